"""Every indicator by name: what it is, in which unit, and which family computes it."""

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
from swashtwin.signals.envelope import envelopes, kurtograms
from swashtwin.signals.levels import Spectrum, band_rms, segment_length, shape_statistics
from swashtwin.signals.shaft_angle import ShaftAngle, resampled_by_angle
from swashtwin.signals.spectra import order_spectrum, power_density, segment_densities

_BAND = re.compile(r"([0-9]+\.?[0-9]*)\s*-\s*([0-9]+\.?[0-9]*)\s*(Hz|kHz|x)")

_SHOWN = {"m/s": (1000.0, "mm/s")}
"""Factor and unit of the trade for what is shown to people; files and JSON are in SI units."""


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
        """Band of a text such as ``10-1000 Hz``, ``1-5 kHz`` or ``0.5-6.5x``.

        Raises
        ------
        InputError
            The text is no band.

        Examples
        --------
        >>> Band.parse("0.5-6.5x")
        Band(low=0.5, high=6.5, in_orders=True)
        """
        match = _BAND.fullmatch(text.strip())
        if match is None or not float(match[1]) < float(match[2]):
            raise InputError(
                f'band {text!r} must be two rising numbers and a unit: "10-1000 Hz" or "0.5-6.5x".'
            )
        factor = 1000.0 if match[3] == "kHz" else 1.0
        return cls(float(match[1]) * factor, float(match[2]) * factor, in_orders=match[3] == "x")

    @property
    def name(self) -> str:
        """Edges and unit, such as ``10-1000 Hz`` or ``0.5-6.5x``."""
        return f"{self.low:g}-{self.high:g}{'x' if self.in_orders else ' Hz'}"


BANDS = (Band(10, 1000), Band(1000, 2000), Band(2000, 5000), Band(5000, 10000))
"""Bands of `indicators_of` where none are named."""


@dataclass(frozen=True)
class Indicator:
    """One column of a table."""

    name: str
    """Name, such as ``rms`` or ``order_amplitude 7x``."""
    unit: str
    """Unit, empty where it has none."""
    meaning: str
    """What it is, with its convention."""

    @property
    def shown(self) -> tuple[float, str]:
        """Factor to the unit in which people read it, and that unit, such as millimeters per
        second.
        """
        return _SHOWN.get(self.unit, (1.0, self.unit))


@dataclass(frozen=True, eq=False)
class Measured:
    """A recording and all that indicators are computed from."""

    recording: Recording
    """The channels to describe."""
    shaft: float | None
    """Shaft frequency [Hz], or None where nobody knows it."""
    angle: ShaftAngle | None
    """Angle of the shaft where it was measured or followed."""
    orders: tuple[int, ...]
    """Multiples of the shaft whose lines are wanted."""
    bands: tuple[Band, ...]
    """Bands whose levels are wanted."""

    @cached_property
    def band_spectrum(self) -> Spectrum:
        """Power density that velocity and band levels are read from."""
        rate = self.recording.sample_rate
        return power_density(
            self.recording.signal, rate, segment_length(self.recording.n_samples, rate)
        )


Values = Iterator[tuple[Indicator, Float[np.ndarray, " channel"]]]

_STATISTICS = {
    "rms": "root mean square, mean removed",
    "peak": "largest magnitude, mean removed",
    "crest_factor": "peak over rms",
    "kurtosis": "fourth standardized moment; 3 for Gaussian noise",
    "skewness": "third standardized moment; 0 for a symmetric signal",
}


def _statistics(measured: Measured) -> Values:
    values = shape_statistics(measured.recording)
    for name, meaning in _STATISTICS.items():
        unit = measured.recording.unit if name in ("rms", "peak") else ""
        yield Indicator(name, unit, meaning), values[name]


def _level(
    measured: Measured, low: float, high: float, *, of_velocity: bool = False
) -> Float[np.ndarray, " channel"]:
    """Level in a band, or NaN where the recording is too short or too slow for it."""
    signal, rate = measured.recording.signal, measured.recording.sample_rate
    try:
        return band_rms(
            signal, rate, low, high, of_velocity=of_velocity, spectrum=measured.band_spectrum
        )
    except InputError:
        return np.full(len(signal), math.nan)


def _order_amplitudes(
    orders: tuple[int, ...], signal: np.ndarray, rate: float, shaft: float
) -> Iterator[tuple[int, np.ndarray]]:
    """Each order with its amplitude, from one power density of the signal; NaN where it has
    none.
    """
    densities = segment_densities(signal, rate)
    for order in orders:
        try:
            yield (
                order,
                order_spectrum(
                    signal, rate, shaft, np.array([order]), densities=densities
                ).amplitude[:, 0],
            )
        except InputError:
            yield order, np.full(len(signal), math.nan)


def _velocity(measured: Measured) -> Values:
    if measured.recording.unit == "m/s^2":
        indicator = Indicator(
            "velocity_rms", "m/s", "rms velocity, 10 to 1000 Hz, integrated from acceleration"
        )
        yield indicator, _level(measured, 10.0, 1000.0, of_velocity=True)


def _levels(measured: Measured) -> Values:
    for band in measured.bands:
        factor = measured.shaft if band.in_orders else 1.0
        if factor is None:
            continue
        meaning = "rms in the band; its square is the energy"
        indicator = Indicator(f"band_rms {band.name}", measured.recording.unit, meaning)
        yield indicator, _level(measured, band.low * factor, band.high * factor)


def _lines(measured: Measured) -> Values:
    if measured.shaft is None:
        return
    signal, rate, shaft = measured.recording.signal, measured.recording.sample_rate, measured.shaft
    meaning = "peak amplitude of the line, its power gathered over 0.6 % of wandering speed, noise taken away"
    if measured.angle is not None:
        turned = resampled_by_angle(measured.recording, measured.angle)
        signal, rate, shaft = turned.signal, float(turned.attributes["samples_per_turn"]), 1.0
        meaning = "peak amplitude of the line along the shaft's angle, noise taken away"
    for order, amplitude in _order_amplitudes(measured.orders, signal, rate, shaft):
        yield Indicator(f"order_amplitude {order}x", measured.recording.unit, meaning), amplitude


def _envelope(measured: Measured) -> Values:
    signal, rate = measured.recording.signal, measured.recording.sample_rate
    meaning = "edge of the channel's most impulsive band (kurtogram)"
    try:
        least = 3 * max(measured.orders, default=0) * (measured.shaft or 0.0)
        grams = kurtograms(signal, rate, least_bandwidth=least)
    except InputError:
        return
    bands = np.array([gram.band for gram in grams])
    height = np.array([gram.kurtosis[gram.best] for gram in grams])
    yield (
        Indicator(
            "spectral_kurtosis", "", "kurtosis of the most impulsive band; 0 for Gaussian noise"
        ),
        height,
    )
    yield Indicator("envelope_band_low", "Hz", f"lower {meaning}"), bands[:, 0]
    yield Indicator("envelope_band_high", "Hz", f"upper {meaning}"), bands[:, 1]
    if measured.shaft is None:
        return
    for order, amplitude in _order_amplitudes(
        measured.orders, envelopes(signal, rate, bands), rate, measured.shaft
    ):
        meaning = "peak amplitude of the envelope's line"
        yield Indicator(f"envelope_amplitude {order}x", measured.recording.unit, meaning), amplitude


FAMILIES: Mapping[str, Callable[[Measured], Values]] = MappingProxyType(
    {
        "statistics": _statistics,
        "velocity": _velocity,
        "bands": _levels,
        "orders": _lines,
        "envelope": _envelope,
    }
)
"""Families of indicators, and the function that computes each."""
