"""Columns that are clocks or counters of samples, and the rate that they show.

`extract_time` takes them out of a file's columns; `split_at_breaks` parts the recordings that one
file holds one after the other.
"""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, UnitError, parse_quantity, propose_setting
from swashtwin.recordings.columns import Column, slice_column
from swashtwin.recordings.formats.array_shapes import require_recording_shape
from swashtwin.recordings.formats.axes import require_samples, settle_axes
from swashtwin.recordings.formats.column_names import (
    is_name_empty,
    name_in_group,
    names_other,
    parse_time_name,
    unknown_unit,
)
from swashtwin.recordings.formats.headings import split_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.row_sets import (
    paired_times,
    separate_rows,
    trim_short_pairs,
)
from swashtwin.recordings.formats.sample_units import normalize_unit
from swashtwin.recordings.formats.time_column import (
    MAX_RATE_ERROR,
    MEDIAN_SAMPLES,
    NO_UNIT,
    find_restarts,
    is_batched,
    read_time_column,
    read_times,
    unwrap_counter,
)

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Seconds of each unit of time; no slip of one letter turns one into another."""

_COUNTER_NAME = re.compile(
    r"(?:index|samples?|sample[_ ]?(?:no|number|index)|count(?:er)?|cnt|nr?|no|row|point"
    r"|column_0)\.?|#|",
    re.IGNORECASE,
)

# Numbers of a counter of 8, 16 or 32 bits, or of two to six digits, before it begins again.
_COUNTER_SIZES = (100.0, 256.0, 1000.0, 10_000.0, 65_536.0, 100_000.0, 1e6, 2.0**32)

# Names of the first vector of a matrix, and of an abscissa.
_FIRST_VECTOR = re.compile(r"\(:,1\)$|\(1,:\)$|/0$|^X$")

# Unit of a count since 1970 in this century, by its minimum; the maximum is ten times that.
_EPOCHS = {1e9: "s", 1e12: "ms", 1e15: "us", 1e18: "ns"}

# Days of a spreadsheet (since 1900), and of MATLAB (since year 0), in this century.
_DAY_RANGES = ((20_000.0, 80_000.0), (700_000.0, 800_000.0))

# A column without a name that gives a higher rate is not a clock.
_MAX_UNNAMED_RATE_HZ = 1e8

# A shorter column may rise evenly by chance.
_MIN_CLOCK_SAMPLES = 16

# Samples at the beginning by which the kind of a column is decided.
_HEAD_SAMPLES = 1000


@dataclass(frozen=True)
class _Clock:
    unit: float | None
    """Seconds of one unit, or None if it is unknown."""
    rate: float | None
    """Sample rate [Hz], or None if the times do not show it."""
    problem: str
    """What is wrong with the times, or empty."""
    is_overruled: bool = False
    """Whether the stated rate counts, since the times were written in batches."""


def extract_time(
    path: Path, raw: RawFile, options: ReadOptions, header_rate: float | None = None
) -> RawFile:
    """Return the columns without clocks, which become the rates, and without counters.

    A column is a clock if the options or its name say so, or if it rises evenly and has no unit of
    another quantity. A clock holds for the columns of its group or structure; of several, the last
    one before a column holds for it. A counter states no rate, but samples that it skips are lost.
    If a clock states no rate, the attribute ``time_gaps`` says why. If a clock begins again,
    another recording begins.

    Parameters
    ----------
    header_rate : sample rate [Hz] that a header states and `raw` does not have yet.
    """
    raw = settle_axes(path, raw, options)
    require_recording_shape(path, raw.columns, options)
    paired_clocks = paired_times(raw) if options.time_column is None else []
    named_clocks = [name for name in raw.columns if parse_time_name(name) is not None]
    raw = trim_short_pairs(raw, paired_clocks or named_clocks)
    clock_names = paired_clocks or _find_clocks(path, raw, options)
    if len(clock_names) == 1:
        (clock_name,) = clock_names
        unit = _clock_unit(path, raw, clock_name, options)
        raw = separate_rows(raw, clock_name, partial(read_time_column, path, unit=unit))
        clock_names = [clock_name] if clock_name in raw.columns else []

    stated_rate = _stated_rate(raw, options, header_rate)
    clocks: dict[str, _Clock] = {}
    for name in clock_names:
        unit = _clock_unit(path, raw, name, options)
        clock = _read_clock(path, raw.columns[name], unit, stated_rate)
        if _is_guessed(raw, name, options) and not _agrees(clock, options):
            clock = _Clock(unit, None, "")
        clocks[name] = clock

    counters = _find_counters(raw, clock_names)
    signals = {
        name: column
        for name, column in raw.columns.items()
        if name not in clocks and name not in counters
    }
    require_samples(path, raw, signals)
    rates, starts, problems = _apply_clocks(path, raw, signals, clocks, options)

    if not problems:
        problems += _counter_problems(raw, counters)

    sample_rate = raw.sample_rate
    if not raw.rates and len(rates) == len(signals) and len(set(rates.values())) == 1:
        sample_rate = next(iter(rates.values()))
        rates = {}

    # Clocks that nothing but their even rise shows are reported to the user.
    guessed_clocks = [name for name in clocks if _is_guessed(raw, name, options)]
    attributes = dict(raw.attributes)
    for key, texts, separator in (
        ("clock_columns", guessed_clocks, ", "),
        ("counter_columns", counters, ", "),
        ("batch_columns", [name for name in clocks if clocks[name].is_overruled], ", "),
        ("time_gaps", problems, "; "),
    ):
        if texts:
            attributes[key] = separator.join(texts)

    return replace(
        raw,
        columns=signals,
        sample_rate=sample_rate,
        attributes=attributes,
        breaks=_clock_restarts(raw, clocks),
        units=_of_columns(raw.units, signals),
        rates=_of_columns(rates, signals),
        starts=_of_columns(starts, signals),
    )


def _stated_rate(raw: RawFile, options: ReadOptions, header_rate: float | None) -> float | None:
    """Return the sample rate [Hz] of the options, or else the only one of the file.

    That of the file does not count if the options name the time column.
    """
    if options.sample_rate is not None:
        with suppress(UnitError):
            return parse_quantity(options.sample_rate, "Hz")
        return None
    if options.time_column is not None:
        return None
    file_rates = {*raw.rates.values(), raw.sample_rate, header_rate} - {None}
    return file_rates.pop() if len(file_rates) == 1 else None


def _read_clock(
    path: Path, column: Column, unit: float | None, stated_rate: float | None
) -> _Clock:
    """Return the rate that a clock shows, or the stated one if its times agree in batches."""
    clock = None
    error = None
    try:
        clock = _Clock(unit, *read_time_column(path, column, unit))
    except DataError as cause:
        error = cause
    if clock is not None and clock.rate is not None and not clock.problem:
        return clock

    if (
        stated_rate is not None
        and stated_rate > 0
        and is_batched(read_times(column, unit or 1.0), 1 / stated_rate)
    ):
        return _Clock(unit, stated_rate, "", is_overruled=True)
    if error is not None:
        raise error
    assert clock is not None
    return clock


def _is_guessed(raw: RawFile, name: str, options: ReadOptions) -> bool:
    """Return whether nothing but its even rise shows that a column is a clock."""
    is_unnamed = parse_time_name(name) is None and _column_unit(raw, name) is None
    return options.time_column is None and is_unnamed


def _agrees(clock: _Clock, options: ReadOptions) -> bool:
    """Return whether a clock gives the specified rate, or no rate is specified."""
    if options.sample_rate is None or clock.rate is None or options.time_unit is not None:
        return True
    with suppress(UnitError):
        specified = parse_quantity(options.sample_rate, "Hz")
        return math.isclose(clock.rate, specified, rel_tol=MAX_RATE_ERROR)
    return True


def _of_columns(values: Mapping[str, Any], columns: Mapping[str, Column]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in columns}


def _apply_clocks(
    path: Path,
    raw: RawFile,
    signals: Mapping[str, Column],
    clocks: Mapping[str, _Clock],
    options: ReadOptions,
) -> tuple[dict[str, float], dict[str, str], list[str]]:
    """Return rates [Hz] and starts of the signals by their clocks, and the clocks' problems."""
    is_specified = options.time_column is not None
    rates = dict(raw.rates)
    starts = dict(raw.starts)
    problems: list[str] = []
    for name, column in signals.items():
        clock_name = _clock_for(raw, name, column, clocks)
        if clock_name is None:
            continue

        clock = clocks[clock_name]
        file_rate = raw.rates.get(name, raw.sample_rate)
        has_other_rate = file_rate or options.sample_rate is not None
        is_settled = clock.problem.startswith(NO_UNIT) and has_other_rate
        if clock.problem and clock.problem not in problems and not is_settled:
            problems.append(clock.problem)

        if clock.rate and file_rate and not is_specified:
            require_one_rate(path, name, file_rate, clock.rate, clock_name)
        if clock.rate and (not file_rate or is_specified):
            rates[name] = clock.rate
        if len(clocks) > 1:
            starts[name] = f"{float(raw.columns[clock_name][0:1][0]):.9g}"
    return rates, starts, problems


