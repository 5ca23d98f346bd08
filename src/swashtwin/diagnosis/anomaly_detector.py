"""`AnomalyDetector`: alarms at a specified false-alarm rate, from healthy recordings alone."""

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
from swashtwin.diagnosis.progress import Progress, ignore_progress
from swashtwin.diagnosis.recording_arguments import require_layout, require_recordings
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import (
    DataError,
    InputError,
    load_artifact,
    plural,
    save_artifact,
    spell_in_words,
)
from swashtwin.learning import (
    DEFAULT_FALSE_ALARM_RATE,
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
    describe_sensor_doubts,
    find_exact_copies,
    specified_shaft_frequency,
    summarize_recordings,
)

_VERSION = 3
_MAY_BE_NAN = ("healthy.speed", "healthy.pressure")
_MAX_NAMED_OUTLIERS = 6
_MAX_OUTLIER_CAUSES = 2

# Parameters of a classifier that a detector shares, or that change nothing without faults.
_IGNORED_PARAMETERS = ("error_rate", "seed", "fault_of")

# An outlier resembles another operating point if its score there is lower by this factor.
_OTHER_POINT_RATIO = 4.0

# Relative; keeps a p-value equal to the rate from being above it by rounding.
_RATE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class _Card:
    """What is saved of a detector."""

    healthy: HealthyBaseline
    error_rate: float
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        _require_allowed_rate(self.healthy.n_recordings, self.error_rate)


