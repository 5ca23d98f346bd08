"""The plan of a study, training sets × classifiers under a scenario; and one training of it."""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from sklearn.decomposition import PCA

from swashtwin.diagnosis import save_classifier
from swashtwin.foundation import InputError
from swashtwin.learning import (
    Classifier,
    FittedClassifier,
    Scores,
    WindowSet,
    evaluate,
    likeliest_class,
    pooled_probabilities,
)
from swashtwin.pump import PRESSURE_TOLERANCE, load_pump, values_match
from swashtwin.recordings import Manifest
from swashtwin_bench.results.result import Contrasts, build_score_row
from swashtwin_bench.results.runs import Task
from swashtwin_bench.rigs.writing import PUMPS, RIG_VERSION
from swashtwin_bench.rivals.baselines import ON_FEATURES
from swashtwin_bench.rivals.models import Model, select_models, train_model
from swashtwin_bench.studies.ceilings import CEILINGS, KNOWN_RIGS
from swashtwin_bench.studies.dataset import StudyDataset, count_cells
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.scenario import RANDOM_WINDOWS, Scenario, machined_faults
from swashtwin_bench.studies.training_sets import (
    CALIBRATED_TWINS,
    PAPER_TRAINING_SETS,
    TWIN_TRAINING_SETS,
    TrainingSet,
)

CLEAN = "clean"
"""Name of the tests without a perturbation."""

N_EMBEDDED = 30
"""Principal components of the last features that a run keeps for t-SNE."""


@dataclass(frozen=True)
class PlanSettings:
    """Settings of a study of classifiers; None or empty keeps what the study has."""

    classifiers: tuple[str, ...] = ()
    """Classifiers to train instead of those of the study."""
    training_sets: tuple[str, ...] = ()
    """Training sets: some of the study, or others that twins fill."""
    values: tuple[str, ...] = ()
    """Values of the varied factor, some of the study."""
    window: int | None = None
    """Samples per window."""
    rig: str | None = None
    """Version of the virtual rig."""
    sensors: int | None = None
    """Accelerometers of the rig and of the twin: 3, or 13 as in the paper (version 1)."""
    precision: str | None = None
    """Number format of networks in training, ``"float32"`` or ``"bfloat16"``."""


