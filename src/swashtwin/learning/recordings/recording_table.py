"""Levels of whole recordings, and what of one differs from the healthy ones of its machine."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import compress

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64

from swashtwin.foundation import InputError
from swashtwin.learning.recordings.recording_levels import RecordingLevels
from swashtwin.learning.windows.operating_point import group_means, operating_points
from swashtwin.learning.windows.window_set import WindowSet

LEAST_OWN = 2
"""Healthy recordings of a machine from which changes from them are taken."""
_NEAR = 0.1
"""Distance of two operating points, in logarithms of speed and pressure, at which one counts half for the other."""
_SAME = 0.06
"""Such a distance up to which two points are the same."""
_ROUNDS = 4


Rows = Int64[np.ndarray, " _window"]
Change = Callable[[Float32[np.ndarray, "channel time"]], Float32[np.ndarray, "channel time"]]


def recording_rows(windows: WindowSet) -> list[Rows]:
    """Rows of each recording's windows in order of time, in the order of the ids."""
    order = np.lexsort((windows.start, windows.recording_id))
    names = windows.recording_id[order]
    return [part for part in np.split(order, np.flatnonzero(names[1:] != names[:-1]) + 1) if part.size]


def joined(windows: WindowSet, rows: Rows) -> Iterator[Float32[np.ndarray, "channel time"]]:
    """Stretches without a gap that a recording's windows, which may overlap, make up."""
    parts, end = list[np.ndarray](), 0
    for row in rows.tolist():
        start = int(windows.start[row])
        if parts and not 0 <= end - start <= windows.length:
            yield np.concatenate(parts, axis=1)
            parts = []
        parts.append(windows.signal[row][:, end - start if parts else 0 :])
        end = start + windows.length
    yield np.concatenate(parts, axis=1)


def shortest_stretch(windows: WindowSet) -> int:
    """Samples of the longest stretch of the recording whose longest stretch is the shortest."""
    return min(max(part.shape[1] for part in joined(windows, rows)) for rows in recording_rows(windows))


def levels_of(
    layout: RecordingLevels, windows: WindowSet, rows: list[Rows], change: Change = lambda stretch: stretch
) -> Float[np.ndarray, "recording channel level"]:
    """Levels of recordings by their windows: of their stretches the mean by length.

    Parameters
    ----------
    rows : rows of each recording's windows, as of `recording_rows`.
    change : what is done to each stretch before.
    """
    levels = np.empty((len(rows), windows.n_channels, layout.n_levels), dtype=np.float32)
    for number, members in enumerate(rows):
        shaft = float(windows.speed[members[0]]) / (2 * np.pi)
        parts = list(joined(windows, members))
        weights = [part.shape[1] for part in parts]
        levels[number] = np.average([layout.measure(change(part), shaft) for part in parts], axis=0, weights=weights)
    return levels


