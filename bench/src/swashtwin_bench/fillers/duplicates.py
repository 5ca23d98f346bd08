"""Copies of measured windows: the controls that other fillers must exceed."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from swashtwin.foundation import derive_seed, random_stream
from swashtwin.learning import WindowSet
from swashtwin.signals import add_noise
from swashtwin.synthesis import require_count
from swashtwin_bench.fillers.filler import fill_cell, find_sources


@dataclass(frozen=True)
class Duplicate:
    """Random oversampling: unchanged copies of measured windows of the cell."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """Return `count` copies of measured windows (`Filler`)."""
        sources = draw_sources(train, label, pressure, count, seed)
        return fill_cell(
            train.signal[sources],
            sources,
            train=train,
            name="duplicate",
            label=label,
            pressure=pressure,
            seed=seed,
        )


@dataclass(frozen=True)
class NoisyDuplicate:
    """Copies of measured windows, each with different white noise."""

    snr_db: float = 30.0
    """Ratio of the power of the window to that of the noise, per channel [dB]."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """Return `count` copies of measured windows with noise (`Filler`)."""
        sources = draw_sources(train, label, pressure, count, seed)
        noise_seed = derive_seed(seed, "noisy duplicate", label)
        noisy = [
            add_noise(train.signal[source].astype(float), self.snr_db, noise_seed, i)
            for i, source in enumerate(sources)
        ]
        return fill_cell(
            np.stack(noisy),
            sources,
            train=train,
            name="noisy_duplicate",
            label=label,
            pressure=pressure,
            seed=seed,
        )


def draw_sources(
    train: WindowSet, label: str, pressure: float, count: int, seed: int
) -> np.ndarray:
    """Return the index of the measured window from which each synthetic one is made."""
    require_count(count)
    return draw_indices(find_sources(train, label, pressure), label, count, seed)


def draw_indices(
    sources: Int64[np.ndarray, " source"], label: str, count: int, seed: int
) -> Int64[np.ndarray, " window"]:
    """Return `count` of `sources` in random order; none repeats before all were drawn."""
    rng = random_stream(seed, "sources", label)
    n_rounds = math.ceil(count / len(sources))
    rounds = [rng.permutation(sources) for _ in range(n_rounds)]
    return np.concatenate(rounds)[:count]
