"""Orders and third octaves that evidence is summed in, of the signal and of its envelope."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning import WindowLevel
from swashtwin.signals import line_frequencies, signal_envelope, transform

ORDERS = 40
"""Orders of the shaft that stand one by one; higher ones, which a wandering speed smears, in third octaves."""


@dataclass(frozen=True)
class Band:
    """One order of the shaft, one third octave, or a whole channel."""

    name: str
    """Such as ``"order 7"``, ``"1.8-2.2 kHz"``, ``"envelope order 7"`` or ``"waveform shape"``."""
    low: float
    """Lower edge [Hz]."""
    high: float
    """Upper edge [Hz]."""
    order: int | None = None
    """Order of the shaft in its middle, or None for a third octave."""
    part: str = "signal"
    """What it is a band of: ``"signal"``, ``"envelope"``, or ``"whole"`` for what belongs to no band."""


def signal_bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """Orders as far as the samples resolve them, and third octaves above; they cover all frequencies, without gap."""
    nyquist, bands = sample_rate / 2, list[Band]()
    edge, resolution = max(sample_rate / n_samples, 1.0), sample_rate / n_samples
    if shaft is not None and resolution < shaft / 4 and 1.5 * shaft < nyquist:
        edge = 0.5 * shaft
        bands.append(Band("below order 0.5", 0.0, edge))
        for order in range(1, ORDERS + 1):
            if (order + 0.5) * shaft > nyquist:
                break
            edge = (order + 0.5) * shaft
            bands.append(Band(f"order {order}", (order - 0.5) * shaft, edge, order))
    else:
        bands.append(Band(f"below {hertz(edge)}", 0.0, edge))
    while edge < nyquist:
        above = min(edge * 2 ** (1 / 3), nyquist)
        if above * 2 ** (1 / 6) > nyquist:
            above = nyquist
        bands.append(Band(f"{hertz(edge)} to {hertz(above)}", edge, above))
        edge = above
    return tuple(bands)


def level_bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """`signal_bands`, the same of the envelopes, and what belongs to no band."""
    signal = signal_bands(sample_rate, shaft, n_samples)
    envelope = [replace(band, name=f"envelope {band.name}", part="envelope") for band in signal]
    whole = [Band(name, 0.0, sample_rate / 2, part="whole") for name in _WHOLE.values()]
    return (*signal, *envelope, *whole)


_WHOLE = {
    ("deviation", False): "overall level",
    ("deviation", True): "envelope level",
    ("shape", None): "waveform shape",
}


def hertz(frequency: float) -> str:
    """Frequency in words, with two digits of kHz or three of Hz."""
    return f"{frequency / 1000:.2g} kHz" if frequency >= 1000 else f"{frequency:.3g} Hz"


def level_shares(
    levels: tuple[WindowLevel, ...], bands: tuple[Band, ...], sample_rate: float, turns: float
) -> Float64[np.ndarray, "level band"]:
    """Share of each level in each of `level_bands`, by overlap in frequency; those of a level sum to 1.

    Parameters
    ----------
    turns : turns of the shaft per sample.
    """
    shares = np.zeros((len(levels), len(bands)))
    names = [band.name for band in bands]
    for row, level in zip(shares, levels, strict=True):
        if level.quantity != "power":
            key = (level.quantity, None if level.quantity == "shape" else level.is_envelope)
            row[names.index(_WHOLE[key])] = 1.0
            continue
        part = "envelope" if level.is_envelope else "signal"
        low, high = (edge * sample_rate for edge in level.edges(turns))
        for index, band in enumerate(bands):
            if band.part == part:
                row[index] = max(0.0, min(high, band.high) - max(low, band.low))
        if row.any():
            row /= row.sum()
        else:  # beyond the spectrum
            row[max(index for index, band in enumerate(bands) if band.part == part)] = 1.0
    return shares


def band_sums(
    lines: Float64[np.ndarray, "channel line"], bands: tuple[Band, ...], sample_rate: float, n_samples: int
) -> Float64[np.ndarray, "channel band"]:
    """Sum of the lines in each band; the last holds the last line too."""
    frequency = line_frequencies(n_samples, sample_rate)
    band = np.clip(np.searchsorted([band.high for band in bands], frequency, side="right"), 0, len(bands) - 1)
    return np.stack([np.bincount(band, weights=row, minlength=len(bands)) for row in lines])


def band_rms(
    samples: Float64[np.ndarray, "channel time"], bands: tuple[Band, ...], sample_rate: float
) -> Float64[np.ndarray, "channel band"]:
    """Root mean square of the samples, or of their envelope, in each band; NaN where it is of no band."""
    rms = np.full((len(samples), len(bands)), np.nan)
    moving = samples - samples.mean(axis=1, keepdims=True)
    for part in ("signal", "envelope"):
        members = [index for index, band in enumerate(bands) if band.part == part]
        if members:
            lines = _powers(moving if part == "signal" else signal_envelope(moving))
            sums = band_sums(lines, tuple(bands[index] for index in members), sample_rate, samples.shape[1])
            rms[:, members] = np.sqrt(sums)
    return rms


def _powers(samples: np.ndarray) -> Float64[np.ndarray, "channel line"]:
    """Mean square of each line, mean removed."""
    moving = samples - samples.mean(axis=1, keepdims=True)
    return np.asarray(np.maximum(line_shares(moving, moving), 0.0) / samples.shape[1], dtype=np.float64)


def line_shares(
    signal: Float[np.ndarray, "channel time"], gradient: Float[np.ndarray, "channel time"]
) -> Float64[np.ndarray, "channel line"]:
    """What each line of the spectrum (`signals.transform`) adds to the answer; their sum is Σ signal · gradient.

    Examples
    --------
    >>> x, g = np.random.default_rng(0).normal(size=(2, 1, 9))
    >>> bool(np.isclose(line_shares(x, g).sum(), (x * g).sum()))
    True
    """
    n = signal.shape[-1]
    both = transform(signal) * np.conj(transform(gradient))
    weight = np.full(both.shape[-1], 2.0)
    weight[0] = 1.0
    if n % 2 == 0:
        weight[-1] = 1.0
    return np.asarray(weight / n * both.real, dtype=np.float64)
