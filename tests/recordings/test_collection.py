"""Recordings of a data set are loaded lazily, selected and split; formats can be registered."""

import gc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_files import noise

from swashtwin.foundation import DataError, InputError, LeakError, MissingFileError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import (
    RawFile,
    ReadOptions,
    Recording,
    Recordings,
    load_recording,
    load_recordings,
    register_format,
    write_index,
    write_recording,
    write_store,
)
from swashtwin.recordings import file_formats as registry
from swashtwin.recordings.samples import Samples


def make(name: str, **facts: object) -> Recording:
    return noise(name, **{"label": "normal", **facts})


def rig(count: int = 3) -> list[Recording]:
    """Return `count` recordings of each of two classes, two specimens and two pressures."""
    return [
        make(
            f"{specimen}_{label}_{pressure}_{number}",
            label=label,
            specimen=specimen,
            condition=OperatingCondition(speed=rpm(860), discharge_pressure=MPa(pressure)),
            attributes={"day": "Monday" if number % 2 else "Friday"},
        )
        for specimen in "AB"
        for label in ("normal", "piston")
        for pressure in (5, 15)
        for number in range(count)
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of HDF5 files with an index and a store of the same recordings."""
    path = tmp_path_factory.mktemp("rig")
    recordings = rig()
    files = [
        write_recording(recording, path / f"{recording.recording_id}.h5")
        for recording in recordings
    ]

    write_index(recordings, files, path)
    write_store(recordings, path / "store.h5")
    return path


def record_loads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that collects the names of recordings whose signals are loaded."""
    names: list[str] = []
    load = Samples.raw

    def recording_raw(samples: Samples, start: int, stop: int) -> np.ndarray:
        names.append(samples.name)
        return load(samples, start, stop)

    monkeypatch.setattr(Samples, "raw", recording_raw)
    return names


# ---- loading


def test_facts_and_changes_of_facts_load_no_signal(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = record_loads(monkeypatch)
    recordings = load_recordings(folder)
    train, test = recordings.where(specimen="A").split(by="condition", test=0.5)
    recording = (train + test)[0].replace(label="worn").select_channels(["y"])
    recording = replace(recording, specimen="C")

    # all of these are facts
    text = repr(
        (recordings, recording, recording.duration, recording.n_samples, recording.has_speed)
    )
    assert names == []
    assert "worn, 1 channel at 1000 Hz" in text

    np.testing.assert_array_equal(recording.signal, make(recording.recording_id).signal[1:])
    assert set(names) == {recording.recording_id}


def test_recordings_of_an_index_a_store_and_files_are_the_same(folder: Path) -> None:
    files = sorted(folder.glob("[AB]_*.h5"))
    by_id = {recording.recording_id: recording for recording in rig()}

    for recordings in (
        load_recordings(folder),
        load_recordings(folder / "store.h5"),
        load_recordings(files),
    ):
        assert sorted(recordings.recording_ids) == sorted(by_id)
        for recording in recordings:
            original = by_id[recording.recording_id]
            np.testing.assert_array_equal(recording.signal, original.signal)
            assert recording.condition == original.condition


def test_a_loop_keeps_no_signal_in_memory(folder: Path) -> None:
    recordings = load_recordings(folder)
    for recording in recordings:
        assert recording.signal.shape == (2, 400)

    del recording
    gc.collect()
    assert recordings[0] is not recordings[0]

    alive = [
        candidate
        for candidate in gc.get_objects()
        if type(candidate) is Samples and candidate.name in recordings.recording_ids
    ]
    assert all(samples._arrays is None for samples in alive if samples.open_columns is not None)


def test_facts_may_be_specified_for_single_files_only(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x\n" + "1.5\n2.5\n" * 50)
    (recording,) = load_recordings(
        tmp_path / "a.csv", sample_rate="1 kHz", unit="g", label="normal"
    )
    assert (recording.sample_rate, recording.n_samples) == (1000.0, 100)
    assert recording.label == "normal"

    for source in (folder, folder / "store.h5"):
        with pytest.raises(InputError, match="unit is for single files"):
            load_recordings(source, unit="g")


def test_a_selection_from_an_index_opens_no_other_file(folder: Path, tmp_path: Path) -> None:
    whole = load_recordings(folder)
    for source in (folder, folder / "store.h5"):
        selection = load_recordings(source, specimen="A", label="healthy")
        assert selection.recording_ids == whole.where(specimen="A", label="healthy").recording_ids

    index = (folder / "recordings.toml").read_text()
    # the index without its files
    (tmp_path / "recordings.toml").write_text(index)

    with pytest.raises(MissingFileError, match="A_"):
        load_recordings(tmp_path, specimen="A")

    for file in folder.glob("A_*.h5"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    assert set(load_recordings(tmp_path, specimen="A").specimens) == {"A"}


def test_a_file_that_changes_after_it_was_loaded_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    for write in (write_recording, lambda recording, path: write_store([recording], path)):
        # the same number of samples, and fewer
        for count in (400, 50):
            write(make("a"), path)
            recordings = load_recordings([path])
            write(replace(make("a"), signal=np.ones((2, count))), path)
            with pytest.raises(
                DataError, match=r"a\.h5: the file has changed since it was loaded; load it again"
            ):
                recordings[0].slice(0, 10)

    path.unlink()
    with pytest.raises(DataError, match="the file is gone since it was loaded; put it back"):
        _ = recordings[0].signal


@pytest.mark.parametrize("name", ["a.h5", "store.h5", "a.csv"])
def test_a_relative_path_stays_valid_after_a_change_of_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)

    if name == "store.h5":
        write_store([make("a")], name)
    else:
        write_recording(make("a"), name)

    recordings = load_recordings(name)
    monkeypatch.chdir("/")

    np.testing.assert_array_equal(recordings[0].signal, make("a").signal)


# ---- a sequence


def test_recordings_are_a_sequence_with_facts_and_a_short_repr(folder: Path) -> None:
    recordings = load_recordings(folder)
    assert (
        repr(recordings)
        == "Recordings(24: 12 normal, 12 piston; 2 specimens; 2 channels at 1000 Hz)"
    )
    assert repr(Recordings([])) == "Recordings(0)"

    assert len(recordings) == len(list(recordings)) == 24
    assert recordings[2:5].recording_ids == recordings.recording_ids[2:5]
    assert recordings[-1].recording_id == recordings.recording_ids[-1]

    assert set(recordings.labels) == {"normal", "piston"}
    assert set(recordings.specimens) == {"A", "B"}
    pressures = {
        recording.condition.discharge_pressure for recording in recordings if recording.condition
    }
    assert pressures == {MPa(5), MPa(15)}

    mixed = Recordings([make("a"), make("b", label=None, sample_rate=500.0)])
    assert repr(mixed) == "Recordings(2: 1 normal, 1 no label; 2 channels at 2 sample rates)"


def test_where_selects_by_condition_and_attribute(folder: Path) -> None:
    recordings = load_recordings(folder)

    # speed and pressure match within a tolerance
    selection = recordings.where(label="healthy", specimen="A", speed=rpm(855), pressure=MPa(15.2))
    assert len(selection) == 3
    assert len(recordings.where(label="normal", day="Monday")) == 4
    assert recordings.where(ids=["B_piston_15_2"])[0].label == "piston"

    two_healthy_words = Recordings([make("a", label="healthy"), make("b")])
    assert two_healthy_words.where(label="normal").recording_ids == ("a", "b")


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"label": "slipper"}, "the label 'slipper'; there are labels normal, piston"),
        (
            {"specimen": "C", "pressure": MPa(10)},
            r"the specimen 'C' and the pressure 10 MPa; there are specimens A, B; pressures \[MPa\] 5, 15",
        ),
        ({"speed": 86.0}, r"the speed 821.2 rev/min; there are speeds \[rev/min\] 860"),
        ({"day": "Sunday"}, "day 'Sunday'; there are days Friday, Monday"),
        ({"ids": ["x"]}, "the id x; there are ids A_normal_5_0"),
    ],
)
def test_an_empty_selection_reports_the_available_values(
    folder: Path, conditions: dict[str, object], message: str
) -> None:
    with pytest.raises(DataError, match=f"No recording has {message}"):
        load_recordings(folder).where(**conditions)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("lable", "did you mean 'label'"),
        ("dya", "did you mean 'day'"),
        ("qqq", "use one of label, specimen, speed, pressure, ids, day.$"),
    ],
)
def test_an_unknown_attribute_is_refused_with_the_closest_name(name: str, hint: str) -> None:
    # attributes that hold a file name or a number are not offered
    recordings = Recordings(
        replace(
            recording,
            attributes={**recording.attributes, "file": f"{number}.csv", "fs": "1"},
        )
        for number, recording in enumerate(rig())
    )

    with pytest.raises(InputError, match=f"No recording has the attribute '{name}'; {hint}"):
        recordings.where(**{name: "piston"})