@dataclass(frozen=True)
class Plan:
    """Training sets, classifiers and tests of a study, for each seed."""

    study: str
    """Name, such as ``"case1"``."""
    title: str
    """Question, as a heading."""
    scenario: Scenario
    """Scarce cells, and tests."""
    models: Mapping[str, Model]
    """Classifiers by name; the first is the main one of the study."""
    training_sets: Mapping[str, TrainingSet] = field(default_factory=lambda: PAPER_TRAINING_SETS)
    """Training sets by name."""
    varied: str = ""
    """Factor by which the scenario varies, such as ``"scarce_windows"``; empty for one scenario."""
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {"": {}})
    """Changes of `scenario` by the value of the factor."""
    unfilled_variant: str | None = None
    """Value of the varied factor at which exactly the training sets without synthetic windows are
    trained; None if every training set is trained at every value.
    """
    reference_values: Mapping[str, str] = field(default_factory=dict)
    """Value of a factor that its other values are compared with, by factor."""
    metric: str = "accuracy"
    """Metric of the comparisons, a name in `METRICS`."""
    contrasts: Contrasts = field(default_factory=dict)
    """Pairs of training sets that are compared besides those with a reference value."""
    size: str = "custom"
    """Name of the settings."""
    perturbations: tuple[Perturbation, ...] = ()
    """Changes of the test recordings; each is tested in addition to the clean tests."""
    draws: int = 5
    """Draws of each perturbation."""
    repeats: int = 0
    """Trainings on the data of the first seed, instead of seeds; 0 if each seed has other data."""
    split_seed: int | None = None
    """Seed of split, twins and synthesis, if only the training is repeated under each seed."""
    rig: str = "1"
    """Version of the virtual rig."""
    fleet: str = "paper"
    """Size of the fleets of the rig."""
    sensors: int = 3
    """Accelerometers of the rig."""
    notes: tuple[str, ...] = ()
    """Notes to be read with the numbers."""

    def __post_init__(self) -> None:
        if not (self.models and self.training_sets):
            raise InputError("A study needs at least one classifier and one training set.")
        if self.has_ceilings and self.rig not in KNOWN_RIGS:
            raise InputError(
                f"Ceilings are drawn from the truth of version {RIG_VERSION} of the rig, not of "
                f"version {self.rig}: select training_sets without ceiling."
            )

    @property
    def has_ceilings(self) -> bool:
        """Whether a training set is made with the hidden truth of the rig."""
        return any(training_set.source in CEILINGS for training_set in self.training_sets.values())

    def with_settings(self, settings: PlanSettings) -> "Plan":
        """Return the plan with these settings.

        Raises
        ------
        InputError
            A classifier, training set, value, version of the rig or number of sensors does not
            exist.
        """
        plan = self
        if settings.classifiers:
            plan = plan._with_classifiers(settings.classifiers)

        if settings.training_sets:
            training_sets = {**TWIN_TRAINING_SETS, **plan.training_sets}
            self._require(settings.training_sets, training_sets, "training set")
            selected_sets = {name: training_sets[name] for name in settings.training_sets}
            plan = replace(plan, training_sets=selected_sets)

        if settings.values:
            variants = plan.variants if plan.varied else {}
            self._require(settings.values, variants, f"value of {plan.varied or 'anything'}")
            plan = replace(plan, variants={name: variants[name] for name in settings.values})

        if settings.rig is not None and settings.rig != plan.rig:
            scenario = replace(plan.scenario, faults=machined_faults(settings.rig))
            plan = replace(plan, rig=settings.rig, scenario=scenario)

        if settings.sensors is not None:
            allowed = {str(count): count for count in PUMPS}
            self._require([str(settings.sensors)], allowed, "number of sensors")
            scenario = replace(plan.scenario, pump=load_pump(PUMPS[settings.sensors]))
            plan = replace(plan, scenario=scenario, sensors=settings.sensors)

        if settings.precision is not None:
            models = {
                name: model.with_training(precision=settings.precision)
                for name, model in plan.models.items()
            }
            plan = replace(plan, models=models)

        if settings.window is not None:
            plan = plan.of_window(settings.window)

        return plan

    def _with_classifiers(self, names: Sequence[str]) -> "Plan":
        further = select_models(self.size, [name for name in names if name not in self.models])
        available = {**self.models, **further}
        plan = replace(self, models={name: available[name] for name in names})

        if "classifier" in self.reference_values:
            references = {**self.reference_values, "classifier": names[0]}
            plan = replace(plan, reference_values=references)

        return plan

    def _require(self, names: Sequence[str], choices: Mapping[str, Any], description: str) -> None:
        unknown = [name for name in names if name not in choices]
        if unknown:
            remedy = f"there are {', '.join(choices)}" if choices else "it has none"
            raise InputError(f"{self.study} has no {description} {unknown[0]!r}; {remedy}.")

    def of_window(self, length: int) -> "Plan":
        """Return the plan with windows of another length, and as much signal in the scarce cells.

        Parameters
        ----------
        length : samples per window.
        """

        def convert(count: int) -> int:
            """Return the number of windows in as much signal: at least 1, unless it is 0."""
            return max(min(count, 1), count * self.scenario.length // length)

        test_windows = self.scenario.test_windows
        if test_windows is not None:
            test_windows = convert(test_windows)

        scenario = replace(
            self.scenario,
            length=length,
            scarce_windows=convert(self.scenario.scarce_windows),
            test_windows=test_windows,
        )
        return replace(self, scenario=scenario)

    def tasks(self, seed: int, data: str, device: str = "cpu") -> list[Task]:
        """Return all tasks of a seed in order.

        Parameters
        ----------
        data : SHA-256 of the recordings.
        device : device on which networks are trained.
        """
        scenarios = {name: self.scenario_of(name).describe() for name in self.variants}
        training_sets = {
            name: training_set.describe(self.scenario.faults)
            for name, training_set in self.training_sets.items()
        }
        # Described once: to describe a network, it is built.
        models = {name: model.describe() for name, model in self.models.items()}
        tests = {"perturbations": list(map(str, self.perturbations)), "draws": self.draws}

        tasks = []
        for variant, training_set, model in product(self.variants, self.training_sets, self.models):
            if not self._is_trained_at(variant, self.training_sets[training_set]):
                continue

            factors = {"classifier": model, "training_set": training_set}
            if variant:
                factors[self.varied] = variant

            settings: dict[str, Any] = {
                "scenario": scenarios[variant],
                "training_set": training_sets[training_set],
                "model": models[model],
                # Trees always run on the CPU, so their key does not depend on the device.
                "device": device if self.models[model].is_network else "cpu",
                "tests": tests,
            }
            # The data are then those of another seed, which the key has to hold.
            if self.split_seed is not None:
                settings["split_seed"] = self.split_seed

            tasks.append(
                Task(
                    study=self.study,
                    size=self.size,
                    seed=seed,
                    factors=factors,
                    settings=settings,
                    data=data,
                )
            )

        return tasks

    def _is_trained_at(self, variant: str, training_set: TrainingSet) -> bool:
        if self.unfilled_variant is None:
            return True

        is_unfilled = training_set.source is None
        return is_unfilled == (variant == self.unfilled_variant)

    def model_of(self, task: Task) -> Model:
        """Return the classifier of a task."""
        return self.models[task.factors["classifier"]]

    def needs_twins(self, task: Task) -> bool:
        """Return whether a calibrated twin fills the cells of a task."""
        return self.training_sets[task.factors["training_set"]].source in CALIBRATED_TWINS

    def data_seed(self, seed: int) -> int:
        """Return the seed of the data that are trained on under `seed`."""
        return seed if self.split_seed is None else self.split_seed

    def position(self, factors: Mapping[str, str]) -> tuple[int, ...]:
        """Return the position of a run among those of the plan.

        A classifier that is not in the plan comes last.
        """
        choices: tuple[tuple[Mapping[str, Any], str], ...] = (
            (self.models, factors["classifier"]),
            (self.variants, factors.get(self.varied, "")),
            (self.training_sets, factors["training_set"]),
        )
        return tuple(
            list(names).index(name) if name in names else len(names) for names, name in choices
        )

    def scenario_of(self, variant: str) -> Scenario:
        """Return the scenario of a variant."""
        return replace(self.scenario, **self.variants[variant])


def train_and_test(
    task: Task,
    plan: Plan,
    dataset: StudyDataset,
    synthetic: WindowSet,
    values: Mapping[str, float],
    out: Path | None,
    *,
    keep_model: bool,
) -> dict[str, Any]:
    """Train on the measured and the synthetic windows, test at every split, and return the results.

    Parameters
    ----------
    synthetic : windows that the training set of the task adds.
    values : metrics of these windows.
    out : folder of the studies; the training of a network is saved in the folder of the task after
        each epoch, and continues from there.
    keep_model : whether a trained network is saved there.
    """
    started = time.perf_counter()
    cpu_started = time.process_time()

    model = plan.model_of(task)
    if plan.training_sets[task.factors["training_set"]].class_weights:
        model = model.with_training(class_weights=True)
    is_on_features = model.kind in ON_FEATURES

    checkpoint = None
    if out is not None:
        checkpoint = task.folder(out) / "training.safetensors"
    train = dataset.measured + synthetic
    epoch_ends: list[float] = []
    classifier = train_model(
        model,
        train,
        seed=task.seed,
        manifest=dataset.manifest,
        device=task.settings["device"],
        checkpoint=checkpoint,
        progress=lambda _: epoch_ends.append(time.process_time()),
    )
    # A network without weights is solved at once, and its training is cheap to repeat.
    if keep_model and out is not None and classifier.network.weights:
        save_classifier(classifier, task.folder(out) / "model.safetensors")

    run_values = dict(values)
    if len(epoch_ends) > 1:
        # Since an interruption, if there was one: the epochs before it were not timed here.
        run_values["epoch_cpu_s"] = float(np.mean(np.diff(epoch_ends)))

    window_sets = {"train": train, **dataset.tests}
    return {
        "rows": list(_test_all(classifier, plan, dataset)),
        "classes": list(classifier.classes),
        "history": [] if is_on_features else [asdict(epoch) for epoch in classifier.history],
        "values": run_values,
        "roles": dataset.roles(),
        "sha256": {name: windows.fingerprint() for name, windows in window_sets.items()},
        "cells": {name: count_cells(windows) for name, windows in window_sets.items()},
        "wall_s": time.perf_counter() - started,
        "cpu_s": time.process_time() - cpu_started,
        "device": task.settings["device"],
        "features": None if is_on_features else _embed_tests(classifier, dataset),
    }


@dataclass(frozen=True, eq=False)
class _Answers:
    """The probabilities that a classifier gave to the windows of a test, computed once."""

    classes: tuple[str, ...]
    manifest: Manifest | tuple[str, ...]
    """Recordings that no test may contain."""
    probability: Float[np.ndarray, "window class"]

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        return self.probability

    def correct_recordings(self, test: WindowSet) -> dict[str, list[int]]:
        """Return the numbers of recordings classified right, and of all, by specimen."""
        counts: dict[str, list[int]] = {}
        for name in np.unique(test.recording_id).tolist():
            rows = np.flatnonzero(test.recording_id == name)
            answer = likeliest_class(pooled_probabilities(self.probability[rows])[None])[0]
            is_right = self.classes[answer] == test.label[rows[0]]

            count = counts.setdefault(str(test.specimen[rows[0]]), [0, 0])
            count[0] += int(answer >= 0 and is_right)
            count[1] += 1

        return counts


def _test_all(
    classifier: Classifier, plan: Plan, dataset: StudyDataset
) -> Iterator[dict[str, Any]]:
    """Yield the row of each test: split, perturbation and draw."""
    for split, clean_test in dataset.tests.items():
        # A test with recordings of the manifest is refused, and this split, which shows how much
        # of a score is leak, has them by design.
        manifest = () if split == RANDOM_WINDOWS else classifier.manifest

        for perturbation in (None, *plan.perturbations):
            factors = {"split": split}
            if plan.perturbations:
                factors["perturbation"] = str(perturbation or CLEAN)

            for repeat in range(plan.draws if perturbation else 1):
                test = clean_test
                if perturbation:
                    test = perturbation.of_test(dataset, split, repeat)
                answers = _Answers(classifier.classes, manifest, classifier.predict_proba(test))
                scores = evaluate(answers, test, split=split)
                recall = scarce_recall(scores, dataset.scenario)
                yield {
                    **factors,
                    "repeat": repeat,
                    **build_score_row(scores, recall),
                    "correct_recordings": answers.correct_recordings(test),
                }


def scarce_recall(scores: Scores, scenario: Scenario) -> float:
    """Return the recall of the measured windows in the scarce cells; NaN if the test has none."""
    recalls = [
        cell.recall
        for cell in scores.cells
        if cell.label in scenario.scarce
        and cell.discharge_pressure is not None
        and values_match(cell.discharge_pressure, scenario.pressure, PRESSURE_TOLERANCE)
    ]
    return float(np.mean(recalls)) if recalls else math.nan


def _embed_tests(classifier: FittedClassifier, dataset: StudyDataset) -> dict[str, list[Any]]:
    """Return principal components of the last features of the test windows, for t-SNE.

    Class and split of each window are returned too.
    """
    features = [classifier.embed(test) for test in dataset.tests.values()]
    matrix = np.concatenate(features).astype(float)
    # There are no more components than windows or features. The full solver draws no random
    # numbers.
    n_components = min(N_EMBEDDED, *matrix.shape)
    components = PCA(n_components, svd_solver="full").fit_transform(matrix)

    labels: list[str] = []
    splits: list[str] = []
    for split, test in dataset.tests.items():
        labels += test.label.tolist()
        splits += [split] * len(test)

    return {"values": np.round(components, 4).tolist(), "label": labels, "split": splits}
