"""The candidates that training chooses from, how each fared, and what was chosen."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from swashtwin.foundation import plural
from swashtwin.learning.networks.band_power_network import BandPowerNetwork
from swashtwin.learning.training.settings import TrainingSettings
from swashtwin.learning.windows.window_set import WindowSet

DISTURBED_TRAINING = TrainingSettings(
    epochs=4,
    normalization="set",
    noise_snr=-2.5,
    noise_kinds=("white", "pink", "hum"),
    noise_share=1.0,
    gain=12.0,
    stretch=0.02,
)
"""Training on the windows as they are and four times changed: noise to -2.5 dB on every window,
gains to 12 dB a channel and speeds to 2 % on half of them each.
"""


@dataclass(frozen=True)
class Candidate:
    """A `BandPowerNetwork` with lines in hertz and both heads, trained as in `DISTURBED_TRAINING`."""

    shape: bool
    """Whether each channel's own level is subtracted, so that no gain changes anything."""

    @property
    def name(self) -> str:
        """What it is called in a table: ``band_shapes`` or ``band_powers``."""
        return "band_shapes" if self.shape else "band_powers"

    def network(self, windows: WindowSet) -> BandPowerNetwork:
        """Its untrained network for windows."""
        return BandPowerNetwork(windows.n_channels, len(windows.classes), shape=self.shape)


CANDIDATES = (Candidate(shape=True), Candidate(shape=False))
"""What training chooses from, the more invariant first.

Of 24 kinds tried (lines at orders or in hertz, trained clean or disturbed, by each head or both) a
trial with two pumps to train on, or with four bearings, chose by chance: on rig fleets 100 and 101
of version 2 what it chose named 0.67 and 0.64 of the recordings of new pumps right, these two 0.66
to 0.67 and 0.82 to 0.83.
"""


@dataclass(frozen=True)
class Trial:
    """How one candidate fared on recordings that its training did not see."""

    candidate: str
    score: float
    """Mean over the groups of the mean of `clean` and `disturbed`."""
    standard_error: float
    """Standard error of `score`, between the groups; 0 with one group."""
    clean: float
    """Mean over the classes of the share of recordings told right, as they were measured."""
    disturbed: float
    """The same under noise at 5 dB, and under other gains and speeds, on average."""
    is_tied: bool
    """Whether its score is within one standard error of the best one."""


@dataclass(frozen=True)
class Choice:
    """The trials of all candidates, and the one chosen."""

    candidate: str
    """Name of the candidate chosen, of those tied with the best; see `choose_candidate`."""
    trials: tuple[Trial, ...]
    """Every candidate tried, in the declared order; none where the recordings are too few for a
    trial.
    """
    group: str
    """What inner folds kept whole: ``"specimen"``, ``"condition"`` or ``"recording"``; empty
    without a trial.
    """
    n_folds: int
    n_windows: int
    """Measured windows that were tested on."""
    reason: str
    """Why there was no trial; empty where there was one."""
    n_machines: int = 0
    """Machines that it rests on; 0 where folds did not leave machines out."""
    head_recalls: Mapping[str, float] = field(default_factory=dict)
    """Mean recall, by recording, of each head on whole recordings, and of all heads together
    ``"without baseline"`` of the machine and ``"with baseline"``; empty
    where recordings are too short.
    """

    def sentence(self) -> str:
        """The choice in words."""
        if not self.trials:
            return f"Chosen without a trial: {self.candidate} ({self.reason})."
        trial = next(trial for trial in self.trials if trial.candidate == self.candidate)
        tied = sum(trial.is_tied for trial in self.trials)
        others = f"; one of {tied} that are as good within one standard error" if tied > 1 else ""
        text = (
            f"Chosen: {self.candidate}, {100 * trial.clean:.0f} % of the recordings of unseen {self.group}s right, "
            f"{100 * trial.disturbed:.0f} % under noise, gain and speed{others}."
        )
        if self.head_recalls:
            unaided, aided = (
                self.head_recalls.get(f"{kind} baseline") for kind in ("without", "with")
            )
            text += f" With heads on whole recordings {100 * (unaided or 0):.0f} %"
            text += (
                "."
                if aided is None
                else f", and {100 * aided:.0f} % with healthy recordings of the same machine."
            )
        if self.n_machines:
            text += f" This rests on {plural(self.n_machines, 'machine')}."
        return text

    def to_dict(self) -> dict[str, Any]:
        """The same as JSON can hold it."""
        return {**asdict(self), "trials": [asdict(trial) for trial in self.trials]}
