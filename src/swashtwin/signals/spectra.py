"""Tapers, transforms, power densities and lines: the one module where signals become spectra.

Spectra are one-sided. They give peak amplitudes unless they are called power: a sine of amplitude 1
reads 1. Only networks and other code that torch differentiates call `torch.fft` themselves.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from jaxtyping import Complex, Float, Inexact, Int
from numpy.lib.stride_tricks import sliding_window_view

from swashtwin.foundation import InputError


def hann_taper(count: int, *, symmetric: bool = False) -> Float[np.ndarray, " time"]:
    """Return the Hann taper of `count` samples; read only.

    It is periodic, as spectra need it, or symmetric, as weighted means do.
    """
    if count <= MAX_CACHED_TAPER:
        return _cached_taper(count, symmetric)
    return _cached_taper.__wrapped__(count, symmetric)


MAX_CACHED_TAPER = 1 << 18
"""Samples of a taper up to which it is cached: computing it takes longer than the transform of the
signal that it tapers.
"""


@lru_cache(maxsize=16)
def _cached_taper(count: int, symmetric: bool) -> Float[np.ndarray, " time"]:
    taper: np.ndarray = np.hanning(count) if symmetric else np.hanning(count + 1)[:-1]
    taper.setflags(write=False)
    return taper


def transform(signal: Float[np.ndarray, "*batch time"]) -> Complex[np.ndarray, "*batch line"]:
    """Return the one-sided discrete Fourier transform along the last axis, unscaled."""
    return np.asarray(scipy.fft.rfft(signal, axis=-1))


def inverse_transform(
    lines: Inexact[np.ndarray, "*batch line"], count: int
) -> Float[np.ndarray, "*batch time"]:
    """Return the signal of `count` samples whose `transform` has these lines."""
    return np.asarray(scipy.fft.irfft(lines, count, axis=-1))


def line_frequencies(count: int, sample_rate: float) -> Float[np.ndarray, " line"]:
    """Return the frequency [Hz] of each line of the `transform` of `count` samples."""
    return np.fft.rfftfreq(count, 1 / sample_rate)


def tapered_transform(
    signal: Float[np.ndarray, "*batch time"],
) -> Complex[np.ndarray, "*batch line"]:
    """Return the `transform` of a signal less its mean times `hann_taper`, in its precision."""
    taper = hann_taper(signal.shape[-1]).astype(signal.dtype, copy=False)
    moving = signal - signal.mean(axis=-1, keepdims=True)
    return transform(np.multiply(moving, taper, out=moving))


def signal_envelope(signal: Float[np.ndarray, "*batch time"]) -> Float[np.ndarray, "*batch time"]:
    """Return the magnitude of the analytic signal.

    The result is that of `scipy.signal.hilbert`, which takes four times as long.
    """
    length = signal.shape[-1]
    lines = transform(signal) * -1j
    # The mean and the line at half the rate have no phase that could be turned.
    lines[..., 0] = 0
    lines[..., (length + 1) // 2 :] = 0

    square = inverse_transform(lines, length) ** 2
    square += signal**2
    envelope: np.ndarray = np.sqrt(square, out=square)
    return envelope


MAX_BLOCK_SAMPLES = 1 << 16
"""Samples of each channel that are transformed together: they stay in the processor's cache."""


