"""Time of the alarm in the life of bearings that ran until they failed, by two rules.

The watch is `OperatingPointMonitor` with its defaults. The plain rule raises an alarm if a band is
6 dB above its median of the first 20 recordings, which are assumed healthy, in two of three
recordings. No threshold is fitted to these bearings.
"""

import math
from collections.abc import Sequence
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
"""Recordings at the start of each life that are assumed healthy."""

EARLY = 0.25
"""Share of the life within which an alarm counts as early."""

PLAIN_RISE = 6.0
"""Rise of a band [dB] that the plain rule counts: twice the amplitude."""

METRICS = {
    "watch_at": "watch: alarm at share of life",
    "plain_at": "plain rule: alarm at share of life",
    "recordings": "recordings",
}
"""Heading of each figure."""

_NOTES = (
    "The rule of the watch was selected on the virtual rig, by people who knew how a detector "
    "behaves on these bearings.",
    "Six bearings of one machine support counts, not claims about bearing life. Recordings taken "
    "within minutes scatter less than those of days, so single alarms are far more frequent than "
    "the specified rate.",
)


def bearing_life(work: Work, folder: Path) -> StudyTable:
    """Return the time of the alarm in the life of each bearing of ``bearing_run_to_failure``.

    Parameters
    ----------
    folder : folder of the set, or the folder that holds it.

    Raises
    ------
    InputError
        A bearing has hardly more recordings than are assumed healthy.
    """
    inner_folder = Path(folder) / "bearing_run_to_failure"
    recordings = read_bearing_run_to_failure(inner_folder if inner_folder.is_dir() else folder)
    lives: dict[str, list[Recording]] = {}
    for recording in recordings:
        lives.setdefault(str(recording.specimen), []).append(recording)

    for name, life in lives.items():
        if len(life) < 2 * N_HEALTHY:
            raise InputError(
                f"{name} has {len(life)} recordings; at least {2 * N_HEALTHY} are required."
            )

    values = work.map("bearings", _values, [(life,) for life in lives.values()])
    trials = [
        Trial({"bearing": name}, 0, figures) for name, figures in zip(lives, values, strict=True)
    ]

    return StudyTable(
        study="run-to-failure",
        title="Does the alarm come before the end, and not too early?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(
            _describe_alarms("watch", [figures["watch_at"] for figures in values]),
            _describe_alarms("plain rule", [figures["plain_at"] for figures in values]),
        ),
        settings={"healthy": N_HEALTHY, "early": EARLY},
        origin=(
            "bearing_run_to_failure: six bearings run until they failed (PRONOSTIA, IEEE PHM 2012)."
        ),
        notes=_NOTES,
    )


def _describe_alarms(rule: str, alarm_shares: Sequence[float]) -> str:
    """Return how many alarms a rule raised, and at which shares of life."""
    alarm_count = sum(not math.isnan(share) for share in alarm_shares)
    early_count = sum(share <= EARLY for share in alarm_shares)
    shares = ", ".join("none" if math.isnan(share) else f"{share:.2f}" for share in alarm_shares)

    return (
        f"The alarm of the {rule} came before the end on {alarm_count} of {len(alarm_shares)} "
        f"bearings, at {shares} of life; {early_count} of these in the first quarter."
    )


def _values(life: Sequence[Recording]) -> dict[str, float]:
    return {
        "watch_at": watch_alarm(life),
        "plain_at": plain_alarm(life),
        "recordings": float(len(life)),
    }


def watch_alarm(life: Sequence[Recording]) -> float:
    """Return the share of life at which the watch raises its first alarm, or NaN.

    Parameters
    ----------
    life : recordings of one bearing, in order of time to its end.
    """
    monitor = OperatingPointMonitor(str(life[0].specimen))
    state = None
    for recording, share in zip(life, _shares(life), strict=True):
        point_judgment = monitor.judge(recording, state)
        # An alarm at the end of life warns of nothing.
        if point_judgment.is_alarm and share < 1:
            return float(share)
        state = point_judgment.state

    return math.nan


def plain_alarm(life: Sequence[Recording]) -> float:
    """Return the share of life at which the plain rule raises its first alarm, or NaN.

    It does if a band is `PLAIN_RISE` above its median in two of three recordings.

    Parameters
    ----------
    life : recordings of one bearing, in order of time to its end; the median is that of the first
        `N_HEALTHY`.
    """
    layout, _ = band_power_layout(life)
    is_band = np.array([band_power.is_band for band_power in layout.band_powers])
    band_powers = np.array([layout.measure(recording)[is_band] for recording in life])

    is_high = band_powers - np.median(band_powers[:N_HEALTHY], axis=0) >= PLAIN_RISE
    is_high[:N_HEALTHY] = False

    for number, share in enumerate(_shares(life)):
        last_three = is_high[max(number - 2, 0) : number + 1]
        if share < 1 and (last_three.sum(axis=0) >= 2).any():
            return float(share)

    return math.nan


def _shares(life: Sequence[Recording]) -> Float64[np.ndarray, " recording"]:
    """Return the share of life at each recording."""
    snapshot = np.array([int(recording.attributes["snapshot"]) for recording in life])

    return np.asarray(snapshot / snapshot[-1])
