"""Whether the watch's alarm keeps its promise: on healthy pumps that drift, and on pumps whose fault grows."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from joblib import delayed
from scipy.stats import binomtest

from swashtwin.foundation import VERSION, parallel
from swashtwin.monitoring import PointMonitor
from swashtwin_bench.results.finished import finished_values
from swashtwin_bench.results.runs import Task
from swashtwin_bench.results.table import StudyTable, Trial, origin_of
from swashtwin_bench.rigs.courses import PlantCourse, plant_course
from swashtwin_bench.rigs.trending import TRENDS
from swashtwin_bench.rigs.writing import RIG_VERSION

HEALTHY = "healthy"
METRICS = {
    "watched": "healthy recordings watched",
    "false_alarms": "false alarms",
    "large": "large healthy recordings",
    "alarm_at": "severity at the alarm, over the typical one",
    "delay": "recordings from the onset to the alarm",
}
"""Heading of each figure."""


@dataclass(frozen=True)
class AlarmStudySettings:
    """How much is recorded of each pump, and the rule that judges it."""

    pumps: int = 2
    """Pumps of each fleet with a healthy course; the first of them wears as well."""
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


def run_alarms(
    *,
    seeds: Iterable[int] = (100, 101),
    settings: AlarmStudySettings | None = None,
    jobs: int = 1,
    out: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """False alarms on healthy courses, and severity and delay at the alarm where a fault grows.

    Parameters
    ----------
    seeds : fleets of the virtual rig.
    settings : how much is recorded, and the rule.
    jobs : processes that work side by side, a course each.
    out : folder of finished courses, which a later call reads; None writes nothing.
    progress : called with (courses done, in all).
    command : command line that repeats the study, kept with the result.
    """
    started, settings, seeds = time.perf_counter(), settings or AlarmStudySettings(), tuple(seeds)
    pumps = [chr(ord("A") + number) for number in range(settings.pumps)]
    courses = [(HEALTHY, seed, pump) for seed in seeds for pump in pumps]
    courses += [(kind, seed, pumps[0]) for kind in TRENDS for seed in seeds]
    running = parallel(jobs, return_as="generator")(
        delayed(_finished_course)(kind, seed, pump, settings, out) for kind, seed, pump in courses
    )
    trials = []
    for (kind, seed, pump), values in zip(courses, running, strict=True):
        trials.append(Trial({"course": kind, "pump": pump}, seed, values))
        if progress is not None:
            progress(len(trials), len(courses))
    first = next(plant_course(seeds[0], pumps[0], PlantCourse(recordings=1, duration=0.1)))[0]
    study = StudyTable(
        study="alarms",
        title="Does the alarm keep its promise, and does it come in time?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings=asdict(settings),
        origin=origin_of([first]),
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "Load and oil temperature drift over days and weeks, more than while a baseline is learned. The promise "
            "holds for a pump that does not change; under drift it is measured, not promised.",
            "How fast the rig's faults grow was chosen; a delay in recordings says nothing about hours on a machine.",
        ),
    )
    return replace(study, answer=tuple(_answer(study, settings)))


def _finished_course(
    kind: str, seed: int, pump: str, settings: AlarmStudySettings, out: Path | None
) -> dict[str, float]:
    """Result of `_course`, from its file where it has one."""
    task = Task(
        study="alarms",
        size="",
        seed=seed,
        factors={"course": kind, "pump": pump},
        settings=asdict(settings),
        data=f"virtual rig {RIG_VERSION}",
    )
    values = finished_values(out, task, lambda: _course(kind, seed, pump, settings))
    return {name: math.nan if value is None else value for name, value in values.items()}


def _course(kind: str, seed: int, pump: str, settings: AlarmStudySettings) -> dict[str, float | None]:
    """Figures of one course. Recordings before the onset of a fault count as healthy."""
    torch.set_num_threads(1)
    is_healthy = kind == HEALTHY
    course = PlantCourse(
        recordings=settings.healthy if is_healthy else settings.worn,
        kind=None if is_healthy else kind,
        onset=settings.onset,
        severity=settings.severity,
        duration=settings.duration,
    )
    monitor = PointMonitor(f"{seed}-{pump}", false_alarm_rate=settings.false_alarm_rate, learning=settings.learning)
    state, watched, false_alarms, large = None, 0, 0, 0
    alarm_at: float | None = None
    delay: float | None = None
    for number, (recording, severity) in enumerate(plant_course(seed, pump, course)):
        point_judgment = monitor.judge(recording, state)
        state = point_judgment.state
        if severity == 0:
            watched += point_judgment.stage == "watching"
            large += point_judgment.is_large
            false_alarms += point_judgment.pump == "raised"
        elif point_judgment.is_alarm:
            alarm_at, delay = severity, float(number + 1 - settings.onset)
            break
    return {
        "watched": float(watched),
        "false_alarms": float(false_alarms),
        "large": float(large),
        "alarm_at": alarm_at,
        "delay": delay,
    }


def _answer(study: StudyTable, settings: AlarmStudySettings) -> Iterator[str]:
    healthy = study.of(course=HEALTHY)
    watched = int(sum(trial.values["watched"] for trial in healthy))
    false_alarms = [int(trial.values["false_alarms"]) for trial in healthy]
    ever = sum(count > 0 for count in false_alarms)
    yield (
        f"Healthy: {sum(false_alarms)} false alarms in {watched} recordings watched "
        f"({_share(sum(false_alarms), watched)}); {ever} of {len(healthy)} pumps ever raised one "
        f"({_share(ever, len(healthy))}), {settings.false_alarm_rate:g} is promised for a pump that does not change."
    )
    worn = [trial for trial in study.trials if trial.factors["course"] != HEALTHY]
    before = int(sum(trial.values["false_alarms"] for trial in worn))
    healthy_part = int(sum(trial.values["watched"] for trial in worn))
    yield f"Growing faults: {before} false alarms in {healthy_part} recordings watched before the onset."
    yield _detection("all classes", worn)
    for kind in TRENDS:
        yield _detection(kind.replace("_", " "), study.of(course=kind))


def _detection(name: str, trials: Sequence[Trial]) -> str:
    """How many courses were alarmed in time, and when."""
    severity = np.array([trial.values["alarm_at"] for trial in trials])
    in_time = int(np.sum(severity <= 1))
    delay = [trial.values["delay"] for trial in trials if not math.isnan(trial.values["delay"])]
    when = (
        f"; median severity at the alarm {np.nanmedian(severity):.2f}, median delay {np.median(delay):.0f} recordings"
        if delay
        else ""
    )
    return (
        f"{name}: {in_time} of {len(trials)} courses alarmed at the typical severity or before "
        f"({_share(in_time, len(trials))}), {len(delay)} at all{when}."
    )


def _share(count: int, total: int) -> str:
    """Share and its 95 % interval (Clopper and Pearson)."""
    if not total:
        return "none"
    interval = binomtest(count, total).proportion_ci(method="exact")
    return f"{count / total:.2g}, 95 % interval {interval.low:.2g} to {interval.high:.2g}"
