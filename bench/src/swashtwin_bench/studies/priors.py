"""Priors of twins and faults for the zero-shot study: no fault was measured, so its size is a guess.

The guess decides the score, and the virtual rig's own widths would be a gift. So there are two: `wide_fault` knows what
the literature calls plausible, `rig_fault` knows what the rig draws, and the study says which is which.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from operator import add

import numpy as np

from swashtwin.calibration import Calibration
from swashtwin.foundation import deg, derive_seed, mm, stream, um
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    OperatingCondition,
    PistonWear,
    SealingLandScratch,
    SwashPlateDefect,
    ValvePlateWear,
)
from swashtwin.synthesis import Variation, simulate_windows

Draw = Callable[[str, int, np.random.Generator], Fault | None]
"""A fault of a class; its number decides the kind where a class has several."""

_ANGLES = (math.radians(200), math.radians(340))
_PLAUSIBLE: Mapping[str, tuple[Fault, ...]] = {
    "swash_plate": (SwashPlateDefect(depth=mm(0.1), length=mm(30), width=mm(24)),),
    "cylinder_block": (BoreDefect(depth=um(120)),),
    "piston": (PistonWear(clearance=um(40)),),
    "valve_plate": (DamScratch(area=1e-6), GrooveErosion(advance=deg(2))),
}
_OTHERS: Mapping[str, tuple[Fault, ...]] = {
    "cylinder_block": (SealingLandScratch(conductance=1.2e-12),),
    "valve_plate": (ValvePlateWear(film_increase=um(9)),),
}
RIG_FAULTS: Mapping[str, tuple[Fault, ...]] = {
    "swash_plate": (SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24)),),
    "cylinder_block": (BoreDefect(depth=um(270), half_width=deg(40)),),
    "piston": (PistonWear(clearance=um(60)),),
    "valve_plate": (DamScratch(area=0.8e-6), GrooveErosion(advance=deg(5))),
}


def wide_fault(label: str, number: int, rng: np.random.Generator) -> Fault | None:
    """Fault with a severity log-uniform over a decade around what docs/explanation/physics.md, section 5, calls
    plausible.

    The middles: recess 0.1 mm (what rejects a pump), bush 120 um, clearance 40 um, dam scratch 1 mm^2, grooves 2 deg.
    The place of a defect is anywhere on the pressure side, a bush is felt over +-20...50 deg.
    """
    return _spread(_PLAUSIBLE, label, number, rng)


def any_fault(label: str, number: int, rng: np.random.Generator) -> Fault | None:
    """The same with further kinds of a class that the rig has not: a scratched sealing land, a worn valve plate."""
    kinds = {name: (*faults, *_OTHERS.get(name, ())) for name, faults in _PLAUSIBLE.items()}
    return _spread(kinds, label, number, rng)


def rig_fault(label: str, number: int, rng: np.random.Generator) -> Fault | None:
    """Fault as typical and as spread as on the virtual rig (docs/bench/rig.md). For a real pump these are not known."""
    if label not in RIG_FAULTS:
        return None
    kinds = RIG_FAULTS[label]
    return kinds[number % len(kinds)].scaled(float(np.exp(rng.normal(0, 0.2))))


def _spread(
    plausible: Mapping[str, tuple[Fault, ...]], label: str, number: int, rng: np.random.Generator
) -> Fault | None:
    if label not in plausible:
        return None
    kinds = plausible[label]
    fault = kinds[number % len(kinds)].scaled(float(10 ** rng.uniform(-0.5, 0.5)))
    if isinstance(fault, SwashPlateDefect | BoreDefect):
        fault = replace(fault, angle=float(rng.uniform(*_ANGLES)))
    if isinstance(fault, BoreDefect):
        fault = replace(fault, half_width=deg(float(rng.uniform(20, 50))))
    return fault


def prior_twins(calibration: Calibration, count: int, seed: int) -> list[Twin]:
    """Twins drawn from what was known before any measurement: values, mounting, gains and modes of the housing."""
    unknowns = calibration.posterior.unknowns
    before = replace(calibration.posterior, point=unknowns.center, covariance=np.diag(unknowns.deviation**2))
    return before.twins(calibration.nominal, count, seed)


def posterior_twins(calibration: Calibration, count: int, seed: int) -> list[Twin]:
    """Twins drawn from what a calibration knows."""
    return calibration.posterior.twins(calibration.nominal, count, seed)


_TWIN = ", twin: "


def twin_name(pump: str, kind: str, number: int) -> str:
    """Specimen that the windows of a pump's twin carry: no two twins of a study share one, for each has its own healthy
    windows to be compared with."""
    return f"{pump}{_TWIN}{kind} {number}"


def pump_of(specimen: str) -> str:
    """Pump whose twin, or which itself, carries this name.

    Examples
    --------
    >>> pump_of(twin_name("A", "nominal", 3)), pump_of("A")
    ('A', 'A')
    """
    return specimen.partition(_TWIN)[0]


def synthetic_windows(
    twins: Mapping[str, Sequence[Twin]],
    conditions: Sequence[OperatingCondition],
    healthy: WindowSet,
    fault: Draw,
    *,
    kind: str,
    count: int,
    seed: int,
) -> WindowSet:
    """Windows of every class, from each twin at each condition, over the noise of its own pump's healthy windows.

    Parameters
    ----------
    twins : of each pump.
    healthy : measured windows of the pumps without a fault.
    fault : draws a fault.
    kind : what the twins are called (`twin_name`).
    count : windows of each twin, condition and class.
    """
    parts = []
    for pump, pump_twins in twins.items():
        like = healthy.subset(healthy.specimen == pump)
        for condition, label in product(conditions, healthy.classes):
            purpose = ("zero-shot", kind, pump, label, round(condition.discharge_pressure))
            rng = stream(seed, *purpose)
            numbers = [(number, turn) for turn in range(count) for number in range(len(pump_twins))]
            faulty = [
                pump_twins[number].at(condition).with_fault(fault(label, number + turn, rng))
                for number, turn in numbers
            ]
            windows = simulate_windows(
                faulty,
                count=len(faulty),
                like=like,
                seed=derive_seed(seed, *purpose) % 2**31,
                variation=_VARIATION,
            )
            names = np.array([twin_name(pump, kind, number) for number, _ in numbers])
            parts.append(replace(windows, specimen=names))
    return reduce(add, parts)


_VARIATION = Variation(severity=0.0, angle=0.0)
"""Of all but the fault, which is drawn before."""
