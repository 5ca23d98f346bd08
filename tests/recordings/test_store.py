"""Recordings larger than memory are converted, cut and diagnosed in blocks, with equal results."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from recording_files import noise

import swashtwin
from swashtwin.diagnosis import diagnose
from swashtwin.foundation import DataError, InputError, MissingFileError, MPa, rpm
from swashtwin.learning import TrainingSettings, build_network, cut_windows, fit, window_batches
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import (
    Recording,
    is_store,
    load_recording,
    load_recordings,
    write_recording,
    write_store,
)
from swashtwin.recordings.samples import Columns, Samples

SOURCES = Path(swashtwin.__file__).parents[1]
FACTS = (
    "sample_rate",
    "recording_id",
    "channels",
    "unit",
    "label",
    "condition",
    "specimen",
    "synthetic",
    "attributes",
)


def make(name: str, count: int = 5000, **changes: object) -> Recording:
    attributes = {"sensor": "352C33", "block": "A"}
    return noise(name, count=count, **{"label": "normal", "attributes": attributes, **changes})


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make blocks so small that each recording of these tests has several."""
    for module in ("recordings.recording", "recordings.formats.hdf5", "learning.windows.cutting"):
        monkeypatch.setattr(f"swashtwin.{module}.BLOCK_SAMPLES", 700)


def assert_same(first: Recording, second: Recording) -> None:
    np.testing.assert_array_equal(first.signal, second.signal)
    for name in FACTS:
        assert getattr(first, name) == getattr(second, name)

    assert (first.speed is None) == (second.speed is None)
    if first.speed is not None:
        np.testing.assert_array_equal(first.speed, second.speed)


def test_a_recording_in_g_has_the_same_signal_in_a_file_and_in_a_store(tmp_path: Path) -> None:
    write_recording(make("a", unit="1"), tmp_path / "a.wav")
    measured = load_recording(tmp_path / "a.wav", unit="g")
    assert measured.samples.factors != (1.0, 1.0)

    copied = load_recording(write_recording(measured, tmp_path / "a.h5"))
    np.testing.assert_array_equal(copied.signal, measured.signal)

    (stored,) = load_recordings(write_store([measured], tmp_path / "store.h5"))
    np.testing.assert_array_equal(stored.signal, measured.signal)


# ---- one file, in slices


@pytest.mark.parametrize("suffix", ["h5", "csv", "tdms", "wav", "parquet", "mat", "npz", "mf4"])
def test_the_parts_of_a_recording_in_a_file_are_those_of_its_signal(
    suffix: str, tmp_path: Path
) -> None:
    path = write_recording(make("a"), tmp_path / f"a.{suffix}")
    facts = {"unit": "m/s^2"} if suffix == "wav" else {}
    whole = load_recording(path, **facts)
    recording = load_recording(path, **facts)

    blocks = list(recording.blocks())
    assert len(blocks) == 8
    joined = np.concatenate([block.signal for block in blocks], axis=1)
    np.testing.assert_array_equal(joined, whole.signal)
    assert_same(recording, whole)

    # a slice past the end stops at the end
    tail = recording.unloaded().slice(4990, 6000)
    np.testing.assert_array_equal(tail.signal, whole.signal[:, 4990:])
    assert (recording.n_samples, recording.duration) == (5000, 5.0)


