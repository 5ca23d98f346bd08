"""The time of a file: which columns are clocks or counters of samples, and what they say of the
rate.
"""

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
from swashtwin.recordings.formats.columns import Column, slice_column
from swashtwin.recordings.formats.headings import split_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import normalize_unit
from swashtwin.recordings.formats.time_column import (
    COARSE,
    ENOUGH,
    NO_UNIT,
    read_time_column,
    restarts,
    times_of,
)

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
    r"(?:index|samples?|sample[_ ]?(?:no|number|index)|count(?:er)?|cnt|nr?|no|row|point|column_0)\.?|#|",
    re.IGNORECASE,
)
OTHER_AXIS = re.compile(
    r"(?:^|[^a-z])(?:angle|winkel|distance|weg|position|order|ordnung|freq(?:uency)?|frequenz)(?:[^a-z]|$)",
    re.IGNORECASE,
)
"""Names of columns that rise as the time does and are another quantity."""
_FIRST = re.compile(r"\(:,1\)$|\(1,:\)$|/0$|^X$")
"""The first vector of a matrix, and what stands against Y."""
_EPOCHS = {1e9: "s", 1e12: "ms", 1e15: "us", 1e18: "ns"}
"""Least and, ten times that, greatest count of a unit since 1970 in this century."""
_DAYS = ((20_000.0, 80_000.0), (700_000.0, 800_000.0))
"""Days of a spreadsheet, and of MATLAB, in this century."""
_FASTEST = 1e8
"""Rate [Hz] above which a column without a name is no clock."""
_HEAD = 1000


def extract_time(path: Path, raw: RawFile, options: ReadOptions) -> RawFile:
    """The columns without those that hold the time, which become the rates, and without counters of
    samples.

    A column is a clock if the options or its name say so, or if it rises evenly and has no unit of
    another quantity. A clock holds for the columns of its group or structure; of several, the last
    before a column holds for it. A counter states no rate, but samples that it skips are lost.
    Where a clock states no rate, the attribute ``time_gaps`` says why. Where a clock begins again,
    another recording begins.
    """
    clocks = _clocks(path, raw, options)
    rest = {name: column for name, column in raw.columns.items() if name not in clocks}
    counters = [
        name
        for name, column in rest.items()
        if (len(raw.columns) > 1 and _is_counter(raw, name, column))
        or (clocks and match_time_name(name) and raw.units.get(name) in (None, *TIME_UNITS))
    ]
    counters = counters if len(counters) < len(rest) else []
    others = {name: column for name, column in rest.items() if name not in counters}
    seconds = {name: _unit(path, raw, name, options) for name in clocks}
    found = {
        name: read_time_column(path, raw.columns[name], unit) for name, unit in seconds.items()
    }
    breaks: Sequence[int] = ()
    if len(clocks) == 1 and found[clocks[0]][1]:
        breaks = restarts(times_of(raw.columns[clocks[0]], seconds[clocks[0]] or 1.0))
    rates, starts, gaps = dict(raw.rates), dict(raw.starts), []
    for name, column in others.items():
        clock = _clock_of(raw, name, column, found)
        if clock is None:
            continue
        rate, gap = found[clock]
        stated = raw.rates.get(name, raw.sample_rate)
        is_settled = gap.startswith(NO_UNIT) and (stated or options.sample_rate is not None)
        gaps += [gap] if gap and gap not in gaps and not is_settled else []
        if rate and stated and options.time_column is None:
            require_one_rate(path, name, stated, rate, clock)
        if rate and (not stated or options.time_column is not None):
            rates[name] = rate
        if len(clocks) > 1:
            starts[name] = f"{float(raw.columns[clock][0:1][0]):.9g}"
    if counters and not clocks and (lost := _lost(raw.columns[counters[0]])):
        gaps.append(f"{counters[0]} skips {lost[0]} samples at {lost[1]} places")
    guessed = [name for name in clocks if not match_time_name(name) and options.time_column is None]
    guessed = [name for name in guessed if _own_unit(raw, name) is None]
    found_facts = {
        "clock_columns": ", ".join(guessed),
        "counter_columns": ", ".join(counters),
        "time_gaps": "; ".join(gaps),
    }
    attributes = dict(raw.attributes) | {name: text for name, text in found_facts.items() if text}
    sample_rate = raw.sample_rate
    if not raw.rates and len(rates) == len(others) and len(set(rates.values())) == 1:
        sample_rate, rates = next(iter(rates.values())), {}
    kept: dict[str, Any] = {
        field: {name: value for name, value in values.items() if name in others}
        for field, values in (("units", raw.units), ("rates", rates), ("starts", starts))
    }
    return replace(
        raw,
        columns=others,
        sample_rate=sample_rate,
        attributes=attributes,
        breaks=tuple(breaks),
        **kept,
    )


