"""Is a data set sound, and is there enough of it? What can be trained, tested and calibrated with it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from swashtwin.foundation import DataError, InputError, plural, to_table
from swashtwin.learning.copies import Copy, copied_recordings
from swashtwin.learning.healthy.healthy_levels import LEAST_HEALTHY, USUAL_ERROR_RATE
from swashtwin.learning.training.confidence import allowed_error_rate, least_validation
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Finding,
    InspectionReport,
    Recording,
    best_test_rows,
    condition_words,
    inspect_recordings,
    manifest_of,
    recording_groups,
    repeated_recordings,
    stated_angular_speed,
    stated_pressure,
    stated_speed,
)

_MOST_SAMPLES = 1 << 27
"""Samples of all recordings up to which copies are looked for: this needs all in memory (1 GB)."""
_TEST_FRACTION = 0.2
_DETECTION = "detection from healthy recordings alone"
_CALIBRATION_TURNS = 16
"""Revolutions whose orders a calibration can read."""

State = Literal["yes", "partly", "no"]


@dataclass(frozen=True)
class ClassCount:
    """Recordings of one class at one operating condition."""

    label: str
    """Class; empty where the recordings have none."""
    condition: str
    """Operating condition in words, or ``"-"`` where none is stated."""
    recordings: int
    """How many recordings."""
    specimens: tuple[str, ...]
    """On which specimens; empty where none is stated."""
    seconds: float
    """Their length together [s]."""


@dataclass(frozen=True)
class Use:
    """One thing that the recordings may serve."""

    name: str
    """What it is."""
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
    copies: tuple[Copy, ...]
    """Channels that are another one again at another gain; those of equal samples are findings of the inspection."""
    counts: tuple[ClassCount, ...]
    """Recordings of each class and condition, without copies."""
    gaps: tuple[tuple[str, str], ...]
    """Class and condition that others have and it has not."""
    uses: tuple[Use, ...]
    """What can be trained, tested and calibrated."""
    notes: tuple[str, ...]
    """What was not looked at, and why."""

    @property
    def is_sound(self) -> bool:
        """Whether nothing was found that must not be used."""
        return not self.inspection.has_errors and not self.copies

    @property
    def is_enough(self) -> bool:
        """Whether a classifier can be trained and tested with them."""
        return all(use.state != "no" for use in self.uses if use.is_required)

    @property
    def answer(self) -> str:
        """The answer in one sentence."""
        missing = [use.name for use in self.uses if use.is_required and use.state == "no"]
        is_tested = any(use.is_required and use.state != "no" for use in self.uses if use.name != _DETECTION)
        enough = f"enough {'to train and to test' if is_tested else 'for an anomaly detector'}"
        if missing:
            enough = f"not enough: no {' and no '.join(missing)}"
        if not self.is_sound:
            enough = f"the usable recordings are {enough}"
        findings = [*self.inspection.findings, *(f for report in self.inspection.recordings for f in report.findings)]
        errors = sum(finding.severity == "error" for finding in findings) + len(self.copies)
        if self.is_sound:
            return f"The data are sound{', but' if missing else ' and'} {enough}."
        return f"The data are not sound ({errors} finding{'s' * (errors != 1)} to mend); {enough}."

    def to_dict(self) -> dict[str, Any]:
        """The check as JSON can hold it."""
        return {
            "answer": self.answer,
            "is_sound": self.is_sound,
            "is_enough": self.is_enough,
            "gaps": [{"label": label, "condition": condition} for label, condition in self.gaps],
            "inspection": self.inspection.to_dict(),
            **to_table({name: getattr(self, name) for name in ("counts", "uses", "copies", "notes")}),
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
    inspection = inspect_recordings(recordings, window=window, unreadable=unreadable, progress=progress)
    unfit = {
        report.recording_id
        for report in inspection.recordings
        if any(finding.severity == "error" for finding in report.findings)
    }
    usable = [recording for recording in recordings if recording.recording_id not in unfit]
    copies, notes = _copies(usable)
    repeated = {*repeated_recordings(manifest_of(usable)), *(copy.again.recording_id for copy in copies)}
    usable = [recording for recording in usable if recording.recording_id not in repeated]
    names = [recording.recording_id for recording in usable]
    facts = ([stated(recording) for recording in usable] for stated in (stated_angular_speed, stated_pressure))
    conditions = dict(zip(names, condition_words(names, *facts), strict=True))
    counts = _counts(usable, conditions)
    labeled = [recording for recording in usable if recording.label and not recording.synthetic]
    lost = {recording.label for recording in recordings if recording.label} - {item.label for item in labeled}
    if repeated:
        notes = (f"{len(repeated)} of the recordings are copies of others and are not counted.", *notes)
    unusable = (f"no recording of {name} is usable." for name in sorted(map(str, lost)))
    notes = (*_one_machine_each(labeled), *unusable, *_origins(recordings), *notes)
    return DataCheck(
        inspection=inspection,
        copies=copies,
        counts=counts,
        gaps=_gaps(counts),
        uses=tuple(_uses(labeled, error_rate)),
        notes=notes,
    )


def _copies(recordings: Sequence[Recording]) -> tuple[tuple[Copy, ...], tuple[str, ...]]:
    """(copies at another gain, why they were not looked for)."""
    samples = sum(recording.n_samples * recording.n_channels for recording in recordings)
    if samples > _MOST_SAMPLES:
        return (), (f"copies were not looked for: {samples:.3g} samples are too many.",)
    return copied_recordings(recordings), ()


def _one_machine_each(labeled: Sequence[Recording]) -> list[str]:
    """Classes that stand on one specimen only, which has no other class."""
    pairs = {(str(recording.label), recording.specimen or "") for recording in labeled}
    classes, specimens = (Counter(pair[part] for pair in pairs) for part in (0, 1))
    alone = sorted(label for label, name in pairs if name and classes[label] == specimens[name] == 1)
    return [
        f"{label}: measured on one specimen only, which has no other class. Whatever is special about that machine "
        "tells the class, and no test on these recordings can show that it is the fault; measure the class on another "
        "machine, or this machine in another class."
        for label in (alone if len(classes) > 1 else ())
    ]


def _origins(recordings: Sequence[Recording]) -> list[str]:
    """Which recordings are none of a machine, by their attribute ``origin``."""
    origins = Counter(recording.attributes.get("origin", "") for recording in recordings)
    return [
        f"{plural(count, 'recording')} of the {origin}: a stand-in for a machine, no measurement of a real pump."
        for origin, count in origins.items()
        if "virtual rig" in origin
    ]


def _counts(recordings: Sequence[Recording], conditions: dict[str, str]) -> tuple[ClassCount, ...]:
    cells: dict[tuple[str, str], list[Recording]] = {}
    for recording in recordings:
        cells.setdefault((recording.label or "", conditions[recording.recording_id]), []).append(recording)
    return tuple(
        ClassCount(
            label,
            condition,
            len(members),
            tuple(sorted({recording.specimen for recording in members if recording.specimen})),
            sum(recording.duration for recording in members),
        )
        for (label, condition), members in cells.items()
    )


def _gaps(counts: Sequence[ClassCount]) -> tuple[tuple[str, str], ...]:
    labels = dict.fromkeys(count.label for count in counts if count.label)
    conditions = dict.fromkeys(count.condition for count in counts)
    cells = {(count.label, count.condition) for count in counts}
    return tuple((label, condition) for label in labels for condition in conditions if (label, condition) not in cells)


def _uses(labeled: Sequence[Recording], error_rate: float) -> list[Use]:
    classes = Counter(str(recording.label) for recording in labeled)
    is_healthy_only = bool(classes) and all(map(is_healthy, classes))
    return [
        _training(classes, not is_healthy_only),
        _detection(sum(count for name, count in classes.items() if is_healthy(name)), is_healthy_only),
        _test(labeled, "recording", "test on recordings that were not trained on", not is_healthy_only),
        _test(labeled, "specimen", "test on specimens that were not trained on", False),
        _test(labeled, "condition", "test at operating conditions that were not trained at", False),
        _confidence(labeled, error_rate),
        _calibration(labeled),
    ]


def _training(classes: Counter[str], is_required: bool) -> Use:
    if len(classes) < 2:
        reason = f"{len(classes)} class{'es' * (len(classes) != 1)} with a label; a classifier tells two or more apart."
        return Use("training of a classifier", "no", is_required, reason)
    healthy = any(is_healthy(name) for name in classes)
    listed = ", ".join(f"{count} {name}" for name, count in classes.items())
    reason = f"{listed}." if healthy else f"{listed}; none is healthy, so false alarms cannot be counted."
    return Use("training of a classifier", "yes" if healthy else "partly", is_required, reason)


def _detection(n_healthy: int, is_required: bool) -> Use:
    """Whether an anomaly detector can be made, at the false-alarm rate that is usual or at a higher one."""
    count = plural(n_healthy, "healthy recording")
    if n_healthy < LEAST_HEALTHY:
        return Use(_DETECTION, "no", is_required, f"{count}; {LEAST_HEALTHY} are needed at least.")
    allowed = allowed_error_rate(n_healthy, USUAL_ERROR_RATE)
    reason = f"{count} allow a false-alarm rate of {allowed:g}: train on an index of these alone."
    return Use(_DETECTION, "yes" if allowed == USUAL_ERROR_RATE else "partly", is_required, reason)


def _test(labeled: Sequence[Recording], group: str, name: str, is_required: bool) -> Use:
    if not labeled:
        return Use(name, "no", is_required, "no recording has a class.")
    try:
        groups = recording_groups(labeled, group)
    except (DataError, InputError) as cause:
        return Use(name, "no", is_required, str(cause))
    members: dict[str, set[str]] = {}
    for recording in labeled:
        members.setdefault(str(recording.label), set()).add(groups[recording.recording_id])
    few = sorted(label for label, names in members.items() if len(names) < 2)
    total = len(set(groups.values()))
    if few:
        return Use(name, "no", is_required, f"{', '.join(few)}: one {group} only, two are needed.")
    _, classes = np.unique([str(recording.label) for recording in labeled], return_inverse=True)
    kept = np.array([groups[recording.recording_id] for recording in labeled])
    if best_test_rows(classes, classes, kept, _TEST_FRACTION, seed=0) is None:
        reason = f"{plural(total, group)}, and no share of them keeps every class in training and in the test."
        return Use(name, "no", is_required, reason)
    share = f"--group {group} " if group != "recording" else ""
    reason = f"{plural(total, group)}, two or more of each class: train {share}holds them out."
    return Use(name, "yes", is_required, reason)


def _confidence(labeled: Sequence[Recording], error_rate: float) -> Use:
    name = "calibrated confidence"
    _, classes = np.unique([str(recording.label) for recording in labeled], return_inverse=True)
    tested = best_test_rows(classes, classes, np.arange(len(labeled)), _TEST_FRACTION, seed=0) if len(labeled) else None
    left = 0 if tested is None else len(labeled) - len(tested)
    needed, allowed = least_validation(error_rate), allowed_error_rate(left, error_rate)
    remainder = "1 recording is" if left == 1 else f"{left} recordings are"
    after = f"{remainder} left after a test of --test-fraction {_TEST_FRACTION:g}"
    if allowed == error_rate:
        return Use(name, "yes", False, f"train calibrates it with its folds; {after}, {needed} are needed.")
    lacking = f"--error-rate {error_rate:g} needs {needed} recordings; {after}"
    if left < 4:
        return Use(name, "no", False, f"{lacking}.")
    return Use(name, "partly", False, f"{lacking}, which allow --error-rate {allowed:g}.")


def _calibration(labeled: Sequence[Recording]) -> Use:
    name = "calibration of a twin"
    healthy = [recording for recording in labeled if is_healthy(recording.label)]
    stated = [recording for recording in healthy if recording.condition is not None]
    long = [
        recording for recording in stated if recording.duration * (stated_speed(recording) or 0) >= _CALIBRATION_TURNS
    ]
    if not healthy:
        return Use(name, "no", False, "no recording of a healthy pump (normal).")
    if not stated:
        count = plural(len(healthy), "healthy recording")
        reason = f"{count}, none with speed and discharge pressure; add both to the index."
        return Use(name, "no", False, reason)
    if not long:
        return Use(name, "no", False, f"no healthy recording covers {_CALIBRATION_TURNS} revolutions; record longer.")
    specimens = {recording.specimen for recording in long if recording.specimen}
    choice = f" of {len(specimens)} specimens: choose one with --specimen" if len(specimens) > 1 else ""
    reason = f"{plural(len(long), 'healthy recording')} with speed and pressure{choice}."
    return Use(name, "yes" if len(long) == len(healthy) else "partly", False, reason)
