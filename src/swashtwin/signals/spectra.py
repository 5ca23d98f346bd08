"""What can be done to a sampled signal without knowing what a pump is.

Spectra are one-sided and give peak amplitudes: a sine of amplitude 1 reads 1.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Complex, Float, Int

from swashtwin.foundation import InputError, stream


def amplitude_spectrum(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, resolution: float | None = None
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]:
    """Frequencies [Hz] and one-sided peak amplitudes, Hann taper, averaged over half-overlapping segments.

    Parameters
    ----------
    signal : readings, any unit.
    sample_rate : [Hz].
    resolution : spacing of the lines [Hz]; None takes one segment over the whole signal.

    Raises
    ------
    InputError
        A resolution that is not positive, or above half the sample rate.

    Examples
    --------
    >>> time = np.arange(1000) / 1000
    >>> frequency, amplitude = amplitude_spectrum(np.sin(2 * np.pi * 50 * time)[None], 1000.0)
    >>> print(f"{amplitude[0, 50]:.3f}")
    1.000
    """
    if resolution is not None and not 0 < resolution <= sample_rate / 2:
        raise InputError(
            f"resolution ({resolution:g}) is the spacing of the lines: above 0 and at most half the sample rate "
            f"({sample_rate / 2:g})."
        )
    length = signal.shape[-1] if resolution is None else min(signal.shape[-1], round(sample_rate / resolution))
    frequency, power = scipy.signal.welch(signal, sample_rate, "hann", nperseg=length, scaling="spectrum")
    return frequency, np.sqrt(2 * power)


_FLOOR_BINS = 8
"""The noise under a line is judged from at least so many readings of the spectrum that no line asked for reaches."""


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


def order_spectrum(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    shaft_frequency: float,
    orders: Int[np.ndarray, " order"],
    *,
    jitter: float = 0.006,
    segments: int = 4,
) -> OrderSpectrum:
    """Amplitudes at `orders`, each gathered over the band in which a jittering speed smears it.

    The power within the band, less the noise floor beside it, is that of one sine. A smear of `jitter` (relative) is
    expected; the band never reaches half way to the next order asked for, and the floor is read off between the bands.
    Lines that are in the signal but not asked for count as noise where they fall there.

    Parameters
    ----------
    signal : at least `segments` x 4 revolutions.
    jitter : half-width of the speed's variation, relative.
    segments : the scatter of the amplitudes between so many parts of the signal gives `deviation`.

    Raises
    ------
    InputError
        The signal is too short, or an order lies below 1 or above half the sample rate.
    """
    length = signal.shape[-1] // segments
    if length / sample_rate * shaft_frequency < 4:
        raise InputError(
            f"the signal covers {signal.shape[-1] / sample_rate * shaft_frequency:.1f} revolutions; its orders need at "
            f"least {4 * segments}."
        )
    if orders.min() < 1:
        raise InputError(f"order {orders.min()} has no amplitude: lines begin at order 1.")
    if orders.max() * shaft_frequency * (1 + jitter) > sample_rate / 2:
        raise InputError(
            f"order {orders.max()} lies at {orders.max() * shaft_frequency:.0f} Hz, above half the sample rate "
            f"({sample_rate / 2:.0f} Hz)."
        )
    parts = signal[:, : segments * length].reshape(signal.shape[0], segments, length)
    frequency, density = scipy.signal.periodogram(parts, sample_rate, "hann", detrend="constant")
    line_width = frequency[1]
    centers = orders * shaft_frequency
    spacing = float(np.min(np.diff(np.unique(np.concatenate([[0], centers])))))
    halves = np.minimum(2.5 * line_width + jitter * centers, 0.45 * spacing)
    free = np.arange(len(frequency)) > 1  # the mean that was taken away leaves a hole in the first two
    for center, half in zip(centers, halves, strict=True):
        free &= np.abs(frequency - center) > half
    power = np.empty((signal.shape[0], segments, len(orders)))
    floor = np.empty_like(power)
    for i, (center, half) in enumerate(zip(centers, halves, strict=True)):
        distance = np.abs(frequency - center)
        inside = distance <= half
        beside = free & (distance <= max(2 * half, half + 6 * line_width))
        if beside.sum() < _FLOOR_BINS:
            beside = free & (distance <= np.sort(distance[free])[:_FLOOR_BINS].max(initial=0))
        level = np.median(density[..., beside], axis=-1) / math.log(2)  # a periodogram's median is ln 2 of its mean
        floor[..., i] = level * inside.sum() * line_width
        power[..., i] = density[..., inside].sum(axis=-1) * line_width - floor[..., i]
    mean_power = power.mean(axis=1)
    amplitude = np.sqrt(2 * np.clip(mean_power, 0, None))
    noise = floor.mean(axis=1)
    spread = power.std(axis=1, ddof=1) / math.sqrt(segments)
    power_deviation = np.sqrt(spread**2 + (noise**2) / (4 * segments))
    deviation = power_deviation / np.maximum(amplitude, np.sqrt(np.maximum(power_deviation, 1e-300)))
    return OrderSpectrum(np.asarray(orders), shaft_frequency, amplitude, deviation)


def synchronous_signal(
    lines: Complex[np.ndarray, "channel line"], orders: Int[np.ndarray, " line"], angle: Float[np.ndarray, " time"]
) -> Float[np.ndarray, "channel time"]:
    """Signal Re sum_k lines_k exp(i k angle) along a shaft angle [rad], which may advance unevenly.

    One revolution is tabulated on a grid of at least 32 points per shortest period and read off by interpolation; its
    error is below 0.5 % of the sum of the lines' magnitudes.
    """
    n_grid = 1 << max(12, math.ceil(math.log2(32 * (int(orders.max()) + 1))))
    spectrum = np.zeros((lines.shape[0], n_grid // 2 + 1), dtype=complex)
    spectrum[:, orders] = lines * (n_grid / 2)
    spectrum[:, 0] *= 2
    revolution = np.fft.irfft(spectrum, n_grid, axis=-1)
    position = np.mod(angle, 2 * np.pi) * (n_grid / (2 * np.pi))
    left = position.astype(np.int64) % n_grid
    weight = position - np.floor(position)
    return revolution[:, left] * (1 - weight) + revolution[:, (left + 1) % n_grid] * weight


def add_noise(
    signal: Float[np.ndarray, "channel time"], snr_db: float, seed: int, *purpose: object
) -> Float[np.ndarray, "channel time"]:
    """Signal with white Gaussian noise of a stated signal-to-noise ratio [dB] added.

    The signal's power is its variance over the whole of `signal`, per channel (docs/protocol.md, "Noise").

    Parameters
    ----------
    purpose : names the random stream, usually the recording's id and the repeat.
    """
    power = signal.var(axis=-1, keepdims=True)
    scale = np.sqrt(power * 10 ** (-snr_db / 10))
    return signal + scale * stream(seed, "noise", float(snr_db), *purpose).standard_normal(signal.shape)


def band_limited(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, low: float, high: float
) -> Float[np.ndarray, "channel time"]:
    """Signal between `low` and `high` [Hz], zero-phase Butterworth of order 4 in each direction.

    Raises
    ------
    InputError
        No band: `low` must be positive, below `high`, and below half the sample rate.
    """
    nyquist = sample_rate / 2
    if not 0 < low < min(high, nyquist):
        raise InputError(f"a band of {low:g}...{high:g} Hz is none at {sample_rate:g} Hz; it needs 0 < low < high.")
    if high >= 0.98 * nyquist:
        sos = scipy.signal.butter(4, low / nyquist, "highpass", output="sos")
    else:
        sos = scipy.signal.butter(4, [low / nyquist, high / nyquist], "bandpass", output="sos")
    return scipy.signal.sosfiltfilt(sos, signal, axis=-1)


def aligned(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel longer"]
) -> Float[np.ndarray, "channel time"]:
    """Stretch of `simulated`, as long as `measured`, that correlates best with it over all channels together.

    With `simulated` one period longer than `measured`, every phase is tried.

    Raises
    ------
    InputError
        `simulated` is the shorter one.
    """
    length = measured.shape[-1]
    if simulated.shape[-1] < length:
        raise InputError(f"{simulated.shape[-1]} simulated readings are fewer than the {length} measured ones.")
    score = sum(scipy.signal.correlate(s, m, "valid") for s, m in zip(simulated, measured, strict=True))
    start = int(np.argmax(score))
    return simulated[:, start : start + length]


def waveform_rmse(measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]) -> float:
    """Root mean square of the difference, in the signals' unit (the paper's RMSE)."""
    return float(np.sqrt(np.mean((measured - simulated) ** 2)))


def peak_error(measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]) -> float:
    """Mean over channels of the difference of the largest magnitudes, relative to the measured (the paper's PE)."""
    peaks = np.abs(measured).max(axis=-1)
    return float(np.mean(np.abs(np.abs(simulated).max(axis=-1) - peaks) / peaks))


def spectrum_value_error(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Sum of the amplitudes' differences over the sum of the measured amplitudes (the paper's SVE; our reading)."""
    return float(np.abs(measured - simulated).sum() / measured.sum())


LEVEL_RANGE = 60.0
"""Lines further [dB] below the strongest measured one count as if they were so far below it: there is only noise."""


def spectral_correlation(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Pearson's correlation of the levels in dB, over all channels and orders; 1 is a spectrum of the same shape.

    A level is 20 log10 of the amplitude, no lower than 60 dB below the strongest measured line (`LEVEL_RANGE`), the
    same floor for both sides. A common gain does not change it. It is 0 where the levels of one side are all equal.

    Examples
    --------
    >>> measured = np.array([[1.0, 0.1, 0.5]])
    >>> round(spectral_correlation(measured, 2 * measured), 3)
    1.0
    """
    floor = max(float(measured.max()) * 10 ** (-LEVEL_RANGE / 20), 1e-300)
    first, second = (20 * np.log10(np.maximum(side, floor)).ravel() for side in (measured, simulated))
    first, second = first - first.mean(), second - second.mean()
    width = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / width if width > 0 else 0.0


def band_shares(n_lines: int, n_bands: int) -> Float[np.ndarray, "line band"]:
    """Share of each line of a spectrum in each of `n_bands` bands of equal ratio.

    The bands reach from half the first line to half a line after the last; a line that a band's edge cuts is shared in
    proportion, so that the lowest bands, narrower than a line, are never empty.
    """
    line = np.arange(1, n_lines + 1)
    edges = np.geomspace(0.5, n_lines + 0.5, n_bands + 1)
    upper, lower = np.minimum(edges[1:, None], line + 0.5), np.maximum(edges[:-1, None], line - 0.5)
    return np.maximum(upper - lower, 0).T
