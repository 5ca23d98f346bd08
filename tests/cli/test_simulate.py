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


def test_simulate_writes_what_it_tells(tmp_path: Path) -> None:
    out = tmp_path / "new" / "s.h5"
    answer = run_json(
        "twin", "simulate", *AT_15, *DEFECT, *SHORT, "--sample-rate", "12.8 kHz", "--out", out
    )
    back = load_recording(out)
    assert (answer["label"], answer["duration_s"], answer["sample_rate_hz"]) == (
        "swash_plate",
        0.2,
        12800.0,
    )
    assert (back.label, back.duration, back.recording_id) == ("swash_plate", 0.2, "s")
    assert back.speed is None
    for name, row in zip(back.channels, back.signal, strict=True):
        assert answer["rms_m_s2"][name] == pytest.approx(np.sqrt((row**2).mean()))
    assert "cover_z" in run("twin", "simulate", *AT_15, *SHORT, "--force", "--out", out).stdout


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_many_recordings_differ_in_all_that_varies(tmp_path: Path) -> None:
    words = ("twin", "simulate", *AT_15, *DEFECT, *SHORT, "--seed", 3, "--out", tmp_path / "runs")
    answer = run_json(*words, "--count", 4)
    back = load_recordings(answer["index"])
    assert (
        answer["new"]
        == [recording.recording_id for recording in back]
        == [f"runs-000{i}" for i in range(4)]
    )
    conditions = [recording.condition for recording in back if recording.condition is not None]
    for name, center, width in (("speed", rpm(860), 0.005), ("discharge_pressure", MPa(15), 0.03)):
        values = [getattr(condition, name) for condition in conditions]
        assert len(set(values)) == 4
        assert all(abs(value / center - 1) <= width for value in values)
    assert {recording.label for recording in back} == {"swash_plate"}
    turn = np.exp(-7j * rpm(860) * back[0].time)
    assert (
        np.ptp([np.angle((recording.signal[1] * turn).sum()) for recording in back]) > math.pi / 2
    )
    assert run_json(*words, "--count", 2)["new"] == []
    assert len(load_recordings(answer["index"])) == 4


def test_an_interrupted_run_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("twin", "simulate", *AT_15, *DEFECT, *SHORT, "--count", 4, "--out")
    calls: list[int] = []

    def interrupted(*arguments: Any, **options: Any) -> Iterator[Recording]:
        calls.append(len(calls))
        yield from whole(*arguments, **options)
        if len(calls) == 3:
            raise KeyboardInterrupt

    whole = Twin.blocks
    with monkeypatch.context() as patch:
        patch.setattr(Twin, "blocks", interrupted)
        assert "The same command continues" in one_line(
            run(*words, tmp_path / "one" / "runs", code=130)
        )
    assert sorted(contents(tmp_path / "one" / "runs")) == [
        "runs-0000.h5",
        "runs-0001.h5",
        "series.json",
    ]
    assert run_json(*words, tmp_path / "one" / "runs")["new"] == ["runs-0002", "runs-0003"]
    assert run_json(*words, tmp_path / "one" / "runs")["new"] == []
    run(*words, tmp_path / "two" / "runs")
    assert contents(tmp_path / "one" / "runs") == contents(tmp_path / "two" / "runs")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("--seed", 1), "seed was 0, now 1"),
        (("--duration", "0.3 s"), "duration_s was 0.2, now 0.3"),
    ],
)
def test_a_folder_made_with_other_options_is_refused(
    tmp_path: Path, change: tuple[object, ...], said: str
) -> None:
    words = ("twin", "simulate", *AT_15, *SHORT, "--count", 2, "--out", tmp_path / "runs")
    run(*words)
    before = contents(tmp_path / "runs")
    assert said in one_line(run(*words, *change, code=3))
    assert contents(tmp_path / "runs") == before


@pytest.mark.parametrize(
    ("fault", "law"), [("swash_plate", "lift_off"), ("swash_plate:depth=0.07mm", "shared")]
)
def test_a_recess_gets_the_law_that_suits_its_depth_and_says_which(
    fault: str, law: str, tmp_path: Path
) -> None:
    words = (
        "twin",
        "simulate",
        *AT_15,
        "--duration",
        "0.1 s",
        "--fault",
        fault,
        "--out",
        tmp_path / "a.h5",
    )
    notes = run_json(*words)["notes"]
    assert f"contact={law}, which suits its depth" in notes[0]
    assert any("pulls at its slippers" in text for text in notes) == (law == "shared")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--speed", "860", "--pressure", "15 MPa", "--out", "x.h5"), "has no unit"),
        ((*AT_15, "--fault", "swosh_plate", "--out", "x.h5"), "Did you mean 'swash_plate'?"),
        ((*AT_15, "--fault", "piston:depth=1mm", "--out", "x.h5"), "it has clearance"),
        ((*AT_15, "--out", "x.exe"), "must end in .h5 or "),
        ((*AT_15, "--count", 2, "--out", "."), "not empty; choose a new folder"),
        (
            (*AT_15, "--count", 100_000, "--duration", "10000 s", "--out", "x"),
            "GB free, and 100000 such",
        ),
        ((*AT_15, "--sample-rate", "1 kHz", "--out", "x.h5"), "twice the twin's bandwidth"),
    ],
)
def test_bad_input_ends_with_one_line_and_code_3(
    words: tuple[object, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kept").touch()
    line = one_line(run("twin", "simulate", *words, code=3))
    assert said in line
    assert not list(tmp_path.rglob("*.h5"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("x.h5", "--fault", "piston:depth"), "Usage"),
        (("x.h5", "--count", "2"), "Usage"),
        (("x.csv", "--duration", "1e7 s"), "GB of memory"),
    ],
)
def test_a_wrong_command_line_is_shown_how_it_is_used(
    words: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    assert (
        said
        in run("twin", "simulate", *AT_15, "--out", tmp_path / words[0], *words[1:], code=2).stderr
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("out", ["full.h5", "runs"])
def test_a_full_disk_leaves_the_old_file_and_nothing_half_written(
    out: str,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    words = (
        "twin",
        "simulate",
        *AT_15,
        *SHORT,
        *(("--count", 2) if out == "runs" else ()),
        "--force",
        "--out",
    )
    with contextlib.chdir(tmp_path_factory.mktemp("warm")):
        run(*words, out)  # compiled once, where there is space for the cache
    Path("full.h5").write_text("old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16384, limits[1]))
    try:
        result = run(*words, out, code=3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert result.stdout == ""
    assert (
        result.stderr.splitlines()[-1]
        == "swashtwin: error: File too large; no file is half-written."
    )
    assert (tmp_path / "full.h5").read_text() == "old"
    left = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
    assert left == ["full.h5", *(["series.json"] if out == "runs" else [])]
