"""Rows of the zero-shot study by recording: a pump prior with no measured fault and with a few, and measured faults."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from swashtwin.bench.questions.zero_shot_data import ORACLE, ZeroShotSplit
from swashtwin.bench.results.table import Trial
from swashtwin.diagnosis import PriorClassifier, load_prior
from swashtwin.foundation import stream
from swashtwin.learning import fit_forest
from swashtwin.recordings import Recording

PRIOR, FOREST = "pump prior", "forest on changes"
"""The training set, and what learns from it."""
SHOTS = (1, 3, 5)
"""Measured recordings of each fault that teach it further."""


def few_shot(count: int) -> str:
    """Name of the training set with so many measured recordings of each fault."""
    return f"{PRIOR} and {count} of each fault"


def prior_trials(
    recordings: Sequence[Recording], split: ZeroShotSplit, seed: int, prior: PriorClassifier | None = None
) -> Iterator[Trial]:
    """Scores by recording, over the tests of a split.

    Parameters
    ----------
    split : its healthy recordings are what others are compared with, its faulty ones teach.
    seed : of the fleet; draws the measured recordings of few-shot.
    prior : the shipped one by default.
    """
    by_id = {recording.recording_id: recording for recording in recordings}
    healthy = [by_id[name] for name in sorted(split.healthy)]
    adapted = (prior or load_prior("25scy14-1b")).adapt(healthy)
    changes = {name: adapted.change(by_id[name])[0].ravel() for name in sorted(by_id)}
    references = _against_others(adapted, [recording.recording_id for recording in healthy])
    tests = {
        test: (
            np.stack([changes[name] for name in sorted(ids)]),
            np.array([adapted.classes.index(str(by_id[name].label)) for name in sorted(ids)]),
        )
        for test, ids in split.tests.items()
    }
    pool = {
        label: [name for name in sorted(split.faulty) if by_id[name].label == label] for label in adapted.classes[1:]
    }
    forests = {PRIOR: adapted.forest}
    rng = stream(seed, "few-shot")
    draws = {label: rng.permutation(names).tolist() for label, names in pool.items() if names}
    for count in SHOTS:
        names = [name for drawn in draws.values() for name in drawn[:count]]
        if all(len(drawn) >= count for drawn in draws.values()) and names:
            rows = np.stack([changes[name] for name in names])
            forests[few_shot(count)] = adapted.taught_by(rows, [str(by_id[name].label) for name in names]).forest
    if draws and references:
        measured = [*references, *(changes[name] for names in pool.values() for name in names)]
        target = [0] * len(references) + [adapted.classes.index(label) for label, names in pool.items() for _ in names]
        forests[ORACLE] = fit_forest(np.stack(measured), np.array(target), seed=seed)
    for training_set, forest in forests.items():
        for test, (values, target_of_test) in tests.items():
            predicted = forest.predict_proba(values).argmax(axis=1)
            factors = {"training_set": training_set, "classifier": FOREST, "test": test}
            yield Trial(factors, seed, recording_scores(predicted, target_of_test, adapted.classes))


def _against_others(adapted: PriorClassifier, names: Sequence[str]) -> list[np.ndarray]:
    """Changes of healthy recordings, each against the others of its point; none where it is the only one."""
    rows = []
    for index in range(len(names)):
        others = np.array(
            [
                adapted.specimen[other] == adapted.specimen[index]
                and np.isclose(adapted.point_pressure[other], adapted.point_pressure[index])
                and other != index
                for other in range(len(names))
            ]
        )
        if others.any():
            rows.append((adapted.levels[index] - adapted.levels[others].mean(axis=0)).ravel())
    return rows


def recording_scores(predicted: np.ndarray, target: np.ndarray, classes: Sequence[str]) -> Mapping[str, float]:
    """Scores by recording; the first class is the healthy one."""
    recalls = {
        name: float(np.mean(predicted[target == index] == index)) if (target == index).any() else float("nan")
        for index, name in enumerate(classes)
    }
    return {
        "recording_balanced_accuracy": float(np.nanmean(list(recalls.values()))),
        "recording_accuracy": float(np.mean(predicted == target)),
        "false_alarm_rate": 1 - recalls[classes[0]],
        **{f"recall_{name}": recall for name, recall in recalls.items()},
    }
