"""One spectrum of a recording, with the lines of shaft and pistons marked."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import short_repr
from swashtwin.recordings import Recording, require_usable, specified_shaft_frequency
from swashtwin.signals.envelope import envelope_spectrum
from swashtwin.signals.shaft_angle import ShaftAngle, resample_by_angle, specified_angle
from swashtwin.signals.spectra import amplitude_spectrum

LineSpectrumKind = Literal["amplitude", "envelope", "order"]
"""Spectra that `spectrum_of` makes."""

SHAFT_MARKS = 2
"""Multiples of the shaft frequency that are marked."""
PISTON_MARKS = 5
"""Multiples of the piston-pass frequency that are marked."""
MARK_TOLERANCE = 0.006
"""Half-width [relative] within which a marked line is searched: speeds wander by this much."""


@dataclass(frozen=True)
class Mark:
    """Expected position of a line."""

    position: float
    """Position on the axis, in its unit."""
    name: str
    """Name of the line: ``1x``, or ``7x`` for the piston-pass line of seven pistons."""
    of_pistons: bool
    """Whether it belongs to the pistons rather than to the shaft."""


@dataclass(frozen=True, eq=False)
class LineSpectrum:
    """A spectrum of each channel."""

    kind: LineSpectrumKind
    """Kind of the spectrum."""
    recording_id: str
    """Recording that it is of."""
    channels: tuple[str, ...]
    """Name of each channel."""
    axis: str
    """Quantity along the axis."""
    axis_unit: str
    """Unit of the axis, empty for orders."""
    position: Float[np.ndarray, " line"]
    """Position of each line on the axis."""
    amplitude: Float[np.ndarray, "channel line"]
    """One-sided peak amplitude."""
    unit: str
    """Unit of the amplitude."""
    marks: tuple[Mark, ...]
    """Expected lines of shaft and pistons; empty if the speed is not known."""
    bands: tuple[tuple[float, float], ...] = ()
    """Band [Hz] of each channel's envelope."""
    angle_from: str = ""
    """Source of the shaft angle, for orders."""

    __repr__ = short_repr

    def at(self, mark: Mark) -> Float[np.ndarray, " channel"]:
        """Return the maximum of each channel within 0.6 %, or two lines, of a mark.

        It is NaN beyond the end of the spectrum.
        """
        if mark.position > self.position[-1]:
            return np.full(len(self.channels), math.nan)
        line_width = float(self.position[1] - self.position[0])
        tolerance = max(MARK_TOLERANCE * mark.position, 2 * line_width)
        is_near = np.abs(self.position - mark.position) <= tolerance
        largest: np.ndarray = self.amplitude[:, is_near].max(axis=1)
        return largest


def spectrum_of(
    recording: Recording,
    kind: LineSpectrumKind = "amplitude",
    *,
    angle: ShaftAngle | None = None,
    pistons: int | None = None,
    band: tuple[float, float] | None = None,
    resolution: float = 0.0,
) -> LineSpectrum:
    """Return the spectrum of each channel, with the lines of shaft and pistons marked.

    The Hann taper is corrected for.

    Parameters
    ----------
    kind : ``amplitude`` and ``envelope`` over frequency, ``order`` over multiples of the shaft
        (along its angle).
    angle : shaft angle from a tachometer or a followed line; without it, orders use the specified
        speed.
    pistons : number of pistons, for the marks.
    band : edges [Hz] for the envelope; by default the kurtogram's for each channel.
    resolution : spacing of the lines of an amplitude spectrum [Hz]; 0 transforms the whole
        recording at once.

    Raises
    ------
    InputError
        No speed for orders, or an invalid band.
    DataError
        The recording is unfit.
    """
    require_usable(recording)
    if angle is None:
        shaft = specified_shaft_frequency(recording)
    else:
        shaft = angle.mean_speed / (2 * math.pi)

    axis = "frequency"
    axis_unit = "Hz"
    bands: tuple[tuple[float, float], ...] = ()
    angle_source = ""
    if kind == "amplitude":
        position, amplitude = amplitude_spectrum(
            recording.signal, recording.sample_rate, resolution
        )
    elif kind == "envelope":
        position, amplitude, edges = envelope_spectrum(
            recording.signal, recording.sample_rate, band
        )
        bands = tuple((float(low), float(high)) for low, high in edges)
    else:
        if angle is None:
            angle = specified_angle(recording)
        steady = resample_by_angle(recording, angle)
        samples_per_turn = float(steady.attributes["samples_per_turn"])
        position, amplitude = amplitude_spectrum(steady.signal, samples_per_turn)
        axis = "order"
        axis_unit = ""
        shaft = 1.0
        angle_source = angle.source

    return LineSpectrum(
        kind=kind,
        recording_id=recording.recording_id,
        channels=recording.channels,
        axis=axis,
        axis_unit=axis_unit,
        position=position,
        amplitude=amplitude,
        unit=recording.unit,
        marks=_expected_marks(shaft, pistons),
        bands=bands,
        angle_from=angle_source,
    )


def _expected_marks(shaft: float | None, pistons: int | None) -> tuple[Mark, ...]:
    """Return the marks at a shaft frequency, in the unit of the axis."""
    if shaft is None:
        return ()

    marks = []
    for order in range(1, SHAFT_MARKS + 1):
        marks.append(Mark(order * shaft, f"{order}x", of_pistons=False))
    if pistons is not None:
        for passes in range(1, PISTON_MARKS + 1):
            order = pistons * passes
            marks.append(Mark(order * shaft, f"{order}x", of_pistons=True))
    return tuple(marks)
