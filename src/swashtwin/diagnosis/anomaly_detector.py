"""`AnomalyDetector`: alarms at a stated false-alarm rate, learned from healthy recordings alone."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from swashtwin.diagnosis.alarm_scores import AlarmScores, evaluate_alarms
from swashtwin.diagnosis.changed_bands import band_power_changes
from swashtwin.diagnosis.estimator import Estimator
from swashtwin.diagnosis.healthy_spectrum import detector_spectrum
from swashtwin.diagnosis.recording_arguments import require_layout, require_recordings
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, InputError, load_artifact, plural, save_artifact
from swashtwin.learning import (
    DEFAULT_ERROR_RATE,
    MAX_OUTLIER_SHARE,
    MIN_HEALTHY_RECORDINGS,
    BandPowerLayout,
    HealthyBaseline,
    allowed_error_rate,
    detectable_rise,
    find_inliers,
    measure_baseline,
    min_validation_recordings,
)
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Manifest,
    Recording,
    find_exact_copies,
    specified_shaft_frequency,
    summarize_recordings,
)

_VERSION = 2
_MAY_BE_NAN = ("healthy.speed", "healthy.pressure")


@dataclass(frozen=True, eq=False)
class _Card:
    """What is saved of a detector."""

    healthy: HealthyBaseline
    error_rate: float
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        _require_allowed(self.healthy.n_recordings, self.error_rate)


class AnomalyDetector(Estimator):
    """Detector of deviations from healthy recordings, with a stated false-alarm rate.

    Levels in bands, at shaft orders, and of the envelope are compared with those of the same
    machine at the same operating point; how much they scatter is learned from all points together
    (docs/explanation/diagnosis.md). It takes recordings, no arrays, which do not state machine and
    operating point.

    Parameters
    ----------
    error_rate : false-alarm rate by recording; 0.05 by default, or the least that the recordings
        allow: 20 allow a rate of 0.05, n of them 1 / (n + 1).

    Attributes
    ----------
    fitted_ : `HealthyBaseline`, what a recording is compared with.
    error_rate_ : the false-alarm rate.
    notes_ : what was left out, and what so many recordings cannot give.
    """

    KIND: ClassVar[str] = "anomaly detector"
    """Kind of its file."""

    fitted_: HealthyBaseline
    error_rate_: float
    notes_: tuple[str, ...]

    def __init__(self, *, error_rate: float | None = None) -> None:
        self.error_rate = error_rate

    def fit(
        self,
        X: Sequence[Recording],
        y: Any = None,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> "AnomalyDetector":
        """The same detector, with the levels of healthy recordings.

        Parameters
        ----------
        X : healthy recordings, labeled so or not at all.
        y : not used.
        progress : called with the number of recordings that are done, and of all.

        Raises
        ------
        DataError
            A recording has a label that is not healthy, or they are unfit, do not fit together, or
            are too few.
        InputError
            A false-alarm rate that the recordings are too few for, or no recordings.
        """
        recordings = require_recordings(X)
        for recording in recordings:
            if recording.label is not None and not is_healthy(recording.label):
                raise DataError(
                    f"{recording.recording_id} is labeled {recording.label!r}; an anomaly detector learns from healthy "
                    "recordings alone: leave the others out, or train a classifier on two classes or more."
                )
        if self.error_rate is not None:
            _require_allowed(len(recordings), self.error_rate)
        measured, notes = measure_baseline(recordings, progress=progress)
        healthy, odd = leave_out_odd(measured, self.error_rate)
        notes, rate = (*notes, *odd), self.error_rate
        if rate is None:
            rate = allowed_error_rate(healthy.n_recordings, DEFAULT_ERROR_RATE)
            if rate > DEFAULT_ERROR_RATE:
                few = (
                    f"{healthy.n_recordings} healthy recordings allow no false-alarm rate below {rate:g}; "
                    f"{DEFAULT_ERROR_RATE:g} takes {min_validation_recordings(DEFAULT_ERROR_RATE)}."
                )
                notes = (*notes, few)
        left_out = [
            name
            for recording in recordings
            if (name := recording.recording_id) not in healthy.manifest
        ]
        _require_allowed(healthy.n_recordings, rate, left_out)
        return self._set(_Card(healthy, rate, notes))

    def _set(self, card: _Card) -> "AnomalyDetector":
        self.fitted_, self.error_rate_, self.notes_ = card.healthy, card.error_rate, card.notes
        return self

    @property
    def layout(self) -> BandPowerLayout:
        """What recordings must have in common with the healthy ones, and which levels are
        compared.
        """
        self._require_fitted()
        return self.fitted_.layout

    @property
    def manifest(self) -> Manifest:
        """The healthy recordings, by id and content."""
        self._require_fitted()
        return self.fitted_.manifest

    def diagnose(self, recording: Recording, *, error_rate: float | None = None) -> Diagnosis:
        """Whether a recording deviates from the healthy ones of its machine at its operating point,
        and in what.

        A recording that cannot be used, or of a machine or operating point without healthy
        recordings, has no verdict.

        Parameters
        ----------
        error_rate : false-alarm rate; the detector's own by default.

        Raises
        ------
        DataError
            The recording has another sample rate, other channels or another unit.
        InputError
            A false-alarm rate that the healthy recordings are too few for.
        """
        self._require_fitted()
        healthy, rate = self.fitted_, self.error_rate_ if error_rate is None else error_rate
        _require_allowed(healthy.n_recordings, rate)
        require_layout(self.layout, recording)
        result = Diagnosis(
            recording.recording_id,
            "detector",
            error_rate=rate,
            basis=plural(healthy.n_recordings, "healthy recording"),
            n_basis=healthy.n_recordings,
            facts=summarize_recordings([recording]),
        )
        try:
            deviation = healthy.deviation(recording)
            seen = find_exact_copies(
                self.manifest, {recording.recording_id: recording.content_hashes()}
            )
        except DataError as cause:
            return replace(result, no_verdict=str(cause))
        if not math.isfinite(deviation.score):
            reason = "its levels are no finite numbers: a sample is far too large; cut it out or repair the file."
            return replace(result, no_verdict=reason)
        own = (
            ("It is one of the healthy recordings that made the detector; this proves nothing.",)
            if seen
            else ()
        )
        shifts, changes = band_power_changes(
            deviation, self.layout.band_powers, specified_shaft_frequency(recording)
        )
        is_alarm = deviation.p_value <= rate * (1 + 1e-9)
        return replace(
            result,
            label="abnormal" if is_alarm else "normal",
            p_value=deviation.p_value,
            score=deviation.score,
            shifts=shifts,
            changes=changes,
            notes=(*own, *deviation.notes),
            deviation=deviation,
            band_powers=self.layout.band_powers,
            spectrum=detector_spectrum(self.layout, deviation, healthy.members(recording)),
        )

    def evaluate(self, X: Sequence[Recording], y: Any = None) -> AlarmScores:
        """False alarms, and alarms of each fault, on recordings that had no part in it
        (`evaluate_alarms`).
        """
        self._require_fitted()
        return evaluate_alarms(self.diagnose, self.manifest, X, y, self.error_rate_)

    def save(self, path: Path | str) -> Path:
        """`path`, after the detector was written to it whole."""
        self._require_fitted()
        card = _Card(self.fitted_, self.error_rate_, self.notes_)
        return save_artifact(path, self.KIND, _VERSION, card, may_be_nan=_MAY_BE_NAN)

    @classmethod
    def load(cls, path: Path | str) -> "AnomalyDetector":
        """The detector that `save` wrote. Errors: `load_model`."""
        advice = "swashtwin train, or its method save, writes a detector"
        card = load_artifact(path, _Card, cls.KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
        return cls(error_rate=card.error_rate)._set(card)


def _require_allowed(n_healthy: int, error_rate: float, left_out: Sequence[str] = ()) -> None:
    """Refuse a false-alarm rate that so many healthy recordings cannot state, and name what was
    `left_out`.
    """
    needed = min_validation_recordings(error_rate)
    if n_healthy < needed:
        without = f" without {', '.join(left_out)}" if left_out else ""
        raise InputError(
            f"a false-alarm rate of {error_rate:g} needs {needed} healthy recordings at least, there are {n_healthy}"
            f"{without}; record more, or allow {allowed_error_rate(n_healthy, error_rate):g}."
        )


_MOST_NAMED = 6
_ALIKE = 4.0
"""A recording is like those of another point where its score is so many times lower there."""


def leave_out_odd(
    healthy: HealthyBaseline, error_rate: float | None
) -> tuple[HealthyBaseline, tuple[str, ...]]:
    """(the usual recordings, notes on the odd ones: names, what moved, what they cost).

    All stay where more than `MAX_OUTLIER_SHARE` are odd, for then they are another state of the machine.
    """
    is_usual = find_inliers(healthy.band_powers, healthy.point_index)
    odd = np.flatnonzero(~is_usual).tolist()
    if not odd:
        return healthy, ()
    usual, count = healthy.subset(is_usual), healthy.n_recordings
    names = list(healthy.manifest)
    named = ", ".join(names[row] for row in odd[:_MOST_NAMED])
    named += f" and {len(odd) - _MOST_NAMED} more" if len(odd) > _MOST_NAMED else ""
    with_them, without = (
        detectable_rise(
            part.band_powers,
            part.point_index,
            error_rate or allowed_error_rate(part.n_recordings, DEFAULT_ERROR_RATE),
        )
        for part in (healthy, usual)
    )
    cost = f"a change would have to be {with_them / without:.1f} times as large (in dB) to be heard"
    if len(odd) > MAX_OUTLIER_SHARE * count or usual.n_recordings < MIN_HEALTHY_RECORDINGS:
        return healthy, (
            f"{len(odd)} of {count} healthy recordings are unlike the others ({named}), too many to leave out; with "
            f"them {cost}. State the operating point of each, or train on the recordings of one state of the machine.",
        )
    return usual, (
        *(_left_out(names[row], healthy, row, usual) for row in odd),
        f"With {named} {cost}. A healthy recording of that kind is an alarm: where they come as often again, the "
        f"false-alarm rate is {(len(odd) + 1) / (count + 1):.2g}.",
    )


def _left_out(name: str, healthy: HealthyBaseline, row: int, usual: HealthyBaseline) -> str:
    """That a recording is left out, and why."""
    point = healthy.points[healthy.point_index[row]]
    if point not in usual.points:
        return f"{name} is left out: the recordings of its operating point are not alike, so none shows what is usual."
    at_points = [
        usual.deviation_of(healthy.band_powers[row], index) for index in range(len(usual.points))
    ]
    own, nearest = (
        at_points[usual.points.index(point)],
        min(at_points, key=lambda deviation: deviation.score),
    )
    speed = healthy.speed[row] / (2 * math.pi)
    shifts, changes = band_power_changes(
        own, healthy.layout.band_powers, None if math.isnan(speed) else speed
    )
    words = [f"it is like those at {nearest.point}"] if _ALIKE * nearest.score < own.score else []
    words += [*shifts, *(change.sentence for change in changes)]
    return f"{name} is left out, for it is unlike the other healthy recordings: {'; '.join(words[:2])}."
