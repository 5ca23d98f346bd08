"""features, spectrum and trend on the command line: what they write, print and refuse."""

import csv
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.foundation import MPa
from swashtwin.plot.signal_figures import MOST_POINTS
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_index, write_recording
from swashtwin.report import spectrum_drawing
from swashtwin.signals import IndicatorTable, LineSpectrum, long_indicators, spectrum_of

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
    """Six healthy recordings, a loud one and one like them."""
    path = tmp_path_factory.mktemp("pump")
    recordings = [measured(f"healthy{i}", 1 + 0.01 * (i % 3), i) for i in range(6)]
    recordings += [measured("loud", 1.6, 7, label="piston"), measured("like", 1.0, 8, label="piston")]
    files = [write_recording(recording, path / f"{recording.recording_id}.h5") for recording in recordings]
    write_index(recordings, files, path)
    return path


def test_features_writes_every_indicator_with_its_unit(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "features.csv"
    answer = run_json("signal", "features", folder, "--pistons", 7, "--tachometer", "tacho", "--out", out)
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(answer["rows"]) == 8
    assert {row["channel"] for row in rows} == {"cover"}
    first = answer["rows"][0]
    assert first["values"]["order_amplitude 7x"] == pytest.approx(1.0, rel=0.01)
    assert first["values"]["order_phase 7x"] == pytest.approx(0.3, abs=0.05)
    assert float(rows[0]["velocity_rms [m/s]"]) == first["values"]["velocity_rms"]
    assert next(column["unit"] for column in answer["columns"] if column["name"] == "velocity_rms") == "m/s"


def test_many_recordings_are_summed_up_by_class_and_furthest_ones_named(tmp_path: Path) -> None:
    recordings = [measured(f"healthy{i}", 1 + 0.01 * (i % 3), i) for i in range(12)]
    recordings += [measured("loud", 1.6, 13, label="piston"), measured("like", 1.0, 14, label="piston")]
    write_index(
        recordings,
        [write_recording(recording, tmp_path / f"{recording.recording_id}.h5") for recording in recordings],
        tmp_path,
    )
    output = run("signal", "trend", tmp_path).stdout
    assert re.search(r"normal +[89][09.]+ rev/min, 15 MPa +12 .* 12 +0 +0 +0", output)
    assert re.search(r"piston +[89][09.]+ rev/min, 15 MPa +2 .* 1 +1 +0 +0", output)
    assert "Furthest off: loud (" in output
    assert "healthy7" not in output
    medians = run("signal", "features", tmp_path, "--tachometer", "tacho").stdout
    assert re.search(r"piston +899.9 rev/min, 15 MPa +cover +2 ", medians)
    assert "healthy7" not in medians


def test_features_goes_on_after_an_interrupt(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, out, described = tmp_path / "whole.csv", tmp_path / "out.csv", []
    words = ("signal", "features", folder, "--out")
    run(*words, whole)

    def stopping(recording: Recording, describe: Callable[[Recording], IndicatorTable]) -> IndicatorTable:
        described.append(recording.recording_id)
        if len(described) == 4:
            raise KeyboardInterrupt
        return long_indicators(recording, describe)

    monkeypatch.setattr("swashtwin.signals.long_indicators", stopping)
    assert "out.csv.partial holds the rows that are done" in one_line(run(*words, out, code=130))
    assert not out.exists()
    with (tmp_path / "out.csv.partial").open("a") as file:
        file.write('[{"columns"')  # killed while it wrote a line
    run(*words, out)
    assert len(described) == 4 + 5
    assert out.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "whole.csv"]


def test_bands_are_those_asked_for(folder: Path) -> None:
    options = ("--band", "10-200 Hz", "--band", "0.5-1.5x", "--channels", "cover")
    answer = run_json("signal", "features", folder / "loud.h5", *options)
    names = [column["name"] for column in answer["columns"] if column["name"].startswith("band_rms")]
    assert names == ["band_rms 10-200 Hz", "band_rms 0.5-1.5x"]
    assert answer["rows"][0]["values"]["band_rms 0.5-1.5x"] == pytest.approx(1.6 * 0.3 / math.sqrt(2), rel=0.02)


def test_a_line_can_be_tracked_instead_of_a_tachometer(folder: Path) -> None:
    options = ("--pistons", 7, "--track", "7", "--channels", "cover")
    answer = run_json("signal", "features", folder / "loud.h5", *options)
    assert answer["rows"][0]["values"]["order_amplitude 7x"] == pytest.approx(1.6, rel=0.01)
    assert answer["rows"][0]["speed_rad_s"] == pytest.approx(2 * np.pi * SHAFT, rel=1e-3)


@pytest.mark.parametrize(("kind", "at"), [("amplitude", 105.0), ("envelope", 105.0), ("order", 7.0)])
def test_spectrum_writes_a_figure_and_its_data_and_marks_the_piston_line(
    folder: Path, tmp_path: Path, kind: str, at: float
) -> None:
    out = tmp_path / f"{kind}.svg"
    options = ("--kind", kind, "--pistons", 7, "--tachometer", "tacho", "--out", out)
    answer = run_json("signal", "spectrum", folder / "loud.h5", *options)
    mark = next(mark for mark in answer["marks"] if mark["name"] == "7x")
    assert mark["at"] == pytest.approx(at, rel=0.002)
    if kind in ("amplitude", "order"):
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
    result = run("signal", "spectrum", file, "--out", tmp_path / "a.svg")
    assert "--speed" in result.stderr
    answer = run_json("signal", "spectrum", file, "--speed", "900 rpm", "--out", tmp_path / "b.svg")
    assert [mark["name"] for mark in answer["marks"]] == ["1x", "2x"]


def test_trend_flags_the_loud_recording_only(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "trend.svg"
    answer = run_json(
        "signal", "trend", folder, "--indicator", "rms", "--channel", "cover", "--by", "time", "--out", out
    )
    assert answer["flagged"] == ["loud"]
    assert [point["recording"] for point in answer["points"]][:2] == ["like", "loud"]
    assert "loud" in out.read_text(encoding="utf-8")
    assert Path(answer["csv"]).read_text(encoding="utf-8").count("within") == 7
    said = run("signal", "trend", folder, "--channel", "cover").stdout
    assert "No ISO zone is printed" in said
    assert "1 of 8 flagged" in said


def test_what_cannot_be_told_is_one_line(folder: Path, tmp_path: Path) -> None:
    assert "no indicator 'loudness'" in one_line(run("signal", "trend", folder, "--indicator", "loudness", code=3))
    assert "stated to be healthy" in one_line(run("signal", "trend", folder, "--baseline", "fine", code=3))
    assert "must end in .csv" in one_line(run("signal", "features", folder, "--out", tmp_path / "a.txt", code=3))
    assert "band '10 Hz'" in one_line(run("signal", "features", folder, "--band", "10 Hz", code=3))
    assert "Invalid value for FILE" in run("signal", "spectrum", folder, code=2).stderr
    assert (
        "Invalid value for --track"
        in run("signal", "features", folder, "--track", "7", "--tachometer", "tacho", code=2).stderr
    )


def test_a_long_spectrum_is_drawn_thinned_and_kept_whole_in_its_data() -> None:
    rng = np.random.default_rng(0)
    signal = rng.standard_normal((1, 200_000)) + 5 * np.cos(2 * np.pi * 1234.5 * np.arange(200_000) / RATE)
    spectrum: LineSpectrum = spectrum_of(Recording(signal, RATE, "long"))
    drawing = spectrum_drawing(spectrum)
    assert drawing.svg.count("\nL ") < 1.1 * MOST_POINTS
    assert len(drawing.columns["frequency [Hz]"]) == 100_001


@pytest.mark.parametrize(
    ("command", "options", "refused"),
    [
        ("signal features", ("--channels", "cover"), "--channels"),
        ("signal features", ("--sample-rate", "1 kHz"), "--sample-rate"),
        ("inspect", ("--unit", "g"), "--unit"),
        ("signal features", ("--tachometer", "tacho:2", "--track", "7"), "--track"),
        ("data split", ("--folds", 2, "--test-fraction", 0.3), "--test-fraction"),
        ("data split", ("--folds", 2, "--dealing", "each"), "--folds"),
    ],
)
def test_an_option_that_would_say_nothing_is_refused(
    folder: Path, command: str, options: tuple[object, ...], refused: str
) -> None:
    assert f"Invalid value for {refused}" in run(*command.split(), folder, *options, code=2).stderr


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--track", "0"), 3, "is no line of the shaft"),
        (("--kind", "envelope", "--band", "1-99 kHz"), 3, "half the sample rate"),
        (("--band", "100-900 Hz"), 2, "Invalid value for --band"),
    ],
)
def test_a_spectrum_that_cannot_be_is_refused(
    folder: Path, tmp_path: Path, options: tuple[object, ...], code: int, said: str
) -> None:
    refusal = run("signal", "spectrum", folder / "loud.h5", "--out", tmp_path / "a.svg", *options, code=code).stderr
    assert said in refusal
    assert not list(tmp_path.iterdir())


def test_a_recording_that_cannot_be_tracked_leaves_a_gap_and_is_named(folder: Path, tmp_path: Path) -> None:
    loud = measured("loud", 1.6, 7)
    noise = np.random.default_rng(0).standard_normal(loud.signal.shape)
    lost = write_recording(replace(loud, signal=noise, recording_id="lost"), tmp_path / "lost.h5")
    options = ("--pistons", 7, "--track", "7", "--channels", "cover")
    result = run("signal", "features", folder / "loud.h5", lost, *options, "--json")
    assert "no orders: lost: the line at order 7" in result.stderr
    values = {row["recording"]: row["values"] for row in json.loads(result.stdout)["rows"]}
    assert values["loud"]["order_amplitude 7x"] == pytest.approx(1.6, rel=0.01)
    assert values["lost"]["order_amplitude 7x"] is None
    assert values["lost"]["rms"] == pytest.approx(1.0, rel=0.05)
    assert "the line at order 7" in one_line(run("signal", "features", lost, *options, code=3))
