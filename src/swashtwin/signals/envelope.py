"""Envelope spectra, the kurtogram, which band one is taken of, and one spectrum of a recording with
its lines marked.

A flaw in a rolling bearing rings the housing at multiples of its `defect_orders`, which the
envelope's spectrum shows.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import scipy
from jaxtyping import Complex, Float, Float32, Int
from numpy.lib.stride_tricks import sliding_window_view

from swashtwin.foundation import InputError
from swashtwin.recordings import Recording, require_usable, specified_shaft_frequency
from swashtwin.signals.filtering import band_limited
from swashtwin.signals.shaft_angle import ShaftAngle, resampled_by_angle, stated_angle
from swashtwin.signals.spectra import AT_ONCE, amplitude_spectrum, signal_envelope

_LEVELS = 7
"""Halvings of the whole band, at most."""
_LEAST_VALUES = 200
"""Independent values of the envelope in a band, at least: the kurtosis of noise then scatters by
0.14.
"""
_SLOPE = 0.125
"""Width of a filter's slopes beyond either edge, relative to the band; neighbors add up to 1."""
_EDGE = 4
"""Values of the envelope dropped at either end, where the filter sees the signal's other end."""
_SURE = 3.0
"""Standard deviations of noise taken off a band's kurtosis before bands are compared."""
_ABREAST = 8
"""Bands that are transformed together where there are so many: the processor does several at a
time.
"""
_LONG = 1 << 19
"""Lines of a spectrum from which its filters take too much memory to be kept for the next one."""


@dataclass(frozen=True, eq=False)
class Kurtogram:
    """Spectral kurtosis of bands that halve and third the spectrum."""

    low: Float[np.ndarray, " band"]
    """Lower edge of each band [Hz]."""
    high: Float[np.ndarray, " band"]
    """Upper edge of each band [Hz]."""
    kurtosis: Float[np.ndarray, " band"]
    """E|c|⁴ / (E|c|²)² - 2 of each band's complex envelope c: 0 for Gaussian noise, -1 for one
    sine.
    """
    deviation: Float[np.ndarray, " band"]
    """Standard deviation of the kurtosis that Gaussian noise would have, 2 / √(bandwidth ·
    duration).
    """

    @property
    def best(self) -> int:
        """Band whose kurtosis lies highest after three standard deviations are taken off (our
        reading).

        Antoni takes the highest itself, which in a short recording is often a narrow band of plain
        noise. Bands that begin at 0 Hz have no part in it, as an envelope is one of something
        faster; the whole band where there is no other.
        """
        sure = np.where(self.low > 0, self.kurtosis - _SURE * self.deviation, -np.inf)
        return int(np.argmax(sure))

    @property
    def band(self) -> tuple[float, float]:
        """Edges [Hz] of the best band."""
        return float(self.low[self.best]), float(self.high[self.best])


def kurtograms(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, *, least_bandwidth: float = 0.0
) -> list[Kurtogram]:
    """Spectral kurtosis of each channel on the grid of Antoni's fast kurtogram (DOI
    10.1016/j.ymssp.2005.12.002).

    Bands are 1, 1/2, 1/3, 1/4, 1/6, 1/8, 1/12 ... of half the sample rate; of those that begin at 0
    Hz only the whole one is there, as an envelope is one of something faster. Each band's complex
    envelope comes from the inverse transform of its part of the spectrum, with raised-cosine
    slopes, instead of from his tree of short filters. Zeros are added to the part up to a length
    that is fast to transform, which samples the same envelope a little more closely (our reading:
    his envelopes have a length that his tree decides); the kurtosis of noise moves by less than its
    deviation. Transforms are of single precision.

    Parameters
    ----------
    least_bandwidth : narrowest band wanted [Hz]; an envelope holds frequencies up to half its
        band's width or so.
    """
    n_samples = signal.shape[-1]
    if n_samples < 2 * _LEAST_VALUES or (np.ptp(signal, axis=-1) == 0).any():
        raise InputError(
            f"{n_samples} samples, or constant ones, have no kurtogram; it takes {2 * _LEAST_VALUES}."
        )
    time = np.arange(n_samples) - (n_samples - 1) / 2
    trend = ((signal @ time) / (time @ time))[:, None] * time + signal.mean(axis=-1, keepdims=True)
    moving = signal - trend
    moving /= moving.std(axis=-1, keepdims=True)
    spectra = scipy.fft.rfft(moving, overwrite_x=True).astype(np.complex64)
    edges, kurtosis = [], []
    halves = [2**level for level in range(_LEVELS + 1)]
    for count in sorted([*halves, *(3 * half for half in halves[:-1])]):
        width = sample_rate / 2 / count
        values = n_samples / sample_rate * width
        if count > 1 and (values < _LEAST_VALUES or width < least_bandwidth):
            continue
        deviation = 2 / math.sqrt(values)
        edges += [
            (index / count, (index + 1) / count, deviation) for index in range(count > 1, count)
        ]
        kurtosis.append(_kurtosis(spectra, count))
    low, high, deviations = np.array(edges).T
    nyquist = sample_rate / 2
    return [
        Kurtogram(low * nyquist, high * nyquist, row, deviations)
        for row in np.concatenate(kurtosis, axis=1)
    ]


