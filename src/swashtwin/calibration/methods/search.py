"""The protocol of the methods that search, and what they share."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.objective.unknowns import VALUES, Unknowns
from swashtwin.foundation import MissingExtraError
from swashtwin.physics import HarmonicBalance, SteadySolver

EXACT: SteadySolver = HarmonicBalance()
"""The solver of every method's default."""
Progress = Callable[[int, int, float], None]
"""Called with (steps done, steps in all, loss)."""
Decay = Literal["constant", "cosine"]
"""How a step size goes: as it is, or falling to zero at the last step as a cosine does."""


@dataclass(frozen=True, eq=False)
class History:
    """History of a search, one entry a step."""

    spectrum_loss: Float[np.ndarray, " step"]
    """Distance of the spectra, as the method measures it."""
    boundary_loss: Float[np.ndarray, " step"]
    """Penalty for leaving the bounds; zero for methods that cannot leave them."""
    points: Float[np.ndarray, "step unknown"]
    """Coordinates, in the order of `Unknowns.names`: first the logarithms of the six values."""
    best: int
    """Step of least loss."""
    prior_loss: Float[np.ndarray, " step"] = field(default_factory=lambda: np.empty(0))
    """What the priors add to the loss; zero for methods that count none."""
    gradient_norm: Float[np.ndarray, " gradient"] = field(default_factory=lambda: np.empty(0))
    """Norm of the gradient of the loss with respect to what the method moves: weights, or coordinates in units of their
    priors' deviations. Empty for methods without gradients."""

    def __post_init__(self) -> None:
        if not len(self.prior_loss):
            object.__setattr__(self, "prior_loss", np.zeros_like(self.spectrum_loss))

    @property
    def loss(self) -> Float[np.ndarray, " step"]:
        """What the method minimized."""
        return self.spectrum_loss + self.boundary_loss + self.prior_loss

    @property
    def least_loss(self) -> float:
        """The least loss."""
        return float(self.loss[self.best])

    @property
    def values(self) -> Float[np.ndarray, "step 6"]:
        """Interface values, in the order of `pump.PARAMETERS`."""
        return np.exp(self.points[:, VALUES])


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a method."""

    point: Float[np.ndarray, " unknown"]
    """Coordinates, in the order of `Unknowns.names`."""
    history: History
    """Course of the search."""
    simulations: int
    """How many parameter sets were simulated, with or without their gradient."""
    notes: tuple[str, ...] = ()
    """What the user should look at, in words."""

    @property
    def values(self) -> Float[np.ndarray, " 6"]:
        """Interface values, in the order of `pump.PARAMETERS`."""
        return np.exp(self.point[VALUES])


@runtime_checkable
class Calibrator(Protocol):
    """A method that searches the values with which a twin comes nearest to a measurement."""

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Result of the search. The same seed on the same machine gives the same bits."""
        ...


class Trace:
    """Steps of a search from one start whose loss is the penalized one, as it goes on."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, float, float]] = []
        self._points: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._points)

    @property
    def last_loss(self) -> float:
        """Penalized loss of the last step."""
        return self._rows[-1][1]

    def add(self, point: np.ndarray, weighted: float, penalized: float, gradient_norm: float | None = None) -> None:
        """Keep one step: its point, the losses there, and the norm of the penalized one's gradient."""
        self._points.append(np.array(point))
        self._rows.append((weighted, penalized, np.nan if gradient_norm is None else gradient_norm))

    def arrays(self) -> dict[str, np.ndarray]:
        """All steps so far; `of` makes a trace of them again."""
        return {"points": np.array(self._points), "rows": np.array(self._rows)}

    @classmethod
    def of(cls, points: np.ndarray, rows: np.ndarray) -> "Trace":
        """Trace of the `arrays` of another."""
        trace = cls()
        trace._points = list(points)
        trace._rows = [(float(weighted), float(penalized), float(norm)) for weighted, penalized, norm in rows]
        return trace

    def search(self, simulations: int | None = None) -> Search:
        """The step of least penalized loss; `simulations` where they are not one a step."""
        weighted, penalized, gradient = np.array(self._rows).T
        points, best = np.array(self._points), int(np.argmin(penalized))
        gradient = np.empty(0) if np.isnan(gradient).any() else gradient
        history = History(weighted, np.zeros_like(weighted), points, best, penalized - weighted, gradient)
        return Search(points[best], history, len(self) if simulations is None else simulations)


def best_of(runs: Sequence[Search]) -> Search:
    """The run from the best start, with the simulations of all."""
    best = min(runs, key=lambda run: run.history.least_loss)
    return replace(best, simulations=sum(run.simulations for run in runs))


def with_priors(
    objective: Objective, point: Float[Tensor, "*batch unknown"], weighted: Float[Tensor, "*batch"], first: int = 0
) -> Float[Tensor, "*batch"]:
    """The penalized loss, which every method but the paper's minimizes, where the weighted loss is `weighted`.

    Root of (weighted loss)^2 + (sum of squares of the coordinates' distances from their priors' means, in standard
    deviations) / (number of lines). The negative logarithm of the posterior density is the square of it times half the
    number of lines: all methods have the same minimum.

    Parameters
    ----------
    first : coordinates before this one count without a prior.
    """
    center = torch.as_tensor(objective.unknowns.center)
    point = torch.cat([center[:first].expand(*point.shape[:-1], -1), point[..., first:]], dim=-1)
    return (weighted.square() + objective.prior_loss(point) / objective.measured.numel()).sqrt()


def starting_points(
    unknowns: Unknowns, count: int, generator: np.random.Generator
) -> Iterator[Float[np.ndarray, " unknown"]]:
    """First the twin as it is, then points drawn evenly within the bounds."""
    for number in range(count):
        yield unknowns.start if number == 0 else generator.uniform(unknowns.lower, unknowns.upper)


def load_extra(module: str) -> Any:
    """The optional module, imported when first needed."""
    try:
        return import_module(module)
    except ImportError as cause:
        raise MissingExtraError(
            f'this search needs {module}, which is not installed: pip install "swashtwin[search]".'
        ) from cause
