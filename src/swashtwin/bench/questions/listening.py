"""How long to listen: accuracy, probabilities and prediction sets of recordings cut to ever more windows."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import cast

import numpy as np
from jaxtyping import Float
from joblib import delayed

from swashtwin.bench.questions.confidence import LEVELS, ConfidenceStudySettings, record_roles
from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.bench.rivals.models import THRESHOLD, Model, models_of, train_model
from swashtwin.foundation import VERSION, InputError, one_thread, parallel
from swashtwin.learning import (
    Confidence,
    SureClassifier,
    WindowSet,
    cross_fit,
    cut_windows,
    learn_confidence,
    pooled_probabilities,
    window_counts,
)
from swashtwin.recordings import Recording

CONFIDENCES = {
    "held out": "half of the trained recordings calibrate the confidence, the other half trains",
    "cross-fitted": "all of them train; folds calibrate the confidence: those of the training itself where it has "
    "some, else by recording at L2 and by pump at L4",
}
"""Ways to a confidence."""

METRICS = {
    "accuracy": "named right",
    "probability": "mean probability of the class named",
    "log_loss": "log loss [nat]",
    "coverage": "sets that hold the class",
    "set_size": "classes per set",
}
"""Heading of each figure; all count stretches of the listening time, each recording alike."""


@dataclass(frozen=True)
class ListeningStudySettings:
    """How much is recorded, and what is trained on it."""

    recorded: ConfidenceStudySettings = field(default_factory=lambda: ConfidenceStudySettings(duration=4.0))
    """Pumps, length of recordings, samples per window and error rate."""
    size: str = "quick"
    """Size of the models (`MODELS`)."""


def run_listening(
    *,
    seeds: Iterable[int] = (100, 101),
    settings: ListeningStudySettings | None = None,
    classifiers: Iterable[str] = ("extra_trees",),
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Figures by listening time, level of test and way to a confidence.

    Parameters
    ----------
    seeds : fleets of the virtual rig.
    settings : how much is recorded, and what is trained on it.
    classifiers : names of models (`MODELS`).
    jobs : processes that train side by side.
    progress : called with (done, in all).
    command : command line that repeats the study, stored with the result.

    Raises
    ------
    InputError
        No classifier of that name, or one that can have no confidence.
    """
    started, settings, seeds = time.perf_counter(), settings or ListeningStudySettings(), tuple(seeds)
    models = models_of(settings.size, classifiers)
    for name, model in models.items():
        if model.kind == THRESHOLD or model.trainings > 1 or model.sensors is not None:
            raise InputError(f"the classifier {name!r} has no confidence; take a network or trees.")
    tasks = [(name, way, level) for name in models for way in CONFIDENCES for level in LEVELS]
    trials = []
    for number, seed in enumerate(seeds):
        parts = record_roles(seed, settings.recorded)
        origin, roles = origin_of(parts["train"]), {name: len(group) for name, group in parts.items()}
        running = parallel(jobs, return_as="generator")(
            delayed(_task)(parts, models[name], way, level, seed, settings.recorded) for name, way, level in tasks
        )
        for count, ((name, way, level), result) in enumerate(zip(tasks, running, strict=True), 1):
            factors = {"classifier": name, "level": level, "confidence": way}
            trials += [
                Trial({**factors, "listening": f"{1000 * span:.0f} ms"}, seed, row) for span, row in result.items()
            ]
            if progress is not None:
                progress(number * len(tasks) + count, len(seeds) * len(tasks))
    trials.sort(key=lambda trial: list(trial.factors.values())[:3])
    study = StudyTable(
        study="listening",
        title="How long must one listen?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings=asdict(settings),
        origin=origin,
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "A recording is cut into as many stretches of each listening time as it has; each recording counts alike. "
            "Stretches of one recording are not independent: the spread is that over fleets.",
            "Unknown recordings are not part of this study; see bench confidence.",
        ),
        details={"recordings": roles, "confidences": CONFIDENCES},
    )
    return replace(study, answer=tuple(_answer(study)))


@one_thread()
def _task(
    parts: Mapping[str, list[Recording]],
    model: Model,
    way: str,
    level: str,
    seed: int,
    settings: ConfidenceStudySettings,
) -> dict[float, dict[str, float]]:
    """Figures by listening time [s] of one training."""
    first, second, test = (cut_windows(parts[role], length=settings.length) for role in ("train", "same", level))

    def train(windows: WindowSet) -> SureClassifier:
        return cast(SureClassifier, train_model(model, windows, seed=seed))

    if way == "held out":
        classifier = learn_confidence(train(first), second, error_rate=settings.error_rate)
    else:
        group, n_folds = ("recording", 5) if level == "L2" else ("specimen", settings.trained_pumps)
        classifier = train(first + second)
        if classifier.confidence is None:
            classifier = cross_fit(
                train, first + second, group=group, n_folds=n_folds, error_rate=settings.error_rate, seed=seed
            )
    probability = classifier.predict_proba(test)
    masks = [test.recording_id == name for name in np.unique(test.recording_id)]
    answers = [(probability[mask], int(test.target[mask][0])) for mask in masks]
    return {
        count * test.length / test.sample_rate: _figures(classifier.confidence, answers, count)
        for count in window_counts(min(len(windows) for windows, _ in answers))
    }


def _figures(
    confidence: Confidence | None, answers: Sequence[tuple[Float[np.ndarray, "window class"], int]], count: int
) -> dict[str, float]:
    """Means over recordings, each the mean over its stretches of `count` windows."""
    assert confidence is not None
    recordings = []
    for probability, target in answers:
        starts = range(0, len(probability) - count + 1, count)
        pooled = np.stack([pooled_probabilities(probability[start : start + count]) for start in starts])
        calibrated, in_set = confidence.temperature_scaled(pooled, count), confidence.prediction_set(pooled, count)
        right = pooled.argmax(axis=1) == target
        columns = (
            right, calibrated.max(axis=1), -np.log(np.maximum(calibrated[:, target], 1e-300)), in_set[:, target],
            in_set.sum(axis=1),
        )  # fmt: skip
        recordings.append([column.mean() for column in columns])
    return dict(zip(METRICS, np.mean(recordings, axis=0).tolist(), strict=True))


def _answer(study: StudyTable) -> Iterator[str]:
    for factors in {tuple(list(trial.factors.items())[:3]): None for trial in study.trials}:
        name, level, way = dict(factors).values()
        spans = list(dict.fromkeys(trial.factors["listening"] for trial in study.of(**dict(factors))))
        shares = [float(np.mean(study.values("accuracy", **dict(factors), listening=span))) for span in spans]
        figures = ", ".join(f"{share:.2f} after {span}" for span, share in zip(spans, shares, strict=True))
        yield f"{name}, confidence {way}, at {level}: {figures} named right."
