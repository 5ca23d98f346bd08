"""The windows that `synthesize` makes, with their fidelity to measured windows of the same class."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from swashtwin.learning import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.synthesis.fidelity import Fidelity, measure_fidelity


@dataclass(frozen=True, eq=False, repr=False)
class SyntheticWindows(WindowSet):
    """Windows of one class that a twin made, and what they can be compared with."""

    measured: WindowSet | None = None
    """Measured windows of the class; None where there are none."""
    seed: int = 0
    """Seed that made them."""

    @classmethod
    def of(cls, windows: WindowSet, measured: WindowSet | None, seed: int) -> "SyntheticWindows":
        """`windows`, with the measured ones that they are to be compared with."""
        return cls(
            **{item.name: getattr(windows, item.name) for item in fields(WindowSet)}, measured=measured, seed=seed
        )

    @cached_property
    def fidelity(self) -> Fidelity | None:
        """How well they are told from the measured windows, and by what; None where the class was not measured.

        It takes some seconds, and is computed when it is first asked for.
        """
        return None if self.measured is None else measure_fidelity(self.measured, self, seed=self.seed)


def comparable_windows(like: WindowSet, synthetic: WindowSet, specimen: str | None = None) -> WindowSet | None:
    """Measured windows of `like` to compare synthetic ones with: of their class, at their pressures where there are
    some; None where the class was not measured.

    Parameters
    ----------
    specimen : machine whose windows alone are taken; None takes those of all.
    """
    same = ~like.synthetic & np.isin(like.label, synthetic.label)
    if specimen is not None:
        same &= like.specimen == specimen
    near = np.zeros(len(like), dtype=bool)
    for pressure in np.unique(synthetic.discharge_pressure):
        near |= np.asarray(values_match(like.discharge_pressure, float(pressure), PRESSURE_TOLERANCE))
    if (same & near).any():
        same &= near
    return like.subset(same) if same.any() else None
