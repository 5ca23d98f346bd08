"""The shaft's angle from the piston-pass lines: sidebands do not pass for them, a run-up is followed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, MPa
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.signals import piston_pass_angle

RATE, SECONDS, STATED = 10000.0, 6.0, 15.0
TIME = np.arange(int(SECONDS * RATE)) / RATE


def recording_of(signal: np.ndarray) -> Recording:
    """Seven pistons of a shaft at 15 Hz, as stated, in a little noise."""
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(signal))
    return Recording((signal + noise)[None], RATE, "one", condition=OperatingCondition(2 * np.pi * STATED, MPa(15)))


@pytest.mark.parametrize("off", [-0.015, 0.015])
def test_sidebands_do_not_pass_for_a_piston_line(off: float) -> None:
    shaft = STATED * (1 + off)
    angle = 2 * np.pi * shaft * TIME
    lines = [0.33 * np.cos(7 * k * angle) + 0.4 * np.cos((7 * k - np.sign(off)) * angle) for k in range(1, 7)]
    assert piston_pass_angle(recording_of(sum(lines)), 7).mean_speed == pytest.approx(2 * np.pi * shaft, rel=1e-3)


@pytest.mark.parametrize("off", [0.0, 0.012])
def test_a_run_up_is_followed_along_the_speed_that_it_states(off: float) -> None:
    shaft = 14 + 4 * TIME / SECONDS
    angle = 2 * np.pi * np.cumsum(shaft) / RATE
    signal = sum(np.cos(7 * k * angle + k) / k for k in range(1, 7))
    error = piston_pass_angle(replace(recording_of(signal), speed=2 * np.pi * shaft * (1 + off)), 7).angle - angle
    inside = slice(int(RATE / 5), -int(RATE / 5))
    assert np.degrees(np.abs(error[inside] - np.median(error[inside])).max()) < 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"condition": None}, "nobody stated its speed"),
        ({"signal": np.random.default_rng(0).standard_normal((1, 60000))}, "stands clear"),
    ],
)
def test_a_recording_without_an_angle_is_refused_with_the_reason(changes: dict[str, Any], reason: str) -> None:
    recording = replace(recording_of(np.cos(2 * np.pi * 7 * STATED * TIME)), **changes)
    with pytest.raises((DataError, InputError), match=reason):
        piston_pass_angle(recording, 7)
