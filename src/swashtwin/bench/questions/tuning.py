"""Hyper-parameter search on validation recordings: pumps of the training set in turn, never a test recording.

The search sees what Case I trains on, measured windows only: the twins that fill cells are calibrated on these
recordings, and their windows would carry a validation pump into training. It lies in a journal on disk, so that a
search that was interrupted goes on.
"""

import hashlib
import inspect
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.bench.rivals.models import Model, models_of, train_model
from swashtwin.bench.studies.cases import SCENARIOS
from swashtwin.bench.studies.dataset import prepare
from swashtwin.bench.studies.sources import SameRecordings, Source
from swashtwin.bench.studies.workers import Workers
from swashtwin.foundation import VERSION, InputError, MissingExtraError, derive_seed
from swashtwin.learning import NETWORKS, WindowSet, evaluate, group_folds
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    import optuna

TRAINING_SPACE: Mapping[str, tuple[Any, ...]] = {
    "learning_rate": (1e-4, 1e-2),
    "weight_decay": (1e-6, 1e-2),
    "batch_size": (16, 30, 64),
    "normalization": ("set", "recording", "window"),
}
"""Training settings that are searched: between two floats on a logarithmic scale, or among values."""

NETWORK_SPACE: Mapping[str, tuple[Any, ...]] = {"dropout": (0.0, 0.1, 0.2, 0.3, 0.5), "stride": (8, 16, 32)}
"""Settings of a network that are searched where it has them."""


UNCHANGED = "own"
"""Mark of the trial that is the unchanged model."""


@dataclass(frozen=True)
class Candidate:
    """Settings with their validation scores."""

    settings: Mapping[str, Any]
    """By name."""
    recall: tuple[float, ...]
    """Macro recall on each validation fold."""
    is_unchanged: bool = False
    """Whether they are the unchanged settings of the study."""

    @property
    def mean(self) -> float:
        """Macro recall in the mean over the folds."""
        return float(np.mean(self.recall))


