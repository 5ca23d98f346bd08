"""What may be swapped in a calibration: the method that searches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float

from swashtwin.calibration.objective import Objective
from swashtwin.integrators import HarmonicBalance, SteadySolver

EXACT: SteadySolver = HarmonicBalance()
"""The solver of every method's default."""
Progress = Callable[[int, int, float], None]
"""Called with (steps done, steps in all, loss)."""


@dataclass(frozen=True, eq=False)
class History:
    """How a search went, one entry a step."""

    spectrum_loss: Float[np.ndarray, " step"]
    """Distance of the spectra, as the method measures it."""
    boundary_loss: Float[np.ndarray, " step"]
    """Penalty for leaving the bounds; zero for methods that cannot leave them."""
    points: Float[np.ndarray, "step unknown"]
    """Coordinates, in the order of `Unknowns.names`: first the logarithms of the six values."""
    best: int
    """Step that was kept."""

    @property
    def values(self) -> Float[np.ndarray, "step 6"]:
        """Interface values, in the order of `pump.PARAMETERS`."""
        return np.exp(self.points[:, :6])


@dataclass(frozen=True, eq=False)
class Search:
    """What a method found."""

    point: Float[np.ndarray, " unknown"]
    """Coordinates, in the order of `Unknowns.names`."""
    history: History
    """How it got there."""
    simulations: int
    """How many parameter sets were simulated, with or without their gradient."""

    @property
    def values(self) -> Float[np.ndarray, " 6"]:
        """Interface values, in the order of `pump.PARAMETERS`."""
        return np.exp(self.point[:6])


@runtime_checkable
class Calibrator(Protocol):
    """A method that searches the values with which a twin comes nearest to a measurement."""

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """What it found. The same seed on the same machine gives the same bits."""
        ...


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it torch uses one thread: more only wait for each other in kernels as small as these."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
