"""Copies of measured windows: the controls that every other filler has to beat."""

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
    """Random oversampling: measured windows of the cell, drawn with replacement and repeated as
    they are.
    """

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """`count` windows of the cell, each a copy of a measured one (`Filler`)."""
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
    """Power of the window over that of the noise, per channel [dB]."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """`count` windows of the cell, each a copy of a measured one with noise (`Filler`)."""
        sources = draw_sources(train, label, pressure, count, seed)
        noise = derive_seed(seed, "noisy duplicate", label)
        signal = np.stack(
            [
                add_noise(train.signal[source].astype(float), self.snr_db, noise, i)
                for i, source in enumerate(sources)
            ]
        )
        return fill_cell(
            signal,
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
    """Index of the measured window that each synthetic one comes from; no window repeats before all
    were drawn.
    """
    require_count(count)
    return draw_indices(find_sources(train, label, pressure), label, count, seed)


def draw_indices(
    sources: Int64[np.ndarray, " source"], label: str, count: int, seed: int
) -> Int64[np.ndarray, " window"]:
    """`count` of `sources` in random order; no window repeats before all were drawn."""
    rng = random_stream(seed, "sources", label)
    rounds = -(-count // len(sources))
    return np.concatenate([rng.permutation(sources) for _ in range(rounds)])[:count]