def _clock_restarts(raw: RawFile, clocks: Mapping[str, _Clock]) -> tuple[int, ...]:
    """Return the samples at which the only clock of a file begins again."""
    if len(clocks) != 1:
        return ()

    ((name, clock),) = clocks.items()
    if not clock.problem:
        return ()
    return tuple(find_restarts(read_times(raw.columns[name], clock.unit or 1.0)))


def require_one_rate(
    path: Path, name: str, file_rate: float, clock_rate: float, clock_name: str
) -> None:
    """Refuse a file whose stated rate [Hz] differs from the rate [Hz] of its time column."""
    if not math.isclose(clock_rate, file_rate, rel_tol=MAX_RATE_ERROR):
        raise DataError(
            f"{path} states two sample rates for {name}: {file_rate:g} Hz, and {clock_rate:g} Hz "
            f"by the times in {clock_name}.",
            field="time_column",
            remedy=f"Set {propose_setting('time_column', clock_name)} if the times are right, "
            "or correct the file.",
        )


def split_at_breaks(raw: RawFile) -> RawFile:
    """Return the recordings that begin at the breaks of a file as columns such as ``x [2]``."""
    if not raw.breaks:
        return raw

    columns: dict[str, Column] = {}
    starts: dict[str, str] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    sensitivities: dict[str, str] = {}
    foreign_units: dict[str, str] = {}
    for name, column in raw.columns.items():
        ends = [0, *raw.breaks, len(column)]
        for number, (first, end) in enumerate(pairwise(ends), 1):
            key = f"{name} [{number}]"
            columns[key] = slice_column(column, first, end)
            starts[key] = f"sample {first} of the file"
            if name in raw.units:
                units[key] = raw.units[name]
            if name in raw.foreign_units:
                foreign_units[key] = raw.foreign_units[name]
            if name in raw.rates:
                rates[key] = raw.rates[name]
            if name in raw.sensitivities:
                sensitivities[key] = raw.sensitivities[name]

    attributes = {name: text for name, text in raw.attributes.items() if name != "time_gaps"}
    return replace(
        raw,
        columns=columns,
        starts=starts,
        attributes=attributes,
        units=units,
        rates=rates,
        sensitivities=sensitivities,
        foreign_units=foreign_units,
    )


