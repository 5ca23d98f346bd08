"""`fit_recordings`: heads on whole recordings, and how far each is to be believed of a machine not
heard.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float, Float64, Int64

from swashtwin.foundation import derive_seed, random_stream
from swashtwin.learning.choice.candidate_trials import OutOfFoldPredictions, is_made_without
from swashtwin.learning.recordings.recording_features import (
    RecordingBandLayout,
    RecordingTable,
    measure_recordings,
    recording_rows,
    shortest_stretch,
)
from swashtwin.learning.recordings.recording_model import (
    HEAD_NAMES,
    Heads,
    RecordingModel,
    fit_heads,
    joint,
)
from swashtwin.learning.training.confidence import fit_pooling
from swashtwin.learning.training.settings import with_noise
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import is_healthy
from swashtwin.signals import NoiseKind

LEAST_SAMPLES = 4096
"""Samples of the shortest recording from which whole recordings are listened to."""
_LEAST_SNR = -2.5
_KINDS: tuple[NoiseKind, ...] = ("white", "pink", "hum")
"""Noise of the copy that heads are trained on beside each recording."""


@dataclass(frozen=True, eq=False)
class RecordingTrial:
    """What heads on whole recordings said of recordings that they were not trained on."""

    logarithms: tuple[Float64[np.ndarray, "recording class"] | None, ...]
    """By short windows, pooled, and by each of `HEAD_NAMES`; None where there is no such head."""
    target: Int64[np.ndarray, " recording"]
    temperatures: Float64[np.ndarray, " head"]

    def recalls(self, with_own: bool) -> dict[str, float]:
        """Mean recall, by recording, of each head on whole recordings, and of all together."""
        by_head = zip(HEAD_NAMES, self.logarithms[1:], strict=True)
        recalls = {name: self._recall(part) for name, part in by_head if part is not None}
        recalls["without baseline"] = self._recall(joint(self.logarithms[:3], self.temperatures))
        if with_own:
            recalls["with baseline"] = self._recall(joint(self.logarithms, self.temperatures))
        return recalls

    def answers(self, windows: OutOfFoldPredictions, *, own: bool) -> OutOfFoldPredictions:
        """Joint answers of windows, from those by the short windows alone, with or without the
        heads on changes.
        """
        index = np.unique(windows.recording_id, return_inverse=True)[1]
        heads = [
            None if part is None else part[index] for part in self.logarithms[1 : 5 if own else 3]
        ]
        return replace(
            windows, probability=joint([_logarithm(windows.probability), *heads], self.temperatures)
        )

    def _recall(self, answer: Float[np.ndarray, "recording class"]) -> float:
        right = answer.argmax(axis=1) == self.target
        return float(
            np.mean([right[self.target == index].mean() for index in np.unique(self.target)])
        )


def _logarithm(probability: Float[np.ndarray, "row class"]) -> Float64[np.ndarray, "row class"]:
    return np.asarray(np.log(np.maximum(probability, 1e-12)))


class _Tables:
    """Levels of all training recordings as they are and with noise, and their changes, each
    computed once.
    """

    def __init__(self, windows: WindowSet, layout: RecordingBandLayout, seed: int) -> None:
        rows = recording_rows(windows)
        first = np.array([int(members[0]) for members in rows])
        self.table = RecordingTable.measured(layout, windows)
        self.target, self.synthetic = windows.target[first], windows.synthetic[first]
        rng = random_stream(seed, "noise on recordings")
        rate = windows.sample_rate
        noisy = measure_recordings(
            layout,
            windows,
            rows,
            lambda stretch: with_noise(stretch[None], _LEAST_SNR, rng, _KINDS, rate)[0],
        )
        is_normal = np.array([is_healthy(name) for name in windows.classes])
        self.healthy = self.table.only(is_normal[self.target] & ~self.synthetic)
        machines = set(self.healthy.machines())
        measured = {
            name for name, made in zip(self.table.specimen, self.synthetic, strict=True) if not made
        }
        copies = [self.table, replace(self.table, band_powers=noisy)]
        self.on_band_powers = np.stack(
            [layout.shapes(part.band_powers).reshape(len(rows), -1) for part in copies]
        )
        self.on_changes: np.ndarray | None = None
        has_each_class = len(np.unique(self.target[~self.synthetic])) == len(windows.classes)
        if has_each_class and measured <= machines:
            self.on_changes = np.stack(
                [self.healthy.changes(layout, part).reshape(len(rows), -1) for part in copies]
            )

    def training(self, tested: np.ndarray) -> np.ndarray:
        """Recordings that train where some are tested: the other measured ones, and what was made
        without them.
        """
        specimen = np.array(self.table.specimen, dtype=np.str_)
        measured = ~self.synthetic & ~np.isin(np.arange(len(self.target)), tested)
        made = self.synthetic & is_made_without(specimen, specimen[tested])
        lacks = len(np.unique(self.target[measured | made])) < len(np.unique(self.target))
        return np.flatnonzero(measured | (self.synthetic if lacks else made))

    def heads(self, values: np.ndarray, used: np.ndarray, n_classes: int, seed: int) -> Heads:
        """Heads found from some recordings and their noisy copies."""
        used = used[np.isfinite(values[:, used]).all(axis=(0, 2))]
        return fit_heads(values[:, used], self.target[used], n_classes, seed)


def fit_recordings(
    windows: WindowSet, answers: OutOfFoldPredictions, seed: int
) -> tuple[RecordingModel, RecordingTrial] | None:
    """(heads on whole recordings, what they said of left-out recordings), or None where recordings
    are too short.

    `answers` are those of short windows to the recordings that each fold left out; the heads' folds
    are the same.
    """
    shortest = shortest_stretch(windows)
    if shortest < LEAST_SAMPLES:
        return None
    layout = RecordingBandLayout.of(windows, shortest)
    tables, n_classes = _Tables(windows, layout, seed), len(windows.classes)
    row = {name: index for index, name in enumerate(tables.table.recording_id)}
    names, first, index = np.unique(answers.recording_id, return_index=True, return_inverse=True)
    fold, tested = answers.fold[first], np.array([row[name] for name in names.tolist()])
    pooled = np.zeros((len(names), n_classes))
    np.add.at(pooled, index, _logarithm(answers.probability))
    pooled /= np.bincount(index)[:, None]
    parts = [tables.on_band_powers] + ([] if tables.on_changes is None else [tables.on_changes])
    logarithms = [np.full((len(tested), n_classes), np.nan) for _ in parts]
    for number in np.unique(fold):
        members = fold == number
        used = tables.training(tested[members])
        for part, values in enumerate(parts):
            heads = tables.heads(values, used, n_classes, derive_seed(seed, "trial", int(number)))
            logarithms[part][members] = heads.log_probabilities(values[0, tested[members]])[1]
    target = tables.target[tested]
    on_band_powers, on_changes = (*logarithms, None)[:2]
    heard = (pooled, None, on_band_powers, None, on_changes)
    temperatures = np.array(
        [
            1.0
            if part is None
            else fit_pooling(list(scipy.special.softmax(part, axis=1)[:, None]), target)[0]
            for part in heard
        ]
    )
    trial = RecordingTrial(heard, target, temperatures)
    every = np.arange(len(tables.target))
    model = RecordingModel(
        layout=layout,
        usual_shaft=float(np.median(windows.speed) / (2 * np.pi)) if layout.n_orders else 0.0,
        on_band_powers=tables.heads(tables.on_band_powers, every, n_classes, seed),
        on_changes=None
        if tables.on_changes is None
        else tables.heads(tables.on_changes, every, n_classes, seed),
        healthy=tables.healthy,
        temperatures=trial.temperatures,
    )
    return model, trial
