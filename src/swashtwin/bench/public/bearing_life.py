"""When the alarm of a detector from a bearing's first recordings comes in its life, on bearings run until they failed.

The rule was fixed before any bearing was looked at: the first 20 recordings are healthy, and an alarm stands as
`persistent_alarms` says. No threshold is fitted to these bearings.
"""

import math
import time
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from swashtwin.bench.public.readers.bearing_run_to_failure import read_bearing_run_to_failure
from swashtwin.bench.results.table import StudyTable, Trial
from swashtwin.diagnosis import AnomalyVerdict, fit_healthy, persistent_alarms
from swashtwin.foundation import VERSION, InputError
from swashtwin.recordings import Recording

N_HEALTHY = 20
"""Recordings at the start of each life that are taken for healthy."""
EARLY = 0.25
"""Share of the life in which an alarm is early."""

METRICS = {
    "alarm_at": "alarm at share of life",
    "early_standing": "standing alarms in the first quarter",
    "early_alarms": "single alarms in the first quarter",
    "recordings": "recordings",
}
"""Heading of each figure."""

_NOTES = (
    f"The first {N_HEALTHY} recordings of each bearing are its healthy ones, at a false-alarm rate of 0.05. An alarm "
    "stands where two recordings in a row are alarms and one and the same level has risen by 6 dB and five standard "
    "deviations in both. The rule was fixed before any bearing was looked at.",
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
        trials.append(Trial({"bearing": name}, 0, life_values(life)))
    ends = [trial.values["alarm_at"] for trial in trials]
    early = sum(trial.values["early_standing"] > 0 for trial in trials)
    shares = ", ".join("none" if math.isnan(end) else f"{end:.2f}" for end in ends)
    answer = (
        f"The alarm came before the end on {sum(not math.isnan(end) for end in ends)} of {len(ends)} bearings, at "
        f"{shares} of life; {early} had one in the first quarter.",
    )
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


def life_values(life: Sequence[Recording]) -> dict[str, float]:
    """Figures of one bearing, its recordings in order of time to its end."""
    detector = fit_healthy(life[:N_HEALTHY])
    verdicts: list[AnomalyVerdict] = [detector.diagnose(recording) for recording in life[N_HEALTHY:]]
    snapshot = np.array([int(recording.attributes["snapshot"]) for recording in life])
    share = snapshot[N_HEALTHY:] / snapshot[-1]
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
