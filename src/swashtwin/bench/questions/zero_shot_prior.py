"""Rows of the zero-shot study by recording: a pump prior with no measured fault and with a few, and measured faults."""

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from swashtwin.bench.questions.zero_shot_data import ORACLE, ZeroShotSplit
from swashtwin.bench.results.table import Trial
from swashtwin.diagnosis import PriorClassifier, load_prior
from swashtwin.foundation import stream
from swashtwin.learning import Forest, fit_forest
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.recordings import Recording, stated_pressure

PRIOR, FOREST = "pump prior", "forest on changes"
"""The training set, and what learns from it."""
SHOTS = (1, 3, 5)
"""Measured recordings of each fault that teach it further."""


OTHER_PRESSURES = "faults measured at other pressures"
"""What teaches where the tests are at a pressure without any measured fault (levels L3 and L4)."""


def few_shot(count: int) -> str:
    """Name of the training set with so many measured recordings of each fault."""
    return f"{PRIOR} and {count} of each fault"


def at_unseen_pressure(test: str) -> str:
    """Name of a test's recordings at the highest pressure, at which no fault teaches."""
    return f"{test}, unseen pressure"


def prior_trials(
    recordings: Sequence[Recording], split: ZeroShotSplit, seed: int, prior: PriorClassifier | None = None
) -> Iterator[Trial]:
    """Scores by recording, over the tests of a split, and over those at the highest pressure.

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
    references = adapted.healthy_changes()
    pool = {
        label: [name for name in sorted(split.faulty) if by_id[name].label == label] for label in adapted.classes[1:]
    }
    highest = max(stated_pressure(recording) for recording in recordings)
    below = {name for name in by_id if not values_match(stated_pressure(by_id[name]), highest, PRESSURE_TOLERANCE)}

    def taught(names: Sequence[str]) -> Forest:
        return adapted.taught_by(
            np.stack([changes[name] for name in names]), [str(by_id[name].label) for name in names]
        ).forest

    def from_measured(names: Sequence[str]) -> Forest:
        target = [0] * len(references) + [adapted.classes.index(str(by_id[name].label)) for name in names]
        return fit_forest(np.stack([*references, *(changes[name] for name in names)]), np.array(target), seed=seed)

    forests = {PRIOR: adapted.forest}
    rng = stream(seed, "few-shot")
    draws = {label: rng.permutation(names).tolist() for label, names in pool.items() if names}
    for count in SHOTS:
        names = [name for drawn in draws.values() for name in drawn[:count]]
        if all(len(drawn) >= count for drawn in draws.values()) and names:
            forests[few_shot(count)] = taught(names)
    faulty = [name for names in pool.values() for name in names]
    if faulty and len(references):
        forests[ORACLE] = from_measured(faulty)
    yield from _trials(forests, split.tests, changes, by_id, adapted.classes, seed)
    elsewhere = [name for name in faulty if name in below]
    at_highest = {at_unseen_pressure(test): ids - below for test, ids in split.tests.items() if ids - below}
    forests = {PRIOR: adapted.forest}
    if elsewhere:
        forests[f"{PRIOR} and {OTHER_PRESSURES}"] = taught(elsewhere)
    if elsewhere and len(references):
        forests[OTHER_PRESSURES] = from_measured(elsewhere)
    yield from _trials(forests, at_highest, changes, by_id, adapted.classes, seed)


def _trials(
    forests: Mapping[str, Forest],
    tests: Mapping[str, Collection[str]],
    changes: Mapping[str, np.ndarray],
    recordings: Mapping[str, Recording],
    classes: Sequence[str],
    seed: int,
) -> Iterator[Trial]:
    """Scores of each forest on the recordings of each test."""
    for training_set, forest in forests.items():
        for test, ids in tests.items():
            predicted = forest.predict_proba(np.stack([changes[name] for name in sorted(ids)])).argmax(axis=1)
            target = np.array([classes.index(str(recordings[name].label)) for name in sorted(ids)])
            factors = {"training_set": training_set, "classifier": FOREST, "test": test}
            yield Trial(factors, seed, recording_scores(predicted, target, classes))


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
