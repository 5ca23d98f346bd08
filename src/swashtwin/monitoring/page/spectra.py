"""The spectrum of one recording over those of healthy recordings of the same machine and operating point."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.history import History, Judgment
from swashtwin.monitoring.page.site import Site
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording

MOST_HEALTHY = 8
"""Healthy recordings that a spectrum is compared with."""
RESOLUTION = 2.0
"""Spacing of the lines [Hz]."""
MOST_POINTS = 1600
"""Points drawn of one spectrum; each is the greatest line of its group."""
_SEARCH = 200
_MARKS = 4


@dataclass(frozen=True, eq=False)
class SpectrumComparison:
    """Amplitudes of a recording, and the range of those of healthy ones."""

    channels: tuple[str, ...]
    """Channels."""
    unit: str
    """Unit of the amplitudes."""
    frequency: Float[np.ndarray, " line"]
    """Frequency of each point [Hz]."""
    amplitude: Float[np.ndarray, "channel line"]
    """Peak amplitudes of this recording."""
    lowest: Float[np.ndarray, "channel line"]
    """Least amplitude of the healthy recordings; NaN where there is none."""
    highest: Float[np.ndarray, "channel line"]
    """Greatest amplitude of the healthy recordings; NaN where there is none."""
    n_healthy: int
    """Healthy recordings."""
    shaft: float | None
    """Shaft frequency [Hz]."""
    marks: tuple[tuple[float, str], ...]
    """Frequencies [Hz] of the shaft's and the pistons' lines, and their names."""

    @property
    def end(self) -> float:
        """End of the axis [Hz]."""
        return float(self.frequency[-1])

    def orders(self) -> list[str]:
        """Order of each point as an addition to its frequency; empty where the speed is not known."""
        if self.shaft is None:
            return [""] * len(self.frequency)
        return [f" ({frequency / self.shaft:.2f}×)" for frequency in self.frequency.tolist()]


def compared_spectrum(site: Site, stored: Judgment) -> SpectrumComparison | None:
    """Spectrum of a stored recording; None where its samples are not kept any more or have none, as a dead channel."""
    history = site.history
    recording = history.read.waveform(stored.id)
    if recording is None:
        return None
    try:
        frequency, amplitude = _points(recording)
    except SwashTwinError:
        return None  # such as a dead channel
    healthy = [
        spectrum
        for identity in _healthy_ids(history, stored)
        if (spectrum := _stored_points(history, identity)) is not None and spectrum.shape == amplitude.shape
    ]
    nothing = np.full_like(amplitude, math.nan)
    shaft = None if stored.speed is None else stored.speed / (2 * math.pi)
    return SpectrumComparison(
        recording.channels,
        recording.unit,
        frequency,
        amplitude,
        np.min(healthy, axis=0) if healthy else nothing,
        np.max(healthy, axis=0) if healthy else nothing,
        len(healthy),
        shaft,
        _marks(shaft, _pistons(site, stored.machine), float(frequency[-1])),
    )


def _healthy_ids(history: History, stored: Judgment) -> Sequence[int]:
    """Healthy recordings of the same operating point with samples, those of the baseline first."""
    ids: list[int] = []
    for state in ("learning", "normal"):
        others = history.read.recordings(stored.machine, point=stored.point, state=state, limit=_SEARCH)
        ids += [other.id for other in others if other.waveform is not None and other.id != stored.id]
    return ids[:MOST_HEALTHY]


def _stored_points(history: History, identity: int) -> Float[np.ndarray, "channel line"] | None:
    try:
        recording = history.read.waveform(identity)
        return None if recording is None else _points(recording)[1]
    except (SwashTwinError, OSError):
        return None  # removed by retention meanwhile


def _points(recording: Recording) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, "channel line"]]:
    """Frequencies [Hz] and amplitudes, at most `MOST_POINTS`."""
    resolution = max(RESOLUTION, recording.sample_rate / recording.signal.shape[-1])
    from swashtwin.signals import spectrum_of  # scipy's signal package takes a second to import

    spectrum = spectrum_of(recording, resolution=resolution)
    position, amplitude = spectrum.position[1:], spectrum.amplitude[:, 1:]
    group = math.ceil(len(position) / MOST_POINTS)
    starts = np.arange(0, len(position), group)
    return position[starts], np.maximum.reduceat(amplitude, starts, axis=1)


def _pistons(site: Site, name: str) -> int | None:
    machine = site.config.machine(name)
    try:
        return None if machine is None or machine.pump is None else load_pump(machine.pump).rotating_group.piston_count
    except (SwashTwinError, OSError):
        return None


def _marks(shaft: float | None, pistons: int | None, end: float) -> tuple[tuple[float, str], ...]:
    if shaft is None:
        return ()
    orders = [1, *(pistons * k for k in range(1, _MARKS + 1))] if pistons else [1]
    return tuple((order * shaft, f"{order}×") for order in orders if order * shaft < end)
