"""The time of a file: which columns are clocks or counters of samples, and what they say of the rate."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import BLOCK, Column, Part
from swashtwin.recordings.formats.raw import Options, RawFile, plain_unit, snapped_rate
from swashtwin.recordings.formats.tables import split_unit

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Seconds of each unit of time; there is none that one wrong letter turns into another."""
_TIME_NAME = re.compile(
    r"(?:x[_ ]?value|t|epoch|(?=milli|micro|nano)"
    r"|(?:elapsed|rel(?:ative)?|abs(?:olute)?|sample|measurement)?[_ ]?(?:time|zeit)(?:[_ ]?stamps?)?)"
    r"(?:[_ ]?(?<![a-z])(s|sec|seconds|ms|msec|us|usec|ns)|[_ ]?((?:milli|micro|nano)s(?:econds)?))?(?:[_ ]?\d+)?",
    re.IGNORECASE,
)
"""What a column with the time is called, with its unit at the end or without it."""
_COUNTER_NAME = re.compile(
    r"(?:index|samples?|sample[_ ]?(?:no|number|index)|count(?:er)?|cnt|nr?|no|row|point|column_0)\.?|#|", re.IGNORECASE
)
_FIRST_OF_MATRIX = re.compile(r"\(:,1\)$|\(1,:\)$|/0$")
_EPOCHS = {1e9: "s", 1e12: "ms", 1e15: "us", 1e18: "ns"}
"""Least and, ten times that, greatest count of a unit since 1970 in this century."""
_DAYS = ((20_000.0, 80_000.0), (700_000.0, 800_000.0))
"""Days of a spreadsheet, and of MATLAB, in this century."""
_COARSE = 5e-3
"""Relative doubt about a rate beyond which a time column does not state it."""
_SLOW = 20.0
"""Rate [Hz] up to which times without a unit are doubted: they may as well be milliseconds, or ticks."""
_FASTEST = 1e8
"""Rate [Hz] above which a column without a name is no clock."""
_HEAD = 1000
_MOST_PARTS = 100
"""Recordings that one table holds at most; a clock that begins again more often is broken."""
_ENOUGH = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""


def timed(path: Path, raw: RawFile, options: Options) -> RawFile:
    """The columns without those that hold the time, which become the rates, and without counters of samples.

    A column is a clock if the options or its name say so, or if it rises evenly and has no unit of another quantity. A
    clock holds for the columns of its group or structure; of several, the last before a column holds for it. A counter
    states no rate, but samples that it skips are lost. Where a clock states no rate, the attribute ``time_gaps`` says
    why. Where a clock begins again, another recording begins.

    Raises
    ------
    DataError
        The rate of the times is another than one that the file states.
    """
    clocks = _clocks(path, raw, options)
    rest = {name: column for name, column in raw.columns.items() if name not in clocks}
    counters = [
        name
        for name, column in rest.items()
        if (len(raw.columns) > 1 and _is_counter(raw, name, column))
        or (clocks and named_as_time(name) and raw.units.get(name) in (None, *TIME_UNITS))
    ]
    counters = counters if len(counters) < len(rest) else []
    others = {name: column for name, column in rest.items() if name not in counters}
    seconds = {name: _unit(path, raw, name, options) for name in clocks}
    found = {name: read_time_column(path, raw.columns[name], unit) for name, unit in seconds.items()}
    breaks: Sequence[int] = ()
    if len(clocks) == 1 and found[clocks[0]][1]:
        breaks = _TimeColumn(raw.columns[clocks[0]], seconds[clocks[0]] or 1.0).restarts()
    rates, starts, gaps = dict(raw.rates), dict(raw.starts), []
    for name, column in others.items():
        clock = _clock_of(raw, name, column, found)
        if clock is None:
            continue
        rate, gap = found[clock]
        gaps += [gap] if gap and gap not in gaps else []
        stated = raw.rates.get(name, raw.sample_rate)
        if rate and stated and options.time_column is None:
            require_one_rate(path, name, stated, rate, clock)
        if rate and (not stated or options.time_column is not None):
            rates[name] = rate
        if len(clocks) > 1:
            starts[name] = f"{float(raw.columns[clock][0:1][0]):.9g}"
    if counters and not clocks and (lost := _lost(raw.columns[counters[0]])):
        gaps.append(f"{counters[0]} skips {lost[0]} samples at {lost[1]} places")
    found_facts = {"counter_columns": ", ".join(counters), "time_gaps": "; ".join(gaps)}
    attributes = dict(raw.attributes) | {name: text for name, text in found_facts.items() if text}
    sample_rate = raw.sample_rate
    if not raw.rates and len(rates) == len(others) and len(set(rates.values())) == 1:
        sample_rate, rates = next(iter(rates.values())), {}
    kept: dict[str, Any] = {
        field: {name: value for name, value in values.items() if name in others}
        for field, values in (("units", raw.units), ("rates", rates), ("starts", starts))
    }
    return replace(raw, columns=others, sample_rate=sample_rate, attributes=attributes, breaks=tuple(breaks), **kept)


