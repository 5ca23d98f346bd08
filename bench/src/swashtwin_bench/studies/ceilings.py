"""Ceilings: windows of models that know the hidden truth of the virtual rig.

They show what a study could show at most: a calibration can find no better values than the true
ones, and no model has better lines than the rig itself. Both are drawn for the training pumps of a
fleet, with assemblies, severities and operating points of their own, so that they share nothing
with a recording. A product cannot make them, since a plant does not know the truth.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import random_stream
from swashtwin.learning import WindowSet
from swashtwin.physics import Scales, Twin
from swashtwin.pump import (
    Fault,
    Interfaces,
    OperatingCondition,
    SwashPlateDefect,
    is_healthy,
    load_pump,
)
from swashtwin.signals import synchronous_signal
from swashtwin.synthesis import Variation, build_windows, simulate_windows
from swashtwin_bench.rigs.fleet import Specimen, draw_fault, film_factors
from swashtwin_bench.rigs.measuring import Run, sensor_lines
from swashtwin_bench.rigs.writing import (
    PUMPS,
    RIG_VERSION,
    VERSIONS,
    WIDE_VERSION,
    draw_run,
)
from swashtwin_bench.studies.dataset import StudyDataset

TRUE_VALUES = "ceiling_true"
"""Source of twins with the true values of the training pumps."""

PERFECT_MODEL = "ceiling_perfect"
"""Source of the rig's own lines of the training pumps without noise or drift."""

CEILINGS = (TRUE_VALUES, PERFECT_MODEL)
"""Sources that need the hidden truth."""

KNOWN_RIGS = (RIG_VERSION, WIDE_VERSION)
"""Versions of the rig whose truth they can draw: both have the measurement of version 1."""

NO_VARIATION = Variation(0.0, 0.0, 0.0, 0.0, interfaces=0.0, sensor=0.0)
"""Equal windows of a twin, apart from phase and temperature."""

# Bandwidth over the piston-pass frequency of a twin whose lines are subtracted again: above 1, as
# the twin requires, and with few lines to compute.
_FEW_LINES = 1.01


def draw_training_pumps(dataset: StudyDataset) -> list[Specimen]:
    """Return the training pumps of the fleet with their true properties.

    The seed of the dataset is that of the fleet, and its rig one of `KNOWN_RIGS`.
    """
    nominal = load_pump(PUMPS[dataset.measured.n_channels])
    names = sorted(set(dataset.measured.specimen.tolist()))
    draw_specimen = VERSIONS[dataset.rig].draw_specimen
    return [draw_specimen(nominal, name, dataset.seed) for name in names]


def build_true_twins(
    dataset: StudyDataset,
    faults: Sequence[Fault | None],
    conditions: Sequence[OperatingCondition],
) -> list[Twin]:
    """Return twins with the true interface values, mounting and bearings of the training pumps.

    There is one for each kind of fault, operating point and pump. The rest of the drawing is the
    nominal one. The films have their values at 45 degC, and slippers follow a recess as those of
    the pump do.
    """
    twins = []
    for fault, condition, specimen in product(faults, conditions, draw_training_pumps(dataset)):
        pump = dataset.scenario.pump
        pump = replace(pump, name=f"{pump.name} ({specimen.name})")
        if isinstance(fault, SwashPlateDefect):
            fault = replace(fault, corner=specimen.following_cutoff, gain=specimen.following)
        factors = film_factors(condition.discharge_pressure, relative_viscosity=1.0)
        interfaces = Interfaces.from_values(specimen.values * factors)
        scales = Scales(mount=specimen.mount, bearing=specimen.bearing)
        twins.append(Twin(pump, condition, fault, interfaces, scales=scales))

    return twins


def specimen_of(twin: Twin) -> str:
    """Return the training pump that a twin was made for, as its name says; empty if it is nominal.

    Examples
    --------
    >>> pump = replace(load_pump("25scy14-1b"), name="25scy14-1b (A)")
    >>> specimen_of(Twin(pump, OperatingCondition(speed=90.0, discharge_pressure=15e6)))
    'A'
    """
    return twin.pump.name.partition(" (")[2].removesuffix(")")