def require_one_rate(path: Path, name: str, stated: float, rate: float, clock: str) -> None:
    """Refuse a rate [Hz] by the times in a clock that is another than the one that the file
    states.
    """
    if not math.isclose(rate, stated, rel_tol=COARSE):
        raise DataError(
            f"{path} states two sample rates for {name}: {stated:g} Hz, and {rate:g} Hz by the times in {clock}; "
            f'say time_column = "{clock}" if the times are right, or correct the file.'
        )


def split_at_breaks(raw: RawFile) -> RawFile:
    """The recordings that begin at the breaks of a file, with columns of their own, such as ``x
    [2]``.
    """
    if not raw.breaks:
        return raw
    columns: dict[str, Column] = {}
    starts: dict[str, str] = {}
    names: dict[str, str] = {}
    for name, column in raw.columns.items():
        for number, (first, last) in enumerate(pairwise([0, *raw.breaks, len(column)]), 1):
            key = f"{name} [{number}]"
            columns[key], starts[key], names[key] = (
                slice_column(column, first, last),
                f"sample {first} of the file",
                name,
            )
    kept: dict[str, Any] = {
        field: {key: values[name] for key, name in names.items() if name in values}
        for field, values in (
            ("units", raw.units),
            ("rates", raw.rates),
            ("sensitivities", raw.sensitivities),
        )
    }
    attributes = {name: text for name, text in raw.attributes.items() if name != "time_gaps"}
    return replace(raw, columns=columns, starts=starts, attributes=attributes, **kept)


def time_name(path: Path, names: Sequence[str], options: ReadOptions) -> str | None:
    """Name of the column with the time that the options state, or of the first that is called so;
    or None.
    """
    stated = options.time_column
    if stated is None:
        return (
            next((name for name in names if match_time_name(name)), None)
            if len(names) > 1
            else None
        )
    if isinstance(stated, int) and 0 <= stated < len(names):
        return names[stated]
    if isinstance(stated, str) and (stated in names or split_unit(stated)[0] in names):
        return stated if stated in names else split_unit(stated)[0]
    raise DataError(f"{path} has no column {stated!r} for time_column; it has {', '.join(names)}.")


def match_time_name(name: str) -> re.Match[str] | None:
    """What the name of a column says of a time, without the groups that it is in."""
    return _TIME_NAME.fullmatch(re.split(r"[./]", name)[-1].strip()) if name.strip() else None


def _clocks(path: Path, raw: RawFile, options: ReadOptions) -> list[str]:
    """Columns with the time: the stated one, or those called so, or else those that rise evenly."""
    names = list(raw.columns)
    if options.time_column is not None:
        return list(filter(None, [time_name(path, names, options)]))
    if len(names) < 2:
        return []
    called, rising = [], []
    for name in names:
        stated = raw.rates.get(name, raw.sample_rate)
        if match_time_name(name) and (
            (_is_of_time(raw, name) and stated is None) or _is_clock(raw, name)
        ):
            called.append(name)
        elif (
            _is_of_time(raw, name)
            and not OTHER_AXIS.search(name)
            and _is_clock(raw, name, may_count=options.time_unit is not None)
            and (stated is None or _steps_at(stated, raw.columns[name]))
        ):
            rising.append(name)
    chosen = (
        ([name for name in called if _is_clock(raw, name)] if len(called) > 1 else [])
        or called
        or rising
    )
    return chosen if len(chosen) < len(names) else chosen[:1]


def _own_unit(raw: RawFile, name: str) -> str | None:
    """Unit of a column; none where it is that of all, and not of the time among them."""
    unit = raw.units.get(name)
    of_all = unit not in TIME_UNITS and all(raw.units.get(each) == unit for each in raw.columns)
    return None if of_all and (match_time_name(name) or _FIRST.search(name)) else unit


def _is_of_time(raw: RawFile, name: str) -> bool:
    return _own_unit(raw, name) in (None, *TIME_UNITS)


