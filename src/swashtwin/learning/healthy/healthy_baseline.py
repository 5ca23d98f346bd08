"""The baseline: band powers of a machine's healthy recordings, with which new ones are compared."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

from swashtwin.foundation import DataError, InputError, plural, short_repr
from swashtwin.learning.healthy.band_power_layout import (
    BandPowerLayout,
    Deviation,
    band_power_layout,
)
from swashtwin.learning.healthy.nonconformity import (
    conformal_p_value,
    nonconformity_scores,
    robust_spread,
)
from swashtwin.learning.healthy.point_matching import (
    Point,
    describe_point,
    match_point,
    point_key,
    specified_point,
)
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values
from swashtwin.recordings import (
    Manifest,
    Recording,
    build_manifest,
    describe_duplicates,
    find_duplicates,
    join_names,
    layout_findings,
)

MIN_HEALTHY_RECORDINGS = 5
"""Healthy recordings that a baseline needs: the spread of fewer is not known."""
DEFAULT_FALSE_ALARM_RATE = 0.05
"""Default false-alarm rate of a detector, if the recordings allow it."""


@dataclass(frozen=True, eq=False)
class HealthyBaseline:
    """Band powers of healthy recordings, with machine and operating point of each; no samples."""

    layout: BandPowerLayout
    band_powers: Float64[np.ndarray, "recording band"]
    """Band powers of each recording [dB]."""
    specimen: tuple[str, ...]
    """Machine of each; empty if it is not specified."""
    speed: Float64[np.ndarray, " recording"]
    """Speed of each recording's operating point [rad/s]; NaN if it is not specified."""
    pressure: Float64[np.ndarray, " recording"]
    """Discharge pressure of each recording's operating point [Pa]; NaN if it is not specified."""
    shortest: int
    """Samples of the shortest recording."""
    manifest: Manifest

    __repr__ = short_repr

    def __post_init__(self) -> None:
        count = len(self.specimen)
        if self.layout.length > self.shortest:
            raise InputError("The segments are longer than the recordings.")
        if 2 * self.layout.n_orders > self.layout.sample_rate:
            raise InputError("The shaft orders lie beyond the sample rate.")
        if len(self.manifest) != count or not self.speed.shape == self.pressure.shape == (count,):
            raise InputError(
                f"{count} healthy recordings need as many speeds, pressures and entries of the "
                "manifest."
            )
        if self.band_powers.shape != (count, len(self.layout.band_powers)):
            raise InputError(
                f"The band powers have the shape {self.band_powers.shape} for {count} recordings."
            )
        if count < 2 or np.bincount(self.point_index).min() < 2:
            raise InputError(
                "An operating point has a single healthy recording: it needs two or more."
            )

    @property
    def n_recordings(self) -> int:
        """Number of recordings."""
        return len(self.band_powers)

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """Specimen, speed [rad/s] and pressure [Pa] of each machine and operating point; None for
        what is not specified.
        """
        return tuple(dict.fromkeys(self._recording_points))

    @cached_property
    def point_index(self) -> Int64[np.ndarray, " recording"]:
        """Index of each recording's point."""
        indices = [self.points.index(point) for point in self._recording_points]
        return np.array(indices, dtype=np.int64)

    @cached_property
    def _recording_points(self) -> list[Point]:
        columns = zip(self.specimen, self.speed.tolist(), self.pressure.tolist(), strict=True)
        return [point_key(specimen, speed, pressure) for specimen, speed, pressure in columns]

    def deviation(self, recording: Recording) -> Deviation:
        """Return the distance of a recording from the healthy ones.

        It joins them, and all are scored alike, so the p-value is exact if it is exchangeable with
        them (`conformal_p_value`).

        Raises
        ------
        DataError
            It is unfit, much shorter than the healthy ones, or of a machine or operating point
            without healthy recordings.
        """
        index, notes = match_point(recording, self.points)
        return self.deviation_of(self.layout.measure(recording, self.shortest), index, notes)

    def deviation_of(
        self, band_powers: Float64[np.ndarray, " band"], index: int, notes: tuple[str, ...] = ()
    ) -> Deviation:
        """Return the distance of `band_powers` [dB] from the healthy recordings of a point."""
        scores = nonconformity_scores(
            np.vstack([self.band_powers, band_powers]), np.append(self.point_index, index)
        )
        members = self.band_powers[self.point_index == index]
        change = band_powers - members.mean(axis=0)
        spread = robust_spread(self.band_powers, self.point_index)
        # The mean of m recordings scatters too, by 1 / m of the variance of one.
        change_spread = spread * math.sqrt(1 + 1 / len(members))
        return Deviation(
            score=float(scores[-1]),
            p_value=conformal_p_value(scores),
            change=change,
            spreads=change / change_spread,
            point=describe_point(self.points[index]) if len(self.points) > 1 else "",
            notes=notes,
        )

    def subset(self, mask: Bool[np.ndarray, " recording"]) -> "HealthyBaseline":
        """Return the baseline of some of its recordings."""
        rows = np.flatnonzero(mask).tolist()
        entries = list(self.manifest.items())
        return replace(
            self,
            band_powers=self.band_powers[rows],
            specimen=tuple(self.specimen[row] for row in rows),
            speed=self.speed[rows],
            pressure=self.pressure[rows],
            manifest=dict(entries[row] for row in rows),
        )

    def members(self, recording: Recording) -> Float64[np.ndarray, "recording band"]:
        """Return the band powers [dB] of the healthy recordings of a recording's point.

        Raises
        ------
        DataError
            No healthy recording exists at that operating point.
        """
        index, _ = match_point(recording, self.points)
        return self.band_powers[self.point_index == index]