def _kurtosis(
    spectra: Complex[np.ndarray, "channel line"], count: int
) -> Float[np.ndarray, "channel band"]:
    """Spectral kurtosis of `count` bands that share a spectrum, without the first where there are
    several.
    """
    channels, last = len(spectra), spectra.shape[1] - 1
    first, weights = (_filters if last < _LONG else _filters.__wrapped__)(last, count)
    width = weights.shape[1] // 2
    bands = sliding_window_view(
        np.pad(spectra, ((0, 0), (0, width))).view(np.float32), 2 * width, axis=1
    )
    at_once = max(1, AT_ONCE // (width * channels) // _ABREAST) * _ABREAST
    kurtosis = np.empty((channels, len(first)))
    for start in range(0, len(first), at_once):
        part = slice(start, start + at_once)
        lines = np.zeros(
            (channels, len(first[part]), scipy.fft.next_fast_len(width)), spectra.dtype
        )
        np.multiply(
            bands[:, 2 * first[part]], weights[part], out=lines.view(np.float32)[..., : 2 * width]
        )
        envelope = scipy.fft.ifft(lines, axis=-1, overwrite_x=True)[..., _EDGE:-_EDGE]
        power = envelope.real**2
        power += envelope.imag**2
        mean = power.mean(axis=-1)
        power /= np.where(mean > 0, mean, 1)[..., None]
        kurtosis[:, part] = np.einsum("cbt,cbt->cb", power, power) / power.shape[-1] - 2
    return kurtosis


@lru_cache(maxsize=2 * _LEVELS + 1)
def _filters(
    last: int, count: int
) -> tuple[Int[np.ndarray, " band"], Float32[np.ndarray, "band part"]]:
    """First lines of the filters of `_kurtosis`, and the weights of real and imaginary parts."""
    edges = last * np.arange(count > 1, count + 1) / count
    slope = _SLOPE * last / count
    first = np.maximum(1, np.floor(edges[:-1] - slope)).astype(int)
    end = np.minimum(last, np.ceil(edges[1:] + slope)).astype(int)
    line = first[:, None] + np.arange(int((end - first).max()) + 1)
    rise = np.clip((line - edges[:-1, None]) / (2 * slope) + 0.5, 0, 1) if count > 1 else 1.0
    fall = np.where(
        edges[1:, None] < last, np.clip((edges[1:, None] - line) / (2 * slope) + 0.5, 0, 1), 1.0
    )
    weights = np.where(line <= end[:, None], np.sin(np.pi / 2 * np.minimum(rise, fall)), 0.0)
    return first, np.repeat(weights.astype(np.float32), 2, axis=1)


def envelopes(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    bands: Float[np.ndarray, "channel 2"],
) -> Float[np.ndarray, "channel time"]:
    """Envelope of each channel in its band [Hz]: the magnitude of the analytic signal after
    `signals.band_limited`.
    """
    limited = [
        band_limited(row[None], sample_rate, max(low, 1e-3 * sample_rate), high)
        for row, (low, high) in zip(signal, bands, strict=True)
    ]
    return signal_envelope(np.concatenate(limited))


def envelope_spectrum(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    band: tuple[float, float] | None = None,
) -> tuple[
    Float[np.ndarray, " frequency"],
    Float[np.ndarray, "channel frequency"],
    Float[np.ndarray, "channel 2"],
]:
    """Frequencies [Hz], peak amplitudes of the envelope (A (1 + m cos) in the band reads A m), and
    each channel's band.

    Parameters
    ----------
    band : edges [Hz] of the band whose envelope is taken; None lets the kurtogram choose one for
        each channel.

    Examples
    --------
    >>> time = np.arange(20000) / 10000
    >>> struck = (1 + 0.5 * np.cos(2 * np.pi * 30 * time)) * np.sin(2 * np.pi * 2000 * time)
    >>> frequency, amplitude, _ = envelope_spectrum(struck[None], 10000.0, (1500, 2500))
    >>> print(f"{frequency[60]:.0f} Hz: {amplitude[0, 60]:.2f}")
    30 Hz: 0.50
    """
    if band is not None and not 0 <= band[0] < band[1] <= sample_rate / 2:
        raise InputError(
            f"a band of {band[0]:g}...{band[1]:g} Hz is none at {sample_rate:g} Hz; "
            f"it lies between 0 and half the sample rate ({sample_rate / 2:g} Hz)."
        )
    chosen = (
        [gram.band for gram in kurtograms(signal, sample_rate)]
        if band is None
        else [band] * len(signal)
    )
    bands = np.array(chosen, dtype=float)
    return *amplitude_spectrum(envelopes(signal, sample_rate, bands), sample_rate), bands


class DefectOrders(NamedTuple):
    """Events per turn of the shaft, the outer race standing still."""

    inner_race: float
    """A rolling body meets a flaw on the inner race (BPFI)."""
    outer_race: float
    """A rolling body meets a flaw on the outer race (BPFO)."""
    ball: float
    """A flaw on a rolling body meets a race: twice in each of its own turns (2 BSF)."""
    cage: float
    """Turns of the cage (FTF)."""


def defect_orders(bodies: int, diameter_ratio: float, contact_angle: float = 0.0) -> DefectOrders:
    """Events per turn of the shaft without sliding.

    With g = (d / D) cos a: cage (1 - g) / 2, outer race Z (1 - g) / 2, inner race Z (1 + g) / 2,
    ball (1 - g²) D / d (a flaw on a body meets both races in each of its turns; Randall and Antoni
    2011, doi:10.1016/j.ymssp.2010.07.017).

    Parameters
    ----------
    bodies : number Z of rolling bodies in a row.
    diameter_ratio : diameter d of a body over the pitch diameter D, both in one unit.
    contact_angle : a [rad].

    Examples
    --------
    >>> print(f"{defect_orders(9, 0.3126 / 1.537).inner_race:.4f}")
    5.4152
    """
    ratio = diameter_ratio * math.cos(contact_angle)
    if bodies < 3 or not 0 < ratio < 1:
        raise InputError(
            f"a bearing of {bodies} bodies with d / D = {diameter_ratio:g} is none; it takes 3 or more, and a ratio of "
            "diameters between 0 and 1."
        )
    return DefectOrders(
        inner_race=bodies * (1 + ratio) / 2,
        outer_race=bodies * (1 - ratio) / 2,
        ball=(1 - ratio**2) / diameter_ratio,
        cage=(1 - ratio) / 2,
    )


LineSpectrumKind = Literal["amplitude", "envelope", "order"]
"""Spectra that `spectrum_of` makes."""

_SHAFT_MARKS, _PISTON_MARKS = 2, 5


@dataclass(frozen=True)
class Mark:
    """Where a line is expected."""

    at: float
    """Place on the axis, in its unit."""
    name: str
    """What it is: ``1x``, or ``7x`` for the piston-pass line of seven pistons."""
    of_pistons: bool
    """Whether it belongs to the pistons rather than to the shaft."""


@dataclass(frozen=True, eq=False)
class LineSpectrum:
    """A spectrum of each channel."""

    kind: LineSpectrumKind
    """Which spectrum."""
    recording_id: str
    """Of which recording."""
    channels: tuple[str, ...]
    """Name of each channel."""
    axis: str
    """What lies along the axis."""
    axis_unit: str
    """Unit of the axis, empty for orders."""
    position: Float[np.ndarray, " line"]
    """Place of each line on the axis."""
    amplitude: Float[np.ndarray, "channel line"]
    """One-sided peak amplitude."""
    unit: str
    """Unit of the amplitude."""
    marks: tuple[Mark, ...]
    """Where lines of shaft and pistons are expected; empty where nobody knows the speed."""
    bands: tuple[tuple[float, float], ...] = ()
    """Band [Hz] of each channel's envelope."""
    angle_from: str = ""
    """Where the shaft's angle comes from, for orders."""

    def at(self, mark: Mark) -> Float[np.ndarray, " channel"]:
        """Greatest value of each channel within 0.6 %, or two lines, of a mark; NaN beyond the
        spectrum's end.
        """
        near = np.abs(self.position - mark.at) <= max(
            0.006 * mark.at, 2 * float(self.position[1] - self.position[0])
        )
        if mark.at > self.position[-1]:
            return np.full(len(self.channels), math.nan)
        return self.amplitude[:, near].max(axis=1)


def spectrum_of(
    recording: Recording,
    kind: LineSpectrumKind = "amplitude",
    *,
    angle: ShaftAngle | None = None,
    pistons: int | None = None,
    band: tuple[float, float] | None = None,
    resolution: float = 0.0,
) -> LineSpectrum:
    """Spectrum of each channel, Hann taper corrected, with the places of the shaft's and the
    pistons' lines.

    Parameters
    ----------
    kind : ``amplitude`` and ``envelope`` over frequency, ``order`` over multiples of the shaft
        (along its angle).
    angle : shaft angle from a tachometer or a followed line; orders fall back on the stated speed
        without it.
    pistons : number of pistons, for the marks.
    band : edges [Hz] for the envelope; by default the kurtogram's for each channel.
    resolution : spacing of the lines of an amplitude spectrum [Hz]; 0 takes the whole recording at
        once.

    Raises
    ------
    InputError
        No speed for orders, or a band that is none.
    DataError
        The recording is unfit.
    """
    require_usable(recording)
    shaft = (
        specified_shaft_frequency(recording) if angle is None else angle.mean_speed / (2 * math.pi)
    )
    signal, rate, unit = recording.signal, recording.sample_rate, recording.unit
    header = (kind, recording.recording_id, recording.channels)
    if kind == "amplitude":
        frequency, amplitude = amplitude_spectrum(signal, rate, resolution)
        return LineSpectrum(
            *header, "frequency", "Hz", frequency, amplitude, unit, _marks(shaft, pistons)
        )
    if kind == "envelope":
        frequency, amplitude, edges = envelope_spectrum(signal, rate, band)
        bands = tuple((float(low), float(high)) for low, high in edges)
        marks = _marks(shaft, pistons)
        return LineSpectrum(*header, "frequency", "Hz", frequency, amplitude, unit, marks, bands)
    angle = stated_angle(recording) if angle is None else angle
    turned = resampled_by_angle(recording, angle)
    per_turn = float(turned.attributes["samples_per_turn"])
    order, amplitude = amplitude_spectrum(turned.signal, per_turn)
    marks = _marks(1.0, pistons)
    return LineSpectrum(
        *header, "order", "", order, amplitude, unit, marks, angle_from=angle.source
    )


def _marks(shaft: float | None, pistons: int | None) -> tuple[Mark, ...]:
    if shaft is None:
        return ()
    marks = [Mark(k * shaft, f"{k}x", False) for k in range(1, _SHAFT_MARKS + 1)]
    for order in [] if pistons is None else [pistons * k for k in range(1, _PISTON_MARKS + 1)]:
        marks.append(Mark(order * shaft, f"{order}x", True))
    return tuple(marks)