def find_time_column(path: Path, names: Sequence[str], options: ReadOptions) -> str | None:
    """Return the name of the time column by the options, or the first named as one, or None.

    Raises
    ------
    DataError
        The options name a column that the file does not have.
    """
    specified = options.time_column
    if specified is None:
        if len(names) < 2:
            return None
        return next((name for name in names if parse_time_name(name)), None)

    if isinstance(specified, int) and 0 <= specified < len(names):
        return names[specified]
    if isinstance(specified, str):
        for name in (specified, split_unit(specified)[0]):
            if name in names:
                return name
    raise DataError(
        f"{path} has no column {specified!r} for time_column; it has {', '.join(names)}."
    )


def _group_of(name: str) -> str:
    return re.split(r"[^./]*$", name)[0]


def _find_clocks(path: Path, raw: RawFile, options: ReadOptions) -> list[str]:
    """Return the specified time column, or those named as times, or those that rise evenly."""
    names = list(raw.columns)
    if options.time_column is not None:
        specified = find_time_column(path, names, options)
        return [] if specified is None else [specified]
    if len(names) < 2:
        return []

    named_clocks: list[str] = []
    rising_columns: list[str] = []
    for name in names:
        file_rate = raw.rates.get(name, raw.sample_rate)
        may_be_time = _may_be_time(raw, name)
        has_time_name = parse_time_name(name) is not None
        if has_time_name and ((may_be_time and file_rate is None) or _is_clock(raw, name)):
            named_clocks.append(name)
        elif (
            may_be_time
            and (is_name_empty(name) or _column_unit(raw, name) is not None)
            and _is_clock(raw, name, may_count=options.time_unit is not None)
            and (file_rate is None or _has_rate(raw.columns[name], file_rate))
        ):
            rising_columns.append(name)

    # T in degC is a temperature, beside a time of another name.
    named_clocks = [name for name in named_clocks if _may_be_time(raw, name)] or named_clocks
    clocks = named_clocks or rising_columns
    if len(named_clocks) > 1:
        clocks = [name for name in named_clocks if _is_clock(raw, name)] or clocks
    # Some column must remain as a signal.
    return clocks if len(clocks) < len(names) else clocks[:1]


