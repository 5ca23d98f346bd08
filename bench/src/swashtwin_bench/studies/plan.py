"""A study as a plan: training sets × classifiers under a scenario, for each seed; and how one task of it is run."""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from swashtwin.diagnosis import save_classifier
from swashtwin.foundation import VERSION, InputError
from swashtwin.learning import Classifier, FittedClassifier, Scores, WindowSet, evaluate
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin_bench.results.runs import Embedding, Outcome, Run, Task
from swashtwin_bench.rivals.models import Model, train_model
from swashtwin_bench.rivals.unlisted import UnlistedClassifier
from swashtwin_bench.studies.dataset import StudyDataset, cells_of
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.scenario import RANDOM_WINDOWS, Scenario, machined_faults
from swashtwin_bench.studies.training_sets import (
    CALIBRATED_TWINS,
    PAPER_TRAINING_SETS,
    TWIN_TRAINING_SETS,
    TrainingSet,
)

EPOCH_TIME = "epoch_cpu_s"
"""CPU time of an epoch of the training [s], among the values of a run; the mean of those since an interruption."""

CLEAN = "clean"
"""Row of the tests without any perturbation."""


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
    """Factor that the scenario varies by, such as ``"scarce_windows"``; empty where there is one scenario."""
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {"": {}})
    """What differs from `scenario`, by the factor's value."""
    bare: str | None = None
    """Value of the varied factor under which what is filled by nothing stands, and stands alone; None where it stands
    under each."""
    compared: Mapping[str, str | Mapping[str, Sequence[str]]] = field(default_factory=dict)
    """Factor and the value that all its others are compared with, or several values, each with those that it is
    compared with."""
    size: str = "custom"
    """Name of the settings."""
    rivals: tuple[str, ...] = ()
    """Classifiers whose rows stand beside those of the study, not among them; where there are any, so do those of every
    further classifier."""
    perturbations: tuple[Perturbation, ...] = ()
    """What recordings of the tests are changed by, each once more beside the clean tests."""
    draws: int = 5
    """Draws of each perturbation."""
    split_seed: int | None = None
    """Seed of split, twins and synthesis, where only the training is repeated under each seed; by default each seed
    draws everything anew."""
    notes: tuple[str, ...] = ()
    """Notes that must be read with the numbers."""
    model_notes: Mapping[str, str] = field(default_factory=dict)
    """Notes on single classifiers, given where these were trained."""

    def __post_init__(self) -> None:
        if not (self.models and self.training_sets):
            raise InputError("a study needs a classifier and a training set.")
        noisy = self.perturbations or any(training_set.noise for training_set in self.training_sets.values())
        if noisy and any(self.scenario_of(name).along_angle for name in self.variants):
            raise InputError(
                "noise is added before a recording is put along the shaft's angle, which would have to be found anew "
                "in each draw; plans with noise cut windows along time."
            )

    def tasks(self, seed: int, data: str, device: str = "cpu") -> list[Task]:
        """Every task of a seed, in order.

        Parameters
        ----------
        data : SHA-256 of the recordings.
        device : where networks are trained.
        """
        scenarios = {name: self.scenario_of(name).describe() for name in self.variants}
        sets = {name: each.describe(self.scenario.faults) for name, each in self.training_sets.items()}
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
                    # called snrs when white noise was all there was; finished runs are found by it
                    "tests": {"snrs": list(map(str, self.perturbations)), "draws": self.draws},
                    **({} if self.split_seed is None else {"split_seed": self.split_seed}),
                },
                data=data,
            )
            for variant, training_set, model in product(self.variants, self.training_sets, self.models)
            if self.bare is None or (variant == self.bare) is (self.training_sets[training_set].by is None)
        ]

    def of_classifiers(self, models: Mapping[str, Model]) -> "Plan":
        """The plan of other classifiers; the first is the study's own, which others are compared with."""
        main, *others = models
        is_single = isinstance(self.compared.get("classifier"), str)
        compared = {**self.compared, **({"classifier": main} if is_single else {})}
        return replace(self, models=models, compared=compared, rivals=tuple(others) if self.rivals else ())

    def of_training_sets(self, names: Sequence[str]) -> "Plan":
        """The plan of some of its training sets only, or of others of `TWIN_TRAINING_SETS`.

        Raises
        ------
        InputError
            There is none of that name.
        """
        choices = {**TWIN_TRAINING_SETS, **self.training_sets}
        for name in names:
            if name not in choices:
                raise InputError(f"{self.study} has no training set {name!r}; there are {', '.join(choices)}.")
        return replace(self, training_sets={name: choices[name] for name in names})

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

    def of_rig(self, version: str) -> "Plan":
        """The plan on a version of the virtual rig, whose twins simulate the faults that it has."""
        return replace(self, scenario=replace(self.scenario, faults=machined_faults(version)))

    def of_values(self, names: Sequence[str]) -> "Plan":
        """The plan at some values of its varied factor only.

        Raises
        ------
        InputError
            It varies nothing, or not by such a value.
        """
        for name in names:
            if not self.varied or name not in self.variants:
                choices = f"the values of {self.varied} are {', '.join(self.variants)}"
                raise InputError(
                    f"{self.study} has no value {name!r} to choose; {choices if self.varied else 'it has none'}."
                )
        return replace(self, variants={name: changes for name, changes in self.variants.items() if name in names})

    def needs_twins(self, task: Task) -> bool:
        """Whether a task is filled by a calibrated twin."""
        return self.training_sets[task.factors["training_set"]].by in CALIBRATED_TWINS

    def data_seed(self, seed: int) -> int:
        """Seed of the data that is trained on under `seed`."""
        return seed if self.split_seed is None else self.split_seed

    def position(self, task: Task) -> tuple[int, ...]:
        """Position of a task's row among those of the plan; classifiers that the plan lacks come last."""
        named: tuple[tuple[Mapping[str, Any], str], ...] = (
            (self.variants, task.factors.get(self.varied, "")),
            (self.training_sets, task.factors["training_set"]),
            (self.models, task.factors["classifier"]),
        )
        return tuple(list(names).index(name) if name in names else len(names) for names, name in named)

    def variant_of(self, task: Task) -> str:
        """Name of the variant that a task is of."""
        return task.factors[self.varied] if self.varied else ""

    def scenario_of(self, variant: str) -> Scenario:
        """The scenario of a variant."""
        return replace(self.scenario, **self.variants[variant])