def measure_baseline(
    recordings: Sequence[Recording], *, progress: Callable[[int, int], None] | None = None
) -> tuple[HealthyBaseline, tuple[str, ...]]:
    """Return the baseline of healthy recordings, and notes on recordings that were excluded.

    Recordings of one machine within 2 % of speed and 6 % of pressure are of one operating point.

    Parameters
    ----------
    progress : called with the number of recordings that are done, and of all.

    Raises
    ------
    DataError
        Recordings that do not fit together or are unfit, or fewer than `MIN_HEALTHY_RECORDINGS`
        remain.
    InputError
        A recording is synthetic.
    """
    for recording in recordings:
        if recording.synthetic:
            raise InputError(
                f"{recording.recording_id} is synthetic: the scatter of a machine is known from "
                "measured recordings only."
            )
    for finding in layout_findings(recordings):
        raise DataError(finding.message)

    # A copy would count as agreement between recordings, and narrow the spread.
    manifest = build_manifest(recordings)
    duplicates = find_duplicates(manifest)
    notes = describe_duplicates(duplicates, "excluded from the baseline.")
    distinct = [recording for recording in recordings if recording.recording_id not in duplicates]

    speed, pressure = _merged_conditions(distinct)
    rows, single_notes = _comparable_rows(distinct, speed, pressure)
    notes += single_notes
    if len(rows) < MIN_HEALTHY_RECORDINGS:
        count = plural(len(rows), "healthy recording")
        raise DataError(
            f"{count} of {len(recordings)} can be compared with others of the same machine and "
            f"operating point; {MIN_HEALTHY_RECORDINGS} are needed, and 20 for a false-alarm rate "
            f"of 0.05. {' '.join(notes)}".rstrip()
        )

    comparable = [distinct[row] for row in rows]
    layout, layout_notes = band_power_layout(comparable)
    band_powers = []
    for number, recording in enumerate(comparable):
        if progress is not None:
            progress(number, len(comparable))
        band_powers.append(layout.measure(recording))
    names = [recording.recording_id for recording in comparable]
    baseline = HealthyBaseline(
        layout=layout,
        band_powers=np.stack(band_powers),
        specimen=tuple(recording.specimen or "" for recording in comparable),
        speed=speed[rows],
        pressure=pressure[rows],
        shortest=min(recording.n_samples for recording in comparable),
        manifest={name: manifest[name] for name in names},
    )
    return baseline, (*notes, *layout_notes)


def _merged_conditions(
    recordings: Sequence[Recording],
) -> tuple[Float64[np.ndarray, " recording"], Float64[np.ndarray, " recording"]]:
    """Return speeds [rad/s] and pressures [Pa], equal at the same operating point; else NaN."""
    conditions = np.array([specified_point(recording) for recording in recordings]).reshape(-1, 2)
    speed = merge_close_values(conditions[:, 0], SPEED_TOLERANCE)
    pressure = merge_close_values(conditions[:, 1], PRESSURE_TOLERANCE)
    return speed, pressure


def _comparable_rows(
    recordings: Sequence[Recording],
    speed: Float64[np.ndarray, " recording"],
    pressure: Float64[np.ndarray, " recording"],
) -> tuple[list[int], list[str]]:
    """Return the recordings that share their point with another one, and notes on the others."""
    points = []
    for row, recording in enumerate(recordings):
        point = point_key(recording.specimen or "", float(speed[row]), float(pressure[row]))
        points.append(point)

    counts = Counter(points)
    rows = [row for row, point in enumerate(points) if counts[point] > 1]
    singles = {
        recordings[row].recording_id: describe_point(point)
        for row, point in enumerate(points)
        if counts[point] == 1
    }
    if len(singles) > 1:
        note = (
            f"{len(singles)} recordings are the only ones at their operating points and are "
            f"excluded: {join_names(list(singles))}."
        )
        return rows, [note]
    return rows, [
        f"{name} is the only one at {point} and is excluded." for name, point in singles.items()
    ]
