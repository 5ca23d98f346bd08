"""Zero-shot: a classifier of faults without a measured one, trained on twins of healthy recordings only.

Every class of fault in training is synthetic; the tests are measured recordings, level L5: other recordings of pumps
whose twins were calibrated, and pumps without twins. Each machine has healthy recordings from its first days, so
features may be taken against these (`order_levels.AgainstHealthy`); they are never tested on.

Two rows are no rivals but ends of the scale: an oracle that learns from measured faults, and rules that learn
nothing. What a training set is worth before any fault was seen can be judged on *strangers*: synthetic windows of twins
drawn from the priors. By this the study chooses among what needs no measured fault, and tells how far it chose well.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from joblib import delayed
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import recall_score, roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict

from swashtwin.foundation import VERSION, InputError, derive_seed, parallel
from swashtwin.learning import (
    BiTCN,
    Classifier,
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    evaluate,
    extract_features,
    fit,
    fit_extra_trees,
)
from swashtwin.recordings import Recording
from swashtwin_bench.questions.zero_shot_data import (
    CALIBRATED,
    HEALTHY_ONLY,
    MEASURED_NORMALS,
    NOMINAL,
    ORACLE,
    POSTERIOR,
    SAME,
    ZeroShotData,
    ZeroShotSettings,
    prepare_zero_shot,
)
from swashtwin_bench.questions.zero_shot_prior import prior_trials
from swashtwin_bench.questions.zero_shot_table import (
    ENVELOPE_RULE,
    LEVELS,
    METRICS,
    NET,
    NET_HEALTHY,
    NOTES,
    RULE,
    TREES,
    TREES_HEALTHY,
    TREES_ORDERS,
    Fleet,
    Outcome,
    answer_of,
    confusions_of,
    describe_settings,
    trial_of,
)
from swashtwin_bench.results.table import StudyTable, origin_of
from swashtwin_bench.rigs.writing import RIG_VERSION, SIZES, rig_recordings
from swashtwin_bench.rivals.composed import NetworkOnView
from swashtwin_bench.rivals.order_levels import (
    CachedExtractor,
    Extractor,
    against_healthy,
    envelope_levels,
    highest_order,
    order_levels,
    order_lines,
)
from swashtwin_bench.rivals.order_threshold import OrderThreshold, rising_orders, threshold_orders
from swashtwin_bench.studies.priors import pump_of

ZERO_SHOT_SIZES = {
    "quick": ZeroShotSettings(
        training=TrainingSettings(epochs=12, learning_rate=2e-3, decay="cosine", normalization="set"),
        network={"stride": 64, "channels": (32,) * 5},
        order_network={"stride": 4, "channels": (32,) * 5},
    ),
    "prior": ZeroShotSettings(calibrated=False),
    "paper": ZeroShotSettings(
        windows=12,
        draws=8,
        synthetic=8,
        training=TrainingSettings(epochs=60, learning_rate=1e-3, decay="cosine", normalization="set"),
        network={"stride": 16},
        order_network={"stride": 2},
    ),
}
"""``quick`` takes about three minutes of CPU for each fleet; ``paper`` takes every window of a recording, and over five
times as many synthetic ones. ``prior`` compares the pump prior with the nominal twin and measured faults alone, in half
a minute."""

NETWORKS_ON = (POSTERIOR, ORACLE)
"""Training sets that networks learn from."""

PLAIN_ON = (NOMINAL, CALIBRATED, POSTERIOR, MEASURED_NORMALS, ORACLE)
"""Training sets that trees also learn from without a comparison with healthy recordings."""


def run_zero_shot(
    recordings: Sequence[Recording] | None = None,
    *,
    size: str | ZeroShotSettings = "quick",
    rig_version: str = RIG_VERSION,
    seeds: Iterable[int] = (0,),
    jobs: int = 1,
    progress: Callable[[str, int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Scores on measured faults of classifiers that saw none, by training set, classifier and test.

    Parameters
    ----------
    recordings : of several specimens, healthy ones at every pressure; None takes a fleet of the virtual rig for each
        seed.
    size : name in `ZERO_SHOT_SIZES`, or settings.
    rig_version : version of the virtual rig where there are no `recordings`.
    seeds : each draws the split, the twins, the faults and the weights anew, and the fleet where there are no
        `recordings`.
    jobs : seeds that run side by side.
    progress : called with (what, done, in all).
    command : command line that repeats the study, kept with the result.

    Raises
    ------
    DataError
        The recordings cannot be split so.
    InputError
        No seed.
    """
    started = time.perf_counter()
    settings = ZERO_SHOT_SIZES[size] if isinstance(size, str) else size
    seeds = tuple(seeds)
    if not seeds:
        raise InputError("the zero-shot study needs a seed.")
    running = parallel(jobs, return_as="generator")(
        delayed(_fleet)(recordings, settings, rig_version, seed) for seed in seeds
    )
    fleets = []
    for count, fleet in enumerate(running, 1):
        fleets.append(fleet)
        if progress is not None:
            progress("fleets" if recordings is None else "splits", count, len(seeds))
    classes = fleets[0].outcomes[0].scores.classes
    trials = tuple(
        trial
        for fleet in fleets
        for trial in (*fleet.by_recording, *(trial_of(outcome, fleet.seed) for outcome in fleet.outcomes))
    )
    study = StudyTable(
        study="zero-shot",
        title="Zero-shot: faults without a measured window",
        metrics={**METRICS, **{f"recall_{name}": f"recall {name.replace('_', ' ')}" for name in classes}},
        trials=trials,
        answer=(),
        settings={**describe_settings(settings), "fleets": "one for each seed" if recordings is None else "as given"},
        origin=fleets[0].origin,
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=NOTES,
        details={
            "classes": list(classes),
            "confusion": confusions_of(fleets),
            "rules": {str(fleet.seed): fleet.rules for fleet in fleets},
            "splits": {str(fleet.seed): fleet.roles for fleet in fleets},
            "level": LEVELS,
        },
    )
    return replace(study, answer=answer_of(study))


