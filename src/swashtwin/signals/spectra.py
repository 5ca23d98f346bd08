"""Tapers, transforms, power densities and lines: the one place where signals become spectra.

Spectra are one-sided and, where not called power, give peak amplitudes: a sine of amplitude 1 reads
1. Only networks and other code that torch differentiates call `torch.fft` themselves.
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
    """Hann taper of `count` samples; periodic, as a spectrum wants it, or symmetric, as a weighted
    mean does; read only.
    """
    return (
        _kept_taper(count, symmetric)
        if count <= _LONGEST_KEPT
        else _kept_taper.__wrapped__(count, symmetric)
    )


_LONGEST_KEPT = 1 << 18
"""Samples of a taper up to which it is kept: to compute it takes longer than to transform what it
tapers.
"""


@lru_cache(maxsize=16)
def _kept_taper(count: int, symmetric: bool) -> Float[np.ndarray, " time"]:
    taper: np.ndarray = np.hanning(count) if symmetric else np.hanning(count + 1)[:-1]
    taper.setflags(write=False)
    return taper


def transform(
    signal: Float[np.ndarray, "*batch time"], count: int | None = None
) -> Complex[np.ndarray, "*batch line"]:
    """One-sided discrete Fourier transform along the last axis, unscaled; `count` pads the signal
    with zeros.
    """
    return np.asarray(scipy.fft.rfft(signal, count, axis=-1))


def inverse_transform(
    lines: Inexact[np.ndarray, "*batch line"], count: int
) -> Float[np.ndarray, "*batch time"]:
    """Signal of `count` samples whose `transform` has these lines."""
    return np.asarray(scipy.fft.irfft(lines, count, axis=-1))


def line_frequencies(count: int, sample_rate: float) -> Float[np.ndarray, " line"]:
    """Frequency [Hz] of each line of the `transform` of `count` samples."""
    return np.fft.rfftfreq(count, 1 / sample_rate)


def tapered_transform(
    signal: Float[np.ndarray, "*batch time"],
) -> Complex[np.ndarray, "*batch line"]:
    """`transform` of a signal without its mean, times `hann_taper`; of the signal's precision."""
    taper = hann_taper(signal.shape[-1]).astype(signal.dtype, copy=False)
    moving = signal - signal.mean(axis=-1, keepdims=True)
    return transform(np.multiply(moving, taper, out=moving))


