"""Levels of a machine's healthy recordings by operating point: what new ones are compared with, and
the odd ones.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64

from swashtwin.foundation import DataError, InputError, plural
from swashtwin.learning.healthy.band_power_layout import (
    BandPowerLayout,
    Deviation,
    band_power_layout,
)
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values, values_match
from swashtwin.recordings import (
    Manifest,
    Recording,
    build_manifest,
    find_duplicates,
    layout_findings,
    specified_pressure,
    specified_shaft_frequency,
)

Point = tuple[str | float | None, ...]

LEAST_SPREAD = 1.0
"""Standard deviation [dB] that every level has at least: mounting and temperature move it so much,
whatever was measured.
"""
RIDGE = 1.0
"""Added to each level's variance, in units of it, in all directions: there are more levels than
recordings.
"""


def point_residuals(
    band_powers: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> tuple[Float64[np.ndarray, "recording level"], Float64[np.ndarray, " recording"]]:
    """(levels less the mean of their point, factor to the spread of a difference from the other
    recordings' mean).

    Of m recordings of a point the factor is sqrt(m / (m - 1)): residual times factor has the
    variance of one recording, at every point.
    """
    count = np.bincount(point)[point]
    sums = np.zeros((int(point.max()) + 1, band_powers.shape[1]))
    np.add.at(sums, point, band_powers)
    return band_powers - sums[point] / count[:, None], np.sqrt(count / (count - 1))


def robust_spread(
    band_powers: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " level"]:
    """Standard deviation [dB] of each level within the points: 1.4826 times the median magnitude,
    and `LEAST_SPREAD`.

    Both are added as variances; every point has two recordings at least.
    """
    residual, factor = point_residuals(band_powers, point)
    magnitude = np.median(np.abs(residual * factor[:, None]), axis=0)
    return np.asarray(np.sqrt((1.4826 * magnitude) ** 2 + LEAST_SPREAD**2))


def nonconformity_scores(
    band_powers: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " recording"]:
    """Nonconformity score of each recording: its squared Mahalanobis distance from all others of
    the set.

    d_i = n u_i' (R_i' R_i + n ρ I)^-1 u_i with u_i the recording's difference from the mean of the
    others at its point, over the spread of such a difference, R_i the residuals of the n others
    about their points' means, both in units of `robust_spread`, and ρ = 1. Leaving one out is done
    in closed form: with all residuals R of N = n + 1 recordings and h the diagonal of f² R R' (R R'
    + N ρ I)^-1, d is h / (1 - h) up to a factor. No order of the recordings matters, so the scores
    of exchangeable recordings are exchangeable.
    """
    residual, factor = point_residuals(band_powers, point)
    scaled = residual / robust_spread(band_powers, point)
    gram = scaled @ scaled.T
    share = np.linalg.solve(gram + len(gram) * RIDGE * np.eye(len(gram)), gram)
    leverage = factor**2 * np.diag(share)
    return np.asarray(leverage / (1 - leverage))


def conformal_p_value(scores: Float[np.ndarray, " recording"]) -> float:
    """Share of the scores that are at least as high as the last, the last counted.

    Full conformal prediction (Vovk, Gammerman and Shafer 2005, DOI 10.1007/b106715): where the last
    recording is exchangeable with the others, it is at most e with a chance of at most e, for each
    e.
    """
    return float(np.mean(scores >= scores[-1] * (1 - 1e-9)))


MIN_HEALTHY_RECORDINGS = 5
"""Healthy recordings that levels are compared with at least: of fewer, no spread can be told."""
DEFAULT_ERROR_RATE = 0.05
"""False-alarm rate of a detector where none is asked for and the recordings allow it."""


@dataclass(frozen=True, eq=False)
class HealthyBaseline:
    """Levels of healthy recordings, with the machine and the operating point of each; it holds no
    samples.
    """

    layout: BandPowerLayout
    band_powers: Float64[np.ndarray, "recording level"]
    """Levels of each recording [dB]."""
    specimen: tuple[str, ...]
    """Machine of each; empty where none is stated."""
    speed: Float64[np.ndarray, " recording"]
    """Speed of each recording's operating point [rad/s], NaN where none is stated."""
    pressure: Float64[np.ndarray, " recording"]
    """Discharge pressure of each recording's operating point [Pa], NaN where none is stated."""
    shortest: int
    """Samples of the shortest recording."""
    manifest: Manifest

    def __post_init__(self) -> None:
        count = len(self.specimen)
        if self.layout.length > self.shortest or 2 * self.layout.n_orders > self.layout.sample_rate:
            raise InputError(
                "the segments are longer than the recordings, or shaft orders beyond the sample rate."
            )
        if len(self.manifest) != count or not self.speed.shape == self.pressure.shape == (count,):
            raise InputError(
                f"{count} healthy recordings need as many speeds, pressures and entries of the manifest."
            )
        if self.band_powers.shape != (count, len(self.layout.band_powers)):
            raise InputError(
                f"the levels have the shape {self.band_powers.shape} for {count} recordings."
            )
        if count < 2 or np.bincount(self.point_index).min() < 2:
            raise InputError(
                "an operating point has a single healthy recording; two are needed at least."
            )

    @property
    def n_recordings(self) -> int:
        """Number of recordings."""
        return len(self.band_powers)

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """Specimen, speed [rad/s] and pressure [Pa] of each machine and operating point; None where
        not stated.
        """
        return tuple(dict.fromkeys(self._keys()))

    @cached_property
    def point_index(self) -> Int64[np.ndarray, " recording"]:
        """Index of each recording's point."""
        return np.array([self.points.index(key) for key in self._keys()], dtype=np.int64)

    def _keys(self) -> list[Point]:
        return list(map(_point_key, self.specimen, self.speed.tolist(), self.pressure.tolist()))

    def deviation(self, recording: Recording) -> Deviation:
        """How far a recording is from the healthy ones.

        It joins them, and all are scored alike, so the p-value is exact where it is exchangeable
        with them (`conformal_p_value`).

        Raises
        ------
        DataError
            It is unfit, much shorter than the healthy ones, or of a machine or operating point that
            has none.
        """
        index, notes = self._point_of(recording)
        return self.deviation_of(self.layout.measure(recording, self.shortest), index, notes)

    def deviation_of(
        self, band_powers: Float64[np.ndarray, " level"], index: int, notes: tuple[str, ...] = ()
    ) -> Deviation:
        """How far `band_powers` [dB] are from those of the healthy recordings of a point, by its
        index.
        """
        scores = nonconformity_scores(
            np.vstack([self.band_powers, band_powers]), np.append(self.point_index, index)
        )
        members = self.band_powers[self.point_index == index]
        change = band_powers - members.mean(axis=0)
        scatter = robust_spread(self.band_powers, self.point_index) * math.sqrt(
            1 + 1 / len(members)
        )
        words = _words(self.points[index]) if len(self.points) > 1 else ""
        p_value = conformal_p_value(scores)
        return Deviation(float(scores[-1]), p_value, change, change / scatter, words, notes)

    def subset(self, chosen: Bool[np.ndarray, " recording"]) -> "HealthyBaseline":
        """The same of some recordings."""
        rows = np.flatnonzero(chosen).tolist()
        entries = list(self.manifest.items())
        return replace(
            self,
            band_powers=self.band_powers[rows],
            specimen=tuple(self.specimen[row] for row in rows),
            speed=self.speed[rows],
            pressure=self.pressure[rows],
            manifest=dict(entries[row] for row in rows),
        )

    def members(self, recording: Recording) -> Float64[np.ndarray, "recording level"]:
        """Levels [dB] of the healthy recordings of a recording's machine and point; a `DataError`
        without any.
        """
        return self.band_powers[self.point_index == self._point_of(recording)[0]]

    def _point_of(self, recording: Recording) -> tuple[int, tuple[str, ...]]:
        """Index of a recording's point, and notes on what it does not state."""
        point = _point_key(recording.specimen or "", *_stated_point(recording))
        left, missing = list(range(len(self.points))), []
        for part, (noun, tolerance) in enumerate(_FACTS):
            stated, known = point[part], [self.points[index][part] for index in left]
            exact = [
                index
                for index, fact in zip(left, known, strict=True)
                if _agree(fact, stated, tolerance)
            ]
            if not exact:
                exact = [
                    index
                    for index, fact in zip(left, known, strict=True)
                    if fact is None or stated is None
                ]
            if not exact:
                others = dict.fromkeys(_fact_words(part, fact) for fact in known)
                where = f"{'of' if part == 0 else 'at the'} {noun} {_fact_words(part, stated)}"
                raise DataError(
                    f"no healthy recording is {where} ({', '.join(others)} {'were' if len(others) > 1 else 'was'} "
                    "recorded), so nothing can be said about this one."
                )
            left = exact
            if stated is None and any(self.points[index][part] is not None for index in left):
                missing.append(noun)
        if len(left) > 1:
            raise DataError(
                f"healthy recordings are of {len(left)} machines and operating points ("
                f"{'; '.join(_words(self.points[index]) for index in left[:6])}), and {recording.recording_id} does "
                f"not state its {' and '.join(missing)}; state {'them' if len(missing) > 1 else 'it'} in an index, or "
                "the speed and the pressure with --speed and --pressure."
            )
        if not missing:
            return left[0], ()
        return left[0], (
            f"It does not state its {' and '.join(missing)}; {_words(self.points[left[0]])} was assumed.",
        )


