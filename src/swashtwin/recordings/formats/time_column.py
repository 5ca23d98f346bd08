"""The times of a column: the rate that they show, and what is wrong with their spacing."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.columns import BLOCK_SAMPLES, Column
from swashtwin.recordings.formats.raw_file import snap_rate

COARSE = 5e-3
"""Relative doubt about a rate beyond which a time column does not state it."""
_SLOW = 20.0
"""Rate [Hz] up to which times without a unit are doubted: they may as well be milliseconds, or
ticks.
"""
_MOST_PARTS = 100
"""Recordings that one table holds at most; a clock that begins again more often is broken."""
NO_UNIT = "its times have no unit"
"""How the doubt about times begins that a stated rate removes."""
ENOUGH = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""
_HEAD = 1000


def read_time_column(
    path: Path, column: Column, unit: float | None = 1.0
) -> tuple[float | None, str]:
    """Sample rate [Hz] of a time column, and what is wrong with its spacing (empty where nothing
    is).

    The rate is None where the times are too coarse to tell it, or have no unit and would give an
    unlikely one.

    Parameters
    ----------
    unit : seconds of one unit of the column; None where nobody says it.
    """
    time = times_of(column, unit or 1.0)
    missing = ~np.isfinite(time)
    if missing[:1].any():
        raise DataError(
            f"{path}: the time column has no time at its first sample; remove that line."
        )
    if missing.any():
        return None, f"the time column has no time at {int(missing.sum())} of its samples"
    steps = np.diff(time)
    usual = _median(steps) if time.size > 2 else 0.0
    if time.size < 3 or not (time[-1] > time[0] or usual > 0):
        raise DataError(f"{path}: the time column does not rise from its first to its last sample.")
    ends = time[:_HEAD], time[-_HEAD:]  # later times may have fewer digits
    digits = min(
        next((d for d in range(12) if np.abs(end - np.round(end, d)).max() < 1e-12), 12)
        for end in ends
    )
    first = np.asarray(column[0:1])[0]  # a count of days is not as fine as its digits
    spacing = (
        2 * (unit or 1.0) * float(np.spacing(abs(first))) if isinstance(first, np.floating) else 0.0
    )
    rate, gaps = _rate(path, time, steps, usual, max(10.0**-digits, spacing))
    if unit is None and rate is not None and rate <= _SLOW:
        return (
            None,
            f'{NO_UNIT}, and would be {rate:.6g} Hz in seconds; say time_unit = "ms" or what it is',
        )
    return rate, gaps


def times_of(column: Column, unit: float) -> Float[np.ndarray, " time"]:
    """Times of a column [s]; those since 1970 since the first, as their digits are needed for the
    steps.
    """
    counts = np.concatenate(
        [np.asarray(column[at : at + BLOCK_SAMPLES]) for at in range(0, len(column), BLOCK_SAMPLES)]
        or [np.empty(0)]
    )
    if counts.size and abs(float(counts[0]) * unit) > 1e6:
        counts = counts - counts[0]
    return np.asarray(counts, dtype=np.float64) * unit


def restarts(time: Float[np.ndarray, " time"]) -> list[int]:
    """Samples at which the time begins again and goes on from there; none where it does so all the
    time.
    """
    late = time[1:-2] - 10 * _median(np.diff(time))
    back = (time[2:-1] < late) & (time[2:-1] < time[:-3]) & (time[3:] < time[1:-2])
    found: list[int] = (2 + np.flatnonzero(back)).tolist()
    return found if len(found) <= _MOST_PARTS else []


def _median(values: Float[np.ndarray, " step"]) -> float:
    """Median of some thousands of them, spread over all."""
    return float(np.median(values[:: 1 + len(values) // ENOUGH]))


def _rate(
    path: Path,
    time: Float[np.ndarray, " time"],
    steps: Float[np.ndarray, " step"],
    usual: float,
    quantum: float,
) -> tuple[float | None, str]:
    """Rate [Hz] of times that are written to `quantum` [s], and what is wrong with their
    spacing.
    """
    span, number = time[-1] - time[0], np.arange(len(time))
    step, half = span / len(steps), len(time) // 2
    if abs(step - (paired := _median(time[half:] - time[: len(time) - half]) / half)) * len(
        time
    ) > 4 * quantum + (1e-9 * span):
        step = max(paired, 1e-300)  # the first or the last contradicts the others
    if step > 0 and (regular := _regular_step(steps, step, quantum)) is not None:
        if math.isnan(regular):
            return None, (
                f"its times are too coarse to tell {1 / usual:.6g} Hz with samples lost from {1 / step:.6g} Hz without"
            )
        tolerance = max(1e-6, min(0.01, 0.1 * quantum / regular))
        return snap_rate(regular, tolerance), _spacing(
            time, steps, regular, min(quantum, 0.1 * regular)
        )
    strayed = time - step * number
    drift = float(np.abs(strayed - _median(strayed)).max())
    if drift <= max(0.5 * step, 1.01 * quantum):
        tolerance = max(1e-6, min(quantum, 4 * drift) / span)
        return (None if tolerance > COARSE else snap_rate(step, tolerance)), ""
    if usual <= 0:
        raise DataError(
            f"{path}: most steps of the time column are zero or negative; name another time_column."
        )
    even = steps[np.abs(steps - usual) < 0.25 * usual]
    tolerance = max(1e-6, min(0.01, 4 * quantum / (usual * len(even))))
    return snap_rate(float(even.mean()), tolerance), _spacing(time, steps, usual, quantum)


def _regular_step(steps: Float[np.ndarray, " step"], step: float, quantum: float) -> float | None:
    """Time between neighbors [s], where so many samples are lost that `step`, the mean, is another;
    else None.

    NaN where steps of one and of two quanta may as well be a lower rate.
    """
    usual = _median(steps)
    lost = (steps > 1.5 * usual).mean()
    is_least = abs(usual / quantum - 1) < 1e-6 and steps.min() > 0
    if lost < 0.005 or not (usual > 4 * quantum or is_least):
        return None
    if is_least and lost > 0.15 and steps.max() < 2.5 * usual:
        return math.nan
    usual = float(steps[np.abs(steps - usual) < 0.25 * usual].mean())
    return usual if step / usual - 1 > 2e-3 else None


def _spacing(
    time: Float[np.ndarray, " time"],
    steps: Float[np.ndarray, " step"],
    usual: float,
    quantum: float,
) -> str:
    """What is wrong with the steps between samples."""
    off = np.abs(steps - usual)
    odd, worst = int((off > 0.5 * usual + quantum).sum()), int(off.argmax())
    if not odd:
        return f"steps drift between {steps.min():.6g} s and {steps.max():.6g} s"
    return (
        f"{odd} of {len(steps)} steps differ from the usual {usual:.6g} s; "
        f"the worst is {steps[worst]:.6g} s at {time[worst]:.6g} s"
    )
