"""Check whether a data set is sound, and large enough to train, test and calibrate with."""

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from swashtwin.foundation import DataError, InputError, plural, to_table
from swashtwin.learning.healthy.healthy_baseline import (
    DEFAULT_FALSE_ALARM_RATE,
    MIN_HEALTHY_RECORDINGS,
)
from swashtwin.learning.training.confidence import (
    DEFAULT_ERROR_RATE,
    allowed_error_rate,
    min_validation_recordings,
)
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Finding,
    InspectionReport,
    Recording,
    describe_conditions,
    describe_duplicates,
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
"""Whether the recordings suffice for a use, and the reason."""

# Share of the recordings that a test takes by default.
_TEST_FRACTION = 0.2

# Recordings left after a test below which no confidence is calibrated.
_MIN_REMAINING_RECORDINGS = 4

_DETECTION = "detection from healthy recordings alone"

# Revolutions that a calibration needs to resolve orders.
_CALIBRATION_TURNS = 16


@dataclass(frozen=True)
class ClassCount:
    """Recordings of one class at one operating condition."""

    label: str
    """Class; empty if the recordings have none."""
    condition: str
    """Description of the operating point, or ``"-"`` if none is specified."""
    recordings: int
    specimens: tuple[str, ...]
    """Specimens they are of; empty if none is specified."""
    seconds: float
    """Their total length [s]."""


@dataclass(frozen=True)
class Use:
    """A use of the recordings, and whether they suffice for it."""

    name: str
    state: State
    """Whether they suffice."""
    is_required: bool
    """Whether the data are too few without it."""
    reason: str
    """What they suffice with, or what is missing."""