_FACTS = (("specimen", 0.0), ("speed", SPEED_TOLERANCE), ("pressure", PRESSURE_TOLERANCE))
"""Facts of a point, and the relative difference up to which two are the same."""


def measure_baseline(
    recordings: Sequence[Recording], *, progress: Callable[[int, int], None] | None = None
) -> tuple[HealthyBaseline, tuple[str, ...]]:
    """(levels of healthy recordings, notes on what was left out and why).

    Recordings of one machine within 2 % of speed and 6 % of pressure are of one operating point.

    Parameters
    ----------
    progress : called with the number of recordings that are done, and of all.

    Raises
    ------
    DataError
        Recordings that do not fit together or are unfit, or fewer than `MIN_HEALTHY_RECORDINGS` are left.
    InputError
        A recording is synthetic.
    """
    for recording in recordings:
        if recording.synthetic:
            raise InputError(
                f"{recording.recording_id} is synthetic; only measured recordings say how much scatters."
            )
    for finding in layout_findings(recordings):
        raise DataError(finding.message)
    manifest = build_manifest(recordings)
    copies = find_duplicates(manifest)
    notes = [
        f"{name} holds the same samples as {first} and is left out."
        for name, first in copies.items()
    ]
    distinct = [recording for recording in recordings if recording.recording_id not in copies]
    facts = np.array([_stated_point(recording) for recording in distinct]).reshape(-1, 2)
    speed = merge_close_values(facts[:, 0], SPEED_TOLERANCE)
    pressure = merge_close_values(facts[:, 1], PRESSURE_TOLERANCE)
    specimens = [recording.specimen or "" for recording in distinct]
    keys = list(map(_point_key, specimens, speed.tolist(), pressure.tolist()))
    for key in dict.fromkeys(key for key in keys if keys.count(key) == 1):
        notes.append(
            f"{distinct[keys.index(key)].recording_id} is the only one at {_words(key)} and is left out."
        )
    used = [index for index, key in enumerate(keys) if keys.count(key) > 1]
    if len(used) < MIN_HEALTHY_RECORDINGS:
        raise DataError(
            f"{plural(len(used), 'healthy recording')} of {len(recordings)} can be compared with others of the same "
            f"machine and operating point; {MIN_HEALTHY_RECORDINGS} are needed at least, and 20 for a false-alarm rate of "
            f"0.05. {' '.join(notes)}".rstrip()
        )
    kept = [distinct[index] for index in used]
    layout, reason = band_power_layout(kept)
    rows = []
    for number, recording in enumerate(kept):
        if progress is not None:
            progress(number, len(kept))
        rows.append(layout.measure(recording))
    healthy = HealthyBaseline(
        layout=layout,
        band_powers=np.stack(rows),
        specimen=tuple(recording.specimen or "" for recording in kept),
        speed=speed[used],
        pressure=pressure[used],
        shortest=min(recording.n_samples for recording in kept),
        manifest={recording.recording_id: manifest[recording.recording_id] for recording in kept},
    )
    return healthy, (*notes, *reason)


