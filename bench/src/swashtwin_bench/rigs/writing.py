"""Which recordings the virtual rig takes, and how it puts them on disk."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float
from joblib import delayed

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
from swashtwin_bench.rigs.fleet import Specimen, draw_fault, draw_specimen
from swashtwin_bench.rigs.measuring import Run, measure
from swashtwin_bench.rigs.version_three import fleet as version_three
from swashtwin_bench.rigs.version_three.measuring import measure as measure_three
from swashtwin_bench.rigs.version_two import fleet as version_two
from swashtwin_bench.rigs.version_two.measuring import measure as measure_two

RIG_VERSION = "1"
"""Version that is taken where none is named. No recording of a version ever changes: another law is
another version.
"""

OTHER_DESIGNS = ("3",)
"""Versions whose pumps are not of the design 25scy14-1b, so that a prior is told their pistons."""

DEEP_VERSION = "1-deep"
"""Version 1 with the paper's recess of 0.6 mm; all recordings without a recess are those of version
1.
"""

MANIFEST_NAME = "rig.json"
"""File in a rig's folder that says what the rig is, so that a run that was interrupted can go
on.
"""

SAMPLE_RATE = 25600.0
"""Readings per second and channel [Hz]."""

PUMPS = MappingProxyType({3: "25scy14-1b", 13: "25scy14-1b-13"})
"""Pump file by the number of its accelerometers."""

SPEED = rpm(860)
"""Set speed [rad/s], the paper's."""

PRESSURES = (MPa(5), MPa(10), MPa(15))
"""Set discharge pressures [Pa], the paper's."""


@dataclass(frozen=True)
class RigSize:
    """How much is recorded."""

    specimens: int
    """Pumps in the fleet."""
    repeats: int
    """Recordings per pump, class and pressure."""
    duration: float = 4.0
    """Length of each [s]."""


SIZES = MappingProxyType(
    {
        "tiny": RigSize(specimens=2, repeats=2, duration=1.25),
        "short": RigSize(specimens=6, repeats=2, duration=2.0),
        "small": RigSize(specimens=6, repeats=3),
        "paper": RigSize(specimens=6, repeats=4),
    }
)
"""``tiny`` is for trying things out, ``short`` for studies of many fleets, ``small`` for a demo.
``paper`` holds, in each class, over three times the paper's 650 windows of 80 ms, so that a study
can take the paper's counts for training and test on recordings it did not train on.
"""


@dataclass(frozen=True)
class _Slot:
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
        """Set speed [rad/s]: recordings of a cell take turns where there are several."""
        speeds = VERSIONS[self.version].speeds
        return speeds[(self.repeat - 1) % len(speeds)]


def _slots(
    size: RigSize,
    version: str,
    sensors: int,
    labels: Sequence[str] = CLASSES,
    pressures: Sequence[float] | None = None,
) -> list[_Slot]:
    require_version(version)
    classes = VERSIONS[version].labels
    if unknown := set(labels) - set(classes):
        raise InputError(
            f"{min(unknown)!r} is no class of rig version {version}; it has {', '.join(classes)}."
        )
    if sensors not in PUMPS or (
        sensors != 3 and VERSIONS[version].draw_specimen is not draw_specimen
    ):
        raise InputError(
            f"{sensors} sensors cannot be recorded by version {version} of the rig: version 1 has "
            f"{' or '.join(map(str, PUMPS))}, the others have 3."
        )
    names = [chr(ord("A") + i) for i in range(size.specimens)]
    cells = product(
        names, classes, PRESSURES if pressures is None else pressures, range(1, size.repeats + 1)
    )
    return [_Slot(*cell, version, sensors) for cell in cells if cell[1] in labels]