@pytest.mark.parametrize(
    "attributes", [{}, {"samples_per_turn": "0"}, {"samples_per_turn": "many"}]
)
def test_a_recording_over_shaft_angle_requires_its_samples_per_turn(
    attributes: dict[str, str],
) -> None:
    recording = make("a", attributes={"domain": "angle", **attributes})
    with pytest.raises(
        DataError, match=r"a runs along the shaft's angle, but its samples_per_turn \("
    ):
        Recordings([recording]).where(speed=rpm(860))


# ---- splits


@settings(max_examples=12)
@given(seed=st.integers(0, 50), by=st.sampled_from(["recording", "specimen", "condition", "day"]))
def test_a_split_keeps_groups_whole_and_every_class_on_both_sides(seed: int, by: str) -> None:
    recordings = Recordings(rig())
    train, test = recordings.split(test=0.25, by=by, seed=seed)

    assert sorted(train.recording_ids + test.recording_ids) == sorted(recordings.recording_ids)
    assert set(train.labels) == set(test.labels) == {"normal", "piston"}

    groups = {
        "recording": lambda recording: recording.recording_id,
        "specimen": lambda recording: recording.specimen,
        "condition": lambda recording: recording.condition,
        "day": lambda recording: recording.attributes["day"],
    }
    assert not set(map(groups[by], train)) & set(map(groups[by], test))

    repeated_train, repeated_test = recordings.split(test=0.25, by=by, seed=seed)
    assert train.recording_ids == repeated_train.recording_ids
    assert test.recording_ids == repeated_test.recording_ids


