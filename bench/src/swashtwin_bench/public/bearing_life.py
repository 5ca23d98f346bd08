"""When alarms come in the life of bearings that ran until they failed, by two rules.

The watch: `OperatingPointMonitor` with its defaults. The plain rule: a band stands 6 dB above its median of
the first 20 recordings, which are taken for healthy, in two of three. No threshold is fitted to
these bearings.
"""

import math
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import InputError
from swashtwin.learning import band_power_layout
from swashtwin.monitoring import OperatingPointMonitor
from swashtwin.recordings import Recording
from swashtwin_bench.public.readers.named_files import read_bearing_run_to_failure
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial

N_HEALTHY = 20
"""Recordings at the start of each life that are taken for healthy."""
EARLY = 0.25
"""Share of the life in which an alarm is early."""

PLAIN_RISE = 6.0
"""Rise of a band [dB] that the plain rule counts: twice the amplitude."""

METRICS = {
    "watch_at": "watch: alarm at share of life",
    "plain_at": "plain rule: alarm at share of life",
    "recordings": "recordings",
}
"""Heading of each figure."""

_NOTES = (
    "The rule of the watch was chosen on the virtual rig, by people who had seen what a detector does on these "
    "bearings.",
    "Six bearings of one machine: count what is seen, and claim no life. Recordings within minutes of each other "
    "scatter less than those of days, so single alarms are far more frequent than the stated rate promises.",
)


def bearing_life(work: Work, folder: Path) -> StudyTable:
    """When the alarm comes in the life of each bearing of the set ``bearing_run_to_failure``.

    Parameters
    ----------
    folder : where the set is, or the folder that holds it.

    Raises
    ------
    InputError
        A bearing has hardly more recordings than are taken for healthy.
    """
    inner = Path(folder) / "bearing_run_to_failure"
    recordings = read_bearing_run_to_failure(inner if inner.is_dir() else folder)
    lives = {
        name: list(group)
        for name, group in groupby(recordings, key=lambda item: str(item.specimen))
    }
    for name, life in lives.items():
        if len(life) < 2 * N_HEALTHY:
            raise InputError(
                f"{name} has {len(life)} recordings; {2 * N_HEALTHY} are needed at least."
            )
    values = work.map("bearings", _values, [(life,) for life in lives.values()])
    answers = []
    for metric, rule in (("watch_at", "watch"), ("plain_at", "plain rule")):
        ends = [each[metric] for each in values]
        shares = ", ".join("none" if math.isnan(end) else f"{end:.2f}" for end in ends)
        answers.append(
            f"The alarm of the {rule} came before the end on {sum(not math.isnan(end) for end in ends)} of {len(ends)} "
            f"bearings, at {shares} of life; {sum(end <= EARLY for end in ends)} of these in the first quarter."
        )
    return StudyTable(
        study="run-to-failure",
        title="Does the alarm come before the end, and not too early?",
        metrics=METRICS,
        trials=tuple(
            Trial({"bearing": name}, 0, each) for name, each in zip(lives, values, strict=True)
        ),
        answer=tuple(answers),
        settings={"healthy": N_HEALTHY, "early": EARLY},
        origin="bearing_run_to_failure: six bearings run until they failed (PRONOSTIA, IEEE PHM 2012).",
        notes=_NOTES,
    )


def _values(life: Sequence[Recording]) -> dict[str, float]:
    return {
        "watch_at": watch_alarm(life),
        "plain_at": plain_alarm(life),
        "recordings": float(len(life)),
    }


def watch_alarm(life: Sequence[Recording]) -> float:
    """Share of life at which the watch with its defaults raises its first alarm, or NaN.

    Parameters
    ----------
    life : recordings of one bearing, in order of time to its end.
    """
    monitor, state = OperatingPointMonitor(str(life[0].specimen)), None
    for recording, share in zip(life, _shares(life), strict=True):
        point_judgment = monitor.judge(recording, state)
        if point_judgment.is_alarm and share < 1:
            return float(share)
        state = point_judgment.state
    return math.nan


def plain_alarm(life: Sequence[Recording]) -> float:
    """Share of life at which a band is `PLAIN_RISE` above its median in two of three recordings, or
    NaN.

    Parameters
    ----------
    life : recordings of one bearing, in order of time to its end; the first `N_HEALTHY` make the
        median.
    """
    layout, _ = band_power_layout(life)
    bands = np.array([level.is_band for level in layout.band_powers])
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