def require_one_rate(path: Path, name: str, stated: float, rate: float, clock: str) -> None:
    """Refuse a rate [Hz] by the times in a clock that is another than the one that the file states."""
    if not math.isclose(rate, stated, rel_tol=_COARSE):
        raise DataError(
            f"{path} states two sample rates for {name}: {stated:g} Hz, and {rate:g} Hz by the times in {clock}; "
            f'say time_column = "{clock}" if the times are right, or correct the file.'
        )


def split(raw: RawFile) -> RawFile:
    """The recordings that begin at the breaks of a file, with columns of their own, such as ``x [2]``."""
    if not raw.breaks:
        return raw
    columns: dict[str, Column] = {}
    starts: dict[str, str] = {}
    names: dict[str, str] = {}
    for name, column in raw.columns.items():
        for number, (first, last) in enumerate(pairwise([0, *raw.breaks, len(column)]), 1):
            key = f"{name} [{number}]"
            columns[key], starts[key], names[key] = Part(column, first, last), f"sample {first} of the file", name
    kept: dict[str, Any] = {
        field: {key: values[name] for key, name in names.items() if name in values}
        for field, values in (("units", raw.units), ("rates", raw.rates), ("sensitivities", raw.sensitivities))
    }
    attributes = {name: text for name, text in raw.attributes.items() if name != "time_gaps"}
    return replace(raw, columns=columns, starts=starts, attributes=attributes, **kept)


def time_name(path: Path, names: Sequence[str], options: Options) -> str | None:
    """Name of the column with the time that the options state, or of the first that is called so; or None."""
    stated = options.time_column
    if stated is None:
        return next((name for name in names if named_as_time(name)), None) if len(names) > 1 else None
    if isinstance(stated, int) and 0 <= stated < len(names):
        return names[stated]
    if isinstance(stated, str) and (stated in names or split_unit(stated)[0] in names):
        return stated if stated in names else split_unit(stated)[0]
    raise DataError(f"{path} has no column {stated!r} for time_column; it has {', '.join(names)}.")


def named_as_time(name: str) -> re.Match[str] | None:
    """What the name of a column says of a time, without the groups that it is in."""
    return _TIME_NAME.fullmatch(re.split(r"[./]", name)[-1].strip()) if name.strip() else None


def _clocks(path: Path, raw: RawFile, options: Options) -> list[str]:
    """Columns with the time: the stated one, or those called so, or else those that rise evenly."""
    names = list(raw.columns)
    if options.time_column is not None:
        return list(filter(None, [time_name(path, names, options)]))
    if len(names) < 2:
        return []
    called, rising = [], []
    for name in names:
        is_rated = raw.rates.get(name, raw.sample_rate) is not None
        if named_as_time(name) and ((_is_of_time(raw, name) and not is_rated) or _is_clock(raw, name)):
            called.append(name)
        elif not is_rated and _is_of_time(raw, name) and _is_clock(raw, name, may_count=options.time_unit is not None):
            rising.append(name)
    chosen = ([name for name in called if _is_clock(raw, name)] if len(called) > 1 else []) or called or rising
    return chosen if len(chosen) < len(names) else chosen[:1]


def _own_unit(raw: RawFile, name: str) -> str | None:
    """Unit of a column; none where it is that of a whole matrix, and not of the time in it."""
    unit = raw.units.get(name)
    of_all = unit not in TIME_UNITS and all(raw.units.get(each) == unit for each in raw.columns)
    return None if of_all and (named_as_time(name) or _FIRST_OF_MATRIX.search(name)) else unit


def _is_of_time(raw: RawFile, name: str) -> bool:
    return _own_unit(raw, name) in (None, *TIME_UNITS)


