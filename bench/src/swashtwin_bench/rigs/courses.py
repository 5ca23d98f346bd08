"""Recordings of one of the rig's pumps, which `rig_recordings` does not have: trends and courses.

A trend has faults of chosen severity, as the rig takes them. In a course, weeks of service in a
plant, healthy or with a fault that grows, the pump is not taken apart between recordings. Its load
and its oil temperature drift over days and weeks, more than between the recordings that a baseline
learns from.
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
"""Fault of each trend, as severe as the rig's typical one (docs/bench/rig.md)."""


def typical_faults(version: str) -> Mapping[str, Fault]:
    """Typical fault of each trend in a version of the rig; versions 1 and 2 have the same,
    `TRENDS`.
    """
    return (
        {mode: Damage(1.0, mode) for modes in MODES.values() for mode in modes}
        if version == "3"
        else TRENDS
    )


def trend_recordings(
    seed: int,
    specimen: str,
    *,
    severities: Sequence[float] = (0.3, 0.6, 1.0, 1.7, 3.0),
    healthy: int = 5,
    pressure: float = MPa(10),
    duration: float = 4.0,
) -> Iterator[tuple[Recording, Run]]:
    """Healthy recordings of one pump, then its trend with each fault of `TRENDS`, each with the
    truth behind it.

    As in the rig, the pump is taken apart before each recording, and its condition varies. No
    recording of `rig_recordings` is among them.

    Parameters
    ----------
    seed : which fleet.
    specimen : which pump of it, such as ``"A"``.
    severities : over the typical one; the widths of bores scatter as in the rig.
    pressure : set discharge pressure [Pa].
    duration : length of each recording [s].
    """
    pump = draw_specimen(load_pump("25scy14-1b"), specimen, seed)
    named_faults: list[tuple[str, Fault | None]] = [
        (f"{specimen}_trend_normal_{n + 1}", None) for n in range(healthy)
    ]
    for kind, typical in TRENDS.items():
        named_faults += [
            (f"{specimen}_trend_{kind}_{factor:g}", typical.scaled(factor)) for factor in severities
        ]
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


PER_DAY = 3
"""Recordings in a day."""

# Period [day] of the slow swing of load and temperature; its phase differs from course to course.
_SEASON = 60.0

# Time [day] in which the wandering of load and temperature is forgotten.
_MEMORY = 5.0


@dataclass(frozen=True)
class PlantCourse:
    """What happens to a pump, recording after recording."""

    recordings: int = 360
    """How many."""
    kind: str | None = None
    """Fault that grows, of `typical_faults` the version, or None for a healthy course."""
    onset: int = 60
    """Recordings before the fault begins."""
    severity: float = 2.0
    """Severity of the last recording over the typical one; it grows evenly from the onset."""
    pressure: float = MPa(10)
    """Set discharge pressure [Pa]."""
    duration: float = 2.0
    """Length of each recording [s]."""
    version: str = RIG_VERSION
    """Version of the rig, a name in `writing.VERSIONS`."""

    def severities(self) -> Float64[np.ndarray, " recording"]:
        """Severity over the typical one at each recording; 0 where nothing is wrong."""
        if self.kind is None:
            return np.zeros(self.recordings)
        after = np.arange(1, self.recordings + 1) - self.onset
        return np.clip(after / (self.recordings - self.onset), 0, None) * self.severity


def plant_course(
    seed: int, specimen: str, course: PlantCourse, *, batch: int = 30
) -> Iterator[tuple[Recording, float]]:
    """Recordings of a course in order of time, each with its severity over the typical one.

    Parameters
    ----------
    seed : which fleet.
    specimen : which pump of it, such as ``"A"``.
    batch : recordings computed together; the samples do not depend on it.
    """
    rig, trends = VERSIONS[course.version], typical_faults(course.version)
    pump = rig.draw_specimen(load_pump("25scy14-1b"), specimen, seed)
    severities = course.severities()
    name = f"{specimen}_{course.kind or 'normal'}_course"
    conditions = _conditions(seed, name, course, rig.speeds[0])
    for first in range(0, course.recordings, batch):
        numbers = range(first, min(first + batch, course.recordings))
        runs = []
        for number in numbers:
            typical = None if course.kind is None or not severities[number] else trends[course.kind]
            fault = None if typical is None else typical.scaled(float(severities[number]))
            runs.append(Run(pump, conditions[number], fault))
        names = [f"{name}_{number + 1:04d}" for number in numbers]
        signals = rig.measure(runs, course.duration, SAMPLE_RATE, [(seed, item) for item in names])
        for number, item, run, signal in zip(numbers, names, runs, signals, strict=True):
            label = "normal" if run.fault is None else run.fault.label
            recording = make_recording(
                item,
                label,
                course.pressure,
                run,
                signal,
                speed=rig.speeds[0],
                version=course.version,
            )
            yield recording, float(severities[number])


def _conditions(
    seed: int, name: str, course: PlantCourse, set_speed: float
) -> list[OperatingCondition]:
    """What holds at each recording: a slow swing, a wandering of days, and scatter from recording
    to recording.
    """
    rng = random_stream(seed, "plant", name)
    count = course.recordings
    day = np.arange(count) / PER_DAY

    def drift(swing: float, wander: float, scatter: float) -> Float64[np.ndarray, " recording"]:
        keep = np.exp(-1 / (_MEMORY * PER_DAY))
        walk = np.empty(count)
        state = rng.normal()
        for number, step in enumerate(rng.normal(size=count)):
            state = keep * state + np.sqrt(1 - keep**2) * step
            walk[number] = state
        season = np.sin(2 * np.pi * (day / _SEASON + rng.random()))
        return np.asarray(swing * season + wander * walk + scatter * rng.normal(size=count))

    temperature = np.clip(45 + drift(7.0, 3.0, 2.0), 25, 65)
    load = np.clip(drift(0.015, 0.01, 0.005), -0.045, 0.045)
    speed = rng.uniform(0.997, 1.003, count)
    return [
        OperatingCondition(
            speed=set_speed * speed[number],
            discharge_pressure=course.pressure * (1 + load[number]),
            oil_temperature=celsius(temperature[number]),
        )
        for number in range(count)
    ]
