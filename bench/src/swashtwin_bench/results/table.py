"""The table of a study: metrics over seeds, for each combination of factors.

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
from swashtwin_bench.results.naming import format_factor

USER_FILES = "Recordings from files of the user."
"""Origin of recordings that do not come from the virtual rig."""


@dataclass(frozen=True)
class Trial:
    """Values of one combination of factors under one seed."""

    factors: Mapping[str, str]
    """Name of its row, such as ``{"twin": "nominal"}``; the keys are the same in a table."""
    seed: int
    """Seed of all random draws."""
    values: Mapping[str, float]
    """Value of each metric; NaN or missing if it is not defined."""


@dataclass(frozen=True, eq=False)
class StudyTable:
    """Contents of the report and of the JSON of a study."""

    study: str
    """Name, such as ``"calibration"``."""
    title: str
    """Question, as a heading."""
    metrics: Mapping[str, str]
    """Heading of each metric that is shown, with its unit in brackets."""
    trials: tuple[Trial, ...]
    """All trials, in the order of the rows."""
    answer: tuple[str, ...]
    """Answer in sentences."""
    settings: Mapping[str, Any]
    """Settings, as JSON can hold them."""
    origin: str
    """Source of the recordings; for the virtual rig it states that they are simulated."""
    wall_s: float = 0.0
    """Duration of the study [s]."""
    version: str = VERSION
    """Version of swashtwin."""
    command: str = ""
    """Command that repeats the study."""
    notes: tuple[str, ...] = ()
    """Limits and surprises that a reader of the numbers must know."""
    device: str = "cpu"
    """Device on which it ran."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Further results that a reader may check, as JSON can hold them."""

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds in ascending order."""
        return tuple(sorted({trial.seed for trial in self.trials}))

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors that were varied."""
        return tuple(self.trials[0].factors) if self.trials else ()

    @property
    def main_metric(self) -> str:
        """Name of the metric that the summary of the page shows: the first that differs by row."""
        rows = self.rows()
        for metric in self.metrics:
            if len({row[metric]["mean"] for row in rows} - {None}) > 1:
                return metric
        return next(iter(self.metrics))

    def summary_rows(self) -> list[dict[str, Any]]:
        """Return the rows that the summary of the page shows: those with the main metric."""
        return [row for row in self.rows() if row[self.main_metric]["mean"] is not None]

    @property
    def headline(self) -> str:
        """The range of the main metric in a few words; empty if no row defines it."""
        rows = self.summary_rows()
        if not rows:
            return ""

        rows.sort(key=lambda row: float(row[self.main_metric]["mean"]), reverse=True)
        ends = []
        for index in dict.fromkeys([0, len(rows) - 1]):
            value = f"{rows[index][self.main_metric]['mean']:.3g}"
            ends.append(f"{value} ({self.label_row(rows[index])})")
        heading = self.metrics[self.main_metric]
        return f"{heading[0].upper()}{heading[1:]}: {' to '.join(ends)}"

    def label_row(self, row: Mapping[str, Any], *, without: str = "") -> str:
        """Return the factors of a row that vary in the study, or else its first one.

        Parameters
        ----------
        without : name of a factor that is left out.
        """
        varied = []
        for name in self.factors:
            if name != without and len({trial.factors[name] for trial in self.trials}) > 1:
                varied.append(name)

        labels = []
        for name in varied or self.factors[:1]:
            label = format_factor(name, row[name])
            # A number alone would not say of what.
            if label.isdecimal():
                label = f"{name} {label}"
            labels.append(label)
        return ", ".join(labels)

    def values(self, metric: str, **factors: str) -> list[float]:
        """Return a metric of each trial with these factors."""
        return [trial.values.get(metric, math.nan) for trial in self.select(**factors)]

    def select(self, **factors: str) -> list[Trial]:
        """Return the trials with these factors."""
        return [trial for trial in self.trials if factors.items() <= trial.factors.items()]

    def rows(self) -> list[dict[str, Any]]:
        """Return one row for each combination of factors."""
        keys = dict.fromkeys(tuple(trial.factors.items()) for trial in self.trials)

        rows = []
        for key in keys:
            factors = dict(key)
            spreads = {metric: spread(self.values(metric, **factors)) for metric in self.metrics}
            rows.append({**factors, **spreads})

        return rows

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of the study."""
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
    """Return mean, sample standard deviation (None for one value) and the values."""
    finite = [value for value in values if math.isfinite(value)]
    return {
        "mean": float(np.mean(finite)) if finite else None,
        "std": float(np.std(finite, ddof=1)) if len(finite) > 1 else None,
        "values": [value if math.isfinite(value) else None for value in values],
    }


def paired_interval(
    differences: Sequence[float], test_share: float | None = None
) -> tuple[float, float]:
    """Return the 95 % interval of the mean of paired differences; NaN for one pair.

    It is Student's, or that of the corrected resampled t test.

    Parameters
    ----------
    test_share : ratio of test to training recordings, if the pairs are splits of the same
        recordings. Such pairs are correlated, so the variance is (1/n + test_share) s² instead of
        s²/n (Nadeau and Bengio 2003, DOI 10.1023/A:1024068626366).

    Examples
    --------
    >>> [round(value, 3) for value in paired_interval([0.1, 0.2, 0.3])]
    [-0.048, 0.448]
    """
    values = np.asarray(differences, dtype=float)
    if values.size < 2:
        return math.nan, math.nan

    variance_factor = 1 / values.size + (test_share or 0.0)
    standard_error = math.sqrt(variance_factor * values.var(ddof=1))
    half_width = float(stats.t.ppf(0.975, values.size - 1)) * standard_error

    mean = float(values.mean())
    return mean - half_width, mean + half_width


def describe_origin(recordings: Sequence[Recording]) -> str:
    """Return the source of recordings; for the virtual rig with a warning that it is simulated."""
    origins = sorted({recording.attributes.get("origin", "") for recording in recordings} - {""})
    if not origins:
        return USER_FILES

    return (
        f"Recordings of the {'; '.join(origins)}: a stand-in for a machine. The rig shares the "
        "equations of the model and the drawing of the pump with the twin, and most training sets "
        "spread severities as version 1 of the rig does. No figure here shows how well the method "
        "works on a real pump."
    )