def _clock_of(raw: RawFile, name: str, column: Column, clocks: Mapping[str, Any]) -> str | None:
    """The clock that holds for a column: of its own length, in the nearest group, before it, and with a rate."""
    names = list(raw.columns)

    def merit(clock: str) -> tuple[int, bool, bool, int]:
        scope = re.split(r"[^./]*$", clock)[0]
        at = names.index(clock) - names.index(name)
        return len(scope), clocks[clock][0] is not None, at < 0, at if at < 0 else -at

    fitting = [
        clock
        for clock in clocks
        if len(raw.columns[clock]) == len(column) and name.startswith(re.split(r"[^./]*$", clock)[0])
    ]
    return max(fitting, key=merit, default=None)


def _is_clock(raw: RawFile, name: str, *, may_count: bool = False) -> bool:
    """Whether a column rises evenly, as no vibration does, at a rate of a measurement, beside another of its length.

    One that rises by one is a counter, unless somebody says that it `may_count` the time.
    """
    column = raw.columns[name]
    if len(column) < 16 or sum(len(other) == len(column) for other in raw.columns.values()) < 2:
        return False
    head = np.asarray(column[0:_HEAD], dtype=np.float64)
    steps = np.diff(head)
    usual = float(np.median(steps))
    even = np.abs(steps - usual) <= 0.5 * usual
    if not (np.isfinite(head).all() and (steps > 0).all() and even.mean() > 0.5):
        return False
    rate = 1 / (usual * TIME_UNITS[_unit_by_size(head) or "s"])
    is_count = usual == 1 and _unit_by_size(head) is None and not may_count
    sparse = np.asarray(column[0 :: 1 + len(column) // _ENOUGH], dtype=np.float64)
    return not is_count and rate <= _FASTEST and bool((np.diff(sparse) > 0).all())


def _is_counter(raw: RawFile, name: str, column: Column) -> bool:
    """Whether a column holds whole numbers that rise by one, from the beginning again or not, or rises evenly.

    It has no unit of another quantity. One that is called as counters are may skip samples.
    """
    if not _is_of_time(raw, name) or len(column) < 3:
        return False
    head = np.asarray(column[0:_HEAD], dtype=np.float64)
    if not (head == np.round(head)).all():
        return _is_clock(raw, name)
    steps = _counted(head)
    may_skip = _COUNTER_NAME.fullmatch(re.split(r"[./]", name)[-1].strip()) is not None
    is_counted = np.median(steps) == 1 and (steps >= 1).all() and (may_skip or (len(steps) > 15 and steps.max() == 1))
    return bool(is_counted) or _is_clock(raw, name)


def _counted(counts: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Steps of a counter, which may begin again after its largest number."""
    steps, span = np.diff(counts), counts.max() - counts.min()
    if span >= 15:
        steps[steps == -span] = 1
    return steps


def _lost(counter: Column) -> tuple[int, int] | None:
    """How many samples a counter skips, and at how many places; None where it skips none."""
    steps = _counted(np.asarray(counter[:], dtype=np.float64))
    places = int((steps != 1).sum())
    return (int((steps - 1).sum()), places) if places else None


def _unit_by_size(head: Float[np.ndarray, " time"]) -> str | None:
    """Unit of times since 1970, or of days of a spreadsheet, which their size tells; else None."""
    for least, unit in _EPOCHS.items():
        if least <= head[0] < 10 * least:
            return unit
    is_days = any(least < head[0] < most for least, most in _DAYS) and head[-1] - head[0] < 1
    return "d" if is_days else None


def _unit(path: Path, raw: RawFile, name: str, options: Options) -> float | None:
    """Seconds of one unit of a clock: as stated, by its heading, its name or its size; None where nothing says it."""
    head = np.asarray(raw.columns[name][0:_HEAD], dtype=np.float64)
    in_file, match = _own_unit(raw, name), named_as_time(name)
    words = match and next(filter(None, match.groups()), None)
    unit = options.time_unit or in_file or words or _unit_by_size(head)
    if unit is None and re.search(r"[\[(].*[a-zA-Z].*[\])]$", name):
        unit = name
    if unit is not None and plain_unit(unit) not in TIME_UNITS:
        raise DataError(
            f"{path}: the time column {name!r} is in {unit!r}, which is none of {', '.join(TIME_UNITS)}; say "
            'time_unit = "ms" or what it is, or name another time_column.'
        )
    return None if unit is None else TIME_UNITS[plain_unit(unit)]


def read_time_column(path: Path, column: Column, unit: float | None = 1.0) -> tuple[float | None, str]:
    """Sample rate [Hz] of a time column, and what is wrong with its spacing (empty where nothing is).

    The column is read in blocks. The rate is None where the times are too coarse to tell it, or have no unit and would
    give an unlikely one.

    Parameters
    ----------
    unit : seconds of one unit of the column; None where nobody says it.

    Raises
    ------
    DataError
        The times do not rise, or the first is missing.
    """
    time = _TimeColumn(column, unit or 1.0)
    sparse = time.every(time.stride)
    if sparse.size and not np.isfinite(sparse[0]):
        raise DataError(f"{path}: the time column has no time at its first sample; remove that line.")
    if not np.isfinite(sparse).all() or not np.isfinite(time.last):
        return None, f"the time column has no time at {int((~np.isfinite(time.every(1))).sum())} of its samples"
    usual = float(np.median(time.every(time.stride, steps=True))) if time.count > 2 else 0.0
    if time.count < 3 or not (time.last > time.first or usual > 0):
        raise DataError(f"{path}: the time column does not rise from its first to its last sample.")
    ends = time.part(0, _HEAD), time.part(max(0, time.count - _HEAD), time.count)  # later times may have fewer digits
    digits = min(next((d for d in range(12) if np.abs(end - np.round(end, d)).max() < 1e-12), 12) for end in ends)
    first = np.asarray(column[0:1])[0]  # a count of days is not as fine as its digits
    spacing = 2 * (unit or 1.0) * float(np.spacing(abs(first))) if isinstance(first, np.floating) else 0.0
    rate, gaps = _rate(path, time, sparse, usual, max(10.0**-digits, spacing))
    if unit is None and rate is not None and rate <= _SLOW:
        return (
            None,
            f'its times have no unit, and would be {rate:.6g} Hz in seconds; say time_unit = "ms" or what it is',
        )
    return rate, gaps


def _rate(
    path: Path, time: "_TimeColumn", sparse: Float[np.ndarray, " time"], usual: float, quantum: float
) -> tuple[float | None, str]:
    """Rate [Hz] of times that are written to `quantum` [s], and what is wrong with their spacing."""
    step = time.step(sparse, quantum)
    if step > 0 and (regular := time.regular_step(step, quantum)) is not None:
        if math.isnan(regular):
            return None, (
                f"its times are too coarse to tell {1 / usual:.6g} Hz with samples lost from {1 / step:.6g} Hz without"
            )
        tolerance = max(1e-6, min(0.01, 0.1 * quantum / regular))
        return snapped_rate(regular, tolerance), time.spacing(regular, min(quantum, 0.1 * regular))
    drift = time.drift(sparse, step)
    if np.isnan(drift):
        return None, "the time column has samples without a time"
    if drift <= max(0.5 * step, 1.01 * quantum):
        tolerance = max(1e-6, min(quantum, 4 * drift) / (time.last - time.first))
        return (None if tolerance > _COARSE else snapped_rate(step, tolerance)), ""
    if usual <= 0:
        raise DataError(f"{path}: most steps of the time column are zero or negative; name another time_column.")
    steps = time.every(time.stride, steps=True)
    steps = steps[np.abs(steps - usual) < 0.25 * usual]
    tolerance = max(1e-6, min(0.01, 4 * quantum / (usual * len(steps))))
    return snapped_rate(float(steps.mean()), tolerance), time.spacing(usual, quantum)


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
        """Time between neighbors [s], where so many samples are lost that `step`, the mean, is another; else None.

        NaN where steps of one and of two quanta may as well be a lower rate.
        """
        steps = self.every(self.stride, steps=True)
        usual = float(np.median(steps))
        lost = (steps > 1.5 * usual).mean()
        is_least = abs(usual / quantum - 1) < 1e-6 and steps.min() > 0
        if lost < 0.005 or not (usual > 4 * quantum or is_least):
            return None
        if is_least and lost > 0.15 and steps.max() < 2.5 * usual:
            return math.nan
        usual = float(steps[np.abs(steps - usual) < 0.25 * usual].mean())
        return usual if step / usual - 1 > 2e-3 else None

    def restarts(self) -> list[int]:
        """Samples at which the time begins again and goes on from there; none where it does so all the time."""
        usual = float(np.median(self.every(self.stride, steps=True)))
        found: list[int] = []
        for start in range(0, self.count, BLOCK):
            part = self.part(start, start + BLOCK + 3)
            back = (part[2:-1] < part[1:-2] - 10 * usual) & (part[2:-1] < part[:-3]) & (part[3:] < part[1:-2])
            found += (start + 2 + np.flatnonzero(back[:BLOCK])).tolist()
        return found if len(found) <= _MOST_PARTS else []

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
