"""Features for rolling bearings and motors: how far lines stand above the floor around them.

A flaw in a rolling bearing rings the housing each time it is struck. What the housing and the
sensor make of that differs from machine to machine, but it changes a line and the floor around it
alike. So each feature here is a *prominence*: log10 of a power less its mean over the neighboring
lines. Lines are of the signal and of the squared envelopes of wide bands, at orders of the shaft
(Randall and Antoni 2011, doi:10.1016/j.ymssp.2010.07.017).
"""

from functools import lru_cache
from itertools import pairwise

import numpy as np
import scipy
from jaxtyping import Bool, Complex64, Float, Float32, Float64, Int64

from swashtwin.signals import (
    BandPower,
    band_shares,
    hann_taper,
    logarithmic_edges,
    power_below,
    running_sums,
    transform,
)

LINE_SPACING = 0.05
"""Distance of neighboring lines [orders]: twenty turns of the shaft resolve it."""
N_LINES = 320
"""Lines, up to order 16: the first three harmonics of the defects of most bearings."""
FLOOR_HALF_WIDTH = 10
"""Lines on either side whose mean is the floor of a line: half an order."""
LINES_PER_CELL = 5
"""Lines of which the most prominent one is a feature: a quarter of an order."""
N_CELLS = N_LINES // LINES_PER_CELL
"""Features of each spectrum."""
ENVELOPE_BANDS = ((1 / 16, 1 / 4), (1 / 8, 1 / 2), (1 / 4, 1.0))
"""Edges of the bands whose envelopes are taken [half the sample rate]: two octaves each."""
N_SHAPE_BANDS = 24
"""Logarithmic bands that describe the shape of the spectrum."""
LINES_PER_UNIT = 20
"""Spectral lines that take the place of one order if the speed is not known."""
FLOOR = 1e-7
"""Added to each mean power before its logarithm; that of all lines together is about 1."""
MIN_DEVIATION = 1e-6
"""Smallest deviation of a channel that is divided by, in the scaled unit."""

FUNDAMENTALS = np.geomspace(2.0, 8.0, 57)
"""Orders that are tried as the rate of a defect: those of bearings with 5 to 14 bodies."""
MIN_DISTANCE_FROM_SHAFT = 0.06
"""Distance from a whole order [orders] below which a line is one of the shaft."""
N_HARMONICS = 4
"""Harmonics of a comb."""
SIDEBAND_SPACINGS = (1.0, 0.4)
"""Distance of the side bands [orders]: a flaw on the inner race passes the load once in a turn of
the shaft, a flaw on a rolling body once in a turn of the cage, which takes 2.5 of the shaft.
"""
N_SIGNATURE = 2 + len(SIDEBAND_SPACINGS)
"""Numbers of `_comb_signature`."""


def n_features(uses_orders: bool) -> int:
    """Return the number of features of a channel."""
    n_spectra = 1 + len(ENVELOPE_BANDS)
    n_signature = N_SIGNATURE * len(ENVELOPE_BANDS) if uses_orders else 0
    return N_SHAPE_BANDS + n_spectra * N_CELLS + n_signature