def run_tuning(
    data: Source | Sequence[Recording],
    *,
    model: str,
    size: str = "quick",
    trials: int = 20,
    seed: int = 0,
    out: Path,
    workers: Workers | None = None,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Settings by their macro recall on validation recordings, best first; the study's own stand among them.

    Parameters
    ----------
    data : recordings as for Case I.
    model : name of a network in `MODELS`.
    trials : settings to try in all, those of an earlier call with the same `out` included.
    seed : of the split, the folds, the weights and the search.
    out : folder of the journal, ``OUT/tune/MODEL-HASH.journal``.
    workers : where candidates are trained.
    progress : called with candidates done and in all.

    Raises
    ------
    InputError
        The model is no network, or there are fewer than two training specimens.
    MissingExtraError
        Optuna is not installed.
    """
    started, workers = time.perf_counter(), workers or Workers()
    study_model = models_of(size, [model])[model]
    if not study_model.is_network:
        raise InputError(f"{model} has no settings to search; name a network, such as bitcn.")
    recordings, fingerprint = (data if isinstance(data, Source) else SameRecordings(data)).recordings_for(seed)
    windows = prepare(recordings, SCENARIOS[size], seed, ()).measured
    folds = validation_folds(windows)
    space = _space(study_model)
    decisive = json.dumps(
        [study_model.describe(), SCENARIOS[size].describe(), seed, fingerprint, space], sort_keys=True
    )
    name = f"{model}-{hashlib.sha256(decisive.encode()).hexdigest()[:12]}"
    with workers.started():
        search = _open_search(Path(out) / "tune" / f"{name}.journal", name, seed)
        while (count := len(_complete(search))) < trials or not any(map(_is_unchanged, _complete(search))):
            if progress is not None:
                progress(count, trials)
            batch = [search.ask() for _ in range(max(1, min(workers.jobs, trials - count)))]
            models = [
                study_model if _is_unchanged(trial) else _with(study_model, _suggest(trial, space)) for trial in batch
            ]
            calls = [(model, windows, folds, seed, device) for model in models]
            for index, recall in workers.each(validate, calls):
                batch[index].set_user_attr("recall", list(recall))
                search.tell(batch[index], float(np.mean(recall)))
    candidates = [
        Candidate(
            _unchanged_settings(study_model, space) if _is_unchanged(trial) else trial.params,
            tuple(trial.user_attrs["recall"]),
            _is_unchanged(trial),
        )
        for trial in _complete(search)
    ]
    return _table(candidates, model, size, seed, origin_of(recordings), command, time.perf_counter() - started, device)


def validation_folds(windows: WindowSet) -> list[tuple[np.ndarray, np.ndarray]]:
    """(training, validation) indices, each specimen validating once.

    Raises
    ------
    InputError
        There is one specimen only.
    """
    if len(set(windows.specimen.tolist())) < 2:
        raise InputError("tuning validates on pumps that a candidate was not trained on; it needs two to train on.")
    return list(group_folds(windows, group="specimen", dealing="each"))


def validate(
    model: Model, windows: WindowSet, folds: Sequence[tuple[np.ndarray, np.ndarray]], seed: int, device: str
) -> tuple[float, ...]:
    """Macro recall of a model on each validation fold."""
    recalls = []
    for train, validation in folds:
        classifier = train_model(model, windows.subset(train), seed=seed, device=device)
        recalls.append(evaluate(classifier, windows.subset(validation), level="L4").macro_recall)
    return tuple(recalls)


def _network_defaults(model: Model) -> dict[str, Any]:
    """Settings that a model's network takes, with their defaults."""
    defaults: dict[str, Any] = {}
    for kind in reversed(NETWORKS[model.kind].__mro__):
        defaults |= {name: parameter.default for name, parameter in inspect.signature(kind).parameters.items()}
    return defaults


def _space(model: Model) -> dict[str, tuple[Any, ...]]:
    """What is searched of a model: of the normalizations those that go with how it is trained."""
    defaults = _network_defaults(model)
    suitable = tuple(name for name in TRAINING_SPACE["normalization"] if model.training.fits_normalization(name))
    training = {**TRAINING_SPACE, "normalization": suitable}
    return {**training, **{name: values for name, values in NETWORK_SPACE.items() if name in defaults}}


def _unchanged_settings(model: Model, space: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
    """What the unchanged model has of what is searched, be it within the space or not."""
    settings = {**_network_defaults(model), **vars(model.training), **model.network}
    return {name: settings[name] for name in space}


def _is_range(values: tuple[Any, ...]) -> bool:
    return len(values) == 2 and all(isinstance(value, float) for value in values)


def _suggest(trial: "optuna.Trial", space: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
    def suggest(name: str, values: tuple[Any, ...]) -> Any:
        if _is_range(values):
            return trial.suggest_float(name, *values, log=True)
        return trial.suggest_categorical(name, values)

    return {name: suggest(name, values) for name, values in space.items()}


def _with(model: Model, settings: Mapping[str, Any]) -> Model:
    training = {name: value for name, value in settings.items() if name in TRAINING_SPACE}
    network = {name: value for name, value in settings.items() if name not in TRAINING_SPACE}
    return replace(model.with_training(**training), network={**model.network, **network})


def _open_search(path: Path, name: str, seed: int) -> "optuna.Study":
    """The search in a journal; the unchanged model is next, unless it has a score.

    It is a trial without parameters, for the space need not hold its settings; an interrupt may have lost it before.
    """
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
    except ImportError as cause:
        raise MissingExtraError('a search needs optuna: pip install "swashtwin[search]".') from cause
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = JournalFileOpenLock(str(path))  # optuna's usual lock is a link, which Windows lets few users make
    lock.acquire()  # so that a half line is none that another process is writing
    try:
        _cut_half_line(path)
    finally:
        lock.release()
    storage = JournalStorage(JournalFileBackend(str(path), lock))
    search = optuna.create_study(study_name=name, storage=storage, direction="maximize", load_if_exists=True)
    search.sampler = optuna.samplers.TPESampler(seed=derive_seed(seed, "tuning", len(search.trials)) % 2**32)
    if not any(_is_unchanged(trial) and trial.state.name in ("COMPLETE", "WAITING") for trial in search.trials):
        search.enqueue_trial({}, user_attrs={UNCHANGED: True})
    return search


def _cut_half_line(path: Path) -> None:
    """Leave out the last line of a journal whose writing was killed; optuna would join it with the next."""
    if path.is_file():
        with path.open("r+b") as file:
            file.truncate(file.read().rfind(b"\n") + 1)


def _is_unchanged(trial: "optuna.Trial | optuna.trial.FrozenTrial") -> bool:
    return bool(trial.user_attrs.get(UNCHANGED))


def _complete(search: "optuna.Study") -> list[Any]:
    return [trial for trial in search.trials if trial.state.name == "COMPLETE"]


def _table(
    candidates: Sequence[Candidate],
    model: str,
    size: str,
    seed: int,
    origin: str,
    command: str,
    wall_s: float,
    device: str,
) -> StudyTable:
    best = sorted(candidates, key=lambda candidate: -candidate.mean)
    trials = [
        Trial({"settings": _words(candidate)}, fold, {"recall": value})
        for candidate in best
        for fold, value in enumerate(candidate.recall)
    ]
    unchanged = next(candidate for candidate in candidates if candidate.is_unchanged)
    answer = (
        f"Best of {len(candidates)} on validation recordings: {_words(best[0])}, macro recall {best[0].mean:.3f}; "
        f"the study's own settings: {unchanged.mean:.3f}.",
    )
    return StudyTable(
        study="tune",
        title=f"Settings of {model} by their score on validation recordings",
        metrics={"recall": "macro recall on pumps not trained on"},
        trials=tuple(trials),
        answer=answer,
        settings={"model": model, "size": size, "seed": seed, "best": dict(best[0].settings)},
        origin=origin,
        wall_s=wall_s,
        version=VERSION,
        command=command,
        notes=(
            "Validation pumps are training pumps of Case I, each left out in turn; no test recording was used. "
            "The best of many candidates is flattered by having been chosen: test it by a study with other seeds.",
            "What stands as a seed is the number of the validation fold.",
        ),
        device=device,
        details={
            "candidates": [
                {
                    "settings": dict(candidate.settings),
                    "recall": list(candidate.recall),
                    "unchanged": candidate.is_unchanged,
                }
                for candidate in candidates
            ]
        },
    )


def _words(candidate: Candidate) -> str:
    settings = ", ".join(
        f"{name}={value:.3g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in candidate.settings.items()
    )
    return f"the study's own: {settings}" if candidate.is_unchanged else settings