def _clock_of(raw: RawFile, name: str, column: Column, clocks: Mapping[str, Any]) -> str | None:
    """The clock that holds for a column: of its own length, in the nearest group, before it, and
    with a rate.
    """
    names = list(raw.columns)

    def merit(clock: str) -> tuple[int, bool, bool, int]:
        scope = re.split(r"[^./]*$", clock)[0]
        at = names.index(clock) - names.index(name)
        return len(scope), clocks[clock][0] is not None, at < 0, at if at < 0 else -at

    fitting = [
        clock
        for clock in clocks
        if len(raw.columns[clock]) == len(column)
        and name.startswith(re.split(r"[^./]*$", clock)[0])
    ]
    return max(fitting, key=merit, default=None)


def _is_clock(raw: RawFile, name: str, *, may_count: bool = False) -> bool:
    """Whether a column rises evenly, as no vibration does, at a rate of a measurement, beside
    another of its length.

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
    sparse = np.asarray(column[0 :: 1 + len(column) // ENOUGH], dtype=np.float64)
    return not is_count and rate <= _FASTEST and bool((np.diff(sparse) > 0).all())


def _steps_at(rate: float, column: Column) -> bool:
    usual = float(np.median(np.diff(np.asarray(column[0:_HEAD], dtype=np.float64))))
    return math.isclose(usual * rate, 1.0, rel_tol=COARSE)


def _is_counter(raw: RawFile, name: str, column: Column) -> bool:
    """Whether a column holds whole numbers that rise by one, from the beginning again or not, or
    rises evenly.

    It has no unit of another quantity. One that is called as counters are may skip samples.
    """
    if not _is_of_time(raw, name) or len(column) < 3:
        return False
    head = np.asarray(column[0:_HEAD], dtype=np.float64)
    if not (head == np.round(head)).all():
        return _is_clock(raw, name)
    steps = _counted(head)
    may_skip = _COUNTER_NAME.fullmatch(re.split(r"[./]", name)[-1].strip()) is not None
    is_counted = (
        np.median(steps) == 1
        and (steps >= 1).all()
        and (may_skip or (len(steps) > 15 and steps.max() == 1))
    )
    return bool(is_counted) or _is_clock(raw, name)


def _counted(counts: Float[np.ndarray, " time"]) -> Float[np.ndarray, " step"]:
    """Steps of a counter, which may begin again after its largest number."""
    steps, span = np.diff(counts), counts.max() - counts.min()
    if span >= 15:
        steps[steps == -span] = 1
    return steps


def _lost(counter: Column) -> tuple[int, int] | None:
    """How many samples a counter by ones skips, and at how many places; None where it skips
    none.
    """
    counts = np.asarray(counter[:], dtype=np.float64)
    steps = _counted(counts)
    if np.median(steps) != 1 or not (counts == np.round(counts)).all():
        return None  # a ramp
    places = int((steps != 1).sum())
    return (int((steps - 1).sum()), places) if places else None


def _unit_by_size(head: Float[np.ndarray, " time"]) -> str | None:
    """Unit of times since 1970, or of days of a spreadsheet, which their size tells; else None."""
    for least, unit in _EPOCHS.items():
        if least <= head[0] < 10 * least:
            return unit
    is_days = any(least < head[0] < most for least, most in _DAYS) and head[-1] - head[0] < 1
    return "d" if is_days else None


def _unit(path: Path, raw: RawFile, name: str, options: ReadOptions) -> float | None:
    """Seconds of one unit of a clock: as stated, by its heading, its name or its size; None where
    nothing says it.
    """
    head = np.asarray(raw.columns[name][0:_HEAD], dtype=np.float64)
    in_file, match = _own_unit(raw, name), match_time_name(name)
    words = match and next(filter(None, match.groups()), None)
    unit = options.time_unit or in_file or words or _unit_by_size(head)
    if unit is None and re.search(r"[\[(].*[a-zA-Z].*[\])]$", name):
        unit = name
    if unit is not None and normalize_unit(unit) not in TIME_UNITS:
        raise DataError(
            f"{path}: the time column {name!r} is in {unit!r}, which is none of {', '.join(TIME_UNITS)}; say "
            'time_unit = "ms" or what it is, or name another time_column.'
        )
    return None if unit is None else TIME_UNITS[normalize_unit(unit)]
