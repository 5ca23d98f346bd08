"""A study as a plan: training sets × classifiers under a scenario, for each seed; and what one
training of it gives.
"""

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
from swashtwin.learning import Classifier, FittedClassifier, Scores, WindowSet, evaluate
from swashtwin.pump import PRESSURE_TOLERANCE, load_pump, values_match
from swashtwin_bench.results.result import build_score_row
from swashtwin_bench.results.runs import Task
from swashtwin_bench.rigs.writing import PUMPS
from swashtwin_bench.rivals.baselines import ON_FEATURES
from swashtwin_bench.rivals.models import Model, select_models, train_model
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
"""Row of the tests without any perturbation."""

EMBEDDED = 30
"""Principal components of the last features that a run keeps for t-SNE."""


@dataclass(frozen=True)
class PlanSettings:
    """What can be set of a study of classifiers; what is None or empty stays as the study has
    it.
    """

    classifiers: tuple[str, ...] = ()
    """Classifiers to train instead of the study's."""
    training_sets: tuple[str, ...] = ()
    """These of the study's training sets only, or others that twins fill."""
    values: tuple[str, ...] = ()
    """These values only of what the study varies."""
    window: int | None = None
    """Samples per window."""
    rig: str | None = None
    """Version of the virtual rig."""
    sensors: int | None = None
    """Accelerometers of the rig and of the twin: 3, or 13 as the paper has them (version 1)."""
    precision: str | None = None
    """Number format of networks in training, ``"float32"`` or ``"bfloat16"``."""