@dataclass(frozen=True, eq=False)
class DataCheck:
    """Result of a check whether recordings are sound and enough."""

    inspection: InspectionReport
    """Findings of each recording, and of all together."""
    counts: tuple[ClassCount, ...]
    """Recordings of each class and condition, without copies."""
    gaps: tuple[tuple[str, str], ...]
    """Class and condition without a recording, although other classes have the condition."""
    uses: tuple[Use, ...]
    """What can be trained, tested and calibrated."""
    notes: tuple[str, ...]
    """Recordings that were not counted, and what a test on the others cannot show."""

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
        if not self.is_enough:
            missing_uses = [use.name for use in required if use.state == "no"]
            enough = f"not enough: no {' and no '.join(missing_uses)}"
        elif any(use.state != "no" and use.name != _DETECTION for use in required):
            enough = "enough to train and to test"
        else:
            enough = "enough for an anomaly detector"

        if self.is_sound:
            conjunction = " and" if self.is_enough else ", but"
            return f"The data are sound{conjunction} {enough}."

        findings = list(self.inspection.findings)
        for report in self.inspection.recordings:
            findings += report.findings
        n_errors = sum(finding.severity == "error" for finding in findings)
        return (
            f"The data are not sound ({plural(n_errors, 'finding')} to mend); the usable "
            f"recordings are {enough}."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the check as JSON can hold it."""
        table: dict[str, Any] = {
            "answer": self.answer,
            "is_sound": self.is_sound,
            "is_enough": self.is_enough,
            "gaps": [{"label": label, "condition": condition} for label, condition in self.gaps],
            "inspection": self.inspection.to_dict(),
        }
        table.update(to_table({"counts": self.counts, "uses": self.uses, "notes": self.notes}))
        return table


def check_recordings(
    recordings: Sequence[Recording],
    *,
    window: int = 2048,
    unreadable: Sequence[Finding] = (),
    progress: Callable[[int, int], None] | None = None,
) -> DataCheck:
    """Check whether recordings are sound and enough.

    Parameters
    ----------
    window : samples of the windows that are to be cut.
    unreadable : findings of `load_recordings` about files that are not among the recordings.
    progress : called with the number of finished recordings, and the total.
    """
    inspection = inspect_recordings(
        recordings, window=window, unreadable=unreadable, progress=progress
    )
    unusable = set()
    for report in inspection.recordings:
        if any(finding.severity == "error" for finding in report.findings):
            unusable.add(report.recording_id)
    usable = [recording for recording in recordings if recording.recording_id not in unusable]
    content = inspection.manifest
    copies = find_duplicates(
        {recording.recording_id: content[recording.recording_id] for recording in usable}
    )
    usable = [recording for recording in usable if recording.recording_id not in copies]
    labeled = [recording for recording in usable if recording.label and not recording.synthetic]

    counts = _counts(usable)
    return DataCheck(
        inspection=inspection,
        counts=counts,
        gaps=_gaps(counts),
        uses=_uses(labeled),
        notes=tuple(_notes(recordings, labeled, copies)),
    )


def _gaps(counts: Sequence[ClassCount]) -> tuple[tuple[str, str], ...]:
    """Return each class and condition without a recording."""
    cells = {(count.label, count.condition) for count in counts}
    labels = dict.fromkeys(count.label for count in counts if count.label)
    conditions = dict.fromkeys(count.condition for count in counts)
    return tuple(cell for cell in itertools.product(labels, conditions) if cell not in cells)


def _notes(
    recordings: Sequence[Recording], labeled: Sequence[Recording], copies: Mapping[str, str]
) -> list[str]:
    """Return what was not counted, and what a test on the recordings cannot show."""
    notes = _one_machine_notes(labeled)

    labels = {recording.label for recording in recordings if recording.label}
    usable_labels = {recording.label for recording in labeled}
    for label in sorted(map(str, labels - usable_labels)):
        notes.append(f"No recording of {label} is usable.")

    origins = Counter(recording.attributes.get("origin", "") for recording in recordings)
    for origin, count in origins.items():
        if "virtual rig" in origin:
            notes.append(
                f"{plural(count, 'recording')} of the {origin}: a stand-in for a machine, not a "
                "measurement of a real pump."
            )

    notes += describe_duplicates(copies, "not counted.")
    return notes


def _one_machine_notes(labeled: Sequence[Recording]) -> list[str]:
    """Return a note on each class measured on a single specimen that has no other class."""
    pairs = {(str(recording.label), recording.specimen or "") for recording in labeled}
    specimens_by_class = Counter(label for label, _ in pairs)
    classes_by_specimen = Counter(specimen for _, specimen in pairs)
    if len(specimens_by_class) < 2:
        return []

    confounded = sorted(
        label
        for label, specimen in pairs
        if specimen and specimens_by_class[label] == classes_by_specimen[specimen] == 1
    )
    return [
        f"{label}: measured on one specimen only, which has no other class. Any peculiarity of "
        "that machine identifies the class, and no test on these recordings can show that it is "
        "the fault. Measure the class on another machine, or this machine in another class."
        for label in confounded
    ]


def _counts(recordings: Sequence[Recording]) -> tuple[ClassCount, ...]:
    conditions = describe_conditions(
        [recording.recording_id for recording in recordings],
        [specified_speed(recording) for recording in recordings],
        [specified_pressure(recording) for recording in recordings],
    )
    cells: dict[tuple[str, str], list[Recording]] = {}
    for recording, condition in zip(recordings, conditions, strict=True):
        cells.setdefault((recording.label or "", condition), []).append(recording)

    counts = []
    for (label, condition), members in cells.items():
        specimens = {member.specimen for member in members if member.specimen}
        counts.append(
            ClassCount(
                label=label,
                condition=condition,
                recordings=len(members),
                specimens=tuple(sorted(specimens)),
                seconds=sum(member.duration for member in members),
            )
        )
    return tuple(counts)


def _uses(labeled: Sequence[Recording]) -> tuple[Use, ...]:
    classes = Counter(str(recording.label) for recording in labeled)
    n_healthy = sum(count for name, count in classes.items() if is_healthy(name))
    # Healthy recordings alone are meant for an anomaly detector, which no test needs.
    is_healthy_only = n_healthy == len(labeled) > 0
    needs_classifier = not is_healthy_only

    def use(name: str, answer: Answer, *, is_required: bool = False) -> Use:
        state, reason = answer
        return Use(name, state, is_required, reason)

    return (
        use("training of a classifier", _training(classes), is_required=needs_classifier),
        use(_DETECTION, _detection(n_healthy), is_required=is_healthy_only),
        use(
            "test on recordings that were not trained on",
            _test(labeled, "recording"),
            is_required=needs_classifier,
        ),
        use("test on specimens that were not trained on", _test(labeled, "specimen")),
        use("test at operating conditions that were not trained at", _test(labeled, "condition")),
        use("calibrated confidence", _confidence(labeled)),
        use("calibration of a twin", _calibration(labeled)),
    )


def _training(classes: Counter[str]) -> Answer:
    n_classes = len(classes)
    if n_classes < 2:
        count = "1 class" if n_classes == 1 else f"{n_classes} classes"
        return "no", f"{count} with a label; a classifier separates two or more."

    class_counts = ", ".join(f"{count} {name}" for name, count in classes.items())
    if any(map(is_healthy, classes)):
        return "yes", f"{class_counts}."
    return "partly", f"{class_counts}; no class is healthy, so false alarms cannot be counted."


def _detection(n_healthy: int) -> Answer:
    """Answer whether an anomaly detector can be made, and at which false-alarm rate."""
    count = plural(n_healthy, "healthy recording")
    if n_healthy < MIN_HEALTHY_RECORDINGS:
        return "no", f"{count}; at least {MIN_HEALTHY_RECORDINGS} are needed."

    allowed = allowed_error_rate(n_healthy, DEFAULT_FALSE_ALARM_RATE)
    reason = f"{count} allow a false-alarm rate of {allowed:g}: train on an index of these alone."
    return "yes" if allowed == DEFAULT_FALSE_ALARM_RATE else "partly", reason


def _test(labeled: Sequence[Recording], group: str) -> Answer:
    if not labeled:
        return "no", "no recording has a class."
    try:
        group_by_recording = recording_groups(labeled, group)
    except (DataError, InputError) as cause:
        return "no", str(cause)

    labels = np.array([str(recording.label) for recording in labeled])
    groups = np.array([group_by_recording[recording.recording_id] for recording in labeled])
    scarce = [label for label in np.unique(labels) if np.unique(groups[labels == label]).size < 2]
    if scarce:
        return "no", f"{', '.join(scarce)}: only one {group}, two are needed."

    count = plural(np.unique(groups).size, group)
    if _test_rows(labels, groups) is None:
        return "no", f"{count}, and no share of them keeps every class in training and in the test."
    return "yes", f"{count}, two or more of each class; a test can hold out whole {group}s."


def _test_rows(labels: np.ndarray, groups: np.ndarray) -> np.ndarray | None:
    classes = np.unique(labels, return_inverse=True)[1]
    return select_test_rows(classes, classes, groups, _TEST_FRACTION, seed=0)


def _confidence(labeled: Sequence[Recording]) -> Answer:
    n_remaining = 0
    if labeled:
        labels = np.array([str(recording.label) for recording in labeled])
        test_rows = _test_rows(labels, np.arange(len(labeled)))
        if test_rows is not None:
            n_remaining = len(labeled) - len(test_rows)

    needed = min_validation_recordings(DEFAULT_ERROR_RATE)
    allowed = allowed_error_rate(n_remaining, DEFAULT_ERROR_RATE)
    verb = "is" if n_remaining == 1 else "are"
    remaining_text = (
        f"{plural(n_remaining, 'recording')} {verb} left after a test on a share of "
        f"{_TEST_FRACTION:g}"
    )
    if allowed == DEFAULT_ERROR_RATE:
        return (
            "yes",
            f"training calibrates it with its folds; {remaining_text}, {needed} are needed.",
        )

    shortage = (
        f"an error rate of {DEFAULT_ERROR_RATE:g} needs {needed} recordings; {remaining_text}"
    )
    if n_remaining < _MIN_REMAINING_RECORDINGS:
        return "no", f"{shortage}."
    return "partly", f"{shortage}, which allow an error rate of {allowed:g}."


def _calibration(labeled: Sequence[Recording]) -> Answer:
    healthy = [recording for recording in labeled if is_healthy(recording.label)]
    if not healthy:
        return "no", "no recording of a healthy pump (normal)."

    with_condition = [recording for recording in healthy if recording.condition is not None]
    if not with_condition:
        count = plural(len(healthy), "healthy recording")
        return "no", f"{count}, none with speed and discharge pressure; add both to the index."

    usable = []
    for recording in with_condition:
        shaft_frequency = specified_shaft_frequency(recording) or 0.0
        if recording.duration * shaft_frequency >= _CALIBRATION_TURNS:
            usable.append(recording)
    if not usable:
        return "no", f"no healthy recording covers {_CALIBRATION_TURNS} revolutions; record longer."

    reason = f"{plural(len(usable), 'healthy recording')} with speed and pressure"
    specimens = {recording.specimen for recording in usable if recording.specimen}
    if len(specimens) > 1:
        reason += f" of {len(specimens)} specimens: choose one of them"
    return "yes" if len(usable) == len(healthy) else "partly", f"{reason}."
