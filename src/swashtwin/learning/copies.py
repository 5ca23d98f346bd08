"""Recordings that are in a set twice, at another gain and offset."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from swashtwin.foundation import stream
from swashtwin.recordings import Recording, rises_evenly

SAME_SHAPE = 1 - 1e-6
"""Correlation from which two stretches are one measurement at another gain and offset. Two measurements of one machine
stay far below it; rounding to another converter's steps (at 10 bits and more) stays above."""
_DIRECTIONS = 8
_AT_ONCE = 512


@dataclass(frozen=True)
class Location:
    """A channel of a recording."""

    recording_id: str
    """Recording."""
    channel: str
    """Channel."""


@dataclass(frozen=True)
class Copy:
    """Samples that occur a second time, at another gain and offset."""

    first: Location
    """Where they occur first."""
    again: Location
    """Where they occur again."""
    gain: float
    """Factor from the first to the second; negative where the sensor was turned over."""


def copied_recordings(recordings: Iterable[Recording]) -> tuple[Copy, ...]:
    """Every channel of a recording that is another one again; where every sample is the same, their hashes tell.

    Only those of one length are compared. Constant ones and ramps, such as those of a counter, are passed over: all of
    these are alike.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(size=(1, 100))
    >>> recordings = [Recording(gain * noise, 10.0, name) for name, gain in (("one", 1.0), ("two", -2.0))]
    >>> [(copy.again.recording_id, round(copy.gain, 3)) for copy in copied_recordings(recordings)]
    [('two', -2.0)]
    """
    locations, rows = [], []
    for recording in recordings:
        for channel, row in zip(recording.channels, recording.signal, strict=True):
            locations.append(Location(recording.recording_id, channel))
            rows.append(row)
    return tuple(_copies(locations, rows))


def _copies(locations: Sequence[Location], rows: Sequence[np.ndarray]) -> Iterator[Copy]:
    lengths: dict[int, list[int]] = {}
    for index, row in enumerate(rows):
        if np.isfinite(row).all() and np.ptp(row) > 0 and not rises_evenly(row, float(row[1] - row[0])):
            lengths.setdefault(len(row), []).append(index)
    for members in lengths.values():
        firsts: dict[bytes, int] = {}
        for member in members:
            firsts.setdefault(hashlib.sha256(np.ascontiguousarray(rows[member]).tobytes()).digest(), member)
        distinct = list(firsts.values())
        for index, later in _alike([rows[member] for member in distinct]):
            first, again = distinct[index], distinct[later]
            yield Copy(locations[first], locations[again], _gain(rows[first], rows[again]))


def _gain(first: np.ndarray, again: np.ndarray) -> float:
    centered = first - first.mean(dtype=np.float64)
    return float(centered @ (again - again.mean(dtype=np.float64)) / (centered @ centered))


def _alike(rows: Sequence[np.ndarray]) -> Iterator[tuple[int, int]]:
    """Pairs (first, later one) of rows that correlate beyond `SAME_SHAPE`, whatever the sign; each later one once.

    Standardized rows that correlate so lie within √(2 - 2·`SAME_SHAPE`) of each other, and so do their projections on
    a few random unit directions: a search among these leaves few pairs to correlate.
    """
    if len(rows) < 2:
        return
    width = len(rows[0])
    directions = stream(0, "copies", width).normal(size=(width, _DIRECTIONS))
    directions /= np.linalg.norm(directions, axis=0)
    parts = [np.stack(rows[at : at + _AT_ONCE]) for at in range(0, len(rows), _AT_ONCE)]
    seen = np.concatenate([_standardized(part) @ directions for part in parts])
    reach = float(np.sqrt(2 * (1 - SAME_SHAPE) * _DIRECTIONS))
    tree, copies = cKDTree(seen), set[int]()
    for index in range(len(rows)):
        if index in copies:
            continue
        near = {*tree.query_ball_point(seen[index], reach), *tree.query_ball_point(-seen[index], reach)}
        for later in sorted(near):
            if later > index and later not in copies:
                pair = _standardized(np.stack([rows[index], rows[later]]))
                if abs(float(pair[0] @ pair[1])) >= SAME_SHAPE:
                    copies.add(later)
                    yield index, later


def _standardized(rows: np.ndarray) -> Float[np.ndarray, "row time"]:
    """Rows without their mean, of norm 1."""
    centered = rows.astype(np.float64)
    centered -= centered.mean(axis=1, keepdims=True)
    unit: np.ndarray = centered / np.linalg.norm(centered, axis=1, keepdims=True)
    return unit
