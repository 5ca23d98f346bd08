"""Windows along the shaft's angle: what they are cut from, and what stays as it was."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tiny_case import TINY, tiny

from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.signals import piston_pass_angle
from swashtwin_bench import plan_of, run_plan
from swashtwin_bench.studies.dataset import prepare, read_for
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.scenario import Scenario
from swashtwin_bench.studies.training_sets import PAPER_TRAINING_SETS, TrainingSet

ANGLE = replace(TINY, along_angle=True)
RATE, SECONDS, STATED = 10000.0, 6.0, 15.0
SPEED = 2 * np.pi * STATED


def turning(shaft: float) -> Recording:
    """Seven pistons and a line at order 100 of a shaft at `shaft` [Hz] that wanders by 0.4 %; 15 Hz are stated."""
    time = np.arange(int(SECONDS * RATE)) / RATE
    angle = 2 * np.pi * shaft * (time + 0.004 / (2 * np.pi * 0.5) * np.sin(2 * np.pi * 0.5 * time))
    signal = np.cos(7 * angle) + 0.5 * np.cos(14 * angle + 1) + 0.1 * np.cos(100 * angle)
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(time))
    condition = OperatingCondition(SPEED, MPa(15))
    return Recording((signal + noise)[None], RATE, f"at {shaft}", condition=condition)


def highest_line(recording: Recording) -> tuple[float, float]:
    """(frequency [Hz], amplitude) of the greatest line above 1 kHz."""
    taper = np.hanning(recording.signal.shape[1])
    spectrum = 2 / taper.sum() * np.abs(np.fft.rfft(recording.signal[0] * taper))
    frequency = np.fft.rfftfreq(len(taper), 1 / recording.sample_rate)
    index = int(np.argmax(np.where(frequency > 1000, spectrum, 0)))
    return float(frequency[index]), float(spectrum[index])


@pytest.fixture(scope="module")
def two_classes(recordings: list[Recording]) -> list[Recording]:
    return [
        recording
        for recording in recordings
        if recording.label in ("normal", "swash_plate") and "_10MPa_" not in recording.recording_id
    ]


@pytest.fixture(scope="module")
def along_angle(two_classes: list[Recording]) -> dict[str, Recording]:
    """The recordings that train, test or lend under seed 0, along the shaft's angle."""
    return read_for(two_classes, ANGLE, 0)


@pytest.mark.parametrize("shaft", [14.9, 15.0, 15.1])
def test_a_line_of_the_shaft_stands_still_however_fast_it_turned(shaft: float) -> None:
    recording = turning(shaft)
    frequency, amplitude = highest_line(ANGLE.as_read(recording, SPEED))
    assert frequency == pytest.approx(100 * STATED, abs=1 / SECONDS)
    assert amplitude == pytest.approx(0.1, rel=0.16)  # the taper lets a line between two bins lose 15 %
    assert highest_line(recording)[1] < 0.05


def test_windows_stay_as_long_as_they_are_along_time(recordings: list[Recording]) -> None:
    along_angle = ANGLE.as_read(recordings[0], rpm(860))
    assert along_angle.sample_rate == pytest.approx(recordings[0].sample_rate, rel=1e-3)
    assert along_angle.condition == recordings[0].condition
    assert TINY.as_read(recordings[0], rpm(860)) is recordings[0]


def test_roles_and_counts_are_those_along_time(two_classes: list[Recording], along_angle: dict[str, Recording]) -> None:
    time, angle = prepare(two_classes, TINY, 0, ()), prepare(two_classes, ANGLE, 0, (), read=along_angle)
    assert angle.roles() == time.roles()
    assert angle.measured.counts() == time.measured.counts()
    assert {level: test.counts() for level, test in angle.tests.items()} == {
        level: test.counts() for level, test in time.tests.items()
    }
    assert angle.measured.fingerprint() != time.measured.fingerprint()


def test_settings_along_time_do_not_mention_the_angle() -> None:
    assert "along_angle" not in Scenario().describe()
    assert replace(Scenario(), along_angle=True).describe() == {**Scenario().describe(), "along_angle": True}


def test_the_study_compares_the_angle_with_time(two_classes: list[Recording]) -> None:
    plan = tiny("shaft-angle", training_sets={"nominal": PAPER_TRAINING_SETS["nominal"]})
    result = run_plan(plan, two_classes)
    assert {row["domain"] for row in result.rows()} == {"time", "angle"}
    compared = {(pair.first["domain"], pair.second["domain"]) for pair in result.differences()}
    assert compared == {("angle", "time")}
    by_domain = {
        run["factors"]["domain"]: run for run in result.runs if run["factors"]["classifier"] == result.main_classifier
    }
    assert by_domain["time"]["sha256"]["train"] != by_domain["angle"]["sha256"]["train"]
    assert result.settings["variants"] == {"time": {}, "angle": {"along_angle": True}}
    assert by_domain["time"]["roles"] == by_domain["angle"]["roles"]


