"""Figures of the page as SVG, colored by its style sheet; its script adds zoom and the value at the
pointer.

The field of a figure is stretched to the width of the page. So horizontal places are shares of the
width, vertical ones pixels, and texts stand outside the field.
"""

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from markupsafe import Markup, escape

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.history.reading import Trend
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.page.site import Site
from swashtwin.recordings import Recording

HEIGHT = 240.0
"""Height of a field [px]."""
BAND_SPREADS = 3.0
"""Half width of the baseline's band in spreads of the healthy recordings."""
_WIDTH = 1000.0
"""Width of a field, in units that are stretched."""
_LINE, _BOTTOM = 16.0, 22.0
"""Space above a field for one line of text, and below it [px]."""
_CLOSEST = 0.05
"""Distance of the names of two marks at least, over the width."""
_MOST_TICKS = 6
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MINUTE, _DAY = 60, 86_400
_TIME_STEPS = (
    *(minutes * _MINUTE for minutes in (1, 5, 15, 60, 180, 360, 720)),
    *(days * _DAY for days in (1, 2, 7, 14, 30, 91, 365)),
)
"""Distances of marked times [s]."""
MOST_HEALTHY = 8
"""Healthy recordings that a spectrum is compared with."""
RESOLUTION = 2.0
"""Spacing of the lines [Hz]."""
LINES = 1600
"""Points drawn of one spectrum; each is the greatest line of its group."""
_MARKS = 4


class Axis(NamedTuple):
    """Range of an axis: numbers, their logarithms to base 10, or seconds since 1970."""

    low: float
    high: float
    kind: str = ""
    """Empty, ``log`` or ``time``."""

    @classmethod
    def around(cls, *values: Iterable[float], kind: str = "") -> "Axis":
        """The range of all finite values and a twentieth more at each end."""
        numbers = np.concatenate([np.asarray(tuple(part), np.float64) for part in values])
        if kind == "log":
            with np.errstate(divide="ignore", invalid="ignore"):
                numbers = np.log10(numbers)
        numbers = numbers[np.isfinite(numbers)]
        low, high = (float(numbers.min()), float(numbers.max())) if numbers.size else (0.0, 1.0)
        margin = 0.05 * (high - low) or (_DAY if kind == "time" else 0.5)
        return cls(low - margin, high + margin, kind)

    def share(self, values: Float[np.ndarray, "*point"] | float) -> Float[np.ndarray, "*point"]:
        """How far from the low to the high end values lie, of a number one without a dimension; NaN
        where a logarithm has none.
        """
        numbers = np.asarray(values, np.float64)
        if self.kind == "log":
            numbers = np.log10(np.where(numbers > 0, numbers, np.nan))
        return np.asarray((numbers - self.low) / (self.high - self.low))

    def ticks(self) -> list[tuple[float, str]]:
        """(share, text) of round values."""
        span = self.high - self.low
        if self.kind == "time":
            year = _TIME_STEPS[-1]
            years = year * math.ceil(span / year / _MOST_TICKS)
            step: float = next((step for step in _TIME_STEPS if span / step <= _MOST_TICKS), years)
        elif self.kind == "log":
            step = max(1, math.ceil(span / _MOST_TICKS))
        else:
            power = 10.0 ** math.floor(math.log10(span / _MOST_TICKS))
            step = next(
                power * factor
                for factor in (1, 2, 5, 10, 20)
                if span / (power * factor) <= _MOST_TICKS
            )
        numbers = np.arange(math.ceil(self.low / step), math.floor(self.high / step) + 1) * step
        shares = np.clip(
            (numbers - self.low) / span, 0, 1
        )  # a value at an end may round to one past it
        return [
            (float(share), self._text(float(number), step))
            for share, number in zip(shares, numbers, strict=True)
        ]

    def _text(self, number: float, step: float) -> str:
        if self.kind == "time":
            return datetime.fromtimestamp(number, UTC).strftime(
                "%H:%M" if step < _DAY else "%Y-%m-%d"
            )
        if self.kind == "log":
            plain = {-1: "0.1", 0: "1", 1: "10", 2: "100"}
            return plain.get(round(number), f"10{str(round(number)).translate(_SUPERSCRIPTS)}")
        return f"{number:.4g}".replace("-", "−")


