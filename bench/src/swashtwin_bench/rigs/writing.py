"""Versions of the virtual rig, the recordings that each one takes, and their files."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float

from swashtwin.foundation import (
    InputError,
    MPa,
    celsius,
    parallel,
    random_stream,
    resume_folder,
    rpm,
    write_text,
)
from swashtwin.pump import CLASSES, Fault, OperatingCondition, Pump, load_pump
from swashtwin.recordings import Recording, write_index, write_recording
from swashtwin_bench.rigs.fleet import Specimen, draw_fault, draw_specimen, draw_wide_specimen
from swashtwin_bench.rigs.measuring import Run, measure
from swashtwin_bench.rigs.version_three import fleet as version_three
from swashtwin_bench.rigs.version_three.measuring import measure as measure_three
from swashtwin_bench.rigs.version_two import fleet as version_two
from swashtwin_bench.rigs.version_two.measuring import measure as measure_two

RIG_VERSION = "1"
"""Default version. No recording of a version ever changes: a change makes a new version."""

OTHER_DESIGNS = ("3",)
"""Versions with pumps of other designs than 25scy14-1b, whose priors need the piston count."""

DEEP_VERSION = "1-deep"
"""Version 1 with the paper's recess of 0.6 mm; recordings of other classes are those of version 1.
"""

WIDE_VERSION = "1-wide"
"""Version 1 with pumps that differ more from their drawing and from each other."""

MANIFEST_NAME = "rig.json"
"""File in a rig's folder that describes the rig, so that an interrupted run can be resumed."""

SAMPLE_RATE = 25600.0
"""Readings per second and channel [Hz]."""

PUMPS = MappingProxyType({3: "25scy14-1b", 13: "25scy14-1b-13"})
"""Pump file by number of accelerometers."""

SPEED = rpm(860)
"""Set speed of version 1 [rad/s], the paper's."""

PRESSURES = (MPa(5), MPa(10), MPa(15))
"""Set discharge pressures [Pa], the paper's."""

# Set speeds of version 2 [rad/s]: the paper's, and one that moves every line of the spectrum.
_SPEEDS_TWO = (SPEED, rpm(1120))

# Set speeds of version 3 [rad/s].
_SPEEDS_THREE = (rpm(1000), rpm(1450))

# Recordings of a class and pressure between two reassemblies of a pump of version 3.
_REPEATS_PER_ASSEMBLY = 3


@dataclass(frozen=True)
class RigSize:
    """Number and length of the recordings."""

    specimens: int
    """Pumps in the fleet."""
    repeats: int
    """Recordings per pump, class and pressure."""
    duration: float = 4.0
    """Length of each recording [s]."""


SIZES = MappingProxyType(
    {
        "tiny": RigSize(specimens=2, repeats=2, duration=1.25),
        "short": RigSize(specimens=6, repeats=2, duration=2.0),
        "many": RigSize(specimens=9, repeats=4, duration=2.0),
        "small": RigSize(specimens=6, repeats=3),
        "paper": RigSize(specimens=6, repeats=4),
    }
)
"""Sizes by name: ``tiny`` for trials, ``short`` for studies of many fleets, ``many`` for studies
whose tests need more pumps, ``small`` for a demo.

``paper`` has in each class over three times the paper's 650 windows of 80 ms, so that a study can
take the paper's counts for training and test on other recordings.
"""


@dataclass(frozen=True)
class _Slot:
    """One recording to be taken."""

    specimen: str
    label: str
    pressure: float
    repeat: int
    version: str = RIG_VERSION
    sensors: int = 3

    @property
    def name(self) -> str:
        return f"{self.specimen}_{self.label}_{self.pressure / 1e6:.0f}MPa_{self.repeat}"

    @property
    def speed(self) -> float:
        """Set speed [rad/s]: successive repeats alternate between the speeds of the version."""
        speeds = VERSIONS[self.version].speeds
        return speeds[(self.repeat - 1) % len(speeds)]


