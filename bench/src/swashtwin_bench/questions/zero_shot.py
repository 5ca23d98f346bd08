"""Zero-shot: a pump prior that saw no measured fault, beside measured faults, on recordings of the
virtual rig.

Every class of fault in the prior is synthetic; the tests are measured recordings, split L5. Each
machine has healthy recordings from its first days, which others are compared with; they are never
tested on. Measured faults also teach: a few of each beside the prior, or all of them alone (an
oracle).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
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
"""Healthy recordings of a pump and operating point that the prior is adapted to; half as many
test.
"""
HELD_OUT = 2
"""Pumps of which nothing teaches but healthy recordings."""

SAME, UNSEEN = "same pump", "unseen pump"
"""The tests: other recordings of pumps whose faults may teach, and pumps held out."""

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
"""Probability from which an answer counts as sure."""

PRIOR = "pump prior"
"""The training set without a measured fault."""
SHOTS = (1, 3, 5)
"""Measured recordings of each fault that teach it further."""


def few_shot(count: int) -> str:
    """Name of the training set with so many measured recordings of each fault."""
    return f"{PRIOR} and {count} of each fault"


def adapted_to(count: int, *, alone: bool = False) -> str:
    """Name of the training set of so many healthy recordings at each point, of a pump `alone` or of
    its fleet.
    """
    return f"{PRIOR}, {count} healthy{' of the pump alone' if alone else ''}"


def left_out(label: str) -> str:
    """Name of the training set whose prior does not hold a class."""
    return f"{PRIOR} without {label.replace('_', ' ')}"


SPLITS = {
    "no measured fault": "L5",
    f"measured faults, {SAME}": "L2",
    f"measured faults, {UNSEEN}": "L4",
}
"""Split of the rows, by what teaches and what tests them."""

_NOTES = (
    "Rows that no measured fault teaches are split L5. Rows that measured faults teach (the "
    "oracle, a few of each fault) are L2 on the same pumps and L4 on others. The pump prior has "
    "learned from healthy recordings of the same pumps, so its normals are L2 there.",
)


@dataclass(frozen=True, eq=False)
class ZeroShotSplit:
    """Recording ids by role."""

    pumps: tuple[str, ...]
    """Specimens of which measured faults may teach."""
    healthy: frozenset[str]
    """Healthy recordings, of every specimen, that nothing is tested on."""
    faulty: frozenset[str]
    """Faulty recordings of these specimens that may teach."""
    tests: Mapping[str, frozenset[str]]
    """Recordings of each test."""


def split_zero_shot(
    recordings: Sequence[Recording], seed: int, held_out: int = HELD_OUT, *, most: int | None = None
) -> ZeroShotSplit:
    """Recordings for training, for reference and for tests, under `seed`.

    Of each specimen, class and pressure a third of the recordings test (at least one, `most` at
    most); of specimens held out all the faulty ones do. A single faulty recording of a cell tests.

    Raises
    ------
    DataError
        Too few specimens, a class that no twin simulates, or a single healthy recording of a
        specimen at a pressure.
    """
    foreign = sorted({str(r.label) for r in recordings} - set(CLASSES))
    if foreign:
        raise DataError(
            f"the study simulates {', '.join(CLASSES)}, and no {foreign[0]!r}; leave those "
            "recordings out."
        )
    cells = recordings_by_cell(recordings, "the zero-shot study")
    specimens = sorted({str(r.specimen) for r in recordings})
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
        order = [cell[i].recording_id for i in rng.permutation(len(cell))]
        where, label = tests[UNSEEN if cell[0].specimen in unseen else SAME], cell[0].label
        if label == "normal" and len(order) < 2:
            raise DataError(
                f"{order[0]} is the only healthy recording of {cell[0].specimen} at its pressure; "
                "the study needs one to learn from and one to test."
            )
        count = min(max(1, len(order) // 3), most or len(order))
        trained_on = order[count:] if label == "normal" or cell[0].specimen not in unseen else []
        where |= set(order) - set(trained_on)
        (healthy if label == "normal" else faulty).update(trained_on)
    return ZeroShotSplit(
        tuple(name for name in specimens if name not in unseen),
        frozenset(healthy),
        frozenset(faulty),
        {name: frozenset(ids) for name, ids in tests.items()},
    )


def few_healthy(healthy: Sequence[Recording], count: int, seed: int) -> list[Recording]:
    """`count` recordings of each pump and operating point, all where there are fewer; fewer are
    among more.
    """
    rng, chosen = random_stream(seed, "few healthy"), []
    for specimen in sorted({str(recording.specimen) for recording in healthy}):
        own = [
            (item, item.condition)
            for item in healthy
            if item.specimen == specimen and item.condition
        ]
        for point in group_by_condition([condition for _, condition in own]):
            chosen += [own[index][0] for index in rng.permutation(point)[:count]]
    return chosen


@dataclass(frozen=True)
class ZeroShotSettings:
    """What is tested on."""

    rig: str = RIG_VERSION
    """Version of the virtual rig where no recordings are given."""
    healthy: tuple[int, ...] = ()
    """Healthy recordings of a pump and operating point that the prior is adapted to, in place of
    `HEALTHY`; then no measured fault teaches, no class is left out, and all numbers have the same
    tests.
    """


def zero_shot(
    work: Work, settings: ZeroShotSettings, recordings: Sequence[Recording] | None = None
) -> StudyTable:
    """Scores on measured faults of the pump prior, which saw none, and of what measured faults
    teach.

    Parameters
    ----------
    work : each seed draws the split and the measured faults anew, and the fleet where there are no
        `recordings`.
    recordings : of several specimens, healthy ones at every pressure; None takes fleets of the
        virtual rig.

    Raises
    ------
    DataError
        The recordings cannot be split so.
    """
    fleets = work.map("fleets", _fleet, [(recordings, settings, seed) for seed in work.seeds])
    roles = {
        str(seed): {
            "pumps": list(split.pumps),
            "healthy": sorted(split.healthy),
            "oracle": sorted(split.faulty),
            **{name: sorted(ids) for name, ids in split.tests.items()},
        }
        for seed, (_, split, _) in zip(work.seeds, fleets, strict=True)
    }
    study = StudyTable(
        study="zero-shot",
        title="Zero-shot: faults without a measured recording",
        metrics=METRICS,
        trials=tuple(trial for trials, *_ in fleets for trial in trials),
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
    pistons, most = dict[str, int](), None
    if recordings is None:
        size, points = SIZES["small"], len(VERSIONS[settings.rig].speeds)
        most = HEALTHY * points // 2
        healthy = replace(size, repeats=max(settings.healthy, default=HEALTHY) * points + most)
        pairs = [
            pair
            for labels, plan in ((CLASSES[:1], healthy), (CLASSES[1:], size))
            for pair in rig_recordings(seed, plan, labels=labels, version=settings.rig)
        ]
        recordings = [recording for recording, _ in pairs]
        if settings.rig in OTHER_DESIGNS:
            pistons = {run.specimen.name: len(run.specimen.clearances) for _, run in pairs}
    split = split_zero_shot(recordings, seed, most=most)
    if settings.healthy:
        trials = healthy_trials(recordings, split, seed, settings.healthy, pistons)
    else:
        trials = prior_trials(recordings, split, seed, pistons=pistons)
    return list(trials), split, describe_origin(recordings)


def _answer(study: StudyTable, healthy: Sequence[int]) -> tuple[str, ...]:
    """What came out, in sentences."""
    rows = {
        (row["training_set"], row["test"]): row["recording_balanced_accuracy"]["mean"]
        for row in study.rows()
    }

    def pair(training_set: str, tests: tuple[str, str] = (SAME, UNSEEN)) -> str:
        means = [rows.get((training_set, test)) for test in tests]
        return " / ".join("no number" if mean is None else f"{mean:.3f}" for mean in means)

    where = "Balanced accuracy by recording on the same pumps / on pumps held out"
    if healthy:
        sets = [adapted_to(count, alone=alone) for alone in (False, True) for count in healthy]
        return (f"{where}: {'; '.join(f'{name} {pair(name)}' for name in sets)}.",)
    shots = ", ".join(f"{count} of each {pair(few_shot(count))}" for count in SHOTS)
    return (
        f"{where}: {PRIOR}, no measured fault {pair(PRIOR)}; all measured faults {pair(ORACLE)}; "
        f"the prior and measured recordings of each fault: {shots}.",
    )


def prior_trials(
    recordings: Sequence[Recording],
    split: ZeroShotSplit,
    seed: int,
    prior: PriorClassifier | None = None,
    pistons: Mapping[str, int] | None = None,
) -> Iterator[Trial]:
    """Scores by recording, over the tests of a split.

    Parameters
    ----------
    split : its healthy recordings are what others are compared with, its faulty ones teach.
    seed : of the fleet; draws the measured recordings of few-shot.
    prior : the shipped one by default.
    pistons : number of pistons by specimen where they are not of the prior's design.
    """
    by_id = {recording.recording_id: recording for recording in recordings}
    shipped, pistons = prior or PriorClassifier.load(DESIGN), pistons or {}
    classes = shipped.classes[:-1]
    labels = {name: str(recording.label) for name, recording in by_id.items()}
    pool = {
        label: [name for name in sorted(split.faulty) if labels[name] == label]
        for label in classes[1:]
    }
    faulty = [name for names in pool.values() for name in names]

    def adapted(prior: PriorClassifier, taught: Sequence[str] = ()) -> dict[str, PriorClassifier]:
        return _adapted(prior, [by_id[name] for name in [*sorted(split.healthy), *taught]], pistons)

    own = adapted(shipped)
    classifiers = {
        PRIOR: own,
        **{left_out(label): adapted(_without(shipped, label)) for label in classes[1:]},
    }
    rng = random_stream(seed, "few-shot")
    draws = {label: rng.permutation(names).tolist() for label, names in pool.items() if names}
    for count in SHOTS:
        names = [name for drawn in draws.values() for name in drawn[:count]]
        if all(len(drawn) >= count for drawn in draws.values()) and names:
            classifiers[few_shot(count)] = adapted(shipped, names)
    tests = {test: [by_id[name] for name in sorted(ids)] for test, ids in split.tests.items()}
    for training_set, by_specimen in classifiers.items():
        yield from _scored(training_set, by_specimen, tests, seed)
    moves = np.concatenate(
        [part.healthy_changes() for part in {id(part): part for part in own.values()}.values()]
    )
    if faulty and len(moves):
        changes = {
            name: own[str(by_id[name].specimen)].change(by_id[name])[0] for name in sorted(by_id)
        }
        values = np.stack([*moves, *(changes[name] for name in faulty)]).reshape(
            len(moves) + len(faulty), -1
        )
        rows = np.array([0] * len(moves) + [classes.index(labels[name]) for name in faulty])
        forest = _forest(values, rows, len(classes), seed)
        for test, tested in tests.items():
            probability = forest(np.stack([changes[item.recording_id] for item in tested]))
            target = np.array([classes.index(str(item.label)) for item in tested])
            yield Trial(
                {"training_set": ORACLE, "test": test},
                seed,
                recording_scores(probability, target, classes),
            )


def healthy_trials(
    recordings: Sequence[Recording],
    split: ZeroShotSplit,
    seed: int,
    counts: Sequence[int],
    pistons: Mapping[str, int],
) -> Iterator[Trial]:
    """Scores of the shipped prior adapted to fewer healthy recordings at each point, of the fleet
    or of a pump alone.

    Parameters
    ----------
    split, seed, pistons : as those of `prior_trials`.
    counts : numbers of recordings.
    """
    shipped = PriorClassifier.load(DESIGN)
    healthy = [item for item in recordings if item.recording_id in split.healthy]
    tests = {
        name: [item for item in recordings if item.recording_id in ids]
        for name, ids in split.tests.items()
    }
    for alone in (False, True):
        for count in counts:
            by_specimen = _adapted(shipped, few_healthy(healthy, count, seed), pistons, alone=alone)
            yield from _scored(adapted_to(count, alone=alone), by_specimen, tests, seed)


def _adapted(
    prior: PriorClassifier,
    learned: Sequence[Recording],
    pistons: Mapping[str, int],
    *,
    alone: bool = False,
) -> dict[str, PriorClassifier]:
    """By specimen the classifier of its design, or of it `alone`."""
    specimens = dict.fromkeys(str(item.specimen) for item in learned)
    group_of = {specimen: specimen if alone else pistons.get(specimen) for specimen in specimens}
    fitted = {}
    for group in sorted(set(group_of.values()), key=str):
        known = [item for item in learned if group_of[str(item.specimen)] == group]
        fitted[group] = prior.fit(known, pistons=pistons.get(str(known[0].specimen)))
    return {specimen: fitted[group] for specimen, group in group_of.items()}


def _scored(
    training_set: str,
    by_specimen: Mapping[str, PriorClassifier],
    tests: Mapping[str, Sequence[Recording]],
    seed: int,
) -> Iterator[Trial]:
    for test, recordings in tests.items():
        answers = [by_specimen[str(item.specimen)].diagnose(item) for item in recordings]
        probability = np.array(
            [[answer.probabilities.get(name, 0.0) for name in CLASSES] for answer in answers]
        )
        unknown = np.array([answer.unknown for answer in answers])
        target = np.array([CLASSES.index(str(item.label)) for item in recordings])
        factors = {"training_set": training_set, "test": test}
        yield Trial(factors, seed, recording_scores(probability, target, CLASSES, unknown))


def _forest(
    values: np.ndarray, target: np.ndarray, n_classes: int, seed: int
) -> Callable[[np.ndarray], np.ndarray]:
    """Random forest, classes weighted alike; a class without a row has no probability."""
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
    """The prior without the virtual recordings of a class, which is then none of its classes."""
    virtual, index = prior.virtual, prior.classes.index(label)
    assert virtual is not None
    kept = virtual.target != index
    target = virtual.target[kept] - (virtual.target[kept] > index)
    virtual = replace(
        virtual, change=virtual.change[kept], target=target, number=virtual.number[kept]
    )
    return replace(
        prior, virtual=virtual, classes=tuple(name for name in prior.classes if name != label)
    )


def recording_scores(
    probability: np.ndarray,
    target: np.ndarray,
    classes: Sequence[str],
    unknown: np.ndarray | None = None,
) -> Mapping[str, float]:
    """Scores of the likeliest class by recording; the first class is the healthy one.

    Parameters
    ----------
    unknown : whether each was called unknown, which counts as not sure; None where nothing says so.
    """
    predicted = probability.argmax(axis=1)
    doubt = np.zeros(len(target), dtype=bool) if unknown is None else unknown
    of_class = {name: target == index for index, name in enumerate(classes)}

    def share(hit: np.ndarray, mask: np.ndarray) -> float:
        return float(np.mean(hit[mask])) if mask.any() else float("nan")

    recalls = {name: share(predicted == target, mask) for name, mask in of_class.items()}
    return {
        "recording_balanced_accuracy": float(np.nanmean(list(recalls.values()))),
        "recording_accuracy": float(np.mean(predicted == target)),
        "sure_and_wrong": float(
            np.mean((predicted != target) & (probability.max(axis=1) >= SURE) & ~doubt)
        ),
        "unknown": float("nan") if unknown is None else float(np.mean(doubt)),
        "false_alarm_rate": 1 - recalls[classes[0]],
        **{f"recall_{name}": recall for name, recall in recalls.items()},
        **{
            f"unknown_{name}": share(doubt, mask)
            for name, mask in of_class.items()
            if unknown is not None
        },
    }
