"""Vibration features and levels of windows: what an analyst would compute before any network."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import (
    TIME_STATISTICS,
    band_shares,
    hann_taper,
    signal_envelope,
    tapered_transform,
    time_statistics,
)

_LEAST_SHIFT, _ALIKE = 3.0, 0.25
"""A channel as a whole moved where the median change of its bands is at least so many dB, and the
bands differ from it by so little, relative to it, in the median.
"""


def line_powers(signal: Float[np.ndarray, "*batch time"]) -> Float[np.ndarray, "*batch line"]:
    """Mean square of each line of the spectrum but the first, mean removed, Hann taper; of the
    signal's precision.
    """
    length = signal.shape[-1]
    spectrum = tapered_transform(signal)[..., 1:]
    power = spectrum.real**2 + spectrum.imag**2
    power *= power.dtype.type(2 / (length * np.sum(hann_taper(length) ** 2)))
    return np.asarray(power)


def running_sums(power: Float[np.ndarray, "*batch line"]) -> Float64[np.ndarray, "*batch edge"]:
    """Power of all lines before each edge between two lines."""
    sums = np.zeros((*power.shape[:-1], power.shape[-1] + 1))
    sums[..., 1:] = power  # summed in place: to convert while summing takes twice as long
    return np.cumsum(sums, axis=-1, out=sums)


def up_to(
    sums: Float64[np.ndarray, "*batch edge"], edge: Float[np.ndarray, "*row place"]
) -> Float64[np.ndarray, "*batch place"]:
    """Power below edges, in lines; a line that an edge cuts counts by its share.

    Parameters
    ----------
    sums : `running_sums` of the lines 1, 2, ...
    edge : the same for all rows of `sums`, or with an axis for each of theirs.

    Examples
    --------
    >>> up_to(running_sums(np.array([1.0, 2.0, 3.0])), np.array([0.5, 2.0, 9.0])).tolist()
    [0.0, 2.0, 6.0]
    """
    position = np.clip(edge - 0.5, 0, sums.shape[-1] - 1)
    line = np.minimum(position.astype(np.int64), sums.shape[-1] - 2)
    left, right = (
        sums[..., at] if edge.ndim == 1 else np.take_along_axis(sums, at, -1)
        for at in (line, line + 1)
    )
    return np.asarray(left + (position - line) * (right - left))


def between(
    sums: Float64[np.ndarray, "*batch edge"],
    low: Float[np.ndarray, " band"],
    high: Float[np.ndarray, " band"],
) -> Float64[np.ndarray, "*batch band"]:
    """Power between two edges, in lines (`up_to`)."""
    return up_to(sums, high) - up_to(sums, low)


def common_shift(change: Float[np.ndarray, "*channel band"]) -> Float[np.ndarray, "*channel"]:
    """Change [dB] of a channel whose bands nearly all moved alike, as a gain moves them; else 0."""
    shift = np.median(change, axis=-1)
    rest = np.median(np.abs(change - shift[..., None]), axis=-1)
    return np.where((np.abs(shift) >= _LEAST_SHIFT) & (rest <= _ALIKE * np.abs(shift)), shift, 0.0)


N_BANDS = 32
"""Logarithmic bands per spectrum."""

_N_SHAPE, _N_LINES, _LINE_SHARE, _N_LEVEL_BANDS = 5, 72, 0.08, 48

ENVELOPE_STATISTICS = ("mean", "deviation", "rms", "skewness", "kurtosis", "crest_factor")
"""Those of the envelope |x - m + i H(x - m)|, H being the Hilbert transform over the window."""
OF_ENVELOPE = [TIME_STATISTICS.index(name) for name in ENVELOPE_STATISTICS]


def feature_values(
    signal: Float[np.ndarray, "window channel time"],
) -> Float64[np.ndarray, "window feature"]:
    """Vibration features of each window, channel after channel: 82 each, named by `feature_names`.

    12 statistics of the time signal, the energies of 32 logarithmic frequency bands, 6 statistics
    of the envelope, and the energies of 32 logarithmic bands of the envelope's spectrum.
    """
    parts = []
    for samples in signal.transpose(1, 0, 2).astype(np.float64):
        envelope = signal_envelope(samples - samples.mean(axis=1, keepdims=True))
        parts += [
            time_statistics(samples),
            band_energies(samples),
            time_statistics(envelope)[:, OF_ENVELOPE],
            band_energies(envelope),
        ]
    return np.concatenate(parts, axis=1)


def feature_names(channels: Sequence[str]) -> tuple[str, ...]:
    """Name of each column of `feature_values`."""
    names = [f"time {name}" for name in TIME_STATISTICS]
    names += [f"spectrum band {band}" for band in range(N_BANDS)]
    names += [f"envelope {name}" for name in ENVELOPE_STATISTICS]
    names += [f"envelope spectrum band {band}" for band in range(N_BANDS)]
    return tuple(f"{channel} {name}" for channel in channels for name in names)


def window_powers(windows: WindowSet) -> list[Float64[np.ndarray, "window line"]]:
    """`line_powers` of each window, channel by channel."""
    return [
        line_powers(windows.signal[:, index].astype(np.float64))
        for index in range(windows.n_channels)
    ]


def reference_features(
    windows: WindowSet, powers: Sequence[Float64[np.ndarray, "window line"]] | None = None
) -> Float64[np.ndarray, "window feature"]:
    """Levels of each window, channel after channel, by which `TrainingReference` tells what is like
    the training.

    Per channel: the logarithm of the deviation, four numbers of the waveform's shape that no gain
    changes, log10 of the mean power in up to 72 equal bands of the lowest twelfth of the spectrum,
    and `band_energies` in 48 bands. All are decades or shares, so that none needs a scale. `powers`
    are `window_powers`, where they are at hand.
    """
    parts = []
    powers = window_powers(windows) if powers is None else powers
    for index in range(windows.n_channels):
        moving = windows.signal[:, index].astype(np.float64)
        moving -= moving.mean(axis=1, keepdims=True)
        square = moving * moving
        pairs = (
            (moving, moving),
            (square, moving),
            (square, square),
        )  # products, for a power takes ten times as long
        second, third, fourth = (np.einsum("wt,wt->w", *pair) / windows.length for pair in pairs)
        deviation = np.maximum(np.sqrt(second), 1e-15)
        peak, magnitude = (
            np.maximum(moving.max(axis=1), -moving.min(axis=1)),
            np.abs(moving).mean(axis=1),
        )
        shape = (
            np.log10(deviation),
            third / deviation**3,
            np.log10(np.maximum(fourth / deviation**4, 1e-3)),
            np.log10(np.maximum(peak / deviation, 1e-3)),
            magnitude / deviation,
        )
        lowest = powers[index][:, : max(1, round(_LINE_SHARE * powers[index].shape[1]))]
        edges = np.linspace(
            0, lowest.shape[1], min(_N_LINES, lowest.shape[1]), endpoint=False
        ).astype(np.int64)
        mean = np.add.reduceat(lowest, edges, axis=1) / np.diff([*edges, lowest.shape[1]])
        parts += [
            np.column_stack(shape),
            np.log10(np.maximum(mean, 1e-30)),
            log_band_powers(powers[index], _N_LEVEL_BANDS),
        ]
    return np.concatenate(parts, axis=1)


def reference_spectrum(
    features: Float[np.ndarray, "row feature"], n_channels: int, length: int, sample_rate: float
) -> tuple[
    Float64[np.ndarray, " band"],
    Float64[np.ndarray, " band"],
    Float64[np.ndarray, "row channel band"],
]:
    """(lower, upper edges [Hz], power densities [dB re 1 unit^2/Hz]) that `reference_features` or their
    means hold.

    The narrow bands of the lowest twelfth of the spectrum, then the logarithmic bands above them.
    """
    n_lines, spacing = length // 2, sample_rate / length
    lowest = max(1, round(_LINE_SHARE * n_lines))
    starts = np.linspace(0, lowest, min(_N_LINES, lowest), endpoint=False).astype(np.int64)
    narrow = (np.append(starts, lowest) + 0.5) * spacing
    wide = np.geomspace(0.5, n_lines + 0.5, _N_LEVEL_BANDS + 1) * spacing
    above = wide[:-1] >= narrow[-1] * (1 - 1e-9)
    rows = features.reshape(len(features), n_channels, -1)
    lines = 10 * rows[:, :, _N_SHAPE : _N_SHAPE + len(starts)] - 10 * np.log10(spacing)
    bands = 10 * rows[:, :, -_N_LEVEL_BANDS:] - 10 * np.log10(np.diff(wide))
    low = np.concatenate([narrow[:-1], wide[:-1][above]])
    high = np.concatenate([narrow[1:], wide[1:][above]])
    return low, high, np.concatenate([lines, bands[:, :, above]], axis=2)


def band_energies(
    signal: Float[np.ndarray, "window time"], n_bands: int = N_BANDS
) -> Float64[np.ndarray, "window band"]:
    """log10 of the mean square in each of the `band_shares`, mean removed, Hann taper [log10 of the
    unit squared].
    """
    return log_band_powers(line_powers(signal), n_bands)


def log_band_powers(
    power: Float64[np.ndarray, "window line"], n_bands: int
) -> Float64[np.ndarray, "window band"]:
    """`band_energies` from the powers of `line_powers`."""
    return np.log10(np.maximum(power @ band_shares(power.shape[1], n_bands), 1e-30))