@dataclass(frozen=True)
class RunFacts:
    """Facts that a run's file holds, and that have no part in its result."""

    device: str = "cpu"
    """Where networks are trained."""
    command: str = ""
    """Command that repeats the study."""
    origin: str = ""
    """Where the recordings come from, in words."""
    calibrations: tuple[str, ...] = ()
    """Names of the calibrations behind the twins."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Figures of the synthetic windows."""
    checkpoint: Path | None = None
    """File that a training saves to after each epoch and goes on from; it is deleted when the training ends."""
    model: Path | None = None
    """File that a trained network is saved to."""


def run_task(task: Task, plan: Plan, dataset: StudyDataset, synthetic: WindowSet, facts: RunFacts) -> Run:
    """One task: train on the measured and the synthetic windows, test at every level.

    Parameters
    ----------
    synthetic : what the task's training_set adds.
    """
    torch.set_num_threads(1)
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
        device=facts.device,
        checkpoint=facts.checkpoint,
        progress=lambda _: ends.append(time.process_time()),
    )
    epoch_time = {EPOCH_TIME: float(np.mean(np.diff(ends)))} if len(ends) > 1 else {}
    if facts.model is not None and isinstance(classifier, FittedClassifier):
        save_classifier(classifier, facts.model)
    outcomes = tuple(_outcomes(classifier, task, plan, dataset))
    tested = dataset.tests
    return Run(
        task=task,
        outcomes=outcomes,
        history=getattr(classifier, "history", ()),
        values={**facts.values, **epoch_time},
        roles=dataset.roles(),
        fingerprints={"train": train.fingerprint(), **{name: test.fingerprint() for name, test in tested.items()}},
        cells={"train": cells_of(train), **{name: cells_of(test) for name, test in tested.items()}},
        calibrations=facts.calibrations,
        origin=facts.origin,
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        device=facts.device if model.is_network else "cpu",
        version=VERSION,
        command=facts.command,
        embedding=_embedding(classifier, task, dataset),
    )


def _outcomes(classifier: Classifier, task: Task, plan: Plan, dataset: StudyDataset) -> Iterator[Outcome]:
    for level, clean in dataset.tests.items():
        for perturbation in (None, *plan.perturbations):
            varied = {"perturbation": str(perturbation or CLEAN)} if plan.perturbations else {}
            factors = {**task.factors, "level": level, **varied}
            for repeat in range(plan.draws if perturbation else 1):
                test = perturbation.of_test(dataset, level, repeat) if perturbation else clean
                tested = UnlistedClassifier(classifier) if level == RANDOM_WINDOWS else classifier
                scores = evaluate(tested, test, level=level)
                yield Outcome(factors, task.seed, scores, scarce_recall(scores, dataset.scenario), repeat)


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


def _embedding(classifier: Classifier, task: Task, dataset: StudyDataset) -> Embedding | None:
    if not isinstance(classifier, FittedClassifier):
        return None
    tests = dataset.tests
    return Embedding(
        factors=task.factors,
        features=np.concatenate([classifier.embed(test) for test in tests.values()]),
        label=np.concatenate([test.label for test in tests.values()]),
        level=np.concatenate([np.full(len(test), level) for level, test in tests.items()]),
    )
