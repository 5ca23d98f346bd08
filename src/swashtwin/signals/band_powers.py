"""Band powers: the spectral features that a power spectrum and a table of bands give.

Edges of bands are in *lines* of a spectrum: line k lies at k, reaches half a line to either side,
and line 1 is the first above the mean. A line that an edge cuts counts by its share, so that a band
narrower than a line is never empty. Which bands are measured is data, and belongs to whoever
measures: `learning` has a table for windows, one for whole recordings, and one for the baseline of
healthy recordings.

Two functions compute the same sums. `power_between` reads them off `running_sums`, for bands that
differ from row to row (shaft orders) or that overlap. `band_shares` is a matrix for a table that
all spectra of a length share: one matrix product gives all bands.

Root mean squares of a band (`band_rms`) are corrected for the noise bandwidth of the taper: a sine
of amplitude 1 reads 0.7071 in any band that holds it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float64, Int

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording, require_usable, specified_shaft_frequency
from swashtwin.signals.spectra import hann_taper, power_density, tapered_transform

MIN_POWER = 1e-30
"""Smallest power whose logarithm is taken, so that an empty band stays finite."""


@dataclass(frozen=True)
class BandPower:
    """What one spectral feature is measured from: the power of a band, or another `quantity`."""

    channel: str
    """Channel; empty if the feature is measured of every channel."""
    is_envelope: bool
    """Whether it is of the envelope rather than of the signal."""
    order: int | None
    """Shaft order that the band is about; None for a band of frequencies."""
    low: float
    """Lower edge [shaft orders] for an order; else [Hz], or of short windows [periods per sample].
    """
    high: float
    """Upper edge, likewise."""
    quantity: str = "power"
    """``"power"`` of a band, ``"deviation"`` of the whole, or ``"shape"`` of the waveform."""

    @property
    def is_band(self) -> bool:
        """Whether it is the power of a band of frequencies of the signal."""
        return self.order is None and not self.is_envelope and self.quantity == "power"

    def edges(self, shaft: float | None) -> tuple[float, float]:
        """Return the edges [Hz] at a shaft frequency [Hz]; NaN for an order without one."""
        if self.order is None:
            return self.low, self.high
        if shaft is None:
            return math.nan, math.nan
        return self.low * shaft, self.high * shaft

    def describe(self, shaft: float | None = None) -> str:
        """Return a label such as ``shaft order 9 (129 Hz)``, at a shaft frequency [Hz].

        Examples
        --------
        >>> BandPower("x", True, 9, 8.75, 9.25).describe(14.333)
        'shaft order 9 of the envelope (129 Hz)'
        """
        signal = " of the envelope" if self.is_envelope else ""
        if self.order is None:
            return f"{_format_hertz(self.low)} to {_format_hertz(self.high)} Hz{signal}"
        if shaft is None:
            return f"shaft order {self.order}{signal}"
        return f"shaft order {self.order}{signal} ({_format_hertz(self.order * shaft)} Hz)"


def _format_hertz(frequency: float) -> str:
    return f"{frequency:.0f}" if frequency >= 100 else f"{frequency:.3g}"


def line_powers(signal: Float[np.ndarray, "*batch time"]) -> Float[np.ndarray, "*batch line"]:
    """Return the mean square of each line from line 1 on, in the signal's precision.

    The mean is removed and a Hann taper applied.
    """
    length = signal.shape[-1]
    spectrum = tapered_transform(signal)[..., 1:]
    power = spectrum.real**2 + spectrum.imag**2
    power *= power.dtype.type(2 / (length * np.sum(hann_taper(length) ** 2)))
    return np.asarray(power)


def running_sums(power: Float[np.ndarray, "*batch line"]) -> Float64[np.ndarray, "*batch edge"]:
    """Return the power of all lines below each edge between two lines."""
    sums = np.zeros((*power.shape[:-1], power.shape[-1] + 1))
    # Summed in place, because converting to double precision while summing takes twice as long.
    sums[..., 1:] = power
    return np.cumsum(sums, axis=-1, out=sums)


def power_below(
    sums: Float64[np.ndarray, "*batch edge"], edges: Float[np.ndarray, "*row position"]
) -> Float64[np.ndarray, "*batch position"]:
    """Return the power below edges, which are in lines.

    Parameters
    ----------
    sums : `running_sums` of the lines 1, 2, ...
    edges : the same for all rows of `sums`, or with an axis for each of theirs.

    Examples
    --------
    >>> power_below(running_sums(np.array([1.0, 2.0, 3.0])), np.array([0.5, 2.0, 9.0])).tolist()
    [0.0, 2.0, 6.0]
    """
    position = np.clip(edges - 0.5, 0, sums.shape[-1] - 1)
    line = np.minimum(position.astype(np.int64), sums.shape[-1] - 2)
    if edges.ndim == 1:
        below = sums[..., line]
        above = sums[..., line + 1]
    else:
        below = np.take_along_axis(sums, line, -1)
        above = np.take_along_axis(sums, line + 1, -1)
    return np.asarray(below + (position - line) * (above - below))


def power_between(
    sums: Float64[np.ndarray, "*batch edge"],
    low: Float[np.ndarray, " band"],
    high: Float[np.ndarray, " band"],
) -> Float64[np.ndarray, "*batch band"]:
    """Return the power between pairs of edges, which are in lines (`power_below`)."""
    power: np.ndarray = power_below(sums, high) - power_below(sums, low)
    return power


def logarithmic_edges(n_lines: int, n_bands: int) -> Float64[np.ndarray, " edge"]:
    """Return the edges of bands of equal ratio over the lines 1 to `n_lines`, in lines."""
    return np.geomspace(0.5, n_lines + 0.5, n_bands + 1)


def equal_bands(
    n_lines: int, n_bands: int, share: float
) -> tuple[Int[np.ndarray, " band"], Int[np.ndarray, " band"]]:
    """Return the first line, and the line after the last, of equal bands; lines counted from 0.

    The bands cover the lowest `share` of the lines. If there are more bands than lines, neighbors
    overlap, so that none is empty.
    """
    n_covered = max(1, round(share * n_lines))
    band = np.arange(n_bands)
    first = band * n_covered // n_bands
    end = -(-(band + 1) * n_covered // n_bands)
    return first, end


@lru_cache(maxsize=16)
def band_shares(n_lines: int, n_bands: int) -> Float[np.ndarray, "line band"]:
    """Return the share of each line in each of the bands of `logarithmic_edges`; read only."""
    line = np.arange(1, n_lines + 1)
    edges = logarithmic_edges(n_lines, n_bands)
    upper = np.minimum(edges[1:, None], line + 0.5)
    lower = np.maximum(edges[:-1, None], line - 0.5)

    shares: np.ndarray = np.maximum(upper - lower, 0).T
    shares.setflags(write=False)
    return shares


def log_band_powers(
    power: Float64[np.ndarray, "window line"], n_bands: int
) -> Float64[np.ndarray, "window band"]:
    """Return log10 of the power in each of the bands of `logarithmic_edges`."""
    powers = power @ band_shares(power.shape[1], n_bands)
    log_powers: np.ndarray = np.log10(np.maximum(powers, MIN_POWER))
    return log_powers


SEGMENT_S = 2.0
"""Length of the segments of a spectrum for `band_rms` [s]: its lines lie 0.5 Hz apart."""

Spectrum = tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]
"""Frequencies [Hz] and power density [unit^2/Hz]."""


def segment_length(n_samples: int, sample_rate: float) -> int:
    """Return the samples of the segments for `band_rms`; a shorter signal is one segment."""
    return min(n_samples, round(SEGMENT_S * sample_rate))


def band_rms(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    low: float,
    high: float,
    *,
    of_velocity: bool = False,
    spectrum: Spectrum | None = None,
) -> Float[np.ndarray, " channel"]:
    """Return the root mean square between `low` and `high` [Hz], in the signal's unit.

    Its square is the band's energy. No zone of ISO 20816 applies to piston pumps; compare with the
    machine's own baseline (`signals.trend_of`).

    Parameters
    ----------
    of_velocity : return that of the velocity [m/s] of an acceleration [m/s^2]: the power density is
        divided by the angular frequency squared, which needs no start value and lets no offset
        drift. Vibration severity of machines is commonly stated from 10 to 1000 Hz.
    spectrum : `power_density` of the signal in segments of `segment_length`, if already known.

    Examples
    --------
    >>> time = np.arange(4000) / 1000
    >>> print(band_rms(np.sin(2 * np.pi * 50 * time)[None], 1000.0, 10, 100).round(4))
    [0.7071]
    """
    n_samples = signal.shape[-1]
    if not 0 <= low < high <= sample_rate / 2:
        raise InputError(
            f"Band {low:g} to {high:g} Hz lies outside 0 to {sample_rate / 2:g} Hz "
            "(half the sample rate)."
        )
    length = segment_length(n_samples, sample_rate)
    line_width = sample_rate / length
    # The division by the frequency squared would make much of the first line, which holds what the
    # taper leaks from the mean.
    if high - low < line_width or (of_velocity and low < 2 * line_width):
        raise InputError(
            f"{n_samples / sample_rate:.3g} s resolve {line_width:.3g} Hz, too little for "
            f"{low:g} to {high:g} Hz: record longer."
        )

    if spectrum is None:
        spectrum = power_density(signal, sample_rate, length)
    frequency, density = spectrum

    upper = np.minimum(frequency + line_width / 2, high)
    lower = np.maximum(frequency - line_width / 2, low)
    weight = np.clip(upper - lower, 0, None)
    if of_velocity:
        weight[1:] /= (2 * np.pi * frequency[1:]) ** 2  # line 0 lies below the band
    rms: np.ndarray = np.sqrt(density @ weight)
    return rms


TURNS = 8
"""Revolutions in each segment of a spectrum by orders: eight lines lie from order to order."""
STRETCH_SAMPLES = 1 << 18
"""Samples of a channel that are transformed together; a longer recording is read in stretches."""


def require_shaft_frequency(recording: Recording) -> float:
    """Return the specified shaft frequency [Hz]; raise a `DataError` if there is none."""
    shaft = specified_shaft_frequency(recording)
    if not shaft:
        raise DataError(
            f"{recording.recording_id} specifies no speed, which shaft orders need.",
            field="speed",
            remedy="Set {speed='860 rpm'}.",
        )
    return shaft


def _identity(signal: np.ndarray) -> np.ndarray:
    return signal


def recording_density(
    recording: Recording,
    length: int,
    *,
    min_samples: float = 0,
    transform_samples: Callable[[np.ndarray], np.ndarray] = _identity,
) -> Float64[np.ndarray, "*batch frequency"]:
    """Return the power density [unit^2/Hz] of a recording, which is never whole in memory.

    Parameters
    ----------
    length : samples of each segment.
    min_samples : samples that the recording must have, besides those of a segment.
    transform_samples : applied to the samples (channel, time) of each stretch before the density is
        taken, for instance to take their envelope.

    Raises
    ------
    DataError
        The recording is unfit or too short.
    """
    require_usable(recording)
    needed = max(length, min_samples)
    if recording.n_samples < needed:
        raise DataError(
            f"{recording.recording_id} lasts {recording.duration:.3g} s "
            f"({recording.n_samples} samples); its band powers need "
            f"{needed / recording.sample_rate:.3g} s ({needed:.0f}): record longer."
        )

    sample_counts = []
    densities = []
    for start in range(0, recording.n_samples - length + 1, max(length, STRETCH_SAMPLES)):
        end = min(start + max(length, STRETCH_SAMPLES), recording.n_samples)
        signal = recording.slice(start, end).signal
        sample_counts.append(signal.shape[1])
        density = power_density(transform_samples(signal), recording.sample_rate, length)[1]
        densities.append(density)

    weights = np.array(sample_counts) / sum(sample_counts)
    return np.asarray(np.einsum("p,p...->...", weights, np.stack(densities)))
