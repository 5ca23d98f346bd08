"""Which recordings the virtual rig takes, and how it puts them on disk."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float
from joblib import Parallel, delayed

from swashtwin.bench.rigs.fleet import Specimen, draw_fault, draw_specimen
from swashtwin.bench.rigs.measuring import Run, measure
from swashtwin.foundation import InputError, MPa, celsius, rpm, stream, write_text
from swashtwin.pump import CLASSES, Fault, OperatingCondition, load_pump
from swashtwin.recordings import Recording, write_index, write_recording

RIG_VERSION = "1"
"""Changes whenever a recording of the same seed would; the changelog then carries re-measured figures."""

SAMPLE_RATE = 25600.0
"""Readings per second and channel [Hz]."""

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
        "small": RigSize(specimens=6, repeats=3),
        "paper": RigSize(specimens=6, repeats=4),
    }
)
"""``tiny`` is for trying things out, ``small`` for a demo. ``paper`` holds, in each class, over three times the paper's
650 windows of 80 ms, so that a study can take the paper's counts for training and test on recordings it did not train
on."""


@dataclass(frozen=True)
class _Slot:
    specimen: str
    label: str
    pressure: float
    repeat: int

    @property
    def name(self) -> str:
        return f"{self.specimen}_{self.label}_{self.pressure / 1e6:.0f}MPa_{self.repeat}"


def _slots(size: RigSize) -> list[_Slot]:
    names = [chr(ord("A") + i) for i in range(size.specimens)]
    return [_Slot(*key) for key in product(names, CLASSES, PRESSURES, range(1, size.repeats + 1))]


def run_of(name: str, specimen: Specimen, pressure: float, seed: int, fault: Fault | None) -> Run:
    """Measurement `name` of a reassembled pump at a set discharge pressure [Pa], with the condition that held."""
    rng = stream(seed, "condition", name)
    condition = OperatingCondition(
        speed=SPEED * rng.uniform(0.997, 1.003),
        discharge_pressure=pressure * rng.uniform(0.97, 1.03),
        oil_temperature=celsius(rng.uniform(30, 60)),
    )
    return Run(specimen.reassemble(seed, name), condition, fault)


def recording_of(
    name: str, label: str, pressure: float, run: Run, signal: Float[np.ndarray, "sensor time"]
) -> Recording:
    """Recording `name` of a run: it states the set pressure [Pa] and speed, not those that held."""
    stated = OperatingCondition(
        speed=SPEED,
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
        attributes={"origin": f"swashtwin virtual rig, version {RIG_VERSION}"},
    )


def rig_recordings(
    seed: int, size: RigSize, *, labels: Sequence[str] = CLASSES, batch: int = 30, jobs: int = 1
) -> Iterator[tuple[Recording, Run]]:
    """Recordings of the rig, one by one, each with the truth behind it.

    What a recording states of its condition is what was set and a thermometer read to a degree; the pressure and the
    speed that really held were up to 3 % and 0.3 % off, and nothing downstream learns them.

    Parameters
    ----------
    seed : addresses every draw; the same seed gives the same recordings, whichever others are taken with them.
    labels : classes to record.
    batch : recordings computed together.
    jobs : processes that compute batches side by side; the samples do not depend on it.
    """
    nominal = load_pump("25scy14-1b")
    fleet = {name: draw_specimen(nominal, name, seed) for name in {slot.specimen for slot in _slots(size)}}
    slots = [slot for slot in _slots(size) if slot.label in labels]
    batches = [slots[first : first + batch] for first in range(0, len(slots), batch)]
    measured = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_measure_batch)(slots, [fleet[slot.specimen] for slot in slots], size.duration, seed)
        for slots in batches
    )
    for pairs in measured:
        yield from pairs


def _measure_batch(
    slots: Sequence[_Slot], specimens: Sequence[Specimen], duration: float, seed: int
) -> list[tuple[Recording, Run]]:
    torch.set_num_threads(1)
    runs = [
        run_of(slot.name, specimen, slot.pressure, seed, draw_fault(slot.label, slot.specimen, seed, slot.name))
        for slot, specimen in zip(slots, specimens, strict=True)
    ]
    signals = measure(runs, duration, SAMPLE_RATE, [(seed, slot.name) for slot in slots])
    return [
        (recording_of(slot.name, slot.label, slot.pressure, run, signal), run)
        for slot, run, signal in zip(slots, runs, signals, strict=True)
    ]


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
    file_format: str = "h5",
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Index file of a virtual rig written to `folder`.

    The truth goes to ``<folder>-truth.json`` beside the folder, for scoring only: no function of swashtwin reads it.

    Parameters
    ----------
    folder : new or empty folder.
    seed : which fleet.
    size : name in `SIZES`, or a size of one's own.
    file_format : ``h5`` (default), ``mat``, ``wav``, ``csv`` or ``tdms``.
    jobs : processes that work side by side.
    progress : called with recordings done and in all.

    Raises
    ------
    InputError
        The folder holds files already, or the size is unknown.
    """
    folder = Path(folder).resolve()
    if isinstance(size, str) and size not in SIZES:
        raise InputError(f"rig size {size!r} is unknown; choose one of {', '.join(SIZES)}.")
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty; choose a new folder for the rig.")
    plan = SIZES[size] if isinstance(size, str) else size
    total = len(_slots(plan))
    recordings, files, runs, fleet = [], [], {}, {}
    for recording, run in rig_recordings(seed, plan, jobs=jobs):
        path = folder / run.specimen.name / f"{recording.recording_id}.{file_format}"
        write_recording(recording, path)
        recordings.append(recording)
        files.append(path.relative_to(folder))
        runs[recording.recording_id] = _truth(run)
        fleet[run.specimen.name] = {"mount": run.specimen.mount, "bearing": run.specimen.bearing}
        if progress:
            progress(len(recordings), total)
    truth = {"rig_version": RIG_VERSION, "seed": seed, "size": asdict(plan), "specimens": fleet, "recordings": runs}
    write_text(folder.parent / f"{folder.name}-truth.json", json.dumps(truth, indent=1))
    return write_index(recordings, files, folder / "recordings.toml")
