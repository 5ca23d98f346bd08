"""A study whose answer is a table: factors, and metrics over seeds.

The JSON is stable: ``{"study", "title", "seeds", "rows", "answer", "notes", "settings", "origin",
"wall_s", "device", "version", "command", "details"}``. Each row holds the factors that name it and,
under each metric, ``{"mean", "std", "values"}`` over the trials.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import stats

from swashtwin.foundation import VERSION
from swashtwin.recordings import Recording


@dataclass(frozen=True)
class Trial:
    """What came out once."""

    factors: Mapping[str, str]
    """What names its row, such as ``{"twin": "nominal"}``; every trial of a table has the same
    names.
    """
    seed: int
    """Seed of all that was drawn."""
    values: Mapping[str, float]
    """Number under each metric; NaN, or left out, where there is none."""


@dataclass(frozen=True, eq=False)
class StudyTable:
    """All that the report and the JSON of such a study are made from."""

    study: str
    """Name, such as ``"calibration"``."""
    title: str
    """What it asks, as a heading."""
    metrics: Mapping[str, str]
    """Heading of each metric, with its unit in brackets; only these are shown."""
    trials: tuple[Trial, ...]
    """Everything that was tried, in the order in which rows are to stand."""
    answer: tuple[str, ...]
    """What came out, in sentences."""
    settings: Mapping[str, Any]
    """Settings, as JSON can hold them."""
    origin: str
    """Where the recordings come from, in words; the virtual rig says that it is none of a
    machine's.
    """
    wall_s: float = 0.0
    """How long it took [s]."""
    version: str = VERSION
    """Version of swashtwin."""
    command: str = ""
    """Command that repeats it."""
    notes: tuple[str, ...] = ()
    """What a reader must know beside the numbers: limits, surprises, what was left out."""
    device: str = "cpu"
    """What it ran on."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Whatever else a reader may check, as JSON can hold it: single cases, splits, chosen
    settings.
    """

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds that were run, in order."""
        return tuple(sorted({trial.seed for trial in self.trials}))

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of what was varied."""
        return tuple(self.trials[0].factors) if self.trials else ()

    def values(self, metric: str, **factors: str) -> list[float]:
        """The metric of every trial of those factors."""
        return [trial.values.get(metric, float("nan")) for trial in self.of(**factors)]

    def of(self, **factors: str) -> list[Trial]:
        """Trials that have those factors."""
        return [
            trial
            for trial in self.trials
            if all(trial.factors[name] == want for name, want in factors.items())
        ]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each set of factors."""
        keys = dict.fromkeys(tuple(trial.factors.items()) for trial in self.trials)
        rows = []
        for key in keys:
            factors = dict(key)
            spreads = {metric: spread(self.values(metric, **factors)) for metric in self.metrics}
            rows.append({**factors, **spreads})
        return rows

    def to_dict(self) -> dict[str, Any]:
        """The study's JSON."""
        return {
            "study": self.study,
            "title": self.title,
            "seeds": list(self.seeds),
            "rows": self.rows(),
            "answer": list(self.answer),
            "notes": list(self.notes),
            "settings": dict(self.settings),
            "origin": self.origin,
            "wall_s": round(self.wall_s, 2),
            "device": self.device,
            "version": self.version,
            "command": self.command,
            "details": dict(self.details),
        }


def spread(values: Sequence[float]) -> dict[str, Any]:
    """Mean, standard deviation (of the sample; None for one value) and the values themselves."""
    finite = [value for value in values if math.isfinite(value)]
    return {
        "mean": float(np.mean(finite)) if finite else None,
        "std": float(np.std(finite, ddof=1)) if len(finite) > 1 else None,
        "values": [value if math.isfinite(value) else None for value in values],
    }


def paired_interval(
    differences: Sequence[float], test_share: float | None = None
) -> tuple[float, float]:
    """95 % interval of the mean of paired differences, by Student's t; NaN for one pair.

    Parameters
    ----------
    test_share : test recordings over training recordings, where the pairs are splits of the same
        recordings: the variance is then (1/n + test_share) s² instead of s²/n (Nadeau and Bengio
        2003, DOI 10.1023/A:1024068626366).

    Examples
    --------
    >>> [round(value, 3) for value in paired_interval([0.1, 0.2, 0.3])]
    [-0.048, 0.448]
    """
    values = np.asarray(differences, dtype=float)
    if values.size < 2:
        return math.nan, math.nan
    factor = 1 / values.size + (test_share or 0.0)
    half = float(stats.t.ppf(0.975, values.size - 1)) * math.sqrt(factor * values.var(ddof=1))
    mean = float(values.mean())
    return mean - half, mean + half


def describe_origin(recordings: Sequence[Recording]) -> str:
    """Where recordings come from, in words; those of the virtual rig say that they are none of a
    machine's.
    """
    origins = sorted({recording.attributes.get("origin", "") for recording in recordings} - {""})
    if not origins:
        return "Recordings from files of the user."
    return (
        f"Recordings of the {'; '.join(origins)}: a stand-in for a machine. It shares the model's equations and "
        "the pump's drawing with the twin, and most training sets spread severities as its version 1 does. No figure "
        "here says how well the method works on a real pump."
    )
