"""Noise has the power that was asked for, and the spectrum of its kind."""

import numpy as np
import pytest

from swashtwin.foundation import InputError
from swashtwin.signals import NoiseKind, add_noise

RATE = 12800.0
COUNT = 51200


def added(kind: NoiseKind, snr_db: float = 5.0, *purpose: object) -> np.ndarray:
    """What `add_noise` adds to a line of an amplitude of 3 and 1 in two channels."""
    signal = np.array([[3.0], [1.0]]) * np.sin(2 * np.pi * 100 / RATE * np.arange(COUNT))
    return add_noise(signal, snr_db, 0, *purpose, kind=kind, sample_rate=RATE) - signal


@pytest.mark.parametrize("kind", ["white", "pink", "hum"])
def test_each_kind_has_the_power_of_its_ratio_in_each_channel(kind: NoiseKind) -> None:
    power = np.mean([added(kind, 5.0, repeat).var(axis=1) for repeat in range(5)], axis=0)
    np.testing.assert_allclose(power, np.array([4.5, 0.5]) * 10**-0.5, rtol=0.2)
    np.testing.assert_array_equal(added(kind), added(kind))
    assert not np.array_equal(added(kind), added(kind, 5.0, "another"))


def test_pink_noise_has_the_same_power_in_each_octave() -> None:
    power = np.abs(np.fft.rfft(added("pink"), axis=1)) ** 2
    octaves = [power[0, low : 2 * low].sum() for low in (256, 1024, 4096)]
    np.testing.assert_allclose(octaves, np.mean(octaves), rtol=0.15)


def test_hum_is_lines_of_the_mains_that_fall_with_their_number() -> None:
    power = np.abs(np.fft.rfft(added("hum") * np.hanning(COUNT), axis=1)) ** 2
    per_hertz = COUNT / RATE
    lines = [
        power[0, round((50 * h - 4) * per_hertz) : round((50 * h + 4) * per_hertz)].sum()
        for h in range(1, 22)
    ]

    np.testing.assert_allclose(
        np.array(lines[:20]) / lines[0], 1 / np.arange(1, 21) ** 2, rtol=0.01
    )
    assert sum(lines[:20]) > 0.999 * power[0].sum()
    assert lines[20] < 1e-4 * lines[19]


def test_hum_above_half_the_rate_is_left_out_and_refused_without_a_rate() -> None:
    signal = np.sin(np.arange(5000.0))[None]
    changed = add_noise(signal, 0.0, 0, kind="hum", sample_rate=130.0) - signal

    assert changed.var() == pytest.approx(signal.var(), rel=0.02)
    np.testing.assert_array_equal(add_noise(signal, 0.0, 0, kind="hum", sample_rate=10.0), signal)
    with pytest.raises(InputError, match="needs the sample rate"):
        add_noise(signal, 0.0, 0, kind="hum")