@dataclass(frozen=True, eq=False)
class RecordingTable:
    """Levels of whole recordings, with what is known of each; it holds no samples."""

    levels: Float32[np.ndarray, "reference channel level"]
    """Of each recording."""
    specimen: tuple[str, ...]
    """Machine of each."""
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each, NaN where not stated."""
    recording_id: tuple[str, ...]
    """The recordings."""

    def __post_init__(self) -> None:
        count = len(self.levels)
        if not count == len(self.specimen) == len(self.condition) == len(self.recording_id):
            raise InputError("levels of recordings need a machine, an operating point and an id each.")

    @classmethod
    def measured(cls, layout: RecordingLevels, windows: WindowSet) -> "RecordingTable":
        """The table of the recordings that windows were cut from, in the order of their ids."""
        rows = recording_rows(windows)
        first = [int(members[0]) for members in rows]
        return cls(
            levels_of(layout, windows, rows),
            tuple(windows.specimen[first].tolist()),
            np.stack([windows.condition(index) for index in first]),
            tuple(windows.recording_id[first].tolist()),
        )

    def machines(self) -> tuple[str, ...]:
        """Machines with `LEAST_OWN` healthy recordings or more, in order."""
        names, count = np.unique(self.specimen, return_counts=True)
        return tuple(name for name, n in zip(names.tolist(), count.tolist(), strict=True) if name and n >= LEAST_OWN)

    def joined(self, other: "RecordingTable") -> "RecordingTable":
        """These and further recordings; of one id the new one."""
        old = self.only(~np.isin(self.recording_id, other.recording_id))
        return RecordingTable(
            np.concatenate([old.levels, other.levels]),
            old.specimen + other.specimen,
            np.concatenate([old.condition, other.condition]),
            old.recording_id + other.recording_id,
        )

    def only(self, used: Bool[np.ndarray, " reference"]) -> "RecordingTable":
        """Those that a mask keeps."""
        specimen, recording_id = (tuple(compress(part, used.tolist())) for part in (self.specimen, self.recording_id))
        return RecordingTable(self.levels[used], specimen, self.condition[used], recording_id)

    def changes(self, layout: RecordingLevels, of: "RecordingTable") -> Float32[np.ndarray, "recording channel level"]:
        """Changes of recordings from the others of their machine in this table of healthy ones; NaN where it has none.

        What an operating point adds is the same for all machines (`_of_points`) and is taken off, as other machines
        have it: so each healthy recording of a machine counts, those near the recording's point most. A channel that
        moved as a whole is taken for a gain (`RecordingLevels.without_gain`).
        """
        own, ids = np.array(self.specimen, dtype=np.str_), np.array(self.recording_id, dtype=np.str_)
        changes = np.full(of.levels.shape, np.nan, dtype=np.float32)
        for row, (name, at, this) in enumerate(zip(of.specimen, of.condition, of.recording_id, strict=True)):
            others = np.flatnonzero((own == name) & (ids != this))
            if name and others.size:
                weight = 1 / (1 + _distance(self.condition[others], at) / _NEAR)
                added = np.stack([self._added_at(name, at) for at in self.condition[others]])
                usual = np.average(self.levels[others] - added, axis=0, weights=weight)
                changes[row] = layout.without_gain(of.levels[row] - self._added_at(name, at) - usual)
        return changes

    def _added_at(self, name: str, at: Float[np.ndarray, " quantity"]) -> Float64[np.ndarray, "channel level"]:
        """What an operating point adds by other machines than the one named, so that a recording never has a part in
        what it is compared with: of a point that they lack, the mean of those around, the nearest most."""
        if name not in self._points:
            self._points[name] = _of_points(self.only(np.array(self.specimen, dtype=np.str_) != name))
        points, added = self._points[name]
        if not len(points):
            return np.zeros(self.levels.shape[1:])
        distance = _distance(points, at)
        near = distance < _SAME
        return np.asarray(np.average(added, axis=0, weights=near if near.any() else distance**-2.0))

    @cached_property
    def _points(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Operating points of all machines but one, and what they add, by that one's name."""
        return {}


def _of_points(
    table: RecordingTable,
) -> tuple[Float64[np.ndarray, "point quantity"], Float64[np.ndarray, "point channel level"]]:
    """(operating points, what each adds to the levels of any machine): least squares of machine plus point."""
    if not table.specimen:
        return np.zeros((0, 2)), np.zeros((0, *table.levels.shape[1:]))
    points, point = operating_points(table.condition)
    machine = np.unique(table.specimen, return_inverse=True)[1]
    added = np.zeros((len(points), *table.levels.shape[1:]))
    for _ in range(_ROUNDS):
        own = group_means(table.levels - added[point], machine)
        added = group_means(table.levels - own[machine], point)
    return points, added


def _distance(points: Float[np.ndarray, "point quantity"], at: Float[np.ndarray, " quantity"]) -> np.ndarray:
    """Sum of the magnitudes of the logarithms of ratios; what either does not state counts nothing."""
    return np.asarray(np.nansum(np.abs(np.log(points / at)), axis=1))