class AnomalyDetector(Estimator):
    """Detector of deviations from healthy recordings, at a specified false-alarm rate.

    Powers in bands, at shaft orders, and of the envelope are compared with those of the same
    machine at the same operating point. Their scatter is estimated from all operating points
    together (docs/explanation/diagnosis.md). It takes recordings, not arrays, which do not specify
    machine and operating point.

    Parameters
    ----------
    error_rate : false-alarm rate by recording; by default 0.05, or the lowest that the recordings
        allow: n of them allow 1 / (n + 1), so 19 allow 0.05.

    Attributes
    ----------
    fitted_ : `HealthyBaseline` that recordings are compared with.
    error_rate_ : the false-alarm rate.
    notes_ : recordings that were left out, and limits of the number of recordings, as sentences.
    n_features_in_ : number of channels.
    """

    KIND: ClassVar[str] = "anomaly detector"
    """Kind of its file."""

    fitted_: HealthyBaseline
    error_rate_: float
    notes_: tuple[str, ...]
    n_features_in_: int

    def __init__(self, *, error_rate: float | None = None) -> None:
        self.error_rate = error_rate

    @classmethod
    def in_place_of(cls, classifier: Estimator) -> "AnomalyDetector":
        """Return the detector to train if all recordings are healthy, with the same error rate.

        Raises
        ------
        InputError
            A parameter of the classifier that a detector does not have is not at its default.
        """
        for name, value in classifier.changed_params().items():
            if name not in _IGNORED_PARAMETERS:
                raise InputError(
                    f"{name} ({value!r}) belongs to a classifier, but all recordings are healthy, "
                    "so that an anomaly detector is trained on all of them.",
                    field=name,
                    remedy=f"Omit {{{name}}}, or add recordings of a fault.",
                )
        return cls(error_rate=classifier.get_params()["error_rate"])

    def fit(
        self,
        X: Sequence[Recording],
        y: Any = None,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> "AnomalyDetector":
        """Measure healthy recordings and return the detector.

        Parameters
        ----------
        X : healthy recordings, labeled as healthy or not labeled.
        y : not used.
        progress : called with the number of finished recordings, and of all.

        Raises
        ------
        DataError
            A recording has a label that is not healthy, or the recordings cannot be used, do not
            fit together, or are too few.
        InputError
            There are no recordings, or too few for the false-alarm rate.
        """
        recordings = require_recordings(X)
        for recording in recordings:
            if recording.label is not None and not is_healthy(recording.label):
                raise DataError(
                    f"{recording.recording_id} is labeled {recording.label!r}; an anomaly detector "
                    "learns from healthy recordings alone. Leave the others out, or train a "
                    "classifier on two classes or more."
                )
        if self.error_rate is not None:
            # Before the measurement, which takes long.
            _require_allowed_rate(len(recordings), self.error_rate)

        baseline, notes = measure_baseline(recordings, progress=progress)
        healthy, outlier_notes = exclude_outliers(baseline, self.error_rate)
        notes = (*notes, *outlier_notes)

        rate = self.error_rate
        if rate is None:
            rate = allowed_error_rate(healthy.n_recordings, DEFAULT_FALSE_ALARM_RATE)
            if rate > DEFAULT_FALSE_ALARM_RATE:
                note = (
                    f"{healthy.n_recordings} healthy recordings allow no false-alarm rate below "
                    f"{rate:g}; {DEFAULT_FALSE_ALARM_RATE:g} needs "
                    f"{min_validation_recordings(DEFAULT_FALSE_ALARM_RATE)}."
                )
                notes = (*notes, note)

        excluded_ids = [
            recording.recording_id
            for recording in recordings
            if recording.recording_id not in healthy.manifest
        ]
        _require_allowed_rate(healthy.n_recordings, rate, excluded_ids)
        return self._set_fitted(_Card(healthy, rate, notes))

    def _set_fitted(self, card: _Card) -> "AnomalyDetector":
        self.fitted_ = card.healthy
        self.error_rate_ = card.error_rate
        self.notes_ = card.notes
        self.n_features_in_ = len(card.healthy.layout.channels)
        return self

    @property
    def layout(self) -> BandPowerLayout:
        """Layout that recordings must have, and the band powers that are compared."""
        self._require_fitted()
        return self.fitted_.layout

    @property
    def manifest(self) -> Manifest:
        """The healthy recordings, by id and content."""
        self._require_fitted()
        return self.fitted_.manifest

    def diagnose(self, recording: Recording, *, error_rate: float | None = None) -> Diagnosis:
        """Return whether and where a recording deviates from the healthy ones of its machine.

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
            The healthy recordings are too few for the false-alarm rate.
        """
        self._require_fitted()
        healthy = self.fitted_
        rate = self.error_rate_ if error_rate is None else error_rate
        _require_allowed_rate(healthy.n_recordings, rate)
        require_layout(self.layout, recording)

        diagnosis = Diagnosis(
            recording.recording_id,
            "detector",
            error_rate=rate,
            basis=plural(healthy.n_recordings, "healthy recording"),
            n_basis=healthy.n_recordings,
            facts=summarize_recordings([recording]),
        )
        try:
            with recording.loaded():
                deviation = healthy.deviation(recording)
                content = recording.content_hashes()
                doubts = describe_sensor_doubts(recording)
        except DataError as cause:
            return replace(diagnosis, no_verdict=cause.describe(spell_in_words))
        if not math.isfinite(deviation.score):
            reason = (
                "its band powers are not finite numbers: a sample is far too large. Cut it out or "
                "repair the file."
            )
            return replace(diagnosis, no_verdict=reason)

        notes = (*deviation.notes, *doubts)
        if find_exact_copies(self.manifest, {recording.recording_id: content}):
            note = "It is one of the detector's healthy recordings, so the answer proves nothing."
            notes = (note, *notes)

        shifts, changes = band_power_changes(
            deviation, self.layout.band_powers, specified_shaft_frequency(recording)
        )
        is_alarm = deviation.p_value <= rate * (1 + _RATE_TOLERANCE)
        return replace(
            diagnosis,
            label="abnormal" if is_alarm else "normal",
            p_value=deviation.p_value,
            score=deviation.score,
            shifts=shifts,
            changes=changes,
            notes=notes,
            deviation=deviation,
            band_powers=self.layout.band_powers,
            spectrum=detector_spectrum(self.layout, deviation, healthy.members(recording)),
        )

    def evaluate(
        self, X: Sequence[Recording], y: Any = None, progress: Progress = ignore_progress
    ) -> AlarmScores:
        """Return false alarms, and alarms of each fault, on recordings not used in training.

        Parameters and errors: see `evaluate_alarms`.
        """
        self._require_fitted()
        return evaluate_alarms(self.diagnose, self.manifest, X, y, self.error_rate_, progress)

    def save(self, path: Path | str) -> Path:
        """Write the detector to `path` as a complete file and return the path."""
        self._require_fitted()
        card = _Card(self.fitted_, self.error_rate_, self.notes_)
        return save_artifact(path, self.KIND, _VERSION, card, may_be_nan=_MAY_BE_NAN)

    @classmethod
    def load(cls, path: Path | str) -> "AnomalyDetector":
        """Return the detector that `save` wrote. Errors: see `load_model`."""
        advice = "swashtwin train, or its method save, writes a detector"
        card = load_artifact(path, _Card, cls.KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
        return cls(error_rate=card.error_rate)._set_fitted(card)


def _require_allowed_rate(
    n_healthy: int, error_rate: float, excluded_ids: Sequence[str] = ()
) -> None:
    """Raise an `InputError` if the healthy recordings are too few for a false-alarm rate."""
    n_needed = min_validation_recordings(error_rate)
    if n_healthy < n_needed:
        without = f" without {', '.join(excluded_ids)}" if excluded_ids else ""
        raise InputError(
            f"A false-alarm rate of {error_rate:g} needs at least {n_needed} healthy recordings; "
            f"there are {n_healthy}{without}. Record more, or allow "
            f"{allowed_error_rate(n_healthy, error_rate):g}."
        )


def exclude_outliers(
    baseline: HealthyBaseline, error_rate: float | None
) -> tuple[HealthyBaseline, tuple[str, ...]]:
    """Exclude healthy recordings that differ from the others.

    All stay if more than `MAX_OUTLIER_SHARE` differ, since these are then another state of the
    machine.

    Parameters
    ----------
    error_rate : false-alarm rate at which the cost of outliers is computed; None for the default.

    Returns
    -------
    The baseline without outliers, and notes on them: names, what differs, and what they cost.
    """
    is_inlier = find_inliers(baseline.band_powers, baseline.point_index)
    outlier_rows = np.flatnonzero(~is_inlier).tolist()
    if not outlier_rows:
        return baseline, ()

    inliers = baseline.subset(is_inlier)
    ids = list(baseline.manifest)
    n_outliers = len(outlier_rows)
    n_recordings = baseline.n_recordings
    names = ", ".join(ids[row] for row in outlier_rows[:_MAX_NAMED_OUTLIERS])
    if n_outliers > _MAX_NAMED_OUTLIERS:
        names += f" and {n_outliers - _MAX_NAMED_OUTLIERS} more"

    rise_ratio = _detection_limit(baseline, error_rate) / _detection_limit(inliers, error_rate)
    cost = f"a change must be {rise_ratio:.1f} times as large (in dB) to be detected"
    if (
        n_outliers > MAX_OUTLIER_SHARE * n_recordings
        or inliers.n_recordings < MIN_HEALTHY_RECORDINGS
    ):
        note = (
            f"{n_outliers} of {n_recordings} healthy recordings differ from the others ({names}), "
            f"too many to leave out; with them {cost}. Specify the operating point of each, or "
            "train on the recordings of one state of the machine."
        )
        return baseline, (note,)

    notes = [_describe_outlier(ids[row], baseline, row, inliers) for row in outlier_rows]
    false_alarm_rate = (n_outliers + 1) / (n_recordings + 1)
    notes.append(
        f"With {names} {cost}. A healthy recording of that kind raises an alarm: if such "
        f"recordings are as frequent in the future, the false-alarm rate is {false_alarm_rate:.2g}."
    )
    return inliers, tuple(notes)


def _detection_limit(baseline: HealthyBaseline, error_rate: float | None) -> float:
    """Return the median rise [dB] of a single band power that raises an alarm."""
    rate = error_rate or allowed_error_rate(baseline.n_recordings, DEFAULT_FALSE_ALARM_RATE)
    return detectable_rise(baseline.band_powers, baseline.point_index, rate)


def _describe_outlier(
    name: str, baseline: HealthyBaseline, row: int, inliers: HealthyBaseline
) -> str:
    """Describe that a recording is left out, and why."""
    point = baseline.points[baseline.point_index[row]]
    if point not in inliers.points:
        return (
            f"{name} is left out: the recordings of its operating point differ from each other, so "
            "none shows what is normal."
        )

    deviations = [
        inliers.deviation_of(baseline.band_powers[row], index)
        for index in range(len(inliers.points))
    ]
    own_deviation = deviations[inliers.points.index(point)]
    nearest = min(deviations, key=lambda deviation: deviation.score)

    shaft_frequency = baseline.speed[row] / (2 * math.pi)
    shifts, changes = band_power_changes(
        own_deviation,
        baseline.layout.band_powers,
        None if math.isnan(shaft_frequency) else shaft_frequency,
    )
    causes = []
    if _OTHER_POINT_RATIO * nearest.score < own_deviation.score:
        causes.append(f"it resembles those at {nearest.point}")
    causes += [*shifts, *(change.sentence for change in changes)]
    return (
        f"{name} is left out, since it differs from the other healthy recordings: "
        f"{'; '.join(causes[:_MAX_OUTLIER_CAUSES])}."
    )
