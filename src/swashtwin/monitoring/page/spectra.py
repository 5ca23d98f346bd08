"""Spectra of recordings over those of healthy recordings, over shaft orders or frequency."""

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.monitoring.page.axis import Axis
from swashtwin.monitoring.page.charts import (
    Mark,
    draw_band,
    draw_curve,
    draw_figure,
    draw_vertical,
    with_unit,
)
from swashtwin.monitoring.page.site import Site
from swashtwin.recordings import Recording, specified_shaft_frequency

MAX_HEALTHY = 8
"""Healthy recordings that a spectrum is compared with."""
MIN_RESOLUTION_HZ = 2.0
"""Smallest distance of a spectrum's lines, unless the shaft turns slowly."""
LINES_PER_ORDER = 12
"""Lines of a spectrum between two shaft orders, if the recording is long enough."""
MAX_LINES = 1600
"""Points of one drawn spectrum, each the largest line of its group; a screen shows no more."""
MARKED_HARMONICS = 4
"""Harmonics of the piston-pass frequency that are marked; an axis of orders ends after them."""
END_ORDER = 60.0
"""End of an axis of orders if the number of pistons is not known."""

# Space beyond the last marked line, as a factor.
_END_MARGIN = 1.1


class _Lines(NamedTuple):
    """Lines of one recording."""

    frequency: Float[np.ndarray, " line"]
    """Frequencies [Hz], evenly spaced from the first line above zero."""
    amplitude: Float[np.ndarray, "channel line"]
    """Peak amplitudes."""
    shaft_hz: float | None
    """Frequency of the shaft, if it is specified."""

    def near(self, positions: Float[np.ndarray, " point"]) -> Float[np.ndarray, "channel point"]:
        """Return the amplitudes of the lines next to frequencies [Hz]."""
        indices = np.round(positions / self.frequency[0]).astype(int) - 1
        return self.amplitude[:, np.clip(indices, 0, len(self.frequency) - 1)]


def draw_spectra(
    site: Site,
    judgment: Judgment,
    healthy_ids: Sequence[int],
    *,
    is_over_orders: bool = True,
    channel: str | None = None,
) -> Sequence[Markup]:
    """Return a figure of each channel's spectrum over those of healthy recordings.

    The result is empty if the samples are no longer stored or have no spectrum.

    Parameters
    ----------
    is_over_orders : whether the axis is one of shaft orders, which ends a little beyond the marked
        lines of the pistons; otherwise, and if the speed is not known, it is one of frequency.
    channel : the only channel that is drawn; by default all of them.
    """
    try:
        recording = site.history.reader.waveform(judgment.id)
        if recording is None:
            return ()
        lines = _read_lines(recording)
        machine = site.config.machine(judgment.machine)
        piston_count = None
        if machine is not None:
            piston_count = machine.piston_count
    except (SwashTwinError, OSError):
        return ()

    unit_hz = 1.0
    x = Axis(0.0, float(lines.frequency[-1]))
    axis_title = "frequency [Hz]"
    if is_over_orders and lines.shaft_hz is not None:
        unit_hz = lines.shaft_hz
        x = Axis(0.0, min(_end_order(piston_count), x.high / unit_hz), "order")
        axis_title = "shaft orders"

    is_shown = lines.frequency <= x.high * unit_hz
    position = lines.frequency[is_shown] / unit_hz
    amplitude = lines.amplitude[:, is_shown]
    starts = np.arange(0, len(position), math.ceil(len(position) / MAX_LINES))
    healthy = [
        np.maximum.reduceat(healthy_lines.near(position * healthy_unit), starts, axis=1)
        for healthy_lines, healthy_unit in _read_healthy_lines(site, healthy_ids, recording, x)
    ]
    position = position[starts]
    amplitude = np.maximum.reduceat(amplitude, starts, axis=1)

    marks: list[Mark] = []
    shaft_text = ""
    if lines.shaft_hz is not None:
        marks = _order_marks(x, lines.shaft_hz / unit_hz, piston_count)
        shaft_text = repr(lines.shaft_hz)

    figures = []
    for row, name in enumerate(recording.channels):
        if channel not in (None, name):
            continue
        y = Axis.around(amplitude[row], *(lines[row] for lines in healthy), kind="log")
        parts = [draw_vertical(mark.share, mark.role) for mark in marks]
        if healthy:
            low = y.share(np.min([lines[row] for lines in healthy], axis=0))
            high = y.share(np.max([lines[row] for lines in healthy], axis=0))
            parts.append(draw_band(x.share(position), low, high))
        parts.append(draw_curve(x.share(position), y.share(amplitude[row])))

        title = f"{with_unit(name, recording.unit)} over {axis_title}"
        figures.append(
            draw_figure(
                x, y, parts, title=title, marks=marks, unit=recording.unit, shaft=shaft_text
            )
        )
    return figures


def _end_order(piston_count: int | None) -> float:
    if piston_count is None:
        return END_ORDER
    return _END_MARGIN * MARKED_HARMONICS * piston_count


def _read_healthy_lines(
    site: Site, healthy_ids: Iterable[int], recording: Recording, x: Axis
) -> list[tuple[_Lines, float]]:
    """Return the lines of healthy recordings with the given channels, and their unit of `x` [Hz].

    Lines at the same order are compared, although the speeds differ a little.
    """
    spectra = []
    for number in healthy_ids:
        # Retention may remove the samples at any time.
        with suppress(SwashTwinError, OSError):
            healthy = site.history.reader.waveform(number)
            if healthy is None or healthy.channels != recording.channels:
                continue
            lines = _read_lines(healthy)
            unit_hz = lines.shaft_hz if x.kind == "order" else 1.0
            # Beyond half of the sample rate there would be no line.
            if unit_hz is not None and x.high * unit_hz <= _END_MARGIN * lines.frequency[-1]:
                spectra.append((lines, unit_hz))
    return spectra


def _order_marks(x: Axis, shaft: float, piston_count: int | None) -> list[Mark]:
    """Return marks at the harmonics of the piston-pass frequency and at the shaft frequency.

    Parameters
    ----------
    shaft : shaft frequency in the unit of the axis.
    """
    marks = [Mark(float(x.share(shaft)), "1×")]
    if piston_count:
        marks = [
            Mark(float(x.share(order * shaft)), f"{order}×", "piston")
            for order in piston_count * np.arange(1, MARKED_HARMONICS + 1)
        ] + marks
    return [mark for mark in marks if mark.share < 1]


def _read_lines(recording: Recording) -> _Lines:
    from swashtwin.signals import spectrum_of  # scipy's signal package takes a second to import

    shaft_hz = specified_shaft_frequency(recording) or None
    resolution = MIN_RESOLUTION_HZ
    if shaft_hz is not None:
        resolution = min(resolution, shaft_hz / LINES_PER_ORDER)
    resolution = max(resolution, recording.sample_rate / recording.signal.shape[-1])
    spectrum = spectrum_of(recording, resolution=resolution)

    # Without the line at 0 Hz, which is the mean.
    return _Lines(spectrum.position[1:], spectrum.amplitude[:, 1:], shaft_hz)
