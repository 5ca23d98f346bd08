"""Twins behind the same protocol as the fillers that need data alone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from swashtwin.calibration import FaultLaw, Posterior
from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import is_same_class
from swashtwin.synthesis import DEFAULT_VARIATION, Background, Variation, simulate_windows


@dataclass(frozen=True, eq=False)
class TwinFiller:
    """Windows of `simulate_windows` as a `Filler`: nominal or calibrated twins, posterior draws, any background."""

    twins: Sequence[Twin]
    """Twins of any classes; those of the cell's class take turns, each taken to the cell's pressure."""
    posterior: Sequence[Posterior] | None = None
    """What the calibration of each twin leaves open, or None to take the twins' values."""
    background: Background = "spectrum"
    """What the windows are laid over, as in `simulate_windows`."""
    variation: Variation = DEFAULT_VARIATION
    """What differs from window to window."""
    laws: Sequence[FaultLaw | None] | None = None
    """Law of a recess for each twin, or None for the fault's own."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell, made with the twins of its class (`Filler`)."""
        numbers = [number for number, twin in enumerate(self.twins) if is_same_class(twin.label, label)]
        if not numbers:
            labels = ", ".join(sorted({twin.label for twin in self.twins})) or "nothing"
            raise InputError(f"no twin simulates {label!r}; those given simulate {labels}.")
        conditions = [self.twins[number].condition for number in numbers]
        if not math.isnan(pressure):
            conditions = [condition.replaced(discharge_pressure=pressure) for condition in conditions]
        return simulate_windows(
            [self.twins[number].at(condition) for number, condition in zip(numbers, conditions, strict=True)],
            count=count,
            like=train,
            seed=seed,
            variation=self.variation,
            background=self.background,
            posterior=None if self.posterior is None else [self.posterior[number] for number in numbers],
            law=None if self.laws is None else [self.laws[number] for number in numbers],
        )
