"""Series of recordings of one pump of the rig: trends of severity and courses of service.

A trend has faults of specified severity, recorded as the rig records them. A course is weeks of
service in a plant, healthy or with a growing fault. The pump is not taken apart between recordings,
and its load and oil temperature drift over days and weeks: more than they vary while a baseline is
learned. `rig_recordings` contains neither.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import MPa, celsius, deg, random_stream, um
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    OperatingCondition,
    PistonWear,
    load_pump,
)
from swashtwin.recordings import Recording
from swashtwin_bench.rigs.fleet import RECESS, draw_specimen
from swashtwin_bench.rigs.measuring import Run, measure
from swashtwin_bench.rigs.version_three.fleet import MODES, Damage
from swashtwin_bench.rigs.writing import (
    RIG_VERSION,
    SAMPLE_RATE,
    VERSIONS,
    draw_run,
    make_recording,
)

TRENDS: Mapping[str, Fault] = MappingProxyType(
    {
        "swash_plate": RECESS,
        "piston": PistonWear(um(60)),
        "cylinder_block": BoreDefect(um(270), half_width=deg(40)),
        "scratched_valve_plate": DamScratch(0.8e-6),
        "eroded_grooves": GrooveErosion(deg(5)),
    }
)
"""Fault of each trend at the rig's typical severity (docs/bench/rig.md)."""

RECORDINGS_PER_DAY = 3

# Period [day] of the slow swing of load and temperature; its phase differs from course to course.
_SEASON_PERIOD_DAYS = 60.0

# Time [day] in which the wandering of load and temperature loses its memory.
_WANDER_MEMORY_DAYS = 5.0


def typical_faults(version: str) -> Mapping[str, Fault]:
    """Return the typical fault of each trend in a version of the rig.

    Versions 1 and 2 share `TRENDS`; version 3 has a trend for each of its modes of damage.
    """
    if version != "3":
        return TRENDS

    typical: dict[str, Fault] = {}
    for modes in MODES.values():
        for mode in modes:
            typical[mode] = Damage(1.0, mode)

    return typical


def trend_recordings(
    seed: int,
    specimen: str,
    *,
    severities: Sequence[float] = (0.3, 0.6, 1.0, 1.7, 3.0),
    healthy: int = 5,
    pressure: float = MPa(10),
    duration: float = 4.0,
) -> Iterator[tuple[Recording, Run]]:
    """Yield healthy recordings of a pump, then its trend with each fault of `TRENDS`.

    Each recording comes with the run that it was measured in. As in the rig, the pump is taken
    apart before each recording, and its operating point varies.

    Parameters
    ----------
    seed : number of the fleet.
    specimen : name of the pump, such as ``"A"``.
    severities : over the typical one; the widths of bores scatter as in the rig.
    healthy : number of healthy recordings.
    pressure : set discharge pressure [Pa].
    duration : length of each recording [s].
    """
    pump = draw_specimen(load_pump("25scy14-1b"), specimen, seed)

    named_faults: list[tuple[str, Fault | None]] = []
    for number in range(healthy):
        named_faults.append((f"{specimen}_trend_normal_{number + 1}", None))
    for kind, typical in TRENDS.items():
        for severity in severities:
            name = f"{specimen}_trend_{kind}_{severity:g}"
            named_faults.append((name, typical.scaled(severity)))

    runs = []
    for name, fault in named_faults:
        run = draw_run(name, pump, pressure, seed, None)
        if isinstance(fault, BoreDefect):
            fault = replace(
                fault, half_width=deg(random_stream(seed, "trend", name).uniform(36, 44))
            )
        runs.append(replace(run, fault=fault))

    signals = measure(runs, duration, SAMPLE_RATE, [(seed, name) for name, _ in named_faults])
    for (name, fault), run, signal in zip(named_faults, runs, signals, strict=True):
        label = "normal" if fault is None else fault.label
        yield make_recording(name, label, pressure, run, signal), run


