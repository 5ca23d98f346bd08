"""The candidates that training chooses from, in one list."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swashtwin.learning.training.settings import TrainingSettings

CLEAN_TRAINING = TrainingSettings(epochs=1, normalization="set")
"""Training on the windows as they are."""

DISTURBED_TRAINING = TrainingSettings(
    epochs=4,
    normalization="set",
    noise_snr=-2.5,
    noise_kinds=("white", "pink", "hum"),
    noise_share=1.0,
    gain=12.0,
    stretch=0.02,
)
"""Training on the windows as they are and four times changed: noise to -2.5 dB on every window, gains to 12 dB a
channel and speeds to 2 % on half of them each."""


@dataclass(frozen=True)
class Candidate:
    """A way to train a `LevelNetwork`."""

    axis: str
    """``"order"`` or ``"frequency"``: along what narrow lines are counted."""
    shape: bool
    """Whether each channel's own level is subtracted, so that no gain changes anything."""
    heads: tuple[str, ...]
    """What decides on the levels; of several the average."""
    training: TrainingSettings
    """Clean or disturbed training windows."""

    @property
    def name(self) -> str:
        """What it is called in a table.

        Examples
        --------
        >>> CANDIDATES[0].name
        'shapes at orders, disturbed training, average'
        """
        kind = f"{'shapes' if self.shape else 'levels'} {'at orders' if self.axis == 'order' else 'in hertz'}"
        head = (
            "average"
            if len(self.heads) > 1
            else {"discriminant": "discriminant", "hidden": "hidden layer"}[self.heads[0]]
        )
        return f"{kind}, {'disturbed' if self.training != CLEAN_TRAINING else 'clean'} training, {head}"

    @property
    def rank(self) -> tuple[bool, ...]:
        """Order among candidates that two or three machines cannot tell apart, from the best.

        Learned once on rig fleets 100 to 103 of versions 1 and 2, from two pumps to new ones by recording: averages
        before single heads, levels before shapes, disturbed before clean training, orders before hertz. The first had
        0.98 and 0.80, the first of the declared order 0.96 and 0.73.
        """
        return len(self.heads) == 1, self.shape, self.training == CLEAN_TRAINING, self.axis != "order"

    @property
    def representation(self) -> tuple[str, bool, TrainingSettings]:
        """What candidates of the same invariance share: all but the heads."""
        return self.axis, self.shape, self.training

    def network_settings(self, turns: float) -> Mapping[str, Any]:
        """Settings of its `LevelNetwork`, for a shaft that turns so far per sample."""
        return {"axis": self.axis, "shape": self.shape, "heads": self.heads, "turns": turns}


CANDIDATES: tuple[Candidate, ...] = tuple(
    Candidate(axis, shape, heads, training)
    for shape in (True, False)
    for axis in ("order", "frequency")
    for training in (DISTURBED_TRAINING, CLEAN_TRAINING)
    for heads in (("discriminant", "hidden"), ("discriminant",), ("hidden",))
)
"""From the most invariant to the least: shapes before levels, orders before hertz, disturbed before clean training."""
