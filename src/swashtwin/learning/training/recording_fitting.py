"""Training of heads on whole recordings, and their answers to recordings they did not see."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float, Float64, Int64

from swashtwin.foundation import derive_seed, random_stream
from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.learning.recordings.recording_heads import Heads, fit_heads
from swashtwin.learning.recordings.recording_model import (
    HEAD_NAMES,
    RecordingModel,
    combine_votes,
)
from swashtwin.learning.recordings.recording_table import (
    RecordingTable,
    Stretch,
    measure_recordings,
    recording_rows,
    shortest_stretch,
)
from swashtwin.learning.training.confidence import fit_pooling
from swashtwin.learning.training.out_of_fold import OutOfFoldPredictions
from swashtwin.learning.training.training_settings import with_noise
from swashtwin.learning.windows.splitting import fold_training_rows
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import is_healthy
from swashtwin.signals import NoiseKind

MIN_STRETCH_SAMPLES = 4096
"""Samples of the shortest recording from which whole recordings are classified."""
MIN_SNR_DB = -2.5
"""Lowest signal-to-noise ratio of the noisy copies that heads are trained on."""
NOISE_KINDS: tuple[NoiseKind, ...] = ("white", "pink", "hum")
"""Noise of these copies."""
MIN_PROBABILITY = 1e-12
"""Smallest probability whose logarithm is taken."""


@dataclass(frozen=True, eq=False)
class RecordingTrial:
    """Answers to recordings that the heads were not trained on."""

    votes: tuple[Float64[np.ndarray, "recording class"] | None, ...]
    """Logarithms of probabilities by short windows, pooled, and by each of `HEAD_NAMES`; None
    without such a head.
    """
    target: Int64[np.ndarray, " recording"]
    temperatures: Float64[np.ndarray, " head"]

    def recalls(self, with_baseline: bool) -> dict[str, float]:
        """Return the mean recall by recording of each head, and of all together."""
        recalls = {}
        for name, vote in zip(HEAD_NAMES, self.votes[1:], strict=True):
            if vote is not None:
                recalls[name] = self._mean_recall(vote)
        without = combine_votes(self.votes[:2], self.temperatures)
        recalls["without baseline"] = self._mean_recall(without)
        if with_baseline:
            together = combine_votes(self.votes, self.temperatures)
            recalls["with baseline"] = self._mean_recall(together)
        return recalls

    def answers(self, windows: OutOfFoldPredictions, *, with_changes: bool) -> OutOfFoldPredictions:
        """Return the joint answers of windows from those by the short windows alone.

        Parameters
        ----------
        with_changes : whether the head on changes from a machine's healthy recordings takes part.
        """
        recording_index = np.unique(windows.recording_id, return_inverse=True)[1]
        votes: list[np.ndarray | None] = [_log_probability(windows.probability)]
        head_votes = self.votes[1:] if with_changes else self.votes[1:2]
        for vote in head_votes:
            votes.append(None if vote is None else vote[recording_index])
        return replace(windows, probability=combine_votes(votes, self.temperatures))

    def _mean_recall(self, answer: Float[np.ndarray, "recording class"]) -> float:
        is_right = answer.argmax(axis=1) == self.target
        recalls = [is_right[self.target == index].mean() for index in np.unique(self.target)]
        return float(np.mean(recalls))


def _log_probability(
    probability: Float[np.ndarray, "row class"],
) -> Float64[np.ndarray, "row class"]:
    return np.asarray(np.log(np.maximum(probability, MIN_PROBABILITY)))


class _TrainingTables:
    """Band powers of all training recordings, clean and with noise, and their changes."""

    def __init__(self, windows: WindowSet, layout: RecordingBandLayout, seed: int) -> None:
        rows = recording_rows(windows)
        first = np.array([int(members[0]) for members in rows])
        self.n_classes = len(windows.classes)
        self.table = RecordingTable.measured(layout, windows)
        self.target = windows.target[first]
        self.is_synthetic = windows.synthetic[first]

        rng = random_stream(seed, "noise on recordings")

        def add_noise(stretch: Stretch) -> Stretch:
            return with_noise(stretch[None], MIN_SNR_DB, rng, NOISE_KINDS, windows.sample_rate)[0]

        noisy = measure_recordings(layout, windows, rows, add_noise)
        copies = [self.table, replace(self.table, band_powers=noisy)]
        shapes = [layout.shapes(copy.band_powers).reshape(len(rows), -1) for copy in copies]
        self.on_band_powers = np.stack(shapes)

        is_normal = np.array([is_healthy(name) for name in windows.classes])
        self.healthy = self.table.only(is_normal[self.target] & ~self.is_synthetic)
        self.on_changes: np.ndarray | None = None
        if self._has_changes():
            changes = [self.healthy.changes(layout, copy).reshape(len(rows), -1) for copy in copies]
            self.on_changes = np.stack(changes)

    def _has_changes(self) -> bool:
        """Return whether every measured machine has references, and every class is measured."""
        specimens = zip(self.table.specimen, self.is_synthetic.tolist(), strict=True)
        measured = {specimen for specimen, is_synthetic in specimens if not is_synthetic}
        measured_classes = np.unique(self.target[~self.is_synthetic])
        has_references = measured <= set(self.healthy.machines())
        return has_references and len(measured_classes) == self.n_classes

    def training_rows(self, tested: np.ndarray) -> np.ndarray:
        """Return the recordings that train if some are tested (`fold_training_rows`)."""
        specimen = np.array(self.table.specimen, dtype=np.str_)
        return fold_training_rows(self.target, specimen, self.is_synthetic, tested)

    def fit_heads(self, values: np.ndarray, rows: np.ndarray, seed: int) -> Heads:
        """Return heads fitted to some recordings and their noisy copies."""
        # Recordings of machines without references have no changes.
        rows = rows[np.isfinite(values[:, rows]).all(axis=(0, 2))]
        return fit_heads(values[:, rows], self.target[rows], self.n_classes, seed)


def fit_recordings(
    windows: WindowSet, answers: OutOfFoldPredictions, seed: int
) -> tuple[RecordingModel, RecordingTrial] | None:
    """Return heads on whole recordings, and their answers to held-out recordings.

    None if recordings are too short.

    Parameters
    ----------
    answers : answers of short windows to the recordings that each fold held out; the heads' folds
        are the same.
    """
    shortest = shortest_stretch(windows)
    if shortest < MIN_STRETCH_SAMPLES:
        return None
    layout = RecordingBandLayout.of(windows, shortest)
    tables = _TrainingTables(windows, layout, seed)
    trial = _try_heads(tables, answers, seed)

    all_rows = np.arange(len(tables.target))
    on_changes = None
    if tables.on_changes is not None:
        on_changes = tables.fit_heads(tables.on_changes, all_rows, seed)
    default_shaft = 0.0
    if layout.n_orders:
        default_shaft = float(np.median(windows.speed) / (2 * np.pi))
    model = RecordingModel(
        layout=layout,
        default_shaft=default_shaft,
        on_band_powers=tables.fit_heads(tables.on_band_powers, all_rows, seed),
        on_changes=on_changes,
        healthy=tables.healthy,
        temperatures=trial.temperatures,
    )
    return model, trial


def _try_heads(tables: _TrainingTables, answers: OutOfFoldPredictions, seed: int) -> RecordingTrial:
    """Return the answers of heads to the recordings that each fold held out."""
    names, first, recording_index = np.unique(
        answers.recording_id, return_index=True, return_inverse=True
    )
    table_row = {name: row for row, name in enumerate(tables.table.recording_id)}
    tested = np.array([table_row[name] for name in names.tolist()])
    fold = answers.fold[first]

    by_windows = np.zeros((len(names), tables.n_classes))
    np.add.at(by_windows, recording_index, _log_probability(answers.probability))
    by_windows /= np.bincount(recording_index)[:, None]
    votes = (
        by_windows,
        _out_of_fold_votes(tables, tables.on_band_powers, tested, fold, seed),
        _out_of_fold_votes(tables, tables.on_changes, tested, fold, seed),
    )

    target = tables.target[tested]
    temperatures = [1.0 if vote is None else _fit_temperature(vote, target) for vote in votes]
    return RecordingTrial(votes, target, np.array(temperatures))


def _out_of_fold_votes(
    tables: _TrainingTables,
    values: Float[np.ndarray, "copy recording column"] | None,
    tested: Int64[np.ndarray, " tested"],
    fold: Int64[np.ndarray, " tested"],
    seed: int,
) -> Float64[np.ndarray, "tested class"] | None:
    """Return log-probabilities of the tested recordings by heads fitted without their fold.

    None if there are no values for such heads.
    """
    if values is None:
        return None

    votes = np.full((len(tested), tables.n_classes), np.nan)
    for number in np.unique(fold):
        members = fold == number
        rows = tables.training_rows(tested[members])
        heads = tables.fit_heads(values, rows, derive_seed(seed, "trial", int(number)))
        votes[members] = heads.log_probabilities(values[0, tested[members]])
    return votes


def _fit_temperature(
    vote: Float64[np.ndarray, "recording class"], target: Int64[np.ndarray, " recording"]
) -> float:
    """Return the temperature at which the probabilities of held-out recordings are most likely."""
    probability = scipy.special.softmax(vote, axis=1)
    return float(fit_pooling(list(probability[:, None]), target)[0])