def test_a_class_of_one_group_stays_in_training() -> None:
    recordings = [*rig(), make("only", label="slipper", specimen="A")]
    for seed in range(5):
        train, test = Recordings(recordings).split(seed=seed)
        assert "slipper" in train.labels
        assert set(test.labels) == {"normal", "piston"}

    unlabeled = Recordings(make(str(number), label=None) for number in range(10))
    train, test = unlabeled.split(test=0.2)
    assert (len(train), len(test)) == (8, 2)


def test_an_impossible_split_is_refused() -> None:
    disjoint = Recordings([make("a", specimen="A"), make("b", label="piston", specimen="B")])
    with pytest.raises(DataError, match="Every split by specimen removes a class from training"):
        disjoint.split(by="specimen")

    with pytest.raises(DataError, match="There is only one specimen"):
        Recordings([make("a", specimen="A"), make("b", specimen="A")]).split(by="specimen")

    with pytest.raises(LeakError, match="b is synthetic"):
        Recordings([make("a"), make("b", synthetic=True)]).split()

    with pytest.raises(InputError, match=r"at most 0\.5"):
        disjoint.split(test=0.7)
    with pytest.raises(InputError, match="No recording has the attribute 'dya'"):
        Recordings(rig()).split(by="dya")


# ---- registered file formats


def read_counts(path: Path, options: ReadOptions) -> RawFile:
    """Read a made-up format: a line with the rate, then one line of numbers per channel."""
    rate, *lines = path.read_text(encoding="ascii").splitlines()
    columns = {line.split()[0]: np.array(line.split()[1:], dtype=float) for line in lines}
    return RawFile(columns, sample_rate=float(rate), units=dict.fromkeys(columns, "g"))


@pytest.fixture
def counts_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(registry, "_registered_readers", {})

    path = tmp_path / "a.Counts"
    path.write_text("1000\nx 1 2 3 4\ny 5 6 7 8\n")
    return path


def test_a_registered_format_is_read_alone_and_through_an_index(counts_file: Path) -> None:
    with pytest.raises(DataError, match=r"'.counts' cannot be read; supported are .csv"):
        load_recording(counts_file)

    register_format(".counts", read_counts)
    recording = load_recording(counts_file, label="normal")
    assert recording.channels == ("x", "y")
    assert (recording.unit, recording.sample_rate) == ("m/s^2", 1000.0)
    np.testing.assert_allclose(recording.signal, 9.80665 * np.arange(1.0, 9.0).reshape(2, 4))

    index = counts_file.parent / "recordings.toml"
    index.write_text(
        'format = 1\n[[recording]]\nfile = "a.Counts"\nlabel = "piston"\nchannels = ["y"]\n'
    )

    (recording,) = load_recordings(index)
    assert (recording.label, recording.channels) == ("piston", ("y",))
    np.testing.assert_allclose(recording.slice(1, 3).signal, [[6 * 9.80665, 7 * 9.80665]])

    counts_file.write_text("1000\nx 1 two\n")
    with pytest.raises(
        DataError, match=r"a.Counts is damaged, cut off, or not a .counts file \(ValueError"
    ):
        load_recordings(index)


def test_an_installed_format_is_found_by_its_entry_point(
    counts_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class EntryPoint:
        name = "counts"

        def load(self) -> object:
            return read_counts

    def entry_points(*, group: str, name: str = "counts") -> list[EntryPoint]:
        if (group, name) == ("swashtwin.formats", "counts"):
            return [EntryPoint()]
        return []

    monkeypatch.setattr(registry, "entry_points", entry_points)
    assert load_recording(counts_file).n_samples == 4


def test_a_suffix_that_cannot_be_registered_is_refused() -> None:
    with pytest.raises(InputError, match=r"'\.CSV'|'\.csv' is a format of swashtwin itself"):
        register_format(".CSV", read_counts)
    with pytest.raises(InputError, match=r"Invalid suffix 'acq': it must begin with a point"):
        register_format("acq", read_counts)