@lru_cache(maxsize=4)
def prominent_bands(length: int, uses_orders: bool) -> tuple[BandPower, ...]:
    """Return what each feature of a channel is of, in the order of `line_prominences`.

    Edges are in orders, or in periods per sample for windows of `length` samples.
    """
    edges = (np.arange(N_CELLS + 1) * LINES_PER_CELL + 0.5) * LINE_SPACING
    if not uses_orders:
        edges = edges * LINES_PER_UNIT / length

    spectra = []
    for is_envelope in (False, True):
        cells = []
        for low, high in pairwise(edges.tolist()):
            order = round((low + high) / 2) if uses_orders else None
            cells.append(BandPower("", is_envelope, order, low, high))
        spectra.append(cells)

    shape_edges = (logarithmic_edges(length // 2, N_SHAPE_BANDS) / length).tolist()
    shape = [BandPower("", False, None, low, high) for low, high in pairwise(shape_edges)]

    signal, envelope = spectra
    if uses_orders:
        envelope += [BandPower("", True, None, 0.0, 0.5, "shape")] * N_SIGNATURE
    return (*shape, *signal, *envelope * len(ENVELOPE_BANDS))


def line_prominences(
    windows: Float32[np.ndarray, "window channel time"], turns: Float[np.ndarray, " window"] | None
) -> Float32[np.ndarray, "window channel feature"]:
    """Return the features of each channel [decades].

    The power in logarithmic bands less its mean over them; of the signal and of each squared
    envelope, the most prominent line in each quarter of an order; and of each envelope the comb of
    lines that stands out most (`_comb_signature`).

    Parameters
    ----------
    turns : turns of the shaft per sample in each window; None takes a fixed number of spectral
        lines for an order, and leaves out the combs.
    """
    length = windows.shape[-1]
    x = windows - windows.mean(axis=-1, keepdims=True)
    mean_square = np.einsum("wct,wct->wc", x, x)[..., None] / np.float32(length)
    x /= np.maximum(np.sqrt(mean_square), np.float32(MIN_DEVIATION))

    if turns is None:
        lines_per_order = np.full(len(windows), float(LINES_PER_UNIT))
    else:
        lines_per_order = turns * length

    power = _line_powers(x)
    parts = [_band_shape(power), _most_prominent(_prominences(power, lines_per_order))]
    spectrum = transform(x)
    for low, high in ENVELOPE_BANDS:
        envelope = _squared_envelope(spectrum, low, high)
        prominences = _prominences(_line_powers(envelope), lines_per_order)
        parts.append(_most_prominent(prominences))
        if turns is not None:
            parts.append(_comb_signature(prominences))
    return np.concatenate(parts, axis=-1, dtype=np.float32)


def _squared_envelope(
    spectrum: Complex64[np.ndarray, "window channel line"], low: float, high: float
) -> Float32[np.ndarray, "window channel time"]:
    """Return the squared envelope of a band over its mean, less 1.

    It has two samples for each spectral line of the band, since its bandwidth is that of the band.

    Parameters
    ----------
    low, high : edges of the band [half the sample rate].
    """
    first, end, count = envelope_lines(spectrum.shape[-1] - 1, low, high)
    analytic = scipy.fft.ifft(spectrum[..., first:end], count, axis=-1)
    square = analytic.real**2 + analytic.imag**2
    mean = np.maximum(square.mean(axis=-1, keepdims=True), np.float32(1e-30))
    return square / mean - np.float32(1)


def envelope_lines(last_line: int, low: float, high: float) -> tuple[int, int, int]:
    """Return the first spectral line of a band, that after its last, and the envelope's samples."""
    first = max(1, int(low * last_line))
    end = max(first + 1, int(high * last_line))
    return first, end, scipy.fft.next_fast_len(2 * (end - first))


def _line_powers(
    x: Float32[np.ndarray, "window channel time"],
) -> Float32[np.ndarray, "window channel spectral_line"]:
    """Return the power of each spectral line above the mean, of the signal with a Hann taper."""
    lines = transform(x * hann_taper(x.shape[-1]).astype(np.float32))[..., 1:]
    return np.asarray((lines.real**2 + lines.imag**2) / np.float32(x.shape[-1]))


def _band_shape(
    power: Float32[np.ndarray, "window channel spectral_line"],
) -> Float32[np.ndarray, "window channel band"]:
    """Return log10 of the power in each logarithmic band less the mean over the bands."""
    shares = band_shares(power.shape[-1], N_SHAPE_BANDS).astype(np.float32)
    bands = np.log10(power @ shares + np.float32(FLOOR))
    return np.asarray(bands - bands.mean(axis=-1, keepdims=True))


def _prominences(
    power: Float32[np.ndarray, "window channel spectral_line"],
    lines_per_order: Float[np.ndarray, " window"],
) -> Float64[np.ndarray, "window channel line"]:
    """Return log10 of the power of each line less the mean over its neighbors.

    A line beyond the spectrum has the power of the last one within it.
    """
    edges = (np.arange(N_LINES + 1) + 0.5) * LINE_SPACING * lines_per_order[:, None]
    width = LINE_SPACING * lines_per_order[:, None, None]
    last_edge = power.shape[-1] + 0.5
    # A line that the end of the spectrum cuts moves inwards, and stays as wide.
    low = np.clip(edges[:, None, :-1], 0.5, last_edge - width)
    high = low + width
    sums = running_sums(power)
    mean_power = (power_below(sums, high) - power_below(sums, low)) / width
    logarithm = np.log10(mean_power + FLOOR)

    return np.asarray(logarithm - logarithm @ neighbor_weights())


@lru_cache(maxsize=1)
def neighbor_weights() -> Float64[np.ndarray, "line floor"]:
    """Return the weight of each line in the floor of each line; read only.

    At either end the last line stands for those beyond.
    """
    weights = np.zeros((N_LINES, N_LINES))
    line = np.arange(N_LINES)
    for offset in range(-FLOOR_HALF_WIDTH, FLOOR_HALF_WIDTH + 1):
        neighbor = np.clip(line + offset, 0, N_LINES - 1)
        weights[neighbor, line] += 1 / (2 * FLOOR_HALF_WIDTH + 1)

    weights.setflags(write=False)
    return weights


def _most_prominent(
    prominences: Float64[np.ndarray, "window channel line"],
) -> Float64[np.ndarray, "window channel cell"]:
    """Return the most prominent line of each cell."""
    shape = (*prominences.shape[:-1], N_CELLS, LINES_PER_CELL)
    return np.asarray(prominences.reshape(shape).max(axis=-1))


def _comb_signature(
    prominences: Float64[np.ndarray, "window channel line"],
) -> Float64[np.ndarray, "window channel number"]:
    """Return how far the most prominent comb, its side bands, and the shaft's lines stand out.

    The comb is that of the fundamental in `FUNDAMENTALS` whose harmonics have the highest mean
    prominence, lines of the shaft excluded. Side bands are means over the first three harmonics, at
    `SIDEBAND_SPACINGS` from these.
    """
    teeth = prominences_at(prominences, np.outer(FUNDAMENTALS, np.arange(1.0, N_HARMONICS + 1)))
    combs = np.where(is_of_shaft(), -np.inf, teeth.mean(axis=-1))
    best = combs.argmax(axis=-1)

    columns = [combs.max(axis=-1)]
    for spacing in SIDEBAND_SPACINGS:
        by_fundamental = prominences_at(prominences, sideband_orders(spacing)).mean(axis=-1)
        columns.append(np.take_along_axis(by_fundamental, best[..., None], axis=-1)[..., 0])
    columns.append(prominences_at(prominences, np.arange(1.0, N_HARMONICS + 1)).mean(axis=-1))
    return np.stack(columns, axis=-1)


def is_of_shaft() -> Bool[np.ndarray, " fundamental"]:
    """Return whether each of `FUNDAMENTALS` is too near to a line of the shaft."""
    distance = np.abs(FUNDAMENTALS - np.rint(FUNDAMENTALS))
    return np.asarray(distance < MIN_DISTANCE_FROM_SHAFT)


def sideband_orders(spacing: float) -> Float64[np.ndarray, "fundamental sideband"]:
    """Return the orders of the side bands of the first three harmonics of each fundamental."""
    harmonics = FUNDAMENTALS[:, None] * np.arange(1, N_HARMONICS)
    return np.concatenate([harmonics - spacing, harmonics + spacing], axis=-1)


def prominences_at(
    prominences: Float64[np.ndarray, "window channel line"], order: Float[np.ndarray, "*position"]
) -> Float64[np.ndarray, "window channel *position"]:
    """Return the highest prominence within one line of each order; 0 beyond the last line."""
    inner, is_covered = nearest_lines(order)
    near = [prominences[..., inner + offset] for offset in (-1, 0, 1)]
    return np.maximum.reduce(near) * is_covered


def nearest_lines(
    order: Float[np.ndarray, "*position"],
) -> tuple[Int64[np.ndarray, "*position"], Bool[np.ndarray, "*position"]]:
    """Return the line nearest to each order, and whether it has a line on either side.

    Lines without are moved to the nearest one that has.
    """
    index = np.rint(order / LINE_SPACING).astype(np.int64) - 1
    inner = np.clip(index, 1, N_LINES - 2)
    return inner, index == inner
