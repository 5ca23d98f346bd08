"""Classification of whole recordings: by their band powers, and by changes from healthy ones."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float, Float64

from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.learning.recordings.recording_heads import Heads
from swashtwin.learning.recordings.recording_table import RecordingTable
from swashtwin.learning.windows.window_set import WindowSet

HEAD_NAMES = ("band powers", "changes")
"""Heads on whole recordings, in the order of the temperatures."""
VOTE_WEIGHTS = (1.0, 1.0, 2.0)
"""Weights of short windows and of `HEAD_NAMES`.

Changes, if they are known, have half of the weight of all: on rig fleets 100 to 102 of both
versions trees on changes were right in 0.93 of recordings of new pumps, and on band powers in 0.85.
"""

LogProbabilities = Float64[np.ndarray, "row class"]


@dataclass(frozen=True, eq=False)
class RecordingModel:
    """Heads on whole recordings, each with a temperature fitted on held-out machines.

    The probability of a recording is the mean over the heads, each tempered: a head that was too
    sure of unknown machines is flat and counts little. Heads on changes answer if the machine has
    healthy recordings.
    """

    layout: RecordingBandLayout
    default_shaft: float
    """Shaft frequency [Hz] for recordings without one; 0 if no orders are used."""
    on_band_powers: Heads
    on_changes: Heads | None
    """None unless every machine of the training had two healthy recordings."""
    healthy: RecordingTable
    """Healthy recordings of machines of the training, and of those added since."""
    temperatures: Float64[np.ndarray, " head"]
    """Temperature of the answers of short windows, then of `HEAD_NAMES`."""

    def __post_init__(self) -> None:
        if self.temperatures.shape != (1 + len(HEAD_NAMES),) or not (self.temperatures > 0).all():
            raise ValueError("whole recordings need a positive temperature for each head")

    def require_sizes(self, n_channels: int, n_classes: int) -> None:
        """Raise a `ValueError` if heads or healthy recordings misfit the channels or classes."""
        shape = (n_channels, self.layout.n_band_powers)
        for heads in (self.on_band_powers, self.on_changes):
            if heads is not None and not heads.fit_sizes(math.prod(shape), n_classes):
                raise ValueError("heads on whole recordings do not fit the channels and classes")
        if self.healthy.band_powers.shape[1:] != shape:
            raise ValueError("healthy recordings do not fit the channels and band powers")

    def knows(self, specimen: str) -> bool:
        """Return whether a machine has enough healthy recordings to compare with."""
        return self.on_changes is not None and specimen in self.healthy.machines()

    def with_healthy(self, windows: WindowSet) -> "RecordingModel":
        """Return the model with further healthy recordings, given by their windows."""
        return replace(self, healthy=self.healthy.joined(self.table(windows)))

    def table(self, windows: WindowSet) -> RecordingTable:
        """Return the band powers of the recordings that windows are of."""
        if self.layout.n_orders:
            default_speed = 2 * np.pi * self.default_shaft
            speed = np.where(np.isnan(windows.speed), default_speed, windows.speed)
            windows = replace(windows, speed=speed)
        return RecordingTable.measured(self.layout, windows)

    def combined(
        self, log_probability: Float[np.ndarray, "window class"], windows: WindowSet
    ) -> Float64[np.ndarray, "window class"]:
        """Return probabilities of windows from their own and from those of their recordings."""
        recording_index = np.unique(windows.recording_id, return_inverse=True)[1]
        votes: list[LogProbabilities | None] = [log_probability]
        for answer in self.answers(self.table(windows)):
            votes.append(None if answer is None else answer[recording_index])
        return combine_votes(votes, self.temperatures)

    def answers(self, table: RecordingTable) -> list[LogProbabilities | None]:
        """Return the logarithms of probabilities by each head, None without a head.

        Rows of machines without healthy recordings are NaN in the answer by changes.
        """
        n_recordings = len(table.band_powers)
        shapes = self.layout.shapes(table.band_powers).reshape(n_recordings, -1)
        by_band_powers = self.on_band_powers.log_probabilities(shapes)
        if self.on_changes is None:
            return [by_band_powers, None]

        # Machines with too few healthy recordings have no name, and so no change.
        specimen = tuple(name if self.knows(name) else "" for name in table.specimen)
        changes = self.healthy.changes(self.layout, replace(table, specimen=specimen))
        changes = changes.reshape(n_recordings, -1)
        is_known = np.isfinite(changes).all(axis=1)[:, None]
        by_changes = self.on_changes.log_probabilities(np.where(is_known, changes, 0))
        return [by_band_powers, np.where(is_known, by_changes, np.nan)]


def combine_votes(
    votes: Sequence[LogProbabilities | None], temperatures: Float[np.ndarray, " head"]
) -> Float64[np.ndarray, "row class"]:
    """Return the weighted mean of tempered probabilities (`VOTE_WEIGHTS`).

    A vote that is None or missing, and a row of NaN, do not count.

    Parameters
    ----------
    votes : logarithms of probabilities: by short windows, then by `HEAD_NAMES`.
    """
    shape = next(vote.shape for vote in votes if vote is not None)
    total = np.zeros(shape)
    total_weight = np.zeros((shape[0], 1))
    for index, (vote, temperature) in enumerate(zip(votes, temperatures, strict=False)):
        if vote is None:
            continue
        probability = scipy.special.softmax(vote / temperature, axis=1)
        # A NaN by short windows is no missing vote: the answer is then NaN, and no verdict.
        counts = np.isfinite(probability).all(axis=1, keepdims=True) | (index == 0)
        weight = np.where(counts, VOTE_WEIGHTS[index], 0.0)
        total = total + np.where(counts, probability, 0.0) * weight
        total_weight = total_weight + weight
    return np.asarray(total / total_weight)