def _list_slots(
    size: RigSize,
    version: str,
    sensors: int,
    labels: Sequence[str] = CLASSES,
    pressures: Sequence[float] | None = None,
) -> list[_Slot]:
    """Return the recordings of a rig in their fixed order.

    Raises
    ------
    InputError
        The version, a class or the number of sensors is unknown.
    """
    require_version(version)
    classes = VERSIONS[version].labels

    unknown = set(labels) - set(classes)
    if unknown:
        raise InputError(
            f"Invalid class {min(unknown)!r} for version {version} of the rig: "
            f"use {', '.join(classes)}."
        )

    # Only version 1 places its sensors by the pump file; the others drew theirs for three.
    draws_by_pump_file = VERSIONS[version].draw_specimen in (draw_specimen, draw_wide_specimen)
    if sensors not in PUMPS or (sensors != 3 and not draws_by_pump_file):
        raise InputError(
            f"Version {version} of the rig cannot record {sensors} sensors: version 1 has "
            f"{' or '.join(map(str, PUMPS))}, the others have 3."
        )

    if pressures is None:
        pressures = PRESSURES

    slots = []
    for index in range(size.specimens):
        specimen = chr(ord("A") + index)
        for label in classes:
            if label not in labels:
                continue
            for pressure in pressures:
                for repeat in range(1, size.repeats + 1):
                    slots.append(_Slot(specimen, label, pressure, repeat, version, sensors))

    return slots


def draw_run(
    name: str,
    specimen: Specimen,
    pressure: float,
    seed: int,
    fault: Fault | None,
    speed: float = SPEED,
) -> Run:
    """Return measurement `name` of a reassembled pump, with its true operating point.

    The true values scatter around the set pressure [Pa] and speed [rad/s].
    """
    rng = random_stream(seed, "condition", name)
    condition = OperatingCondition(
        speed=speed * rng.uniform(0.997, 1.003),
        discharge_pressure=pressure * rng.uniform(0.97, 1.03),
        oil_temperature=celsius(rng.uniform(30, 60)),
    )

    return Run(specimen.reassemble(seed, name), condition, fault)


@dataclass(frozen=True)
class RigVersion:
    """One version of the rig: its pumps, their operating points and their measurement."""

    speeds: tuple[float, ...]
    """Set speeds [rad/s]."""
    draw_specimen: Callable[[Pump, str, int], Specimen]
    """Draws the pump of a name and a seed from the nominal one."""
    run: Callable[[_Slot, Specimen, int], Run]
    """Draws the measurement of a slot and a seed."""
    measure: Callable[
        [Sequence[Run], float, float, Sequence[tuple[int, str]]],
        list[Float[np.ndarray, "sensor time"]],
    ]
    """Measures runs for a duration [s] at a sample rate [Hz]."""
    labels: tuple[str, ...] = CLASSES
    """Classes that the version can record."""


def _draw_first_run(slot: _Slot, specimen: Specimen, seed: int, *, is_deep: bool = False) -> Run:
    fault = draw_fault(slot.label, slot.specimen, seed, slot.name, is_deep=is_deep)
    return draw_run(slot.name, specimen, slot.pressure, seed, fault)


def _draw_second_run(slot: _Slot, specimen: Specimen, seed: int, *, is_deep: bool = False) -> Run:
    """Return the measurement of a slot of version 2.

    A pump that is not reassembled keeps its fault and its assembly in all recordings of a class.
    """
    assert isinstance(specimen, version_two.SecondSpecimen)
    purpose = slot.name if specimen.is_reassembled else f"{slot.specimen}_{slot.label}"
    fault = version_two.draw_fault(slot.label, slot.specimen, seed, purpose, is_deep=is_deep)

    rng = random_stream(seed, "condition of version 2", slot.name)
    condition = OperatingCondition(
        speed=slot.speed * (1 - rng.uniform(0.002, 0.008) * slot.pressure / MPa(15)),
        discharge_pressure=slot.pressure * specimen.gauge * rng.uniform(0.96, 1.04),
        oil_temperature=celsius(rng.uniform(28, 62)),
    )

    return Run(specimen.reassemble(seed, purpose), condition, fault)


def _draw_third_run(slot: _Slot, specimen: Specimen, seed: int) -> Run:
    """Return the measurement of a slot of version 3.

    A pump is reassembled for each class, and after every third recording of a class and pressure.
    """
    assert isinstance(specimen, version_three.ThirdSpecimen)
    assembly = (slot.repeat - 1) // _REPEATS_PER_ASSEMBLY
    purpose = f"{slot.specimen}_{slot.label}_{assembly}"
    fault = version_three.draw_fault(slot.label, len(specimen.clearances), seed, purpose)

    rng = random_stream(seed, "condition of version 3", slot.name)
    condition = OperatingCondition(
        speed=slot.speed * (1 - specimen.slip * slot.pressure / MPa(15) * rng.uniform(0.7, 1.1)),
        discharge_pressure=slot.pressure * specimen.gauge * rng.uniform(0.965, 1.035),
        oil_temperature=celsius(rng.uniform(28, 62)),
        suction_pressure=rng.uniform(0.095e6, 0.13e6),
    )

    return Run(specimen.reassemble(seed, purpose), condition, fault)