def signal_envelope(signal: Float[np.ndarray, "*batch time"]) -> Float[np.ndarray, "*batch time"]:
    """Magnitude of the analytic signal, as by `scipy.signal.hilbert`, which takes four times as
    long.
    """
    length = signal.shape[-1]
    lines = transform(signal) * -1j
    lines[..., 0] = 0  # the mean and half the rate have no phase to be turned
    lines[..., (length + 1) // 2 :] = 0
    square = inverse_transform(lines, length) ** 2
    square += signal**2
    envelope: np.ndarray = np.sqrt(square, out=square)
    return envelope


AT_ONCE = 1 << 16
"""Samples of each channel that are transformed together: they stay in the processor's cache."""


def power_density(
    signal: Float[np.ndarray, "*batch time"], sample_rate: float, length: int | None = None
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "*batch frequency"]]:
    """Frequencies [Hz] and one-sided power density [unit^2/Hz], Hann taper, mean removed.

    Parameters
    ----------
    length : samples of the half-overlapping segments over which it is averaged (Welch); None takes
        the whole signal.
    """
    length = signal.shape[-1] if length is None else min(length, signal.shape[-1])
    taper = hann_taper(length)
    segments = sliding_window_view(np.asarray(signal, dtype=np.float64), length, axis=-1)
    segments = segments[..., :: max(1, length - length // 2), :]
    density = np.zeros((*segments.shape[:-2], length // 2 + 1))
    at_once = max(1, AT_ONCE // length)
    for first in range(0, segments.shape[-2], at_once):
        part = segments[..., first : first + at_once, :]
        part = (part - part.mean(axis=-1, keepdims=True)) * taper
        lines = scipy.fft.rfft(part, axis=-1, overwrite_x=True)
        density += (lines.real**2 + lines.imag**2).sum(axis=-2)
    density *= 2 / (sample_rate * (taper @ taper) * segments.shape[-2])
    density[..., 0] /= 2
    if length % 2 == 0:
        density[..., -1] /= 2
    return line_frequencies(length, sample_rate), density


def fourier_lines(
    revolution: Float[np.ndarray, "*batch step"],
) -> Complex[np.ndarray, "*batch order"]:
    """Lines X_k of one period of x(t) = X_0 + Re sum_k X_k exp(i k theta), theta from 0 in equal
    steps.

    Examples
    --------
    >>> angle = 2 * np.pi * np.arange(8) / 8
    >>> np.abs(fourier_lines(3 + np.cos(2 * angle))[:3]).round(12)
    array([3., 0., 1.])
    """
    lines = transform(revolution) * (2 / revolution.shape[-1])
    lines[..., 0] /= 2
    return lines


def periodic_signal(
    lines: Complex[np.ndarray, "*batch order"], steps: int
) -> Float[np.ndarray, "*batch step"]:
    """One period in `steps` equal steps of the signal whose `fourier_lines` these are."""
    spectrum = lines * (steps / 2)
    spectrum[..., 0] *= 2
    return inverse_transform(spectrum, steps)


def amplitude_spectrum(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, resolution: float = 0.0
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]:
    """Frequencies [Hz] and one-sided peak amplitudes, Hann taper, averaged over half-overlapping
    segments.

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
"""The scatter of the amplitudes between so many parts of a signal gives their deviation."""
_FLOOR_BINS = 8
"""The noise under a line is judged from at least so many samples of the spectrum that no line asked
for reaches.
"""


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
    """`power_density` of each of `SEGMENTS` equal parts of the signal; a rest at the end is left
    out.
    """
    length = signal.shape[-1] // SEGMENTS
    return power_density(
        signal[:, : SEGMENTS * length].reshape(signal.shape[0], SEGMENTS, length), sample_rate
    )


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
    """Amplitudes at `orders`, each gathered over the band in which a jittering speed smears it.

    The power within the band, less the noise floor beside it, is that of one sine. A smear of
    `JITTER` (relative) is expected; the band never reaches half way to the next order asked for,
    and the floor is read off between the bands. Lines that are in the signal but not asked for
    count as noise where they fall there.

    Parameters
    ----------
    signal : at least `SEGMENTS` x 4 revolutions.
    densities : `segment_densities` of the signal, where they are at hand.

    Raises
    ------
    InputError
        The signal is too short, or an order lies below 1 or above half the sample rate.
    """
    length = signal.shape[-1] // SEGMENTS
    if length / sample_rate * shaft_frequency < 4:
        raise InputError(
            f"the signal covers {signal.shape[-1] / sample_rate * shaft_frequency:.1f} revolutions; its orders need at "
            f"least {4 * SEGMENTS}."
        )
    if orders.min() < 1:
        raise InputError(f"order {orders.min()} has no amplitude: lines begin at order 1.")
    if orders.max() * shaft_frequency * (1 + JITTER) > sample_rate / 2:
        raise InputError(
            f"order {orders.max()} lies at {orders.max() * shaft_frequency:.0f} Hz, above half the sample rate "
            f"({sample_rate / 2:.0f} Hz)."
        )
    frequency, density = segment_densities(signal, sample_rate) if densities is None else densities
    line_width = frequency[1]
    centers = orders * shaft_frequency
    spacing = float(np.min(np.diff(np.unique(np.concatenate([[0], centers])))))
    halves = np.minimum(2.5 * line_width + JITTER * centers, 0.45 * spacing)
    free = (
        np.arange(len(frequency)) > 1
    )  # the mean that was taken away leaves a hole in the first two
    for center, half in zip(centers, halves, strict=True):
        free &= np.abs(frequency - center) > half
    power = np.empty((signal.shape[0], SEGMENTS, len(orders)))
    floor = np.empty_like(power)
    for i, (center, half) in enumerate(zip(centers, halves, strict=True)):
        distance = np.abs(frequency - center)
        inside = distance <= half
        beside = free & (distance <= max(2 * half, half + 6 * line_width))
        if beside.sum() < _FLOOR_BINS:
            beside = free & (distance <= np.sort(distance[free])[:_FLOOR_BINS].max(initial=0))
        level = np.median(density[..., beside], axis=-1) / math.log(
            2
        )  # a periodogram's median is ln 2 of its mean
        floor[..., i] = level * inside.sum() * line_width
        power[..., i] = density[..., inside].sum(axis=-1) * line_width - floor[..., i]
    mean_power = power.mean(axis=1)
    amplitude = np.sqrt(2 * np.clip(mean_power, 0, None))
    noise = floor.mean(axis=1)
    spread = power.std(axis=1, ddof=1) / math.sqrt(SEGMENTS)
    power_deviation = np.sqrt(spread**2 + (noise**2) / (4 * SEGMENTS))
    deviation = power_deviation / np.maximum(
        amplitude, np.sqrt(np.maximum(power_deviation, 1e-300))
    )
    return OrderSpectrum(np.asarray(orders), shaft_frequency, amplitude, deviation)


def synchronous_signal(
    lines: Complex[np.ndarray, "channel line"],
    orders: Int[np.ndarray, " line"],
    angle: Float[np.ndarray, " time"],
) -> Float[np.ndarray, "channel time"]:
    """Signal Re sum_k lines_k exp(i k angle) along a shaft angle [rad], which may advance unevenly.

    One revolution is tabulated on a grid of at least 32 points per shortest period and read off by
    interpolation; its error is below 0.5 % of the sum of the lines' magnitudes.
    """
    n_grid = 1 << max(12, math.ceil(math.log2(32 * (int(orders.max()) + 1))))
    every = np.zeros((lines.shape[0], n_grid // 2 + 1), dtype=complex)
    every[:, orders] = lines
    revolution = periodic_signal(every, n_grid)
    position = np.mod(angle, 2 * np.pi) * (n_grid / (2 * np.pi))
    left = position.astype(np.int64) % n_grid
    weight = position - np.floor(position)
    return revolution[:, left] * (1 - weight) + revolution[:, (left + 1) % n_grid] * weight


def aligned(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel longer"]
) -> Float[np.ndarray, "channel time"]:
    """Stretch of `simulated`, as long as `measured`, that correlates best with it over all channels
    together.

    With `simulated` one period longer than `measured`, every phase is tried.

    Raises
    ------
    InputError
        `simulated` is the shorter one.
    """
    length = measured.shape[-1]
    if simulated.shape[-1] < length:
        raise InputError(
            f"{simulated.shape[-1]} simulated samples are fewer than the {length} measured ones."
        )
    score = sum(
        scipy.signal.correlate(s, m, "valid") for s, m in zip(simulated, measured, strict=True)
    )
    start = int(np.argmax(score))
    return simulated[:, start : start + length]


def waveform_rmse(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]
) -> float:
    """Root mean square of the difference, in the signals' unit (the paper's RMSE)."""
    return float(np.sqrt(np.mean((measured - simulated) ** 2)))


def peak_error(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]
) -> float:
    """Mean over channels of the difference of the largest magnitudes, relative to the measured (the
    paper's PE).
    """
    peaks = np.abs(measured).max(axis=-1)
    return float(np.mean(np.abs(np.abs(simulated).max(axis=-1) - peaks) / peaks))


def spectrum_value_error(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Sum of the amplitudes' differences over the sum of the measured amplitudes (the paper's SVE;
    our reading).
    """
    return float(np.abs(measured - simulated).sum() / measured.sum())


LEVEL_RANGE = 60.0
"""Lines further [dB] below the strongest measured one count as if they were so far below it: there
is only noise.
"""


def spectral_correlation(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Pearson's correlation of the levels in dB, over all channels and orders; 1 is a spectrum of
    the same shape.

    A level is 20 log10 of the amplitude, no lower than 60 dB below the strongest measured line
    (`LEVEL_RANGE`), the same floor for both sides. A common gain does not change it. It is 0 where
    the levels of one side are all equal.

    Examples
    --------
    >>> measured = np.array([[1.0, 0.1, 0.5]])
    >>> round(spectral_correlation(measured, 2 * measured), 3)
    1.0
    """
    floor = max(float(measured.max()) * 10 ** (-LEVEL_RANGE / 20), 1e-300)
    first, second = (
        20 * np.log10(np.maximum(side, floor)).ravel() for side in (measured, simulated)
    )
    first, second = first - first.mean(), second - second.mean()
    width = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / width if width > 0 else 0.0
