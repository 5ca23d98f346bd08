"""Twins behind the same protocol as the fillers that need data alone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from swashtwin.calibration import Posterior
from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.synthesis.background import Background
from swashtwin.synthesis.twin_windows import synthesize
from swashtwin.synthesis.variation import DEFAULT_VARIATION, Variation


@dataclass(frozen=True, eq=False)
class TwinFiller:
    """What `synthesize` makes, as a `Filler`: nominal twins, calibrated ones, with posterior draws, over any noise."""

    twins: Sequence[Twin]
    """Twins of any classes; those of the cell's class take turns, each taken to the cell's pressure."""
    posterior: Sequence[Posterior] | None = None
    """What the calibration of each twin leaves open, or None to take the values found."""
    background: bool | Background = True
    """What the windows are laid over, as in `synthesize`."""
    machines: Sequence[str] | None = None
    """Specimen that each twin stands for, whose windows alone lend it noise; None takes those of all."""
    variation: Variation = DEFAULT_VARIATION
    """What differs from window to window."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell, made with the twins of its class (`Filler`)."""
        own = [place for place, twin in enumerate(self.twins) if twin.label == label]
        if not own:
            known = ", ".join(sorted({twin.label for twin in self.twins})) or "nothing"
            raise InputError(f"no twin simulates {label!r}; those given simulate {known}.")
        conditions = [self.twins[i].condition for i in own]
        if not math.isnan(pressure):
            conditions = [one.replaced(discharge_pressure=pressure) for one in conditions]
        return synthesize(
            [self.twins[i].at(condition) for i, condition in zip(own, conditions, strict=True)],
            label=label,
            count=count,
            like=train,
            seed=seed,
            variation=self.variation,
            background=self.background,
            posterior=None if self.posterior is None else [self.posterior[i] for i in own],
            machines=None if self.machines is None else [self.machines[i] for i in own],
        )
