"""Alarms of the watch on healthy pumps that drift and on pumps whose fault grows.

The suspect of an alarm comes from a pump prior, adapted to the recordings that the watch learned
from.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from swashtwin.diagnosis import PriorClassifier
from swashtwin.monitoring import OperatingPointMonitor, Suspect
from swashtwin.pump import CLASSES, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Task, Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.courses import PlantCourse, plant_course, typical_faults
from swashtwin_bench.rigs.writing import OTHER_DESIGNS, RIG_VERSION, VERSIONS

HEALTHY = "healthy"
PUMP = "25scy14-1b"
"""Design of the rig's pumps, and name of its prior."""
METRICS = {
    "watched": "healthy recordings watched",
    "false_alarms": "false alarms",
    "large": "large healthy recordings",
    "findings": "healthy recordings with a finding about sensors or a pump at rest",
    "alarm_at": "severity at the alarm, over the typical one",
    "delay": "recordings from the onset to the alarm",
    "named_right": "suspect sure and right",
    "named_wrong": "suspect sure and wrong",
    "likeliest_right": "likeliest fault right",
    "unknown": "suspect unknown",
}
"""Heading of each figure."""


@dataclass(frozen=True)
class AlarmStudySettings:
    """Courses of the study, and the rule that judges them."""

    pumps: int = 2
    """Pumps of each fleet with a healthy course. The first pump wears, even if this is 0."""
    healthy: int = 280
    """Recordings of a healthy course, three in a day."""
    worn: int = 120
    """Recordings of a course with a fault that grows; it ends with the alarm."""
    onset: int = 40
    """Recordings before the fault begins."""
    severity: float = 2.0
    """Severity at the end over the typical one of the class; it grows linearly from the onset."""
    duration: float = 2.0
    """Length of each recording [s]."""
    false_alarm_rate: float = 0.01
    """Specified probability that a pump that does not change ever raises an alarm."""
    learning: int = 20
    """Recordings that a baseline learns from."""
    rig: str = RIG_VERSION
    """Version of the virtual rig."""


def alarms(work: Work, settings: AlarmStudySettings) -> StudyTable:
    """Return false alarms on healthy courses, and severity and delay at the alarm of faults.

    Parameters
    ----------
    work : its seeds are fleets of the virtual rig.
    settings : courses and rule.
    """
    pumps = [chr(ord("A") + number) for number in range(settings.pumps)]
    courses = []
    for seed in work.seeds:
        courses += [(HEALTHY, seed, pump, settings, work.out) for pump in pumps]
    for kind in typical_faults(settings.rig):
        courses += [(kind, seed, "A", settings, work.out) for seed in work.seeds]
    runs = work.map("courses", _run, courses)

    trials = []
    for (kind, seed, pump, *_), run in zip(courses, runs, strict=True):
        values = {name: run[name] for name in METRICS}
        trials.append(Trial({"course": kind, "pump": pump}, seed, values))

    # The origin is the same for all recordings, so a short one will do.
    shortest = PlantCourse(recordings=1, duration=0.1, version=settings.rig)
    first, _ = next(plant_course(work.seeds[0], "A", shortest))

    study = StudyTable(
        study="alarms",
        title="Does the alarm keep its promise, and does it come in time?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings=asdict(settings),
        origin=describe_origin([first]),
        notes=(
            "Load and oil temperature drift over days and weeks, more than while a baseline is "
            "learned. The promise holds for a pump that does not change; under drift it is "
            "measured, not promised.",
            "How fast the rig's faults grow was chosen; a delay in recordings says nothing about "
            "hours on a machine.",
        ),
    )

    return replace(study, answer=tuple(_answer(study, settings)))


def _run(
    kind: str, seed: int, pump: str, settings: AlarmStudySettings, out: Path | None
) -> dict[str, Any]:
    factors = {"course": kind, "pump": pump}
    task = Task("alarms", seed, factors, asdict(settings), f"virtual rig {settings.rig}")
    return task.run(out, lambda: _course(kind, seed, pump, settings))


def _course(kind: str, seed: int, pump: str, settings: AlarmStudySettings) -> dict[str, float]:
    """Return the figures of one course.

    Recordings before the onset of a fault count as healthy. The course ends with the alarm.
    """
    is_healthy = kind == HEALTHY
    course = PlantCourse(
        recordings=settings.healthy if is_healthy else settings.worn,
        kind=None if is_healthy else kind,
        onset=settings.onset,
        severity=settings.severity,
        duration=settings.duration,
        version=settings.rig,
    )
    monitor = OperatingPointMonitor(
        f"{seed}-{pump}",
        false_alarm_rate=settings.false_alarm_rate,
        baseline_recordings=settings.learning,
    )

    values = dict.fromkeys(METRICS, math.nan)
    for name in ("watched", "false_alarms", "large", "findings"):
        values[name] = 0.0

    state = None
    learned: list[Recording] = []
    for number, (recording, severity) in enumerate(plant_course(seed, pump, course)):
        judgment = monitor.judge(recording, state)
        state = judgment.state
        if judgment.stage == "learning":
            learned.append(recording)

        if severity == 0:
            values["watched"] += judgment.stage == "watching"
            values["large"] += judgment.is_large
            values["findings"] += bool(judgment.findings)
            values["false_alarms"] += judgment.pump == "raised"
        elif judgment.is_alarm:
            values["alarm_at"] = severity
            values["delay"] = float(number + 1 - settings.onset)
            return values | _score_suspect(learned, recording, settings.rig, seed)

    return values


