"""`Diagnosis`: what a model of any kind says of one recording, and what to check on the machine
before acting on it.

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
from swashtwin.foundation import plural, to_table
from swashtwin.learning import Choice, Deviation
from swashtwin.pump import is_healthy, propose_class
from swashtwin.recordings import RecordingSummary
from swashtwin.signals import BandPower

_FOR_PAGES = ("facts", "fault_of", "choice", "deviation", "band_powers", "spectrum")
"""Fields that pages draw, and that `Diagnosis.to_dict` leaves out."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The answer of a classifier, a detector or a pump prior on one recording, and how sure it
    is.
    """

    recording_id: str
    """The recording."""
    kind: str = "classifier"
    """What answers: ``"classifier"``, ``"detector"`` (`AnomalyDetector`) or ``"prior"``
    (`PriorClassifier`).
    """
    unknown: bool = False
    """Whether the recording does not resemble the training, so that no class is named; `label` says
    nothing then.
    """
    label: str | None = None
    """Likeliest class of the whole recording, or ``"abnormal"`` or ``"normal"`` of a detector; None
    without verdict.
    """
    no_verdict: str | None = None
    """Why there is no verdict: the recording cannot be used, or a number of the answer is not
    finite.
    """
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Probability of each class, pooled over the windows with the temperature and the dependence
    that validation recordings gave. Without `error_rate` it is a score between classes rather than
    a calibrated chance: the windows of one recording are not independent, and count as a single
    one. Of a prior it is calibrated on virtual pumps.
    """
    window_labels: tuple[str | None, ...] = ()
    """Likeliest class of each window, in order of time; None where a number of it is not finite."""
    error_rate: float | None = None
    """Share of recordings whose `prediction_set` may miss the true class, and of those wrongly
    called unknown or raising a false alarm; None where the confidence was not calibrated
    (`fit_best_candidate`, `learn_confidence`).
    """
    prediction_set: tuple[str, ...] = ()
    """Classes that cannot be ruled out at the error rate, likeliest first."""
    plausibility: Mapping[str, float] = field(default_factory=dict)
    """Conformal p-value of each class."""
    scarce_classes: tuple[str, ...] = ()
    """Classes whose p-value is taken among the recordings of all of them together, since some have
    too few for the error rate; that of each other class is taken among its recordings alone.
    """
    p_value: float | None = None
    """Conformal p-value of resembling the recordings of `basis`, 1 / (n + 1) at least; the
    recording is unknown, or an alarm, where it is at most the error rate.
    """
    score: float | None = None
    """How unlike these it is: `TrainingReference.ood_score`, or the squared distance of a
    detector.
    """
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
    changes: tuple[BandPowerChange, ...] = ()
    """Levels that moved, furthest first, also without an alarm; of a detector."""
    notes: tuple[str, ...] = ()
    """What a reader should know before trusting it, such as a condition that was never trained."""
    facts: RecordingSummary = field(default_factory=RecordingSummary)
    """Machine, date, condition and file of the recording, as far as it states them."""
    fault_of: Mapping[str, str] = field(default_factory=dict)
    """Fault of the model that a class of another name stands for."""
    choice: Choice | None = None
    """How the classifier was chosen; None where its network was named."""
    deviation: Deviation | None = None
    """All levels' changes; of a detector with a verdict."""
    band_powers: tuple[BandPower, ...] = ()
    """What each level of `deviation` is."""
    spectrum: HealthySpectrum | None = None
    """Its levels over those of healthy recordings; None without a verdict, or where the model has
    no healthy one.
    """

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.recording_id}: {self.sentence()}>"

    @property
    def verdict(self) -> str:
        """The answer in a word: ``"no verdict"``, ``"unknown"``, or `label`."""
        return "no verdict" if self.label is None else "unknown" if self.unknown else self.label

    @property
    def is_near(self) -> bool:
        """Whether it resembles the training, and is unknown since a pump prior takes it for a fault
        not in it.
        """
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
        return (
            0.0
            if self.label is None
            else self.window_labels.count(self.label) / max(self.n_windows, 1)
        )

    def sentence(self) -> str:
        """The verdict in words, with how sure it is."""
        if self.label is None:
            return f"no verdict: {self.no_verdict}"
        if self.kind == "detector":
            assert self.p_value is not None
            assert self.error_rate is not None
            less = " or less" if self.p_value <= (1 + 1e-9) / (self.n_basis + 1) else ""
            return (
                f"{'alarm' if self.alarm else 'no alarm'} at a false-alarm rate of {100 * self.error_rate:.3g} % "
                f"(p = {self.p_value:.3g}{less}, {plural(self.n_basis, 'healthy recording')})."
            ) + (f" Moved: {self.moved}." if self.alarm and self.moved else "")
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
        return f"At an error rate of {rate}, by {self.basis}, it could be any of {names}: do not act on one of them alone."

    @property
    def moved(self) -> str:
        """What moved most, in words; of a detector."""
        return "; ".join(
            (*self.shifts, *(change.sentence for change in self.changes[: 3 - len(self.shifts)]))
        )

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold, the verdict first; without what only pages
        draw.
        """
        table = {name: value for name, value in vars(self).items() if name not in _FOR_PAGES}
        derived = {"alarm": self.alarm, "n_windows": self.n_windows, "agreement": self.agreement}
        return {"verdict": self.verdict, **to_table(table), **derived}


@dataclass(frozen=True)
class Check:
    """One thing to look at."""

    what: str
    """What to do."""
    why: str
    """What it would show, and by which physics."""


_DRAIN = (
    "Measure the case drain flow at rated pressure and known oil temperature, and compare it with this pump's earlier "
    "value."
)
_OIL = "Take an oil sample from the running line: particle count, and which metals."
_BEFORE = Check(
    "Check pressure, speed, oil level, suction pressure, air in the oil, and the sensor's mounting.",
    "A starved or aerated pump and a loose sensor change vibration more than early wear does; rule them out first.",
)
_PLAUSIBLE = (
    Check(
        "Look at the trend of levels and orders against this machine's healthy recordings (swashtwin signal trend).",
        "A learned class is a comparison with other pumps; a change of this pump at one operating point is not.",
    ),
)

CHECKS = MappingProxyType(
    {
        "normal": _PLAUSIBLE,
        "swash_plate": (
            Check(
                _OIL,
                "A worn or pitted swash plate and its slippers shed steel and bronze or brass.",
            ),
            Check(
                _DRAIN,
                "Slippers that ride over a recess lose their film: leakage through the slipper pockets drains into the "
                "case, in bursts once per piston and turn.",
            ),
            Check(
                "Look at the swash plate face and the slipper soles at the next opening.",
                "The recess itself is to be seen there.",
            ),
        ),
        "cylinder_block": (
            Check(
                _DRAIN,
                "A bore or block face that lost its shape widens the gap by its cube in the leakage (laminar slot).",
            ),
            Check(
                "Compare the case drain temperature with the tank's.",
                "Throttled oil carries the lost power as heat: some 0.05 K for each 0.1 MPa that leaks through.",
            ),
            Check(
                "Look at the spline, the shaft bearing and the block's running face at the next opening.",
                "A block that tilts wears its face on one side, and vibrates once per turn.",
            ),
        ),
        "piston": (
            Check(
                _DRAIN,
                "Radial clearance leaks with its cube; one worn piston of seven drains more, once per turn.",
            ),
            Check(
                "Measure the pressure ripple at the outlet, by order.",
                "One piston that delivers less leaves lines at all multiples of the shaft, not only at the piston-pass "
                "line.",
            ),
            Check(
                _OIL,
                "Wear of pistons and bores sheds steel and bronze, and dirt in the gap caused it.",
            ),
        ),
        "valve_plate": (
            Check(
                "Measure the pressure ripple at the outlet, at the piston-pass line and its multiples.",
                "A scratched dam or an eroded groove changes how the pressure in each chamber rises at the dead "
                "centers, for every piston alike.",
            ),
            Check(
                _DRAIN + " Measure the delivered flow too.",
                "Leakage over the dam goes from discharge to suction: flow falls while the drain hardly grows.",
            ),
            Check(
                "Check suction pressure and air in the oil.",
                "Cavitation erodes grooves and will do so again.",
            ),
            Check(
                "Look at the valve plate and the block face at the next opening.",
                "Scratches and erosion are to be seen there.",
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
    """What to check where one of `labels` was diagnosed; of a recording called unknown, what holds
    for any fault.
    """
    if unknown:
        return (
            _BEFORE,
            *_PLAUSIBLE,
            Check(_OIL, "Whatever wears sheds particles."),
            Check(_DRAIN, "Most wear leaks."),
        )
    checks = tuple(
        check
        for label in labels
        for check in CHECKS.get(label, CHECKS.get(propose_class(label) or "", _PLAUSIBLE))
    )
    return checks if labels and all(map(is_healthy, labels)) else (_BEFORE, *checks)
