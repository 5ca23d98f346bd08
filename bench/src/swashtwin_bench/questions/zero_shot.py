"""Zero-shot: a pump prior without measured faults, on recordings of the virtual rig.

Every fault class of the prior is synthetic; the tests are measured recordings, split L5. Each
machine has healthy recordings from its first days as a reference, which never test. For comparison,
measured faults also teach: a few of each together with the prior, or all of them alone (an oracle).
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swashtwin.diagnosis import PriorClassifier
from swashtwin.foundation import DataError, random_stream
from swashtwin.pump import CLASSES, group_by_condition
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.writing import OTHER_DESIGNS, RIG_VERSION, SIZES, VERSIONS, rig_recordings
from swashtwin_bench.studies.cells import recordings_by_cell

DESIGN = "25scy14-1b"
"""Name of the shipped prior."""

HEALTHY = 6
"""Healthy recordings of a pump and operating point that the prior is adapted to; half as many test.
"""

HELD_OUT = 2
"""Held-out pumps, of which only healthy recordings teach."""

SAME = "same pump"
"""Test on other recordings of pumps whose faults may teach."""

UNSEEN = "unseen pump"
"""Test on held-out pumps."""

ORACLE = "measured faults (oracle)"

METRICS = {
    "recording_accuracy": "recordings right",
    "recording_balanced_accuracy": "balanced accuracy by recording",
    "false_alarm_rate": "false alarms",
    "sure_and_wrong": "sure and wrong",
    "unknown": "called unknown",
    **{f"recall_{name}": f"recall {name.replace('_', ' ')}" for name in CLASSES},
    **{f"unknown_{name}": f"{name.replace('_', ' ')} called unknown" for name in CLASSES},
}

SURE = 0.8
"""Smallest probability of an answer that counts as sure."""

PRIOR = "pump prior"
"""Training set without a measured fault."""

SHOTS = (1, 3, 5)
"""Numbers of measured recordings of each fault that teach further."""


def few_shot(count: int) -> str:
    """Return the name of the training set with `count` measured recordings of each fault."""
    return f"{PRIOR} and {count} of each fault"


def adapted_to(count: int, *, alone: bool = False) -> str:
    """Return the name of the training set with `count` healthy recordings per operating point.

    They are those of a pump `alone`, or of its fleet.
    """
    return f"{PRIOR}, {count} healthy{' of the pump alone' if alone else ''}"


def left_out(label: str) -> str:
    """Return the name of the training set whose prior does not hold a class."""
    return f"{PRIOR} without {label.replace('_', ' ')}"


SPLITS = {
    "no measured fault": "L5",
    f"measured faults, {SAME}": "L2",
    f"measured faults, {UNSEEN}": "L4",
}
"""Split of the rows, by their training set and test."""

_NOTES = (
    "Rows that no measured fault teaches are split L5. Rows that measured faults teach (the "
    "oracle, a few of each fault) are L2 on the same pumps and L4 on others. The pump prior has "
    "learned from healthy recordings of the same pumps, so its normals are L2 there.",
)


@dataclass(frozen=True, eq=False)
class ZeroShotSplit:
    """Recording ids by role."""

    pumps: tuple[str, ...]
    """Specimens whose measured faults may teach."""
    healthy: frozenset[str]
    """Healthy recordings of every specimen that do not test."""
    faulty: frozenset[str]
    """Faulty recordings of these specimens that may teach."""
    tests: Mapping[str, frozenset[str]]
    """Recordings of each test."""


def split_zero_shot(
    recordings: Sequence[Recording],
    seed: int,
    held_out: int = HELD_OUT,
    *,
    max_tests: int | None = None,
) -> ZeroShotSplit:
    """Return the recordings for training, for reference and for tests, drawn by `seed`.

    Of each specimen, class and pressure a third of the recordings test: at least one, and at most
    `max_tests`. Of held-out specimens all faulty recordings test. If a cell has a single faulty
    recording, it tests.

    Raises
    ------
    DataError
        Too few specimens, a class that no twin simulates, or a single healthy recording of a
        specimen at a pressure.
    """
    foreign = sorted({str(recording.label) for recording in recordings} - set(CLASSES))
    if foreign:
        raise DataError(
            f"The study cannot simulate the class {foreign[0]!r}, only {', '.join(CLASSES)}. "
            "Exclude those recordings."
        )

    cells = recordings_by_cell(recordings, "the zero-shot study")
    specimens = sorted({str(recording.specimen) for recording in recordings})
    if len(specimens) <= held_out:
        raise DataError(
            f"the zero-shot study needs at least {held_out + 1} specimens, {held_out} of them held "
            f"out; the recordings name {len(specimens)} ({', '.join(specimens)})."
        )

    rng = random_stream(seed, "zero-shot", "split")
    unseen = set(rng.permutation(specimens)[:held_out].tolist())
    healthy: set[str] = set()
    faulty: set[str] = set()
    tests: dict[str, set[str]] = {SAME: set(), UNSEEN: set()}
    for cell in cells:
        order = [cell[index].recording_id for index in rng.permutation(len(cell))]
        is_normal = cell[0].label == "normal"
        is_unseen = cell[0].specimen in unseen
        if is_normal and len(order) < 2:
            raise DataError(
                f"{order[0]} is the only healthy recording of {cell[0].specimen} at its pressure; "
                "the study needs one to learn from and one to test."
            )

        if is_unseen and not is_normal:
            test_count = len(order)
        else:
            test_count = min(max(1, len(order) // 3), max_tests or len(order))
        tests[UNSEEN if is_unseen else SAME].update(order[:test_count])
        if is_normal:
            healthy.update(order[test_count:])
        else:
            faulty.update(order[test_count:])

    return ZeroShotSplit(
        tuple(name for name in specimens if name not in unseen),
        frozenset(healthy),
        frozenset(faulty),
        {name: frozenset(ids) for name, ids in tests.items()},
    )


def few_healthy(healthy: Sequence[Recording], count: int, seed: int) -> list[Recording]:
    """Return `count` recordings of each pump and operating point, or all if there are fewer.

    The recordings of a smaller `count` are among those of a larger one.
    """
    rng = random_stream(seed, "few healthy")
    selected: list[Recording] = []
    for specimen in sorted({str(recording.specimen) for recording in healthy}):
        recordings = []
        conditions = []
        for recording in healthy:
            if recording.specimen == specimen and recording.condition:
                recordings.append(recording)
                conditions.append(recording.condition)

        for indices in group_by_condition(conditions):
            selected += [recordings[index] for index in rng.permutation(indices)[:count]]

    return selected


@dataclass(frozen=True)
class ZeroShotSettings:
    """Recordings of the study."""

    rig: str = RIG_VERSION
    """Version of the virtual rig, if no recordings are given."""
    healthy: tuple[int, ...] = ()
    """Numbers of healthy recordings per pump and operating point that replace `HEALTHY`.

    Then no measured fault teaches, no class is left out, and all numbers share the tests.
    """


def zero_shot(
    work: Work, settings: ZeroShotSettings, recordings: Sequence[Recording] | None = None
) -> StudyTable:
    """Return scores on measured faults of the pump prior, with and without measured faults.

    Parameters
    ----------
    work : each seed draws a split and measured faults, and a fleet if there are no `recordings`.
    recordings : of several specimens, healthy ones at every pressure; fleets of the virtual rig by
        default.

    Raises
    ------
    DataError
        The recordings cannot be split.
    """
    fleets = work.map("fleets", _fleet, [(recordings, settings, seed) for seed in work.seeds])

    trials: list[Trial] = []
    roles: dict[str, dict[str, list[str]]] = {}
    for seed, (fleet_trials, split, _) in zip(work.seeds, fleets, strict=True):
        trials += fleet_trials
        roles[str(seed)] = {
            "pumps": list(split.pumps),
            "healthy": sorted(split.healthy),
            "oracle": sorted(split.faulty),
        }
        for name, ids in split.tests.items():
            roles[str(seed)][name] = sorted(ids)

    study = StudyTable(
        study="zero-shot",
        title="Zero-shot: faults without a measured recording",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings={
            "specimens_held_out": HELD_OUT,
            "healthy": list(settings.healthy) or [HEALTHY],
            "fleets": "one for each seed" if recordings is None else "as given",
        },
        origin=fleets[0][2],
        notes=_NOTES,
        details={"classes": list(CLASSES), "splits": roles, "split": SPLITS},
    )
    return replace(study, answer=_answer(study, settings.healthy))


def _fleet(
    recordings: Sequence[Recording] | None, settings: ZeroShotSettings, seed: int
) -> tuple[list[Trial], ZeroShotSplit, str]:
    """Return the trials of a fleet, its split and its origin."""
    pistons: dict[str, int] = {}
    max_tests = None
    if recordings is None:
        # Each operating point needs as many healthy recordings as the prior is adapted to, and
        # half of `HEALTHY` to test.
        faulty_size = SIZES["small"]
        speed_count = len(VERSIONS[settings.rig].speeds)
        max_tests = HEALTHY * speed_count // 2
        adapting = max(settings.healthy, default=HEALTHY) * speed_count
        healthy_size = replace(faulty_size, repeats=adapting + max_tests)

        pairs = [
            *rig_recordings(seed, healthy_size, labels=CLASSES[:1], version=settings.rig),
            *rig_recordings(seed, faulty_size, labels=CLASSES[1:], version=settings.rig),
        ]
        recordings = [recording for recording, _ in pairs]
        if settings.rig in OTHER_DESIGNS:
            pistons = {run.specimen.name: len(run.specimen.clearances) for _, run in pairs}

    split = split_zero_shot(recordings, seed, max_tests=max_tests)
    if settings.healthy:
        trials = healthy_trials(recordings, split, seed, settings.healthy, pistons)
    else:
        trials = prior_trials(recordings, split, seed, pistons=pistons)

    return list(trials), split, describe_origin(recordings)


def _answer(study: StudyTable, healthy: Sequence[int]) -> tuple[str, ...]:
    rows = {
        (row["training_set"], row["test"]): row["recording_balanced_accuracy"]["mean"]
        for row in study.rows()
    }

    def pair(training_set: str, tests: tuple[str, str] = (SAME, UNSEEN)) -> str:
        means = [rows.get((training_set, test)) for test in tests]
        return " / ".join("no number" if mean is None else f"{mean:.3f}" for mean in means)

    score = "Balanced accuracy by recording on the same pumps / on held-out pumps"
    if healthy:
        sets = [adapted_to(count) for count in healthy]
        sets += [adapted_to(count, alone=True) for count in healthy]
        pairs = "; ".join(f"{name} {pair(name)}" for name in sets)
        return (f"{score}: {pairs}.",)

    shots = ", ".join(f"{count} of each {pair(few_shot(count))}" for count in SHOTS)
    return (
        f"{score}: {PRIOR}, no measured fault {pair(PRIOR)}; all measured faults {pair(ORACLE)}; "
        f"the prior and measured recordings of each fault: {shots}.",
    )


def prior_trials(
    recordings: Sequence[Recording],
    split: ZeroShotSplit,
    seed: int,
    prior: PriorClassifier | None = None,
    pistons: Mapping[str, int] | None = None,
) -> Iterator[Trial]:
    """Yield the scores by recording of each training set, over the tests of a split.

    Parameters
    ----------
    split : its healthy recordings are the reference, its faulty ones teach.
    seed : of the fleet; draws the measured recordings of few-shot training sets.
    prior : the shipped one by default.
    pistons : number of pistons by specimen, if they are not of the prior's design.
    """
    shipped = prior or PriorClassifier.load(DESIGN)
    pistons = pistons or {}
    classes = shipped.classes[:-1]
    by_id = {recording.recording_id: recording for recording in recordings}
    healthy = _order_by_id(by_id, split.healthy)
    faulty: dict[str, list[Recording]] = {label: [] for label in classes[1:]}
    for recording in _order_by_id(by_id, split.faulty):
        faulty[str(recording.label)].append(recording)

    # The prior, priors that lack a class, and the prior with a few measured faults.
    by_specimen = _adapt(shipped, healthy, pistons)
    classifiers = {PRIOR: by_specimen}
    for label in classes[1:]:
        classifiers[left_out(label)] = _adapt(_without(shipped, label), healthy, pistons)
    for count, shots in _draw_shots(faulty, seed).items():
        classifiers[few_shot(count)] = _adapt(shipped, [*healthy, *shots], pistons)

    tests = {test: _order_by_id(by_id, ids) for test, ids in split.tests.items()}
    for training_set, adapted in classifiers.items():
        yield from _scored(training_set, adapted, tests, seed)

    yield from _oracle_trials(by_specimen, faulty, tests, classes, seed)


def _order_by_id(by_id: Mapping[str, Recording], ids: Collection[str]) -> list[Recording]:
    """Return recordings in the order of their ids: sets have none that is reproducible."""
    return [by_id[name] for name in sorted(ids)]


def _draw_shots(faulty: Mapping[str, Sequence[Recording]], seed: int) -> dict[int, list[Recording]]:
    """Return by number in `SHOTS` as many recordings of each measured fault.

    Numbers that a fault does not have are left out. A larger number has the recordings of a smaller
    one too.
    """
    rng = random_stream(seed, "few-shot")
    shuffled_by_fault: list[list[Recording]] = []
    for candidates in faulty.values():
        if candidates:
            order = rng.permutation(len(candidates))
            shuffled_by_fault.append([candidates[index] for index in order])

    if not shuffled_by_fault:
        return {}

    shots: dict[int, list[Recording]] = {}
    for count in SHOTS:
        if min(map(len, shuffled_by_fault)) < count:
            continue
        shots[count] = []
        for shuffled in shuffled_by_fault:
            shots[count] += shuffled[:count]

    return shots


def _oracle_trials(
    by_specimen: Mapping[str, PriorClassifier],
    faulty: Mapping[str, Sequence[Recording]],
    tests: Mapping[str, Sequence[Recording]],
    classes: Sequence[str],
    seed: int,
) -> Iterator[Trial]:
    """Yield the scores of a forest that learns from all measured faults, if there are any.

    Parameters
    ----------
    by_specimen : adapted prior of each specimen, which measures changes from its healthy state.
    faulty : measured faults by class.
    """
    # Specimens of a design share a classifier, whose healthy changes count once.
    unique = {id(classifier): classifier for classifier in by_specimen.values()}
    healthy_changes = np.concatenate(
        [classifier.healthy_changes() for classifier in unique.values()]
    )
    changes = list(healthy_changes)
    targets = [0] * len(changes)
    for label, recordings in faulty.items():
        changes += [_measure_change(by_specimen, recording) for recording in recordings]
        targets += [classes.index(label)] * len(recordings)
    if len(healthy_changes) == 0 or len(changes) == len(healthy_changes):
        return

    values = np.stack(changes).reshape(len(changes), -1)
    forest = _forest(values, np.array(targets), len(classes), seed)
    for test, recordings in tests.items():
        test_changes = [_measure_change(by_specimen, recording) for recording in recordings]
        probability = forest(np.stack(test_changes))
        target = np.array([classes.index(str(recording.label)) for recording in recordings])
        scores = recording_scores(probability, target, classes)
        yield Trial({"training_set": ORACLE, "test": test}, seed, scores)


def _measure_change(by_specimen: Mapping[str, PriorClassifier], recording: Recording) -> np.ndarray:
    return by_specimen[str(recording.specimen)].change(recording)[0]


def healthy_trials(
    recordings: Sequence[Recording],
    split: ZeroShotSplit,
    seed: int,
    counts: Sequence[int],
    pistons: Mapping[str, int],
) -> Iterator[Trial]:
    """Yield the scores of the shipped prior adapted to fewer healthy recordings.

    They are those of the fleet, or of a pump alone.

    Parameters
    ----------
    split, seed, pistons : as in `prior_trials`.
    counts : numbers of recordings per operating point.
    """
    shipped = PriorClassifier.load(DESIGN)
    healthy = _select(recordings, split.healthy)
    tests = {name: _select(recordings, ids) for name, ids in split.tests.items()}

    for alone in (False, True):
        for count in counts:
            references = few_healthy(healthy, count, seed)
            by_specimen = _adapt(shipped, references, pistons, alone=alone)
            yield from _scored(adapted_to(count, alone=alone), by_specimen, tests, seed)


def _select(recordings: Sequence[Recording], ids: frozenset[str]) -> list[Recording]:
    return [recording for recording in recordings if recording.recording_id in ids]


def _adapt(
    prior: PriorClassifier,
    recordings: Sequence[Recording],
    pistons: Mapping[str, int],
    *,
    alone: bool = False,
) -> dict[str, PriorClassifier]:
    """Return by specimen the classifier adapted to its design, or to it `alone`."""
    specimens = dict.fromkeys(str(recording.specimen) for recording in recordings)
    groups = {specimen: specimen if alone else pistons.get(specimen) for specimen in specimens}

    fitted = {}
    for group in sorted(set(groups.values()), key=str):
        members = [
            recording for recording in recordings if groups[str(recording.specimen)] == group
        ]
        fitted[group] = prior.fit(members, pistons=pistons.get(str(members[0].specimen)))

    return {specimen: fitted[group] for specimen, group in groups.items()}


def _scored(
    training_set: str,
    by_specimen: Mapping[str, PriorClassifier],
    tests: Mapping[str, Sequence[Recording]],
    seed: int,
) -> Iterator[Trial]:
    for test, recordings in tests.items():
        probability = np.zeros((len(recordings), len(CLASSES)))
        unknown = np.zeros(len(recordings), dtype=bool)
        for row, recording in enumerate(recordings):
            diagnosis = by_specimen[str(recording.specimen)].diagnose(recording)
            unknown[row] = diagnosis.unknown
            # A prior without a class gives it no probability.
            probability[row] = [diagnosis.probabilities.get(name, 0.0) for name in CLASSES]

        target = np.array([CLASSES.index(str(recording.label)) for recording in recordings])
        factors = {"training_set": training_set, "test": test}
        yield Trial(factors, seed, recording_scores(probability, target, CLASSES, unknown))


def _forest(
    values: np.ndarray, target: np.ndarray, n_classes: int, seed: int
) -> Callable[[np.ndarray], np.ndarray]:
    """Return the probabilities of a random forest with equally weighted classes.

    A class without a row has no probability.
    """
    from sklearn.ensemble import RandomForestClassifier

    forest = RandomForestClassifier(
        100, max_leaf_nodes=256, class_weight="balanced", random_state=seed % 2**32, n_jobs=1
    ).fit(values.astype(np.float32), target)

    def answer(rows: np.ndarray) -> np.ndarray:
        probability = np.zeros((len(rows), n_classes))
        probability[:, forest.classes_] = forest.predict_proba(
            rows.reshape(len(rows), -1).astype(np.float32)
        )
        return probability

    return answer


def _without(prior: PriorClassifier, label: str) -> PriorClassifier:
    """Return the prior without a class and its virtual recordings."""
    virtual = prior.virtual
    assert virtual is not None
    index = prior.classes.index(label)

    # Indices of the classes after the removed one move down by one.
    is_other = virtual.target != index
    target = virtual.target[is_other]
    target = target - (target > index)
    virtual = replace(
        virtual, change=virtual.change[is_other], target=target, number=virtual.number[is_other]
    )
    classes = tuple(name for name in prior.classes if name != label)

    return replace(prior, virtual=virtual, classes=classes)


def recording_scores(
    probability: np.ndarray,
    target: np.ndarray,
    classes: Sequence[str],
    unknown: np.ndarray | None = None,
) -> Mapping[str, float]:
    """Return the scores of the likeliest class by recording.

    Parameters
    ----------
    target : index of the true class of each recording.
    classes : the first one is the healthy one.
    unknown : whether each recording was called unknown, which counts as not sure; `None` if the
        classifier has no such answer.
    """
    is_right = probability.argmax(axis=1) == target
    is_sure = probability.max(axis=1) >= SURE
    if unknown is not None:
        is_sure = is_sure & ~unknown

    def share(hits: np.ndarray, mask: np.ndarray) -> float:
        return float(np.mean(hits[mask])) if mask.any() else float("nan")

    masks = {name: target == index for index, name in enumerate(classes)}
    recalls = {name: share(is_right, mask) for name, mask in masks.items()}
    scores = {
        "recording_balanced_accuracy": float(np.nanmean(list(recalls.values()))),
        "recording_accuracy": float(np.mean(is_right)),
        "sure_and_wrong": float(np.mean(~is_right & is_sure)),
        "unknown": float("nan") if unknown is None else float(np.mean(unknown)),
        "false_alarm_rate": 1 - recalls[classes[0]],
    }
    for name, recall in recalls.items():
        scores[f"recall_{name}"] = recall
    if unknown is not None:
        for name, mask in masks.items():
            scores[f"unknown_{name}"] = share(unknown, mask)

    return scores
