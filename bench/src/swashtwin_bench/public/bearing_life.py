"""When alarms come in the life of bearings that ran until they failed, by three rules.

The detector: the first 20 recordings are healthy, and an alarm stands as `persistent_alarms` says. The watch:
`PointMonitor` with its defaults. The plain rule: a band stands 6 dB above its median of the first 20 recordings in
two of three. No threshold is fitted to these bearings.
"""

import math
import time
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis import AnomalyDetector, Diagnosis
from swashtwin.foundation import VERSION, InputError
from swashtwin.learning import level_layout
from swashtwin.monitoring import PointMonitor
from swashtwin.recordings import Recording
from swashtwin_bench.public.readers.bearing_run_to_failure import read_bearing_run_to_failure
from swashtwin_bench.results.table import StudyTable, Trial

N_HEALTHY = 20
"""Recordings at the start of each life that are taken for healthy."""
EARLY = 0.25
"""Share of the life in which an alarm is early."""

RISE, SPREADS = 6.0, 5.0
"""Rise of a level in dB, and over the standard deviation between healthy recordings, that an alarm takes to stand."""
PLAIN_RISE = 6.0
"""Rise of a band [dB] that the plain rule counts: twice the amplitude."""

METRICS = {
    "watch_at": "watch: alarm at share of life",
    "plain_at": "plain rule: alarm at share of life",
    "alarm_at": "detector: alarm at share of life",
    "early_standing": "detector: standing alarms in the first quarter",
    "early_alarms": "detector: single alarms in the first quarter",
    "recordings": "recordings",
}
"""Heading of each figure."""

_NOTES = (
    f"The first {N_HEALTHY} recordings of each bearing are its healthy ones, at a false-alarm rate of 0.05. An alarm "
    "stands where two recordings in a row are alarms and one and the same level has risen by 6 dB and five standard "
    "deviations in both. This rule was fixed before any bearing was looked at.",
    "The rule of the watch was chosen on the virtual rig, by people who had seen what the detector does on these "
    "bearings. The plain rule takes a band that stands 6 dB above its median of the healthy ones in two of three "
    "recordings.",
    "Six bearings of one machine: count what is seen, and claim no life. Recordings within minutes of each other "
    "scatter less than those of days, so single alarms are far more frequent than the stated rate promises.",
)


def run_bearing_life(
    folder: Path | str, *, progress: Callable[[int, int], None] | None = None, command: str = ""
) -> StudyTable:
    """When the alarm comes in the life of each bearing of the set ``bearing_run_to_failure``.

    Parameters
    ----------
    folder : where the set is.
    progress : called with (bearings done, in all).
    command : command line that repeats the study, kept with the result.

    Raises
    ------
    InputError
        A bearing has hardly more recordings than are taken for healthy.
    """
    started = time.perf_counter()
    recordings = read_bearing_run_to_failure(folder)
    lives = {name: list(group) for name, group in groupby(recordings, key=lambda item: str(item.specimen))}
    trials = []
    for number, (name, life) in enumerate(lives.items()):
        if progress is not None:
            progress(number, len(lives))
        if len(life) < 2 * N_HEALTHY:
            raise InputError(f"{name} has {len(life)} recordings; {2 * N_HEALTHY} are needed at least.")
        values = {"watch_at": watch_alarm(life), "plain_at": plain_alarm(life), **life_values(life)}
        trials.append(Trial({"bearing": name}, 0, values))
    names = {"watch_at": "watch", "plain_at": "plain rule", "alarm_at": "detector"}
    answer = tuple(_answer(name, [trial.values[metric] for trial in trials]) for metric, name in names.items())
    return StudyTable(
        study="run-to-failure",
        title="Does the alarm come before the end, and not too early?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=answer,
        settings={"healthy": N_HEALTHY, "early": EARLY},
        origin="bearing_run_to_failure: six bearings run until they failed (PRONOSTIA, IEEE PHM 2012).",
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=_NOTES,
    )


def _answer(rule: str, ends: Sequence[float]) -> str:
    shares = ", ".join("none" if math.isnan(end) else f"{end:.2f}" for end in ends)
    return (
        f"The alarm of the {rule} came before the end on {sum(not math.isnan(end) for end in ends)} of {len(ends)} "
        f"bearings, at {shares} of life; {sum(end <= EARLY for end in ends)} of these in the first quarter."
    )


def watch_alarm(life: Sequence[Recording]) -> float:
    """Share of life at which the watch with its defaults raises its first alarm, or NaN.

    Parameters
    ----------
    life : recordings of one bearing, in order of time to its end.
    """
    monitor, state = PointMonitor(str(life[0].specimen)), None
    for recording, share in zip(life, _shares(life), strict=True):
        point_judgment = monitor.judge(recording, state)
        if point_judgment.is_alarm and share < 1:
            return float(share)
        state = point_judgment.state
    return math.nan


def plain_alarm(life: Sequence[Recording]) -> float:
    """Share of life at which a band is `PLAIN_RISE` above its median in two of three recordings, or NaN.

    Parameters
    ----------
    life : recordings of one bearing, in order of time to its end; the first `N_HEALTHY` make the median.
    """
    layout, _ = level_layout(life)
    bands = np.array([level.is_band for level in layout.levels])
    levels = np.array([layout.measure(recording)[bands] for recording in life])
    high = levels - np.median(levels[:N_HEALTHY], axis=0) >= PLAIN_RISE
    high[:N_HEALTHY] = False
    for number, share in enumerate(_shares(life)):
        if share < 1 and (high[max(number - 2, 0) : number + 1].sum(axis=0) >= 2).any():
            return float(share)
    return math.nan


def _shares(life: Sequence[Recording]) -> Float64[np.ndarray, " recording"]:
    """Share of life at each recording."""
    snapshot = np.array([int(recording.attributes["snapshot"]) for recording in life])
    return np.asarray(snapshot / snapshot[-1])


def persistent_alarms(verdicts: Sequence[Diagnosis]) -> tuple[bool, ...]:
    """Whether the alarm stands at each recording of a sequence: it does where the one before was an alarm as well, and
    at least one and the same level has risen far in both.

    A single blow against the housing has no second recording, and levels that fall, as when a machine runs in, are no
    damage. Recordings without a verdict are passed over.

    Parameters
    ----------
    verdicts : of one detector, in order of time.
    """
    standing = []
    before = None
    for verdict in verdicts:
        if verdict.deviation is None:
            standing.append(False)
            continue
        risen = (verdict.deviation.change >= RISE) & (verdict.deviation.spreads >= SPREADS) & bool(verdict.alarm)
        standing.append(before is not None and bool(np.any(risen & before)))
        before = risen
    return tuple(standing)


def life_values(life: Sequence[Recording]) -> dict[str, float]:
    """Figures of the detector on one bearing, its recordings in order of time to its end."""
    detector = AnomalyDetector().fit(life[:N_HEALTHY])
    verdicts = [detector.diagnose(recording) for recording in life[N_HEALTHY:]]
    share = _shares(life)[N_HEALTHY:]
    standing = np.array(persistent_alarms(verdicts))
    alarms = np.array([verdict.alarm is True for verdict in verdicts])
    early = share <= EARLY
    before_end = share[standing & (share < 1)]
    return {
        "alarm_at": float(before_end[0]) if before_end.size else math.nan,
        "early_standing": float(np.count_nonzero(standing & early)),
        "early_alarms": float(np.mean(alarms[early])) if early.any() else math.nan,
        "recordings": float(len(life)),
    }
