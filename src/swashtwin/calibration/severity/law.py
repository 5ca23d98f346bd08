"""The law of a recess as recordings show it: how far slippers follow, under which contact, and how noise rises."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from swashtwin.calibration.severity.dimensions import FaultSpace, search_of
from swashtwin.calibration.uncertainty.posterior import Estimate
from swashtwin.pump import Fault, SwashPlateDefect


@dataclass(frozen=True)
class FaultLaw:
    """What recordings of a recess tell of its law, for the pump that was calibrated beside it."""

    fault: SwashPlateDefect
    """The recess that explains them best."""
    estimates: tuple[Estimate, ...]
    """Its depth, corner and further unknowns; the last is how the noise between the lines rises."""
    evidence: Mapping[str, float]
    """Logarithm of each law's evidence less that of the likeliest, by contact and edge (Laplace's approximation)."""
    misfit: float
    """Root mean square of the lines' differences over what was expected; above 1 the intervals are widened by it."""
    recording_ids: tuple[str, ...]
    """Recordings of the fault."""

    @property
    def floor(self) -> float:
        """Factor on the noise between the lines at the depth of `fault`."""
        return self.estimates[-1].value

    def of(self, fault: Fault | None, corner_shift: float = 0.0) -> Fault | None:
        """`fault` under this law, where it is a recess that states no corner; any other fault as it is.

        Parameters
        ----------
        corner_shift : of ln corner, in standard deviations of its estimate.
        """
        if not isinstance(fault, SwashPlateDefect) or fault.corner:
            return fault
        names = ("contact", "edge", "fall", "gain", "leakage")
        corner = next(item for item in self.estimates if item.letter == "corner")
        drawn = corner.value * math.exp(corner.log_std * corner_shift)
        return replace(fault, corner=drawn, **{name: getattr(self.fault, name) for name in names})

    def space(self, space: FaultSpace) -> FaultSpace:
        """`space` of a severity under this law, its corner searched as far as it is uncertain."""
        lawful = self.of(space.reference)
        if lawful is None or lawful == space.reference:
            return space
        deviation = next(item.log_std for item in self.estimates if item.letter == "corner")
        (corner,) = (item for item in search_of(lawful).dimensions if item.name == "corner")
        return FaultSpace(lawful, (*space.free, replace(corner, deviation=deviation)))

    def floor_of(self, fault: Fault | None) -> float:
        """Factor on the noise with a recess of another depth, of which its logarithm is a multiple; 1 without one."""
        if not isinstance(fault, SwashPlateDefect):
            return 1.0
        return float(self.floor ** (fault.depth / self.fault.depth))
