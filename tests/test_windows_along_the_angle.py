"""Windows along the shaft's angle: what they are cut from, and what stays as it was."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_case import TINY, tiny, tiny_recordings

from swashtwin.condition import OperatingCondition
from swashtwin.errors import DataError, InputError
from swashtwin.order_domain import piston_pass_angle
from swashtwin.recording import Recording
from swashtwin.studies import plan_of, run_plan
from swashtwin.studies.fillings import PAPER_FILLINGS
from swashtwin.studies.material import prepare
from swashtwin.studies.scenario import Scenario
from swashtwin.units import MPa

ANGLE = replace(TINY, along_angle=True)
RATE, SECONDS, STATED = 10000.0, 6.0, 15.0


def turning(shaft: float) -> Recording:
    """Seven pistons and a line at order 100 of a shaft at `shaft` [Hz] that wanders by 0.4 %; 15 Hz are stated."""
    time = np.arange(int(SECONDS * RATE)) / RATE
    angle = 2 * np.pi * shaft * (time + 0.004 / (2 * np.pi * 0.5) * np.sin(2 * np.pi * 0.5 * time))
    signal = np.cos(7 * angle) + 0.5 * np.cos(14 * angle + 1) + 0.1 * np.cos(100 * angle)
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(time))
    condition = OperatingCondition(2 * np.pi * STATED, MPa(15))
    return Recording((signal + noise)[None], RATE, f"at {shaft}", condition=condition)


def highest_line(recording: Recording) -> tuple[float, float]:
    """(frequency [Hz], amplitude) of the greatest line above 1 kHz."""
    taper = np.hanning(recording.signal.shape[1])
    spectrum = 2 / taper.sum() * np.abs(np.fft.rfft(recording.signal[0] * taper))
    frequency = np.fft.rfftfreq(len(taper), 1 / recording.sample_rate)
    place = int(np.argmax(np.where(frequency > 1000, spectrum, 0)))
    return float(frequency[place]), float(spectrum[place])


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    return tiny_recordings()


@pytest.mark.parametrize("shaft", [14.9, 15.0, 15.1])
def test_a_line_of_the_shaft_stands_still_however_fast_it_turned(shaft: float) -> None:
    recording = turning(shaft)
    frequency, amplitude = highest_line(ANGLE.as_read(recording))
    assert frequency == pytest.approx(100 * STATED, abs=1 / SECONDS)
    assert amplitude == pytest.approx(0.1, rel=0.16)  # the taper lets a line between two bins lose 15 %
    assert highest_line(recording)[1] < 0.05


def test_windows_stay_as_long_as_they_are_along_time(recordings: list[Recording]) -> None:
    made = ANGLE.as_read(recordings[0])
    assert made.sample_rate == pytest.approx(recordings[0].sample_rate, rel=1e-3)
    assert made.condition == recordings[0].condition
    assert TINY.as_read(recordings[0]) is recordings[0]


def test_roles_and_counts_are_those_along_time(recordings: list[Recording]) -> None:
    time, angle = prepare(recordings, TINY, 0, ()), prepare(recordings, ANGLE, 0, ())
    assert angle.roles() == time.roles()
    assert angle.measured.counts() == time.measured.counts()
    assert {level: test.counts() for level, test in angle.tests.items()} == {
        level: test.counts() for level, test in time.tests.items()
    }
    assert angle.measured.fingerprint() != time.measured.fingerprint()


def test_settings_along_time_are_told_as_ever() -> None:
    assert "along_angle" not in Scenario().described()
    assert replace(Scenario(), along_angle=True).described() == {**Scenario().described(), "along_angle": True}


def test_the_study_compares_the_angle_with_time(recordings: list[Recording]) -> None:
    plan = tiny("shaft-angle", fillings={"nominal": PAPER_FILLINGS["nominal"]})
    result = run_plan(plan, recordings)
    assert {row["domain"] for row in result.rows()} == {"time", "angle"}
    compared = {(dict(one.first)["domain"], dict(one.second)["domain"]) for one in result.contrasts}
    assert compared == {("angle", "time")}
    by_domain = {run.task.factors["domain"]: run for run in result.runs if run.task.factors["classifier"] == result.own}
    assert by_domain["time"].fingerprints["train"] != by_domain["angle"].fingerprints["train"]
    assert by_domain["time"].roles == by_domain["angle"].roles


def test_noise_along_the_angle_is_refused() -> None:
    with pytest.raises(InputError, match="noise along time"):
        replace(plan_of("shaft-angle", "quick"), snrs=(5.0,))


def test_a_recording_without_a_stated_speed_is_named() -> None:
    with pytest.raises(DataError, match=r"at 15\.0 states no speed"):
        ANGLE.as_read(replace(turning(15.0), condition=None))


def test_a_recording_without_piston_lines_is_named() -> None:
    noise = np.random.default_rng(0).standard_normal((1, 60000))
    with pytest.raises(DataError, match="hiss"):
        piston_pass_angle(replace(turning(15.0), signal=noise, recording_id="hiss"), 7)