def _fleet(recordings: Sequence[Recording] | None, settings: ZeroShotSettings, rig_version: str, seed: int) -> Fleet:
    torch.set_num_threads(1)
    if recordings is None:
        recordings = [recording for recording, _ in rig_recordings(seed, SIZES["small"], version=rig_version)]
    origin = origin_of(recordings)
    data = prepare_zero_shot(recordings, settings, seed)
    views = _views(settings, data)
    outcomes = [outcome for name, train in data.sets.items() for outcome in _learn(name, train, data, views, settings)]
    rules = _rules(data, views)
    for name, rule in rules.items():
        outcomes += _score(HEALTHY_ONLY, name, rule, data)
    by_recording = tuple(prior_trials(recordings, data.split, seed))
    roles = {
        "pumps": list(data.split.pumps),
        "healthy": sorted(data.split.healthy),
        "oracle": sorted(data.split.faulty),
        **{name: sorted(ids) for name, ids in data.split.tests.items()},
    }
    rule_columns = {
        name: {label: list(columns) for label, columns in rule.rule.items()} for name, rule in rules.items()
    }
    return Fleet(seed, tuple(outcomes), by_recording, rule_columns, roles, origin)


def _views(settings: ZeroShotSettings, data: ZeroShotData) -> dict[str, Extractor]:
    """What classifiers look at, by name."""
    pistons = settings.pump.rotating_group.piston_count
    views: dict[str, Extractor] = {
        "usual": extract_features,
        "orders": partial(order_levels, piston_count=pistons, top=highest_order(data.healthy)),
        "lines": partial(order_lines, count=settings.orders),
        "envelope": envelope_levels,
    }
    return {name: CachedExtractor(view) for name, view in views.items()}


