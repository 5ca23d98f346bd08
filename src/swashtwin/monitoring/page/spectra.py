"""The spectrum of one recording over those of healthy recordings of the same machine and operating point."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.history.tables import Judgment
from swashtwin.monitoring.page.charts import Axis, band, curve, draw, mark
from swashtwin.monitoring.page.site import Site
from swashtwin.recordings import Recording

MOST_HEALTHY = 8
"""Healthy recordings that a spectrum is compared with."""
RESOLUTION = 2.0
"""Spacing of the lines [Hz]."""
MOST_POINTS = 1600
"""Points drawn of one spectrum; each is the greatest line of its group."""
_SEARCH = 200
_MARKS = 4


def healthy_recordings(site: Site, stored: Judgment) -> Sequence[int]:
    """Healthy recordings of the same operating point with samples, those of the baseline first."""
    ids: list[int] = []
    for state in ("learning", "normal"):
        others = site.history.read.recordings(stored.machine, point=stored.point, state=state, limit=_SEARCH)
        ids += [other.id for other in others if other.waveform is not None and other.id != stored.id]
    return ids[:MOST_HEALTHY]


def draw_spectrum(site: Site, stored: Judgment, healthy_ids: Sequence[int]) -> Sequence[Markup]:
    """A figure of each channel; none where the samples are not kept any more or have no spectrum."""
    try:
        recording = site.history.read.waveform(stored.id)
        if recording is None:
            return ()
        frequency, amplitude = _points(recording)
        machine = site.config.machine(stored.machine)
        pistons = machine.piston_count if machine else None
    except (SwashTwinError, OSError):
        return ()
    others = [_stored_points(site, number) for number in healthy_ids]
    healthy = [spectrum for spectrum in others if spectrum is not None and spectrum.shape == amplitude.shape]
    x = Axis(0.0, float(frequency[-1]))
    shaft = None if stored.speed is None else stored.speed / (2 * math.pi)
    marks = _marks(shaft, pistons, x)
    figures = []
    for row, channel in enumerate(recording.channels):
        y = Axis.around(amplitude[row], *(spectrum[row] for spectrum in healthy), kind="log")
        parts = [mark(share, "mark") for share, _ in marks]
        if healthy:
            rows = np.array([spectrum[row] for spectrum in healthy])
            parts.append(band(x.share(frequency), y.share(rows.min(axis=0)), y.share(rows.max(axis=0))))
        parts.append(curve(x.share(frequency), y.share(amplitude[row])))
        title = f"{channel} [{recording.unit}]" if recording.unit else channel
        known = {} if shaft is None else {"shaft": repr(shaft)}
        figures.append(
            draw(x, y, parts, title=f"{title} over frequency [Hz]", names=marks, unit=recording.unit, **known)
        )
    return figures


def _stored_points(site: Site, identity: int) -> Float[np.ndarray, "channel line"] | None:
    try:
        recording = site.history.read.waveform(identity)
        return None if recording is None else _points(recording)[1]
    except (SwashTwinError, OSError):
        return None  # removed by retention meanwhile


def _points(recording: Recording) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, "channel line"]]:
    """Frequencies [Hz] and peak amplitudes, at most `MOST_POINTS`."""
    resolution = max(RESOLUTION, recording.sample_rate / recording.signal.shape[-1])
    from swashtwin.signals import spectrum_of  # scipy's signal package takes a second to import

    spectrum = spectrum_of(recording, resolution=resolution)
    position, amplitude = spectrum.position[1:], spectrum.amplitude[:, 1:]
    group = math.ceil(len(position) / MOST_POINTS)
    starts = np.arange(0, len(position), group)
    return position[starts], np.maximum.reduceat(amplitude, starts, axis=1)


def _marks(shaft: float | None, pistons: int | None, x: Axis) -> list[tuple[float, str]]:
    """(share of the axis, name) of the lines of the shaft and the pistons, those of the pistons first."""
    if shaft is None:
        return []
    orders = [*(pistons * k for k in range(1, _MARKS + 1) if pistons), 1]
    return [(float(x.share(order * shaft)), f"{order}×") for order in orders if order * shaft < x.high]
