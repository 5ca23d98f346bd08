"""The protocol of the methods that search, and what they share."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.objective.unknowns import VALUES
from swashtwin.physics import HarmonicBalance, SteadySolver

EXACT: SteadySolver = HarmonicBalance()
"""The solver of every method's default."""
Progress = Callable[[int, int, float], None]
"""Called with (steps done, steps in all, loss)."""


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
    prior_loss: Float[np.ndarray, " step"]
    """What the priors add to the loss."""
    gradient_norm: Float[np.ndarray, " step"]
    """Norm of the gradient of the loss with respect to what the method moves: weights, or coordinates in units of their
    priors' deviations."""

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
