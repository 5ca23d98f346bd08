"""Added noise has the requested power, and the spectrum of its kind."""

import numpy as np
import pytest

from swashtwin.foundation import InputError
from swashtwin.signals import NoiseKind, add_noise

RATE = 12800.0
N_SAMPLES = 51_200
SNR_DB = 5.0
MAINS_HZ = 50

# A line of an amplitude of 3 in one channel and 1 in the other, and its power in each.
SIGNAL = np.array([[3.0], [1.0]]) * np.sin(2 * np.pi * 100 / RATE * np.arange(N_SAMPLES))
SIGNAL_POWER = np.array([4.5, 0.5])

KINDS = pytest.mark.parametrize("kind", ["white", "pink", "hum"])


def noise_of(kind: NoiseKind, *purpose: object) -> np.ndarray:
    """Return the noise that `add_noise` adds to the signal with the seed 0."""
    noisy = add_noise(SIGNAL, SNR_DB, 0, *purpose, kind=kind, sample_rate=RATE)
    return noisy - SIGNAL


def power_spectrum(noise: np.ndarray) -> np.ndarray:
    """Return the power of the first channel at each multiple of 0.25 Hz."""
    return np.abs(np.fft.rfft(noise[0])) ** 2


@KINDS
def test_noise_of_each_kind_has_its_power_in_each_channel(kind: NoiseKind) -> None:
    # Hum and pink noise of one draw scatter: the mean of five is within 20 %.
    powers = [noise_of(kind, repeat).var(axis=1) for repeat in range(5)]

    expected = SIGNAL_POWER * 10 ** (-SNR_DB / 10)
    np.testing.assert_allclose(np.mean(powers, axis=0), expected, rtol=0.2)


@KINDS
def test_noise_is_reproducible_and_differs_between_purposes(kind: NoiseKind) -> None:
    np.testing.assert_array_equal(noise_of(kind), noise_of(kind))
    assert not np.array_equal(noise_of(kind), noise_of(kind, "another"))


def test_pink_noise_has_the_same_power_in_each_octave() -> None:
    power = power_spectrum(noise_of("pink"))

    octaves = [power[start : 2 * start].sum() for start in (256, 1024, 4096)]
    np.testing.assert_allclose(octaves, np.mean(octaves), rtol=0.15)


def test_hum_is_twenty_lines_of_the_mains_whose_amplitudes_fall() -> None:
    # the window keeps a line within 4 Hz
    power = power_spectrum(noise_of("hum") * np.hanning(N_SAMPLES))
    samples_per_hertz = N_SAMPLES / RATE
    lines = []
    for harmonic in range(1, 22):
        start = round((MAINS_HZ * harmonic - 4) * samples_per_hertz)
        stop = round((MAINS_HZ * harmonic + 4) * samples_per_hertz)
        lines.append(power[start:stop].sum())

    # the amplitude of harmonic k is 1 / k of the first
    relative_power = np.array(lines[:20]) / lines[0]
    np.testing.assert_allclose(relative_power, 1 / np.arange(1, 21) ** 2, rtol=0.01)

    # there is nothing between the lines, and no line 21
    assert sum(lines[:20]) > 0.999 * power.sum()
    assert lines[20] < 1e-4 * lines[19]


WAVE = np.sin(np.arange(5000.0))[None]


def test_hum_has_only_the_lines_below_half_the_sample_rate() -> None:
    # At 130 Hz, that is the first one, which has all the power.
    hum = add_noise(WAVE, 0.0, 0, kind="hum", sample_rate=130.0) - WAVE

    assert hum.var() == pytest.approx(WAVE.var(), rel=0.02)


def test_hum_at_a_rate_too_low_for_any_line_adds_nothing() -> None:
    noisy = add_noise(WAVE, 0.0, 0, kind="hum", sample_rate=10.0)

    np.testing.assert_array_equal(noisy, WAVE)


def test_hum_without_a_sample_rate_is_refused() -> None:
    with pytest.raises(InputError, match="needs the sample rate"):
        add_noise(WAVE, 0.0, 0, kind="hum")
