"""``swashtwin twin simulate``: one recording or many, steady or not."""

import contextlib
import math
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import AT_15, DEFECT, one_line, run, run_json

from swashtwin.foundation import MPa, rpm
from swashtwin.physics import Twin
from swashtwin.recordings import Recording, load_recording, load_recordings

SHORT = ("--duration", "0.2 s")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_written_recording_is_the_one_that_the_answer_describes(tmp_path: Path) -> None:
    out = tmp_path / "new" / "s.h5"
    command = ("twin", "simulate", *AT_15, *SHORT, "--out", out)

    answer = run_json(*command, *DEFECT, "--sample-rate", "12.8 kHz")
    recording = load_recording(out)

    assert answer["label"] == recording.label == "swash_plate"
    assert answer["duration_s"] == recording.duration == 0.2
    assert answer["sample_rate_hz"] == 12800.0
    assert recording.recording_id == "s"
    # no speed over time: the shaft turns steadily
    assert recording.speed is None
    for name, samples in zip(recording.channels, recording.signal, strict=True):
        assert answer["rms_m_s2"][name] == pytest.approx(np.sqrt((samples**2).mean()))

    assert "cover_z" in run(*command, "--force").stdout


def test_many_recordings_differ_in_speed_pressure_and_shaft_angle(tmp_path: Path) -> None:
    command = ("twin", "simulate", *AT_15, *DEFECT, *SHORT, "--seed", 3, "--out", tmp_path / "runs")

    answer = run_json(*command, "--count", 4)
    recordings = load_recordings(answer["index"])

    recording_ids = [recording.recording_id for recording in recordings]
    assert recording_ids == answer["new"] == [f"runs-000{number}" for number in range(4)]
    assert {recording.label for recording in recordings} == {"swash_plate"}

    conditions = [recording.condition for recording in recordings]
    speeds = [condition.speed for condition in conditions if condition is not None]
    pressures = [condition.discharge_pressure for condition in conditions if condition is not None]
    assert len(set(speeds)) == 4
    assert all(abs(speed / rpm(860) - 1) <= 0.005 for speed in speeds)
    assert len(set(pressures)) == 4
    assert all(abs(pressure / MPa(15) - 1) <= 0.03 for pressure in pressures)

    # the phase of the pistons' line follows from the angle at which a recording starts
    piston_line = np.exp(-7j * rpm(860) * recordings[0].time)
    phases = [np.angle((recording.signal[1] * piston_line).sum()) for recording in recordings]
    assert np.ptp(phases) > math.pi / 2


def test_fewer_recordings_than_exist_add_and_delete_nothing(tmp_path: Path) -> None:
    command = ("twin", "simulate", *AT_15, *DEFECT, *SHORT, "--seed", 3, "--out", tmp_path / "runs")
    answer = run_json(*command, "--count", 4)

    assert run_json(*command, "--count", 2)["new"] == []
    assert len(load_recordings(answer["index"])) == 4


def test_an_interrupted_series_continues_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("twin", "simulate", *AT_15, *DEFECT, *SHORT, "--count", 4, "--out")
    interrupted = tmp_path / "one" / "runs"
    uninterrupted = tmp_path / "two" / "runs"
    original_blocks = Twin.blocks
    calls: list[int] = []

    def blocks_until_the_third_recording(*arguments: Any, **options: Any) -> Iterator[Recording]:
        calls.append(len(calls))
        yield from original_blocks(*arguments, **options)
        if len(calls) == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Twin, "blocks", blocks_until_the_third_recording)
        line = one_line(run(*command, interrupted, code=130))
    assert "The same command continues" in line
    assert sorted(contents(interrupted)) == ["runs-0000.h5", "runs-0001.h5", "series.json"]

    assert run_json(*command, interrupted)["new"] == ["runs-0002", "runs-0003"]
    assert run_json(*command, interrupted)["new"] == []

    run(*command, uninterrupted)
    assert contents(interrupted) == contents(uninterrupted)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(("--seed", 1), "seed was 0, now 1", id="seed"),
        pytest.param(("--duration", "0.3 s"), "duration_s was 0.2, now 0.3", id="duration"),
    ],
)
def test_a_series_of_other_options_is_not_continued(
    tmp_path: Path, change: tuple[object, ...], message: str
) -> None:
    out = tmp_path / "runs"
    command = ("twin", "simulate", *AT_15, *SHORT, "--count", 2, "--out", out)
    run(*command)
    original_contents = contents(out)

    assert message in one_line(run(*command, *change, code=3))
    assert contents(out) == original_contents


