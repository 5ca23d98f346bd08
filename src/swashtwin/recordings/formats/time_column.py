"""The times of a column: the rate that they show, and what is wrong with their spacing."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.raw import BLOCK, Column, snapped_rate

COARSE = 5e-3
"""Relative doubt about a rate beyond which a time column does not state it."""
_SLOW = 20.0
"""Rate [Hz] up to which times without a unit are doubted: they may as well be milliseconds, or ticks."""
_MOST_PARTS = 100
"""Recordings that one table holds at most; a clock that begins again more often is broken."""
NO_UNIT = "its times have no unit"
"""How the doubt about times begins that a stated rate removes."""
ENOUGH = 1 << 18
"""Samples, spread over the whole column, of which a median is taken."""
_HEAD = 1000


def read_time_column(path: Path, column: Column, unit: float | None = 1.0) -> tuple[float | None, str]:
    """Sample rate [Hz] of a time column, and what is wrong with its spacing (empty where nothing is).

    The column is read in blocks. The rate is None where the times are too coarse to tell it, or have no unit and would
    give an unlikely one.

    Parameters
    ----------
    unit : seconds of one unit of the column; None where nobody says it.
    """
    time = TimeColumn(column, unit or 1.0)
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
            f'{NO_UNIT}, and would be {rate:.6g} Hz in seconds; say time_unit = "ms" or what it is',
        )
    return rate, gaps


def _rate(
    path: Path, time: "TimeColumn", sparse: Float[np.ndarray, " time"], usual: float, quantum: float
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
        return (None if tolerance > COARSE else snapped_rate(step, tolerance)), ""
    if usual <= 0:
        raise DataError(f"{path}: most steps of the time column are zero or negative; name another time_column.")
    steps = time.every(time.stride, steps=True)
    steps = steps[np.abs(steps - usual) < 0.25 * usual]
    tolerance = max(1e-6, min(0.01, 4 * quantum / (usual * len(steps))))
    return snapped_rate(float(steps.mean()), tolerance), time.spacing(usual, quantum)


class TimeColumn:
    """Times in seconds; never more of them are in memory than a block, and a sparse sample of all."""

    def __init__(self, column: Column, unit: float) -> None:
        self._column, self._unit = column, unit
        self.count = len(column)
        self._origin: Any = 0
        self.stride = 1 + self.count // ENOUGH
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
