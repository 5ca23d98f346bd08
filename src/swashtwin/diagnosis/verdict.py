"""`Diagnosis`: what a model of any kind says of one recording."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from swashtwin.diagnosis.healthy_spectrum import HealthySpectrum
from swashtwin.diagnosis.level_change import LevelChange
from swashtwin.foundation import plural, to_table
from swashtwin.learning import Choice, Deviation, Level
from swashtwin.pump import is_healthy
from swashtwin.recordings import RecordingFacts

_FOR_PAGES = ("facts", "fault_of", "choice", "deviation", "levels", "spectrum")
"""Fields that pages draw, and that `Diagnosis.to_dict` leaves out."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The answer of a classifier, a detector or a pump prior on one recording, and how sure it is."""

    recording_id: str
    """The recording."""
    kind: str = "classifier"
    """What answers: ``"classifier"``, ``"detector"`` (`AnomalyDetector`) or ``"prior"`` (`PriorClassifier`)."""
    unknown: bool = False
    """Whether the recording does not resemble the training, so that no class is named; `label` says nothing then."""
    label: str | None = None
    """Likeliest class of the whole recording, or ``"abnormal"`` or ``"normal"`` of a detector; None without verdict."""
    no_verdict: str | None = None
    """Why there is no verdict: the recording cannot be used, or a number of the answer is not finite."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Probability of each class, pooled over the windows with the temperature and the dependence that validation
    recordings gave. Without `error_rate` it is a score between classes rather than a calibrated chance: the windows of
    one recording are not independent, and count as a single one. Of a prior it is calibrated on virtual pumps."""
    window_labels: tuple[str | None, ...] = ()
    """Likeliest class of each window, in order of time; None where a number of it is not finite."""
    error_rate: float | None = None
    """Share of recordings whose `prediction_set` may miss the true class, and of those wrongly called unknown or
    raising a false alarm; None where the confidence was not calibrated (`fit_chosen`, `learn_confidence`)."""
    prediction_set: tuple[str, ...] = ()
    """Classes that cannot be ruled out at the error rate, likeliest first."""
    plausibility: Mapping[str, float] = field(default_factory=dict)
    """Conformal p-value of each class."""
    scarce_classes: tuple[str, ...] = ()
    """Classes whose p-value is taken among the recordings of all of them together, since some have too few for the
    error rate; that of each other class is taken among its recordings alone."""
    p_value: float | None = None
    """Conformal p-value of resembling the recordings of `basis`, 1 / (n + 1) at least; the recording is unknown, or an
    alarm, where it is at most the error rate."""
    score: float | None = None
    """How unlike these it is: `TrainingReference.ood_score`, or the squared distance of a detector."""
    threshold: float | None = None
    """Score beyond which a classifier calls a recording unknown."""
    basis: str = ""
    """The recordings that it is compared with, in words."""
    n_basis: int = 0
    """Number of these recordings."""
    reasons: tuple[str, ...] = ()
    """What of the recording is outside the training's range, in words; `notes` hold them too."""
    shifts: tuple[str, ...] = ()
    """Channels whose levels moved as a whole, in words; of a detector."""
    changes: tuple[LevelChange, ...] = ()
    """Levels that moved, furthest first, also without an alarm; of a detector."""
    notes: tuple[str, ...] = ()
    """What a reader should know before trusting it, such as a condition that was never trained."""
    facts: RecordingFacts = field(default_factory=RecordingFacts)
    """Machine, date, condition and file of the recording, as far as it states them."""
    fault_of: Mapping[str, str] = field(default_factory=dict)
    """Fault of the model that a class of another name stands for."""
    choice: Choice | None = None
    """How the classifier was chosen; None where its network was named."""
    deviation: Deviation | None = None
    """All levels' changes; of a detector with a verdict."""
    levels: tuple[Level, ...] = ()
    """What each level of `deviation` is."""
    spectrum: HealthySpectrum | None = None
    """Its levels over those of healthy recordings; None without a verdict, or where the model has no healthy one."""

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.recording_id}: {self.sentence()}>"

    @property
    def verdict(self) -> str:
        """The answer in a word: ``"no verdict"``, ``"unknown"``, or `label`."""
        return "no verdict" if self.label is None else "unknown" if self.unknown else self.label

    @property
    def is_near(self) -> bool:
        """Whether it resembles the training, and is unknown since a pump prior takes it for a fault not in it."""
        if not self.unknown or self.p_value is None or self.error_rate is None:
            return False
        return self.p_value > self.error_rate

    @property
    def alarm(self) -> bool | None:
        """Whether the recording is called abnormal, faulty or unknown; None without a verdict."""
        return None if self.label is None else self.unknown or not is_healthy(self.label)

    @property
    def n_windows(self) -> int:
        """Windows that the recording gave."""
        return len(self.window_labels)

    @property
    def agreement(self) -> float:
        """Share of the windows that say the same as `label`; 0 where there is no verdict."""
        return 0.0 if self.label is None else self.window_labels.count(self.label) / max(self.n_windows, 1)

    def sentence(self) -> str:
        """The verdict in words, with how sure it is."""
        if self.label is None:
            return f"no verdict: {self.no_verdict}"
        if self.kind == "detector":
            return self._detector_sentence()
        if self.unknown and (self.kind == "prior" or self.is_near):
            return f"Unknown: {self.reasons[0]}"
        if self.error_rate is None:
            ranked = sorted(self.probabilities.items(), key=lambda item: -item[1])
            return f"{self.label} ({', '.join(f'{name} {share:.3f}' for name, share in ranked)})."
        rate = f"{100 * self.error_rate:.3g} %"
        if self.unknown:
            differs = f"What differs most: {self.reasons[0]}" if self.reasons else (
                "Operating condition, levels, noise floors and lines are within the training's range, so the pattern "
                "itself is new, as that of a fault never trained would be."
            )  # fmt: skip
            return (
                f"Unknown: its vibration is further from every trained class than that of all but {rate} of "
                f"{self.basis}. {differs}"
            )
        if len(self.prediction_set) == 1:
            return f"{self.label}: no other class is plausible at an error rate of {rate}, by {self.basis}."
        names = ", ".join(name.replace("_", " ") for name in self.prediction_set)
        return (
            f"At an error rate of {rate}, by {self.basis}, it could be any of {names}: do not act on one of them alone."
        )

    def _detector_sentence(self) -> str:
        assert self.p_value is not None
        assert self.error_rate is not None
        less = " or less" if self.p_value <= (1 + 1e-9) / (self.n_basis + 1) else ""
        said = (
            f"{'alarm' if self.alarm else 'no alarm'} at a false-alarm rate of {100 * self.error_rate:.3g} % "
            f"(p = {self.p_value:.3g}{less}, {plural(self.n_basis, 'healthy recording')})."
        )
        moved = self.moved
        return f"{said} Moved: {moved}." if self.alarm and moved else said

    @property
    def moved(self) -> str:
        """What moved most, in words; of a detector."""
        return "; ".join((*self.shifts, *(change.sentence for change in self.changes[: 3 - len(self.shifts)])))

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold, the verdict first; without what only pages draw."""
        table = {name: value for name, value in vars(self).items() if name not in _FOR_PAGES}
        derived = {"alarm": self.alarm, "n_windows": self.n_windows, "agreement": self.agreement}
        return {"verdict": self.verdict, **to_table(table), **derived}