def _column_unit(raw: RawFile, name: str) -> str | None:
    """Return the unit of a column.

    None if it is the unit of all columns, which does not hold for the time among them.
    """
    unit = raw.units.get(name)
    is_common = unit not in TIME_UNITS
    is_common = is_common and all(raw.units.get(column) == unit for column in raw.columns)
    if is_common and (parse_time_name(name) or _FIRST_VECTOR.search(name)):
        return None
    return unit


def _may_be_time(raw: RawFile, name: str) -> bool:
    is_other = name in raw.foreign_units or names_other(name)
    is_other = is_other or (parse_time_name(name) is None and unknown_unit(name) != "")
    return not is_other and _column_unit(raw, name) in (None, *TIME_UNITS)


def _clock_for(raw: RawFile, name: str, column: Column, clocks: Mapping[str, _Clock]) -> str | None:
    """Return the clock that holds for a column, or None.

    It has as many samples, and is in the group of the column or around it. The nearest group
    counts first, then a clock with a rate, then the last one before the column.
    """
    names = list(raw.columns)

    def rank(clock: str) -> tuple[int, bool, bool, int]:
        offset = names.index(clock) - names.index(name)
        is_before = offset < 0
        return (
            len(_group_of(clock)),
            clocks[clock].rate is not None,
            is_before,
            offset if is_before else -offset,
        )

    candidates = [
        clock
        for clock in clocks
        if len(raw.columns[clock]) == len(column) and name.startswith(_group_of(clock))
    ]
    return max(candidates, key=rank, default=None)


