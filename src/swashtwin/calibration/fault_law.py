"""The law of a recess, as recordings of it identified it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from swashtwin.calibration.fault_dimensions import FaultSpace, get_severity_search
from swashtwin.calibration.posterior import Estimate
from swashtwin.pump import Fault, SwashPlateDefect

NOISE_SYMBOL = "noise"
"""Symbol of the estimate of the factor on the noise between the lines."""


@dataclass(frozen=True)
class FaultLaw:
    """What recordings of a recess show of its law, for the pump that was calibrated with it."""

    fault: SwashPlateDefect
    """The recess that explains them best."""
    estimates: tuple[Estimate, ...]
    """Its depth, corner and further unknowns; the last is the factor on the noise between the
    lines.
    """
    evidence: Mapping[str, float]
    """Logarithm of each law's evidence less that of the likeliest, by contact and edge (Laplace's
    approximation).
    """
    misfit: float
    """Root mean square of the lines' differences over what was expected; above 1 the intervals are
    widened by it.
    """
    recording_ids: tuple[str, ...]
    """Recordings of the fault."""

    @property
    def noise_factor(self) -> float:
        """Factor on the noise between the lines at the depth that was recorded
        (`noise_factor_of`).
        """
        return self.estimates[-1].value

    @property
    def corner(self) -> Estimate:
        """Estimate of the corner [Hz]."""
        return next(estimate for estimate in self.estimates if estimate.symbol == "corner")

    def apply_to(self, fault: Fault | None, corner_shift: float = 0.0) -> Fault | None:
        """Return `fault` under this law if it is a recess that specifies no corner; any other
        fault unchanged.

        Parameters
        ----------
        corner_shift : of ln corner, in standard deviations of its estimate.
        """
        if not isinstance(fault, SwashPlateDefect) or fault.corner:
            return fault
        return replace(
            fault,
            corner=self.corner.value * math.exp(self.corner.log_std * corner_shift),
            contact=self.fault.contact,
            edge=self.fault.edge,
            fall=self.fault.fall,
            gain=self.fault.gain,
            leakage=self.fault.leakage,
        )

    def apply_to_space(self, space: FaultSpace) -> FaultSpace:
        """Return the `space` of a severity under this law, with a corner that is free within its
        uncertainty.
        """
        fault = self.apply_to(space.reference)
        if fault is None or fault == space.reference:
            return space

        dimensions = get_severity_search(fault).dimensions
        (corner,) = (dimension for dimension in dimensions if dimension.name == "corner")
        return FaultSpace(fault, (*space.free, replace(corner, prior_std=self.corner.log_std)))

    def noise_factor_of(self, fault: Fault | None) -> float:
        """Return the factor on the noise with a recess of any depth; 1 without one.

        Its logarithm is proportional to the depth. The recess that was recorded has the estimated
        depth, or the specified one if the recordings do not constrain it.
        """
        if not isinstance(fault, SwashPlateDefect):
            return 1.0
        depth = self.estimates[0]
        recorded_depth = depth.nominal
        if depth.is_constrained:
            recorded_depth = depth.value
        return float(self.noise_factor ** (fault.depth / recorded_depth))
