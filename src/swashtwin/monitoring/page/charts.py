"""Figures of the page as plain data for plotly; the browser adds the colors of its light or dark theme by role."""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.monitoring.history import Alarm, Trend
from swashtwin.monitoring.page.spectra import SpectrumComparison

BAND_SPREADS = 3.0
"""Half width of the baseline's band in spreads of the healthy recordings."""

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

Figure = dict[str, Any]


def trend_figure(
    trend: Trend,
    title: str,
    unit: str,
    alarms: Sequence[Alarm],
    *,
    band: tuple[float, float] | None = None,
    limit: float | None = None,
) -> Figure:
    """One indicator over time, with its baseline's band and the times at which alarms were raised.

    Parameters
    ----------
    title : name of the indicator.
    unit : of the indicator, empty where it has none.
    band : (median, spread) of the baseline.
    limit : value at which an alarm is raised; the axis is then logarithmic.
    """
    shapes: list[dict[str, Any]] = [
        _vertical(alarm.opened, "sensor" if alarm.kind == "sensor" else "alarm") for alarm in alarms
    ]
    traces: list[dict[str, Any]] = []
    if band is not None:
        median, spread = band
        low, high = median - BAND_SPREADS * spread, median + BAND_SPREADS * spread
        times = _times(trend)
        ends = times[:1] + times[-1:]
        name = f"Healthy baseline ± {BAND_SPREADS:g} spreads"
        edge = {"type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "legendgroup": "band"}
        traces += [
            {**edge, "x": ends, "y": [low, low], "showlegend": False, "meta": {"role": "edge"}},
            {**edge, "x": ends, "y": [high, high], "fill": "tonexty", "name": name, "meta": {"role": "band"}},
        ]
        shapes.append(_horizontal(median, "median"))
    if limit is not None:
        shapes.append(_horizontal(limit, "alarm"))
    traces.append(
        {
            "type": "scatter",
            "mode": "lines+markers",
            "x": _times(trend),
            "y": [value if math.isfinite(value) else None for value in trend.values.tolist()],
            "customdata": [int(identity) for identity in trend.ids],
            "marker": {"size": 5},
            "line": {"width": 1.5},
            "name": title,
            "hovertemplate": f"%{{x}}<br>%{{y:.3~g}} {unit}<extra></extra>",
            "meta": {"role": "main"},
        }
    )
    axis: dict[str, Any] = {"title": {"text": f"{title} [{unit}]" if unit else title}}
    if limit is not None:
        axis |= _decades()
    return {
        "data": traces,
        "layout": {"yaxis": axis, "xaxis": {"type": "date"}, "shapes": shapes, "showlegend": band is not None},
    }


def spectrum_figure(comparison: SpectrumComparison) -> Figure:
    """The spectrum of each channel over those of healthy recordings, one panel each."""
    count = len(comparison.channels)
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"shapes": [], "annotations": [], "showlegend": True, "panels": count}
    gap = 0.06 if count > 1 else 0.0
    height = (1 - gap * (count - 1)) / count
    x = comparison.frequency.tolist()
    healthy = f"Healthy recordings ({comparison.n_healthy})"
    for row, channel in enumerate(comparison.channels):
        suffix = "" if row == 0 else str(row + 1)
        top = 1 - row * (height + gap)
        layout[f"yaxis{suffix}"] = {
            "domain": [max(0.0, top - height), top],
            **_decades(),
            "title": {"text": f"{channel} [{comparison.unit}]" if comparison.unit else channel},
        }
        common = {"type": "scatter", "mode": "lines", "x": x, "xaxis": "x", "yaxis": f"y{suffix}"}
        shown = {"showlegend": row == 0}
        if comparison.n_healthy:
            faint = {**common, "line": {"width": 0}, "hoverinfo": "skip", "legendgroup": "healthy"}
            low, high = _positive(comparison.lowest[row]), _positive(comparison.highest[row])
            traces += [
                {**faint, "y": low, "showlegend": False, "meta": {"role": "edge"}},
                {**faint, "y": high, "fill": "tonexty", "name": healthy, "meta": {"role": "band"}, **shown},
            ]
        traces.append(
            {
                **common,
                "y": _positive(comparison.amplitude[row]),
                "line": {"width": 1},
                "name": "This recording",
                "legendgroup": "recording",
                "hovertemplate": f"{channel}: %{{x:.0f}} Hz%{{text}}<br>%{{y:.2e}} {comparison.unit}<extra></extra>",
                "text": comparison.orders(),
                "meta": {"role": "main"},
                **shown,
            }
        )
    for frequency, text in comparison.marks:
        layout["shapes"].append({**_line("mark"), "x0": frequency, "x1": frequency, "yref": "paper", "y0": 0, "y1": 1})
        layout["annotations"].append(
            {"x": frequency, "y": 1, "yref": "paper", "yanchor": "bottom", "text": text, "showarrow": False}
        )
    layout["xaxis"] = {
        "title": {"text": "Frequency [Hz]"},
        "anchor": f"y{count if count > 1 else ''}",
        "range": [0, comparison.end],
    }
    return {"data": traces, "layout": layout}


def sparkline(values: Sequence[float], limit: float, width: int = 120, height: int = 28) -> Mapping[str, Any] | None:
    """Points of a small line of the evidence on a logarithmic scale up to `limit`; None for fewer than two values."""
    finite = [value for value in values if math.isfinite(value)]
    if len(finite) < 2:
        return None
    top = math.log10(max(limit, *finite)) + 0.2
    bottom = min(-1.0, math.log10(max(min(finite), 1e-6)))
    scale = (height - 4) / (top - bottom)
    heights = [height - 2 - (math.log10(max(value, 1e-6)) - bottom) * scale for value in finite]
    step = (width - 4) / (len(finite) - 1)
    points = " ".join(f"{2 + index * step:.1f},{y:.1f}" for index, y in enumerate(heights))
    return {
        "points": points,
        "limit": round(height - 2 - (math.log10(limit) - bottom) * scale, 1),
        "width": width,
        "height": height,
    }


def _decades() -> dict[str, Any]:
    """A logarithmic axis with powers of ten in plain signs: raised text would need a style in the page."""
    exponents = range(-9, 10)
    names = {-1: "0.1", 0: "1", 1: "10", 2: "100"}
    texts = [names.get(exponent, f"10{str(exponent).translate(_SUPERSCRIPTS)}") for exponent in exponents]
    return {"type": "log", "tickvals": [10.0**exponent for exponent in exponents], "ticktext": texts}


def _times(trend: Trend) -> list[str]:
    return [f"{time}Z" for time in np.datetime_as_string(trend.times, unit="ms").tolist()]


def _positive(values: Float[np.ndarray, " line"]) -> list[float | None]:
    """Values with four digits for a logarithmic axis."""
    return [float(f"{value:.4g}") if value > 0 else None for value in values.tolist()]


def _line(role: str) -> dict[str, Any]:
    return {"type": "line", "line": {"width": 1.5, "dash": "dot" if role == "median" else "dash"}, "name": role}


def _horizontal(value: float, role: str) -> dict[str, Any]:
    return {**_line(role), "xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value}


def _vertical(time: datetime, role: str) -> dict[str, Any]:
    return {**_line(role), "yref": "paper", "y0": 0, "y1": 1, "x0": time.isoformat(), "x1": time.isoformat()}
