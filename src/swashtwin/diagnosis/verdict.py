"""`Diagnosis`: the answer of a model of any kind on one recording, and the checks to do next.

The reasons of checks are the physics of the parts (docs/explanation/physics.md), not a statistic:
none was measured together with our recordings. Oil is sampled from the running line (ISO 4021) and
counted as ISO 4406 codes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from swashtwin.diagnosis.changed_bands import BandPowerChange
from swashtwin.diagnosis.healthy_spectrum import HealthySpectrum
from swashtwin.foundation import data_frame, html_table, plural, shorten, to_table
from swashtwin.learning import CandidateChoice, Deviation
from swashtwin.pump import is_healthy, propose_class
from swashtwin.recordings import RecordingSummary
from swashtwin.signals import BandPower

# Fields that pages draw, and that `Diagnosis.to_dict` leaves out.
_PAGE_FIELDS = ("facts", "fault_of", "choice", "deviation", "band_powers", "spectrum")

MIN_CERTAIN_PROBABILITY = 0.8
"""Probability from which one class suffices: of a prior's answer, and of the only class in a
prediction set to overrule a prior; selected on fleets 100 and 101 of version 2 of the rig."""

# Changes in the sentence of an alarm.
_MAX_NAMED_CHANGES = 3


# Notes below a diagnosis in a notebook.
_MAX_SHOWN_NOTES = 3


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The answer of a classifier, a detector or a pump prior on one recording, with its certainty.

    The probabilities of a classifier without `error_rate` are scores between classes rather than
    calibrated chances, since the windows of one recording are not independent.
    """

    recording_id: str
    """Id of the recording."""
    kind: str = "classifier"
    """Kind of the model: ``"classifier"``, ``"detector"`` (`AnomalyDetector`) or ``"prior"``
    (`PriorClassifier`)."""
    unknown: bool = False
    """Whether the recording does not resemble the training, so that `label` does not hold."""
    label: str | None = None
    """Likeliest class of the whole recording, or ``"abnormal"`` or ``"normal"`` of a detector; None
    without a verdict."""
    no_verdict: str | None = None
    """Why there is no verdict: the recording cannot be used, or the answer is not finite."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Probability of each class, pooled over the windows and calibrated on validation recordings;
    of a prior calibrated on virtual pumps."""
    window_labels: tuple[str | None, ...] = ()
    """Likeliest class of each window, in order of time; None if its answer is not finite."""
    error_rate: float | None = None
    """Target miscoverage of `prediction_set`, and share of recordings that are wrongly called
    unknown or raise a false alarm; None if the confidence was not calibrated
    (`fit_best_candidate`, `learn_confidence`)."""
    prediction_set: tuple[str, ...] = ()
    """Classes that cannot be excluded at the error rate, likeliest first."""
    plausibility: Mapping[str, float] = field(default_factory=dict)
    """Conformal p-value of each class; adjusted if `basis` names virtual problems."""
    scarce_classes: tuple[str, ...] = ()
    """Classes whose p-values are computed from the recordings of all of them together, since some
    have too few for the error rate, or since machines were held out; that of another class is
    computed from its recordings alone."""
    p_value: float | None = None
    """Conformal p-value of resembling the recordings of `basis`, at least 1 / (n + 1); up to the
    error rate the recording is unknown, or an alarm."""
    score: float | None = None
    """Distance from these recordings: `TrainingReference.ood_score`, or the squared distance of a
    detector."""
    threshold: float | None = None
    """Score above which a classifier calls a recording unknown."""
    basis: str = ""
    """Description of the recordings that it is compared with."""
    n_basis: int = 0
    """Number of these recordings."""
    reasons: tuple[str, ...] = ()
    """Sentences on what lies outside the training's range; `notes` holds them too."""
    separation: str = ""
    """Which further measurement would separate the faults of `candidates`; of a prior. `notes`
    holds it too."""
    shifts: tuple[str, ...] = ()
    """Sentences on channels whose band powers all changed alike; of a detector."""
    changes: tuple[BandPowerChange, ...] = ()
    """Band powers that changed, largest change first, also without an alarm; of a detector."""
    notes: tuple[str, ...] = ()
    """What a reader should know before trusting it, such as a condition that was not trained."""
    facts: RecordingSummary = field(default_factory=RecordingSummary)
    """Machine, date, condition and file of the recording, if it specifies them."""
    fault_of: Mapping[str, str] = field(default_factory=dict)
    """Fault of the model that a class of another name stands for."""
    choice: CandidateChoice | None = None
    """How the classifier was selected; None if its network was named."""
    deviation: Deviation | None = None
    """Changes of all band powers; of a detector with a verdict."""
    band_powers: tuple[BandPower, ...] = ()
    """Description of each band power of `deviation`."""
    spectrum: HealthySpectrum | None = None
    """Its spectrum over those of healthy recordings; None without a verdict, or if the model has no
    healthy recording."""

    def __repr__(self) -> str:
        return shorten(f"<Diagnosis of {self.recording_id}: {self.sentence()}>")

    def _repr_html_(self) -> str:
        rows = []
        # of an unknown recording the probabilities would contradict the verdict
        if self.label is not None and not self.unknown:
            for name, probability in sorted(self.probabilities.items(), key=lambda item: -item[1]):
                rows.append((name, f"{100 * probability:.1f} %"))
        # without an error rate, the sentence on a single class only lists the same probabilities
        is_repeated = bool(rows) and self.error_rate is None and len(self.candidates) < 2
        sentence = "" if is_repeated else self.sentence()
        title = f"{self.recording_id}: {self.verdict}"
        notes = (sentence, *self.notes[:_MAX_SHOWN_NOTES])
        return html_table(title, ("class", "probability"), rows, *notes)

    @property
    def verdict(self) -> str:
        """The answer in a word: ``"no verdict"``, ``"unknown"``, or `label`."""
        if self.label is None:
            return "no verdict"
        return "unknown" if self.unknown else self.label

    @property
    def is_prior_unknown(self) -> bool:
        """Whether it resembles the training, but a pump prior recognizes a fault not trained."""
        if not self.unknown or self.p_value is None or self.error_rate is None:
            return False
        return self.p_value > self.error_rate

    @property
    def alarm(self) -> bool | None:
        """Whether the recording is called abnormal, faulty or unknown; None without a verdict."""
        if self.label is None:
            return None
        return self.unknown or not is_healthy(self.label)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Classes between which the verdict leaves the choice, likeliest first; one if it is
        certain.

        They are the prediction set, or of a prior the likeliest classes that together have a
        probability of `MIN_CERTAIN_PROBABILITY`; else `label`.
        """
        if self.prediction_set:
            return self.prediction_set
        if self.label is None or self.kind != "prior":
            return () if self.label is None else (self.label,)

        others = [name for name in self.probabilities if name != self.label]
        others.sort(key=self.probabilities.__getitem__, reverse=True)
        candidates = [self.label]
        total = self.probabilities[self.label]
        while total < MIN_CERTAIN_PROBABILITY and others:
            candidates.append(others.pop(0))
            total += self.probabilities[candidates[-1]]
        return tuple(candidates)

    @property
    def n_windows(self) -> int:
        """Number of windows of the recording."""
        return len(self.window_labels)

    @property
    def agreement(self) -> float:
        """Share of the windows whose likeliest class is `label`; 0 without a verdict."""
        if self.label is None:
            return 0.0
        return self.window_labels.count(self.label) / max(self.n_windows, 1)

    def sentence(self) -> str:
        """Return the verdict and its certainty as a sentence."""
        if self.label is None:
            return f"no verdict: {self.no_verdict}"
        if self.kind == "detector":
            return self._alarm_sentence()
        if self.unknown:
            return f"Unknown: {self._unknown_reason()}"

        if self.error_rate is None:
            ranked = sorted(self.probabilities.items(), key=lambda entry: -entry[1])
            probabilities = ", ".join(f"{name} {value:.3f}" for name, value in ranked)
            if len(self.candidates) > 1:
                names = " or ".join(name.replace("_", " ") for name in self.candidates)
                return f"Not certain: {names} ({probabilities})."
            return f"{self.label} ({probabilities})."

        rate = f"{100 * self.error_rate:.3g} %"
        if len(self.prediction_set) == 1:
            text = self.label.replace("_", " ")
            name = text[:1].upper() + text[1:]
            return (
                f"{name}: all other classes are excluded at an error rate of {rate} ({self.basis})."
            )
        names = ", ".join(name.replace("_", " ") for name in self.prediction_set)
        return (
            f"Prediction set at an error rate of {rate} ({self.basis}): {names}. Do not act on one "
            "of these classes alone."
        )

    def _alarm_sentence(self) -> str:
        assert self.p_value is not None
        assert self.error_rate is not None

        # The smallest p-value of n recordings is an upper bound.
        is_smallest = self.p_value <= (1 + 1e-9) / (self.n_basis + 1)
        p_value = f"p = {self.p_value:.3g}{' or less' if is_smallest else ''}"
        sentence = (
            f"{'alarm' if self.alarm else 'no alarm'} at a false-alarm rate of "
            f"{100 * self.error_rate:.3g} % ({p_value}, "
            f"{plural(self.n_basis, 'healthy recording')})."
        )
        if self.alarm and self.largest_changes:
            sentence += f" Largest changes: {self.largest_changes}."
        return sentence

    def _unknown_reason(self) -> str:
        if self.kind == "prior" or self.is_prior_unknown:
            return self.reasons[0]

        assert self.error_rate is not None
        distance = (
            f"the recording differs from every trained class more than "
            f"{100 * (1 - self.error_rate):.3g} % of the training recordings do "
            f"(n = {self.n_basis})."
        )
        if self.reasons:
            return f"{distance} {self.reasons[0]}"
        return (
            f"{distance} Operating point, levels, noise floors and lines are within the training's "
            "range, so the pattern itself is new, as for a fault that was not trained."
        )

    @property
    def largest_changes(self) -> str:
        """Description of the largest changes; of a detector."""
        n_changes = _MAX_NAMED_CHANGES - len(self.shifts)
        changes = [change.sentence for change in self.changes[:n_changes]]
        return "; ".join([*self.shifts, *changes])

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame`` of one row, with the keys of `to_dict`.

        ``pandas.concat`` joins those of several recordings.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        return data_frame([self.to_dict()])

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold, the verdict first, without what only pages draw."""
        table = {name: value for name, value in vars(self).items() if name not in _PAGE_FIELDS}
        return {
            "verdict": self.verdict,
            "candidates": list(self.candidates),
            **to_table(table),
            "alarm": self.alarm,
            "n_windows": self.n_windows,
            "agreement": self.agreement,
        }


