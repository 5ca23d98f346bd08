"""Levels of machines' own healthy recordings, and what of a recording differs from those of its machine."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64

from swashtwin.foundation import InputError
from swashtwin.learning.recordings.recording_levels import RecordingLevels
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values

LEAST_OWN = 2
"""Healthy recordings of a machine from which changes from them are taken."""
_NEAR = 0.1
"""Distance of two operating points, in logarithms of speed and pressure, at which one counts half for the other."""
_SAME = 0.06
"""Such a distance up to which two points are the same."""
_TOLERANCES = SPEED_TOLERANCE, PRESSURE_TOLERANCE
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class OwnHealthy:
    """Levels of healthy recordings by machine and operating point; it holds no samples."""

    levels: Float32[np.ndarray, "reference channel level"]
    """Of each healthy recording."""
    specimen: tuple[str, ...]
    """Machine of each."""
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each, NaN where not stated."""
    recording_id: tuple[str, ...]
    """The recordings."""

    def __post_init__(self) -> None:
        count = len(self.levels)
        if not count == len(self.specimen) == len(self.condition) == len(self.recording_id):
            raise InputError("healthy levels need a machine, an operating point and an id each.")

    def machines(self) -> tuple[str, ...]:
        """Machines with `LEAST_OWN` healthy recordings or more, in order."""
        names, count = np.unique(self.specimen, return_counts=True)
        return tuple(name for name, n in zip(names.tolist(), count.tolist(), strict=True) if name and n >= LEAST_OWN)

    def joined(self, other: "OwnHealthy") -> "OwnHealthy":
        """These and further recordings; of one id the new one."""
        old = ~np.isin(self.recording_id, other.recording_id)
        return OwnHealthy(
            np.concatenate([self.levels[old], other.levels]),
            (*np.array(self.specimen, dtype=np.str_)[old].tolist(), *other.specimen),
            np.concatenate([self.condition[old], other.condition]),
            (*np.array(self.recording_id, dtype=np.str_)[old].tolist(), *other.recording_id),
        )

    def only(self, used: Bool[np.ndarray, " reference"]) -> "OwnHealthy":
        """Those that a mask keeps."""
        kept = [(s, r) for s, r, use in zip(self.specimen, self.recording_id, used.tolist(), strict=True) if use]
        return replace(
            self,
            levels=self.levels[used], condition=self.condition[used],
            specimen=tuple(s for s, _ in kept), recording_id=tuple(r for _, r in kept),
        )  # fmt: skip

    def changes(
        self,
        layout: RecordingLevels,
        levels: Float[np.ndarray, "recording channel level"],
        specimen: tuple[str, ...],
        condition: Float[np.ndarray, "recording quantity"],
        recording_id: tuple[str, ...],
    ) -> Float[np.ndarray, "recording channel level"]:
        """Changes of levels from the other healthy recordings of the machine; NaN where it has none.

        What an operating point adds is the same for all machines (`_of_points`) and is taken off, as other machines
        have it: so each healthy recording of a machine counts, those near the recording's point most. A channel that
        moved as a whole is taken for a gain (`RecordingLevels.without_gain`).
        """
        own, ids = np.array(self.specimen, dtype=np.str_), np.array(self.recording_id, dtype=np.str_)
        changes = np.full(levels.shape, np.nan, dtype=np.float32)
        for row, (name, at, this) in enumerate(zip(specimen, condition, recording_id, strict=True)):
            others = np.flatnonzero((own == name) & (ids != this))
            if name and others.size:
                weight = 1 / (1 + _distance(self.condition[others], at) / _NEAR)
                usual = np.average(self.levels[others] - self._added(name, others), axis=0, weights=weight)
                changes[row] = layout.without_gain(levels[row] - self._added_at(name, at) - usual)
        return changes

    def _added(self, name: str, rows: Int64[np.ndarray, " row"]) -> Float64[np.ndarray, "row channel level"]:
        return np.stack([self._added_at(name, at) for at in self.condition[rows]])

    def _added_at(self, name: str, at: Float[np.ndarray, " quantity"]) -> Float64[np.ndarray, "channel level"]:
        """What an operating point adds by other machines than the one named, so that a recording never has a part in
        what it is compared with: of a point that they lack, the mean of those around, the nearest most."""
        if name not in self._points:
            others = np.array(self.specimen, dtype=np.str_) != name
            self._points[name] = _of_points(self.levels[others], self.specimen, self.condition, others)
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
    levels: Float[np.ndarray, "row channel level"],
    specimen: tuple[str, ...],
    condition: Float64[np.ndarray, "reference quantity"],
    used: Bool[np.ndarray, " reference"],
) -> tuple[Float64[np.ndarray, "point quantity"], Float64[np.ndarray, "point channel level"]]:
    """(operating points, what each adds to the levels of any machine): least squares of machine plus point."""
    if not used.any():
        return np.zeros((0, 2)), np.zeros((0, *levels.shape[1:]))
    merged = [merge_close_values(part, limit) for part, limit in zip(condition[used].T, _TOLERANCES, strict=True)]
    points, point = np.unique(np.stack(merged, axis=1), axis=0, return_inverse=True)
    point = point.reshape(-1)
    machine = np.unique(np.array(specimen, dtype=np.str_)[used], return_inverse=True)[1]
    added = np.zeros((len(points), *levels.shape[1:]))
    for _ in range(_ROUNDS):
        own = _means(levels - added[point], machine)
        added = _means(levels - own[machine], point)
    return points, added


def _means(rows: np.ndarray, group: np.ndarray) -> np.ndarray:
    return np.stack([rows[group == number].mean(axis=0) for number in range(int(group.max()) + 1)])


def _distance(points: Float[np.ndarray, "point quantity"], at: Float[np.ndarray, " quantity"]) -> np.ndarray:
    """Sum of the magnitudes of the logarithms of ratios; what either does not state counts nothing."""
    return np.asarray(np.nansum(np.abs(np.log(points / at)), axis=1))