@pytest.mark.parametrize("layout", ["rows", "columns", "one", "thin"])
def test_a_foreign_hdf5_file_is_read_in_its_number_type(layout: str, tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(-(2**15), 2**15, (3, 5000)).astype(np.int16)
    layouts = {"rows": values, "columns": values.T, "one": values[0], "thin": values[:1]}

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["acc"] = layouts[layout]
        file["acc"].attrs.update({"fs": 51200.0, "unit": "mg"})

    recording = load_recording(tmp_path / "a.h5")
    channels = values if layout in ("rows", "columns") else values[:1]
    expected = channels * (9.80665 * 1e-3)
    assert recording.samples.raw(0, 10).dtype == np.int16
    np.testing.assert_allclose(recording.signal, expected, rtol=1e-14)
    np.testing.assert_array_equal(recording.slice(7, 11).signal, recording.signal[:, 7:11])


# ---- stores


def test_a_store_loads_every_recording_and_its_speed(tmp_path: Path) -> None:
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    recordings = [
        make("a", condition=condition, specimen="A", speed=np.linspace(80, 90, 5000)),
        make("b/../ä", 1, label=None, unit="1"),
        make("c", 700, synthetic=True),
    ]

    progress: list[tuple[int, int]] = []
    path = write_store(
        recordings, tmp_path / "deep" / "a.h5", progress=lambda *counts: progress.append(counts)
    )

    assert progress[-1][0] == progress[-1][1]
    assert is_store(path)

    for loaded, recording in zip(load_recordings(path), recordings, strict=True):
        assert_same(loaded, recording)


def test_a_store_keeps_the_number_type_of_a_file_and_rounds_nothing(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(-(2**15), 2**15, (2, 5000)).astype(np.int16)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["acc"] = values
        file["acc"].attrs.update({"fs": 51200.0, "unit": "g"})
    original = load_recording(tmp_path / "a.h5", label="normal")

    path = write_store([original], tmp_path / "store.h5")
    # double precision would take four times the bytes
    assert path.stat().st_size < 1.3 * values.nbytes

    (loaded,) = load_recordings(path)
    original = load_recording(tmp_path / "a.h5", label="normal")
    assert_same(replace(loaded, attributes={}), replace(original, attributes={}))


def test_a_store_cannot_be_loaded_as_one_recording(tmp_path: Path) -> None:
    file = write_recording(make("a"), tmp_path / "one.h5")
    assert not is_store(file)

    store = write_store([make("a"), make("b")], tmp_path / "store.h5")
    with pytest.raises(DataError, match="a store of 2 recordings"):
        load_recording(store)

    with pytest.raises(MissingFileError, match="does not exist"):
        load_recordings(tmp_path / "none.h5")


def test_a_store_without_recordings_or_with_equal_ids_is_refused(tmp_path: Path) -> None:
    for recordings, message in (
        ([], "no recording to store"),
        ([make("a"), make("a")], "the id 'a'"),
    ):
        with pytest.raises((DataError, InputError), match=message):
            write_store(recordings, tmp_path / "a.h5")

    with pytest.raises(InputError, match=r"must end in \.h5"):
        write_store([make("a")], tmp_path / "a.mat")

    assert not list(tmp_path.iterdir())


def test_a_truncated_or_changed_store_is_refused_or_loads_the_same(tmp_path: Path) -> None:
    recordings = [make("a", 300), make("b", 300)]
    content = write_store(recordings, tmp_path / "a.h5").read_bytes()
    generator = np.random.default_rng(5)
    n_refused = 0

    for number in range(120):
        if number % 2:
            damaged = bytearray(content[: generator.integers(1, len(content))])
        else:
            damaged = bytearray(content)
            damaged[generator.integers(0, len(damaged))] ^= int(generator.integers(1, 256))
        path = tmp_path / f"{number}.h5"
        path.write_bytes(damaged)

        # an unused byte may change: then the recordings are the same
        try:
            for loaded, recording in zip(load_recordings(path), recordings, strict=True):
                assert_same(loaded, recording)
        except DataError as error:
            n_refused += "\n" not in str(error)

    assert n_refused > 80


def test_a_damaged_source_leaves_the_old_store(tmp_path: Path) -> None:
    path = write_store([make("old")], tmp_path / "a.h5")
    old_content = path.read_bytes()

    class Torn:
        def __len__(self) -> int:
            return 5000

        def __getitem__(self, span: slice, /) -> np.ndarray:
            if span.start > 3000:
                raise OSError("wrong checksum")
            return np.zeros(span.stop - span.start)

    columns = Columns((Torn(), Torn()), (1.0, 1.0))
    torn = replace(make("new"), samples=Samples.from_columns("new", columns, lambda: columns))

    with pytest.raises(
        DataError, match=r"new: samples 3500 to 4200 cannot be read \(OSError: wrong checksum\)"
    ):
        write_store([torn], path)

    assert path.read_bytes() == old_content
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]


# ---- windows and diagnoses


@pytest.mark.parametrize("stride", [None, 33, 250, 1500])
def test_windows_of_a_recording_in_a_file_are_those_of_one_in_memory(
    stride: int | None, tmp_path: Path
) -> None:
    recordings = [make("a"), make("b", label="piston")]
    loaded = load_recordings(write_store(recordings, tmp_path / "a.h5"))

    whole = cut_windows(recordings, length=100, stride=stride)
    lazy = cut_windows(loaded, length=100, stride=stride)

    for name in ("signal", "target", "recording_id", "start"):
        np.testing.assert_array_equal(getattr(lazy, name), getattr(whole, name))

    parts = list(
        window_batches(loaded[0], length=100, stride=stride, classes=whole.classes, batch=7)
    )
    rows_of_a = whole.recording_id == "a"
    for name in ("signal", "target", "start"):
        np.testing.assert_array_equal(
            np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name)[rows_of_a]
        )


