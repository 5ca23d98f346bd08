"""Rows of the zero-shot study by recording: a pump prior with no measured fault and with a few, and measured faults."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swashtwin.diagnosis import PriorClassifier
from swashtwin.foundation import stream
from swashtwin.learning import Forest, fit_forest
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.recordings import Recording, stated_pressure
from swashtwin_bench.questions.zero_shot_data import ORACLE, ZeroShotSplit
from swashtwin_bench.results.table import Trial

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
    adapted = (prior or PriorClassifier.load("25scy14-1b")).fit([by_id[name] for name in sorted(split.healthy)])
    rows = _Rows(
        changes={name: adapted.change(by_id[name])[0].ravel() for name in sorted(by_id)},
        labels={name: str(recording.label) for name, recording in by_id.items()},
        classes=adapted.classes,
        seed=seed,
    )
    pool = {
        label: [name for name in sorted(split.faulty) if rows.labels[name] == label] for label in adapted.classes[1:]
    }
    faulty = [name for names in pool.values() for name in names]
    forests = {PRIOR: adapted.forest}
    rng = stream(seed, "few-shot")
    draws = {label: rng.permutation(names).tolist() for label, names in pool.items() if names}
    for count in SHOTS:
        names = [name for drawn in draws.values() for name in drawn[:count]]
        if all(len(drawn) >= count for drawn in draws.values()) and names:
            forests[few_shot(count)] = rows.teach(adapted, names)
    if faulty:
        forests |= rows.learn_measured(ORACLE, adapted, faulty)
    yield from rows.trials(forests, split.tests)
    pressures = {name: stated_pressure(recording) for name, recording in by_id.items()}
    highest_pressure = max(pressures.values())
    lower = {name for name in by_id if not values_match(pressures[name], highest_pressure, PRESSURE_TOLERANCE)}
    if not lower:
        return
    forests = {PRIOR: adapted.forest}
    if lower_faults := [name for name in faulty if name in lower]:
        forests[f"{PRIOR} and {OTHER_PRESSURES}"] = rows.teach(adapted, lower_faults)
        forests |= rows.learn_measured(OTHER_PRESSURES, adapted, lower_faults)
    yield from rows.trials(
        forests, {at_unseen_pressure(test): ids - lower for test, ids in split.tests.items() if ids - lower}
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Changes of all recordings of a fleet, from which forests learn and on which they are tested."""

    changes: Mapping[str, np.ndarray]
    """Of each recording, by its id."""
    labels: Mapping[str, str]
    """Class of each."""
    classes: tuple[str, ...]
    """In the order of the probabilities."""
    seed: int
    """Of the fleet."""

    def teach(self, adapted: PriorClassifier, names: Sequence[str]) -> Forest:
        """The adapted prior's forest after these measured faults."""
        return adapted.taught_by(
            np.stack([self.changes[name] for name in names]), [self.labels[name] for name in names]
        ).forest

    def learn_measured(self, training_set: str, adapted: PriorClassifier, names: Sequence[str]) -> dict[str, Forest]:
        """A forest of these measured faults and the healthy recordings alone; none without two healthy ones."""
        healthy = adapted.healthy_changes()
        if not len(healthy):
            return {}
        target = [0] * len(healthy) + [self.classes.index(self.labels[name]) for name in names]
        values = np.stack([*healthy, *(self.changes[name] for name in names)])
        return {training_set: fit_forest(values, np.array(target), len(self.classes), seed=self.seed)}

    def trials(self, forests: Mapping[str, Forest], tests: Mapping[str, Collection[str]]) -> Iterator[Trial]:
        """Scores of each forest on the recordings of each test."""
        for training_set, forest in forests.items():
            for test, ids in tests.items():
                predicted = forest.predict_proba(np.stack([self.changes[name] for name in sorted(ids)])).argmax(axis=1)
                target = np.array([self.classes.index(self.labels[name]) for name in sorted(ids)])
                factors = {"training_set": training_set, "classifier": FOREST, "test": test}
                yield Trial(factors, self.seed, recording_scores(predicted, target, self.classes))


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
