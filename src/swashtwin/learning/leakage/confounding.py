"""Does something that is no vibration give the class away? A test for every fact and every level of the recordings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from jaxtyping import Float, Float64, Int, Int64
from scipy.special import rel_entr
from sklearn.metrics import balanced_accuracy_score
from sklearn.model_selection import StratifiedGroupKFold, cross_val_predict
from sklearn.tree import DecisionTreeClassifier

from swashtwin.foundation import DataError, UnitError, holm_correction, parse, stream
from swashtwin.recordings import Recording, stated_pressure, stated_speed

FALSE_ALARMS = 0.05
"""Share of data sets with classes dealt out at random that get any warning, at most."""
_EFFECT = 0.3
"""Share of the way from guessing to certainty from which a warning is worth a reader's time."""
_PERMUTATIONS = 1999
"""Dealings at least."""
_BINS = 6
_DATES = ("date", "time", "datetime", "timestamp", "measured", "recorded")
_COLUMNS = ("speed", "discharge_pressure", "oil_temperature", "temperature")
_NAMES_OF_FILES = ("file", "sha256", "header", "units", "record", "cycle", "index")
_ADVICE = {
    "set-up": "measure all classes with the same set-up, or undo the difference before training (resample, remove the "
    "offset, normalize each window)",
    "level": "a fault may change the level, but so do amplifier, sensor mounting and load: train with normalized "
    "windows as well and see what is left",
    "condition": "measure every class at every operating point, or hold a point out (--group condition)",
    "place": "measure every class on several of these, and hold whole ones out (--group)",
    "label": "if it is the class by another name, it is no trouble; it must not enter as a feature",
}


@dataclass(frozen=True)
class Confounding:
    """How well one thing alone tells the class."""

    attribute: str
    """What it is, such as ``"sample rate"`` or ``"offset of drive_end"``."""
    kind: str
    """``set-up``, ``level``, ``condition``, ``place`` (machine, day, run) or ``label`` (one value for each class)."""
    balanced_accuracy: float
    """Of a shallow tree that sees nothing else, on recordings (and machines, where these allow it) held out."""
    chance: float
    """Balanced accuracy of guessing: 1 / number of classes."""
    p_value: float
    """Chance of a dependence as strong where classes are dealt at random, corrected by Holm for all that was tested."""
    is_warning: bool
    """Whether it should be looked at: `p_value` below the share of false alarms, and the dependence strong."""
    message: str
    """The finding and what to do."""


@dataclass(frozen=True, eq=False)
class _Column:
    name: str
    kind: str
    values: Float[np.ndarray, " recording"]
    """Numbers; codes where it is a name."""
    is_name: bool


def confounding(
    recordings: Sequence[Recording], *, false_alarms: float = FALSE_ALARMS, seed: int = 0
) -> tuple[Confounding, ...]:
    """How well rate, offset, level, temperature, date, specimen and every attribute alone tell the class, worst first.

    A value is binned (names are their own bins); its mutual information with the class is compared with that of
    classes dealt anew: to whole machines where each has one class and there are machines enough that such a test could
    warn, and to recordings otherwise (recordings of one machine are alike, so that warns sooner; the accuracy is that
    on machines held out where a class has two). The tests are exact at any size and distribution, and Holm's correction
    holds the share of sets with any warning below `false_alarms`. A further fact, one specimen for each class, is no
    matter of chance and is always told.

    Parameters
    ----------
    recordings : with labels; those without one are passed over.
    false_alarms : share of sets with random classes that may get a warning.
    seed : seed of the dealings.

    Raises
    ------
    DataError
        Fewer than two classes.
    """
    labeled = [recording for recording in recordings if recording.label]
    classes, target = np.unique([str(recording.label) for recording in labeled], return_inverse=True)
    if len(classes) < 2:
        raise DataError(f"{len(classes)} class(es) among {len(recordings)} recordings; two can be told apart.")
    machine = np.unique([recording.specimen or recording.recording_id for recording in labeled], return_inverse=True)[1]
    columns = _columns(labeled)
    least = math.ceil(4 * len(columns) / false_alarms)  # dealings from which on Holm's least p can pass
    unit = machine if _ways_to_deal(machine, target) >= least else np.arange(len(labeled))
    count = max(_PERMUTATIONS, least)
    permuted = _dealings(target, unit, count, seed)
    raw = np.array([_p_value(_bins(column), target, permuted) for column in columns])
    corrected = holm_correction(raw)
    results = [
        _result(column, float(p), target, machine, classes.tolist(), false_alarms, seed)
        for column, p in zip(columns, corrected, strict=True)
    ]
    results += _one_machine_each(labeled, classes.tolist())
    return tuple(sorted(results, key=lambda result: (not result.is_warning, result.p_value, -result.balanced_accuracy)))