@pytest.mark.parametrize(
    ("fault", "law"), [("swash_plate", "lift_off"), ("swash_plate:depth=0.07mm", "shared")]
)
def test_the_contact_law_of_a_recess_follows_from_its_depth_and_is_reported(
    fault: str, law: str, tmp_path: Path
) -> None:
    options = ("--duration", "0.1 s", "--fault", fault, "--out", tmp_path / "a.h5")

    notes = run_json("twin", "simulate", *AT_15, *options)["notes"]

    assert f"contact={law}, which suits its depth" in notes[0]
    # without lift-off a film can pull, which the user should know
    warns_of_tension = any("pulls at its slippers" in note for note in notes)
    assert warns_of_tension == (law == "shared")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            ("--speed", "860", "--pressure", "15 MPa", "--out", "x.h5"),
            "has no unit",
            id="speed without a unit",
        ),
        pytest.param(
            (*AT_15, "--fault", "swosh_plate", "--out", "x.h5"),
            "Did you mean 'swash_plate'?",
            id="misspelled fault",
        ),
        pytest.param(
            (*AT_15, "--fault", "piston:depth=1mm", "--out", "x.h5"),
            "it has clearance",
            id="dimension of another fault",
        ),
        pytest.param((*AT_15, "--out", "x.exe"), "must end in .h5 or ", id="unknown suffix"),
        pytest.param(
            (*AT_15, "--count", 2, "--out", "."),
            "not empty; choose a new folder",
            id="folder of other files",
        ),
        # hundreds of terabytes
        pytest.param(
            (*AT_15, "--count", 100_000, "--duration", "10000 s", "--out", "x"),
            "GB free, and 100000 such",
            id="more than the disk holds",
        ),
        pytest.param(
            (*AT_15, "--sample-rate", "1 kHz", "--out", "x.h5"),
            "twice the twin's bandwidth",
            id="sample rate below the bandwidth",
        ),
    ],
)
def test_an_invalid_value_ends_with_one_line_and_code_3(
    options: tuple[object, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "original").touch()

    assert message in one_line(run("twin", "simulate", *options, code=3))
    assert not list(tmp_path.rglob("*.h5"))


@pytest.mark.parametrize(
    ("file", "options", "message"),
    [
        pytest.param("x.h5", ("--fault", "piston:depth"), "Usage", id="dimension without a value"),
        pytest.param("x.h5", ("--count", "2"), "Usage", id="one file for two recordings"),
        # a table is written at once, an HDF5 file in blocks
        pytest.param(
            "x.csv", ("--duration", "1e7 s"), "GB of memory", id="table larger than the memory"
        ),
    ],
)
def test_a_wrong_command_line_ends_with_code_2_and_writes_nothing(
    file: str, options: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    result = run("twin", "simulate", *AT_15, "--out", tmp_path / file, *options, code=2)

    assert message in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("out", "options", "files"),
    [
        pytest.param("full.h5", (), ["full.h5"], id="one recording"),
        pytest.param("runs", ("--count", 2), ["full.h5", "series.json"], id="series"),
    ],
)
def test_a_full_disk_leaves_the_old_file_and_no_partial_one(
    out: str,
    options: tuple[object, ...],
    files: list[str],
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    command = ("twin", "simulate", *AT_15, *SHORT, *options, "--force", "--out", out)
    # compiled code is cached in files, for which there is no space later
    with contextlib.chdir(tmp_path_factory.mktemp("warm")):
        run(*command)
    Path("full.h5").write_text("old")

    # a limit on the size of a file stands for a full disk
    soft_limit, hard_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16384, hard_limit))
    try:
        result = run(*command, code=3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft_limit, hard_limit))

    assert result.stdout == ""
    last_line = result.stderr.splitlines()[-1]
    assert last_line == "swashtwin: error: File too large; no file is half-written."
    assert (tmp_path / "full.h5").read_text() == "old"
    remaining_files = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
    assert remaining_files == files
