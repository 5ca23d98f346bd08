"""Whether a classifier's confidence holds: on pumps that it was trained on, on others, and on a fault left out of
training."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.metrics import roc_auc_score

from swashtwin.learning import (
    FittedClassifier,
    WindowSet,
    cut_windows,
    learn_confidence,
    recording_answers,
    score_confidence,
)
from swashtwin.pump import CLASSES
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Task, Work, fingerprint_of
from swashtwin_bench.results.table import StudyTable, Trial, origin_of, paired_interval
from swashtwin_bench.rigs.writing import RigSize, rig_recordings
from swashtwin_bench.rivals.models import Model, models_of, train_model

VALIDATION = {"same": "other recordings of the training's pumps", "other": "recordings of other pumps"}
"""Recordings that the confidence is learned from."""

CROSS_FITTED = "training"
"""Confidence that the training itself learned from its recordings, where it does."""

LEVELS = ("L2", "L4")

METRICS = {
    "accuracy": "named right",
    "ece_before": "ECE before",
    "ece_after": "ECE after",
    "log_loss_before": "log loss before [nat]",
    "log_loss_after": "log loss after [nat]",
    "coverage": "sets that hold the class",
    "set_size": "classes per set",
    "called_unknown": "wrongly called unknown",
    "unknown_caught": "left-out class called unknown",
    "unknown_auroc": "AUROC of unknown, by features",
    "probability_auroc": "AUROC of unknown, by probability",
    **{f"auroc_{label}": f"AUROC of unknown, {label.replace('_', ' ')} left out" for label in CLASSES},
}
"""Heading of each figure; all count recordings."""


@dataclass(frozen=True)
class ConfidenceStudySettings:
    """How much is recorded, and how classifiers are trained on it."""

    classifiers: tuple[str, ...] = ("bitcn", "extra_trees")
    """Names of `models_of`, such as ``"chosen"``, what `FaultClassifier` trains by itself. The first is compared with
    the others."""
    trained_pumps: int = 3
    """Pumps trained on. Of each class and pressure one recording trains, one sets the confidence, one tests at L2."""
    validation_pumps: int = 2
    """Further pumps whose recordings set the confidence."""
    unseen_pumps: int = 2
    """Further pumps that test at L4."""
    duration: float = 0.7
    """Length of each recording [s]."""
    length: int = 2048
    """Samples per window."""
    error_rate: float = 0.1
    """Asked of prediction sets and of calling unknown."""


def confidence(work: Work, settings: ConfidenceStudySettings) -> StudyTable:
    """Calibration error, coverage, set size and the unknown, by validation recordings and level of test.

    Parameters
    ----------
    work : its seeds are fleets of the virtual rig; each draws pumps, recordings and weights anew.
    settings : how much is recorded, and how classifiers are trained on it.
    """
    values: dict[tuple[str, str, str, int], dict[str, float]] = {}
    roles: dict[str, int] = {}
    trainings = [(kind, left_out) for kind in settings.classifiers for left_out in (None, *CLASSES)]
    for seed in work.seeds:
        parts = record_roles(seed, settings)
        roles = roles or {name: len(group) for name, group in parts.items()}
        origin = origin_of(parts["train"])
        cases = [(parts, kind, left_out, seed, settings, work.out) for kind, left_out in trainings]
        runs = work.each(f"trainings on fleet {seed}", _run, cases)
        for (kind, _), run in zip(trainings, runs, strict=True):
            for validation, by_level in run["results"].items():
                for level, numbers in by_level.items():
                    values.setdefault((kind, validation, level, seed), {}).update(numbers)
    trials = tuple(
        Trial(
            {"classifier": kind, "validation": validation, "level": level},
            seed,
            _average(values[kind, validation, level, seed]),
        )
        for kind in settings.classifiers
        for validation in (*VALIDATION, CROSS_FITTED)
        for level in LEVELS
        for seed in work.seeds
        if (kind, validation, level, seed) in values
    )
    study = StudyTable(
        study="confidence",
        title="Does a classifier know when it may be wrong?",
        metrics=METRICS,
        trials=trials,
        answer=(),
        settings=asdict(settings),
        origin=origin,
        notes=_NOTES,
        details={"recordings": roles, "validation": VALIDATION},
    )
    return replace(study, answer=tuple(_answer(study)))


_NOTES = (
    "Test sets hold 30 to 45 recordings each: the ECE of so few is 0.07 to 0.16 even for a perfect classifier, and a "
    "coverage scatters by about 0.05.",
    "A left-out class is left out of training, validation and the known side of the test; its recordings at the level "
    "are the strange ones. BiTCN and trees know recordings by the same levels, so the figures of the unknown by "
    "features are the same for both.",
)


def record_roles(seed: int, settings: ConfidenceStudySettings) -> dict[str, list[Recording]]:
    """Recordings by role; the rig gives the same ones whichever others are taken with them."""
    trained = RigSize(settings.trained_pumps, 3, settings.duration)
    all_pumps = RigSize(
        settings.trained_pumps + settings.validation_pumps + settings.unseen_pumps, 1, settings.duration
    )
    of_trained = [recording for recording, _ in rig_recordings(seed, trained)]
    names = sorted({str(recording.specimen) for recording in of_trained})
    of_others = [recording for recording, _ in rig_recordings(seed, all_pumps) if recording.specimen not in names]
    validation = sorted({str(recording.specimen) for recording in of_others})[: settings.validation_pumps]
    return {
        "train": [recording for recording in of_trained if recording.recording_id.endswith("_1")],
        "same": [recording for recording in of_trained if recording.recording_id.endswith("_2")],
        "other": [recording for recording in of_others if recording.specimen in validation],
        "L2": [recording for recording in of_trained if recording.recording_id.endswith("_3")],
        "L4": [recording for recording in of_others if recording.specimen not in validation],
    }


def _run(
    parts: Mapping[str, list[Recording]],
    kind: str,
    left_out: str | None,
    seed: int,
    settings: ConfidenceStudySettings,
    out: Path | None,
) -> dict[str, Any]:
    plain = {name: value for name, value in asdict(settings).items() if name != "classifiers"}
    factors = {"classifier": kind, "left_out": left_out or "none"}
    data = fingerprint_of(recording for recordings in parts.values() for recording in recordings)
    task = Task("confidence", seed, factors, {**plain, "model": _model(kind).describe()}, data)
    return task.run(out, lambda: {"results": _training(parts, kind, left_out, seed, settings)})


def _training(
    parts: Mapping[str, list[Recording]],
    kind: str,
    left_out: str | None,
    seed: int,
    settings: ConfidenceStudySettings,
) -> dict[str, dict[str, dict[str, float]]]:
    """Figures by validation recordings and level of one training, on all classes or on all but one."""
    classes = tuple(name for name in CLASSES if name != left_out)
    cut = {
        role: cut_windows(
            [recording for recording in recordings if recording.label != left_out],
            length=settings.length,
            classes=classes,
        )
        for role, recordings in parts.items()
    }
    classifier = train_model(_model(kind), cut["train"], seed=seed)
    sure_classifiers = {
        validation: learn_confidence(classifier, cut[validation], error_rate=settings.error_rate)
        for validation in VALIDATION
    }
    if classifier.confidence is not None:
        sure_classifiers[CROSS_FITTED] = classifier
    results: dict[str, dict[str, dict[str, float]]] = {}
    for validation, sure_classifier in sure_classifiers.items():
        for level in LEVELS:
            if left_out is None:
                scores = score_confidence(sure_classifier, cut[level], error_rate=settings.error_rate)
                wanted = METRICS.keys() & scores.to_dict().keys() - {"unknown_auroc"}
                values = {name: getattr(scores, name) for name in METRICS if name in wanted}
            else:
                strange = [part.relabeled(None) for part in parts[level] if part.label == left_out]
                foreign = cut_windows(strange, length=settings.length, classes=classes)
                values = _unknown(sure_classifier, cut[level], foreign, left_out, settings.error_rate)
            results.setdefault(validation, {})[level] = values
    return results


def _model(kind: str) -> Model:
    return models_of("quick", [kind])[kind]


def _unknown(
    classifier: FittedClassifier, test: WindowSet, foreign: WindowSet, left_out: str, error_rate: float
) -> dict[str, float]:
    """How well recordings of the class left out are separated from those of the trained classes."""
    familiar, strange = recording_answers(classifier, test), recording_answers(classifier, foreign)
    confidence = classifier.confidence
    is_strange = np.repeat([False, True], [len(familiar.target), len(strange.target)])
    doubt = 1 - np.concatenate([familiar.probability.max(axis=1), strange.probability.max(axis=1)])
    caught = math.nan
    if confidence is not None:
        caught = float(np.mean(confidence.ood_p_value(strange.ood_score) <= error_rate))
    ood_score = np.concatenate([familiar.ood_score, strange.ood_score])
    return {
        f"auroc_{left_out}": float(roc_auc_score(is_strange, ood_score)),
        f"probability_auroc of {left_out}": float(roc_auc_score(is_strange, doubt)),
        f"unknown_caught of {left_out}": caught,
    }


def _average(values: Mapping[str, float]) -> dict[str, float]:
    """The figures, and the means over the classes left out."""
    means = {
        "unknown_auroc": [values[f"auroc_{label}"] for label in CLASSES],
        "probability_auroc": [values[f"probability_auroc of {label}"] for label in CLASSES],
        "unknown_caught": [values[f"unknown_caught of {label}"] for label in CLASSES],
    }
    averages = {name: value for name, value in values.items() if name in METRICS}
    return {**averages, **{name: float(np.mean(mean)) for name, mean in means.items()}}


def _answer(study: StudyTable) -> Iterator[str]:
    kinds = list(dict.fromkeys(trial.factors["classifier"] for trial in study.trials))
    for kind in sorted(kinds):
        for validation, level in _rows_told(study, kind):
            mean = {
                name: float(np.nanmean(study.values(name, classifier=kind, validation=validation, level=level)))
                for name in METRICS
            }
            yield (
                f"{kind}, confidence learned from {_learned_from(validation)}, at {level}: sets asked to hold "
                f"{1 - _rate(study):.0%} of the true classes hold {mean['coverage']:.0%} with "
                f"{mean['set_size']:.2f} classes each; calibration error {mean['ece_before']:.3f} before and "
                f"{mean['ece_after']:.3f} after the temperature; a class left out is called unknown in "
                f"{mean['unknown_caught']:.0%} (AUROC {mean['unknown_auroc']:.2f}), a known one in "
                f"{mean['called_unknown']:.0%}."
            )
    for rival in kinds[1:]:
        for level in LEVELS:
            values = [study.values("unknown_auroc", classifier=kind, validation="same", level=level) for kind in kinds]
            differences = np.subtract(values[0], values[kinds.index(rival)])
            low, high = paired_interval(differences.tolist())
            yield (
                f"AUROC of unknown at {level}, {kinds[0]} less {rival}, paired by fleet (n = {len(differences)}): "
                f"{differences.mean():+.3f} ({low:+.3f} to {high:+.3f})."
            )


def _rows_told(study: StudyTable, kind: str) -> list[tuple[str, str]]:
    """(validation recordings, level) that the answer is about."""
    trained = [(CROSS_FITTED, level) for level in LEVELS if study.of(classifier=kind, validation=CROSS_FITTED)]
    return [*trained, ("same", "L2"), ("same", "L4"), ("other", "L4")]


def _learned_from(validation: str) -> str:
    return VALIDATION.get(validation, "the training recordings, cross-fitted")


def _rate(study: StudyTable) -> float:
    return float(study.settings["error_rate"])
