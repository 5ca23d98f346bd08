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
from swashtwin.twin import Scales

EXACT: SteadySolver = HarmonicBalance()
"""The solver of every method's default."""
UNSCALED = Scales()
"""All constants as the pump file says."""

Progress = Callable[[int, int, float], None]
"""Called with (steps done, steps in all, loss)."""

NUISANCES = ("mount", "bearing", "excitation", "sensor")
"""Constants that may be searched beside the six values: the fields of `Scales`, in their order."""

NUISANCE_PRIOR = {"mount": 0.3, "bearing": 0.3, "excitation": 0.5, "sensor": 0.05}
"""Standard deviation of the logarithm of each, before anything is measured (docs/physics.md, section 6)."""


@dataclass(frozen=True, eq=False)
class History:
    """How a search went, one entry a step."""

    spectrum_loss: Float[np.ndarray, " step"]
    """Distance of the spectra, as the method measures it."""
    boundary_loss: Float[np.ndarray, " step"]
    """Penalty for leaving the bounds; zero for methods that cannot leave them."""
    values: Float[np.ndarray, "step 6"]
    """Interface values, in the order of `pump.PARAMETERS`."""
    best: int
    """Step that was kept."""


@dataclass(frozen=True, eq=False)
class Search:
    """What a method found."""

    values: Float[np.ndarray, " 6"]
    """Interface values, in the order of `pump.PARAMETERS`."""
    history: History
    """How it got there."""
    simulations: int
    """How many parameter sets were simulated, with or without their gradient."""
    scales: Scales = UNSCALED
    """Factors that were searched beside the values."""
    nuisances: tuple[str, ...] = ()
    """Which of those were."""


@runtime_checkable
class Calibrator(Protocol):
    """A method that searches the values with which a twin comes nearest to a measurement."""

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """What it found. The same seed on the same machine gives the same bits."""
        ...


def free_logarithms(nuisances: tuple[str, ...]) -> tuple[int, ...]:
    """Places, in the vector of six values and four scales, of what is searched."""
    return (*range(6), *(6 + i for i, name in enumerate(NUISANCES) if name in nuisances))


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it torch uses one thread: more only wait for each other in kernels as small as these."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
