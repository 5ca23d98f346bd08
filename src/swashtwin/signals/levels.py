"""Statistics of time signals, and levels in a band of frequencies: of acceleration and, by integration, of velocity.

Levels are root mean squares from the one-sided power density (Welch, Hann taper, half-overlapping segments of 2 s, mean
removed), the taper's noise bandwidth corrected: a sine of amplitude 1 reads 0.7071 in any band that holds it. A
spectral line that a band's edge cuts is shared in proportion.
"""

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.foundation import InputError
from swashtwin.recordings import Recording
from swashtwin.signals.spectra import power_density

TIME_STATISTICS = (
    "mean",
    "deviation",
    "rms",
    "peak",
    "peak_to_peak",
    "mean_absolute",
    "skewness",
    "kurtosis",
    "crest_factor",
    "shape_factor",
    "impulse_factor",
    "clearance_factor",
)
"""Of x: mean, √(mean (x-m)²), √(mean x²), max|x|, max - min, mean|x|, third and fourth standardized moment, peak / rms,
rms / mean|x|, peak / mean|x|, peak / (mean √|x|)². The first six in the signal's unit, the others without one."""


def time_statistics(signal: Float[np.ndarray, "window time"]) -> Float64[np.ndarray, "window statistic"]:
    """The `TIME_STATISTICS` of each window; a ratio with a zero below it is 0."""
    mean = signal.mean(axis=1)
    deviation = signal.std(axis=1)
    magnitude = np.abs(signal)
    rms, peak, mean_absolute = np.sqrt((signal**2).mean(axis=1)), magnitude.max(axis=1), magnitude.mean(axis=1)
    standard = (signal - mean[:, None]) / np.where(deviation > 0, deviation, 1.0)[:, None]
    square = standard * standard  # a power of floats takes ten times as long as its products
    columns = (
        mean,
        deviation,
        rms,
        peak,
        np.ptp(signal, axis=1),
        mean_absolute,
        (square * standard).mean(axis=1),
        (square * square).mean(axis=1),
        _ratio(peak, rms),
        _ratio(rms, mean_absolute),
        _ratio(peak, mean_absolute),
        _ratio(peak, np.sqrt(magnitude).mean(axis=1) ** 2),
    )
    return np.stack(columns, axis=1)


def _ratio(
    above: Float64[np.ndarray, " window"], below: Float64[np.ndarray, " window"]
) -> Float64[np.ndarray, " window"]:
    return np.where(below > 0, above / np.where(below > 0, below, 1.0), 0.0)


def shape_statistics(recording: Recording) -> dict[str, Float64[np.ndarray, " channel"]]:
    """Level, peaks and shape of each channel without its mean, as of `TIME_STATISTICS`, by name; read in blocks."""
    mean = sum(block.signal.sum(axis=1) for block in recording.blocks()) / recording.n_samples
    sums, largest = np.zeros((3, recording.n_channels)), np.zeros(recording.n_channels)
    for block in recording.blocks():
        centered = block.signal - mean[:, None]
        square = centered * centered
        third, fourth = np.einsum("ct,ct->c", square, centered), np.einsum("ct,ct->c", square, square)
        sums += [square.sum(axis=1), third, fourth]
        largest = np.maximum(largest, square.max(axis=1))
    second, third, fourth = sums / recording.n_samples
    rms, peak = np.sqrt(second), np.sqrt(largest)
    return {
        "rms": rms, "peak": peak, "crest_factor": _ratio(peak, rms), "kurtosis": _ratio(fourth, second**2),
        "skewness": _ratio(third, rms**3),
    }  # fmt: skip


SEGMENT = 2.0
"""Length of the segments [s], so that lines lie 0.5 Hz apart; the whole signal where it is shorter."""


Spectrum = tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]


def segment_length(n_samples: int, sample_rate: float) -> int:
    """Samples of the segments whose `power_density` the levels are read from."""
    return min(n_samples, round(SEGMENT * sample_rate))


def band_rms(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    low: float,
    high: float,
    *,
    of_velocity: bool = False,
    spectrum: Spectrum | None = None,
) -> Float[np.ndarray, " channel"]:
    """Root mean square between `low` and `high` [Hz], in the signal's unit; its square is the band's energy.

    No zone of ISO 20816 applies to piston pumps; compare with the machine's own baseline (`signals.trend_of`).

    Parameters
    ----------
    of_velocity : of the velocity [m/s] where the signal is an acceleration [m/s^2]: the power density is divided by the
        angular frequency squared, which needs no start value and lets no offset drift. Vibration severity of machines
        is commonly stated from 10 to 1000 Hz.
    spectrum : `power_density` of the signal in segments of `segment_length`, where it is at hand.

    Raises
    ------
    InputError
        No band, one that reaches above half the sample rate or is narrower than a spectral line, or, of a velocity, one
        below which the recording holds no full period.

    Examples
    --------
    >>> time = np.arange(4000) / 1000
    >>> print(band_rms(np.sin(2 * np.pi * 50 * time)[None], 1000.0, 10, 100).round(4))
    [0.7071]
    """
    n_samples = signal.shape[-1]
    if not 0 <= low < high <= sample_rate / 2:
        raise InputError(
            f"a band of {low:g} to {high:g} Hz is none at {sample_rate:g} Hz; it lies in 0 to {sample_rate / 2:g} Hz."
        )
    length = segment_length(n_samples, sample_rate)
    width = sample_rate / length
    if high - low < width or (of_velocity and low < 2 * width):
        raise InputError(
            f"{n_samples / sample_rate:.3g} s resolve {width:.3g} Hz, too little for {low:g} to {high:g} Hz; record "
            "longer."
        )
    frequency, density = power_density(signal, sample_rate, length) if spectrum is None else spectrum
    share = np.clip(np.minimum(frequency + width / 2, high) - np.maximum(frequency - width / 2, low), 0, None)
    if of_velocity:
        share[1:] /= (2 * np.pi * frequency[1:]) ** 2  # the first line is below the band
    return np.sqrt(density @ share)