def draw_run(
    name: str,
    specimen: Specimen,
    pressure: float,
    seed: int,
    fault: Fault | None,
    speed: float = SPEED,
) -> Run:
    """Measurement `name` of a reassembled pump at a set pressure [Pa] and speed [rad/s]: the
    condition that held.
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
    """One version of the rig: what its pumps are, how they are run and how they are measured."""

    speeds: tuple[float, ...]
    """Set speeds [rad/s]."""
    draw_specimen: Callable[[Pump, str, int], Specimen]
    """Pump of a name and a seed, made from the nominal one."""
    run: Callable[[_Slot, Specimen, int], Run]
    """Measurement of a slot under a seed."""
    measure: Callable[
        [Sequence[Run], float, float, Sequence[tuple[int, str]]],
        list[Float[np.ndarray, "sensor time"]],
    ]
    """Readings of runs, for a duration [s], at a sample rate [Hz]."""
    labels: tuple[str, ...] = CLASSES
    """Classes that it can record."""


def _draw_first_run(slot: _Slot, specimen: Specimen, seed: int, *, is_deep: bool = False) -> Run:
    fault = draw_fault(slot.label, slot.specimen, seed, slot.name, is_deep=is_deep)
    return draw_run(slot.name, specimen, slot.pressure, seed, fault)


def _draw_second_run(slot: _Slot, specimen: Specimen, seed: int, *, is_deep: bool = False) -> Run:
    """A pump that is not reassembled keeps its fault and its assembly in all recordings of a
    class.
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
    """A pump is put together anew for another part, and after every third recording of a class and
    pressure.
    """
    assert isinstance(specimen, version_three.ThirdSpecimen)
    purpose = f"{slot.specimen}_{slot.label}_{(slot.repeat - 1) // 3}"
    rng = random_stream(seed, "condition of version 3", slot.name)
    condition = OperatingCondition(
        speed=slot.speed * (1 - specimen.slip * slot.pressure / MPa(15) * rng.uniform(0.7, 1.1)),
        discharge_pressure=slot.pressure * specimen.gauge * rng.uniform(0.965, 1.035),
        oil_temperature=celsius(rng.uniform(28, 62)),
        suction_pressure=rng.uniform(0.095e6, 0.13e6),
    )
    fault = version_three.draw_fault(slot.label, len(specimen.clearances), seed, purpose)
    return Run(specimen.reassemble(seed, purpose), condition, fault)


_SPEEDS = (SPEED, rpm(1120))

VERSIONS: Mapping[str, RigVersion] = MappingProxyType(
    {
        "1": RigVersion((SPEED,), draw_specimen, _draw_first_run, measure),
        DEEP_VERSION: RigVersion(
            (SPEED,), draw_specimen, partial(_draw_first_run, is_deep=True), measure
        ),
        "2": RigVersion(_SPEEDS, version_two.draw_specimen, _draw_second_run, measure_two),
        "2-deep": RigVersion(
            _SPEEDS, version_two.draw_specimen, partial(_draw_second_run, is_deep=True), measure_two
        ),
        "3": RigVersion(
            (rpm(1000), rpm(1450)),
            version_three.draw_specimen,
            _draw_third_run,
            measure_three,
            version_three.LABELS,
        ),
    }
)
"""Versions of the rig (docs/bench/rig.md); ``1-deep`` and ``2-deep`` are versions 1 and 2 with the
paper's recess of 0.6 mm.
"""


