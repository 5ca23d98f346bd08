"""Columns of a table: what their headings say, and what the one with the time says."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, UnitError, parse
from swashtwin.recordings.columns import BLOCK, Column
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, plain_unit, snapped_rate

_BRACKET = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]+?)\s*[\])]$")
_AFTER_WORD = re.compile(r"^(.*\S)(?:\s+/\s+|\s+in\s+)(\S+)$")
TRADE_UNITS = frozenset((
    "s", "ms", "us", "ns", "g", "mg", "m/s^2", "mm/s^2", "mm/s", "V", "mV", "A", "mA", "Pa", "kPa", "MPa", "bar",
    "mbar", "psi", "N", "kN", "Nm", "rpm", "Hz", "kHz", "degC", "m3/h", "l/min",
))  # fmt: skip
"""Units that a heading or a second line of headings names without square brackets, as `plain_unit` writes them."""
_ENOUGH = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "d": 86400.0}
"""Seconds of each unit of time; there is none that one wrong letter turns into another."""
_TIME_NAME = re.compile(
    r"(?:x[_ ]?value|t|epoch"
    r"|(?:elapsed|rel(?:ative)?|abs(?:olute)?|sample|measurement)?[_ ]?(?:time|zeit)(?:[_ ]?stamps?)?)"
    r"(?:[_ ](s|sec|seconds|ms|msec|millis|us|usec|micros|ns))?",
    re.IGNORECASE,
)
"""What a column with the time is called, with its unit at the end or without it."""
_COUNTER_NAME = re.compile(r"(?:index|samples?|sample[_ ]?(?:no|number|index)|count(?:er)?|nr?|no|row|point)\.?|#|",
                           re.IGNORECASE)  # fmt: skip
_EPOCHS = {1e9: "s", 1e12: "ms", 1e15: "us", 1e18: "ns"}
"""Least and, ten times that, greatest count of a unit since 1970 in this century."""
_EXCEL_DAYS = (20_000.0, 80_000.0)
"""Days of a spreadsheet in this century."""
_COARSE = 5e-3
"""Relative doubt about a rate beyond which a time column does not state it."""
_RATES = (1.0, 1e8)
"""Rates [Hz] at which a column without a name is a clock."""
_HEAD = 1000


def timed_columns(
    path: Path,
    columns: Mapping[str, Column],
    units: Mapping[str, str],
    attributes: Mapping[str, str],
    options: Options,
    *,
    rated: bool = False,
) -> RawFile:
    """The columns without the one that holds the time, which becomes the rate, and without counters of samples.

    A column is the clock if the options or its name say so, or if it rises evenly. A counter of samples states no rate,
    but samples that it skips are lost.

    Parameters
    ----------
    rated : whether the rate is known otherwise: then no column is taken for a clock because it rises.
    """
    name = time_name(path, list(columns), options)
    if name is None and not rated:
        name = next((each for each in columns if _is_clock(columns, each)), None)
    counters = [each for each in columns if each != name and len(columns) > 1 and _is_counter(each, columns[each])]
    if len(counters) + (name is not None) >= len(columns):
        counters = []
    others = {each: column for each, column in columns.items() if each != name and each not in counters}
    attributes = dict(attributes) | ({"counter_columns": ", ".join(counters)} if counters else {})
    rate, gaps = None, ""
    if name is not None:
        rate, gaps = read_time_column(path, columns[name], _seconds(path, name, columns[name], units, options))
    elif counters and (lost := _lost(columns[counters[0]])):
        gaps = f"{counters[0]} skips {lost[0]} samples at {lost[1]} places"
    units = {other: unit for other, unit in units.items() if other in others}
    return RawFile(others, rate, units, {**attributes, **({"time_gaps": gaps} if gaps else {})})


def timed_variables(path: Path, raw: RawFile, options: Options) -> RawFile:
    """Vectors of a workspace without the one that holds the time, which gives the rate where none is stated.

    Raises
    ------
    DataError
        The rate of the times is another than one that the file states.
    """
    if options.time_column is None and raw.rates:
        names = [name for name in raw.columns if _TIME_NAME.fullmatch(name.rpartition(".")[2])]
        alike = len({len(column) for column in raw.columns.values()}) == 1 and len(raw.columns) > 1
        rising = [name for name in names if alike and (np.diff(np.asarray(raw.columns[name][:], float)) > 0).all()]
        if not rising:
            return raw
        options = replace(options, time_column=rising[0])
    inherited = [name for name, unit in raw.units.items() if unit not in TIME_UNITS]  # a unit of all vectors
    clock = time_name(path, list(raw.columns), options)
    units = {name: unit for name, unit in raw.units.items() if name != clock or name not in inherited}
    timed = timed_columns(path, raw.columns, units, raw.attributes, options, rated=bool(raw.rates))
    timed = replace(timed, facts=raw.facts, starts=raw.starts)
    if not raw.rates:
        return timed
    rates = {other: rate for other, rate in raw.rates.items() if other in timed.columns}
    for other, rate in rates.items():
        if timed.sample_rate is not None and not math.isclose(rate, timed.sample_rate, rel_tol=_COARSE):
            raise DataError(
                f"{path} states two sample rates for {other}: {rate:g} Hz, and {timed.sample_rate:g} Hz by the times "
                f"in {options.time_column}; remove the wrong one."
            )
    return replace(timed, sample_rate=None, rates=rates)


def time_name(path: Path, names: Sequence[str], options: Options) -> str | None:
    """Name of the column with the time that the options state, or that is called so; or None."""
    stated = options.time_column
    if stated is None:
        called = (name for name in names if _TIME_NAME.fullmatch(re.split(r"[./]", name)[-1].strip()))
        return next(called, None) if len(names) > 1 else None
    if isinstance(stated, int) and 0 <= stated < len(names):
        return names[stated]
    if isinstance(stated, str) and split_unit(stated)[0] in names:
        return split_unit(stated)[0]
    raise DataError(f"{path} has no column {stated!r} for time_column; it has {', '.join(names)}.")


def _is_clock(columns: Mapping[str, Column], name: str) -> bool:
    """Whether a column rises evenly, as no vibration does, at a rate of a measurement, beside another of its length."""
    column = columns[name]
    if len(column) < 16 or sum(len(other) == len(column) for other in columns.values()) < 2:
        return False
    head = np.asarray(column[0:_HEAD], dtype=np.float64)
    steps = np.diff(head)
    if not (np.isfinite(head).all() and (steps > 0).all() and steps.max() < 20 * np.median(steps)):
        return False
    rate = 1 / (float(np.median(steps)) * TIME_UNITS[_unit_by_size(head) or "s"])
    whole = np.asarray(column[0 :: 1 + len(column) // _ENOUGH], dtype=np.float64)
    return _RATES[0] < rate <= _RATES[1] and bool((np.diff(whole) > 0).all())


def _is_counter(name: str, column: Column) -> bool:
    """Whether a column is called as a counter of samples is, and holds whole numbers that rise."""
    if not _COUNTER_NAME.fullmatch(name.strip()) or len(column) < 3:
        return False
    head = np.asarray(column[0:_HEAD], dtype=np.float64)
    return bool((head == np.round(head)).all() and (np.diff(head) >= 1).all() and np.median(np.diff(head)) == 1)


def _lost(counter: Column) -> tuple[int, int] | None:
    """How many samples a counter skips, and at how many places; None where it skips none."""
    steps = np.diff(np.asarray(counter[:], dtype=np.float64))
    places = int((steps != 1).sum())
    return (int((steps - 1).sum()), places) if places else None


def _unit_by_size(head: Float[np.ndarray, " time"]) -> str | None:
    """Unit of times since 1970, or of days of a spreadsheet, which their size tells; else None."""
    for least, unit in _EPOCHS.items():
        if least <= head[0] < 10 * least:
            return unit
    is_days = _EXCEL_DAYS[0] < head[0] < _EXCEL_DAYS[1] and head[-1] - head[0] < 1
    return "d" if is_days else None


def _seconds(path: Path, name: str, column: Column, units: Mapping[str, str], options: Options) -> float:
    """Seconds of one unit of the time column: as stated, by its heading, its name or its size."""
    head = np.asarray(column[0:_HEAD], dtype=np.float64)
    match = _TIME_NAME.fullmatch(re.split(r"[./]", name)[-1].strip())
    unit = plain_unit(options.time_unit or units.get(name) or (match and match[1]) or _unit_by_size(head) or "s")
    if unit not in TIME_UNITS:
        raise DataError(
            f"{path}: the time column {name!r} is in {unit!r}, which is none of {', '.join(TIME_UNITS)}; state its "
            "time_unit, or name another time_column."
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
    if (regular := time.regular_step(step, quantum)) is not None:
        return snapped_rate(regular, max(1e-6, min(0.01, 0.1 * quantum / regular))), time.spacing(
            regular, min(quantum, 0.1 * regular)
        )
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
        self._origin: Any = 0
        self.stride = 1 + self.count // _ENOUGH
        self.first = float(self.part(0, 1)[0]) if self.count else np.nan
        if abs(self.first) > 1e6:  # since 1970: the digits are needed for the steps
            self._origin, self.first = np.asarray(column[0:1])[0], 0.0
        self.last = float(self.part(self.count - 1, self.count)[0]) if self.count else np.nan

    def part(self, start: int, stop: int) -> Float[np.ndarray, " time"]:
        """Times [s] of some samples."""
        return np.asarray(self._column[start:stop] - self._origin, dtype=np.float64) * self._unit

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

    def regular_step(self, step: float, quantum: float) -> float | None:
        """Time between neighbors [s], where so many samples are lost that `step`, the mean, is another; else None."""
        steps = self.every(self.stride, steps=True)
        usual = float(np.median(steps))
        lost = (steps > 1.5 * usual).mean()
        is_fine = usual > 4 * quantum or (abs(usual / quantum - 1) < 1e-6 and lost < 0.15 and steps.min() > 0)
        if lost < 0.005 or not is_fine:
            return None
        usual = float(steps[np.abs(steps - usual) < 0.25 * usual].mean())
        return usual if step / usual - 1 > 2e-3 else None

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
    if match and (plain_unit(match[2]) in TRADE_UNITS or (text.endswith("]") and known_unit(match[2]))):
        return match[1], plain_unit(match[2])
    match = _AFTER_WORD.match(text)
    if match and plain_unit(match[2]) in TRADE_UNITS:
        return match[1], plain_unit(match[2])
    return text, None


_RATE_NAME = re.compile(r"fs|(?:sampl\w*[ _-]?)?(?:rate|freq\w*)|abtast(?:rate|frequenz)", re.IGNORECASE)
_STEP_NAME = re.compile(
    r"delta[ _]?[tx]|dt|(?:sampl\w*|time)[ _-]?(?:interval|period|step|increment)|increment", re.IGNORECASE
)
_UNITS_NAME = re.compile(r"y[ _]unit[ _]label|(?:channel[ _])?units?|einheit(?:en)?", re.IGNORECASE)
_QUANTITY = re.compile(r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(.*)")


def header_pairs(header: str) -> list[tuple[str, str]]:
    """Name and value of each line of a header that is ``name: value``, ``name = value``, or two columns."""
    pairs = []
    for line in header.splitlines():
        parts = re.split(r"[;\t]|:\s|\s*=\s*", line.strip("%#; \t"), maxsplit=1)
        if len(parts) == 2:
            pairs.append((parts[0].strip().rstrip(":"), parts[1].strip()))
    return pairs


def header_rate(header: str) -> float | None:
    """Sample rate [Hz] that a header states as a rate or as the time between two samples, the same for all; or None."""
    rates = set()
    for name, text in header_pairs(header):
        heading, unit = split_unit(name)
        for pattern, base in ((_RATE_NAME, "Hz"), (_STEP_NAME, "s")):
            if not pattern.fullmatch(heading.strip()):
                continue
            for part in filter(None, map(str.strip, re.split(r"[;\t]", text))):
                match = _QUANTITY.fullmatch(part)
                if match is None:
                    continue
                try:
                    value = parse(f"{match[1].replace(',', '.')} {plain_unit(match[2] or unit or base)}", base)
                except UnitError:
                    continue
                if value > 0:
                    rates.add(float(f"{value if base == 'Hz' else 1 / value:.9g}"))
    return rates.pop() if len(rates) == 1 else None


def header_units(header: str, count: int) -> Sequence[str | None]:
    """Unit of each of `count` channels, where a line of a header names one for each, or one for all."""
    for name, text in header_pairs(header):
        units = [known_unit(part) for part in re.split(r"[;\t,]", text) if part.strip()]
        if _UNITS_NAME.fullmatch(name) and units and len(units) in (1, count):
            return units * count if len(units) == 1 else units
    return [None] * count
