"""One spectrum of a recording with the lines of shaft and pistons marked: amplitude, envelope or order."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from swashtwin.recordings import Recording, refuse_unfit, stated_speed
from swashtwin.signals.envelope import envelope_spectrum
from swashtwin.signals.shaft_angle import ShaftAngle, resampled_by_angle, stated_angle
from swashtwin.signals.spectra import amplitude_spectrum

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
        """Greatest value of each channel within 0.6 %, or two lines, of a mark; NaN beyond the spectrum's end."""
        near = np.abs(self.position - mark.at) <= max(0.006 * mark.at, 2 * float(self.position[1] - self.position[0]))
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
    """Spectrum of each channel, Hann taper corrected, with the places of the shaft's and the pistons' lines.

    Parameters
    ----------
    kind : ``amplitude`` and ``envelope`` over frequency, ``order`` over multiples of the shaft (along its angle).
    angle : shaft angle from a tachometer or a followed line; orders fall back on the stated speed without it.
    pistons : number of pistons, for the marks.
    band : edges [Hz] for the envelope; by default the kurtogram's for each channel.
    resolution : spacing of the lines of an amplitude spectrum [Hz]; 0 takes the whole recording at once.

    Raises
    ------
    InputError
        No speed for orders, or a band that is none.
    DataError
        The recording is unfit.
    """
    refuse_unfit(recording)
    shaft = stated_speed(recording) if angle is None else angle.mean_speed / (2 * math.pi)
    signal, rate, unit = recording.signal, recording.sample_rate, recording.unit
    header = (kind, recording.recording_id, recording.channels)
    if kind == "amplitude":
        frequency, amplitude = amplitude_spectrum(signal, rate, resolution)
        return LineSpectrum(*header, "frequency", "Hz", frequency, amplitude, unit, _marks(shaft, pistons))
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
    return LineSpectrum(*header, "order", "", order, amplitude, unit, marks, angle_from=angle.source)


def _marks(shaft: float | None, pistons: int | None) -> tuple[Mark, ...]:
    if shaft is None:
        return ()
    marks = [Mark(k * shaft, f"{k}x", False) for k in range(1, _SHAFT_MARKS + 1)]
    for order in [] if pistons is None else [pistons * k for k in range(1, _PISTON_MARKS + 1)]:
        marks.append(Mark(order * shaft, f"{order}x", True))
    return tuple(marks)