def _is_clock(raw: RawFile, name: str, *, may_count: bool = False) -> bool:
    """Return whether a column rises evenly, as no vibration does, at a rate of a measurement.

    Another column must have as many samples. A column that rises by one is a counter, unless
    somebody specified that it `may_count` the time.
    """
    column = raw.columns[name]
    same_length = sum(len(other) == len(column) for other in raw.columns.values())
    if len(column) < _MIN_CLOCK_SAMPLES or same_length < 2:
        return False

    head = unwrap_counter(_read_head(column))
    steps = np.diff(head)
    median_step = float(np.median(steps))
    is_even = np.abs(steps - median_step) <= 0.5 * median_step
    if not (np.isfinite(head).all() and (steps > 0).all() and is_even.mean() > 0.5):
        return False

    unit = _unit_by_size(head)
    rate = 1 / (median_step * TIME_UNITS[unit or "s"])
    is_counter = median_step == 1 and unit is None and not may_count
    if is_counter or rate > _MAX_UNNAMED_RATE_HZ:
        return False

    sparse = np.asarray(column[0 :: 1 + len(column) // MEDIAN_SAMPLES], dtype=np.float64)
    if (np.diff(sparse) > 0).all():
        return True
    return bool((np.diff(read_times(column, 1.0)) > 0).all())


def _read_head(column: Column) -> Float[np.ndarray, " time"]:
    return np.asarray(column[0:_HEAD_SAMPLES], dtype=np.float64)


def _has_rate(column: Column, rate: float) -> bool:
    """Return whether the steps [s] of a column give a rate [Hz]."""
    median_step = float(np.median(np.diff(_read_head(column))))
    return math.isclose(median_step * rate, 1.0, rel_tol=MAX_RATE_ERROR)


def _find_counters(raw: RawFile, clocks: Sequence[str]) -> list[str]:
    """Return counters of samples, and beside a clock further columns named as times."""
    rest = [name for name in raw.columns if name not in clocks]
    counters = [
        name
        for name in rest
        if (len(raw.columns) > 1 and _is_counter(raw, name))
        or (clocks and parse_time_name(name) and raw.units.get(name) in (None, *TIME_UNITS))
    ]
    return counters if len(counters) < len(rest) else []


def _is_counter(raw: RawFile, name: str) -> bool:
    """Return whether a column holds whole numbers that rise by one, or rises evenly.

    The numbers may begin again. The column has no unit of another quantity. A column that is named
    as a counter may skip samples.
    """
    column = raw.columns[name]
    if not _may_be_time(raw, name) or len(column) < 3:
        return False

    head = _read_head(column)
    if not (head == np.round(head)).all():
        return _is_clock(raw, name)

    steps = _counter_steps(head)
    may_skip = _COUNTER_NAME.fullmatch(name_in_group(name)) is not None
    may_skip = may_skip or len(steps) > 15
    if np.median(steps) == 1 and (steps >= 1).all() and may_skip:
        return True
    return _is_clock(raw, name)


def _counter_steps(counts: Float[np.ndarray, " time"]) -> Float[np.ndarray, " step"]:
    """Return the steps of a counter, which may begin again after its largest number.

    It does so after the number of its last bit, after all its digits, or as it did before.
    """
    steps = np.diff(counts)
    falls = steps < 0
    span = counts.max() - counts.min()
    if not falls.any() or span < 15:  # a counter of fewer bits than four is a flag
        return steps

    is_same_fall = steps[falls] == steps[falls][0]
    if is_same_fall.all() and steps[falls][0] == -span:
        steps[falls] = 1
        return steps
    for count in (*_COUNTER_SIZES, span + 1):
        if span < count <= 2 * span:
            return np.where(falls, steps + count, steps)
    return steps


def _counter_problems(raw: RawFile, counters: Sequence[str]) -> list[str]:
    """Return how many samples the first counter that skips any has lost."""
    for name in counters:
        lost = _count_lost_samples(raw.columns[name])
        if lost is not None:
            return [f"{name} skips {lost[0]} samples at {lost[1]} places"]
    return []


def _count_lost_samples(counter: Column) -> tuple[int, int] | None:
    """Return how many samples a counter skips, and at how many places; None if it skips none."""
    counts = np.asarray(counter[:], dtype=np.float64)
    if not np.isfinite(counts).all() or not (counts == np.round(counts)).all():
        return None  # a ramp, which counts no samples
    steps = _counter_steps(counts)
    if np.median(steps) != 1:
        return None

    gap_count = int((steps != 1).sum())
    return (int((steps - 1).sum()), gap_count) if gap_count else None


def _unit_by_size(head: Float[np.ndarray, " time"]) -> str | None:
    """Return the unit of times since 1970, or of days of a spreadsheet, by their size; else
    None.
    """
    for minimum, unit in _EPOCHS.items():
        if minimum <= head[0] < 10 * minimum:
            return unit

    is_date = any(lowest < head[0] < highest for lowest, highest in _DAY_RANGES)
    return "d" if is_date and 0 <= head[-1] - head[0] < 1 else None


def _clock_unit(path: Path, raw: RawFile, name: str, options: ReadOptions) -> float | None:
    """Return the seconds of one unit of a clock, or None if nothing states its unit.

    It is specified, or stated by the clock's heading, name or size.
    """
    time_name = parse_time_name(name)
    unit_in_name = None if time_name is None else time_name.unit

    unit = options.time_unit or _column_unit(raw, name) or unit_in_name
    unit = unit or _unit_by_size(_read_head(raw.columns[name]))
    if unit is None and re.search(r"[\[(].*[a-zA-Z].*[\])]$", name):
        unit = name  # an unknown unit in brackets, which must not be taken for seconds
    if unit is None:
        return None

    if normalize_unit(unit) not in TIME_UNITS:
        raise DataError(
            f"{path}: the time column {name!r} is in {unit!r}, which is not one of "
            f"{', '.join(TIME_UNITS)}.",
            field="time_unit",
            remedy="Set {time_unit='ms'} or what it is, or name another {time_column}.",
        )
    return TIME_UNITS[normalize_unit(unit)]