def _columns(recordings: Sequence[Recording]) -> list[_Column]:
    """Every fact of the recordings that is not the same for all."""
    numbers: list[tuple[str, str, list[float]]] = [
        ("sample rate", "set-up", [recording.sample_rate for recording in recordings]),
        ("length", "set-up", [recording.duration for recording in recordings]),
        ("speed", "condition", [stated_speed(recording) or math.nan for recording in recordings]),
        ("discharge pressure", "condition", [stated_pressure(recording) for recording in recordings]),
        ("oil temperature", "condition", [_temperature(recording) for recording in recordings]),
        ("date", "place", [_date(recording) for recording in recordings]),
    ]
    names: list[tuple[str, str, list[str]]] = [
        ("specimen", "place", [recording.specimen or "" for recording in recordings]),
        ("unit", "set-up", [recording.unit for recording in recordings]),
        ("channels", "set-up", [", ".join(recording.channels) for recording in recordings]),
    ]
    shared = set.intersection(*({*recording.channels} for recording in recordings))
    for channel in [name for name in recordings[0].channels if name in shared]:
        rows = [recording.signal[recording.channels.index(channel)] for recording in recordings]
        numbers.append((f"offset of {channel}", "set-up", [float(np.nanmean(row)) for row in rows]))
        numbers.append((f"level of {channel}", "level", [float(np.nanstd(row)) for row in rows]))
        numbers.append((f"converter step of {channel}", "set-up", [_step(row) for row in rows]))
    attributes = set.intersection(*({*recording.attributes} for recording in recordings))
    for name in sorted(attributes - {*_COLUMNS, *_NAMES_OF_FILES, *_DATES}):
        names.append((name, "place", [str(recording.attributes[name]) for recording in recordings]))
    columns = [_Column(name, kind, np.array(values, dtype=np.float64), False) for name, kind, values in numbers]
    columns += [
        _Column(name, kind, np.unique(values, return_inverse=True)[1].astype(np.float64), True)
        for name, kind, values in names
        if 2 * len(set(values)) <= len(values)  # a name of its own for nearly each recording tells nothing
    ]
    return [column for column in columns if np.unique(column.values).size > 1 and not np.isnan(column.values).all()]


def _temperature(recording: Recording) -> float:
    if recording.condition is not None:
        return recording.condition.oil_temperature
    for name in ("oil_temperature", "temperature"):
        try:
            return parse(str(recording.attributes[name]), "K")
        except (KeyError, UnitError):
            continue
    return math.nan


def _date(recording: Recording) -> float:
    """Seconds since 1970 of the first attribute that says when [s], or NaN."""
    for name in _DATES:
        try:
            return datetime.fromisoformat(str(recording.attributes[name])).timestamp()
        except (KeyError, ValueError):
            continue
    return math.nan


def _step(row: Float[np.ndarray, " time"]) -> float:
    """Distance of neighboring converter steps, or NaN where samples are no steps of one size."""
    values = np.unique(row)
    if not 2 < len(values) < len(row) / 2:
        return math.nan
    gaps = np.diff(values)
    step = float(gaps.min())
    return float(f"{step:.2g}") if np.abs(gaps / step - np.round(gaps / step)).max() < 0.05 else math.nan