def _learn(
    name: str, train: WindowSet, data: ZeroShotData, views: Mapping[str, Extractor], settings: ZeroShotSettings
) -> Iterator[Outcome]:
    """Every classifier of one training set."""
    twin_windows = _twin_windows(name, data)
    references = data.healthy if twin_windows is None else data.healthy + twin_windows
    if data.strangers is not None:
        references = references + data.strangers
    views_taken: dict[str, Extractor] = {TREES_HEALTHY: against_healthy(views["orders"], references)}
    if name in PLAIN_ON and settings.calibrated:
        views_taken |= {TREES_ORDERS: views["orders"], TREES: views["usual"]}
    for kind, view in views_taken.items():
        trees = fit_extra_trees(
            train, seed=data.seed, manifest=data.manifest_of(name), features=view, n_trees=settings.trees
        )
        yield from _score(
            name,
            kind,
            trees,
            data,
            None if twin_windows is None else _discriminator(twin_windows, data, view, settings.trees // 3),
        )
    if name not in NETWORKS_ON or not settings.calibrated:
        return
    network = BiTCN(train.n_channels, len(train.classes), **settings.network)
    yield from _score(name, NET, _train_network(network, train, data, name, settings), data)
    lines = against_healthy(views["lines"], references)
    on_orders = BiTCN(train.n_channels, len(train.classes), **settings.order_network)
    fitted = _train_network(on_orders, _as_orders(train, lines), data, name, settings)
    yield from _score(name, NET_HEALTHY, NetworkOnView(fitted, partial(_as_orders, lines=lines)), data)


def _twin_windows(name: str, data: ZeroShotData) -> WindowSet | None:
    """All windows of the twins behind a training set, healthy ones included; None without a twin."""
    if name == ORACLE:
        return None
    train = data.sets[name]
    synthetic = train.subset(train.synthetic)
    return synthetic if np.any(synthetic.label == "normal") else data.sets[POSTERIOR]


def _train_network(
    network: BiTCN, train: WindowSet, data: ZeroShotData, name: str, settings: ZeroShotSettings
) -> FittedClassifier:
    return fit(network, train, settings=settings.training, seed=data.seed, manifest=data.manifest_of(name))


def _as_orders(windows: WindowSet, lines: Extractor) -> WindowSet:
    values = lines(windows).values.reshape(len(windows), windows.n_channels, -1)
    return replace(windows, signal=values.astype(np.float32))


def _rules(data: ZeroShotData, views: Mapping[str, Extractor]) -> dict[str, OrderThreshold]:
    """The rules that learn nothing: which lines rise is read off the nominal twin, thresholds off healthy windows."""
    nominal = data.sets[NOMINAL]
    rules = {}
    for name, view in ((RULE, views["orders"]), (ENVELOPE_RULE, views["envelope"])):
        relative = against_healthy(view, data.healthy + nominal)
        rule = rising_orders(relative(nominal), nominal)
        rules[name] = threshold_orders(data.healthy, relative, rule, manifest=data.manifest_of(NOMINAL))
    return rules


def _score(
    training_set: str, kind: str, classifier: Classifier, data: ZeroShotData, discriminator: float | None = None
) -> Iterator[Outcome]:
    strangers = float("nan")
    if training_set != HEALTHY_ONLY and data.strangers is not None:
        strangers = _recall(classifier, data.strangers)
    for test, windows in data.tests.items():
        level = "L5" if training_set != ORACLE else "L2" if test == SAME else "L4"
        scores = evaluate(classifier, windows, level=level)
        auroc = float("nan") if discriminator is None else discriminator
        recordings = _recall_of_recordings(classifier, windows)
        yield Outcome(training_set, kind, test, scores, recordings, strangers, auroc)


def _recall(classifier: Classifier, windows: WindowSet) -> float:
    """Macro recall over windows; of synthetic ones of strangers a choice's ground, never a score."""
    predicted = classifier.predict_proba(windows).argmax(axis=1)
    return float(recall_score(windows.target, predicted, average="macro"))


def _recall_of_recordings(classifier: Classifier, windows: WindowSet) -> float:
    """Macro recall over recordings, each answered by the mean logarithm of its windows' probabilities."""
    probability = np.log(np.maximum(classifier.predict_proba(windows), 1e-6))
    _, first, group = np.unique(windows.recording_id, return_index=True, return_inverse=True)
    pooled = np.stack([probability[group == index].mean(axis=0) for index in range(first.size)])
    names = np.array(classifier.classes)
    truth = np.array(windows.classes)[windows.target[first]]
    return float(recall_score(truth, names[pooled.argmax(axis=1)], average="macro", labels=np.unique(truth)))


def _discriminator(twin_windows: WindowSet, data: ZeroShotData, view: Extractor, n_trees: int) -> float:
    """AUROC of measured against synthetic healthy windows, each judged by trees that saw other pumps only."""
    measured = data.healthy.subset(np.isin(data.healthy.specimen, data.split.pumps))
    both = measured + twin_windows.subset(twin_windows.label == "normal")
    group = np.array([pump_of(name) for name in both.specimen.tolist()])
    if len(data.split.pumps) < 2:
        return float("nan")
    trees = ExtraTreesClassifier(
        n_trees, random_state=derive_seed(data.seed, "discriminator") % 2**32, class_weight="balanced", n_jobs=1
    )
    probability = cross_val_predict(
        trees,
        view(both).values,
        both.synthetic,
        groups=group,
        cv=GroupKFold(len(data.split.pumps)),
        method="predict_proba",
    )
    return float(roc_auc_score(both.synthetic, probability[:, 1]))
