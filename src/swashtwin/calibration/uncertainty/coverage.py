"""Whether intervals hold what they promise: calibrations of a twin's own lines, over many draws of the noise."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float

from swashtwin.calibration.methods.gauss_newton import GaussNewton
from swashtwin.calibration.methods.search import Calibrator
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.identifiability_report import estimates_of, posterior_covariance
from swashtwin.foundation import InputError, stream


@dataclass(frozen=True, eq=False)
class Coverage:
    """How often intervals held the truth, of each of the six values."""

    letters: tuple[str, ...]
    """The values' letters."""
    held: Bool[np.ndarray, "draw 6"]
    """Whether the interval held the truth."""
    identified: Bool[np.ndarray, "draw 6"]
    """Whether the value was called identified."""
    error: Float[np.ndarray, "draw 6"]
    """Logarithm of value found over truth, in its standard deviations."""

    @property
    def of_identified(self) -> float:
        """Share of the identified values whose interval held the truth; NaN where there are none."""
        return float(self.held[self.identified].mean()) if self.identified.any() else float("nan")

    @property
    def off_by_three(self) -> float:
        """Share of the identified values that are off by more than three standard deviations (0.003 is chance)."""
        return float((np.abs(self.error[self.identified]) > 3).mean()) if self.identified.any() else float("nan")

    @property
    def by_letter(self) -> dict[str, float]:
        """Share of the intervals that held the truth, whatever the verdict."""
        return dict(zip(self.letters, self.held.mean(axis=0).tolist(), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """The shares, as JSON can hold them."""
        shares = dict(zip(self.letters, self.identified.mean(axis=0).tolist(), strict=True))
        of_identified, off = (
            value if np.isfinite(value) else None for value in (self.of_identified, self.off_by_three)
        )
        return {
            "draws": len(self.held),
            "of_identified": of_identified,
            "off_by_three": off,
            "by_letter": self.by_letter,
            "identified": shares,
        }


def check_coverage(
    objective: Objective,
    truth: Float[np.ndarray, " unknown"],
    *,
    draws: int = 60,
    seed: int = 0,
    method: Calibrator | None = None,
) -> Coverage:
    """Coverage of the intervals where the twin at `truth` is what is measured, with noise as `Comparison.sigma` says.

    Parameters
    ----------
    truth : coordinates within the bounds.
    draws : how often noise is drawn and the twin calibrated.
    method : `GaussNewton` with one start by default.
    """
    if draws < 1:
        raise InputError(f"draws ({draws}) must be at least 1.")
    method = GaussNewton(starts=1) if method is None else method
    clean = objective.with_readings(_lines(objective, np.asarray(truth)))
    held, identified, error = [], [], []
    for index in range(draws):
        noise = clean.sigma.numpy() * stream(seed, "coverage", index).standard_normal(len(clean.sigma))
        readings = clean.measured.numpy() + noise
        noisy = objective.with_readings(readings if objective.has_phases else np.abs(readings))
        point = method.search(noisy, seed=seed).point
        found = estimates_of(noisy, point, posterior_covariance(noisy, point))
        low, high = np.log([one.interval for one in found]).T
        held.append((low <= truth[:6]) & (truth[:6] <= high))
        identified.append([one.verdict == "identified" for one in found])
        error.append((point[:6] - truth[:6]) / [one.log_std for one in found])
    letters = tuple(objective.unknowns.names[:6])
    return Coverage(letters, np.array(held), np.array(identified), np.array(error))


def _lines(objective: Objective, point: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return objective.readings(torch.as_tensor(point)).numpy()
