"""Whether one row beats another: differences paired by seed, with intervals that say what the pairs are."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

_MOST_SIGNS = 100_000

FEWEST_FOR_RANKS = 6
"""Pairs below which no signed-rank test can reach 5 %."""

_NO_WIDTH = 1e-9  # of an interval between equal differences, but for rounding


@dataclass(frozen=True)
class Contrast:
    """How much one row is above another, in the mean over the seeds that both have."""

    first: Mapping[str, str]
    """Factors of the one."""
    second: Mapping[str, str]
    """Factors of the other."""
    metric: str
    """What is compared."""
    mean: float
    """Mean of the differences, first less second."""
    interval: tuple[float, float]
    """95 % interval of it; NaN for one seed."""
    pairs: int
    """Seeds that both have."""
    p_value: float
    """Of Wilcoxon's signed-rank test, corrected by Holm over all contrasts against the same row; NaN with fewer than
    six seeds, and where the seeds split the same recordings, which the test takes for independent pairs."""
    is_corrected: bool
    """Whether the seeds split the same recordings anew, so that the interval is that of the corrected resampled t
    (Nadeau and Bengio 2003); else each seed is a fleet of its own and the interval is Student's."""

    @property
    def is_clear(self) -> bool:
        """Whether the interval excludes zero; one without width says only that too little was tested to differ."""
        low, high = self.interval
        return math.isfinite(low) and high - low > _NO_WIDTH and (low > 0 or high < 0)

    def to_dict(self) -> dict[str, Any]:
        """The contrast as JSON can hold it."""
        return {
            "first": dict(self.first),
            "second": dict(self.second),
            "metric": self.metric,
            "mean": self.mean,
            "interval": [None if math.isnan(value) else value for value in self.interval],
            "pairs": self.pairs,
            "p_value": None if math.isnan(self.p_value) else self.p_value,
            "is_corrected": self.is_corrected,
        }


def paired_interval(differences: Sequence[float], test_share: float | None = None) -> tuple[float, float]:
    """95 % interval of the mean of paired differences, by Student's t; NaN for one pair.

    Parameters
    ----------
    test_share : test recordings over training recordings, where the pairs are splits of the same recordings: the
        variance is then (1/n + test_share) s² instead of s²/n (Nadeau and Bengio 2003, DOI 10.1023/A:1024068626366).

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


def signed_rank_p(differences: Sequence[float]) -> float:
    """p-value of Wilcoxon's signed-rank test, two-sided; NaN with fewer than six pairs, 1 where none differs.

    It is exact, over every change of signs; from 17 pairs on over random ones, the same each time.

    Examples
    --------
    >>> signed_rank_p([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    0.03125
    """
    values = np.asarray(differences, dtype=float)
    if values.size < FEWEST_FOR_RANKS:
        return math.nan
    if not np.any(values):
        return 1.0
    signs = stats.PermutationMethod(n_resamples=_MOST_SIGNS, rng=np.random.default_rng(0))
    return float(stats.wilcoxon(values, zero_method="zsplit", method=signs).pvalue)