def _stated_point(recording: Recording) -> tuple[float, float]:
    """Speed [rad/s] and discharge pressure [Pa] that a recording states, NaN where it states
    none.
    """
    return float(2 * math.pi * (specified_shaft_frequency(recording) or math.nan)), float(
        specified_pressure(recording)
    )


def _agree(first: str | float | None, second: str | float | None, tolerance: float) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return bool(values_match(first, second, tolerance))
    return first == second


def _point_key(specimen: str, speed: float, pressure: float) -> Point:
    return specimen or None, *(None if math.isnan(value) else value for value in (speed, pressure))


def _words(point: Point) -> str:
    facts = [_fact_words(part, value) for part, value in enumerate(point) if value is not None]
    return ", ".join(facts) or "no operating point stated"


def _fact_words(part: int, value: str | float | None) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    return f"{value * 30 / math.pi:.4g} rev/min" if part == 1 else f"{value / 1e6:.3g} MPa"


MAX_OUTLIER_SHARE = 0.2
"""Share of the recordings that is left out at most: more of them are no exception but another state
of the machine.
"""
_SPREADS, _LEAST_SPREAD = 6.0, 0.1
"""A recording is odd where the cube root of its score is so many standard deviations above the
median of the usual ones; the deviation is at least so much of the median. Cube roots of chi-squares
are nearly normal (Wilson and Hilferty 1931).
"""


