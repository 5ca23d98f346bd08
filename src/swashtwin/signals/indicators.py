"""Indicators by family: name, unit and meaning of each, and its value for every channel."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.recordings import Recording
from swashtwin.signals.band_powers import Spectrum, band_rms, segment_length
from swashtwin.signals.envelope import envelopes
from swashtwin.signals.kurtogram import kurtograms
from swashtwin.signals.shaft_angle import ShaftAngle, resample_by_angle
from swashtwin.signals.spectra import order_spectrum, power_density, segment_densities
from swashtwin.signals.waveform_statistics import recording_statistics

_BAND = re.compile(r"([0-9]+\.?[0-9]*)\s*-\s*([0-9]+\.?[0-9]*)\s*(Hz|kHz|x)")

# Factor and unit in which people read a quantity; files and JSON are in SI units.
_DISPLAY_UNITS = {"m/s": (1000.0, "mm/s")}


@dataclass(frozen=True)
class Band:
    """Band of frequencies, in Hz or in multiples of the shaft."""

    low: float
    """Lower edge [Hz] or [shaft orders]."""
    high: float
    """Upper edge [Hz] or [shaft orders]."""
    in_orders: bool = False
    """Whether the edges are multiples of the shaft frequency."""

    @classmethod
    def parse(cls, text: str) -> "Band":
        """Return the band of a text such as ``10-1000 Hz``, ``1-5 kHz`` or ``0.5-6.5x``.

        Raises
        ------
        InputError
            The text is not a band.

        Examples
        --------
        >>> Band.parse("0.5-6.5x")
        Band(low=0.5, high=6.5, in_orders=True)
        """
        match = _BAND.fullmatch(text.strip())
        if match is None or not float(match[1]) < float(match[2]):
            raise InputError(
                f"Invalid band {text!r}: use two rising numbers and a unit, as in "
                '"10-1000 Hz" or "0.5-6.5x".'
            )

        factor = 1000.0 if match[3] == "kHz" else 1.0
        return cls(float(match[1]) * factor, float(match[2]) * factor, in_orders=match[3] == "x")

    @property
    def name(self) -> str:
        """Edges and unit, such as ``10-1000 Hz`` or ``0.5-6.5x``."""
        unit = "x" if self.in_orders else " Hz"
        return f"{self.low:g}-{self.high:g}{unit}"


BANDS = (Band(10, 1000), Band(1000, 2000), Band(2000, 5000), Band(5000, 10000))
"""Default bands of `indicators_of`."""


@dataclass(frozen=True)
class Indicator:
    """One column of a table."""

    name: str
    """Name, such as ``rms`` or ``order_amplitude 7x``."""
    unit: str
    """Unit; empty for a pure number."""
    meaning: str
    """What it is, with its convention."""

    @property
    def display_unit(self) -> tuple[float, str]:
        """Factor to the unit in which people read it, and that unit, such as mm/s."""
        return _DISPLAY_UNITS.get(self.unit, (1.0, self.unit))


@dataclass(frozen=True, eq=False)
class IndicatorInput:
    """A recording, and what its indicators are computed from besides its samples."""

    recording: Recording
    """The recording."""
    shaft: float | None
    """Shaft frequency [Hz]; None if it is not known."""
    angle: ShaftAngle | None
    """Angle of the shaft, if it was measured or followed."""
    orders: tuple[int, ...]
    """Multiples of the shaft whose lines are described."""
    bands: tuple[Band, ...]
    """Bands whose root mean squares are computed."""

    @cached_property
    def band_spectrum(self) -> Spectrum:
        """Power density from which the root mean squares of bands are read."""
        rate = self.recording.sample_rate
        length = segment_length(self.recording.n_samples, rate)
        return power_density(self.recording.signal, rate, length)


Values = Iterator[tuple[Indicator, Float[np.ndarray, " channel"]]]

_STATISTICS = {
    "rms": "root mean square, mean removed",
    "peak": "largest magnitude, mean removed",
    "crest_factor": "peak over rms",
    "kurtosis": "fourth standardized moment; 3 for Gaussian noise",
    "skewness": "third standardized moment; 0 for a symmetric signal",
}
_HAS_UNIT = ("rms", "peak")


def _statistics(source: IndicatorInput) -> Values:
    values = recording_statistics(source.recording)
    for name, meaning in _STATISTICS.items():
        unit = source.recording.unit if name in _HAS_UNIT else ""
        yield Indicator(name, unit, meaning), values[name]


def _rms_or_nan(
    source: IndicatorInput, low: float, high: float, *, of_velocity: bool = False
) -> Float[np.ndarray, " channel"]:
    """Return the root mean square of a band; NaN if the recording is too short or too slow."""
    try:
        return band_rms(
            source.recording.signal,
            source.recording.sample_rate,
            low,
            high,
            of_velocity=of_velocity,
            spectrum=source.band_spectrum,
        )
    except InputError:
        return np.full(source.recording.n_channels, math.nan)


def _order_amplitudes(
    orders: tuple[int, ...], signal: np.ndarray, rate: float, shaft: float
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each order with its amplitude, which is NaN beyond what the recording resolves."""
    densities = segment_densities(signal, rate)
    for order in orders:
        try:
            lines = order_spectrum(signal, rate, shaft, np.array([order]), densities=densities)
            yield order, lines.amplitude[:, 0]
        except InputError:
            yield order, np.full(len(signal), math.nan)