@pytest.mark.parametrize("normalization", ["window", "set", "none"])
def test_a_diagnosis_in_blocks_equals_that_of_the_whole_bit_by_bit(
    normalization: str, tmp_path: Path
) -> None:
    recordings = [make("a"), make("b", label="piston", signal=make("b").signal * 3 + 1)]

    settings = TrainingSettings(epochs=1, normalization=normalization)
    windows = cut_windows(recordings, length=32)
    classifier = fit(
        build_network("bitcn", n_channels=2, n_classes=2, channels=(4,)),
        windows,
        settings=settings,
        seed=0,
    )

    long = make("c", 32 * 1700, signal=np.random.default_rng(9).normal(1, 2, (2, 32 * 1700)))
    (loaded,) = load_recordings(write_store([long], tmp_path / "a.h5"))

    whole = cut_windows([long.replace(label=None)], length=32, classes=classifier.classes)
    expected = classifier.predict_proba(whole)

    verdict = diagnose(classifier, loaded)
    assert verdict.to_dict() == diagnose(classifier, long).to_dict()
    expected_labels = tuple(classifier.classes[index] for index in expected.argmax(axis=1))
    assert verdict.window_labels == expected_labels
    # the windows' probabilities are pooled by their geometric mean

    logarithm = np.log(np.maximum(expected, 1e-12)).mean(axis=0)
    pooled = np.exp(logarithm - logarithm.max())
    assert tuple(verdict.probabilities.values()) == tuple((pooled / pooled.sum()).tolist())


MEMORY = """
import json, resource, sys
import h5py, numpy as np
from pathlib import Path
from swashtwin.diagnosis import diagnose, load_classifier
from swashtwin.recordings import load_recording, load_recordings, write_store
from swashtwin.learning import window_batches
classifier = load_classifier(Path("model.swt"))
def work(name):
    write_store([load_recording(Path(name), label="normal", names=["x", "y"])], Path("store.h5"))
    (recording,) = load_recordings(Path("store.h5"))
    count = sum(len(part) for part in window_batches(recording, length=1024, batch=256))
    return count, diagnose(classifier, recording).n_windows
work("small.h5")
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
counts = work("large.h5")
print(json.dumps([counts, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before]))
"""


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    """Convert, cut and diagnose 64 MB of double precision within the memory of a block."""
    from swashtwin.diagnosis import save_classifier

    recordings = [make("a", 4096), make("b", 4096, label="piston")]
    settings = TrainingSettings(epochs=1)
    classifier = fit(
        build_network("bitcn", n_channels=2, n_classes=2, channels=(2,), stride=32),
        cut_windows(recordings, length=1024), settings=settings, seed=0,
    )  # fmt: skip
    save_classifier(classifier, tmp_path / "model.swt")

    noise = np.random.default_rng(0).normal(size=(2, 1 << 20))
    for name, count in (("small", 1 << 20), ("large", 1 << 22)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            data = file.create_dataset("acc", (2, count), np.float32)
            data.attrs.update({"fs": 1000.0, "unit": "m/s^2"})
            for start in range(0, count, 1 << 20):
                data[:, start : start + (1 << 20)] = noise

    environment = {**os.environ, "PYTHONPATH": str(SOURCES), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", MEMORY]
    process = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )

    counts, growth = json.loads(process.stdout)
    assert counts == [4096, 4096]
    assert growth < 16_000  # KiB
