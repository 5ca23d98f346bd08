"""How well a detector from healthy recordings alone does: false alarms, and alarms for each fault of the same pump."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby

import numpy as np
import torch
from joblib import delayed

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.bench.rigs.writing import PRESSURES, RigSize, rig_recordings
from swashtwin.diagnosis import AlarmScores, fit_healthy, score_alarms
from swashtwin.foundation import VERSION, parallel
from swashtwin.learning import wilson_interval
from swashtwin.pump import CLASSES
from swashtwin.recordings import Recording

METRICS = {
    "alarms": "recordings with an alarm",
    "auroc": "AUROC against healthy",
    "lowest_auroc": "lowest AUROC of a pump",
    "error_rate": "stated false-alarm rate",
}
"""Heading of each figure; those of a fleet are means over its pumps."""


@dataclass(frozen=True)
class HealthyStudySettings:
    """How much is recorded of each pump."""

    pumps: int = 3
    """Pumps of each fleet; each has a detector of its own."""
    healthy: tuple[int, ...] = (3, 7)
    """Healthy recordings at each of three pressures that a detector is made from, one detector for each number."""
    healthy_tests: int = 5
    """Further healthy recordings at each pressure."""
    faulty_tests: int = 2
    """Recordings of each fault at each pressure."""
    duration: float = 4.0
    """Length of each recording [s]."""


def run_healthy(
    *,
    seeds: Iterable[int] = (100, 101),
    settings: HealthyStudySettings | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Alarms by class, by how many healthy recordings of the pump a detector is made from.

    Every detector is judged on the pump whose healthy recordings made it.

    Parameters
    ----------
    seeds : fleets of the virtual rig.
    settings : how much is recorded.
    jobs : processes that work side by side, a fleet each.
    progress : called with (fleets done, in all).
    command : command line that repeats the study, kept with the result.
    """
    started, settings, seeds = time.perf_counter(), settings or HealthyStudySettings(), tuple(seeds)
    running = parallel(jobs, return_as="generator")(delayed(_fleet)(seed, settings) for seed in seeds)
    fleets: dict[int, dict[int, list[AlarmScores]]] = {}
    for number, (seed, scores) in enumerate(zip(seeds, running, strict=True), 1):
        fleets[seed] = scores
        if progress is not None:
            progress(number, len(seeds))
    trials = tuple(
        Trial({"healthy_recordings": str(len(PRESSURES) * count), "label": label}, seed, values)
        for count in settings.healthy
        for label in CLASSES
        for seed in seeds
        for values in [_class_values(fleets[seed][count], label)]
    )
    first = next(iter(rig_recordings(seeds[0], RigSize(1, 1, 0.1), labels=CLASSES[:1])))[0]
    study = StudyTable(
        study="healthy",
        title="Does a detector from healthy recordings alone notice faults, at the rate that it states?",
        metrics=METRICS,
        trials=trials,
        answer=(),
        settings=asdict(settings),
        origin=origin_of([first]),
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "Every healthy recording of the rig follows a reassembly of the pump, with oil between 30 and 60 degC and "
            "pressure and speed a little off, so that healthy recordings scatter as the rig's do, not as a plant's.",
        ),
    )
    return replace(study, answer=tuple(_answer(study, fleets)))


def _fleet(seed: int, settings: HealthyStudySettings) -> dict[int, list[AlarmScores]]:
    """Scores of each pump's detectors, by the healthy recordings of a pressure."""
    torch.set_num_threads(1)
    scores: dict[int, list[AlarmScores]] = {count: [] for count in settings.healthy}
    repeats = max(settings.healthy) + settings.healthy_tests
    healthy = _by_pump(seed, RigSize(settings.pumps, repeats, settings.duration), CLASSES[:1])
    faulty = _by_pump(seed, RigSize(settings.pumps, settings.faulty_tests, settings.duration), CLASSES[1:])
    for members, faults in zip(healthy, faulty, strict=True):
        tests = [recording for recording in members if _repeat(recording) > max(settings.healthy)] + faults
        for count in settings.healthy:
            detector = fit_healthy([recording for recording in members if _repeat(recording) <= count])
            scores[count].append(score_alarms(detector, tests))
    return scores


def _by_pump(seed: int, size: RigSize, labels: Sequence[str]) -> Iterator[list[Recording]]:
    """Recordings of one pump after the other; the rig records in this order."""
    recordings = (recording for recording, _ in rig_recordings(seed, size, labels=labels))
    for _, group in groupby(recordings, key=lambda recording: recording.specimen):
        yield list(group)


def _repeat(recording: Recording) -> int:
    return int(recording.recording_id.rsplit("_", 1)[1])


def _class_values(pumps: Sequence[AlarmScores], label: str) -> dict[str, float]:
    items = [item for scores in pumps for item in scores.classes if item.label == label]
    auroc = [item.auroc for item in items]
    return {
        "alarms": float(np.mean([item.share for item in items])),
        "auroc": float(np.mean(auroc)),
        "lowest_auroc": min(auroc),
        "error_rate": pumps[0].error_rate,
    }


def _answer(study: StudyTable, fleets: Mapping[int, Mapping[int, Sequence[AlarmScores]]]) -> Iterator[str]:
    for count in next(iter(fleets.values())):
        size = str(len(PRESSURES) * count)
        classes = [item for fleet in fleets.values() for scores in fleet[count] for item in scores.classes]
        healthy = [item for item in classes if item.label == CLASSES[0]]
        n, alarms = (sum(getattr(item, name) for item in healthy) for name in ("n_recordings", "n_alarms"))
        low, high = wilson_interval(alarms / n, n) if n else (math.nan, math.nan)
        rate = study.values("error_rate", healthy_recordings=size)[0]
        areas = ", ".join(
            f"{label.replace('_', ' ')} {np.mean(study.values('auroc', healthy_recordings=size, label=label)):.3f}"
            for label in CLASSES[1:]
        )
        yield (
            f"From {size} healthy recordings at a stated false-alarm rate of {rate:g}: {alarms} false alarms on {n} "
            f"healthy recordings ({alarms / max(n, 1):.3f}, 95 % interval {low:.3f} to {high:.3f}); AUROC against "
            f"healthy {areas}."
        )
