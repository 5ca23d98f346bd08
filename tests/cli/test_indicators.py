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

SAMPLE_RATE = 4000.0
SHAFT_FREQUENCY = 15.0
PISTON_FREQUENCY = 7 * SHAFT_FREQUENCY


def pump_recording(name: str, amplitude: float, seed: int, *, label: str = "normal") -> Recording:
    """Vibration of a seven-piston pump with a tachometer, one pulse per turn.

    The line of the pistons has the given amplitude, that of the shaft 0.3 of it.
    """
    time = np.arange(int(3 * SAMPLE_RATE)) / SAMPLE_RATE
    angle = 2 * np.pi * SHAFT_FREQUENCY * time
    noise = 0.02 * np.random.default_rng(seed).standard_normal(len(time))
    vibration = amplitude * (np.cos(7 * angle + 0.3) + 0.3 * np.cos(angle)) + noise
    pulses = (np.mod(angle, 2 * np.pi) < 0.6) * 5.0

    return Recording(
        np.stack([vibration, pulses]),
        SAMPLE_RATE,
        name,
        ("cover", "tacho"),
        label=label,
        specimen="P1",
        condition=OperatingCondition(2 * np.pi * SHAFT_FREQUENCY, MPa(15)),
        # the higher the seed, the earlier, so that order of time is not order of names
        attributes={"date": f"2024-01-{20 - seed:02d}"},
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve healthy recordings, and two with a worn piston, of which one is loud."""
    path = tmp_path_factory.mktemp("pump")
    recordings = [pump_recording(f"healthy{i}", 1 + 0.01 * (i % 3), i) for i in range(12)]
    recordings += [
        pump_recording("loud", 1.6, 13, label="piston"),
        pump_recording("like", 1.0, 14, label="piston"),
    ]
    files = [
        write_recording(recording, path / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, path)
    return path


def test_features_are_written_with_units_and_in_the_given_bands(
    folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "features.csv"
    shaft = ("--pistons", 7, "--tachometer", "tacho")
    bands = ("--band", "10-200 Hz", "--band", "0.5-1.5x")

    answer = run_json("signal", "features", folder, *shaft, *bands, "--out", out)

    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(answer["rows"]) == 14
    # a tachometer has no features
    assert {row["channel"] for row in rows} == {"cover"}

    features = answer["rows"][0]["values"]
    assert features["order_amplitude 7x"] == pytest.approx(1.0, rel=0.01)
    # the line of the shaft alone, an RMS value
    assert features["band_rms 0.5-1.5x"] == pytest.approx(0.3 / math.sqrt(2), rel=0.02)
    band_names = [name for name in features if name.startswith("band_rms")]
    assert band_names == ["band_rms 10-200 Hz", "band_rms 0.5-1.5x"]
    assert float(rows[0]["velocity_rms [m/s]"]) == features["velocity_rms"]


def test_trend_prints_the_furthest_of_many_recordings_first(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin.cli.console.MAX_ROWS", 5)
    monkeypatch.setattr("swashtwin.cli.signal.MAX_ROWS", 5)

    output = run("signal", "trend", folder, "--channel", "cover").stdout

    assert output.index("loud") < output.index("healthy0")
    assert "9 more rows: --json has them." in output
    assert "1 of 14 recordings flagged" in output
    assert "No ISO zone is printed" in output


def test_features_of_many_recordings_are_printed_in_part(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin.cli.console.MAX_ROWS", 5)
    monkeypatch.setattr("swashtwin.cli.signal.MAX_ROWS", 5)

    output = run("signal", "features", folder, "--tachometer", "tacho").stdout

    assert "9 more rows" in output


def test_features_continue_after_an_interrupt_with_an_equal_result(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uninterrupted_out = tmp_path / "whole.csv"
    out = tmp_path / "out.csv"
    recordings = load_recordings(folder)[:6]
    files = [folder / f"{recording.recording_id}.h5" for recording in recordings]
    index = write_index(recordings, files, tmp_path)
    command = ("signal", "features", index, "--track", "7", "--out")
    run(*command, uninterrupted_out)
    described_ids = []

    def interrupted_at_the_fourth(
        recording: Recording, describe: Callable[[Recording], IndicatorTable]
    ) -> IndicatorTable:
        described_ids.append(recording.recording_id)
        if len(described_ids) == 4:
            raise KeyboardInterrupt
        return summarize_long_recording(recording, describe)

    monkeypatch.setattr("swashtwin.signals.summarize_long_recording", interrupted_at_the_fourth)
    assert "The same command continues" in one_line(run(*command, out, code=130))
    assert not out.exists()

    # as if the process had been killed while it wrote a line
    with (tmp_path / "out.csv.partial").open("a") as file:
        file.write('[{"columns"')
    run(*command, out)

    # of six recordings three were done
    assert len(described_ids) == 4 + 3
    assert out.read_bytes() == uninterrupted_out.read_bytes()
    assert sorted(path.name for path in tmp_path.glob("*.csv*")) == ["out.csv", "whole.csv"]


@pytest.mark.parametrize(
    ("kind", "piston_line"),
    [("amplitude", PISTON_FREQUENCY), ("envelope", PISTON_FREQUENCY), ("order", 7.0)],
)
def test_spectrum_writes_a_figure_and_its_data_and_marks_the_piston_line(
    folder: Path, tmp_path: Path, kind: str, piston_line: float
) -> None:
    out = tmp_path / f"{kind}.svg"
    options = ("--kind", kind, "--pistons", 7, "--tachometer", "tacho", "--out", out)

    answer = run_json("signal", "spectrum", folder / "loud.h5", *options)

    mark = next(mark for mark in answer["marks"] if mark["name"] == "7x")
    assert mark["at"] == pytest.approx(piston_line, rel=0.002)
    # the envelope's lines are not amplitudes of the vibration
    if kind != "envelope":
        assert mark["value"]["cover"] == pytest.approx(1.6, rel=0.03)

    drawing = out.read_text(encoding="utf-8")
    assert ">7x<" in drawing
    # left by a formula of matplotlib in place of text
    assert "mathdefault" not in drawing
    rows = list(csv.reader(Path(answer["csv"]).read_text(encoding="utf-8").splitlines()))
    assert rows[0][1] == "cover [m/s^2]"
    assert len(rows) > 1000


def test_a_spectrum_without_a_speed_names_the_option_that_gives_marks(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal((1, 4000))
    file = write_recording(Recording(noise, SAMPLE_RATE, "noise"), tmp_path / "noise.h5")
    command = ("signal", "spectrum", file)

    assert "--speed" in run(*command, "--out", tmp_path / "a.svg").stderr

    answer = run_json(*command, "--speed", "900 rpm", "--out", tmp_path / "b.svg")
    # without a number of pistons
    assert [mark["name"] for mark in answer["marks"]] == ["1x", "2x"]


def test_trend_by_time_draws_the_loud_recording_among_the_others(
    folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "trend.svg"
    options = ("--indicator", "rms", "--channel", "cover", "--by", "time")

    answer = run_json("signal", "trend", folder, *options, "--out", out)

    assert answer["flagged"] == ["loud"]
    # the oldest first
    assert [point["recording_id"] for point in answer["points"]][:2] == ["like", "loud"]
    assert "loud" in out.read_text(encoding="utf-8")
    assert Path(answer["csv"]).read_text(encoding="utf-8").count("within") == 13


@pytest.mark.parametrize(
    ("command", "options", "code", "message"),
    [
        pytest.param(
            "signal trend .",
            ("--indicator", "loudness"),
            3,
            "no indicator 'loudness'",
            id="unknown indicator",
        ),
        pytest.param(
            "signal trend .",
            ("--baseline", "fine"),
            3,
            "No recording is healthy",
            id="baseline of an absent class",
        ),
        pytest.param(
            "signal features .", ("--out", "a.txt"), 3, "must end in .csv", id="suffix of a table"
        ),
        pytest.param(
            "signal features .",
            ("--tachometer", "tacho:2", "--track", "7"),
            2,
            "Invalid value for --track",
            id="two sources of the angle",
        ),
        pytest.param(
            "signal spectrum .", (), 2, "Invalid value for FILE", id="spectrum of a folder"
        ),
        pytest.param(
            "signal spectrum loud.h5",
            ("--track", "0"),
            3,
            "is not a line of the shaft",
            id="order zero",
        ),
        pytest.param(
            "signal spectrum loud.h5",
            ("--kind", "envelope", "--band", "1-99 kHz"),
            3,
            "half the sample rate",
            id="band above half the sample rate",
        ),
        pytest.param(
            "signal spectrum loud.h5",
            ("--band", "100-900 Hz"),
            2,
            "Invalid value for --band",
            id="band of a spectrum that is no envelope",
        ),
        pytest.param(
            "data split .", ("--test-fraction", 0.7), 3, "at most 0.5", id="test fraction"
        ),
    ],
)
def test_an_invalid_option_is_refused_before_any_file_is_written(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    options: tuple[object, ...],
    code: int,
    message: str,
) -> None:
    monkeypatch.chdir(folder)
    files_before = set(folder.iterdir())

    stderr = run(*command.split(), *options, code=code).stderr

    # errors of usage stand in a box
    assert message in " ".join(stderr.replace("│", " ").split())
    assert set(folder.iterdir()) == files_before


def test_a_recording_that_cannot_be_tracked_leaves_a_gap_and_is_named(tmp_path: Path) -> None:
    loud = pump_recording("loud", 1.6, 7).select_channels(["cover"])
    noise = np.random.default_rng(0).standard_normal(loud.signal.shape)
    untrackable = loud.replace(signal=noise, recording_id="lost")
    recordings = [loud, untrackable]
    files = [
        write_recording(recording, tmp_path / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, tmp_path)
    write_index([untrackable], files[1:], tmp_path / "other")
    options = ("--pistons", 7, "--track", "7")

    result = run("signal", "features", tmp_path, *options, "--json")
    assert "no orders: lost: the line at order 7" in result.stderr

    rows = {row["recording_id"]: row for row in json.loads(result.stdout)["rows"]}
    assert rows["loud"]["values"]["order_amplitude 7x"] == pytest.approx(1.6, rel=0.01)
    assert rows["loud"]["speed"] == pytest.approx(2 * np.pi * SHAFT_FREQUENCY, rel=1e-3)
    assert rows["lost"]["values"]["order_amplitude 7x"] is None
    assert rows["lost"]["values"]["rms"] == pytest.approx(1.0, rel=0.05)

    # if no recording can be tracked, nothing is left to write
    refusal = one_line(run("signal", "features", tmp_path / "other", *options, code=3))
    assert "the line at order 7" in refusal


def test_a_tachometer_in_volts_is_read_with_channels_of_acceleration(tmp_path: Path) -> None:
    time = np.arange(3 * 2000) / 2000
    acceleration = np.sin(2 * np.pi * 175 * time)
    # a pulse of 5 V in each turn at 25 Hz
    tachometer = 5.0 * (np.mod(25 * time, 1) < 0.1)
    lines = ["Time [s],acc [g],tacho [V]"]
    for row in zip(time, acceleration, tachometer, strict=True):
        lines.append("{:.4f},{:.5f},{}".format(*row))
    file = tmp_path / "a.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    command = ("signal", "spectrum", file, "--kind", "order", "--out", tmp_path / "a.svg")

    answer = run_json(*command, "--tachometer", "tacho")
    assert answer["angle_from"] == "tacho, 1 pulse per turn"
    assert list(answer["marks"][0]["value"]) == ["acc"]

    refusal = run(*command, "--tachometer", "volts", "--force", code=3)
    assert "no channel 'volts'" in refusal.stderr