@dataclass(frozen=True)
class Check:
    """One check to do on the machine."""

    what: str
    """What to do."""
    why: str
    """What it would show, and by which physics."""


_DRAIN = (
    "Measure the case drain flow at rated pressure and known oil temperature, and compare it with "
    "this pump's earlier value."
)
_OIL = "Take an oil sample from the running line: particle count, and which metals."
_FIRST_CHECK = Check(
    "Check pressure, speed, oil level, suction pressure, air in the oil, and the sensor's "
    "mounting.",
    "A starved or aerated pump and a loose sensor change vibration more than early wear does; rule "
    "them out first.",
)
_TREND_CHECKS = (
    Check(
        "Look at the trend of levels and orders against this machine's healthy recordings "
        "(swashtwin signal trend).",
        "A learned class is a comparison with other pumps; a change of this pump at one operating "
        "point is not.",
    ),
)

CHECKS = MappingProxyType(
    {
        "normal": _TREND_CHECKS,
        "swash_plate": (
            Check(
                _OIL,
                "A worn or pitted swash plate and its slippers shed steel and bronze or brass.",
            ),
            Check(
                _DRAIN,
                "Slippers that ride over a recess lose their film: leakage through the slipper "
                "pockets drains into the case, in bursts once per piston and turn.",
            ),
            Check(
                "Look at the swash plate face and the slipper soles at the next opening.",
                "The recess itself is visible there.",
            ),
        ),
        "cylinder_block": (
            Check(
                _DRAIN,
                "A bore or block face that lost its shape widens the gap; leakage grows with the "
                "cube of the gap (laminar slot).",
            ),
            Check(
                "Compare the case drain temperature with the tank's.",
                "Throttled oil carries the lost power as heat: some 0.05 K for each 0.1 MPa that "
                "leaks through.",
            ),
            Check(
                "Look at the spline, the shaft bearing and the block's running face at the next "
                "opening.",
                "A block that tilts wears its face on one side, and vibrates once per turn.",
            ),
        ),
        "piston": (
            Check(
                _DRAIN,
                "Leakage grows with the cube of the radial clearance; one worn piston drains more "
                "than the others, once per turn.",
            ),
            Check(
                "Measure the pressure ripple at the outlet, by order.",
                "One piston that delivers less leaves lines at all multiples of the shaft, not "
                "only at the piston-pass line.",
            ),
            Check(
                _OIL,
                "Wear of pistons and bores sheds steel and bronze, and dirt in the gap caused it.",
            ),
        ),
        "valve_plate": (
            Check(
                "Measure the pressure ripple at the outlet, at the piston-pass line and its "
                "multiples.",
                "A scratched dam or an eroded groove changes how the pressure in each chamber "
                "rises at the dead centers, for every piston alike.",
            ),
            Check(
                _DRAIN + " Measure the delivered flow too.",
                "Leakage over the dam goes from discharge to suction: flow falls while the drain "
                "hardly grows.",
            ),
            Check(
                "Check suction pressure and air in the oil.",
                "Cavitation erodes grooves and will do so again.",
            ),
            Check(
                "Look at the valve plate and the block face at the next opening.",
                "Scratches and erosion are visible there.",
            ),
        ),
        "loose_slipper": (
            Check(
                "Stop the pump and look soon.",
                "A slipper that comes off its ball breaks the pump within turns.",
            ),
            Check(_OIL, "A loosened crimp sheds bronze or brass."),
            Check(
                "Measure the play of the slippers on their balls at the next opening.",
                "The axial play is what the class means.",
            ),
        ),
    }
)
"""Checks by class, the cheapest first."""


def next_checks(*labels: str, unknown: bool = False) -> tuple[Check, ...]:
    """Return what to check if one of `labels` was diagnosed.

    For a recording called unknown, the checks hold for any fault.
    """
    if unknown:
        return (
            _FIRST_CHECK,
            *_TREND_CHECKS,
            Check(_OIL, "Whatever wears sheds particles."),
            Check(_DRAIN, "Most wear leaks."),
        )

    checks: list[Check] = []
    for label in labels:
        fault = label if label in CHECKS else propose_class(label) or ""
        checks += CHECKS.get(fault, _TREND_CHECKS)

    if labels and all(map(is_healthy, labels)):
        return tuple(checks)
    return (_FIRST_CHECK, *checks)
