"""Band powers of many recordings, and their changes from the healthy ones of the same machine.

Recordings, or stretches of them, are joined again from the windows that were cut from them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import compress

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64

from swashtwin.foundation import InputError
from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.learning.windows.window_set import WindowSet, group_means, operating_points

MIN_REFERENCES = 2
"""Healthy recordings of a machine from which changes are taken."""
HALF_WEIGHT_DISTANCE = 0.1
"""Distance of two operating points, in logarithms of speed and pressure, at which a reference
counts half.
"""
SAME_POINT_DISTANCE = 0.06
"""Such a distance up to which two operating points are the same."""
N_ROUNDS = 4
"""Rounds in which effects of machines and of operating points are fitted in turn."""

Rows = Int64[np.ndarray, " _window"]
Stretch = Float32[np.ndarray, "channel time"]


@dataclass(frozen=True, eq=False)
class RecordingTable:
    """Band powers of whole recordings, with machine and operating point of each; no samples."""

    band_powers: Float32[np.ndarray, "reference channel band"]
    specimen: tuple[str, ...]
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each; NaN if not specified."""
    recording_id: tuple[str, ...]

    def __post_init__(self) -> None:
        count = len(self.band_powers)
        if not count == len(self.specimen) == len(self.condition) == len(self.recording_id):
            raise InputError(
                "Band powers of recordings need a machine, an operating point and an id each."
            )

    @classmethod
    def measured(cls, layout: RecordingBandLayout, windows: WindowSet) -> "RecordingTable":
        """Return the table of the recordings that windows were cut from, ordered by id."""
        rows = recording_rows(windows)
        first = [int(members[0]) for members in rows]
        return cls(
            band_powers=measure_recordings(layout, windows, rows),
            specimen=tuple(windows.specimen[first].tolist()),
            condition=np.stack([windows.condition(row) for row in first]),
            recording_id=tuple(windows.recording_id[first].tolist()),
        )

    @cached_property
    def _specimens(self) -> np.ndarray:
        return np.array(self.specimen, dtype=np.str_)

    def machines(self) -> tuple[str, ...]:
        """Return the machines with `MIN_REFERENCES` recordings or more, in order."""
        names, counts = np.unique(self.specimen, return_counts=True)
        machines = []
        for name, count in zip(names.tolist(), counts.tolist(), strict=True):
            if name and count >= MIN_REFERENCES:
                machines.append(name)
        return tuple(machines)

    def joined(self, further: "RecordingTable") -> "RecordingTable":
        """Return these and further recordings; a further one replaces one of the same id."""
        original = self.only(~np.isin(self.recording_id, further.recording_id))
        return RecordingTable(
            band_powers=np.concatenate([original.band_powers, further.band_powers]),
            specimen=original.specimen + further.specimen,
            condition=np.concatenate([original.condition, further.condition]),
            recording_id=original.recording_id + further.recording_id,
        )

    def only(self, mask: Bool[np.ndarray, " reference"]) -> "RecordingTable":
        """Return the recordings that a mask selects."""
        selected = mask.tolist()
        return RecordingTable(
            band_powers=self.band_powers[mask],
            specimen=tuple(compress(self.specimen, selected)),
            condition=self.condition[mask],
            recording_id=tuple(compress(self.recording_id, selected)),
        )

    def changes(
        self, layout: RecordingBandLayout, recordings: "RecordingTable"
    ) -> Float32[np.ndarray, "recording channel band"]:
        """Return the changes of recordings from this table of healthy ones.

        Each is compared with the other recordings of its machine; without any, its changes are NaN.
        The effect of an operating point is taken to be the same for all machines. It is estimated
        on the other machines (`_point_effects`) and subtracted, so that every healthy recording of
        a machine counts, those near the recording's operating point most. The change of a channel
        as a whole is taken for a gain (`RecordingBandLayout.without_gain`).
        """
        ids = np.array(self.recording_id, dtype=np.str_)
        changes = np.full(recordings.band_powers.shape, np.nan, dtype=np.float32)
        columns = zip(
            recordings.specimen, recordings.condition, recordings.recording_id, strict=True
        )
        for row, (specimen, condition, recording_id) in enumerate(columns):
            references = np.flatnonzero((self._specimens == specimen) & (ids != recording_id))
            if not specimen or not references.size:
                continue
            conditions = self.condition[references]
            weight = 1 / (1 + _log_distance(conditions, condition) / HALF_WEIGHT_DISTANCE)
            effects = np.stack([self._effect_of(specimen, point) for point in conditions])
            reference = np.average(self.band_powers[references] - effects, axis=0, weights=weight)
            effect = self._effect_of(specimen, condition)
            changes[row] = layout.without_gain(recordings.band_powers[row] - effect - reference)
        return changes

    def _effect_of(
        self, specimen: str, condition: Float[np.ndarray, " quantity"]
    ) -> Float64[np.ndarray, "channel band"]:
        """Return the effect of an operating point by other machines than a specimen.

        So a recording never takes part in what it is compared with. For a point that the others
        lack it is the mean of those around, the nearest most.
        """
        if specimen not in self._effects_without:
            other_machines = self.only(self._specimens != specimen)
            self._effects_without[specimen] = _point_effects(other_machines)
        points, effects = self._effects_without[specimen]
        if not len(points):
            return np.zeros(self.band_powers.shape[1:])

        distance = _log_distance(points, condition)
        is_same = distance < SAME_POINT_DISTANCE
        weights = is_same if is_same.any() else distance**-2.0
        return np.asarray(np.average(effects, axis=0, weights=weights))

    @cached_property
    def _effects_without(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Cache of the `_point_effects` of all machines but one, by that one's name."""
        return {}


def _point_effects(
    table: RecordingTable,
) -> tuple[Float64[np.ndarray, "point quantity"], Float64[np.ndarray, "point channel band"]]:
    """Return operating points, and what each adds to the band powers of any machine.

    Least squares of an effect of the machine plus one of the point, fitted in turn.
    """
    if not table.specimen:
        return np.zeros((0, 2)), np.zeros((0, *table.band_powers.shape[1:]))

    points, point = operating_points(table.condition)
    machine = np.unique(table.specimen, return_inverse=True)[1]
    point_effects = np.zeros((len(points), *table.band_powers.shape[1:]))
    for _ in range(N_ROUNDS):
        machine_effects = group_means(table.band_powers - point_effects[point], machine)
        point_effects = group_means(table.band_powers - machine_effects[machine], point)
    return points, point_effects


def _log_distance(
    points: Float[np.ndarray, "point quantity"], condition: Float[np.ndarray, " quantity"]
) -> np.ndarray:
    """Return the sum of |log(ratio)| over the quantities that both specify."""
    return np.asarray(np.nansum(np.abs(np.log(points / condition)), axis=1))


def recording_rows(windows: WindowSet) -> list[Rows]:
    """Return the rows of each recording's windows in order of time, ordered by recording id."""
    order = np.lexsort((windows.start, windows.recording_id))
    names = windows.recording_id[order]
    first_rows = np.flatnonzero(names[1:] != names[:-1]) + 1
    return [rows for rows in np.split(order, first_rows) if rows.size]


def join_windows(windows: WindowSet, rows: Rows) -> Iterator[Stretch]:
    """Yield the stretches without a gap of one recording's windows, which may overlap."""
    parts = list[np.ndarray]()
    end = 0
    for row in rows.tolist():
        start = int(windows.start[row])
        overlap = end - start  # negative at a gap
        if parts and not 0 <= overlap <= windows.length:
            yield np.concatenate(parts, axis=1)
            parts = []
        parts.append(windows.signal[row][:, overlap if parts else 0 :])
        end = start + windows.length
    yield np.concatenate(parts, axis=1)


def shortest_stretch(windows: WindowSet) -> int:
    """Return the samples of the shortest recording, each counted by its longest stretch."""
    longest = []
    for rows in recording_rows(windows):
        longest.append(max(stretch.shape[1] for stretch in join_windows(windows, rows)))
    return min(longest)


def _unchanged(stretch: Stretch) -> Stretch:
    return stretch


def measure_recordings(
    layout: RecordingBandLayout,
    windows: WindowSet,
    rows: list[Rows],
    change: Callable[[Stretch], Stretch] = _unchanged,
) -> Float[np.ndarray, "recording channel band"]:
    """Return the band powers of recordings, averaged over their stretches by length.

    Parameters
    ----------
    rows : rows of each recording's windows.
    change : applied to each stretch before it is measured, for instance to add noise.
    """
    shape = (len(rows), windows.n_channels, layout.n_band_powers)
    band_powers = np.empty(shape, dtype=np.float32)
    for number, members in enumerate(rows):
        shaft = float(windows.speed[members[0]]) / (2 * np.pi)
        stretches = list(join_windows(windows, members))
        lengths = [stretch.shape[1] for stretch in stretches]
        measured = [layout.measure(change(stretch), shaft) for stretch in stretches]
        band_powers[number] = np.average(measured, axis=0, weights=lengths)
    return band_powers
