"""Profile likelihood: how much worse the best fit becomes when one coordinate is held at other values.

A linearized interval sees only the neighborhood of the optimum; a profile follows the valley, however bent, and shows
where it never rises: there the value is not identified (Raue et al. 2009, doi:10.1093/bioinformatics/btp358).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import torch
from jaxtyping import Float

from swashtwin.calibration.methods.search import one_thread
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.discrepancy import discrepancy_of, linearized, noise_covariance
from swashtwin.calibration.uncertainty.profile_likelihood import Valley, interval_of, walk
from swashtwin.foundation import InputError

_WIDER = 10.0
"""By how much the priors of the six values are widened: they then say nothing, but keep flat valleys in place."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The least misfit over all other coordinates, for values of one."""

    name: str
    """Letter of the value, or name of the nuisance, as in `Unknowns.names`."""
    coordinate: Float[np.ndarray, " point"]
    """Where it was held, rising: the logarithm, but for the residue of a housing mode."""
    rise: Float[np.ndarray, " point"]
    """Rise of the sum of squares above the least [1]: 2.71 ends the interval of 90 %."""
    best: float
    """Coordinate of the least."""
    interval: tuple[float | None, float | None]
    """Coordinates at which the rise passes the threshold; None where it does not before the bound."""
    bounds: tuple[float, float]
    """Where it was searched."""
    simulations: int
    """How many parameter sets were simulated, each with its derivatives."""

    @property
    def is_identified(self) -> bool:
        """Whether the interval closes on both sides."""
        return None not in self.interval

    @property
    def words(self) -> str:
        """What it says."""
        below, above = self.interval
        if self.is_identified:
            return f"{self.name}: closed on both sides"
        if below is None and above is None:
            return f"{self.name}: not identified, open on both sides"
        return f"{self.name}: only {'an upper' if below is None else 'a lower'} limit"

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it."""
        arrays = {"coordinate": self.coordinate.tolist(), "rise": self.rise.tolist()}
        pairs = {"interval": list(self.interval), "bounds": list(self.bounds)}
        return {"name": self.name, **arrays, "best": self.best, **pairs, "simulations": self.simulations}


def profile(objective: Objective, point: Float[np.ndarray, " unknown"], name: str) -> Profile:
    """Profile of the coordinate `name`, walked from `point` to both sides, until the rise is clear or a bound is met.

    Lines are weighed by the covariance of `discrepancy` at `point`, so the least may lie beside it. Nuisances keep
    their priors, the six values have none but their bounds.

    Raises
    ------
    InputError
        No such coordinate.
    """
    names = objective.unknowns.names
    if name not in names:
        raise InputError(f"no coordinate {name!r} was searched; there are {', '.join(names)}.")
    return profiles(objective, point, (name,))[0]


def profiles(
    objective: Objective, point: Float[np.ndarray, " unknown"], names: tuple[str, ...] | None = None
) -> tuple[Profile, ...]:
    """Profiles of several coordinates; of the six values by default."""
    names = objective.unknowns.names[:6] if names is None else names
    valley = _Likelihood(objective, point)
    with one_thread():
        best, least = valley.descend(np.asarray(point, dtype=float), held=None)
        found = [_walked(valley, best, least, objective.unknowns.names.index(name)) for name in names]
    return tuple(found)


class _Likelihood(Valley):
    """Whitened least squares of all coordinates but one."""

    def __init__(self, objective: Objective, point: np.ndarray) -> None:
        around, unknowns = linearized(objective, point), objective.unknowns
        self.objective, self.lower, self.upper = objective, unknowns.lower, unknowns.upper
        self.root = np.linalg.cholesky(noise_covariance(around, discrepancy_of(around)))
        wider = np.where(np.arange(len(unknowns)) < 6, _WIDER, 1.0)
        self.center, self.precision = unknowns.center, 1 / (unknowns.deviation * wider)
        self.simulations = 1

    def at(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their derivatives."""
        self.simulations += 1
        readings, slope = self.objective.sensitivity(torch.as_tensor(point))
        lines = scipy.linalg.solve_triangular(
            self.root, np.column_stack([(readings - self.objective.measured).numpy(), slope.numpy()]), lower=True
        )
        residual = np.concatenate([lines[:, 0], self.precision * (point - self.center)])
        return residual, np.concatenate([lines[:, 1:], np.diag(self.precision)])


def _walked(valley: _Likelihood, best: np.ndarray, least: float, held: int) -> Profile:
    before = valley.simulations
    coordinate, rise = walk(valley, best, least, held)
    return Profile(
        name=valley.objective.unknowns.names[held],
        coordinate=coordinate,
        rise=rise,
        best=float(coordinate[np.argmin(rise)]),
        interval=interval_of(coordinate, rise),
        bounds=(float(valley.lower[held]), float(valley.upper[held])),
        simulations=valley.simulations - before,
    )