VERSIONS: Mapping[str, RigVersion] = MappingProxyType(
    {
        "1": RigVersion((SPEED,), draw_specimen, _draw_first_run, measure),
        DEEP_VERSION: RigVersion(
            (SPEED,), draw_specimen, partial(_draw_first_run, is_deep=True), measure
        ),
        "2": RigVersion(_SPEEDS_TWO, version_two.draw_specimen, _draw_second_run, measure_two),
        "2-deep": RigVersion(
            _SPEEDS_TWO,
            version_two.draw_specimen,
            partial(_draw_second_run, is_deep=True),
            measure_two,
        ),
        "3": RigVersion(
            _SPEEDS_THREE,
            version_three.draw_specimen,
            _draw_third_run,
            measure_three,
            version_three.LABELS,
        ),
        WIDE_VERSION: RigVersion((SPEED,), draw_wide_specimen, _draw_first_run, measure),
    }
)
"""Versions of the rig by name (docs/bench/rig.md).

``1-deep`` and ``2-deep`` are versions 1 and 2 with the paper's recess of 0.6 mm. In ``1-wide``
pumps differ more from their drawing (`draw_wide_specimen`).
"""


def wide_version(version: str) -> str:
    """Return the version whose pumps differ more from their drawing than those of `version`.

    Raises
    ------
    InputError
        The version has no such spread.
    """
    if version != RIG_VERSION:
        raise InputError(
            f"Version {version} of the rig has no wide spread: only version {RIG_VERSION} has one."
        )
    return WIDE_VERSION


def require_version(version: str) -> None:
    """Check that a version of the rig exists.

    Raises
    ------
    InputError
        The version is not one of `VERSIONS`.
    """
    if version not in VERSIONS:
        raise InputError(f"Invalid rig version {version!r}: must be one of {', '.join(VERSIONS)}.")


def make_recording(
    name: str,
    label: str,
    pressure: float,
    run: Run,
    signal: Float[np.ndarray, "sensor time"],
    *,
    speed: float = SPEED,
    version: str = RIG_VERSION,
) -> Recording:
    """Return recording `name` of a run.

    Its operating point is what a plant would know: the set pressure [Pa] and speed [rad/s], and an
    oil temperature read to a degree.
    """
    temperature_celsius = round(run.condition.oil_temperature - celsius(0))
    specified = OperatingCondition(
        speed=speed,
        discharge_pressure=pressure,
        oil_temperature=celsius(temperature_celsius),
    )

    return Recording(
        signal=signal,
        sample_rate=SAMPLE_RATE,
        recording_id=name,
        channels=run.specimen.pump.channels,
        label=label,
        condition=specified,
        specimen=run.specimen.name,
        attributes={"origin": f"swashtwin virtual rig, version {version}"},
    )


def rig_recordings(
    seed: int,
    size: RigSize,
    *,
    labels: Sequence[str] = CLASSES,
    pressures: Sequence[float] | None = None,
    version: str = RIG_VERSION,
    sensors: int = 3,
    batch: int = 30,
    jobs: int = 1,
) -> Iterator[tuple[Recording, Run]]:
    """Yield the recordings of the rig, each with the run that it was measured in.

    The operating point of a recording holds the set values and an oil temperature read to a degree.
    The true pressure and speed differ by up to 3 % and 0.3 % (version 2: 8 % and 0.8 %; version 3:
    7 % and 1.6 %). Only the run holds them.

    Parameters
    ----------
    seed : addresses every draw. A recording depends on the seed and its id, not on the other
        recordings taken with it.
    size : number and length of the recordings.
    labels : classes to record, of those that the version has.
    pressures : set discharge pressures [Pa]; `PRESSURES` by default.
    version : name in `VERSIONS`.
    sensors : number of accelerometers, a key of `PUMPS`.
    batch : recordings computed together.
    jobs : processes that compute batches in parallel; the samples do not depend on it.
    """
    slots = _list_slots(size, version, sensors, labels, pressures)
    fleet = _draw_fleet(slots, seed)

    return _measure_slots(slots, fleet, size.duration, seed, batch=batch, jobs=jobs)


def _measure_slots(
    slots: Sequence[_Slot],
    fleet: Mapping[str, Specimen],
    duration: float,
    seed: int,
    *,
    batch: int = 30,
    jobs: int = 1,
) -> Iterator[tuple[Recording, Run]]:
    """Yield the recording of each slot with its run."""
    tasks = []
    for first in range(0, len(slots), batch):
        batch_slots = slots[first : first + batch]
        specimens = [fleet[slot.specimen] for slot in batch_slots]
        tasks.append((batch_slots, specimens, duration, seed))

    for pairs in parallel(_measure_batch, tasks, jobs=jobs):
        yield from pairs


