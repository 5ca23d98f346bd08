"""Levels of a machine's healthy recordings by operating point: what a new recording is compared with."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64

from swashtwin.foundation import DataError, InputError, plural
from swashtwin.learning.healthy.levels import MOST_ORDERS, LevelLayout
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values, values_match
from swashtwin.recordings import (
    Manifest,
    Recording,
    layout_findings,
    manifest_of,
    repeated_recordings,
    stated_pressure,
    stated_speed,
)

LEAST_SPREAD = 1.0
"""Standard deviation [dB] that every level has at least: mounting and temperature move it so much, whatever was
measured."""
RIDGE = 1.0
"""Added to each level's variance, in units of it, in all directions: there are more levels than recordings."""


def point_residuals(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> tuple[Float64[np.ndarray, "recording level"], Float64[np.ndarray, " recording"]]:
    """(levels less the mean of their point, factor to the spread of a difference from the other recordings' mean).

    Of m recordings of a point the factor is sqrt(m / (m - 1)): residual times factor has the variance of one recording,
    at every point.
    """
    count = np.bincount(point)[point]
    sums = np.zeros((int(point.max()) + 1, levels.shape[1]))
    np.add.at(sums, point, levels)
    return levels - sums[point] / count[:, None], np.sqrt(count / (count - 1))


def robust_spread(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " level"]:
    """Standard deviation [dB] of each level within the points: 1.4826 times the median magnitude, and `LEAST_SPREAD`.

    Both are added as variances; every point has two recordings at least.
    """
    residual, factor = point_residuals(levels, point)
    magnitude = np.median(np.abs(residual * factor[:, None]), axis=0)
    return np.asarray(np.sqrt((1.4826 * magnitude) ** 2 + LEAST_SPREAD**2))


def nonconformity_scores(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " recording"]:
    """Nonconformity score of each recording: its squared Mahalanobis distance from all others of the set.

    d_i = n u_i' (R_i' R_i + n ρ I)^-1 u_i with u_i the recording's difference from the mean of the others at its point,
    over the spread of such a difference, R_i the residuals of the n others about their points' means, both in units of
    `robust_spread`, and ρ = 1. Leaving one out is done in closed form: with all residuals R of N = n + 1 recordings and
    h the diagonal of f² R R' (R R' + N ρ I)^-1, d is h / (1 - h) up to a factor. No order of the recordings matters, so
    the scores of exchangeable recordings are exchangeable.
    """
    residual, factor = point_residuals(levels, point)
    scaled = residual / robust_spread(levels, point)
    gram = scaled @ scaled.T
    share = np.linalg.solve(gram + len(gram) * RIDGE * np.eye(len(gram)), gram)
    leverage = factor**2 * np.diag(share)
    return np.asarray(leverage / (1 - leverage))


def conformal_p_value(scores: Float[np.ndarray, " recording"]) -> float:
    """Share of the scores that are at least as high as the last, the last counted.

    Full conformal prediction (Vovk, Gammerman and Shafer 2005, DOI 10.1007/b106715): where the last recording is
    exchangeable with the others, it is at most e with a chance of at most e, for each e.
    """
    return float(np.mean(scores >= scores[-1] * (1 - 1e-9)))


LEAST_HEALTHY = 5
"""Healthy recordings that levels are compared with at least: of fewer, no spread can be told."""
USUAL_ERROR_RATE = 0.05
"""False-alarm rate of a detector where none is asked for and the recordings allow it."""
_TURNS = 8
"""Revolutions in each segment where the speed is known, so that eight spectral lines lie from order to order."""
_SEGMENT = 8192
"""Samples of each segment otherwise, at most."""
_SHORTEST = 0.5
"""Length of a recording over that of the shortest healthy one, at least: levels of a shorter one scatter more."""


@dataclass(frozen=True)
class Deviation:
    """How far a recording is from the healthy ones of its machine at its operating point."""

    score: float
    """Nonconformity score: squared Mahalanobis distance, up to a factor."""
    p_value: float
    """Conformal p-value: chance that a healthy recording is as far, 1 / (n + 1) at least."""
    change: Float64[np.ndarray, " level"]
    """Change [dB] of each level from the mean of the healthy ones."""
    spreads: Float64[np.ndarray, " level"]
    """The same over the standard deviation of such a difference between healthy recordings."""
    point: str
    """Machine and operating point whose healthy recordings it was compared with, in words; empty for the only one."""
    notes: tuple[str, ...]
    """What was assumed, since the recording does not state it."""


@dataclass(frozen=True, eq=False)
class HealthyLevels:
    """Levels of healthy recordings, with the machine and the operating point of each; it holds no samples."""

    layout: LevelLayout
    """Which levels."""
    levels: Float64[np.ndarray, "recording level"]
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
    """The recordings, by id and content."""

    def __post_init__(self) -> None:
        count = len(self.specimen)
        if self.layout.length > self.shortest or 2 * self.layout.n_orders > self.layout.sample_rate:
            raise InputError("the segments are longer than the recordings, or shaft orders beyond the sample rate.")
        if len(self.manifest) != count or not self.speed.shape == self.pressure.shape == (count,):
            raise InputError(f"{count} healthy recordings need as many speeds, pressures and entries of the manifest.")
        if self.levels.shape != (count, len(self.layout.levels)):
            raise InputError(f"the levels have the shape {self.levels.shape} for {count} recordings.")
        if count < 2 or np.bincount(self.point_index).min() < 2:
            raise InputError("an operating point has a single healthy recording; two are needed at least.")

    @property
    def n_recordings(self) -> int:
        """Number of recordings."""
        return len(self.levels)

    @cached_property
    def points(self) -> tuple[tuple[str | float, ...], ...]:
        """Specimen, speed [rad/s] and pressure [Pa] of each machine and operating point."""
        return tuple(dict.fromkeys(map(_point_key, self.specimen, self.speed.tolist(), self.pressure.tolist())))

    @cached_property
    def point_index(self) -> Int64[np.ndarray, " recording"]:
        """Index of each recording's point."""
        index = {key: number for number, key in enumerate(self.points)}
        keys = map(_point_key, self.specimen, self.speed.tolist(), self.pressure.tolist())
        return np.array([index[key] for key in keys], dtype=np.int64)

    def deviation(self, recording: Recording) -> Deviation:
        """How far a recording is from the healthy ones.

        It joins them, and all are scored alike, so the p-value is exact where it is exchangeable with them
        (`conformal_p_value`).

        Raises
        ------
        DataError
            It is unfit, much shorter than the healthy ones, or of a machine or operating point that has none.
        """
        if recording.n_samples < _SHORTEST * self.shortest:
            raise DataError(
                f"{recording.recording_id} is {recording.duration:.3g} s long, the shortest healthy recording "
                f"{self.shortest / self.layout.sample_rate:.3g} s: the levels of so short a one scatter more; record "
                "longer."
            )
        index, notes = self._point_of(recording)
        return self.deviation_of(self.layout.measure(recording), index, notes)

    def deviation_of(self, levels: Float64[np.ndarray, " level"], index: int, notes: tuple[str, ...] = ()) -> Deviation:
        """How far `levels` [dB] are from those of the healthy recordings of a point, by its index."""
        scores = nonconformity_scores(np.vstack([self.levels, levels]), np.append(self.point_index, index))
        members = self.levels[self.point_index == index]
        change = levels - members.mean(axis=0)
        scatter = robust_spread(self.levels, self.point_index) * math.sqrt(1 + 1 / len(members))
        words = self._words(index) if len(self.points) > 1 else ""
        p_value = conformal_p_value(scores)
        return Deviation(float(scores[-1]), p_value, change, change / scatter, words, notes)

    def subset(self, chosen: Bool[np.ndarray, " recording"]) -> "HealthyLevels":
        """The same of some recordings."""
        rows = np.flatnonzero(chosen).tolist()
        entries = list(self.manifest.items())
        return replace(
            self,
            levels=self.levels[rows],
            specimen=tuple(self.specimen[row] for row in rows),
            speed=self.speed[rows],
            pressure=self.pressure[rows],
            manifest=dict(entries[row] for row in rows),
        )

    def members(self, recording: Recording) -> Float64[np.ndarray, "recording level"]:
        """Levels [dB] of the healthy recordings of a recording's machine and point; a `DataError` without any."""
        return self.levels[self.point_index == self._point_of(recording)[0]]

    def _point_of(self, recording: Recording) -> tuple[int, tuple[str, ...]]:
        """Index of a recording's point, and notes on what it does not state."""
        stated = (recording.specimen or "", *_stated_point(recording))
        left, missing = list(range(len(self.points))), []
        for part, (noun, tolerance) in enumerate(_FACTS):
            matching = [index for index in left if _may_match(self.points[index][part], stated[part], tolerance)]
            if not matching:
                others = dict.fromkeys(_fact_words(part, self.points[index][part]) for index in left)
                where = f"{'of' if part == 0 else 'at the'} {noun} {_fact_words(part, stated[part])}"
                raise DataError(
                    f"no healthy recording is {where} ({', '.join(others)} {'were' if len(others) > 1 else 'was'} "
                    "recorded), so nothing can be said about this one."
                )
            exact = [index for index in matching if _is_missing(self.points[index][part]) == _is_missing(stated[part])]
            left = exact or matching
            if _is_missing(stated[part]) and not all(_is_missing(self.points[index][part]) for index in left):
                missing.append(noun)
        if len(left) > 1:
            raise DataError(
                f"healthy recordings are of {len(left)} machines and operating points ("
                f"{'; '.join(self._words(index) for index in left[:6])}), and {recording.recording_id} does not state "
                f"its {' and '.join(missing)}; state {'them' if len(missing) > 1 else 'it'} in an index, or the speed "
                "and the pressure with --speed and --pressure."
            )
        if not missing:
            return left[0], ()
        return left[0], (f"It does not state its {' and '.join(missing)}; {self._words(left[0])} was assumed.",)

    def _words(self, index: int) -> str:
        facts = [_fact_words(part, value) for part, value in enumerate(self.points[index]) if not _is_missing(value)]
        return ", ".join(facts) or "no operating point stated"


_FACTS = (("specimen", 0.0), ("speed", SPEED_TOLERANCE), ("pressure", PRESSURE_TOLERANCE))
"""Facts of a point, and the relative difference up to which two are the same."""


def measure_healthy(
    recordings: Sequence[Recording], *, progress: Callable[[int, int], None] | None = None
) -> tuple[HealthyLevels, tuple[str, ...]]:
    """(levels of healthy recordings, notes on what was left out and why).

    Recordings of one machine within 2 % of speed and 6 % of pressure are of one operating point.

    Parameters
    ----------
    progress : called with the number of recordings that are done, and of all.

    Raises
    ------
    DataError
        Recordings that do not fit together or are unfit, or fewer than `LEAST_HEALTHY` are left.
    InputError
        A recording is synthetic.
    """
    for recording in recordings:
        if recording.synthetic:
            raise InputError(f"{recording.recording_id} is synthetic; only measured recordings say how much scatters.")
    for finding in layout_findings(recordings):
        raise DataError(finding.message)
    manifest = manifest_of(recordings)
    copies = repeated_recordings(manifest)
    notes = [f"{name} holds the same samples as {first} and is left out." for name, first in copies.items()]
    distinct = [recording for recording in recordings if recording.recording_id not in copies]
    facts = np.array([_stated_point(recording) for recording in distinct]).reshape(-1, 2)
    speed = merge_close_values(facts[:, 0], SPEED_TOLERANCE)
    pressure = merge_close_values(facts[:, 1], PRESSURE_TOLERANCE)
    keys = [
        _point_key(recording.specimen or "", *pair)
        for recording, *pair in zip(distinct, speed.tolist(), pressure.tolist(), strict=True)
    ]
    for key in dict.fromkeys(key for key in keys if keys.count(key) == 1):
        words = ", ".join(_fact_words(part, value) for part, value in enumerate(key) if not _is_missing(value))
        notes.append(f"{distinct[keys.index(key)].recording_id} is the only one at {words} and is left out.")
    used = [index for index, key in enumerate(keys) if keys.count(key) > 1]
    if len(used) < LEAST_HEALTHY:
        raise DataError(
            f"{plural(len(used), 'healthy recording')} of {len(recordings)} can be compared with others of the same "
            f"machine and operating point; {LEAST_HEALTHY} are needed at least, and 20 for a false-alarm rate of "
            f"0.05. {' '.join(notes)}".rstrip()
        )
    layout, reason = level_layout([distinct[index] for index in used])
    rows = []
    for number, index in enumerate(used):
        if progress is not None:
            progress(number, len(used))
        rows.append(layout.measure(distinct[index]))
    healthy = HealthyLevels(
        layout=layout,
        levels=np.stack(rows),
        specimen=tuple(distinct[index].specimen or "" for index in used),
        speed=speed[used],
        pressure=pressure[used],
        shortest=min(distinct[index].n_samples for index in used),
        manifest={distinct[index].recording_id: manifest[distinct[index].recording_id] for index in used},
    )
    return healthy, (*notes, *reason)


def level_layout(recordings: Sequence[Recording]) -> tuple[LevelLayout, tuple[str, ...]]:
    """(levels that all of one or more recordings of one layout allow, why orders are not among them)."""
    first, shortest = recordings[0], min(recording.n_samples for recording in recordings)
    shafts = [stated_speed(recording) for recording in recordings]
    stated = [shaft for shaft in shafts if shaft]
    segment, n_orders, reason = min(_SEGMENT, shortest), 0, ""
    if len(stated) < len(shafts):
        reason = f"{recordings[shafts.index(None)].recording_id} states no speed"
    elif shortest / first.sample_rate * min(stated) < _TURNS:
        reason = f"the shortest recording covers {shortest / first.sample_rate * min(stated):.3g} of {_TURNS} turns"
    else:
        segment = min(round(_TURNS * first.sample_rate / min(stated)), shortest)
        n_orders = min(MOST_ORDERS, int(0.45 * first.sample_rate / max(stated)))
    notes = (f"Levels at shaft orders are not compared: {reason}.",) if reason else ()
    return LevelLayout(float(first.sample_rate), first.channels, first.unit, segment, n_orders), notes


def _stated_point(recording: Recording) -> tuple[float, float]:
    """Speed [rad/s] and discharge pressure [Pa] that a recording states, NaN where it states none."""
    return 2 * math.pi * (stated_speed(recording) or math.nan), stated_pressure(recording)


def _point_key(specimen: str, speed: float, pressure: float) -> tuple[str | float, ...]:
    """Key of a point; all NaN are one object, so that they are equal."""
    return specimen, math.nan if math.isnan(speed) else speed, math.nan if math.isnan(pressure) else pressure


def _is_missing(value: str | float) -> bool:
    return not value if isinstance(value, str) else math.isnan(value)


def _may_match(first: str | float, second: str | float, tolerance: float) -> bool:
    """Whether two facts agree, or one is not stated."""
    if _is_missing(first) or _is_missing(second):
        return True
    if isinstance(first, str) or isinstance(second, str):
        return first == second
    return bool(values_match(first, second, tolerance))


def _fact_words(part: int, value: str | float) -> str:
    if isinstance(value, str):
        return value
    return f"{value * 30 / math.pi:.4g} rev/min" if part == 1 else f"{value / 1e6:.3g} MPa"