def require_version(version: str) -> None:
    """Refuse a version that there is not.

    Raises
    ------
    InputError
        It is none of `VERSIONS`.
    """
    if version not in VERSIONS:
        raise InputError(
            f"rig version {version!r} is unknown; choose one of {', '.join(VERSIONS)}."
        )


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
    """Recording `name` of a run: it states the set pressure [Pa] and speed [rad/s], not those that
    held.
    """
    stated = OperatingCondition(
        speed=speed,
        discharge_pressure=pressure,
        oil_temperature=celsius(round(run.condition.oil_temperature - celsius(0))),
    )
    return Recording(
        signal=signal,
        sample_rate=SAMPLE_RATE,
        recording_id=name,
        channels=run.specimen.pump.channels,
        label=label,
        condition=stated,
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
    """Recordings of the rig, one by one, each with the truth behind it.

    What a recording states of its condition is what was set and a thermometer read to a degree; the
    pressure and the speed that really held were up to 3 % and 0.3 % off (version 2: up to 8 % and
    0.8 %; version 3: 7 % and 1.6 %), and nothing downstream learns them.

    Parameters
    ----------
    seed : addresses every draw; the same seed gives the same recordings, whichever others are taken
        with them.
    labels : classes to record, of those that the version has.
    pressures : set discharge pressures [Pa]; None takes `PRESSURES`.
    version : name in `VERSIONS`.
    sensors : accelerometers, one of `PUMPS`.
    batch : recordings computed together.
    jobs : processes that compute batches side by side; the samples do not depend on it.
    """
    slots = _slots(size, version, sensors, labels, pressures)
    return _measured(slots, _fleet(slots, seed), size.duration, seed, batch=batch, jobs=jobs)


def _measured(
    slots: Sequence[_Slot],
    fleet: Mapping[str, Specimen],
    duration: float,
    seed: int,
    *,
    batch: int = 30,
    jobs: int = 1,
) -> Iterator[tuple[Recording, Run]]:
    """Recordings of some slots, each with its run."""
    batches = [slots[first : first + batch] for first in range(0, len(slots), batch)]
    measured = parallel(jobs, return_as="generator")(
        delayed(_measure_batch)(slots, [fleet[slot.specimen] for slot in slots], duration, seed)
        for slots in batches
    )
    for pairs in measured:
        yield from pairs


def _fleet(slots: Sequence[_Slot], seed: int) -> dict[str, Specimen]:
    pumps = {slot.specimen: slot for slot in slots}
    return {
        name: VERSIONS[slot.version].draw_specimen(load_pump(PUMPS[slot.sensors]), name, seed)
        for name, slot in pumps.items()
    }


def _run_of(slot: _Slot, specimen: Specimen, seed: int) -> Run:
    return VERSIONS[slot.version].run(slot, specimen, seed)


def _measure_batch(
    slots: Sequence[_Slot], specimens: Sequence[Specimen], duration: float, seed: int
) -> list[tuple[Recording, Run]]:
    torch.set_num_threads(1)
    runs = [_run_of(slot, specimen, seed) for slot, specimen in zip(slots, specimens, strict=True)]
    version = VERSIONS[slots[0].version]
    signals = version.measure(runs, duration, SAMPLE_RATE, [(seed, slot.name) for slot in slots])
    return [
        (_recording(slot, run, signal), run)
        for slot, run, signal in zip(slots, runs, signals, strict=True)
    ]


def _recording(slot: _Slot, run: Run, signal: Float[np.ndarray, "sensor time"]) -> Recording:
    return make_recording(
        slot.name, slot.label, slot.pressure, run, signal, speed=slot.speed, version=slot.version
    )


def _truth(run: Run) -> dict[str, object]:
    fault = run.fault
    return {
        "specimen": run.specimen.name,
        "condition": asdict(run.condition),
        "values": run.specimen.true_values(),
        "fault": None if fault is None else {"kind": type(fault).__name__, **asdict(fault)},
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
    """Index file of a virtual rig written to `folder`; what an earlier run left whole is kept.

    The truth goes to ``<folder>-truth.json`` beside the folder, for scoring only: no function of
    swashtwin reads it.

    Parameters
    ----------
    folder : new or empty folder, or one that an earlier run with equal arguments left, finished or
        not.
    seed : which fleet.
    size : name in `SIZES`, or a size of one's own.
    version : name in `VERSIONS`.
    sensors : accelerometers, one of `PUMPS`.
    jobs : processes that work side by side.
    progress : called with recordings done and in all.

    Raises
    ------
    InputError
        The folder holds something else, or a rig of other arguments; or the size, the version or
        the number of sensors is unknown.
    """
    folder = Path(folder).resolve()
    if isinstance(size, str) and size not in SIZES:
        raise InputError(f"rig size {size!r} is unknown; choose one of {', '.join(SIZES)}.")
    plan = SIZES[size] if isinstance(size, str) else size
    slots = _slots(plan, version, sensors)
    settings = {"rig_version": version, "seed": seed, "size": asdict(plan), "format": "h5"}
    settings |= {} if sensors == 3 else {"sensors": sensors}
    resume_folder(folder, MANIFEST_NAME, settings)
    files = [Path(slot.specimen) / f"{slot.name}.h5" for slot in slots]
    path_of = {slot.name: folder / file for slot, file in zip(slots, files, strict=True)}
    missing = [slot for slot in slots if not path_of[slot.name].is_file()]
    fleet = _fleet(slots, seed)
    for count, (recording, _) in enumerate(
        _measured(missing, fleet, plan.duration, seed, jobs=jobs), 1
    ):
        write_recording(recording, path_of[recording.recording_id])
        if progress:
            progress(len(slots) - len(missing) + count, len(slots))
    runs = {slot.name: _run_of(slot, fleet[slot.specimen], seed) for slot in slots}
    truth = {
        "rig_version": version,
        "seed": seed,
        "size": asdict(plan),
        "specimens": {name: specimen.truth() for name, specimen in fleet.items()},
        "recordings": {name: _truth(run) for name, run in runs.items()},
    }
    write_text(folder.parent / f"{folder.name}-truth.json", json.dumps(truth, indent=1))
    silent = np.zeros((sensors, 1))
    described = [_recording(slot, runs[slot.name], silent) for slot in slots]
    return write_index(described, files, folder / "recordings.toml")
