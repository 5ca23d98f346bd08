"""Detection by a detector that learned from twenty healthy recordings.

Its false alarms are compared with the specified rate. Two anomalous recordings among the twenty
show what such mistakes cost.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from swashtwin.diagnosis import AnomalyDetector
from swashtwin.foundation import random_stream
from swashtwin.learning import wilson_interval
from swashtwin.pump import CLASSES, is_healthy
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.writing import PRESSURES, RIG_VERSION, RigSize, rig_recordings

METRICS = {
    "healthy": "new healthy recordings",
    "false_alarms": "false alarms",
    "faults": "faults",
    "before": "caught from the eighteen others",
    "caught": "caught with the two odd ones",
    "left_out": "odd ones left out",
}
"""Heading of each figure."""
ANOMALIES = ("none", "bursts", "a disturbed sensor", "another pressure")
"""Kinds of the two anomalous recordings among those that train."""

# Healthy recordings of a pump and pressure.
_HEALTHY = 18

# Recordings of a pump and pressure of each fault.
_FAULTY = 4

# Recordings that train a detector, two of them anomalous.
_TRAIN = 20


@dataclass(frozen=True)
class DetectorStudySettings:
    """Recordings of the study."""

    rig: str = RIG_VERSION
    """Version of the rig."""
    pumps: int = 2
    """Pumps of each fleet."""
    duration: float = 2.0
    """Length of each recording [s]."""


def detector(work: Work, settings: DetectorStudySettings) -> StudyTable:
    """Return detections and false alarms, a row for each kind of anomalous recording.

    Parameters
    ----------
    work : its seeds are fleets of the rig.
    """
    figures = work.map("fleets", _measure_fleet, [(seed, settings) for seed in work.seeds])
    trials = []
    for kind in ANOMALIES:
        for seed, by_kind in zip(work.seeds, figures, strict=True):
            trials.append(Trial({"two odd ones": kind}, seed, by_kind[kind]))

    first, _ = next(rig_recordings(work.seeds[0], RigSize(1, 1, 0.1), version=settings.rig))
    study = StudyTable(
        study="detector",
        title="Does a detector keep its rate, and what do odd healthy recordings cost it?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings=asdict(settings),
        origin=describe_origin([first]),
        notes=(
            "Of twenty, 0.05 is promised, of eighteen 0.053, in the mean over sets of healthy "
            "ones. All recordings of a pump are compared with one set, so false alarms come in "
            "clusters, and intervals are too narrow.",
        ),
    )
    return replace(study, answer=tuple(_answer(study)))


def _measure_fleet(seed: int, settings: DetectorStudySettings) -> dict[str, dict[str, float]]:
    """Return the figures of all pumps of a fleet, by kind of the anomalous recordings."""
    healthy = _record(seed, settings, _HEALTHY, [name for name in CLASSES if is_healthy(name)])
    faulty = _record(seed, settings, _FAULTY, [name for name in CLASSES if not is_healthy(name)])

    sums = {kind: np.zeros(len(METRICS)) for kind in ANOMALIES}
    for pump in sorted({str(recording.specimen) for recording in healthy}):
        faults = [recording for recording in faulty if recording.specimen == pump]
        by_pressure = [recording for recording in healthy if recording.specimen == pump]

        # Pressures alternate, so that those that train and those that test have all of them.
        alternating: list[Recording] = []
        for repeat in range(_HEALTHY):
            alternating += by_pressure[repeat::_HEALTHY]
        normal = alternating[: _TRAIN - 2]
        healthy_pair = alternating[_TRAIN - 2 : _TRAIN]
        tested = alternating[_TRAIN:-2]
        pair_to_disturb = alternating[-2:]

        caught_by_normal = _count_alarms(AnomalyDetector().fit(normal), faults)
        for kind in ANOMALIES:
            pair = healthy_pair
            if kind != "none":
                pair = [_disturb(kind, recording, seed) for recording in pair_to_disturb]
            fitted = AnomalyDetector().fit([*normal, *pair])
            excluded = sum(recording.recording_id not in fitted.manifest for recording in pair)
            sums[kind] += (
                len(tested),
                _count_alarms(fitted, tested),
                len(faults),
                caught_by_normal,
                _count_alarms(fitted, faults),
                excluded,
            )

    return {kind: dict(zip(METRICS, values.tolist(), strict=True)) for kind, values in sums.items()}


def _record(
    seed: int, settings: DetectorStudySettings, repeats: int, labels: list[str]
) -> list[Recording]:
    size = RigSize(settings.pumps, repeats, settings.duration)
    pairs = rig_recordings(seed, size, version=settings.rig, labels=labels)

    return [recording for recording, _ in pairs]


def _count_alarms(fitted: AnomalyDetector, recordings: list[Recording]) -> int:
    return sum(bool(fitted.diagnose(recording).alarm) for recording in recordings)


def _disturb(kind: str, recording: Recording, seed: int) -> Recording:
    """Return a recording with a disturbance.

    ``bursts`` are three to eight knocks of 8 to 25 times the rms, ``a disturbed sensor`` is a
    channel with another gain or with hum, and ``another pressure`` is set wrongly.
    """
    rng = random_stream(seed, kind, recording.recording_id)
    signal = recording.signal.copy()
    rate = recording.sample_rate
    condition = recording.condition

    if kind == "another pressure" and condition is not None:
        is_lowest = condition.discharge_pressure <= PRESSURES[0]
        pressure = PRESSURES[-1] if is_lowest else PRESSURES[0]
        return recording.replace(condition=replace(condition, discharge_pressure=pressure))

    if kind == "bursts":
        time = np.arange(round(0.3 * rate)) / rate
        rms = signal.std(axis=1, keepdims=True)
        for start in rng.integers(0, signal.shape[1] - len(time), rng.integers(3, 9)).tolist():
            decay = np.exp(-time / rng.uniform(0.01, 0.06))
            knock = decay * np.sin(2 * np.pi * rng.uniform(400, 5000) * time)
            signal[:, start : start + len(time)] += rng.uniform(8, 25) * rms * knock

    if kind == "a disturbed sensor":
        channel = signal[rng.integers(len(signal))]
        if rng.integers(2):
            channel *= 10 ** (rng.choice([-1, 1]) * rng.uniform(3, 9) / 20)
        else:
            hum = np.sign(np.sin(100 * np.pi * np.arange(len(channel)) / rate + 0.1))
            channel += channel.std() * rng.uniform(0.5, 2) * hum

    return recording.replace(signal=signal)


def _answer(study: StudyTable) -> Iterator[str]:
    for kind in ANOMALIES:
        sums = [sum(study.values(name, **{"two odd ones": kind})) for name in METRICS]
        healthy, alarms, faults, before, caught, _ = sums
        low, high = wilson_interval(alarms / healthy, int(healthy))

        yield (
            f"{kind}: {alarms:.0f} false alarms in {healthy:.0f}, {alarms / healthy:.3f} "
            f"({low:.3f} to {high:.3f}); {caught / faults:.3f} of the faults caught, "
            f"{caught / max(before, 1):.3f} of those caught without."
        )
