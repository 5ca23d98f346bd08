"""What whole recordings say of their class: heads on levels, and on changes from the machine's own healthy ones."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning.recordings.heads import Heads
from swashtwin.learning.recordings.recording_levels import RecordingLevels
from swashtwin.learning.recordings.recording_table import RecordingTable
from swashtwin.learning.windows.window_set import WindowSet

HEAD_NAMES = ("levels, discriminant", "levels, trees", "changes, discriminant", "changes, trees")
"""What says the class of a whole recording, in the order of the temperatures."""


@dataclass(frozen=True, eq=False)
class RecordingModel:
    """Heads on whole recordings, each with the temperature that its answers to left-out machines ask for.

    The probability of a recording is the mean over the heads, each tempered: a head that was too sure of machines that
    it had not heard is flat and counts little. Heads on changes answer where the machine has healthy recordings.
    """

    layout: RecordingLevels
    usual_shaft: float
    """Shaft frequency [Hz] taken where a recording states none; 0 where levels know no orders."""
    on_levels: Heads
    on_changes: Heads | None
    """None where not every machine of the training had two healthy recordings."""
    healthy: RecordingTable
    """Healthy recordings of machines of the training, and of those met since."""
    temperatures: Float64[np.ndarray, " head"]
    """Of the answers of short windows, then of `HEAD_NAMES`."""

    def __post_init__(self) -> None:
        if self.temperatures.shape != (1 + len(HEAD_NAMES),) or not (self.temperatures > 0).all():
            raise ValueError("whole recordings need a positive temperature for each head")

    def require_sizes(self, n_channels: int, n_classes: int) -> None:
        """Raise a `ValueError` where heads or healthy recordings are of other channels, levels or classes."""
        shape = (n_channels, self.layout.n_levels)
        for heads in filter(None, (self.on_levels, self.on_changes)):
            sizes = [
                (head.weight.shape, count)
                for head, count in zip((heads.clean, heads.noisy, heads.gate), (n_classes, n_classes, 2), strict=True)
            ]
            if any(size != (count, math.prod(shape)) for size, count in sizes):
                raise ValueError("heads on whole recordings do not fit the channels and classes")
        if self.healthy.levels.shape[1:] != shape:
            raise ValueError("healthy recordings do not fit the channels and levels")

    def knows(self, specimen: str) -> bool:
        """Whether a machine has healthy recordings enough to compare with."""
        return self.on_changes is not None and specimen in self.healthy.machines()

    def with_healthy(self, healthy: RecordingTable) -> "RecordingModel":
        """The model that knows further healthy recordings."""
        return replace(self, healthy=self.healthy.joined(healthy))

    def table(self, windows: WindowSet) -> RecordingTable:
        """Levels of the recordings that windows are of."""
        if self.layout.n_orders:
            speed = np.where(np.isnan(windows.speed), 2 * np.pi * self.usual_shaft, windows.speed)
            windows = replace(windows, speed=speed)
        return RecordingTable.measured(self.layout, windows)

    def combined(
        self, log_probability: Float[np.ndarray, "window class"], windows: WindowSet
    ) -> Float64[np.ndarray, "window class"]:
        """Probabilities of windows from what they say themselves and what their whole recordings say.

        Parameters
        ----------
        log_probability : logarithm of each class's probability by the short windows alone.
        """
        table = self.table(windows)
        answers = self.answers(table)
        of_window = np.unique(windows.recording_id, return_inverse=True)[1]
        return joint([log_probability, *(None if part is None else part[of_window] for part in answers)],
                     self.temperatures)  # fmt: skip

    def answers(self, table: RecordingTable) -> list[Float64[np.ndarray, "recording class"] | None]:
        """Logarithms of probabilities by each head; NaN rows where a machine has no healthy recordings of its own."""
        levels = self.layout.shapes(table.levels)
        answers: list[np.ndarray | None] = [*self.on_levels.log_probabilities(levels.reshape(len(levels), -1))]
        if self.on_changes is None:
            return [*answers, None, None]
        named = tuple(name if self.knows(name) else "" for name in table.specimen)
        flat = self.healthy.changes(self.layout, replace(table, specimen=named)).reshape(len(levels), -1)
        known = np.isfinite(flat).all(axis=1)
        on_changes = self.on_changes.log_probabilities(np.where(known[:, None], flat, 0))
        return [*answers, *(np.where(known[:, None], part, np.nan) for part in on_changes)]


def joint(
    logarithms: Sequence[Float[np.ndarray, "row class"] | None], temperatures: Float[np.ndarray, " head"]
) -> Float64[np.ndarray, "row class"]:
    """Mean over heads of their tempered probabilities; one that is None or left out, or whose row is NaN, has no say.

    Changes, where they are known, have half of the weight of all: on rig fleets 100 to 102 of both versions trees on
    changes were right in 0.93 of recordings of new pumps, and levels in 0.85.
    """
    rows, classes = next(part.shape for part in logarithms if part is not None)
    total, weight = np.zeros((rows, classes)), np.zeros((rows, 1))
    for index, (part, temperature) in enumerate(zip(logarithms, temperatures, strict=False)):
        if part is None:
            continue
        scaled = part / temperature
        scaled = np.exp(scaled - scaled.max(axis=1, keepdims=True))
        share = scaled / scaled.sum(axis=1, keepdims=True)
        has_say = np.isfinite(share).all(axis=1, keepdims=True) | (index == 0)
        counts = np.where(has_say, _WEIGHTS[index], 0.0)
        total = total + np.where(has_say, share, 0.0) * counts
        weight = weight + counts
    return np.asarray(total / weight)


_WEIGHTS = (1.0, 1.0, 1.0, 1.0, 2.0)
"""Weights of the heads: trees on changes count twice."""
