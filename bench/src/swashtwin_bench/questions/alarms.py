"""Whether the watch's alarm keeps its promise: on healthy pumps that drift, and on pumps whose
fault grows, whose suspect a pump prior names that is adapted to what the watch learned.
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
    """How much is recorded of each pump, and the rule that judges it."""

    pumps: int = 2
    """Pumps of each fleet with a healthy course. The first pump wears, also where this is 0."""
    healthy: int = 280
    """Recordings of a healthy course, three in a day."""
    worn: int = 120
    """Recordings of a course with a fault that grows; it ends with the alarm."""
    onset: int = 40
    """Recordings before the fault begins."""
    severity: float = 2.0
    """Severity at the end over the typical one of the class, which grows evenly from the onset."""
    duration: float = 2.0
    """Length of each recording [s]."""
    false_alarm_rate: float = 0.01
    """The promise: chance that a pump that does not change ever raises an alarm."""
    learning: int = 20
    """Recordings that a baseline learns from."""
    rig: str = RIG_VERSION
    """Version of the virtual rig."""


def alarms(work: Work, settings: AlarmStudySettings) -> StudyTable:
    """False alarms on healthy courses, and severity and delay at the alarm where a fault grows.

    Parameters
    ----------
    work : its seeds are fleets of the virtual rig.
    settings : how much is recorded, and the rule.
    """
    pumps = [chr(ord("A") + number) for number in range(settings.pumps)]
    courses = [(HEALTHY, seed, pump, settings, work.out) for seed in work.seeds for pump in pumps]
    courses += [
        (kind, seed, "A", settings, work.out)
        for kind in typical_faults(settings.rig)
        for seed in work.seeds
    ]
    trials = [
        Trial({"course": kind, "pump": pump}, seed, {name: run[name] for name in METRICS})
        for (kind, seed, pump, *_), run in zip(
            courses, work.map("courses", _run, courses), strict=True
        )
    ]
    shortest = PlantCourse(recordings=1, duration=0.1, version=settings.rig)
    first = next(plant_course(work.seeds[0], "A", shortest))[0]
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
    """Figures of one course. Recordings before the onset of a fault count as healthy."""
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
    counts = ("watched", "false_alarms", "large", "findings")
    state, values = None, {name: 0.0 if name in counts else math.nan for name in METRICS}
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
            at = {"alarm_at": severity, "delay": float(number + 1 - settings.onset)}
            return {**values, **at, **_suspected(learned, recording, settings.rig, seed)}
    return values


def _suspected(
    learned: Sequence[Recording], recording: Recording, rig: str, seed: int
) -> dict[str, float]:
    """Figures of the suspect of an alarm."""
    specimen = VERSIONS[rig].draw_specimen(load_pump(PUMP), str(recording.specimen), seed)
    pistons = len(specimen.clearances) if rig in OTHER_DESIGNS else None
    suspect = Suspect.of(
        PriorClassifier.load(PUMP).fit(learned, pistons=pistons).diagnose(recording)
    )
    is_right, is_sure = suspect.label == recording.label, suspect.certainty == "sure"
    return {
        "named_right": float(is_sure and is_right),
        "named_wrong": float(is_sure and not is_right),
        "likeliest_right": float(is_right),
        "unknown": float(suspect.certainty == "unknown"),
    }


def _answer(study: StudyTable, settings: AlarmStudySettings) -> Iterator[str]:
    healthy, trends = study.select(course=HEALTHY), typical_faults(settings.rig)
    watched = int(sum(trial.values["watched"] for trial in healthy))
    false_alarms = [int(trial.values["false_alarms"]) for trial in healthy]
    ever = sum(count > 0 for count in false_alarms)
    if healthy:
        yield (
            f"Healthy: {sum(false_alarms)} false alarms in {watched} recordings watched "
            f"({_share(sum(false_alarms), watched)}); {ever} of {len(healthy)} pumps ever raised "
            f"one ({_share(ever, len(healthy))}), {settings.false_alarm_rate:g} is promised for "
            "one that does not change."
        )
        findings = int(sum(trial.values["findings"] for trial in healthy))
        share = _share(findings, watched)
        yield f"Findings about sensors or a pump at rest in healthy recordings: {findings} ({share})."
    worn = [trial for trial in study.trials if trial.factors["course"] != HEALTHY]
    before = int(sum(trial.values["false_alarms"] for trial in worn))
    healthy_part = int(sum(trial.values["watched"] for trial in worn))
    yield f"Growing faults: {before} false alarms in {healthy_part} recordings watched before the onset."
    yield _detection("all classes", worn)
    for kind in trends:
        yield _detection(kind.replace("_", " "), study.select(course=kind))
    is_held = {kind: fault.label in CLASSES for kind, fault in trends.items()}
    yield _suspicion(
        "faults that the prior holds", [item for item in worn if is_held[item.factors["course"]]]
    )
    if not all(is_held.values()):
        yield _suspicion("others", [item for item in worn if not is_held[item.factors["course"]]])


def _detection(name: str, trials: Sequence[Trial]) -> str:
    """How many courses were alarmed in time, and when."""
    severity = np.array([trial.values["alarm_at"] for trial in trials])
    in_time = int(np.sum(severity <= 1))
    delay = [trial.values["delay"] for trial in trials if not math.isnan(trial.values["delay"])]
    when = (
        f"; median severity at the alarm {np.nanmedian(severity):.2f}, median delay "
        f"{np.median(delay):.0f} recordings"
        if delay
        else ""
    )
    return (
        f"{name}: {in_time} of {len(trials)} courses alarmed at the typical severity or before "
        f"({_share(in_time, len(trials))}), {len(delay)} at all{when}."
    )


def _suspicion(name: str, trials: Sequence[Trial]) -> str:
    """How often the suspects of alarms were right."""
    at_alarm = [trial.values for trial in trials if not math.isnan(trial.values["delay"])]
    right, wrong, likeliest, unknown = (
        int(sum(values[name] for values in at_alarm))
        for name in ("named_right", "named_wrong", "likeliest_right", "unknown")
    )
    return (
        f"Suspect at the alarm, {name}: likeliest right in {likeliest} of {len(at_alarm)} "
        f"({_share(likeliest, len(at_alarm))}); named right {right}, named wrong {wrong}, unknown "
        f"{unknown}."
    )


def _share(count: int, total: int) -> str:
    """Share and its 95 % interval (Clopper and Pearson)."""
    if not total:
        return "none"
    interval = binomtest(count, total).proportion_ci(method="exact")
    return f"{count / total:.2g}, 95 % interval {interval.low:.2g} to {interval.high:.2g}"