def _score_suspect(
    learned: Sequence[Recording], recording: Recording, rig: str, seed: int
) -> dict[str, float]:
    """Return the figures of the suspect of an alarm."""
    pistons = None
    if rig in OTHER_DESIGNS:
        specimen = VERSIONS[rig].draw_specimen(load_pump(PUMP), str(recording.specimen), seed)
        pistons = len(specimen.clearances)

    prior = PriorClassifier.load(PUMP).fit(learned, pistons=pistons)
    suspect = Suspect.of(prior.diagnose(recording))
    is_right = suspect.label == recording.label
    is_sure = suspect.certainty == "sure"

    return {
        "named_right": float(is_sure and is_right),
        "named_wrong": float(is_sure and not is_right),
        "likeliest_right": float(is_right),
        "unknown": float(suspect.certainty == "unknown"),
    }


def _answer(study: StudyTable, settings: AlarmStudySettings) -> Iterator[str]:
    healthy = study.select(course=HEALTHY)
    if healthy:
        watched = int(sum(trial.values["watched"] for trial in healthy))
        false_alarms = [int(trial.values["false_alarms"]) for trial in healthy]
        ever = sum(count > 0 for count in false_alarms)
        yield (
            f"Healthy: {sum(false_alarms)} false alarms in {watched} recordings watched "
            f"({_share(sum(false_alarms), watched)}); {ever} of {len(healthy)} pumps ever raised "
            f"one ({_share(ever, len(healthy))}), {settings.false_alarm_rate:g} is promised for "
            "one that does not change."
        )

        findings = int(sum(trial.values["findings"] for trial in healthy))
        share = _share(findings, watched)
        yield (
            f"Findings about sensors or a pump at rest in healthy recordings: {findings} ({share})."
        )

    trends = typical_faults(settings.rig)
    worn = [trial for trial in study.trials if trial.factors["course"] != HEALTHY]
    false_alarms_before = int(sum(trial.values["false_alarms"] for trial in worn))
    healthy_part = int(sum(trial.values["watched"] for trial in worn))
    yield (
        f"Growing faults: {false_alarms_before} false alarms in {healthy_part} recordings "
        "watched before the onset."
    )

    yield _detection("all classes", worn)
    for kind in trends:
        yield _detection(kind.replace("_", " "), study.select(course=kind))

    known_trends = [kind for kind, fault in trends.items() if fault.label in CLASSES]
    known = [trial for trial in worn if trial.factors["course"] in known_trends]
    yield _suspicion("faults that the prior holds", known)
    if len(known_trends) < len(trends):
        unknown = [trial for trial in worn if trial.factors["course"] not in known_trends]
        yield _suspicion("others", unknown)


def _detection(name: str, trials: Sequence[Trial]) -> str:
    """Return how many courses raised an alarm in time, and when."""
    severity = np.array([trial.values["alarm_at"] for trial in trials])
    in_time = int(np.sum(severity <= 1))
    delay = [trial.values["delay"] for trial in trials if not math.isnan(trial.values["delay"])]

    when = ""
    if delay:
        when = (
            f"; median severity at the alarm {np.nanmedian(severity):.2f}, "
            f"median delay {np.median(delay):.0f} recordings"
        )

    return (
        f"{name}: {in_time} of {len(trials)} courses alarmed at the typical severity or before "
        f"({_share(in_time, len(trials))}), {len(delay)} at all{when}."
    )


def _suspicion(name: str, trials: Sequence[Trial]) -> str:
    """Return how often the suspects of alarms were right."""
    at_alarm = [trial.values for trial in trials if not math.isnan(trial.values["delay"])]
    right = int(sum(values["named_right"] for values in at_alarm))
    wrong = int(sum(values["named_wrong"] for values in at_alarm))
    likeliest = int(sum(values["likeliest_right"] for values in at_alarm))
    unknown = int(sum(values["unknown"] for values in at_alarm))

    return (
        f"Suspect at the alarm, {name}: likeliest right in {likeliest} of {len(at_alarm)} "
        f"({_share(likeliest, len(at_alarm))}); named right {right}, named wrong {wrong}, unknown "
        f"{unknown}."
    )


def _share(count: int, total: int) -> str:
    """Return a share and its 95 % interval (Clopper and Pearson)."""
    if not total:
        return "none"

    interval = binomtest(count, total).proportion_ci(method="exact")
    return f"{count / total:.2g}, 95 % interval {interval.low:.2g} to {interval.high:.2g}"
