"""Hydraulic rig with a leaking pump: what is lost of the pump's flow, at its pressure, power and temperature."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from sklearn.model_selection import GroupKFold

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording
from swashtwin_bench.public.question import Fold, Question, Setting, Split, units_of

_OPEN, _CLOSED, _LAST = slice(13, 19), slice(4, 9), slice(52, 59)
"""Seconds of the rig's cycle of 60: flow at moderate load, flow blocked (all of it over the relief valve), the end."""
_PHASES = {"moderate": (_OPEN,), "moderate, blocked": (_OPEN, _CLOSED), "moderate, end": (_OPEN, _LAST)}
_PARTS = 12


def hydraulic_splits(recordings: Sequence[Recording]) -> list[Split]:
    """The splits ``uci_hydraulic/pump_run`` and ``uci_hydraulic/cooler``."""
    splits = []
    for name, attribute in (("pump_run", "pump_run"), ("cooler", "cooler_block")):

        def group(recording: Recording, attribute: str = attribute) -> str:
            return recording.attributes[attribute]

        folds = _folds([group(recording) for recording in recordings])
        splits.append(Split(f"uci_hydraulic/{name}", tuple(recordings), group, folds))
    return splits


def hydraulic_questions(recordings: Sequence[Recording], jobs: int) -> list[Question]:
    """The questions ``uci_hydraulic/pump_run`` and ``uci_hydraulic/cooler``."""
    del jobs  # nothing here takes long
    features = {
        f"{kind} ({name})": _pump_features(recordings, phases, kind)
        for name, phases in _PHASES.items()
        for kind in ("flow", "flow, pressure, power", "efficiency", "all")
    }
    estimators = ("linear discriminant", "curved discriminant", "logistic 1")
    settings = tuple(Setting(name, estimator) for name in features for estimator in estimators)
    usual = {"usual": _usual(recordings)}
    questions = []
    for split in hydraulic_splits(recordings):
        units = units_of(recordings, split.group, split.group, features)
        windows = units_of(recordings, split.group, split.group, usual)
        questions.append(Question(split.name, units, settings, split.folds, windows))
    return questions


def _folds(group: Sequence[str]) -> tuple[Fold, ...]:
    """Each group held out where there are three, five folds of whole groups (`GroupKFold`) where there are more."""
    group_of, groups = np.array(group), np.unique(group)
    if len(groups) < 2:
        raise DataError("the cycles are of one group only, so nothing can be held out; take the whole set.")
    if len(groups) <= 3:
        return tuple(
            Fold(str(group), frozenset(groups.tolist()) - {str(group)}, frozenset({str(group)})) for group in groups
        )
    ids = np.array([int(text) for text in group])
    sides = GroupKFold(5).split(np.zeros(len(ids)), groups=ids)
    return tuple(
        Fold(f"fold {number}", frozenset(group_of[train].tolist()), frozenset(group_of[test].tolist()))
        for number, (train, test) in enumerate(sides, start=1)
    )


def _pump_features(
    recordings: Sequence[Recording], phases: tuple[slice, ...], kind: str
) -> Float[np.ndarray, "cycle feature"]:
    """Medians over phases: flow FS1, pressure PS1, motor power EPS1, their efficiency log(Q p / P), and oil TS1."""
    columns = []
    for phase in phases:
        flow, pressure, power = (_median(recordings, name, phase) for name in ("FS1", "PS1", "EPS1"))
        if phase is _CLOSED:  # the meter reads nothing
            efficiency = np.log(pressure / power)
            features = {"flow": [], "flow, pressure, power": [pressure, power], "efficiency": [efficiency]}
            columns += features.get(kind, [pressure, power, efficiency])
        else:
            passed = np.maximum(flow, 1e-3)
            efficiency = np.log(passed * pressure / power)
            features = {
                "flow": [flow],
                "flow, pressure, power": [flow, pressure, power],
                "efficiency": [np.log(passed), efficiency],
            }
            columns += features.get(kind, [flow, pressure, power, efficiency])
    return np.stack([*columns, _median(recordings, "TS1", slice(0, 60))], axis=1)


def _median(recordings: Sequence[Recording], channel: str, seconds: slice) -> Float[np.ndarray, " cycle"]:
    row = recordings[0].channels.index(channel)
    rate = round(recordings[0].sample_rate)
    first, last = seconds.start * rate, seconds.stop * rate
    return np.array([np.median(recording.signal[row, first:last]) for recording in recordings])


def _usual(recordings: Sequence[Recording]) -> Float[np.ndarray, "cycle feature"]:
    """Mean and deviation of every sensor in twelve parts of the cycle."""
    signal = np.stack([recording.signal for recording in recordings])
    parts = signal.reshape(*signal.shape[:2], _PARTS, -1)
    return np.concatenate([parts.mean(axis=3), parts.std(axis=3)], axis=2).reshape(len(signal), -1)
