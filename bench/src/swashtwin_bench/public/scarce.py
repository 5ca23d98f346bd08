"""The scarce cell on a real pump: one state at one speed is missing, or was recorded once, and data alone fill it."""

import time
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from joblib import delayed
from sklearn.metrics import confusion_matrix

from swashtwin.foundation import VERSION, DataError, InputError, derive_seed, parallel
from swashtwin.learning import WindowSet, cut_windows, extract_features, g_mean, recalls
from swashtwin_bench.fillers.interpolation import NoNeighborsError
from swashtwin_bench.public.estimators import extra_trees
from swashtwin_bench.public.feature_fillers import FEATURE_FILLERS
from swashtwin_bench.public.readers.registry import read_public_set
from swashtwin_bench.results.table import StudyTable, Trial

MEASURED = ("every recording", "one recording", "none")
"""What training has of the scarce cell: all, one repeat, or nothing."""
_WINDOW = 3281


def run_scarce(
    folder: Path | str,
    *,
    seeds: Sequence[int] = (0,),
    jobs: int = 1,
    progress: Callable[[str, int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """What filling a scarce cell from data alone is worth on the pump with the throttled suction.

    Each of the 15 cells (state and speed) in turn is scarce. Training has two repeats of every other cell; the test is
    the third repeat of every state at the cell's speed, measured windows only. What is put in comes from the cell's own
    windows, or from the same state at the other speeds where it has none, and as much as the cell lacks. Extra trees on
    the usual features tell the states apart.

    Parameters
    ----------
    folder : folder that holds ``pump_cavitation``.
    seeds : of the repeats, the fillings and the trees.
    jobs : processes that work side by side.
    progress : called with what is done, how much of it, and of how much.
    command : command line that repeats it.
    """
    began = time.perf_counter()
    if not seeds:
        raise InputError("no seed was given; one is enough: seeds=(0,).")
    recordings = read_public_set("pump_cavitation", Path(folder) / "pump_cavitation")
    windows = cut_windows(recordings, length=_WINDOW)
    features = extract_features(windows).values
    facts = {
        recording.recording_id: (recording.attributes["speed_nominal"], recording.attributes["repeat"])
        for recording in recordings
    }
    speed, repeat = np.array([facts[name] for name in windows.recording_id.tolist()]).T
    if len(np.unique(repeat)) < 3:
        raise DataError(f"{folder}: the drill needs three repeats of each state; {len(np.unique(repeat))} are there.")
    drill = _Drill(windows, features, speed, repeat)
    cells = sorted({(str(label), str(cell_speed)) for label, cell_speed in zip(windows.label, speed, strict=True)})
    tries = list(product(cells, seeds))
    tell = progress or (lambda what, count, total: None)
    tell("scarce cells", 0, len(tries))
    trials_by_cell = parallel(jobs)(delayed(drill.trials)(*cell, seed) for cell, seed in tries)
    tell("scarce cells", len(tries), len(tries))
    order = {key: position for position, key in enumerate(_rows())}
    trials = sorted(
        (trial for part in trials_by_cell for trial in part), key=lambda trial: order[tuple(trial.factors.values())]
    )
    return StudyTable(
        study="scarce",
        title="A scarce cell on a real pump, filled from data alone",
        metrics={
            "scarce_recall": "recall of the scarce cell",
            "balanced_accuracy": "balanced accuracy at its speed",
            "g_mean": "G-mean at its speed",
        },
        trials=tuple(trials),
        answer=_answer(trials),
        settings={"window": _WINDOW, "cells": len(cells)},
        origin="Public recordings of one centrifugal pump on one day (pump_cavitation).",
        wall_s=time.perf_counter() - began,
        version=VERSION,
        command=command,
        notes=(
            "Mean over all cells and the seeds. The test repeat was recorded back to back with those trained on (L2), "
            "so only the recall of a cell that training lacks says anything of a new condition.",
        ),
    )


def _rows() -> list[tuple[str, str]]:
    return [(MEASURED[0], "nothing"), *product(MEASURED[1:], FEATURE_FILLERS)]


class _Drill:
    """Windows of the set, with features, speed and repeat of each."""

    def __init__(
        self, windows: WindowSet, features: Float[np.ndarray, "window feature"], speed: np.ndarray, repeat: np.ndarray
    ) -> None:
        self.windows, self.features, self.speed, self.repeat = windows, features, speed, repeat

    def trials(self, label: str, speed: str, seed: int) -> list[Trial]:
        """Trials of every amount of measured recordings and every filler, in one scarce cell."""
        repeats = np.unique(self.repeat)
        first = derive_seed(seed, "repeats", label, speed) % len(repeats)
        tested_repeat, trained_repeat = repeats[first], repeats[(first + 1) % len(repeats)]
        cell = (self.windows.label == label) & (self.speed == speed)
        test = (self.repeat == tested_repeat) & (self.speed == speed)
        train = {
            MEASURED[0]: self.repeat != tested_repeat,
            MEASURED[1]: (self.repeat != tested_repeat) & (~cell | (self.repeat == trained_repeat)),
            MEASURED[2]: (self.repeat != tested_repeat) & ~cell,
        }
        return [
            Trial(
                {"measured": measured, "filler": filler}, seed, self._score(train[measured], test, cell, filler, seed)
            )
            for measured, filler in _rows()
        ]

    def _score(
        self,
        train: Bool[np.ndarray, " window"],
        test: Bool[np.ndarray, " window"],
        cell: Bool[np.ndarray, " window"],
        filler: str,
        seed: int,
    ) -> dict[str, float]:
        X, label = self.features[train], self.windows.label[train]
        scarce = str(self.windows.label[cell][0])
        lacking = int((cell & ~test).sum() - (cell & train).sum())
        fill = FEATURE_FILLERS[filler]
        if fill is not None:
            pool = cell[train] if cell[train].any() else label == scarce
            try:
                added = fill(self.windows.subset(train), X, pool, lacking, seed)
            except NoNeighborsError:
                return {}
            X, label = np.concatenate([X, added]), np.concatenate([label, np.full(len(added), scarce)])
        predicted = extra_trees(derive_seed(seed, "trees") % 2**32).fit(X, label).predict(self.features[test])
        classes = np.unique(self.windows.label)
        confusion = confusion_matrix(self.windows.label[test], predicted, labels=classes)
        recall = recalls(confusion)
        return {
            "scarce_recall": float(recall[np.flatnonzero(classes == scarce)[0]]),
            "balanced_accuracy": float(recall.mean()),
            "g_mean": g_mean(confusion),
        }


def _answer(trials: Sequence[Trial]) -> tuple[str, ...]:
    def recall(measured: str, filler: str) -> float:
        factors = {"measured": measured, "filler": filler}
        recalls = [trial.values["scarce_recall"] for trial in trials if trial.factors == factors and trial.values]
        return float(np.mean(recalls)) if recalls else float("nan")

    sentences = []
    for measured in MEASURED[1:]:
        scores = {
            name: np.nan_to_num(recall(measured, name), nan=-1.0) for name in FEATURE_FILLERS if name != "nothing"
        }
        best = max(scores, key=scores.__getitem__)
        sentences.append(
            f"With {measured} of the scarce cell its recall is {recall(measured, 'nothing'):.2f} without filling. The "
            f"best filler ({best}) gives {recall(measured, best):.2f}, and all recordings "
            f"{recall(MEASURED[0], 'nothing'):.2f}."
        )
    return tuple(sentences)