@dataclass(frozen=True)
class PlantCourse:
    """Weeks of service of one pump, recorded at regular times."""

    recordings: int = 360
    """Number of recordings."""
    kind: str | None = None
    """Growing fault, a name in `typical_faults`, or `None` for a healthy course."""
    onset: int = 60
    """Recordings before the fault begins."""
    severity: float = 2.0
    """Severity of the last recording over the typical one; it grows linearly from the onset."""
    pressure: float = MPa(10)
    """Set discharge pressure [Pa]."""
    duration: float = 2.0
    """Length of each recording [s]."""
    version: str = RIG_VERSION
    """Version of the rig, a name in `writing.VERSIONS`."""

    def severities(self) -> Float64[np.ndarray, " recording"]:
        """Return the severity over the typical one at each recording; 0 without a fault."""
        if self.kind is None:
            return np.zeros(self.recordings)

        since_onset = np.arange(1, self.recordings + 1) - self.onset
        growth = np.clip(since_onset / (self.recordings - self.onset), 0, None)

        return growth * self.severity


def plant_course(
    seed: int,
    specimen: str,
    course: PlantCourse,
    *,
    severities: Sequence[float] | None = None,
    batch: int = 30,
) -> Iterator[tuple[Recording, float]]:
    """Yield the recordings of a course in order of time, each with its severity.

    The severity is relative to the typical one.

    Parameters
    ----------
    seed : number of the fleet.
    specimen : name of the pump, such as ``"A"``.
    severities : severity of each recording over the typical one; the growth of `course` by default.
    batch : recordings computed together; the samples do not depend on it.
    """
    rig = VERSIONS[course.version]
    pump = rig.draw_specimen(load_pump("25scy14-1b"), specimen, seed)
    typical = None if course.kind is None else typical_faults(course.version)[course.kind]
    if severities is None:
        severities = [float(severity) for severity in course.severities()]

    course_name = f"{specimen}_{course.kind or 'normal'}_course"
    conditions = _draw_conditions(seed, course_name, course, rig.speeds[0])

    for first in range(0, course.recordings, batch):
        numbers = range(first, min(first + batch, course.recordings))
        runs = []
        for number in numbers:
            fault = None
            if typical is not None and severities[number] > 0:
                fault = typical.scaled(severities[number])
            runs.append(Run(pump, conditions[number], fault))

        names = [f"{course_name}_{number + 1:04d}" for number in numbers]
        seeds = [(seed, name) for name in names]
        signals = rig.measure(runs, course.duration, SAMPLE_RATE, seeds)

        for number, name, run, signal in zip(numbers, names, runs, signals, strict=True):
            label = "normal" if run.fault is None else run.fault.label
            recording = make_recording(
                name,
                label,
                course.pressure,
                run,
                signal,
                speed=rig.speeds[0],
                version=course.version,
            )
            yield recording, severities[number]


def _draw_conditions(
    seed: int, course_name: str, course: PlantCourse, set_speed: float
) -> list[OperatingCondition]:
    """Return the true operating point of each recording of a course.

    Load and temperature are the sum of a slow swing, a random walk over days, and scatter from
    recording to recording.
    """
    rng = random_stream(seed, "plant", course_name)
    count = course.recordings

    temperature = np.clip(45 + _draw_drift(rng, count, 7.0, 3.0, 2.0), 25, 65)
    load = np.clip(_draw_drift(rng, count, 0.015, 0.01, 0.005), -0.045, 0.045)
    speed = rng.uniform(0.997, 1.003, count)

    return [
        OperatingCondition(
            speed=set_speed * speed[number],
            discharge_pressure=course.pressure * (1 + load[number]),
            oil_temperature=celsius(temperature[number]),
        )
        for number in range(count)
    ]


def _draw_drift(
    rng: np.random.Generator, count: int, swing: float, wander: float, scatter: float
) -> Float64[np.ndarray, " recording"]:
    """Return a drift of amplitude `swing`, with standard deviations `wander` and `scatter`."""
    # First-order autoregression, whose variance stays 1 by the factor on each new step.
    memory = np.exp(-1 / (_WANDER_MEMORY_DAYS * RECORDINGS_PER_DAY))
    walk = np.empty(count)
    state = rng.normal()
    for number, step in enumerate(rng.normal(size=count)):
        state = memory * state + np.sqrt(1 - memory**2) * step
        walk[number] = state

    day = np.arange(count) / RECORDINGS_PER_DAY
    season = np.sin(2 * np.pi * (day / _SEASON_PERIOD_DAYS + rng.random()))

    return np.asarray(swing * season + wander * walk + scatter * rng.normal(size=count))
