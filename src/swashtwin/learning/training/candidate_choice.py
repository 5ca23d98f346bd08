"""The choice among candidates, as a trained model records it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from swashtwin.foundation import plural

# Keeps 1 / 10 from counting as above a rate of 0.1.
_RATE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Trial:
    """Result of one candidate on recordings that its training did not see."""

    candidate: str
    score: float
    """Mean over the groups of the mean of `clean` and `disturbed`."""
    standard_error: float
    """Standard error of `score`, between the groups; 0 with one group."""
    clean: float
    """Mean recall over the classes, by recording, without disturbance."""
    disturbed: float
    """The mean of the same under noise at 5 dB, and under other gains and speeds."""
    is_tied: bool
    """Whether its score is within one standard error of the best one."""


@dataclass(frozen=True)
class CandidateChoice:
    """The trials of all candidates, and the chosen one."""

    candidate: str
    """Name of the chosen candidate: the best one, or with few machines the first one tied with it
    (`choose_candidate`).
    """
    trials: tuple[Trial, ...]
    """Trials of all candidates, in the declared order; empty if there are too few recordings."""
    group: str
    """What inner folds kept whole: ``"specimen"``, ``"condition"`` or ``"recording"``; empty
    without a trial.
    """
    n_folds: int
    n_windows: int
    """Measured windows that were tested on."""
    reason: str
    """Why there was no trial; empty if there was one."""
    n_machines: int = 0
    """Machines that it rests on; 0 if folds did not leave machines out."""
    head_recalls: Mapping[str, float] = field(default_factory=dict)
    """Mean recall, by recording, of each head on whole recordings, and of all heads together:
    ``"without baseline"`` and ``"with baseline"`` of the machine. Empty if recordings are too
    short.
    """

    def __post_init__(self) -> None:
        if self.head_recalls and "without baseline" not in self.head_recalls:
            raise ValueError("there is no recall without baseline")

    def describe_machine_limit(self, error_rate: float) -> str:
        """Return what its machines cannot promise for a new one; empty if they allow the rate.

        Of K + 1 exchangeable machines, the new one is the most difficult with a probability of
        1 / (K + 1). So no rule keeps a lower error rate for every kind of machine, unless its sets
        name all classes (Dunn, Wasserman and Ramdas, arXiv:1809.07441).
        """
        lowest_rate = 1 / (self.n_machines + 1)
        if not self.n_machines or lowest_rate <= error_rate + _RATE_TOLERANCE:
            return ""
        return (
            f"with {plural(self.n_machines, 'training machine')}, no error rate below "
            f"{100 * lowest_rate:.0f} % can be promised for a new one"
        )

    def sentence(self) -> str:
        """Describe the choice in sentences."""
        if not self.trials:
            return f"Chosen without a trial: {self.candidate} ({self.reason})."

        trial = next(trial for trial in self.trials if trial.candidate == self.candidate)
        text = (
            f"Chosen: {self.candidate}, which classified {100 * trial.clean:.0f} % of the "
            f"recordings of held-out {self.group}s right, and {100 * trial.disturbed:.0f} % under "
            "noise and other gains and speeds"
        )
        n_tied = sum(trial.is_tied for trial in self.trials)
        if n_tied > 1:
            text += f"; one of {n_tied} that are as good within one standard error"
        text += "."

        if self.head_recalls:
            without_baseline = 100 * self.head_recalls["without baseline"]
            text += f" With heads on whole recordings {without_baseline:.0f} %"
            with_baseline = self.head_recalls.get("with baseline")
            if with_baseline is not None:
                text += (
                    f", and {100 * with_baseline:.0f} % with healthy recordings of the same machine"
                )
            text += "."
        if self.n_machines:
            text += f" This rests on {plural(self.n_machines, 'machine')}."
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as JSON can hold it."""
        table = asdict(self)
        table["trials"] = [asdict(trial) for trial in self.trials]
        return table