def record_perfect_windows(
    dataset: StudyDataset,
    label: str,
    pressure: float,
    *,
    count: int,
    assemblies: int,
    seed: int,
    own_noise: bool = False,
) -> WindowSet:
    """Return windows of the rig's own lines, with the noise that windows of twins have.

    Parameters
    ----------
    pressure : set discharge pressure [Pa].
    assemblies : numbers of assemblies and severities; the training pumps take turns.
    own_noise : lay the lines of a pump over its own noise, not over that of all training pumps.
    """
    measured = dataset.measured
    pumps = draw_training_pumps(dataset)
    (condition,) = dataset.conditions(pressure)
    time = np.arange(measured.length) / measured.sample_rate
    lenders = [pump.name for pump in pumps] if own_noise else [""]
    signal = draw_noise(dataset, condition, lenders, count=count, seed=seed)

    specimens = []
    for index in range(count):
        number = index % assemblies
        pump = pumps[number % len(pumps)]
        # No recording has such a name, so none shares an assembly or a severity.
        assembly = f"ceiling_{pump.name}_{label}_{pressure / 1e6:g}MPa_{number}"
        fault = draw_fault(label, pump.name, dataset.seed, assembly)
        run = draw_run(f"{assembly}_{index}", pump, pressure, dataset.seed, fault)
        run = replace(run, specimen=pump.reassemble(dataset.seed, assembly))

        rng = random_stream(seed, "ceiling", label, index)
        signal[index] += _record_lines(run, rng.uniform(0, 2 * math.pi), time)
        specimens.append(f"lines of {run.specimen.pump.name} ({pump.name})")

    return build_windows(
        signal,
        like=measured,
        name=PERFECT_MODEL,
        label=label,
        pressure=np.full(count, pressure),
        speed=np.full(count, condition.speed),
        specimen=np.array(specimens, dtype=np.str_),
        seed=seed,
    )


def _record_lines(
    run: Run, phase: float, time: Float[np.ndarray, " time"]
) -> Float[np.ndarray, "sensor time"]:
    """Return the readings [m/s^2] of a run at times [s], with a shaft angle [rad] at time 0."""
    lines = sensor_lines(run)
    orders = np.arange(1, lines.shape[1] + 1)
    return synchronous_signal(lines, orders, phase + run.condition.speed * time)


def draw_noise(
    dataset: StudyDataset,
    condition: OperatingCondition,
    lenders: Sequence[str],
    *,
    count: int,
    seed: int,
) -> Float[np.ndarray, "window channel time"]:
    """Return the noise that windows of a twin are laid over at an operating point.

    It is the difference of equal windows with and without noise.

    Parameters
    ----------
    lenders : training pumps whose noise the windows have in turns; an empty text stands for all
        pumps together.
    """
    twin = Twin(dataset.scenario.pump, condition)
    piston_pass = twin.pump.rotating_group.piston_count * condition.shaft_frequency
    twin = replace(twin, bandwidth=_FEW_LINES * piston_pass)

    lender = without_gain(dataset.measured)
    silent, noisy = (
        simulate_windows(
            [twin] * len(lenders),
            count=count,
            like=lender,
            seed=seed,
            variation=NO_VARIATION,
            background=background,
            specimens=lenders,
        )
        for background in ("none", "spectrum")
    )
    return noisy.signal.astype(float) - silent.signal


def without_gain(measured: WindowSet) -> WindowSet:
    """Return measured windows that lend noise to a twin, but fit no gain of its channels.

    They are the healthy ones without their label: `simulate_windows` fits the gains to windows that
    are labeled healthy, and else takes the noise of the nearest ones whatever their class.
    """
    healthy_classes = [name for name in measured.classes if is_healthy(name)]
    healthy = measured.subset(np.isin(measured.label, healthy_classes))
    return replace(healthy, target=np.full(len(healthy), -1))
