"""Columns of a table: what their headings say, and what the one with the time says."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import BLOCK, Column
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, snapped_rate

_BRACKET = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]+?)\s*[\])]$")
_AFTER_WORD = re.compile(r"^(.*\S)(?:\s+/\s+|\s+in\s+)(\S+)$")
TRADE_UNITS = (
    "s", "ms", "us", "µs", "g", "mg", "m/s^2", "m/s2", "m/s²", "mm/s^2", "mm/s2", "mm/s²", "mm/s", "V", "mV", "A", "mA",
    "Pa", "kPa", "MPa", "bar", "mbar", "psi", "N", "kN", "Nm", "rpm", "RPM", "1/min", "U/min", "min-1", "Hz", "kHz",
    "°C", "degC", "m3/h", "l/min",
)  # fmt: skip
"""Units that a heading or a second line of headings names without square brackets."""
_ENOUGH = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}
"""Seconds of each unit of time; there is none that one wrong letter turns into another."""
_TIME_NAMES = ("time", "t", "zeit")
_COARSE = 5e-3
"""Relative doubt about a rate beyond which a time column does not state it."""


def timed_columns(
    path: Path,
    columns: Mapping[str, Column],
    units: Mapping[str, str],
    attributes: Mapping[str, str],
    options: Options,
) -> RawFile:
    """The columns without the one that holds the time, which becomes the rate."""
    name = time_name(path, list(columns), options)
    if name is None:
        return RawFile(columns, units=units, attributes=attributes)
    others = {other: column for other, column in columns.items() if other != name}
    rate, gaps = read_time_column(path, columns[name], _seconds(units.get(name, "s"), path))
    units = {other: unit for other, unit in units.items() if other != name}
    return RawFile(others, rate, units, {**attributes, **({"time_gaps": gaps} if gaps else {})})


def timed_variables(path: Path, raw: RawFile, options: Options) -> RawFile:
    """Vectors of a workspace without the one that holds the time, which gives the rate where none is stated.

    Raises
    ------
    DataError
        The rate of the times is another than one that the file states.
    """
    if options.time_column is not None:
        name = time_name(path, list(raw.columns), options)
    else:
        name = _time_vector(raw.columns, rising=bool(raw.rates))
    if name is None:
        return raw
    columns = {name: raw.columns[name], **raw.columns}
    units = {other: unit for other, unit in raw.units.items() if other != name or unit in TIME_UNITS}
    timed = timed_columns(path, columns, units, raw.attributes, replace(options, time_column=name))
    if not raw.rates:
        return timed
    rates = {other: rate for other, rate in raw.rates.items() if other != name}
    for other, rate in rates.items():
        if timed.sample_rate is not None and not math.isclose(rate, timed.sample_rate, rel_tol=_COARSE):
            raise DataError(
                f"{path} states two sample rates for {other}: {rate:g} Hz, and {timed.sample_rate:g} Hz by the times "
                f"in {name}; remove the wrong one."
            )
    return replace(timed, sample_rate=None, rates=rates)


def _time_vector(columns: Mapping[str, Column], *, rising: bool) -> str | None:
    """Name of the vector that is called a time; with `rising` only one that is as long as the others, and rises."""
    names = [name for name in columns if name.lower() in _TIME_NAMES] if len(columns) > 1 else []
    if rising:
        is_even = len({len(column) for column in columns.values()}) == 1
        names = [name for name in names if is_even and (np.diff(np.asarray(columns[name][:], float)) > 0).all()]
    return names[0] if names else None


def _seconds(unit: str, path: Path) -> float:
    if unit not in TIME_UNITS:
        raise DataError(
            f"{path}: the time column is in {unit!r}, which is none of {', '.join(TIME_UNITS)}; name another."
        )
    return TIME_UNITS[unit]


def read_time_column(path: Path, column: Column, unit: float = 1.0) -> tuple[float | None, str]:
    """Sample rate [Hz] of a time column, and what is wrong with its spacing (empty where nothing is).

    The column is read in blocks. The rate is None where the times are too coarse to tell it.

    Parameters
    ----------
    unit : seconds of one unit of the column.

    Raises
    ------
    DataError
        The times do not rise, or some are missing.
    """
    time = _TimeColumn(column, unit)
    sparse = time.every(time.stride)
    if sparse.size and not np.isfinite(sparse[0]):
        raise DataError(f"{path}: the time column has no time at its first sample; remove that line.")
    if time.count < 3 or not np.isfinite(sparse).all() or not time.last > time.first:
        raise DataError(f"{path}: the time column does not rise from its first to its last sample.")
    head = time.part(0, 1000)
    digits = next((d for d in range(12) if np.abs(head - np.round(head, d)).max() < 1e-12), 12)
    quantum = 10.0**-digits
    step = time.step(sparse, quantum)
    drift = time.drift(sparse, step)
    if np.isnan(drift):
        raise DataError(f"{path}: the time column has samples without a time.")
    if drift <= max(0.5 * step, 1.01 * quantum):
        tolerance = max(1e-6, min(quantum, 4 * drift) / (time.last - time.first))
        return (None if tolerance > _COARSE else snapped_rate(step, tolerance)), ""
    usual = float(np.median(time.every(time.stride, steps=True)))
    if usual <= 0:
        raise DataError(f"{path}: most steps of the time column are zero or negative; name another time_column.")
    rate = snapped_rate(usual, max(1e-6, min(0.01, quantum / usual)))
    return rate, time.spacing(usual, quantum)


class _TimeColumn:
    """Times in seconds; never more of them are in memory than a block, and a sparse sample of all."""

    def __init__(self, column: Column, unit: float) -> None:
        self._column, self._unit = column, unit
        self.count = len(column)
        self.stride = 1 + self.count // _ENOUGH
        self.first = float(self.part(0, 1)[0]) if self.count else np.nan
        self.last = float(self.part(self.count - 1, self.count)[0]) if self.count else np.nan

    def part(self, start: int, stop: int) -> Float[np.ndarray, " time"]:
        """Times [s] of some samples."""
        return np.asarray(self._column[start:stop], dtype=np.float64) * self._unit

    def every(self, stride: int, *, steps: bool = False) -> Float[np.ndarray, " time"]:
        """Time [s] of every so many samples, or the step from each of these to the next sample."""
        chosen = []
        for start in range(0, self.count, BLOCK):
            part = self.part(start, start + BLOCK + steps)
            chosen.append((np.diff(part) if steps else part)[-start % stride :: stride])
        return np.concatenate(chosen) if chosen else np.empty(0)

    def step(self, sparse: Float[np.ndarray, " time"], quantum: float) -> float:
        """Time between two samples [s]: from the first and the last, unless the others contradict them."""
        span, half = self.last - self.first, len(sparse) // 2
        step = span / (self.count - 1)
        usual = float(np.median(sparse[half:] - sparse[: len(sparse) - half])) / (half * self.stride)
        return step if abs(step - usual) * self.count <= 4 * quantum + 1e-9 * span else max(usual, 1e-300)

    def drift(self, sparse: Float[np.ndarray, " time"], step: float) -> float:
        """How far the time strays from even steps [s], NaN where a sample has no time."""
        origin = float(np.median(sparse - step * self.stride * np.arange(len(sparse))))
        strayed = 0.0
        for start in range(0, self.count, BLOCK):
            part = self.part(start, start + BLOCK)
            strayed = np.maximum(strayed, np.abs(part - origin - step * np.arange(start, start + len(part))).max())
        return float(strayed)

    def spacing(self, usual: float, quantum: float) -> str:
        """What is wrong with the steps between samples."""
        odd, worst, at, least, most = 0, usual, 0.0, np.inf, -np.inf
        for start in range(0, self.count, BLOCK):
            part = self.part(start, start + BLOCK + 1)
            steps = np.diff(part)
            if not len(steps):
                continue
            off = np.abs(steps - usual)
            odd += int((off > 0.5 * usual + quantum).sum())
            furthest = int(off.argmax())
            if off[furthest] > abs(worst - usual):
                worst, at = float(steps[furthest]), float(part[furthest])
            least, most = min(least, float(steps.min())), max(most, float(steps.max()))
        if not odd:
            return f"steps drift between {least:.6g} s and {most:.6g} s"
        return (
            f"{odd} of {self.count - 1} steps differ from the usual {usual:.6g} s; "
            f"the worst is {worst:.6g} s at {at:.6g} s"
        )


def split_unit(text: str) -> tuple[str, str | None]:
    """Name and unit of a column heading such as ``acceleration [g]`` or ``Zeit in s``."""
    match = _BRACKET.match(text)
    if match and (match[2] in TRADE_UNITS or (text.endswith("]") and known_unit(match[2]))):
        return match[1], match[2]
    match = _AFTER_WORD.match(text)
    if match and match[2] in TRADE_UNITS:
        return match[1], match[2]
    return text, None


def time_name(path: Path, names: Sequence[str], options: Options) -> str | None:
    """Name of the column with the time, or None where none is called so."""
    stated = options.time_column
    if stated is None:
        return names[0] if len(names) > 1 and names[0].lower() in _TIME_NAMES else None
    if isinstance(stated, int) and 0 <= stated < len(names):
        return names[stated]
    if isinstance(stated, str) and split_unit(stated)[0] in names:
        return split_unit(stated)[0]
    raise DataError(f"{path} has no column {stated!r} for time_column; it has {', '.join(names)}.")
