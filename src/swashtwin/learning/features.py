"""Vibration features of windows, as an analyst would compute them before any network."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64, Int64

from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import (
    MIN_POWER,
    TIME_STATISTICS,
    line_powers,
    log_band_powers,
    logarithmic_edges,
    signal_envelope,
    time_statistics,
)

MIN_SHIFT_DB = 3.0
"""Median change of a channel's bands from which the channel may have moved as a whole [dB]."""
MAX_SHIFT_SCATTER = 0.25
"""Median deviation of the bands from that change, relative to it, up to which it is a gain."""


def common_shift(change: Float[np.ndarray, "*channel band"]) -> Float[np.ndarray, "*channel"]:
    """Return the change [dB] of a channel whose bands changed alike, as by a gain; else 0."""
    shift = np.median(change, axis=-1)
    scatter = np.median(np.abs(change - shift[..., None]), axis=-1)
    magnitude = np.abs(shift)
    is_gain = (magnitude >= MIN_SHIFT_DB) & (scatter <= MAX_SHIFT_SCATTER * magnitude)
    return np.where(is_gain, shift, 0.0)


N_BANDS = 32
"""Logarithmic bands per spectrum of `feature_values`."""
ENVELOPE_STATISTICS = ("mean", "deviation", "rms", "skewness", "kurtosis", "crest_factor")
"""Those of the envelope |x - m + i H(x - m)|, H being the Hilbert transform over the window."""
_ENVELOPE_COLUMNS = [TIME_STATISTICS.index(name) for name in ENVELOPE_STATISTICS]


def feature_values(
    signal: Float[np.ndarray, "window channel time"],
) -> Float64[np.ndarray, "window feature"]:
    """Return the vibration features of each window, channel after channel.

    82 for each channel, named by `feature_names`: 12 statistics of the time signal, the powers of
    32 logarithmic frequency bands, 6 statistics of the envelope, and the powers of 32 logarithmic
    bands of the envelope's spectrum.
    """
    columns = []
    for samples in signal.transpose(1, 0, 2).astype(np.float64):
        envelope = signal_envelope(samples - samples.mean(axis=1, keepdims=True))
        columns += [
            time_statistics(samples),
            band_energies(samples),
            time_statistics(envelope)[:, _ENVELOPE_COLUMNS],
            band_energies(envelope),
        ]
    return np.concatenate(columns, axis=1)


def feature_names(channels: Sequence[str]) -> tuple[str, ...]:
    """Return the name of each column of `feature_values`."""
    names = [f"time {name}" for name in TIME_STATISTICS]
    names += [f"spectrum band {band}" for band in range(N_BANDS)]
    names += [f"envelope {name}" for name in ENVELOPE_STATISTICS]
    names += [f"envelope spectrum band {band}" for band in range(N_BANDS)]
    return tuple(f"{channel} {name}" for channel in channels for name in names)


def band_energies(signal: Float[np.ndarray, "window time"]) -> Float64[np.ndarray, "window band"]:
    """Return log10 of the mean square in each of `N_BANDS` bands of equal ratio [unit squared].

    The mean is removed and a Hann taper applied.
    """
    return log_band_powers(line_powers(signal), N_BANDS)


N_SHAPE = 5
"""Numbers of the waveform in `reference_features`."""
N_NARROW = 72
"""Narrow bands of equal width in `reference_features`."""
NARROW_SHARE = 0.08
"""Share of the spectrum that the narrow bands cover, its lowest twelfth."""
N_WIDE = 48
"""Logarithmic bands in `reference_features`."""
MIN_DEVIATION = 1e-15
"""Smallest deviation that is divided by, for silent channels."""
MIN_MOMENT = 1e-3
"""Smallest ratio whose logarithm is taken: a silent channel has a kurtosis of 0."""


def window_powers(windows: WindowSet) -> list[Float64[np.ndarray, "window line"]]:
    """Return `line_powers` of each window, channel by channel."""
    return [
        line_powers(windows.signal[:, channel].astype(np.float64))
        for channel in range(windows.n_channels)
    ]