def draw(
    x: Axis,
    y: Axis,
    parts: Iterable[str],
    *,
    title: str,
    names: Sequence[tuple[float, str]] = (),
    **data: str,
) -> Markup:
    """An SVG element.

    Parameters
    ----------
    parts : what stands in the field, of `band`, `curve`, `level` and `mark`; escaped already.
    title : what the figure shows, for who does not see it, and above the vertical axis.
    names : (share of the width, name) of marks; one too close to an earlier one is left out.
    data : what the script needs to know: ``ids`` of the recordings, ``shaft`` [Hz], ``unit``.
    """
    top = (2 if names else 1) * _LINE
    bottom = top + HEIGHT
    texts = [f'<text class="title" x="4" y="12">{escape(title)}</text>']
    for share, text in y.ticks():
        height = bottom - share * HEIGHT
        texts.append(f'<line class="grid" x1="0" x2="100%" y1="{height:.1f}" y2="{height:.1f}"/>')
        if height > top + _LINE:
            texts.append(f'<text class="value" x="4" y="{height - 3:.1f}">{escape(text)}</text>')
    for share, text in x.ticks():
        if 0.02 < share < 0.98:
            texts.append(
                f'<text class="tick" x="{100 * share:.2f}%" y="{bottom + 16:.0f}">{escape(text)}</text>'
            )
    shown: list[float] = []
    for share, text in names:
        if all(abs(share - other) >= _CLOSEST for other in shown):
            place = f'data-at="{share:.4f}" x="{100 * share:.2f}%" y="{top - 4:.0f}"'
            texts.append(f'<text class="name" {place}>{escape(text)}</text>')
            shown.append(share)
    facts = {
        "x": f"{x.low!r} {x.high!r}",
        "x-kind": x.kind,
        "y": f"{y.low!r} {y.high!r}",
        "y-kind": y.kind,
        **data,
    }
    attributes = " ".join(f'data-{name}="{escape(value)}"' for name, value in facts.items())
    return Markup(
        f'<svg class="drawing" role="img" aria-label="{escape(title)}" height="{bottom + _BOTTOM:.0f}" {attributes}>'
        f'<svg class="field" y="{top:.0f}" height="{HEIGHT:.0f}" viewBox="0 0 {_WIDTH:.0f} {HEIGHT:.0f}" '
        f'preserveAspectRatio="none">{"".join(parts)}</svg>{"".join(texts)}</svg>'
    )


def curve(
    x: Float[np.ndarray, " point"], y: Float[np.ndarray, " point"], *, has_dots: bool = False
) -> str:
    """A line through points, both as shares; it is broken where there is none."""
    points = [
        None if math.isnan(b) else f"{_WIDTH * a:.1f} {(1 - b) * HEIGHT:.1f}"
        for a, b in zip(x, y, strict=True)
    ]
    pairs = zip([None, *points], points, strict=False)
    line = "".join(f"{'M' if last is None else 'L'}{point}" for last, point in pairs if point)
    dots = "".join(f"M{point}h0" for point in points if point) if has_dots else ""
    return f'<path class="main" d="{line}"/>' + (f'<path class="dots" d="{dots}"/>' if dots else "")


def band(
    x: Float[np.ndarray, " point"],
    low: Float[np.ndarray, " point"],
    high: Float[np.ndarray, " point"],
) -> str:
    """The area between two lines, all as shares; nothing where one has no value."""
    is_there = np.isfinite(low) & np.isfinite(high)
    there = [np.asarray(values)[is_there] for values in (x, low, high)]
    edge = [
        f"{_WIDTH * a:.1f} {(1 - b) * HEIGHT:.1f}" for a, b in zip(there[0], there[1], strict=True)
    ]
    back = [
        f"{_WIDTH * a:.1f} {(1 - b) * HEIGHT:.1f}" for a, b in zip(there[0], there[2], strict=True)
    ]
    return f'<path class="band" d="M{"L".join(edge + back[::-1])}Z"/>' if edge else ""


def level(share: float, role: str) -> str:
    """A horizontal line at a share of the height."""
    height = f"{(1 - share) * HEIGHT:.1f}"
    return f'<line class="{role}" x1="0" x2="{_WIDTH:.0f}" y1="{height}" y2="{height}"/>'


def mark(share: float, role: str) -> str:
    """A vertical line at a share of the width."""
    return f'<line class="{role}" x1="{_WIDTH * share:.1f}" x2="{_WIDTH * share:.1f}" y1="0" y2="{HEIGHT:.0f}"/>'