def find_inliers(
    band_powers: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Bool[np.ndarray, " recording"]:
    """Which recordings, two or more of each point, are alike; the others are odd.

    From the half of each point that is nearest to the point's median the usual ones grow and shrink
    (as in Rousseeuw and Van Driessen 1999, DOI 10.1080/00401706.1999.10485670) until each has a
    score below the limit against the other usual ones, and no other recording has. So odd
    recordings cannot hide one another. A point of which one recording would be left is odd as a
    whole.
    """
    usual = _central_half(band_powers, point)
    for _ in range(len(band_powers)):
        scores = scores_against(band_powers, point, usual)
        root = np.cbrt(scores)
        middle = np.median(root[usual])
        deviation = max(1.4826 * np.median(np.abs(root[usual] - middle)), _LEAST_SPREAD * middle)
        near = root <= middle + _SPREADS * deviation
        near &= np.bincount(point[near], minlength=point.max() + 1)[point] > 1
        if np.array_equal(near, usual) or not near.any():
            break
        usual = near
    return usual


def scores_against(
    band_powers: Float[np.ndarray, "recording level"],
    point: Int[np.ndarray, " recording"],
    usual: Bool[np.ndarray, " recording"],
) -> Float64[np.ndarray, " recording"]:
    """Nonconformity score of each recording against the usual ones without it; infinite where its
    point has none.
    """
    scores = np.full(len(band_powers), np.inf)
    scores[usual] = nonconformity_scores(band_powers[usual], point[usual])
    count = np.bincount(point[usual], minlength=point.max() + 1)[point]
    other = ~usual & (count > 0)
    means = np.stack(
        [band_powers[usual & (point == own)].mean(axis=0) for own in point[other]]
        or [band_powers[0]]
    )
    change = (band_powers[other] - means[: other.sum()]) * np.sqrt(count / (count + 1))[other, None]
    scores[other] = _distance(band_powers[usual], point[usual], change)
    return scores


def detectable_rise(
    band_powers: Float[np.ndarray, "recording level"],
    point: Int[np.ndarray, " recording"],
    error_rate: float,
) -> float:
    """Rise of a single level [dB] that lifts a usual recording to an alarm, in the median of the
    levels.

    The score is quadratic in the change: x² w = s - m, with w the score of a rise by 1 dB, s the
    score that an alarm takes at the false-alarm rate, and m the median score of the recordings.
    """
    scores = np.sort(nonconformity_scores(band_powers, point))
    needed = scores[-max(1, int(error_rate * (len(band_powers) + 1) + 1e-9))]
    rise = _distance(band_powers, point, np.eye(band_powers.shape[1]))
    return float(np.median(np.sqrt((needed - np.median(scores)) / rise)))


def _distance(
    band_powers: Float[np.ndarray, "recording level"],
    point: Int[np.ndarray, " recording"],
    change: Float[np.ndarray, "other level"],
) -> Float64[np.ndarray, " other"]:
    """Squared Mahalanobis distance of changes [dB], each of the variance of one recording:
    `nonconformity_scores`.
    """
    spread, ridge = robust_spread(band_powers, point), (len(band_powers) + 1) * RIDGE
    residual, scaled = point_residuals(band_powers, point)[0] / spread, change / spread
    along = residual @ scaled.T
    inner = np.linalg.solve(residual @ residual.T + ridge * np.eye(len(residual)), along)
    return np.asarray(((scaled**2).sum(axis=1) - (along * inner).sum(axis=0)) / ridge)


def _central_half(
    band_powers: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Bool[np.ndarray, " recording"]:
    """The recordings of each point that are nearest to its median in all levels together: more than
    half.
    """
    change = band_powers - np.stack([np.median(band_powers[point == own], axis=0) for own in point])
    spread = np.sqrt(np.median(np.abs(change), axis=0) ** 2 + 1)
    distance = ((change / spread) ** 2).sum(axis=1)
    central = np.zeros(len(band_powers), dtype=bool)
    for own in np.unique(point):
        members = np.flatnonzero(point == own)
        central[members[np.argsort(distance[members])][: len(members) // 2 + 1]] = True
    return central
