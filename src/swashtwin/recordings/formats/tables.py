"""Columns of a table: what their headings say, and what the one with the time says."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, snapped_rate
from swashtwin.recordings.samples import BLOCK, Column

_BRACKET = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]+?)\s*[\])]$")
_TRADE_UNITS = ("s", "ms", "us", "g", "mg", "m/s^2", "m/s2", "m/s²", "mm/s^2", "mm/s", "V", "mV", "Pa", "bar")
_ENOUGH = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}
"""Seconds of each unit of time; there is none that one wrong letter turns into another."""
_TIME_NAMES = ("time", "t", "zeit")


def timed_columns(
    path: Path,
    columns: Mapping[str, Column],
    units: Mapping[str, str],
    attributes: Mapping[str, str],
    options: Options,
) -> RawFile:
    """The columns without the one that holds the time, which becomes the rate."""
    name = _time_name(path, list(columns), options)
    if name is None:
        return RawFile(columns, units=units, attributes=attributes)
    others = {other: column for other, column in columns.items() if other != name}
    rate, gaps = read_time_column(path, columns[name][:] * _seconds(units.get(name, "s"), path))
    units = {other: unit for other, unit in units.items() if other != name}
    return RawFile(others, rate, units, {**attributes, **({"time_gaps": gaps} if gaps else {})})


def _seconds(unit: str, path: Path) -> float:
    if unit not in _TIMES:
        raise DataError(f"{path}: the time column is in {unit!r}, which is none of {', '.join(_TIMES)}; name another.")
    return _TIMES[unit]


def read_time_column(path: Path, seconds: Float[np.ndarray, " time"]) -> tuple[float, str]:
    """Sample rate [Hz] of a time column, and what is wrong with its spacing (empty where nothing is)."""
    if len(seconds) < 3 or not np.isfinite(seconds).all() or not seconds[-1] > seconds[0]:
        raise DataError(f"{path}: the time column does not rise from its first to its last sample.")
    head = seconds[:1000]
    digits = next((d for d in range(12) if np.abs(head - np.round(head, d)).max() < 1e-12), 12)
    quantum = 10.0**-digits
    step = _step(seconds, quantum)
    drift = _drift(seconds, step)
    if drift <= max(0.5 * step, 1.01 * quantum):
        return snapped_rate(step, max(1e-6, min(quantum, 4 * drift) / (seconds[-1] - seconds[0]))), ""
    steps = np.diff(seconds)
    usual = float(np.median(steps))
    if usual <= 0:
        raise DataError(f"{path}: most steps of the time column are zero or negative; name another time_column.")
    odd = np.flatnonzero(np.abs(steps - usual) > 0.5 * usual + quantum)
    rate = snapped_rate(usual, max(1e-6, min(0.01, quantum / usual)))
    if len(odd) == 0:
        return rate, f"steps drift between {steps.min():.6g} s and {steps.max():.6g} s"
    worst = odd[np.argmax(np.abs(steps[odd] - usual))]
    return rate, (
        f"{len(odd)} of {len(steps)} steps differ from the usual {usual:.6g} s; "
        f"the worst is {steps[worst]:.6g} s at {seconds[worst]:.6g} s"
    )


def _step(seconds: Float[np.ndarray, " time"], quantum: float) -> float:
    """Time between two samples [s]: from the first and the last, unless the others contradict them."""
    span, half = float(seconds[-1] - seconds[0]), len(seconds) // 2
    step = span / (len(seconds) - 1)
    some = np.arange(0, len(seconds) - half, 1 + len(seconds) // _ENOUGH)
    usual = float(np.median(seconds[some + half] - seconds[some])) / half
    return step if abs(step - usual) * len(seconds) <= 4 * quantum + 1e-9 * span else max(usual, 1e-300)


def _drift(seconds: Float[np.ndarray, " time"], step: float) -> float:
    """How far the time strays from even steps [s], looked at in parts: a long column leaves no room for another."""
    some = np.arange(0, len(seconds), 1 + len(seconds) // _ENOUGH)
    origin = float(np.median(seconds[some] - step * some))
    parts = range(0, len(seconds), BLOCK)
    strayed = (seconds[at : at + BLOCK] - origin - step * np.arange(at, min(at + BLOCK, len(seconds))) for at in parts)
    return max(float(np.abs(part).max()) for part in strayed)


def split_unit(text: str) -> tuple[str, str | None]:
    """Name and unit of a column heading such as ``acceleration [g]``."""
    match = _BRACKET.match(text)
    if match and (match[2] in _TRADE_UNITS or (text.endswith("]") and known_unit(match[2]))):
        return match[1], match[2]
    return text, None


def _time_name(path: Path, names: Sequence[str], options: Options) -> str | None:
    stated = options.time_column
    if stated is None:
        return names[0] if len(names) > 1 and names[0].lower() in _TIME_NAMES else None
    if isinstance(stated, int) and 0 <= stated < len(names):
        return names[stated]
    if isinstance(stated, str) and split_unit(stated)[0] in names:
        return split_unit(stated)[0]
    raise DataError(f"{path} has no column {stated!r} for time_column; it has {', '.join(names)}.")
