"""Is a data set sound, and is there enough of it? What can be trained, tested and calibrated with
it.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from swashtwin.foundation import DataError, InputError, plural, to_table
from swashtwin.learning.healthy.healthy_baseline import DEFAULT_ERROR_RATE, MIN_HEALTHY_RECORDINGS
from swashtwin.learning.training.confidence import allowed_error_rate, min_validation_recordings
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Finding,
    InspectionReport,
    Recording,
    build_manifest,
    describe_conditions,
    find_duplicates,
    inspect_recordings,
    recording_groups,
    select_test_rows,
    specified_pressure,
    specified_shaft_frequency,
    specified_speed,
)

State = Literal["yes", "partly", "no"]
Answer = tuple[State, str]

_TEST_FRACTION = 0.2
_DETECTION = "detection from healthy recordings alone"
_CALIBRATION_TURNS = 16
"""Revolutions whose orders a calibration can read."""


@dataclass(frozen=True)
class ClassCount:
    """Recordings of one class at one operating condition."""

    label: str
    """Class; empty where the recordings have none."""
    condition: str
    """Operating condition in words, or ``"-"`` where none is stated."""
    recordings: int
    specimens: tuple[str, ...]
    """On which specimens; empty where none is stated."""
    seconds: float
    """Their length together [s]."""


@dataclass(frozen=True)
class Use:
    """One thing that the recordings may serve."""

    name: str
    state: State
    """Whether they suffice."""
    is_required: bool
    """Whether the data are too few without it."""
    reason: str
    """With what, or what is missing."""


@dataclass(frozen=True, eq=False)
class DataCheck:
    """The answer to whether recordings are sound and enough."""

    inspection: InspectionReport
    """Findings of each recording, and of all together."""
    counts: tuple[ClassCount, ...]
    """Recordings of each class and condition, without copies."""
    gaps: tuple[tuple[str, str], ...]
    """Class and condition that others have and it has not."""
    uses: tuple[Use, ...]
    """What can be trained, tested and calibrated."""
    notes: tuple[str, ...]
    """What was not counted, and what a test on these recordings cannot show."""

    @property
    def is_sound(self) -> bool:
        """Whether nothing was found that must not be used."""
        return not self.inspection.has_errors

    @property
    def is_enough(self) -> bool:
        """Whether a classifier can be trained and tested with them."""
        return all(use.state != "no" for use in self.uses if use.is_required)

    @property
    def answer(self) -> str:
        """The answer in one sentence."""
        required = [use for use in self.uses if use.is_required]
        is_tested = any(use.state != "no" for use in required if use.name != _DETECTION)
        enough = f"enough {'to train and to test' if is_tested else 'for an anomaly detector'}"
        if not self.is_enough:
            enough = f"not enough: no {' and no '.join(use.name for use in required if use.state == 'no')}"
        if self.is_sound:
            return f"The data are sound{' and' if self.is_enough else ', but'} {enough}."
        findings = [
            *self.inspection.findings,
            *(f for report in self.inspection.recordings for f in report.findings),
        ]
        errors = plural(sum(finding.severity == "error" for finding in findings), "finding")
        return f"The data are not sound ({errors} to mend); the usable recordings are {enough}."

    def to_dict(self) -> dict[str, Any]:
        """The check as JSON can hold it."""
        return {
            "answer": self.answer,
            "is_sound": self.is_sound,
            "is_enough": self.is_enough,
            "gaps": [{"label": label, "condition": condition} for label, condition in self.gaps],
            "inspection": self.inspection.to_dict(),
            **to_table({name: getattr(self, name) for name in ("counts", "uses", "notes")}),
        }


def check_recordings(
    recordings: Sequence[Recording],
    *,
    window: int = 2048,
    error_rate: float = 0.1,
    unreadable: Sequence[Finding] = (),
    progress: Callable[[int, int], None] | None = None,
) -> DataCheck:
    """Whether recordings are sound and enough.

    Parameters
    ----------
    window : samples of the windows that are to be cut.
    error_rate : error rate that the confidence of a classifier is to hold.
    unreadable : what `load_recordings` reported of files that are not among the recordings.
    progress : called with the number of recordings that are done, and of all.
    """
    inspection = inspect_recordings(
        recordings, window=window, unreadable=unreadable, progress=progress
    )
    unfit = {
        report.recording_id
        for report in inspection.recordings
        if any(finding.severity == "error" for finding in report.findings)
    }
    usable = [recording for recording in recordings if recording.recording_id not in unfit]
    copies = find_duplicates(build_manifest(usable))
    usable = [recording for recording in usable if recording.recording_id not in copies]
    counts = _counts(usable)
    labels, conditions = (
        dict.fromkeys(getattr(count, part) for count in counts) for part in ("label", "condition")
    )
    labeled = [recording for recording in usable if recording.label and not recording.synthetic]
    lost = {recording.label for recording in recordings if recording.label} - {
        item.label for item in labeled
    }
    cells = {(count.label, count.condition) for count in counts}
    origins = Counter(recording.attributes.get("origin", "") for recording in recordings)
    every = ((label, condition) for label in labels if label for condition in conditions)
    return DataCheck(
        inspection=inspection,
        counts=counts,
        gaps=tuple(cell for cell in every if cell not in cells),
        uses=tuple(_uses(labeled, error_rate)),
        notes=(
            *_one_machine_each(labeled),
            *(f"no recording of {name} is usable." for name in sorted(map(str, lost))),
            *(
                f"{plural(count, 'recording')} of the {origin}: a stand-in for a machine, no measurement of a real "
                "pump."
                for origin, count in origins.items()
                if "virtual rig" in origin
            ),
            *(f"{name} is a copy of {first} and is not counted." for name, first in copies.items()),
        ),
    )


def _one_machine_each(labeled: Sequence[Recording]) -> list[str]:
    """Classes that stand on one specimen only, which has no other class."""
    pairs = {(str(recording.label), recording.specimen or "") for recording in labeled}
    classes, specimens = (Counter(pair[part] for pair in pairs) for part in (0, 1))
    alone = sorted(
        label for label, name in pairs if name and classes[label] == specimens[name] == 1
    )
    return [
        f"{label}: measured on one specimen only, which has no other class. Whatever is special about that machine "
        "tells the class, and no test on these recordings can show that it is the fault; measure the class on another "
        "machine, or this machine in another class."
        for label in (alone if len(classes) > 1 else ())
    ]


def _counts(recordings: Sequence[Recording]) -> tuple[ClassCount, ...]:
    names = [recording.recording_id for recording in recordings]
    facts = (
        [stated(recording) for recording in recordings]
        for stated in (specified_speed, specified_pressure)
    )
    cells: dict[tuple[str, str], list[Recording]] = {}
    for recording, words in zip(recordings, describe_conditions(names, *facts), strict=True):
        cells.setdefault((recording.label or "", words), []).append(recording)
    return tuple(
        ClassCount(
            *cell,
            len(members),
            tuple(sorted({recording.specimen for recording in members if recording.specimen})),
            sum(recording.duration for recording in members),
        )
        for cell, members in cells.items()
    )


def _uses(labeled: Sequence[Recording], error_rate: float) -> Iterator[Use]:
    classes = Counter(str(recording.label) for recording in labeled)
    healthy = sum(count for name, count in classes.items() if is_healthy(name))
    is_healthy_only = healthy == len(labeled) > 0
    for name, is_required, (state, reason) in (
        ("training of a classifier", not is_healthy_only, _training(classes)),
        (_DETECTION, is_healthy_only, _detection(healthy)),
        (
            "test on recordings that were not trained on",
            not is_healthy_only,
            _test(labeled, "recording"),
        ),
        ("test on specimens that were not trained on", False, _test(labeled, "specimen")),
        (
            "test at operating conditions that were not trained at",
            False,
            _test(labeled, "condition"),
        ),
        ("calibrated confidence", False, _confidence(labeled, error_rate)),
        ("calibration of a twin", False, _calibration(labeled)),
    ):
        yield Use(name, state, is_required, reason)


def _training(classes: Counter[str]) -> Answer:
    if len(classes) < 2:
        return (
            "no",
            f"{len(classes)} class{'es' * (len(classes) != 1)} with a label; a classifier tells two or more apart.",
        )
    listed = ", ".join(f"{count} {name}" for name, count in classes.items())
    if any(map(is_healthy, classes)):
        return "yes", f"{listed}."
    return "partly", f"{listed}; none is healthy, so false alarms cannot be counted."


def _detection(n_healthy: int) -> Answer:
    """Whether an anomaly detector can be made, at the false-alarm rate that is usual or at a higher
    one.
    """
    count = plural(n_healthy, "healthy recording")
    if n_healthy < MIN_HEALTHY_RECORDINGS:
        return "no", f"{count}; {MIN_HEALTHY_RECORDINGS} are needed at least."
    allowed = allowed_error_rate(n_healthy, DEFAULT_ERROR_RATE)
    reason = f"{count} allow a false-alarm rate of {allowed:g}: train on an index of these alone."
    return "yes" if allowed == DEFAULT_ERROR_RATE else "partly", reason


def _test(labeled: Sequence[Recording], group: str) -> Answer:
    if not labeled:
        return "no", "no recording has a class."
    try:
        groups = recording_groups(labeled, group)
    except (DataError, InputError) as cause:
        return "no", str(cause)
    labels = np.array([str(recording.label) for recording in labeled])
    kept = np.array([groups[recording.recording_id] for recording in labeled])
    few = [label for label in np.unique(labels) if np.unique(kept[labels == label]).size < 2]
    if few:
        return "no", f"{', '.join(few)}: one {group} only, two are needed."
    total = plural(np.unique(kept).size, group)
    if _test_rows(labels, kept) is None:
        return "no", f"{total}, and no share of them keeps every class in training and in the test."
    share = f"--group {group} " if group != "recording" else ""
    return "yes", f"{total}, two or more of each class: train {share}holds them out."


def _test_rows(labels: np.ndarray, groups: np.ndarray) -> np.ndarray | None:
    classes = np.unique(labels, return_inverse=True)[1]
    return select_test_rows(classes, classes, groups, _TEST_FRACTION, seed=0)


def _confidence(labeled: Sequence[Recording], error_rate: float) -> Answer:
    labels = np.array([str(recording.label) for recording in labeled])
    tested = _test_rows(labels, np.arange(len(labeled))) if labeled else None
    left = 0 if tested is None else len(labeled) - len(tested)
    needed, allowed = min_validation_recordings(error_rate), allowed_error_rate(left, error_rate)
    remaining = f"{plural(left, 'recording')} {'is' if left == 1 else 'are'} left"
    after = f"{remaining} after a test of --test-fraction {_TEST_FRACTION:g}"
    if allowed == error_rate:
        return "yes", f"train calibrates it with its folds; {after}, {needed} are needed."
    lacking = f"--error-rate {error_rate:g} needs {needed} recordings; {after}"
    return (
        ("no", f"{lacking}.")
        if left < 4
        else ("partly", f"{lacking}, which allow --error-rate {allowed:g}.")
    )


def _calibration(labeled: Sequence[Recording]) -> Answer:
    healthy = [recording for recording in labeled if is_healthy(recording.label)]
    stated = [recording for recording in healthy if recording.condition is not None]
    long = [
        item
        for item in stated
        if item.duration * (specified_shaft_frequency(item) or 0) >= _CALIBRATION_TURNS
    ]
    if not healthy:
        return "no", "no recording of a healthy pump (normal)."
    if not stated:
        count = plural(len(healthy), "healthy recording")
        return "no", f"{count}, none with speed and discharge pressure; add both to the index."
    if not long:
        return "no", f"no healthy recording covers {_CALIBRATION_TURNS} revolutions; record longer."
    specimens = {recording.specimen for recording in long if recording.specimen}
    choice = (
        f" of {len(specimens)} specimens: choose one with --specimen" if len(specimens) > 1 else ""
    )
    reason = f"{plural(len(long), 'healthy recording')} with speed and pressure{choice}."
    return "yes" if len(long) == len(healthy) else "partly", reason