def _draw_fleet(slots: Sequence[_Slot], seed: int) -> dict[str, Specimen]:
    fleet: dict[str, Specimen] = {}
    for slot in slots:
        if slot.specimen not in fleet:
            nominal = load_pump(PUMPS[slot.sensors])
            version = VERSIONS[slot.version]
            fleet[slot.specimen] = version.draw_specimen(nominal, slot.specimen, seed)

    return fleet


def _measure_batch(
    slots: Sequence[_Slot], specimens: Sequence[Specimen], duration: float, seed: int
) -> list[tuple[Recording, Run]]:
    # Batches run in parallel processes: more threads in each would compete for the cores.
    torch.set_num_threads(1)

    version = VERSIONS[slots[0].version]
    runs = [
        version.run(slot, specimen, seed) for slot, specimen in zip(slots, specimens, strict=True)
    ]
    seeds = [(seed, slot.name) for slot in slots]
    signals = version.measure(runs, duration, SAMPLE_RATE, seeds)

    return [
        (_make_slot_recording(slot, run, signal), run)
        for slot, run, signal in zip(slots, runs, signals, strict=True)
    ]


def _make_slot_recording(
    slot: _Slot, run: Run, signal: Float[np.ndarray, "sensor time"]
) -> Recording:
    return make_recording(
        slot.name, slot.label, slot.pressure, run, signal, speed=slot.speed, version=slot.version
    )


def _describe_truth(run: Run) -> dict[str, object]:
    fault = None
    if run.fault is not None:
        fault = {"kind": type(run.fault).__name__, **asdict(run.fault)}

    return {
        "specimen": run.specimen.name,
        "condition": asdict(run.condition),
        "values": run.specimen.true_values(),
        "fault": fault,
    }


def build_rig(
    folder: Path,
    *,
    seed: int,
    size: str | RigSize = "small",
    version: str = RIG_VERSION,
    sensors: int = 3,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a virtual rig to `folder` and return its index file.

    Recordings that an interrupted run has finished are kept. The truth goes to
    ``<folder>-truth.json`` next to the folder, for scoring only: no function of swashtwin reads it.

    Parameters
    ----------
    folder : new or empty folder, or the folder of an earlier run with equal arguments.
    seed : number of the fleet.
    size : name in `SIZES`, or a `RigSize`.
    version : name in `VERSIONS`.
    sensors : number of accelerometers, a key of `PUMPS`.
    jobs : parallel processes.
    progress : called with the numbers of finished and of all recordings.

    Raises
    ------
    InputError
        The folder holds something else, or a rig of other arguments; or the size, the version or
        the number of sensors is unknown.
    """
    folder = Path(folder).resolve()
    if isinstance(size, str):
        if size not in SIZES:
            raise InputError(f"Invalid rig size {size!r}: must be one of {', '.join(SIZES)}.")
        size = SIZES[size]
    slots = _list_slots(size, version, sensors)

    settings = {"rig_version": version, "seed": seed, "size": asdict(size), "format": "h5"}
    if sensors != 3:
        # Folders of three sensors were written without this key and must stay resumable.
        settings["sensors"] = sensors
    resume_folder(folder, MANIFEST_NAME, settings)

    files = {slot.name: Path(slot.specimen) / f"{slot.name}.h5" for slot in slots}
    missing = [slot for slot in slots if not (folder / files[slot.name]).is_file()]
    fleet = _draw_fleet(slots, seed)
    finished_count = len(slots) - len(missing)
    for recording, _ in _measure_slots(missing, fleet, size.duration, seed, jobs=jobs):
        write_recording(recording, folder / files[recording.recording_id])
        finished_count += 1
        if progress:
            progress(finished_count, len(slots))

    # Drawing a run again is cheap and covers the recordings that an earlier run has finished.
    runs = {}
    for slot in slots:
        runs[slot.name] = VERSIONS[version].run(slot, fleet[slot.specimen], seed)
    truth = {
        "rig_version": version,
        "seed": seed,
        "size": asdict(size),
        "specimens": {name: specimen.truth() for name, specimen in fleet.items()},
        "recordings": {name: _describe_truth(run) for name, run in runs.items()},
    }
    write_text(folder.parent / f"{folder.name}-truth.json", json.dumps(truth, indent=1))

    # The index lists no samples, so recordings without a signal will do.
    silence = np.zeros((sensors, 1))
    recordings = [_make_slot_recording(slot, runs[slot.name], silence) for slot in slots]

    return write_index(recordings, list(files.values()), folder / "recordings.toml")
