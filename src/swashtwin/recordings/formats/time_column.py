"""The sample rate that the times of a column show, and what is wrong with their spacing."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, propose_setting, render_settings, spell_for_index
from swashtwin.recordings.columns import BLOCK_SAMPLES, Column, number_type
from swashtwin.recordings.formats.raw_file import snap_rate

MAX_RATE_ERROR = 5e-3
"""Relative uncertainty of a rate above which a time column does not state it."""
MEDIAN_SAMPLES = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""
NO_UNIT = "its times have no unit"
"""Beginning of the doubt about times that a specified rate or unit removes."""

# Times without a unit that give a lower rate may as well be milliseconds, or ticks.
_MAX_DOUBTED_RATE_HZ = 20.0

# Recordings of one table; a clock that begins again more often is broken.
_MAX_PARTS = 100

# Times beyond it are since 1970, and need their digits for the steps between them.
_EPOCH_THRESHOLD_S = 1e6

# Relative tolerance of a rate: clocks of instruments are no better.
_MIN_TOLERANCE = 1e-6

_MAX_TOLERANCE = 0.01

# Samples at each end of a column by which the digits of its times are counted.
_DIGIT_SAMPLES = 1000

# Relative distance from the median within which a step counts as one sample.
_REGULAR_BAND = 0.25

# Sizes of counters that begin again, and the powers of ten by which their numbers may be divided.
_COUNTER_SIZES = (2.0**16, 2.0**24, 2.0**32)
_COUNTER_DIVISORS = (1.0, 1e3, 1e6, 1e9)

# Share of a counter's period that may be lost as it begins again.
_MAX_LOST_SHARE = 1e-3

# Share of long steps above which they are losses if the mean step is larger for it. Rarer ones are
# losses only if the whole time shows each of them.
_MIN_FREQUENT_SHARE = 0.005

# Steps that are too long from which on times may be written in batches.
_MIN_BATCHES = 8

# Time that steps are too long in all, of which this share may remain at the end: times of batches
# are made up for, lost samples are not.
_MAX_REMAINING_SHARE = 0.2


def read_time_column(
    path: Path, column: Column, unit: float | None = 1.0
) -> tuple[float | None, str]:
    """Return the sample rate [Hz] of a time column, and what is wrong with its spacing.

    The rate is None if the times are too coarse to tell it, or if they have no unit and would give
    an unlikely one. The text is empty if nothing is wrong.

    Parameters
    ----------
    unit : seconds of one unit of the column; None if it is unknown.

    Raises
    ------
    DataError
        The column does not rise, or its first time is missing.
    """
    time = read_times(column, unit or 1.0)

    is_missing = ~np.isfinite(time)
    if is_missing[:1].any():
        raise DataError(
            f"{path}: the time column has no time at its first sample; remove that line."
        )
    if is_missing.any():
        return None, f"the time column has no time at {int(is_missing.sum())} of its samples"

    steps = np.diff(time)
    median_step = _median(steps) if time.size > 2 else 0.0
    if time.size < 3 or not (time[-1] > time[0] or median_step > 0):
        raise DataError(f"{path}: the time column does not rise from its first to its last sample.")

    quantum = _time_resolution(column, time, unit or 1.0)
    rate, problem = _rate(path, time, steps, median_step, quantum)
    if unit is None and rate is not None and rate <= _MAX_DOUBTED_RATE_HZ:
        advice = render_settings("set {time_unit='ms'} or what it is")
        return None, f"{NO_UNIT}, and would be {rate:.6g} Hz in seconds; {advice}"
    return rate, problem


def read_times(column: Column, unit: float) -> Float[np.ndarray, " time"]:
    """Return the times of a column [s]; times since 1970 are returned since the first.

    A counter that begins again after its last number goes on (`unwrap_counter`).

    Parameters
    ----------
    unit : seconds of one unit of the column.
    """
    counts = np.empty(len(column), dtype=number_type(column))
    for start in range(0, len(column), BLOCK_SAMPLES):
        counts[start : start + BLOCK_SAMPLES] = column[start : start + BLOCK_SAMPLES]
    counts = unwrap_counter(counts)

    # Before the conversion to floating point, which would round the steps.
    if counts.size and abs(float(counts[0]) * unit) > _EPOCH_THRESHOLD_S:
        counts = counts - counts[0]
    times = np.asarray(counts, dtype=np.float64)
    return times if unit == 1 else times * unit


def unwrap_counter(counts: np.ndarray) -> np.ndarray:
    """Return the numbers of a counter as if it had not begun again after its last number.

    The last number is that of 16, 24 or 32 bits, or a thousandth, a millionth, ... of it. One step,
    or a small share of the period if samples were lost there, must lie between the last and the
    next number. Otherwise the numbers are returned unchanged: another recording begins.

    Examples
    --------
    >>> unwrap_counter(np.array([65000, 65300, 64, 364]))
    array([65000, 65300, 65600, 65900])
    """
    numbers = np.asarray(counts, dtype=np.float64)
    falls = np.flatnonzero(numbers[1:] < numbers[:-1])
    if not falls.size:  # most columns, which may be long
        return counts
    steps = np.diff(numbers)
    rises = steps[steps > 0]
    if not rises.size or not np.isfinite(numbers).all():
        return counts

    usual_step = float(np.median(rises))
    span = numbers.max() - numbers.min()
    restarts_alike = numbers[falls[0] + 1] == numbers[0]
    for divisor in _COUNTER_DIVISORS:
        for size in _COUNTER_SIZES:
            # Blocks of 65536 samples are as likely as a counter of samples that begins again.
            if span >= size / divisor or (restarts_alike and usual_step * divisor == 1):
                continue
            jumps = steps[falls] + size / divisor
            is_next = np.abs(jumps - usual_step) < 0.5 * usual_step
            is_near = (jumps > 0) & (jumps < _MAX_LOST_SHARE * size / divisor)
            if (is_next | is_near).all():
                is_integer = counts.dtype.kind in "iu" and divisor == 1
                period = int(size) if is_integer else size / divisor
                n_wraps = np.zeros(len(counts), np.int64)
                n_wraps[falls + 1] = 1
                kind = np.int64 if is_integer else np.float64
                return counts.astype(kind) + period * np.cumsum(n_wraps)
    return counts


def is_batched(time: Float[np.ndarray, " time"], sample_step: float) -> bool:
    """Return whether times [s] are those of even steps, written in batches.

    Steps are often too long, and others make up for it. If samples were lost, nothing does.

    Parameters
    ----------
    sample_step : time between two samples [s].
    """
    if time.size < 3 or not np.isfinite(time).all():
        return False
    steps = np.diff(time)
    excess = steps - sample_step
    too_long = excess[excess > 0.5 * sample_step]
    if too_long.size < _MIN_BATCHES:
        return False
    # The last batch may be incomplete.
    max_remainder = min(1.5 * steps.max(), _MAX_REMAINING_SHARE * too_long.sum())
    return bool(abs(excess.sum()) <= max_remainder)


def find_restarts(time: Float[np.ndarray, " time"]) -> list[int]:
    """Return the samples at which the time begins again and goes on from there.

    None if it does so all the time: that clock is broken.
    """
    # Two samples must lie before, and the next one after them must go on: a single outlier, or two
    # samples that were swapped, are not a restart.
    earliest_regular = time[1:-2] - 10 * _median(np.diff(time))
    is_back = time[2:-1] < earliest_regular
    is_back &= (time[2:-1] < time[:-3]) & (time[3:] < time[1:-2])
    restarts: list[int] = (2 + np.flatnonzero(is_back)).tolist()
    return restarts if len(restarts) <= _MAX_PARTS else []


def _median(values: Float[np.ndarray, " step"]) -> float:
    """Return the median of some values, spread over all."""
    return float(np.median(values[:: _median_stride(len(values))]))


def _median_stride(n_values: int) -> int:
    """Return the distance of the values of which a median is taken."""
    return 1 + n_values // MEDIAN_SAMPLES


def _time_resolution(column: Column, time: Float[np.ndarray, " time"], unit: float) -> float:
    """Return the resolution [s] to which the times are written."""
    end_digits: list[int] = []
    for end in (time[:_DIGIT_SAMPLES], time[-_DIGIT_SAMPLES:]):  # later times may have fewer digits
        fitting = (
            digits for digits in range(12) if np.abs(end - np.round(end, digits)).max() < 1e-12
        )
        end_digits.append(next(fitting, 12))
    written = 10.0 ** -min(end_digits)

    # A count of days since 1900 in double precision is not as fine as its digits.
    first = np.asarray(column[0:1])[0]
    if not isinstance(first, np.floating):
        return max(written, 0.0)
    return max(written, 2 * unit * float(np.spacing(abs(first))))


def _rate(
    path: Path,
    time: Float[np.ndarray, " time"],
    steps: Float[np.ndarray, " step"],
    median_step: float,
    quantum: float,
) -> tuple[float | None, str]:
    """Return the rate [Hz] of times that are written to `quantum` [s], and what is wrong.

    If samples are lost, the rate is that of the steps between those that are not. Else it is that
    of the whole time, to which the rounding of the times contributes least.
    """
    mean_step = _mean_step(time, steps, quantum)

    sample_step = None
    if mean_step > 0:
        sample_step = _step_with_losses(steps, mean_step, quantum)
    if sample_step is not None and math.isnan(sample_step):
        return None, (
            f"its times are too coarse to tell {1 / median_step:.6g} Hz with samples lost from "
            f"{1 / mean_step:.6g} Hz without"
        )
    if sample_step is not None:
        tolerance = max(_MIN_TOLERANCE, min(_MAX_TOLERANCE, 0.1 * quantum / sample_step))
        resolution = min(quantum, 0.1 * sample_step)
        problem = _describe_spacing(time, steps, sample_step, resolution)
        return snap_rate(sample_step, tolerance), problem

    drift = _drift(time, mean_step)
    if drift <= max(0.5 * mean_step, 1.01 * quantum):
        span = time[-1] - time[0]
        tolerance = max(_MIN_TOLERANCE, min(quantum, 4 * drift) / span)
        return (None if tolerance > MAX_RATE_ERROR else snap_rate(mean_step, tolerance)), ""

    if median_step <= 0:
        raise DataError(
            f"{path}: most steps of the time column are zero or negative.",
            field="sample_rate",
            remedy="If its times were written in batches, set the sample rate, such as "
            f"{propose_setting('sample_rate', f'{1 / mean_step:.6g} Hz')} (their mean); or name "
            "another {time_column}.",
        )
    regular_steps = steps[np.abs(steps - median_step) < _REGULAR_BAND * median_step]
    tolerance = 4 * quantum / (median_step * len(regular_steps))
    tolerance = max(_MIN_TOLERANCE, min(_MAX_TOLERANCE, tolerance))
    rate = snap_rate(float(regular_steps.mean()), tolerance)
    return rate, _describe_spacing(time, steps, median_step, quantum)


def _drift(time: Float[np.ndarray, " time"], mean_step: float) -> float:
    """Return the maximum deviation [s] of times from even steps."""
    stride = _median_stride(len(time))
    indices = np.arange(0, len(time), stride)
    offset = float(np.median(time[::stride] - mean_step * indices))

    drift = 0.0
    for start in range(0, len(time), BLOCK_SAMPLES):
        block = time[start : start + BLOCK_SAMPLES]
        deviation = block - mean_step * np.arange(start, start + len(block))
        drift = max(drift, float(np.abs(deviation - offset).max()))
    return drift


def _mean_step(
    time: Float[np.ndarray, " time"], steps: Float[np.ndarray, " step"], quantum: float
) -> float:
    """Return the mean step [s] from the ends, or from all pairs half the time apart.

    The second holds if the first or the last time contradicts the others.
    """
    span = time[-1] - time[0]
    half = len(time) // 2
    mean_step: float = span / len(steps)
    stride = _median_stride(len(time) - half)
    paired_times = time[half::stride] - time[: len(time) - half : stride]
    paired_step = float(np.median(paired_times)) / half
    if abs(mean_step - paired_step) * len(time) > 4 * quantum + 1e-9 * span:
        return max(paired_step, 1e-300)
    return mean_step


def _step_with_losses(
    steps: Float[np.ndarray, " step"], mean_step: float, quantum: float
) -> float | None:
    """Return the time between neighboring samples [s] if samples are lost, else None.

    Lost samples make the mean step larger than that of neighbors. NaN if steps of one and of two
    quanta may as well be a lower rate without losses.
    """
    median_step = _median(steps)
    long_share = (steps > 1.5 * median_step).mean()
    is_one_quantum = abs(median_step / quantum - 1) < 1e-6 and steps.min() > 0
    if long_share == 0 or not (median_step > 4 * quantum or is_one_quantum):
        return None
    if is_one_quantum and long_share > 0.15 and steps.max() < 2.5 * median_step:
        return math.nan

    is_regular = np.abs(steps - median_step) < _REGULAR_BAND * median_step
    sample_step = float(steps[is_regular].mean())
    if long_share < _MIN_FREQUENT_SHARE:
        return sample_step if _long_steps_are_losses(steps, sample_step) else None
    return sample_step if mean_step / sample_step - 1 > 2e-3 else None


def _long_steps_are_losses(steps: Float[np.ndarray, " step"], sample_step: float) -> bool:
    """Return whether the whole time is longer by just the samples that long steps lack.

    A clock that is read late makes a long step too, but a short one follows, and the whole time
    is that of all samples.
    """
    long_steps = steps[steps > 1.5 * sample_step]
    lacking_in_steps = float((np.round(long_steps / sample_step) - 1).sum())
    lacking_in_time = float(steps.sum()) / sample_step - steps.size
    return abs(lacking_in_time - lacking_in_steps) <= max(0.5, 0.1 * lacking_in_steps)


def _describe_spacing(
    time: Float[np.ndarray, " time"],
    steps: Float[np.ndarray, " step"],
    regular_step: float,
    quantum: float,
) -> str:
    """Return what is wrong with the steps between samples."""
    deviation = np.abs(steps - regular_step)
    irregular_count = int((deviation > 0.5 * regular_step + quantum).sum())
    if not irregular_count:
        return f"steps drift between {steps.min():.6g} s and {steps.max():.6g} s"

    worst = int(deviation.argmax())
    description = (
        f"{irregular_count} of {len(steps)} steps differ from the usual {regular_step:.6g} s; "
        f"the worst is {steps[worst]:.6g} s at {time[worst]:.6g} s"
    )
    mean_rate = len(steps) / (time[-1] - time[0])
    if irregular_count >= _MIN_BATCHES and is_batched(time, 1 / mean_rate):
        advice = propose_setting("sample_rate", f"{mean_rate:.5g} Hz")
        description += "; " + render_settings(
            f"if the times were written in batches, set {advice} (their mean) or what it is; "
            "else samples were lost",
            spell_for_index,
        )
    return description
