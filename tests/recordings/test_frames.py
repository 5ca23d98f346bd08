"""Recordings as data frames and arrays with names, and data frames that list files."""

from pathlib import Path

import numpy as np
import polars
import pytest
from recording_files import noise

from swashtwin.foundation import InputError, MissingFileError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recordings, write_recording

CONDITION = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two files."""
    path = tmp_path_factory.mktemp("files")
    for name in ("a", "b"):
        write_recording(noise(name, label=None), path / f"{name}.h5")
    return path


def test_a_frame_has_a_row_of_facts_for_each_recording() -> None:
    pytest.importorskip("pandas")
    attributes = {"day": "1", "label": "x"}
    known = noise("a", label="normal", condition=CONDITION, specimen="A", attributes=attributes)
    frame = Recordings([known, noise("b", label=None)]).to_pandas()

    assert frame.recording_id.tolist() == ["a", "b"]
    assert frame.label[0] == "normal"
    assert frame.label.isna().tolist() == [False, True]
    assert frame.speed[0] == pytest.approx(rpm(860))
    assert frame.oil_temperature.isna().tolist() == [False, True]
    assert frame.day[0] == "1"


def test_an_array_has_the_names_of_channels_time_and_known_facts() -> None:
    pytest.importorskip("xarray")
    recording = noise("a", label=None, condition=CONDITION)
    recording = recording.replace(speed=np.full(recording.n_samples, rpm(860)))

    array = recording.to_xarray()

    np.testing.assert_array_equal(array.sel(channel=recording.channels[1]), recording.signal[1])
    np.testing.assert_array_equal(array.time, recording.time)
    assert array.speed.dims == ("time",)
    assert array.attrs["discharge_pressure"] == MPa(15)
    assert "label" not in array.attrs


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_frame_that_lists_files_gives_their_recordings(library: str, folder: Path) -> None:
    frames = pytest.importorskip(library)
    table = {
        "file": ["a.h5", "b.h5"],
        "recording_id": ["first", None],
        "speed": ["860 rpm", None],
        "pressure": [MPa(15), None],
        "operator": ["x", None],
    }
    recordings = Recordings.from_frame(frames.DataFrame(table), folder, label="normal")

    assert recordings.recording_ids == ("first", "b")
    assert recordings.labels == ("normal", "normal")
    assert recordings[0].condition == CONDITION
    assert recordings[0].attributes["operator"] == "x"
    assert "operator" not in recordings[1].attributes


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"path": ["a.h5"]}, "no column 'file'; it has path"),
        ({"file": ["a.h5"], "labels": ["normal"]}, "did you mean 'label'"),
        ({"file": ["a.h5"], "duration": [1.0]}, r"where\(ids="),
        ({"file": ["a.h5", " "]}, "Row 1 has no file"),
        ({"file": ["a.h5", "a.h5"]}, "the id 'a'"),
    ],
)
def test_a_frame_that_lists_no_files_is_refused(
    table: dict[str, list[object]], message: str, folder: Path
) -> None:
    with pytest.raises(InputError, match=message):
        Recordings.from_frame(polars.DataFrame(table), folder)


def test_other_objects_and_missing_files_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="frame is a list"):
        Recordings.from_frame(["a.h5"], folder)
    with pytest.raises(MissingFileError, match=r"no\.h5 does not exist"):
        Recordings.from_frame(polars.DataFrame({"file": ["no.h5"]}), folder)


def test_a_notebook_shows_recordings_as_a_table() -> None:
    html = Recordings([noise("<a>", condition=CONDITION)])._repr_html_()
    assert "&lt;a&gt;" in html
    assert "860 rev/min" in html