@pytest.mark.parametrize(
    "noisy",
    [
        {"perturbations": (Perturbation("white", 5.0),)},
        {"training_sets": {"noisy": TrainingSet("calibrated", noise=True)}},
    ],
)
def test_noise_along_the_angle_is_refused(noisy: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="plans with noise cut windows along time"):
        replace(plan_of("shaft-angle"), **noisy)


def test_speeds_that_differ_a_little_are_played_back_at_one(two_classes: list[Recording]) -> None:
    stated = [
        replace(recording, condition=replace(recording.condition, speed=rpm(860) * (1 + 1e-3 * (i % 3 - 1))))
        for i, recording in enumerate(two_classes)
        if recording.condition is not None and ANGLE.is_near(recording)
    ]
    read = read_for(stated, ANGLE, 0)
    assert len({recording.condition.speed for recording in stated if recording.recording_id in read}) > 1
    assert len({recording.sample_rate for recording in read.values()}) == 1


def test_the_same_recordings_lend_to_the_scarce_cell(
    two_classes: list[Recording], along_angle: dict[str, Recording]
) -> None:
    full = replace(ANGLE, scarce_windows=two_classes[0].signal.shape[1] // ANGLE.length)
    lenders = {}
    for name, scenario, read in (("time", replace(full, along_angle=False), None), ("angle", full, along_angle)):
        windows = prepare(two_classes, scenario, 0, (), read=read).measured
        scarce = windows.subset((windows.label == "swash_plate") & (windows.discharge_pressure > 12e6))
        lenders[name] = (set(scarce.recording_id.tolist()), len(scarce), len(set(scarce.start.tolist())))
    assert lenders["time"] == (lenders["angle"][0], full.scarce_windows, full.scarce_windows)
    assert len(lenders["angle"][0]) == 1
    assert lenders["angle"][1:] == (full.scarce_windows - 1, full.scarce_windows - 1)


@pytest.mark.parametrize("off", [-0.015, 0.015])
def test_sidebands_do_not_pass_for_a_piston_line(off: float) -> None:
    shaft, rng = STATED * (1 + off), np.random.default_rng(0)
    angle = 2 * np.pi * shaft * np.arange(int(SECONDS * RATE)) / RATE
    lines = [0.33 * np.cos(7 * k * angle) + 0.4 * np.cos((7 * k - np.sign(off)) * angle) for k in range(1, 7)]
    signal = sum(lines) + 0.05 * rng.standard_normal(len(angle))
    shaft_angle = piston_pass_angle(replace(turning(STATED), signal=signal[None]), 7)
    assert shaft_angle.mean_speed == pytest.approx(2 * np.pi * shaft, rel=1e-3)


@pytest.mark.parametrize("off", [0.0, 0.012])
def test_a_run_up_is_followed_along_the_speed_that_it_states(off: float) -> None:
    time = np.arange(int(SECONDS * RATE)) / RATE
    shaft = 14 + 4 * time / SECONDS
    angle = 2 * np.pi * np.cumsum(shaft) / RATE
    signal = sum(np.cos(7 * k * angle + k) / k for k in range(1, 7))
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(time))
    recording = replace(turning(STATED), signal=(signal + noise)[None], speed=2 * np.pi * shaft * (1 + off))
    error = piston_pass_angle(recording, 7).angle - angle
    inside = slice(int(RATE / 5), -int(RATE / 5))
    assert np.degrees(np.abs(error[inside] - np.median(error[inside])).max()) < 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"condition": None}, "nobody stated its speed"),
        ({"signal": np.random.default_rng(0).standard_normal((1, 60000))}, "stands clear"),
        ({"signal": turning(15.0).signal[:, :10000]}, "needs 16"),
        ({"attributes": {"domain": "angle", "samples_per_turn": "666"}}, "angle already"),
    ],
)
def test_a_recording_that_cannot_be_put_along_the_angle_is_named_with_a_remedy(
    changes: dict[str, Any], reason: str
) -> None:
    with pytest.raises(DataError, match=reason) as caught:
        ANGLE.as_read(replace(turning(15.0), **changes), SPEED)
    assert "at 15.0" in str(caught.value)
    assert "values=time" in str(caught.value)


def test_a_recording_that_cannot_be_followed_stops_the_study_before_its_calibrations(
    two_classes: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin_bench.studies.runner.run_calibration", lambda *_: pytest.fail("was calibrated"))
    hiss = np.random.default_rng(0).standard_normal(two_classes[0].signal.shape)
    name = sorted(prepare(two_classes, TINY, 0, ()).split.train)[0]
    damaged = [
        replace(recording, signal=hiss) if recording.recording_id == name else recording for recording in two_classes
    ]
    with pytest.raises(DataError, match=name):
        run_plan(tiny("shaft-angle"), damaged)