def draw_trend(
    trend: Trend,
    title: str,
    unit: str,
    alarms: Sequence[Alarm],
    *,
    baseline: tuple[float, float] | None = None,
    limit: float | None = None,
) -> Markup:
    """One indicator over time, with its baseline's band and the times at which alarms were raised.

    Parameters
    ----------
    title : name of the indicator.
    unit : of the indicator, empty where it has none.
    baseline : (median, spread) of the healthy baseline.
    limit : value at which an alarm is raised; the axis is then logarithmic.
    """
    edges: list[float] = []
    if baseline is not None:
        edges = [baseline[0] + sign * BAND_SPREADS * baseline[1] for sign in (-1, 1)]
    times = trend.times.astype("datetime64[ms]").astype(np.float64) / 1000
    x = Axis.around(times, kind="time")
    y = Axis.around(
        trend.values, edges, [] if limit is None else [limit], kind="" if limit is None else "log"
    )
    parts = []
    if baseline is not None:
        ends = np.array([0.0, 1.0])
        parts += [
            band(ends, *(np.full(2, y.share(edge)) for edge in edges)),
            level(float(y.share(baseline[0])), "median"),
        ]
    if limit is not None:
        parts.append(level(float(y.share(limit)), "alarm"))
    for alarm in alarms:
        share = float(x.share(alarm.opened.timestamp()))
        if 0 <= share <= 1:
            parts.append(mark(share, "sensor" if alarm.kind == "sensor" else "alarm"))
    heights = y.share(trend.values)
    parts.append(curve(x.share(times), heights, has_dots=True))
    ids = " ".join(str(number) for number in trend.ids[np.isfinite(heights)])
    return draw(x, y, parts, title=f"{title} [{unit}]" if unit else title, ids=ids, unit=unit)


def draw_spectrum(site: Site, stored: Judgment, healthy_ids: Sequence[int]) -> Sequence[Markup]:
    """A figure of each channel; none where the samples are not kept any more or have no
    spectrum.
    """
    try:
        recording = site.history.reader.waveform(stored.id)
        if recording is None:
            return ()
        frequency, amplitude = _lines(recording)
        machine = site.config.machine(stored.machine)
        pistons = machine.piston_count if machine else None
    except (SwashTwinError, OSError):
        return ()
    healthy = []
    for number in healthy_ids:
        with suppress(SwashTwinError, OSError):  # removed by retention meanwhile
            other = site.history.reader.waveform(number)
            if other is not None and (spectrum := _lines(other)[1]).shape == amplitude.shape:
                healthy.append(spectrum)
    x = Axis(0.0, float(frequency[-1]))
    shaft = None if stored.speed is None else stored.speed / (2 * math.pi)
    marks = []
    if shaft is not None:
        orders = [*(pistons * k for k in range(1, _MARKS + 1) if pistons), 1]
        marks = [
            (float(x.share(order * shaft)), f"{order}×")
            for order in orders
            if order * shaft < x.high
        ]
    figures = []
    for row, channel in enumerate(recording.channels):
        y = Axis.around(amplitude[row], *(spectrum[row] for spectrum in healthy), kind="log")
        parts = [mark(share, "mark") for share, _ in marks]
        if healthy:
            rows = np.array([spectrum[row] for spectrum in healthy])
            parts.append(
                band(x.share(frequency), y.share(rows.min(axis=0)), y.share(rows.max(axis=0)))
            )
        parts.append(curve(x.share(frequency), y.share(amplitude[row])))
        title = f"{channel} [{recording.unit}]" if recording.unit else channel
        known = {} if shaft is None else {"shaft": repr(shaft)}
        figures.append(
            draw(
                x,
                y,
                parts,
                title=f"{title} over frequency [Hz]",
                names=marks,
                unit=recording.unit,
                **known,
            )
        )
    return figures


def _lines(
    recording: Recording,
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, "channel line"]]:
    """Frequencies [Hz] and peak amplitudes, at most `LINES`."""
    resolution = max(RESOLUTION, recording.sample_rate / recording.signal.shape[-1])
    from swashtwin.signals import spectrum_of  # scipy's signal package takes a second to import

    spectrum = spectrum_of(recording, resolution=resolution)
    position, amplitude = spectrum.position[1:], spectrum.amplitude[:, 1:]
    group = math.ceil(len(position) / LINES)
    starts = np.arange(0, len(position), group)
    return position[starts], np.maximum.reduceat(amplitude, starts, axis=1)
