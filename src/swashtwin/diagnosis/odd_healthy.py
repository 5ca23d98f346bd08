"""Odd recordings among a detector's healthy ones: left out, named, and what they would cost."""

import math

import numpy as np

from swashtwin.diagnosis.level_change import level_changes
from swashtwin.learning import (
    LEAST_HEALTHY,
    MOST_ODD,
    USUAL_ERROR_RATE,
    HealthyLevels,
    allowed_error_rate,
    least_rise,
    usual_recordings,
)

_MOST_NAMED = 6
_ALIKE = 4.0
"""A recording is like those of another point where its score is so many times lower there."""


def leave_out_odd(healthy: HealthyLevels, error_rate: float | None) -> tuple[HealthyLevels, tuple[str, ...]]:
    """(the usual recordings, notes on the odd ones: names, what moved, what they cost).

    All stay where more than `MOST_ODD` are odd, for then they are another state of the machine.

    Parameters
    ----------
    error_rate : false-alarm rate asked for, if any.
    """
    is_usual = usual_recordings(healthy.levels, healthy.point_index)
    odd = np.flatnonzero(~is_usual).tolist()
    if not odd:
        return healthy, ()
    usual, count = healthy.subset(is_usual), healthy.n_recordings
    names = list(healthy.manifest)
    named = ", ".join(names[row] for row in odd[:_MOST_NAMED])
    named += f" and {len(odd) - _MOST_NAMED} more" if len(odd) > _MOST_NAMED else ""
    with_them, without = (
        least_rise(part.levels, part.point_index, error_rate or allowed_error_rate(part.n_recordings, USUAL_ERROR_RATE))
        for part in (healthy, usual)
    )
    cost = f"a change would have to be {with_them / without:.1f} times as large (in dB) to be heard"
    if len(odd) > MOST_ODD * count or usual.n_recordings < LEAST_HEALTHY:
        return healthy, (
            f"{len(odd)} of {count} healthy recordings are unlike the others ({named}), too many to leave out; with "
            f"them {cost}. State the operating point of each, or train on the recordings of one state of the machine.",
        )
    return usual, (
        *(_left_out(names[row], healthy, row, usual) for row in odd),
        f"With {named} {cost}. A healthy recording of that kind is an alarm: where they come as often again, the "
        f"false-alarm rate is {(len(odd) + 1) / (count + 1):.2g}.",
    )


def _left_out(name: str, healthy: HealthyLevels, row: int, usual: HealthyLevels) -> str:
    """That a recording is left out, and why."""
    point = healthy.points[healthy.point_index[row]]
    if point not in usual.points:
        return f"{name} is left out: the recordings of its operating point are not alike, so none shows what is usual."
    at_points = [usual.deviation_of(healthy.levels[row], index) for index in range(len(usual.points))]
    own, nearest = at_points[usual.points.index(point)], min(at_points, key=lambda deviation: deviation.score)
    speed = healthy.speed[row] / (2 * math.pi)
    shifts, changes = level_changes(own, healthy.layout.levels, None if math.isnan(speed) else speed)
    words = [f"it is like those at {nearest.point}"] if _ALIKE * nearest.score < own.score else []
    words += [*shifts, *(change.sentence for change in changes)]
    return f"{name} is left out, for it is unlike the other healthy recordings: {'; '.join(words[:2])}."
