"""A flaw in a bearing beats at its own rhythm, whichever bearing and speed; other rhythms stay quiet."""

import math

import numpy as np
import pytest

from swashtwin.foundation import InputError
from swashtwin.signals import BEARINGS, SEATS, defect_prominences, prewhitened
from swashtwin.signals.bearings import defect_orders

RATE, BANDS = 12000.0, ((50.0, 5900.0), (2000.0, 4500.0))


def struck(order: float, shaft: float, *, seed: int = 0, duration: float = 4.0) -> np.ndarray:
    """Noise and a resonance at 3 kHz that rings `order` times a turn, with a little sliding."""
    random = np.random.default_rng(seed)
    n_samples = round(duration * RATE)
    steps = (1 + 0.004 * random.normal(size=round(order * shaft * duration) + 20)) / (order * shaft)
    at = np.round(np.cumsum(steps) * RATE).astype(int)
    train = np.zeros(n_samples)
    train[at[at < n_samples]] = 1.0
    ring = np.exp(-np.arange(60) / 15) * np.sin(2 * math.pi * 3000 * np.arange(60) / RATE)
    return np.convolve(train, ring)[:n_samples] + 0.15 * random.normal(size=n_samples)


@pytest.mark.parametrize("bearing", BEARINGS)
@pytest.mark.parametrize("seat", SEATS)
def test_the_seat_of_a_flaw_stands_out_of_the_envelope_on_either_bearing(bearing: str, seat: str) -> None:
    orders, shaft = BEARINGS[bearing], 29.5
    prominences = defect_prominences(struck(getattr(orders, seat), shaft), RATE, shaft, orders, BANDS)
    assert prominences.shape == (2, 3, 2)
    lines = prominences.mean(axis=0)[:, 0]
    assert SEATS[int(lines.argmax())] == seat
    assert lines.max() > np.sort(lines)[1] + 2


def test_noise_alone_names_no_seat() -> None:
    noise = np.random.default_rng(1).normal(size=48000)
    assert defect_prominences(noise, RATE, 29.5, BEARINGS["SKF 6205"], BANDS).max() < 3.5


def test_the_orders_are_those_that_the_maker_prints() -> None:
    # CWRU's page: 5.4152, 3.5848, 4.7135, 0.39828 for the drive end, 4.9469, 3.0530, 3.9874, 0.3817 for the fan end
    assert BEARINGS["SKF 6205"] == pytest.approx((5.4152, 3.5848, 4.7135, 0.39828), rel=1e-4)
    assert BEARINGS["SKF 6203"] == pytest.approx((4.9469, 3.0530, 3.9874, 0.3817), rel=2e-4)


def test_a_contact_angle_slows_the_ball_less_than_the_other_rhythms() -> None:
    ratio, angle = 0.3, math.radians(40)
    g = ratio * math.cos(angle)
    wanted = (8 * (1 + g) / 2, 8 * (1 - g) / 2, (1 - g**2) / ratio, (1 - g) / 2)
    assert defect_orders(8, ratio, angle) == pytest.approx(wanted)
    assert defect_orders(8, ratio, angle).ball == pytest.approx(3.157, rel=1e-3)


def test_prewhitening_leaves_impulses_and_levels_tones() -> None:
    time = np.arange(12000) / RATE
    tone = 20 * np.sin(2 * math.pi * 500 * time)
    impulsive = struck(3.58, 29.5, duration=1.0)
    white = prewhitened((tone + impulsive)[None])[0]
    level = np.abs(np.fft.rfft(white))[1:-1]
    assert np.ptp(level) < 1e-6 * level.mean()
    assert np.mean((white / white.std()) ** 4) > np.mean(((tone + impulsive) / (tone + impulsive).std()) ** 4) + 1


@pytest.mark.parametrize(("bodies", "ratio"), [(2, 0.2), (9, 0.0), (9, 1.2)])
def test_a_bearing_that_cannot_be_is_refused(bodies: int, ratio: float) -> None:
    with pytest.raises(InputError, match="bearing"):
        defect_orders(bodies, ratio)
