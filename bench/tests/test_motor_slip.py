"""The slip of a motor is heard in what it drives, and tells a pump's load whatever its speed."""

import math
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import InputError, parse, rpm
from swashtwin_bench import read_public_set
from swashtwin_bench.public.motor_slip import MotorSlip, motor_slip

RATE = 3200.0


def driven(field: float, shaft: float, *, seed: int = 0, duration: float = 5.0) -> np.ndarray:
    """Two channels with lines of a four-pole motor's supply and of the shaft [rev/min], in noise."""
    random = np.random.default_rng(seed)
    time = np.arange(round(duration * RATE)) / RATE
    lines = [(2 * k * field, 0.3) for k in (1, 2, 3, 6, 12)] + [(k * shaft, 0.25) for k in (1, 2, 3, 5, 6)]
    tones = [size * np.sin(2 * math.pi * at / 60 * time + random.uniform(0, 6)) for at, size in lines]
    return np.sum(tones, axis=0) + random.normal(size=(2, len(time)))


@pytest.mark.parametrize(("field", "shaft"), [(1034.4, 1012.0), (1241.5, 1229.0), (724.2, 713.5)])
def test_slip_is_found_without_knowing_the_field(field: float, shaft: float) -> None:
    slip = motor_slip(driven(field, shaft), RATE, rpm(round(field, -2)))
    assert slip.synchronous_speed == pytest.approx(rpm(field), rel=5e-4)
    assert slip.synchronous_speed - slip.speed == pytest.approx(rpm(field - shaft), rel=0.2)
    assert slip.clearness > 1.0


def test_the_load_coefficient_of_one_load_is_the_same_at_every_speed() -> None:
    # lag grows with the torque, and the torque with the square of the speed
    coefficients = [
        motor_slip(driven(n, n - 2.1e-5 * n**2), RATE, rpm(n)).load_coefficient for n in (724.0, 1034.0, 1241.0)
    ]
    assert np.ptp(coefficients) < 0.1 * np.mean(coefficients)
    assert MotorSlip(rpm(1000), rpm(980), 1.0).slip == pytest.approx(0.02)


def test_a_recording_too_short_for_the_lines_is_refused() -> None:
    with pytest.raises(InputError, match="30 turns"):
        motor_slip(driven(1034.4, 1012.0, duration=1.0), RATE, rpm(1000))
    with pytest.raises(InputError, match="rising ranges"):
        motor_slip(driven(1034.4, 1012.0), RATE, rpm(1000), slips=(0.04, 0.01))


def test_a_real_pump_slips_less_the_less_it_delivers_and_turns_as_its_log_says(public_data: Path) -> None:
    recordings = read_public_set("pump_cavitation", public_data / "pump_cavitation")
    first_repeats = [
        recording
        for recording in recordings
        if recording.attributes["speed_nominal"] == "1000 rpm" and recording.attributes["repeat"] == "1"
    ]
    assert [recording.label for recording in first_repeats] == [
        "healthy",
        *(f"cavitation{share}" for share in (25, 50, 75, 100)),
    ]
    slips = [motor_slip(recording.signal, recording.sample_rate, rpm(1000)) for recording in first_repeats]
    assert np.all(np.diff([slip.load_coefficient for slip in slips]) < 0)
    logged = [parse(recording.attributes["speed"], "rad/s") for recording in first_repeats]
    assert [slip.speed for slip in slips] == pytest.approx(logged, rel=3e-3)
