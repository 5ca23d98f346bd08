"""What was tried in a choice, how it fared, and what was chosen."""

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Trial:
    """How one candidate fared on recordings that its training did not see."""

    candidate: str
    """Its name."""
    score: float
    """Mean over the groups of the mean of `clean` and `disturbed`."""
    standard_error: float
    """Standard error of `score`, between the groups; 0 with one group."""
    clean: float
    """Mean over the classes of the share of windows told right, as they were measured."""
    disturbed: float
    """The same under noise at 5 dB, and under other gains and speeds, on average."""
    is_tied: bool
    """Whether its score is within one standard error of the best one."""


@dataclass(frozen=True)
class Choice:
    """The trials of all candidates, and the one chosen."""

    chosen: str
    """Name of the candidate chosen: of those tied with the best the first in the declared order, which is from the most
    invariant to the least."""
    trials: tuple[Trial, ...]
    """Every candidate tried, in the declared order; none where the recordings are too few for a trial."""
    group: str
    """What inner folds kept whole: ``"specimen"``, ``"condition"`` or ``"recording"``; empty without a trial."""
    n_folds: int
    """Inner folds."""
    n_windows: int
    """Measured windows that were tested on."""
    reason: str
    """Why there was no trial, or why candidates were left out; empty where all were tried."""

    def sentence(self) -> str:
        """The choice in words."""
        if not self.trials:
            return f"Chosen without a trial: {self.chosen} ({self.reason})."
        trial = next(trial for trial in self.trials if trial.candidate == self.chosen)
        tied = sum(trial.is_tied for trial in self.trials)
        others = f"; the first of {tied} that are as good within one standard error" if tied > 1 else ""
        return (
            f"Chosen: {self.chosen}, {100 * trial.clean:.0f} % of the windows of unseen {self.group}s right, "
            f"{100 * trial.disturbed:.0f} % under noise, gain and speed{others}."
        )

    def to_dict(self) -> dict[str, Any]:
        """The same as JSON can hold it."""
        return {**asdict(self), "trials": [asdict(trial) for trial in self.trials]}
