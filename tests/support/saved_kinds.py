"""Every kind of file that swashtwin saves and loads, with every entry that it can have."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from saved_files import (
    Artifact,
    ColumnsFile,
    HistoryFile,
    JsonFile,
    RecordingFile,
    SavedFile,
    TomlFile,
)
from small_machine import Machine
from tiny_prior import write_prior

from swashtwin.calibration import GaussNewton, Nuisances, calibrate, load_calibration
from swashtwin.diagnosis import (
    AnomalyDetector,
    ChangeLibrary,
    FaultClassifier,
    PriorClassifier,
    load_classifier,
    measure_library,
)
from swashtwin.foundation import DataError, MPa, mm, resume_folder, rpm, to_table
from swashtwin.learning import (
    BiTCN,
    Epoch,
    TrainingSettings,
    cut_windows,
    fit,
    load_windows,
    save_windows,
)
from swashtwin.monitoring import History
from swashtwin.monitoring.alarms.monitor import OperatingPointMonitor
from swashtwin.monitoring.alarms.operating_point import OperatingPoint
from swashtwin.monitoring.history.database import SCHEMA_VERSION, json_text
from swashtwin.monitoring.history.schema import OperatingPointRow
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.page.users import UserFile, add_user
from swashtwin.monitoring.service.filing import _load_state
from swashtwin.monitoring.sources.delivery import Delivery, RejectionError
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, SwashPlateDefect, load_pump, new_pump
from swashtwin.recordings import (
    Recording,
    load_recording,
    load_recordings,
    write_index,
    write_recording,
    write_store,
)

RATE = 4096.0
SHAFT_HZ = 16.0
CONDITION = OperatingCondition(speed=rpm(60 * SHAFT_HZ), discharge_pressure=MPa(10))


@dataclass(frozen=True)
class SavedKind:
    """A kind of file that swashtwin saves and loads."""

    file: SavedFile
    write: Callable[[Path], Path]
    """Writes a file with every entry into an empty folder."""
    load: Callable[[Path], object]
    remedy: str
    """What an error recommends, as a pattern."""
    optional: tuple[str, ...] = ()
    """Keys that a file may lack: nobody specified the fact, or a person left it out."""
    is_edited: bool = False
    """Whether people edit the file, so that an error about a key recommends no new file."""


@cache
def plant(machines: str = "ABC") -> tuple[Recording, ...]:
    """Healthy and worn recordings of machines with two sensors."""
    time = np.arange(8192) / RATE
    recordings = []
    for machine in machines:
        for number, label in enumerate(["normal"] * 4 + ["piston"] * 3):
            draw = np.random.default_rng([ord(machine), number])
            amplitudes = {7: 1.0, 9: 0.6 if label == "normal" else 1.4, 5: 0.5}
            tones = [
                amplitude * np.sin(2 * np.pi * order * SHAFT_HZ * time + draw.uniform(0, 6))
                for order, amplitude in amplitudes.items()
            ]
            recordings.append(
                Recording(
                    np.sum(tones, axis=0) + 0.1 * draw.normal(size=(2, time.size)),
                    RATE,
                    f"{machine} {number}",
                    channels=("x", "y"),
                    label=label,
                    specimen=machine,
                    condition=CONDITION,
                    attributes={"site": "hall 1"},
                )
            )
    return tuple(recordings)


def write_prior_file(folder: Path) -> Path:
    healthy, worn = plant()[0], plant()[4]
    path = write_prior(folder / "prior.safetensors", healthy, worn)
    adapted = PriorClassifier.load(path).fit(
        [recording for recording in plant() if recording.label == "normal"]
    )
    return adapted.save(path)


def write_library(folder: Path) -> Path:
    library = measure_library(plant(), load_pump("25scy14-1b"))
    return library.save(folder / "pumps.safetensors")


def write_classifier(folder: Path) -> Path:
    prior = PriorClassifier.load(write_prior(folder / "prior.safetensors", plant()[0], plant()[4]))
    model = FaultClassifier(prior=prior).fit(plant())
    # The default network is solved for, so that it has no epochs.
    model.fitted_ = replace(model.fitted_, history=(Epoch(1, 0.5, 0.9),))
    return model.save(folder / "model.safetensors")


def write_detector(folder: Path) -> Path:
    healthy = [recording for recording in plant() if recording.label == "normal"]
    return AnomalyDetector(error_rate=0.2).fit(healthy).save(folder / "detector.safetensors")


def write_windows(folder: Path) -> Path:
    return save_windows(cut_windows(plant()[:6], length=1024), folder / "windows.safetensors")


def train(checkpoint: Path, *, resume: bool) -> object:
    windows = cut_windows(plant()[:6], length=1024)
    network = BiTCN(2, 2, channels=(8,), kernel_size=3)
    settings = TrainingSettings(epochs=1)
    return fit(network, windows, settings=settings, checkpoint=checkpoint, resume=resume)


def write_checkpoint(folder: Path) -> Path:
    path = folder / "checkpoint.safetensors"
    train(path, resume=False)
    return path


def write_calibration(folder: Path) -> Path:
    pump = load_pump("25scy14-1b")
    twin = Twin(pump, CONDITION, bandwidth=3000)
    recess = SwashPlateDefect(depth=mm(0.06), corner=1100.0)
    recordings = []
    for name, fault in (("healthy", None), ("recess", recess)):
        clean = twin.with_fault(fault).simulate(2.0, 7680.0, recording_id=name)
        recordings.append(replace(clean, specimen="A", synthetic=False))
    calibration = calibrate(
        pump,
        recordings,
        law=SwashPlateDefect(depth=mm(0.07)),
        method=GaussNewton(starts=1),
        nuisances=Nuisances.typical(),
        phases=False,
    )
    return calibration.save(folder / "calibration.json")


def write_pump(folder: Path) -> Path:
    return new_pump("pump", folder=folder)


def write_index_file(folder: Path) -> Path:
    recording = plant()[0]
    file = write_recording(recording, folder / "a.csv")
    return write_index([recording], [file], folder)


def write_hdf5(folder: Path) -> Path:
    recording = plant()[0]
    speed = np.full(recording.n_samples, CONDITION.speed)
    return write_recording(replace(recording, speed=speed), folder / "a.h5")


def write_hdf5_store(folder: Path) -> Path:
    return write_store(plant()[:2], folder / "store.h5")


def resume(path: Path) -> None:
    resume_folder(path.parent, path.name, {"seed": 1, "rig": {"size": 3}})


def write_series_settings(folder: Path) -> Path:
    resume(folder / "series.json")
    return folder / "series.json"


def open_history(path: Path) -> None:
    History.open("", path.parent).close()


def write_history(folder: Path) -> Path:
    open_history(folder / "history.sqlite")
    return folder / "history.sqlite"


def write_point_state(folder: Path) -> Path:
    monitor = OperatingPointMonitor("pump-1")
    state = None
    for number in range(22):
        state = monitor.judge(Machine().recording(number), state).state
    assert state is not None
    tables = {"baseline": to_table(state.baseline), "test": state.test_table()}
    path = folder / "state.json"
    path.write_text(json_text({"version": SCHEMA_VERSION, **tables}), encoding="utf-8")
    return path


class StoredState(MachineTransaction):
    """A transaction on a history that has one operating point."""

    def __init__(self, path: Path) -> None:
        self._tables = json.loads(path.read_text(encoding="utf-8"))

    def operating_point(self, name: str) -> OperatingPointRow:
        return OperatingPointRow(machine="pump-1", name=name, test=self._tables["test"])

    def baseline(self, name: str) -> dict[str, Any]:
        return dict(self._tables["baseline"])


def load_point_state(path: Path) -> None:
    state = StoredState(path)
    try:
        _load_state(state, OperatingPoint(None, None))
    except RejectionError as error:
        # The watch rejects the recording; in a history there is no file of one operating point.
        raise DataError(f"{path}: {error}") from error


def write_users(folder: Path) -> Path:
    add_user(folder / "users.json", "operator", "a long password")
    return folder / "users.json"


def write_spool_card(folder: Path) -> Path:
    arrived = datetime(2026, 1, 1, tzinfo=UTC)
    Spool(folder).add(Delivery("folder", "a.wav", arrived, "A", {"speed": "960 rpm"}), b"samples")
    return next(folder.glob("*.json"))


def load_spool_card(path: Path) -> None:
    waiting = Spool(path.parent).next(0.0)
    assert waiting is not None
    if waiting.delivery.problem:
        # The watch rejects it under the name of the file.
        assert waiting.delivery.file.split(".")[0] == path.stem
        raise DataError(f"{path}: {waiting.delivery.problem}")


SAVED_KINDS = {
    "classifier": SavedKind(
        Artifact(
            "classifier",
            data=(
                "card.network.settings",
                "card.network.weights",
                "card.manifest",
                "card.fault_of",
                "card.choice.head_recalls",
                "card.resemblance.prior.manifest",
                "card.resemblance.prior.fault_of",
            ),
        ),
        write_classifier,
        load_classifier,
        "swashtwin train",
    ),
    "prior classifier": SavedKind(
        Artifact("prior classifier", data=("card.manifest", "card.fault_of")),
        write_prior_file,
        PriorClassifier.load,
        "swashtwin twin prior",
    ),
    "change library": SavedKind(
        Artifact("change library", data=("card.pumps[].manifest",)),
        write_library,
        ChangeLibrary.load,
        "swashtwin model library",
    ),
    "anomaly detector": SavedKind(
        Artifact("anomaly detector", data=("card.healthy.manifest",)),
        write_detector,
        AnomalyDetector.load,
        "swashtwin train",
    ),
    "window set": SavedKind(
        Artifact("window set", data=("card.content",)),
        write_windows,
        load_windows,
        "swashtwin synthesize",
    ),
    "training checkpoint": SavedKind(
        Artifact("training checkpoint", data=("card.moments", "card.weights", "card.run.manifest")),
        write_checkpoint,
        lambda path: train(path, resume=True),
        "delete it|another checkpoint",
    ),
    "calibration": SavedKind(
        JsonFile(
            version_key="format",
            data=(
                "settings",
                "recording_hashes",
                "twin.pump.sources",
                "nominal.pump.sources",
                "law.evidence",
            ),
        ),
        write_calibration,
        load_calibration,
        "Calibrate again",
    ),
    "pump": SavedKind(
        TomlFile(version_key="format"),
        write_pump,
        load_pump,
        "swashtwin that wrote it",
        optional=("name", "rated"),
        is_edited=True,
    ),
    "index": SavedKind(
        TomlFile(version_key="format", data=("recording[].attributes",)),
        write_index_file,
        load_recordings,
        "swashtwin index",
        optional=(
            *("classes", "recording[].id", "recording[].label", "recording[].specimen"),
            *("recording[].names", "recording[].unit", "recording[].sample_rate"),
            *("recording[].sha256", "recording[].attributes", "recording[].speed"),
            *("recording[].pressure", "recording[].suction_pressure"),
            *("recording[].case_pressure", "recording[].oil_temperature"),
        ),
        is_edited=True,
    ),
    "recording": SavedKind(
        RecordingFile(is_store=False),
        write_hdf5,
        load_recording,
        "from its source|newer swashtwin",
        optional=("label", "specimen", "speed"),
    ),
    "store": SavedKind(
        RecordingFile(is_store=True),
        write_hdf5_store,
        load_recordings,
        "from its source|newer swashtwin",
        optional=("label", "specimen", "hashes"),
    ),
    "series": SavedKind(
        JsonFile(version_key="version"), write_series_settings, resume, "Choose a new folder"
    ),
    "history": SavedKind(HistoryFile(), write_history, open_history, "a new folder"),
    "operating point": SavedKind(
        ColumnsFile(version_key="version", data=("test.test.scores",)),
        write_point_state,
        load_point_state,
        "record a maintenance",
    ),
    "users": SavedKind(
        JsonFile(), write_users, lambda path: UserFile(path).entries(), "swashtwin watch user"
    ),
    "spool card": SavedKind(
        JsonFile(data=("facts",)), write_spool_card, load_spool_card, "deliver the file"
    ),
}
"""Every kind by its name."""
WITHOUT_VERSION = ("operating point", "users", "spool card")
"""Kinds whose files store no version; that of an operating point is the version of its history."""