def reference_features(
    windows: WindowSet, powers: Sequence[Float64[np.ndarray, "window line"]] | None = None
) -> Float64[np.ndarray, "window feature"]:
    """Return the features by which `TrainingReference` compares windows with the training.

    Channel after channel: the logarithm of the deviation, four numbers of the waveform's shape that
    no gain changes, log10 of the mean power in up to 72 equal bands of the lowest twelfth of the
    spectrum, and `log_band_powers` in 48 bands. All are decades or ratios, so that none needs a
    scale.

    Parameters
    ----------
    powers : `window_powers`, if they are known already.
    """
    if powers is None:
        powers = window_powers(windows)

    columns = []
    for channel, power in enumerate(powers):
        samples = windows.signal[:, channel].astype(np.float64)
        columns += [
            _waveform_shape(samples),
            _narrow_log_powers(power),
            log_band_powers(power, N_WIDE),
        ]
    return np.concatenate(columns, axis=1)


def _waveform_shape(
    samples: Float64[np.ndarray, "window time"],
) -> Float64[np.ndarray, "window number"]:
    """Return log10 deviation, skewness, log10 kurtosis, log10 crest factor, mean over deviation."""
    moving = samples - samples.mean(axis=1, keepdims=True)
    # Products, because a power of an array takes ten times as long.
    square = moving * moving
    length = samples.shape[1]
    second = np.einsum("wt,wt->w", moving, moving) / length
    third = np.einsum("wt,wt->w", square, moving) / length
    fourth = np.einsum("wt,wt->w", square, square) / length

    deviation = np.maximum(np.sqrt(second), MIN_DEVIATION)
    peak = np.maximum(moving.max(axis=1), -moving.min(axis=1))
    return np.column_stack(
        (
            np.log10(deviation),
            third / deviation**3,
            np.log10(np.maximum(fourth / deviation**4, MIN_MOMENT)),
            np.log10(np.maximum(peak / deviation, MIN_MOMENT)),
            np.abs(moving).mean(axis=1) / deviation,
        )
    )


def _narrow_starts(n_lines: int) -> tuple[Int64[np.ndarray, " band"], int]:
    """Return the first line of each narrow band, and the line after the last."""
    n_covered = max(1, round(NARROW_SHARE * n_lines))
    n_bands = min(N_NARROW, n_covered)
    starts = np.linspace(0, n_covered, n_bands, endpoint=False).astype(np.int64)
    return starts, n_covered


def _narrow_log_powers(
    power: Float64[np.ndarray, "window line"],
) -> Float64[np.ndarray, "window band"]:
    """Return log10 of the mean power of the lines in each narrow band."""
    starts, n_covered = _narrow_starts(power.shape[1])
    sums = np.add.reduceat(power[:, :n_covered], starts, axis=1)
    mean = sums / np.diff([*starts, n_covered])
    return np.log10(np.maximum(mean, MIN_POWER))


def reference_spectrum(
    features: Float[np.ndarray, "row feature"], n_channels: int, length: int, sample_rate: float
) -> tuple[
    Float64[np.ndarray, " band"],
    Float64[np.ndarray, " band"],
    Float64[np.ndarray, "row channel band"],
]:
    """Return the spectrum that `reference_features`, or their means, hold.

    The narrow bands of the lowest twelfth, then the logarithmic bands above them: lower and upper
    edges [Hz], and power densities [dB re 1 unit^2/Hz].
    """
    n_lines = length // 2
    line_width = sample_rate / length
    starts, n_covered = _narrow_starts(n_lines)
    narrow_edges = (np.append(starts, n_covered) + 0.5) * line_width
    wide_edges = logarithmic_edges(n_lines, N_WIDE) * line_width
    # The tolerance keeps a band that begins at the end of the narrow ones, up to rounding.
    is_above = wide_edges[:-1] >= narrow_edges[-1] * (1 - 1e-9)

    rows = features.reshape(len(features), n_channels, -1)
    narrow_powers = rows[:, :, N_SHAPE : N_SHAPE + len(starts)]
    narrow_density = 10 * narrow_powers - 10 * np.log10(line_width)
    wide_density = 10 * rows[:, :, -N_WIDE:] - 10 * np.log10(np.diff(wide_edges))

    low = np.concatenate([narrow_edges[:-1], wide_edges[:-1][is_above]])
    high = np.concatenate([narrow_edges[1:], wide_edges[1:][is_above]])
    density = np.concatenate([narrow_density, wide_density[:, :, is_above]], axis=2)
    return low, high, density
