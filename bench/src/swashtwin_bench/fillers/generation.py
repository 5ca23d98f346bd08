"""What the generative fillers share: conditions, batches, the windows made of scores, and the model learned last."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor, nn

from swashtwin.foundation import TorchStream, derive_seed, stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import require_count
from swashtwin_bench.fillers.duplicates import draw_indices
from swashtwin_bench.fillers.filler import fill_cell, sources_of
from swashtwin_bench.fillers.log_spectra import SpectralForm
from swashtwin_bench.fillers.periodic_extension import cut_extensions, extension_length, periodic_extensions

Draw = Callable[[Tensor, torch.Generator], Tensor]
"""Scores of new windows, from the condition of each."""


@runtime_checkable
class Generative(Protocol):
    """Settings of a generative model of scores, and how it is trained."""

    @property
    def components(self) -> int:
        """Principal components of the logarithmic spectra whose scores are modeled."""

    def learn(
        self, scores: Float[Tensor, "window component"], condition: Float[Tensor, "window fact"], batches: "Batches"
    ) -> Draw:
        """What draws scores under conditions, after it was fitted on these."""
        ...


@dataclass(frozen=True, eq=False)
class Conditions:
    """Class and pressure as a network takes them."""

    classes: int
    """Number of classes."""
    center: float
    """Mean of the logarithm of the training windows' pressure."""
    spread: float
    """Its standard deviation; 1 where there is none."""

    @classmethod
    def fit(cls, windows: WindowSet) -> "Conditions":
        """Those of training windows."""
        log_pressures = np.log(windows.discharge_pressure[np.isfinite(windows.discharge_pressure)])
        spread = float(log_pressures.std()) if log_pressures.size else 0.0
        return cls(len(windows.classes), float(log_pressures.mean()) if log_pressures.size else 0.0, spread or 1.0)

    def encode(
        self, target: Int64[np.ndarray, " window"], pressure: Float[np.ndarray, " window"]
    ) -> Float64[np.ndarray, "window fact"]:
        """One column for each class, and the logarithm of the pressure, scaled; 0 where it is not known."""
        scaled = (np.log(pressure) - self.center) / self.spread
        return np.concatenate([np.eye(self.classes)[target], np.nan_to_num(scaled)[:, None]], axis=1)


@dataclass(frozen=True, eq=False)
class Batches:
    """Which windows a step learns from, drawn so that a cell counts as the square root of its size."""

    share: Float64[np.ndarray, " window"]
    """Probability of each window."""
    seed: int
    """Addresses the draws, the weights and the noise of the learning."""

    @classmethod
    def fit(cls, windows: WindowSet, seed: int) -> "Batches":
        """Those of training windows."""
        cells = np.column_stack([windows.target, np.nan_to_num(windows.cell_pressure)])
        cell = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
        share = 1 / np.sqrt(np.bincount(cell)[cell])
        return cls(share / share.sum(), seed)

    def draw(self, steps: int, size: int) -> Int64[np.ndarray, "step window"]:
        """Indices of the windows of each step."""
        rng = stream(self.seed, "batches")
        return rng.choice(len(self.share), size=(steps, size), p=self.share)


def dense(widths: tuple[int, ...], seed: int) -> nn.Sequential:
    """Linear layers of `widths` with SiLU between them, their weights drawn from `seed`."""
    with TorchStream(seed):
        layers: list[nn.Module] = []
        for entering, leaving in pairwise(widths):
            layers += [nn.Linear(entering, leaving), nn.SiLU()]
    return nn.Sequential(*layers[:-1])


def fill_with_model(
    model: Generative,
    name: str,
    train: WindowSet,
    *,
    label: str,
    pressure: float,
    count: int,
    seed: int,
) -> WindowSet:
    """`count` windows of a cell with scores that `model` draws, and phases and noise of measured windows of the class.

    Each begins at another angle of the shaft.
    """
    require_count(count)
    sources_of(train, label, pressure)
    measured = train.subset(~train.synthetic & (train.target >= 0))
    lengths = [extension_length(measured, i) for i in range(len(measured))]
    extensions = periodic_extensions(measured, np.arange(len(measured)), max(lengths))
    conditions = Conditions.fit(measured)
    condition = conditions.encode(measured.target, measured.discharge_pressure)
    model_seed = derive_seed(seed, name)
    form = SpectralForm.fit(extensions, condition, model.components, model_seed)
    points = _tensor(form.scores(extensions, condition))
    draw = model.learn(points, _tensor(condition), Batches.fit(measured, model_seed))
    indices = draw_indices(np.flatnonzero(measured.label == label), label, count, seed)
    conditions_wanted = conditions.encode(np.full(count, train.classes.index(label)), np.full(count, float(pressure)))
    random = torch.Generator().manual_seed(derive_seed(seed, name, "draw", label, pressure))
    with torch.no_grad():
        scores = draw(_tensor(conditions_wanted), random).numpy().astype(float)
    conditions_measured = conditions.encode(measured.target[indices], measured.discharge_pressure[indices])
    extensions = form.rebuild(
        scores, conditions_wanted, periodic_extensions(measured, indices, form.length), conditions_measured
    )
    signal = cut_extensions(extensions, measured, indices, stream(seed, name, "angle", label, pressure))
    return fill_cell(signal, indices, train=measured, name=name, label=label, pressure=pressure, seed=seed)


def _tensor(values: np.ndarray) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32)