@dataclass(frozen=True)
class Plan:
    """Training sets, classifiers and tests of a study, for each seed."""

    study: str
    """Name, such as ``"case1"``."""
    title: str
    """What it asks, as a heading."""
    scenario: Scenario
    """What is scarce, and what is tested."""
    models: Mapping[str, Model]
    """Classifiers by name; the first is the study's own."""
    training_sets: Mapping[str, TrainingSet] = field(default_factory=lambda: PAPER_TRAINING_SETS)
    """Training sets by name."""
    varied: str = ""
    """Factor that the scenario varies by, such as ``"scarce_windows"``; empty where there is one
    scenario.
    """
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {"": {}})
    """What differs from `scenario`, by the factor's value."""
    unfilled_variant: str | None = None
    """Value of the varied factor under which what is filled by nothing stands, and stands alone;
    None where it stands under each.
    """
    reference_values: Mapping[str, str] = field(default_factory=dict)
    """Factor and the value that all its others are compared with."""
    size: str = "custom"
    """Name of the settings."""
    perturbations: tuple[Perturbation, ...] = ()
    """What recordings of the tests are changed by, each once more beside the clean tests."""
    draws: int = 5
    """Draws of each perturbation."""
    repeats: int = 0
    """Trainings on the data of the first seed, in place of seeds; 0 where each seed draws
    everything anew.
    """
    split_seed: int | None = None
    """Seed of split, twins and synthesis, where only the training is repeated under each seed."""
    rig: str = "1"
    """Version of the virtual rig on which it is run."""
    fleet: str = "paper"
    """Size of the rig's fleets."""
    sensors: int = 3
    """Accelerometers of the rig."""
    notes: tuple[str, ...] = ()
    """Notes that must be read with the numbers."""

    def __post_init__(self) -> None:
        if not (self.models and self.training_sets):
            raise InputError("a study needs a classifier and a training set.")

    def with_settings(self, settings: PlanSettings) -> "Plan":
        """The plan with what was set.

        Raises
        ------
        InputError
            There is no classifier, training set, value or version of the rig of that name.
        """
        plan, changes = self, dict[str, Any]()
        if settings.classifiers:
            own = self.models
            further = select_models(
                self.size, [name for name in settings.classifiers if name not in own]
            )
            changes["models"] = {name: {**own, **further}[name] for name in settings.classifiers}
            if "classifier" in self.reference_values:
                changes["reference_values"] = {
                    **self.reference_values,
                    "classifier": settings.classifiers[0],
                }
        if settings.training_sets:
            choices = {**TWIN_TRAINING_SETS, **self.training_sets}
            self._require(settings.training_sets, choices, "training set")
            changes["training_sets"] = {name: choices[name] for name in settings.training_sets}
        if settings.values:
            self._require(
                settings.values,
                self.variants if self.varied else {},
                f"value of {self.varied or 'anything'}",
            )
            changes["variants"] = {name: self.variants[name] for name in settings.values}
        if settings.rig is not None and settings.rig != self.rig:
            scenario = replace(self.scenario, faults=machined_faults(settings.rig))
            changes |= {"rig": settings.rig, "scenario": scenario}
        plan = replace(plan, **changes)
        if settings.sensors is not None:
            self._require(
                [str(settings.sensors)], {str(count): "" for count in PUMPS}, "number of sensors"
            )
            scenario = replace(plan.scenario, pump=load_pump(PUMPS[settings.sensors]))
            plan = replace(plan, scenario=scenario, sensors=settings.sensors)
        if settings.precision is not None:
            models = {
                name: each.with_training(precision=settings.precision)
                for name, each in plan.models.items()
            }
            plan = replace(plan, models=models)
        return plan if settings.window is None else plan.of_window(settings.window)

    def _require(self, names: Sequence[str], choices: Mapping[str, Any], what: str) -> None:
        if unknown := [name for name in names if name not in choices]:
            there = f"there are {', '.join(choices)}" if choices else "it has none"
            raise InputError(f"{self.study} has no {what} {unknown[0]!r}; {there}.")

    def of_window(self, length: int) -> "Plan":
        """The plan with windows of another length, and as much signal in the scarce cells.

        Parameters
        ----------
        length : samples per window.
        """

        def of_signal(count: int) -> int:
            return max(min(count, 1), count * self.scenario.length // length)

        test = self.scenario.test_windows
        scenario = replace(
            self.scenario,
            length=length,
            scarce_windows=of_signal(self.scenario.scarce_windows),
            test_windows=None if test is None else of_signal(test),
        )
        return replace(self, scenario=scenario)

    def tasks(self, seed: int, data: str, device: str = "cpu") -> list[Task]:
        """Every task of a seed, in order.

        Parameters
        ----------
        data : SHA-256 of the recordings.
        device : where networks are trained.
        """
        scenarios = {name: self.scenario_of(name).describe() for name in self.variants}
        sets = {
            name: each.describe(self.scenario.faults) for name, each in self.training_sets.items()
        }
        models = {name: model.describe() for name, model in self.models.items()}
        return [
            Task(
                study=self.study,
                size=self.size,
                seed=seed,
                factors={
                    "classifier": model,
                    "training_set": training_set,
                    **({self.varied: variant} if variant else {}),
                },
                settings={
                    "scenario": scenarios[variant],
                    "training_set": sets[training_set],
                    "model": models[model],
                    "device": device if self.models[model].is_network else "cpu",
                    "tests": {
                        "perturbations": list(map(str, self.perturbations)),
                        "draws": self.draws,
                    },
                    **({} if self.split_seed is None else {"split_seed": self.split_seed}),
                },
                data=data,
            )
            for variant, training_set, model in product(
                self.variants, self.training_sets, self.models
            )
            if self.unfilled_variant is None
            or (variant == self.unfilled_variant)
            is (self.training_sets[training_set].source is None)
        ]

    def needs_twins(self, task: Task) -> bool:
        """Whether a task is filled by a calibrated twin."""
        return self.training_sets[task.factors["training_set"]].source in CALIBRATED_TWINS

    def data_seed(self, seed: int) -> int:
        """Seed of the data that is trained on under `seed`."""
        return seed if self.split_seed is None else self.split_seed

    def position(self, factors: Mapping[str, str]) -> tuple[int, ...]:
        """Position of a run among those of the plan; classifiers that the plan lacks come last."""
        named: tuple[tuple[Mapping[str, Any], str], ...] = (
            (self.models, factors["classifier"]),
            (self.variants, factors.get(self.varied, "")),
            (self.training_sets, factors["training_set"]),
        )
        return tuple(
            list(names).index(name) if name in names else len(names) for names, name in named
        )

    def scenario_of(self, variant: str) -> Scenario:
        """The scenario of a variant."""
        return replace(self.scenario, **self.variants[variant])


def train_and_test(
    task: Task, plan: Plan, dataset: StudyDataset, synthetic: WindowSet, values: Mapping[str, float], out: Path | None,
    *, keep_model: bool,
) -> dict[str, Any]:  # fmt: skip
    """What one task comes to: train on the measured and the synthetic windows, test at every split.

    Parameters
    ----------
    synthetic : what the task's training set adds.
    values : figures of these windows.
    out : folder of the studies; a network's training saves to the task's folder after each epoch,
        and goes on there.
    keep_model : whether a trained network is saved there.
    """
    wall, cpu = time.perf_counter(), time.process_time()
    model = plan.models[task.factors["classifier"]]
    if plan.training_sets[task.factors["training_set"]].class_weights:
        model = model.with_training(class_weights=True)
    train = dataset.measured + synthetic
    ends: list[float] = []
    classifier = train_model(
        model,
        train,
        seed=task.seed,
        manifest=dataset.manifest,
        device=task.settings["device"],
        checkpoint=None if out is None else task.folder(out) / "training.safetensors",
        progress=lambda _: ends.append(time.process_time()),
    )
    if keep_model and out is not None and classifier.network.weights:
        save_classifier(classifier, task.folder(out) / "model.safetensors")
    is_on_features = model.kind in ON_FEATURES
    rows = list(_rows(classifier, plan, dataset))
    sets = {"train": train, **dataset.tests}
    return {
        "rows": rows,
        "classes": list(classifier.classes),
        "history": [] if is_on_features else [asdict(epoch) for epoch in classifier.history],
        # the mean of an epoch since an interruption [s]
        "values": {
            **values,
            **({"epoch_cpu_s": float(np.mean(np.diff(ends)))} if len(ends) > 1 else {}),
        },
        "roles": dataset.roles(),
        "sha256": {name: windows.fingerprint() for name, windows in sets.items()},
        "cells": {name: count_cells(windows) for name, windows in sets.items()},
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu,
        "device": task.settings["device"],
        "features": None if is_on_features else _features(classifier, dataset),
    }


@dataclass(frozen=True, eq=False)
class _Unlisted:
    """A classifier that names none of its training recordings, so that other windows of them may be
    tested on: only for split L0, which shows how much of a score is leak.
    """

    classifier: Classifier
    manifest: tuple[str, ...] = ()

    @property
    def classes(self) -> tuple[str, ...]:
        return self.classifier.classes

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        return self.classifier.predict_proba(windows)


def _rows(classifier: Classifier, plan: Plan, dataset: StudyDataset) -> Iterator[dict[str, Any]]:
    for split, clean in dataset.tests.items():
        tested = _Unlisted(classifier) if split == RANDOM_WINDOWS else classifier
        for perturbation in (None, *plan.perturbations):
            varied = {"perturbation": str(perturbation or CLEAN)} if plan.perturbations else {}
            for repeat in range(plan.draws if perturbation else 1):
                test = perturbation.of_test(dataset, split, repeat) if perturbation else clean
                scores = evaluate(tested, test, split=split)
                yield {"split": split, **varied, "repeat": repeat,
                       **build_score_row(scores, scarce_recall(scores, dataset.scenario))}  # fmt: skip


def scarce_recall(scores: Scores, scenario: Scenario) -> float:
    """Recall of the measured windows of the cells that were scarce; NaN where the test has none."""
    cells = [
        cell.recall
        for cell in scores.cells
        if cell.label in scenario.scarce
        and cell.discharge_pressure is not None
        and values_match(cell.discharge_pressure, scenario.pressure, PRESSURE_TOLERANCE)
    ]
    return float(np.mean(cells)) if cells else math.nan


def _features(classifier: FittedClassifier, dataset: StudyDataset) -> dict[str, list[Any]]:
    """Principal components of the last features of the test windows, with class and split of each,
    for t-SNE.
    """
    tests = dataset.tests
    features = np.concatenate([classifier.embed(test) for test in tests.values()]).astype(float)
    count = min(EMBEDDED, *features.shape)
    return {
        "values": np.round(PCA(count, svd_solver="full").fit_transform(features), 4).tolist(),
        "label": [label for test in tests.values() for label in test.label.tolist()],
        "split": [split for split, test in tests.items() for _ in range(len(test))],
    }