def _velocity(source: IndicatorInput) -> Values:
    if source.recording.unit != "m/s^2":
        return
    meaning = "rms velocity, 10 to 1000 Hz, integrated from acceleration"
    values = _rms_or_nan(source, 10.0, 1000.0, of_velocity=True)
    yield Indicator("velocity_rms", "m/s", meaning), values


def _bands(source: IndicatorInput) -> Values:
    meaning = "rms in the band; its square is the energy"
    for band in source.bands:
        factor = source.shaft if band.in_orders else 1.0
        if factor is None:
            continue
        indicator = Indicator(f"band_rms {band.name}", source.recording.unit, meaning)
        yield indicator, _rms_or_nan(source, band.low * factor, band.high * factor)


def _orders(source: IndicatorInput) -> Values:
    if source.shaft is None:
        return

    recording = source.recording
    if source.angle is None:
        signal = recording.signal
        rate = recording.sample_rate
        shaft = source.shaft
        meaning = (
            "peak amplitude of the line, its power gathered over 0.6 % of wandering speed, "
            "noise taken away"
        )
    else:
        steady = resample_by_angle(recording, source.angle)
        signal = steady.signal
        rate = float(steady.attributes["samples_per_turn"])
        shaft = 1.0
        meaning = "peak amplitude of the line along the shaft's angle, noise taken away"

    for order, amplitude in _order_amplitudes(source.orders, signal, rate, shaft):
        yield Indicator(f"order_amplitude {order}x", recording.unit, meaning), amplitude


def _envelope(source: IndicatorInput) -> Values:
    signal = source.recording.signal
    rate = source.recording.sample_rate
    # An envelope holds frequencies up to half the width of its band; three times the highest line
    # leaves room for the filter's slopes.
    min_bandwidth = 3 * max(source.orders, default=0) * (source.shaft or 0.0)
    try:
        grams = kurtograms(signal, rate, min_bandwidth=min_bandwidth)
    except InputError:
        return

    bands = np.array([gram.band for gram in grams])
    kurtosis = np.array([gram.kurtosis[gram.best] for gram in grams])
    kurtosis_meaning = "kurtosis of the most impulsive band; 0 for Gaussian noise"
    edge_meaning = "edge of the channel's most impulsive band (kurtogram)"
    yield Indicator("spectral_kurtosis", "", kurtosis_meaning), kurtosis
    yield Indicator("envelope_band_low", "Hz", f"lower {edge_meaning}"), bands[:, 0]
    yield Indicator("envelope_band_high", "Hz", f"upper {edge_meaning}"), bands[:, 1]
    if source.shaft is None:
        return

    envelope = envelopes(signal, rate, bands)
    meaning = "peak amplitude of the envelope's line"
    for order, amplitude in _order_amplitudes(source.orders, envelope, rate, source.shaft):
        yield Indicator(f"envelope_amplitude {order}x", source.recording.unit, meaning), amplitude


FAMILIES: Mapping[str, Callable[[IndicatorInput], Values]] = MappingProxyType(
    {
        "statistics": _statistics,
        "velocity": _velocity,
        "bands": _bands,
        "orders": _orders,
        "envelope": _envelope,
    }
)
"""Families of indicators, and the function that computes each."""
