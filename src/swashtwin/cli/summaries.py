"""Many recordings in few lines: what the screen shows by class and operating condition."""

import math
import statistics
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Annotated, TypeVar

import typer

T = TypeVar("T")

MOST_ROWS = 12
"""Recordings that are shown one by one; more are summed up."""

All = Annotated[bool, typer.Option("--all", help="Show each recording, not a summary by class and condition.")]


def grouped(items: Iterable[T], key: Callable[[T], Hashable]) -> list[list[T]]:
    """Items with equal keys together, in the order of their first."""
    groups: dict[Hashable, list[T]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def condition_words(ids: Sequence[str], speed: Sequence[float], pressure: Sequence[float]) -> list[str]:
    """Operating condition of each recording in words, a dash where nobody states any.

    Parameters
    ----------
    ids : recordings, for messages.
    speed : angular speed [rad/s], NaN where not stated.
    pressure : discharge pressure [Pa], NaN where not stated.
    """
    import numpy as np

    from swashtwin.recordings import condition_names

    facts = np.array([speed, pressure], dtype=float)
    words = np.full(len(ids), "-", dtype=object)
    for known in {tuple(column) for column in (~np.isnan(facts)).T.tolist()}:
        if any(known):
            own = np.flatnonzero((~np.isnan(facts) == np.array(known)[:, None]).all(axis=0))
            words[own] = condition_names([ids[place] for place in own.tolist()], *facts[:, own])
    return [str(word) for word in words]


def spread_of(values: Iterable[float], digits: int = 4) -> str:
    """Least and greatest of the values that are numbers, in so many digits, or the one they all are."""
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return "-"
    least, most = f"{min(known):.{digits}g}", f"{max(known):.{digits}g}"
    return least if least == most else f"{least} to {most}"


def median_of(values: Iterable[float]) -> float | None:
    """Median of the values that are numbers, or None."""
    known = [value for value in values if math.isfinite(value)]
    return statistics.median(known) if known else None
