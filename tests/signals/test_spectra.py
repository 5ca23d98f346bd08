"""Spectra, lines, noise and the paper's errors against what is known of made signals."""

import math

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import InputError
from swashtwin.signals import (
    align_waveform,
    band_limited,
    order_spectrum,
    peak_error,
    spectral_correlation,
    spectrum_value_error,
    synchronous_signal,
    waveform_rmse,
)
from swashtwin.signals.spectra import amplitude_spectrum, signal_envelope

RATE = 12800.0
SHAFT = 860 / 60


def turning(
    orders: np.ndarray,
    amplitudes: np.ndarray,
    revolutions: float,
    *,
    jitter: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """One channel of lines whose shaft frequency swings by `jitter` (relative) at 0.7 Hz, with
    white noise.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(int(revolutions / SHAFT * RATE)) / RATE
    swing = np.sin(2 * np.pi * 0.7 * time + rng.uniform(0, 2 * np.pi)).cumsum() / RATE
    angle = 2 * np.pi * SHAFT * (time + jitter * swing)
    phases = rng.uniform(0, 2 * np.pi, len(orders))
    signal = sum(
        amplitude * np.cos(order * angle + phase)
        for order, amplitude, phase in zip(orders, amplitudes, phases, strict=True)
    )

    return (signal + noise * rng.standard_normal(len(time)))[None]


@given(
    line=st.integers(3, 490),
    amplitude=st.floats(1e-3, 1e3),
    phase=st.floats(0, 6.3),
    offset=st.floats(-10, 10),
)
def test_a_sine_reads_its_amplitude_and_no_offset(
    line: int, amplitude: float, phase: float, offset: float
) -> None:
    time = np.arange(1000) / 1000
    signal = (offset + amplitude * np.sin(2 * np.pi * line * time + phase))[None]
    frequency, spectrum = amplitude_spectrum(signal, 1000.0)

    assert frequency[line] == line
    assert spectrum[0, line] == pytest.approx(amplitude, rel=1e-6)
    assert spectrum[0, line + 1] == pytest.approx(amplitude / 2, rel=1e-6)  # Hann's neighbors
    assert spectrum[0, 0] == pytest.approx(0, abs=1e-9 * (amplitude + abs(offset)))


@pytest.mark.parametrize(
    ("orders", "revolutions"),
    [
        ([7, 14, 21], 16),
        ([1, 2, 3, 7, 14, 21, 50], 16),
        (range(1, 60), 16),
        (range(1, 60), 33.3),
        (range(1, 60), 100),
    ],
)
def test_every_line_of_a_steady_shaft_reads_its_amplitude(
    orders: list[int], revolutions: float
) -> None:
    order = np.array(orders)
    amplitudes = np.random.default_rng(1).uniform(0.5, 2, len(order))
    spectrum = order_spectrum(turning(order, amplitudes, revolutions + 0.1), RATE, SHAFT, order)

    np.testing.assert_allclose(spectrum.amplitude[0], amplitudes, rtol=0.02)
    np.testing.assert_allclose(spectrum.frequency, order * SHAFT)
    np.testing.assert_array_equal(spectrum.orders, order)


@pytest.mark.parametrize("orders", [[7, 14, 21, 28], range(1, 40)])
@pytest.mark.parametrize("revolutions", [64, 150])
def test_lines_smeared_by_a_jittering_speed_read_their_amplitude(
    orders: list[int], revolutions: float
) -> None:
    order = np.array(orders)
    amplitudes = np.random.default_rng(2).uniform(0.5, 2, len(order))
    signal = turning(order, amplitudes, revolutions, jitter=0.005)
    spectrum = order_spectrum(signal, RATE, SHAFT, order)

    np.testing.assert_allclose(spectrum.amplitude[0], amplitudes, rtol=0.03)

    plain = amplitude_spectrum(signal, RATE)
    highest = np.argmin(np.abs(plain[0] - order[-1] * SHAFT))

    assert (
        plain[1][0, highest] < 0.8 * amplitudes[-1]
    )  # a line of the plain spectrum loses what is smeared


def test_the_noise_under_a_line_is_taken_away() -> None:
    orders = np.array([7, 14, 21])
    draws = [
        order_spectrum(turning(orders, np.ones(3), 100, noise=10.0, seed=s), RATE, SHAFT, orders)
        for s in range(60)
    ]
    power = np.mean([draw.amplitude**2 for draw in draws], axis=0)

    np.testing.assert_allclose(power, 1.0, rtol=0.06)

    width = 0.006 * 21 * SHAFT + 2.5 * SHAFT / 25
    raised = 1 + 2 * 10.0**2 * 2 * width / (
        RATE / 2
    )  # what the band over the last line would read with its noise

    assert raised > 1.15


@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_the_claimed_deviation_is_the_scatter_over_repeated_noise(noise: float) -> None:
    orders = np.array([1, 7, 14, 28])
    amplitudes = np.array([1.0, 2.0, 0.5, 1.0])
    draws = [
        order_spectrum(turning(orders, amplitudes, 80, noise=noise, seed=s), RATE, SHAFT, orders)
        for s in range(60)
    ]
    scatter = np.std([draw.amplitude[0] for draw in draws], axis=0, ddof=1)
    claimed = np.sqrt(np.mean([draw.deviation[0] ** 2 for draw in draws], axis=0))

    assert np.all(claimed > 0.7 * scatter)
    assert np.all(claimed < 1.8 * scatter)


@pytest.mark.parametrize(
    ("revolutions", "orders", "message"),
    [
        (15.9, [7], r"covers 15.9 revolutions; its orders need at least 16"),
        (
            20.0,
            [7, 446],
            r"order 446 lies at 6393 Hz, above half the sample rate \(6400 Hz\)",
        ),
        (20.0, [7, 500], "order 500 lies at 7167 Hz, above half"),
        (20.0, [0, 7], "order 0 has no amplitude: lines begin at order 1"),
    ],
)
def test_orders_that_cannot_be_read_are_refused(
    revolutions: float, orders: list[int], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        order_spectrum(
            turning(np.array([7]), np.ones(1), revolutions),
            RATE,
            SHAFT,
            np.array(orders),
        )


@settings(max_examples=40, deadline=None)
@given(
    orders=st.lists(st.integers(0, 300), min_size=1, max_size=12, unique=True),
    seed=st.integers(0, 2**32),
    start=st.floats(-20, 20),
)
def test_a_synchronous_signal_is_the_sum_of_its_cosines(
    orders: list[int], seed: int, start: float
) -> None:
    rng = np.random.default_rng(seed)
    order = np.array(orders)
    lines = rng.standard_normal((2, len(order))) + 1j * rng.standard_normal((2, len(order)))
    angle = start + rng.uniform(0, 0.3, 500).cumsum()
    expected = np.real(lines @ np.exp(1j * order[:, None] * angle))
    signal = synchronous_signal(lines, order, angle)

    assert np.all(
        np.abs(signal - expected).max(axis=-1) <= 0.005 * np.abs(lines).sum(axis=-1) + 1e-12
    )


@pytest.mark.parametrize(("high", "is_inside"), [(1000.0, False), (6400.0, True)])
def test_a_band_keeps_what_is_inside_unshifted_and_removes_the_rest(
    high: float, is_inside: bool
) -> None:
    time = np.arange(12800) / RATE
    low, inside, above = (np.sin(2 * np.pi * frequency * time) for frequency in (5, 300, 4000))
    limited = band_limited((low + inside + above)[None], RATE, 100.0, high)[0]
    expected = inside + above if is_inside else inside

    np.testing.assert_allclose(limited[1000:-1000], expected[1000:-1000], atol=0.01)


@given(shift=st.integers(0, 50), seed=st.integers(0, 2**32))
def test_a_known_shift_is_found(shift: int, seed: int) -> None:
    turn = np.random.default_rng(seed).standard_normal((2, 50))
    simulated = np.tile(turn, 4)
    measured = 3 * simulated[:, shift : shift + 150]

    np.testing.assert_array_equal(3 * align_waveform(measured, simulated), measured)


@given(scale=st.floats(0.1, 10), seed=st.integers(0, 2**32))
def test_the_papers_errors_have_their_special_values(scale: float, seed: int) -> None:
    measured = np.random.default_rng(seed).standard_normal((3, 64))
    lines = np.abs(measured)

    assert (waveform_rmse(measured, measured), peak_error(measured, measured)) == (0, 0)
    assert spectrum_value_error(lines, lines) == 0
    assert waveform_rmse(measured, measured + scale) == pytest.approx(scale)
    assert waveform_rmse(measured, 0 * measured) == pytest.approx(math.sqrt(np.mean(measured**2)))
    assert peak_error(measured, -scale * measured) == pytest.approx(abs(scale - 1))
    assert peak_error(measured, 0 * measured) == 1
    assert spectrum_value_error(lines, scale * lines) == pytest.approx(abs(scale - 1))
    assert spectrum_value_error(lines, 0 * lines) == pytest.approx(1)


@pytest.mark.parametrize("count", [400, 401])
def test_the_envelope_is_the_magnitude_of_the_analytic_signal(count: int) -> None:
    signal = np.random.default_rng(0).standard_normal((3, count))
    np.testing.assert_allclose(
        signal_envelope(signal), np.abs(scipy.signal.hilbert(signal)), rtol=1e-12
    )


def test_the_correlation_of_levels_ignores_gain_and_what_lies_in_the_noise() -> None:
    measured = np.array([[1.0, 0.1, 0.01], [0.3, 0.03, 1e-4]])
    assert spectral_correlation(measured, 5 * measured) > 0.98
    assert spectral_correlation(measured, 1 / measured) < -0.9
    assert spectral_correlation(measured, np.ones_like(measured)) == 0.0

    silent = measured * (measured > 1e-3)
    assert spectral_correlation(measured, silent) == pytest.approx(1.0)