def _bins(column: _Column) -> Int64[np.ndarray, " recording"]:
    """Bin of each recording; numbers of many values lie in bins of like count, missing values have their own."""
    present = column.values[~np.isnan(column.values)]
    if column.is_name or np.unique(present).size <= _BINS:
        return np.unique(column.values, return_inverse=True)[1].astype(np.int64)
    count = min(_BINS, max(2, present.size // 8))  # few recordings in many bins tell nothing apart
    edges = np.unique(np.quantile(present, np.linspace(0, 1, count + 1)[1:-1]))
    return np.where(np.isnan(column.values), len(edges) + 1, np.searchsorted(edges, column.values)).astype(np.int64)


def _ways_to_deal(machine: Int[np.ndarray, " recording"], target: Int[np.ndarray, " recording"]) -> int:
    """In how many ways the smallest class can be dealt to whole machines; 0 where a machine has several classes."""
    pairs = np.unique(np.stack([machine, target]), axis=1)
    count = int(np.unique(machine).size)
    return math.comb(count, int(np.bincount(pairs[1]).min())) if pairs.shape[1] == count else 0


def _dealings(
    target: Int[np.ndarray, " recording"], unit: Int[np.ndarray, " recording"], count: int, seed: int
) -> Int[np.ndarray, "dealing recording"]:
    """Classes dealt anew to whole units."""
    random = stream(seed, "confounding")
    units, first = np.unique(unit, return_index=True)
    of_unit = target[first]
    order = np.searchsorted(units, unit)
    return np.stack([random.permutation(of_unit)[order] for _ in range(count)])


def _p_value(
    bins: Int[np.ndarray, " recording"],
    target: Int[np.ndarray, " recording"],
    permuted: Int[np.ndarray, "dealing recording"],
) -> float:
    """Share of dealings, this one among them, whose mutual information with the bins is as great."""
    observed, *chance = _information(bins, np.concatenate([target[None], permuted]))
    return float((1 + np.count_nonzero(np.array(chance) >= observed - 1e-12)) / (1 + len(chance)))


def _information(
    bins: Int[np.ndarray, " recording"], classes: Int[np.ndarray, "dealing recording"]
) -> Float64[np.ndarray, " dealing"]:
    """Mutual information of bins and classes [nat] in each dealing."""
    n_bins, n_classes = int(bins.max()) + 1, int(classes.max()) + 1
    cell = (np.arange(len(classes))[:, None] * n_bins + bins) * n_classes + classes
    counts = np.bincount(cell.ravel(), minlength=len(classes) * n_bins * n_classes)
    share = counts.reshape(-1, n_bins, n_classes) / len(bins)
    independent = share.sum(axis=2, keepdims=True) * share.sum(axis=1, keepdims=True)
    return np.asarray(rel_entr(share, independent).sum(axis=(1, 2)))


def _result(
    column: _Column,
    p_value: float,
    target: Int[np.ndarray, " recording"],
    machine: Int[np.ndarray, " recording"],
    classes: list[str],
    false_alarms: float,
    seed: int,
) -> Confounding:
    chance = 1 / len(classes)
    accuracy = _held_out_accuracy(column, target, machine, seed)
    is_warning = p_value <= false_alarms and (accuracy - chance) / (1 - chance) >= _EFFECT
    bins = _bins(column)
    renamed = column.is_name and np.unique(bins).size == len(classes) and _one_class_each_way(bins, target)
    kind = "label" if renamed else column.kind
    strength = "alone tells" if is_warning else "does not tell"
    message = (
        f"{column.name} {strength} the class: {accuracy:.0%} of each class are told right by it alone, guessing gives "
        f"{chance:.0%} (p = {p_value:.2g})"
    )
    text = f"{message}. A classifier can learn it in place of the fault; {_ADVICE[kind]}." if is_warning else message
    return Confounding(column.name, kind, accuracy, chance, p_value, is_warning, text)


def _held_out_accuracy(
    column: _Column, target: Int[np.ndarray, " recording"], machine: Int[np.ndarray, " recording"], seed: int
) -> float:
    """Balanced accuracy of a tree of at most as many leaves as bins, machines held out where each class has two."""
    pairs = np.unique(np.stack([machine, target]), axis=1)
    by_machine = int(np.bincount(pairs[1]).min()) > 1
    groups = machine if by_machine else np.arange(len(target))
    fewest = int(np.bincount(pairs[1] if by_machine else target).min())
    if fewest < 2:
        return float(balanced_accuracy_score(target, _majority(_bins(column), target)))
    values = np.where(np.isnan(column.values), np.nanmin(column.values) - 1, column.values)
    features = (values[:, None] == np.unique(values)).astype(np.float64) if column.is_name else values[:, None]
    tree = DecisionTreeClassifier(max_leaf_nodes=2 * _BINS, class_weight="balanced", random_state=0)
    folds = StratifiedGroupKFold(n_splits=min(5, fewest), shuffle=True, random_state=seed)
    return float(balanced_accuracy_score(target, cross_val_predict(tree, features, target, groups=groups, cv=folds)))


def _majority(
    bins: Int[np.ndarray, " recording"], target: Int[np.ndarray, " recording"]
) -> Int[np.ndarray, " recording"]:
    """Class that is commonest, for its size, in each recording's bin."""
    counts = np.zeros((int(bins.max()) + 1, int(target.max()) + 1))
    np.add.at(counts, (bins, target), 1.0)
    chosen: np.ndarray = (counts / counts.sum(axis=0)).argmax(axis=1)[bins]
    return chosen


def _one_class_each_way(bins: Int[np.ndarray, " recording"], target: Int[np.ndarray, " recording"]) -> bool:
    return np.unique(np.stack([bins, target]), axis=1).shape[1] == np.unique(target).size


def _one_machine_each(recordings: Sequence[Recording], classes: Sequence[str]) -> list[Confounding]:
    """A warning for classes that stand on one specimen only, which has no other class."""
    pairs = {(recording.label, recording.specimen) for recording in recordings}
    machines = {name: [specimen for label, specimen in pairs if label == name] for name in classes}
    alone = [
        name
        for name, specimens in machines.items()
        if len(specimens) == 1 and specimens[0] and sum(specimen == specimens[0] for _, specimen in pairs) == 1
    ]
    if not alone:
        return []
    message = (
        f"{', '.join(alone)}: measured on one specimen only, which has no other class. Whatever is special about that "
        "machine tells the class, and no test on these recordings can show that it is the fault; measure the class on "
        "another machine, or this machine in another class."
    )
    return [Confounding("one specimen", "place", math.nan, 1 / len(classes), 0.0, True, message)]
