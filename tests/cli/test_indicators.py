"""features, spectrum and trend on the command line: what they write, print and refuse."""

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.foundation import MPa
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, load_recordings, write_index, write_recording
from swashtwin.signals import IndicatorTable, summarize_long_recording

RATE, SHAFT = 4000.0, 15.0


def measured(name: str, level: float, seed: int, *, label: str = "normal") -> Recording:
    """Vibration of a seven-piston pump with a tachometer, one pulse per turn."""
    time = np.arange(int(3 * RATE)) / RATE
    angle = 2 * np.pi * SHAFT * time
    noise = 0.02 * np.random.default_rng(seed).standard_normal(len(time))
    pulses = (np.mod(angle, 2 * np.pi) < 0.6) * 5.0
    vibration = level * (np.cos(7 * angle + 0.3) + 0.3 * np.cos(angle)) + noise
    return Recording(
        np.stack([vibration, pulses]), RATE, name, ("cover", "tacho"), label=label, specimen="P1",
        condition=OperatingCondition(2 * np.pi * SHAFT, MPa(15)), attributes={"date": f"2024-01-{20 - seed:02d}"},
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve healthy recordings, a loud one and one like them."""
    path = tmp_path_factory.mktemp("pump")
    recordings = [measured(f"healthy{i}", 1 + 0.01 * (i % 3), i) for i in range(12)]
    recordings += [
        measured("loud", 1.6, 13, label="piston"),
        measured("like", 1.0, 14, label="piston"),
    ]
    files = [
        write_recording(recording, path / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, path)
    return path


def test_features_writes_every_indicator_with_its_unit_in_the_bands_that_are_asked_for(
    folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "features.csv"
    bands = ("--band", "10-200 Hz", "--band", "0.5-1.5x")
    answer = run_json(
        "signal", "features", folder, "--pistons", 7, "--tachometer", "tacho", *bands, "--out", out
    )
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(answer["rows"]) == 14
    assert {row["channel"] for row in rows} == {"cover"}
    first = answer["rows"][0]["values"]
    assert first["order_amplitude 7x"] == pytest.approx(1.0, rel=0.01)
    assert first["band_rms 0.5-1.5x"] == pytest.approx(0.3 / math.sqrt(2), rel=0.02)
    assert [name for name in first if name.startswith("band_rms")] == [
        "band_rms 10-200 Hz",
        "band_rms 0.5-1.5x",
    ]
    assert float(rows[0]["velocity_rms [m/s]"]) == first["velocity_rms"]


def test_of_many_recordings_the_furthest_come_first_and_the_rest_is_in_the_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin.cli.console.MAX_ROWS", 5)
    monkeypatch.setattr("swashtwin.cli.signal.MAX_ROWS", 5)
    output = run("signal", "trend", folder, "--channel", "cover").stdout
    assert output.index("loud") < output.index("healthy0")
    assert "9 more rows: --json has them." in output
    assert "1 of 14 recordings flagged" in output
    assert "No ISO zone is printed" in output
    assert "9 more rows" in run("signal", "features", folder, "--tachometer", "tacho").stdout


def test_features_goes_on_after_an_interrupt(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, out, described = tmp_path / "whole.csv", tmp_path / "out.csv", []
    recordings = load_recordings(folder)[:6]
    files = [folder / f"{recording.recording_id}.h5" for recording in recordings]
    words = (
        "signal",
        "features",
        write_index(recordings, files, tmp_path),
        "--track",
        "7",
        "--out",
    )
    run(*words, whole)

    def stopping(
        recording: Recording, describe: Callable[[Recording], IndicatorTable]
    ) -> IndicatorTable:
        described.append(recording.recording_id)
        if len(described) == 4:
            raise KeyboardInterrupt
        return summarize_long_recording(recording, describe)

    monkeypatch.setattr("swashtwin.signals.summarize_long_recording", stopping)
    assert "The same command continues" in one_line(run(*words, out, code=130))
    assert not out.exists()
    with (tmp_path / "out.csv.partial").open("a") as file:
        file.write('[{"columns"')  # killed while it wrote a line
    run(*words, out)
    assert len(described) == 4 + 3
    assert out.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.glob("*.csv*")) == ["out.csv", "whole.csv"]


@pytest.mark.parametrize(
    ("kind", "at"), [("amplitude", 105.0), ("envelope", 105.0), ("order", 7.0)]
)
def test_spectrum_writes_a_figure_and_its_data_and_marks_the_piston_line(
    folder: Path, tmp_path: Path, kind: str, at: float
) -> None:
    out = tmp_path / f"{kind}.svg"
    options = ("--kind", kind, "--pistons", 7, "--tachometer", "tacho", "--out", out)
    answer = run_json("signal", "spectrum", folder / "loud.h5", *options)
    mark = next(mark for mark in answer["marks"] if mark["name"] == "7x")
    assert mark["at"] == pytest.approx(at, rel=0.002)
    if kind != "envelope":
        assert mark["value"]["cover"] == pytest.approx(1.6, rel=0.03)
    drawing = out.read_text(encoding="utf-8")
    assert ">7x<" in drawing
    assert "mathdefault" not in drawing
    rows = list(csv.reader(Path(answer["csv"]).read_text(encoding="utf-8").splitlines()))
    assert rows[0][1] == "cover [m/s^2]"
    assert len(rows) > 1000


def test_a_spectrum_without_a_speed_says_how_to_get_marks(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal((1, 4000))
    file = write_recording(Recording(noise, RATE, "noise"), tmp_path / "noise.h5")
    assert "--speed" in run("signal", "spectrum", file, "--out", tmp_path / "a.svg").stderr
    answer = run_json("signal", "spectrum", file, "--speed", "900 rpm", "--out", tmp_path / "b.svg")
    assert [mark["name"] for mark in answer["marks"]] == ["1x", "2x"]


def test_trend_by_time_draws_the_loud_recording_beside_the_others(
    folder: Path, tmp_path: Path
) -> None:
    options = (
        "--indicator",
        "rms",
        "--channel",
        "cover",
        "--by",
        "time",
        "--out",
        tmp_path / "trend.svg",
    )
    answer = run_json("signal", "trend", folder, *options)
    assert answer["flagged"] == ["loud"]
    assert [point["recording"] for point in answer["points"]][:2] == ["like", "loud"]
    assert "loud" in (tmp_path / "trend.svg").read_text(encoding="utf-8")
    assert Path(answer["csv"]).read_text(encoding="utf-8").count("within") == 13


@pytest.mark.parametrize(
    ("command", "options", "code", "said"),
    [
        ("signal trend .", ("--indicator", "loudness"), 3, "no indicator 'loudness'"),
        ("signal trend .", ("--baseline", "fine"), 3, "No recording is healthy"),
        ("signal features .", ("--out", "a.txt"), 3, "must end in .csv"),
        (
            "signal features .",
            ("--tachometer", "tacho:2", "--track", "7"),
            2,
            "Invalid value for --track",
        ),
        ("signal spectrum .", (), 2, "Invalid value for FILE"),
        ("signal spectrum loud.h5", ("--track", "0"), 3, "is not a line of the shaft"),
        (
            "signal spectrum loud.h5",
            ("--kind", "envelope", "--band", "1-99 kHz"),
            3,
            "half the sample rate",
        ),
        ("signal spectrum loud.h5", ("--band", "100-900 Hz"), 2, "Invalid value for --band"),
        ("data split .", ("--test-fraction", 0.7), 3, "at most 0.5"),
    ],
)
def test_what_cannot_be_told_is_refused(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    options: tuple[object, ...],
    code: int,
    said: str,
) -> None:
    monkeypatch.chdir(folder)
    before = set(folder.iterdir())
    said_all = " ".join(run(*command.split(), *options, code=code).stderr.replace("│", " ").split())
    assert said in said_all
    assert set(folder.iterdir()) == before


def test_a_recording_that_cannot_be_tracked_leaves_a_gap_and_is_named(tmp_path: Path) -> None:
    loud = measured("loud", 1.6, 7).select_channels(["cover"])
    lost = loud.replace(
        signal=np.random.default_rng(0).standard_normal(loud.signal.shape), recording_id="lost"
    )
    files = [write_recording(item, tmp_path / f"{item.recording_id}.h5") for item in (loud, lost)]
    write_index([loud, lost], files, tmp_path)
    options = ("--pistons", 7, "--track", "7")
    result = run("signal", "features", tmp_path, *options, "--json")
    assert "no orders: lost: the line at order 7" in result.stderr
    rows = {row["recording"]: row for row in json.loads(result.stdout)["rows"]}
    assert rows["loud"]["values"]["order_amplitude 7x"] == pytest.approx(1.6, rel=0.01)
    assert rows["loud"]["speed_rad_s"] == pytest.approx(2 * np.pi * SHAFT, rel=1e-3)
    assert rows["lost"]["values"]["order_amplitude 7x"] is None
    assert rows["lost"]["values"]["rms"] == pytest.approx(1.0, rel=0.05)
    write_index([lost], files[1:], tmp_path / "other")
    assert "the line at order 7" in one_line(
        run("signal", "features", tmp_path / "other", *options, code=3)
    )


def test_a_tachometer_in_volts_stands_beside_accelerations(tmp_path: Path) -> None:
    time = np.arange(3 * 2000) / 2000
    rows = zip(
        time, np.sin(2 * np.pi * 175 * time), 5.0 * (np.mod(25 * time, 1) < 0.1), strict=True
    )
    lines = [
        "Time [s],acc [g],tacho [V]",
        *(f"{moment:.4f},{level:.5f},{pulse}" for moment, level, pulse in rows),
    ]
    (file := tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = ("signal", "spectrum", file, "--kind", "order", "--out", tmp_path / "a.svg")
    answer = run_json(*words, "--tachometer", "tacho")
    assert answer["angle_from"] == "tacho, 1 pulse per turn"
    assert list(answer["marks"][0]["value"]) == ["acc"]
    assert "no channel 'volts'" in run(*words, "--tachometer", "volts", "--force", code=3).stderr