def power_density(
    signal: Float[np.ndarray, "*batch time"], sample_rate: float, length: int | None = None
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "*batch frequency"]]:
    """Return frequencies [Hz] and one-sided power density [unit^2/Hz].

    The mean is removed and a Hann taper applied.

    Parameters
    ----------
    length : samples of the half-overlapping segments over which it is averaged (Welch); None takes
        the whole signal.
    """
    n_samples = signal.shape[-1]
    length = n_samples if length is None else min(length, n_samples)
    taper = hann_taper(length)
    hop = max(1, length - length // 2)
    segments = sliding_window_view(np.asarray(signal, dtype=np.float64), length, axis=-1)
    segments = segments[..., ::hop, :]

    density = np.zeros((*segments.shape[:-2], length // 2 + 1))
    at_once = max(1, MAX_BLOCK_SAMPLES // length)
    for first in range(0, segments.shape[-2], at_once):
        part = segments[..., first : first + at_once, :]
        part = (part - part.mean(axis=-1, keepdims=True)) * taper
        lines = scipy.fft.rfft(part, axis=-1, overwrite_x=True)
        density += (lines.real**2 + lines.imag**2).sum(axis=-2)

    # Lines of both signs are added, except for the mean and half the rate, which have one.
    density *= 2 / (sample_rate * (taper @ taper) * segments.shape[-2])
    density[..., 0] /= 2
    if length % 2 == 0:
        density[..., -1] /= 2
    return line_frequencies(length, sample_rate), density


def fourier_lines(
    revolution: Float[np.ndarray, "*batch step"],
) -> Complex[np.ndarray, "*batch order"]:
    """Return the lines X_k of one period of x(t) = X_0 + Re sum_k X_k exp(i k theta).

    The steps of theta are equal, from 0.

    Examples
    --------
    >>> angle = 2 * np.pi * np.arange(8) / 8
    >>> np.abs(fourier_lines(3 + np.cos(2 * angle))[:3]).round(12)
    array([3., 0., 1.])
    """
    lines: np.ndarray = transform(revolution) * (2 / revolution.shape[-1])
    lines[..., 0] /= 2
    return lines


def periodic_signal(
    lines: Complex[np.ndarray, "*batch order"], steps: int
) -> Float[np.ndarray, "*batch step"]:
    """Return one period in `steps` equal steps of the signal with these `fourier_lines`."""
    spectrum = lines * (steps / 2)
    spectrum[..., 0] *= 2
    return inverse_transform(spectrum, steps)


def amplitude_spectrum(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, resolution: float = 0.0
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]:
    """Return frequencies [Hz] and one-sided peak amplitudes.

    With a Hann taper, averaged over half-overlapping segments.

    Parameters
    ----------
    resolution : spacing of the lines [Hz], no finer than the whole signal in one segment gives.

    Examples
    --------
    >>> time = np.arange(1000) / 1000
    >>> frequency, amplitude = amplitude_spectrum(np.sin(2 * np.pi * 50 * time)[None], 1000.0)
    >>> print(f"{amplitude[0, 50]:.3f}")
    1.000
    """
    length = round(sample_rate / max(resolution, sample_rate / signal.shape[-1]))
    frequency, power = scipy.signal.welch(
        signal, sample_rate, "hann", nperseg=length, scaling="spectrum"
    )
    return frequency, np.sqrt(2 * power)


JITTER = 0.006
"""Half-width of the speed's variation [relative] over which the power of a line is summed."""
SEGMENTS = 4
"""Parts of a signal, the scatter between which gives the deviation of amplitudes."""
MIN_FLOOR_BINS = 8
"""Bins of the spectrum, clear of all lines, from which the noise under a line is estimated."""
MIN_SEGMENT_TURNS = 4
"""Revolutions in each of `SEGMENTS`, so that the lines of neighboring orders are resolved."""
MAX_HALF_WIDTH_SHARE = 0.45
"""Half-width of a line's band over the distance to the next order, so that bands do not touch."""


@dataclass(frozen=True, eq=False)
class OrderSpectrum:
    """Amplitudes of a signal at multiples of the shaft frequency."""

    orders: Int[np.ndarray, " order"]
    """Multiples of the shaft frequency."""
    shaft_frequency: float
    """Shaft frequency [Hz]."""
    amplitude: Float[np.ndarray, "channel order"]
    """Peak amplitude of each line, the noise under it taken away."""
    deviation: Float[np.ndarray, "channel order"]
    """Standard deviation of that amplitude, from noise and from the scatter between segments."""

    @property
    def frequency(self) -> Float[np.ndarray, " order"]:
        """Frequency of each line [Hz]."""
        return self.orders * self.shaft_frequency


def segment_densities(
    signal: Float[np.ndarray, "channel time"], sample_rate: float
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel segment frequency"]]:
    """Return the `power_density` of each of `SEGMENTS` equal parts of the signal.

    A remainder at the end is not used.
    """
    length = signal.shape[-1] // SEGMENTS
    segments = signal[:, : SEGMENTS * length].reshape(signal.shape[0], SEGMENTS, length)
    return power_density(segments, sample_rate)


def order_spectrum(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    shaft_frequency: float,
    orders: Int[np.ndarray, " order"],
    *,
    densities: tuple[
        Float[np.ndarray, " frequency"], Float[np.ndarray, "channel segment frequency"]
    ]
    | None = None,
) -> OrderSpectrum:
    """Return the amplitudes at `orders`, each gathered over the band that a wandering speed smears.

    The power within the band, less the noise floor beside it, is that of one sine. A smear of
    `JITTER` (relative) is expected; the band never reaches half way to the next of the `orders`,
    and the floor is read off between the bands. Other lines of the signal count as noise if they
    lie there.

    Parameters
    ----------
    signal : at least `SEGMENTS` x 4 revolutions.
    densities : `segment_densities` of the signal, if they are known already.

    Raises
    ------
    InputError
        The signal is too short, or an order lies below 1 or above half the sample rate.
    """
    _require_orders(signal.shape[-1], sample_rate, shaft_frequency, orders)
    if densities is None:
        densities = segment_densities(signal, sample_rate)
    frequency, density = densities
    line_width = frequency[1]

    # The distance from 0 counts too, so that order 1 does not take in the removed mean.
    centers = orders * shaft_frequency
    spacing = float(np.min(np.diff(np.unique(np.concatenate([[0], centers])))))
    half_widths = np.minimum(2.5 * line_width + JITTER * centers, MAX_HALF_WIDTH_SHARE * spacing)
    # The mean that was removed leaves a hole in the first two lines.
    is_free = np.arange(len(frequency)) > 1
    for center, half_width in zip(centers, half_widths, strict=True):
        is_free &= np.abs(frequency - center) > half_width

    power = np.empty((signal.shape[0], SEGMENTS, len(orders)))
    floor = np.empty_like(power)
    for index, (center, half_width) in enumerate(zip(centers, half_widths, strict=True)):
        distance = np.abs(frequency - center)
        is_inside = distance <= half_width
        is_beside = _floor_bins(distance, is_free, half_width, line_width)
        # The median of a periodogram of noise is ln 2 of its mean.
        noise_density = np.median(density[..., is_beside], axis=-1) / math.log(2)
        floor[..., index] = noise_density * is_inside.sum() * line_width
        band_power = density[..., is_inside].sum(axis=-1) * line_width
        power[..., index] = band_power - floor[..., index]

    amplitude, deviation = _amplitude_and_deviation(power, floor)
    return OrderSpectrum(np.asarray(orders), shaft_frequency, amplitude, deviation)


def _floor_bins(
    distance: Float[np.ndarray, " frequency"],
    is_free: np.ndarray,
    half_width: float,
    line_width: float,
) -> np.ndarray:
    """Return which bins show the noise under a line: free ones beside its band.

    If there are too few, the nearest `MIN_FLOOR_BINS` free ones are taken, however far they are.
    """
    is_beside = is_free & (distance <= max(2 * half_width, half_width + 6 * line_width))
    if is_beside.sum() < MIN_FLOOR_BINS:
        nearest_distances = np.sort(distance[is_free])[:MIN_FLOOR_BINS]
        is_beside = is_free & (distance <= nearest_distances.max(initial=0))
    return is_beside


def _require_orders(
    n_samples: int,
    sample_rate: float,
    shaft_frequency: float,
    orders: Int[np.ndarray, " order"],
) -> None:
    """Raise an `InputError` unless a signal resolves the orders."""
    nyquist = sample_rate / 2
    if n_samples // SEGMENTS / sample_rate * shaft_frequency < MIN_SEGMENT_TURNS:
        turns = n_samples / sample_rate * shaft_frequency
        raise InputError(
            f"the signal covers {turns:.1f} revolutions; its orders need at least "
            f"{MIN_SEGMENT_TURNS * SEGMENTS}."
        )
    if orders.min() < 1:
        raise InputError(f"order {orders.min()} has no amplitude: lines begin at order 1.")
    if orders.max() * shaft_frequency * (1 + JITTER) > nyquist:
        raise InputError(
            f"order {orders.max()} lies at {orders.max() * shaft_frequency:.0f} Hz, above half the "
            f"sample rate ({nyquist:.0f} Hz)."
        )


def _amplitude_and_deviation(
    power: Float[np.ndarray, "channel segment order"],
    floor: Float[np.ndarray, "channel segment order"],
) -> tuple[Float[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Return peak amplitudes and their standard deviations from the powers of segments."""
    amplitude = np.sqrt(2 * np.clip(power.mean(axis=1), 0, None))
    noise = floor.mean(axis=1)
    spread = power.std(axis=1, ddof=1) / math.sqrt(SEGMENTS)
    power_deviation = np.sqrt(spread**2 + (noise**2) / (4 * SEGMENTS))

    # An amplitude below its own deviation has no derivative to rely on: the root is bounded there.
    smallest = np.sqrt(np.maximum(power_deviation, 1e-300))
    return amplitude, power_deviation / np.maximum(amplitude, smallest)


def synchronous_signal(
    lines: Complex[np.ndarray, "channel line"],
    orders: Int[np.ndarray, " line"],
    angle: Float[np.ndarray, " time"],
) -> Float[np.ndarray, "channel time"]:
    """Return the signal Re sum_k lines_k exp(i k angle) along a shaft angle [rad].

    The angle may advance unevenly. One revolution is tabulated on a grid of at least 32 points per
    shortest period and read off by interpolation; its error is below 0.5 % of the sum of the lines'
    magnitudes.
    """
    # A power of two is fast to transform.
    n_grid = 1 << max(12, math.ceil(math.log2(32 * (int(orders.max()) + 1))))
    all_lines = np.zeros((lines.shape[0], n_grid // 2 + 1), dtype=complex)
    all_lines[:, orders] = lines
    revolution = periodic_signal(all_lines, n_grid)

    position = np.mod(angle, 2 * np.pi) * (n_grid / (2 * np.pi))
    index = position.astype(np.int64) % n_grid
    weight = position - np.floor(position)
    next_index = (index + 1) % n_grid
    signal: np.ndarray = revolution[:, index] * (1 - weight) + revolution[:, next_index] * weight
    return signal


def align_waveform(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel longer"]
) -> Float[np.ndarray, "channel time"]:
    """Return the stretch of `simulated` that correlates best with `measured`.

    It is as long as `measured`, and all channels count together. With `simulated` one period
    longer than `measured`, every phase is tried.

    Raises
    ------
    InputError
        `simulated` is shorter than `measured`.
    """
    length = measured.shape[-1]
    if simulated.shape[-1] < length:
        raise InputError(
            f"{simulated.shape[-1]} simulated samples are fewer than the {length} measured ones."
        )
    correlation = sum(
        scipy.signal.correlate(channel, template, "valid")
        for channel, template in zip(simulated, measured, strict=True)
    )
    start = int(np.argmax(correlation))
    return simulated[:, start : start + length]


def waveform_rmse(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]
) -> float:
    """Return the root mean square of the difference, in the signals' unit (the paper's RMSE)."""
    return float(np.sqrt(np.mean((measured - simulated) ** 2)))


def peak_error(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]
) -> float:
    """Return the relative difference of the largest magnitudes, averaged over channels.

    This is the paper's PE.
    """
    peaks = np.abs(measured).max(axis=-1)
    return float(np.mean(np.abs(np.abs(simulated).max(axis=-1) - peaks) / peaks))


def spectrum_value_error(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Return the sum of the amplitudes' differences over the sum of the measured amplitudes.

    This is our reading of the paper's SVE.
    """
    return float(np.abs(measured - simulated).sum() / measured.sum())


LEVEL_RANGE_DB = 60.0
"""Range below the strongest measured line within which lines are compared; below it is noise."""


def spectral_correlation(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Return Pearson's correlation of two spectra in dB, over all channels and orders.

    1 is a spectrum of the same shape, and a common gain does not change it. Amplitudes of both
    spectra count as at least `LEVEL_RANGE_DB` below the strongest measured line. The correlation is
    0 if one of the spectra is constant.

    Examples
    --------
    >>> measured = np.array([[1.0, 0.1, 0.5]])
    >>> round(spectral_correlation(measured, 2 * measured), 3)
    1.0
    """
    floor = max(float(measured.max()) * 10 ** (-LEVEL_RANGE_DB / 20), 1e-300)
    measured_level = 20 * np.log10(np.maximum(measured, floor)).ravel()
    simulated_level = 20 * np.log10(np.maximum(simulated, floor)).ravel()
    measured_level = measured_level - measured_level.mean()
    simulated_level = simulated_level - simulated_level.mean()

    norm = float(np.linalg.norm(measured_level) * np.linalg.norm(simulated_level))
    if norm == 0:
        return 0.0
    return float(measured_level @ simulated_level) / norm
