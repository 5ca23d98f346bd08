"""The shaft's angle from pulses and from the signal, against known shaft speeds; and the recording
along it.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import (
    Recording,
    inspect_recordings,
    specified_shaft_frequency,
)
from swashtwin.signals import (
    ShaftAngle,
    piston_pass_angle,
    resample_by_angle,
    specified_angle,
    tachometer_angle,
    track_shaft_angle,
)
from swashtwin.signals.spectra import amplitude_spectrum

RATE = 10000.0


def shaft_speed(
    *, seconds: float = 8.0, start: float = 12.0, end: float = 18.0, swing: float = 0.0
) -> np.ndarray:
    """True angle [rad] of a shaft whose frequency [Hz] runs from `start` to `end` and swings
    (relative) at 0.9 Hz.
    """
    time = np.arange(int(seconds * RATE)) / RATE
    steady = start * time + (end - start) * time**2 / (2 * seconds)
    wander = swing * (start + end) / 2 * (1 - np.cos(2 * np.pi * 0.9 * time)) / (2 * np.pi * 0.9)
    return 2 * np.pi * (steady + wander)


def turning(
    angle: np.ndarray, *, noise: float = 0.0, seed: int = 0, channels: int = 1
) -> Recording:
    """Lines of a seven-piston pump along `angle`, another mixture in each channel, with white
    noise.
    """
    rng = np.random.default_rng(seed)
    lines = {1: 0.2, 2: 0.1, 6: 0.15, 7: 1.0, 8: 0.15, 14: 0.5, 21: 0.3}
    rows = [
        sum(
            amount * rng.uniform(0.5, 1.5) * np.cos(k * angle + rng.uniform(0, 6.3))
            for k, amount in lines.items()
        )
        + noise * rng.standard_normal(len(angle))
        for _ in range(channels)
    ]

    return Recording(np.stack(rows), RATE, "run", tuple(f"a{i}" for i in range(channels)))


def tacho(angle: np.ndarray, pulses: int = 1, *, width: float = 0.4) -> Recording:
    level = np.where(np.mod(pulses * angle / (2 * np.pi) - 0.25, 1) < width, 4.8, 0.1)
    return Recording(np.stack([np.zeros(len(angle)), level]), RATE, "run", ("a", "tacho"))


def wandering(angle: ShaftAngle, true: np.ndarray) -> float:
    """Largest difference [degrees] from the true angle, a constant apart, one revolution away from
    either end.
    """
    error = angle.angle - true
    inside = slice(int(RATE / 10), -int(RATE / 10))
    return float(np.degrees(np.abs(error[inside] - np.median(error[inside])).max()))


@pytest.mark.parametrize(("pulses", "limit"), [(1, 1.0), (8, 0.6), (60, 0.6)])
def test_pulses_give_the_angle_of_a_run_up(pulses: int, limit: float) -> None:
    true = shaft_speed(swing=0.005)
    angle = tachometer_angle(tacho(true, pulses), "tacho", pulses)

    assert wandering(angle, true) < limit  # one sample is 0.65 degrees at 18 Hz
    assert angle.mean_speed == pytest.approx(2 * np.pi * 15, rel=1e-3)
    assert 0 < math.degrees(angle.deviation) < 1


def test_a_missed_pulse_is_refused_with_its_time() -> None:
    recording = tacho(shaft_speed(start=15, end=15))
    signal = recording.signal.copy()
    signal[1, int(2.0 * RATE) : int(2.06 * RATE)] = 0.1

    with pytest.raises(DataError, match=r"pulses at 1\.9.* a pulse was missed"):
        tachometer_angle(replace(recording, signal=signal), "tacho")


def test_a_channel_without_pulses_is_no_tachometer() -> None:
    with pytest.raises(DataError, match="0 pulses"):
        tachometer_angle(tacho(shaft_speed()), "a")
    with pytest.raises(InputError, match="no channel 'b'"):
        tachometer_angle(tacho(shaft_speed()), "b")
    with pytest.raises(InputError, match="pulses_per_turn"):
        tachometer_angle(tacho(shaft_speed()), "tacho", 0)


@pytest.mark.parametrize("swing", [0.0, 0.005, 0.02])
def test_a_wandering_speed_is_followed_on_the_piston_line(swing: float) -> None:
    true = shaft_speed(start=14.2, end=14.4, swing=swing)
    angle = track_shaft_angle(turning(true, noise=0.3), order=7, expected_speed=rpm(860))

    assert wandering(angle, true) < 1.5
    assert angle.quality == 1.0


def test_a_run_up_by_half_is_followed_from_one_guess() -> None:
    true = shaft_speed(start=12, end=18)
    angle = track_shaft_angle(
        turning(true, noise=0.3), order=7, expected_speed=2 * np.pi * 15, search=0.25
    )
    assert wandering(angle, true) < 1.5


def test_the_stated_error_is_the_error_that_noise_makes() -> None:
    true = shaft_speed(start=14, end=14.5)
    inside = slice(1000, -1000)
    errors = []
    specified = []

    for seed in range(6):
        angle = track_shaft_angle(
            turning(true, noise=2.0, seed=seed), order=7, expected_speed=rpm(860)
        )
        error = (angle.angle - true)[inside]
        errors.append((error - error.mean()).std())
        specified.append(angle.deviation)

    assert np.mean(specified) == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.35)


def test_noise_without_a_line_is_not_followed() -> None:
    noise = np.random.default_rng(0).standard_normal((2, 80000))
    with pytest.raises(DataError, match="stands clear of the noise"):
        track_shaft_angle(
            Recording(noise, RATE, "noise", ("a", "b")), order=7, expected_speed=rpm(860)
        )


def test_a_hump_of_noise_is_no_line() -> None:
    # a band of 0.3 orders to either side of the piston-pass line
    piston_pass = 7 * 860 / 60
    low = piston_pass - 4
    high = piston_pass + 4
    sos = scipy.signal.butter(2, [low, high], "bandpass", fs=RATE, output="sos")
    noise = np.random.default_rng(1).standard_normal(100_000)
    hump = 20 * scipy.signal.sosfilt(sos, noise)[20_000:] + 0.1 * noise[20_000:]

    with pytest.raises(DataError, match="stands clear of the noise"):
        track_shaft_angle(Recording(hump[None], RATE, "hump"), order=7, expected_speed=rpm(860))


def test_a_line_at_the_edge_of_the_search_is_refused() -> None:
    with pytest.raises(DataError, match=r"at the edge of the search|stands clear"):
        track_shaft_angle(
            turning(shaft_speed(start=14.9, end=14.9), noise=0.1),
            order=7,
            expected_speed=rpm(860),
            search=0.03,
        )


def test_what_cannot_be_followed_is_said() -> None:
    recording = turning(shaft_speed(seconds=0.8))
    with pytest.raises(DataError, match="needs 16"):
        track_shaft_angle(recording, order=7, expected_speed=rpm(860))
    with pytest.raises(InputError, match="specifies no speed"):
        track_shaft_angle(recording, order=7)
    with pytest.raises(InputError, match="below half the sample rate"):
        track_shaft_angle(recording, order=700, expected_speed=rpm(860))
    with pytest.raises(InputError, match="at least one order"):
        track_shaft_angle(recording, order=(), expected_speed=rpm(860))
    with pytest.raises(InputError, match="positive speed"):
        track_shaft_angle(recording, order=7, expected_speed=-1.0)


@settings(max_examples=12, deadline=None)
@given(
    order=st.integers(1, 100),
    swing=st.floats(0, 0.02),
    per_turn=st.sampled_from([256, 512, 1000]),
)
def test_a_line_keeps_its_amplitude_along_the_angle(
    order: int, swing: float, per_turn: int
) -> None:
    true = shaft_speed(seconds=4.0, start=13, end=16, swing=swing)
    recording = Recording(np.cos(order * true + 0.5)[None], RATE, "run")
    angle = ShaftAngle(true, RATE, math.nan, math.nan, "the truth")
    turned = resample_by_angle(recording, angle, per_turn)
    whole = turned.signal[:, 2 * per_turn : 50 * per_turn]
    lines = np.fft.rfft(whole[0]) * 2 / whole.shape[1]

    assert abs(lines[48 * order]) == pytest.approx(1, abs=0.01)
    assert np.angle(lines[48 * order]) == pytest.approx(0.5, abs=0.01)


def test_orders_above_the_new_rate_are_cut_off_and_do_not_fold() -> None:
    true = shaft_speed(start=13, end=16)
    recording = Recording(np.cos(200 * true)[None], RATE, "run")
    turned = resample_by_angle(recording, ShaftAngle(true, RATE, 0.0, 1.0, "truth"), 256)

    assert np.abs(turned.signal[:, 512:-512]).max() < 0.01


def test_a_recording_along_the_angle_says_so_and_agrees_with_itself() -> None:
    true = shaft_speed(start=14, end=14.6)
    condition = OperatingCondition(rpm(860), MPa(15))
    recording = replace(turning(true, noise=0.1), condition=condition, label="normal")
    angle = track_shaft_angle(recording, order=7)
    turned = resample_by_angle(recording, angle, 512)

    assert turned.attributes["domain"] == "angle"
    assert turned.attributes["samples_per_turn"] == "512"
    assert turned.condition == condition
    assert turned.speed is not None

    true_speed = 2 * np.pi * np.linspace(14, 14.6, len(turned.speed))
    assert turned.speed == pytest.approx(true_speed, rel=0.02)
    assert turned.speed[1024:-1024] == pytest.approx(true_speed[1024:-1024], rel=0.003)

    frequency, amplitude = amplitude_spectrum(turned.signal, turned.sample_rate)
    assert frequency[amplitude[0].argmax()] == pytest.approx(
        7 * (specified_shaft_frequency(turned) or 0), rel=1e-3
    )
    assert not inspect_recordings([turned]).recordings[0].findings
    with pytest.raises(InputError, match="already"):
        resample_by_angle(turned, angle, 512)


def test_what_cannot_be_laid_along_an_angle_is_said() -> None:
    recording = turning(shaft_speed())
    angle = ShaftAngle(shaft_speed(), RATE, 0.0, 1.0, "truth")

    with pytest.raises(InputError, match="even number"):
        resample_by_angle(recording, angle, 255)
    with pytest.raises(InputError, match="take the angle from this recording"):
        resample_by_angle(turning(shaft_speed(seconds=4)), angle, 256)
    with pytest.raises(InputError, match="played_at"):
        resample_by_angle(recording, angle, 256, played_at=0.0)

    still = replace(recording, speed=np.zeros(recording.signal.shape[1]))
    with pytest.raises(InputError, match="stands still"):
        specified_angle(still)


def test_of_several_orders_those_beyond_half_the_sample_rate_are_left_out() -> None:
    recording = turning(shaft_speed(start=14.0, end=14.6), noise=0.1)
    angles = track_shaft_angle(recording, order=(7, 400, 700), expected_speed=rpm(860))

    assert angles.source == "the line at order 7"
    with pytest.raises(InputError, match=r"order 400 .* below half the sample rate"):
        track_shaft_angle(recording, order=(700, 400), expected_speed=rpm(860))


# ---- the angle from the piston-pass lines

SECONDS = 6.0
SPECIFIED = 15.0
TIME = np.arange(int(SECONDS * RATE)) / RATE


def recording_of(signal: np.ndarray) -> Recording:
    """Seven pistons of a shaft at 15 Hz, as stated, in a little noise."""
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(signal))
    return Recording(
        (signal + noise)[None],
        RATE,
        "one",
        condition=OperatingCondition(2 * np.pi * SPECIFIED, MPa(15)),
    )


@pytest.mark.parametrize("off", [-0.015, 0.015])
def test_sidebands_do_not_pass_for_a_piston_line(off: float) -> None:
    shaft = SPECIFIED * (1 + off)
    angle = 2 * np.pi * shaft * TIME
    lines = [
        0.33 * np.cos(7 * k * angle) + 0.4 * np.cos((7 * k - np.sign(off)) * angle)
        for k in range(1, 7)
    ]

    assert piston_pass_angle(recording_of(sum(lines)), 7).mean_speed == pytest.approx(
        2 * np.pi * shaft, rel=1e-3
    )


@pytest.mark.parametrize("off", [0.0, 0.012])
def test_a_run_up_is_followed_along_the_speed_that_it_states(off: float) -> None:
    shaft = 14 + 4 * TIME / SECONDS
    angle = 2 * np.pi * np.cumsum(shaft) / RATE
    signal = sum(np.cos(7 * k * angle + k) / k for k in range(1, 7))
    error = (
        piston_pass_angle(
            replace(recording_of(signal), speed=2 * np.pi * shaft * (1 + off)), 7
        ).angle
        - angle
    )
    inside = slice(int(RATE / 5), -int(RATE / 5))

    assert np.degrees(np.abs(error[inside] - np.median(error[inside])).max()) < 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"condition": None}, "specifies no speed"),
        (
            {"signal": np.random.default_rng(0).standard_normal((1, 60000))},
            "stands clear",
        ),
    ],
)
def test_a_recording_without_an_angle_is_refused_with_the_reason(
    changes: dict[str, Any], reason: str
) -> None:
    recording = replace(recording_of(np.cos(2 * np.pi * 7 * SPECIFIED * TIME)), **changes)
    with pytest.raises((DataError, InputError), match=reason):
        piston_pass_angle(recording, 7)
