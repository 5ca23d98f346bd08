"""Running a plan: finished tasks are read, the others run in parallel and are saved one by one."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swashtwin.calibration import Calibration
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowSet
from swashtwin.recordings import Recording, load_recordings
from swashtwin_bench.results.result import METRICS, RUN_METRICS, StudyResult, build_trials, name_run
from swashtwin_bench.results.runs import Run, Task, Work, fingerprint_recordings, load_run
from swashtwin_bench.results.table import describe_origin
from swashtwin_bench.rigs.writing import RIG_VERSION, SIZES, RigSize, build_rig
from swashtwin_bench.studies.dataset import (
    StudyDataset,
    calibration_tasks,
    load_finished_calibration,
    prepare_dataset,
    run_calibration,
)
from swashtwin_bench.studies.plan import Plan, train_and_test
from swashtwin_bench.studies.scenario import Scenario
from swashtwin_bench.studies.training_sets import fill_cells, for_training

Source = Sequence[Recording] | Callable[[int], Sequence[Recording]]
"""Recordings that are the same under every seed, or a function that returns those of a seed."""

RECORDINGS_PER_REPEAT = 15
"""Recordings of a specimen of the rig in each repeat: five classes at three pressures."""

DEFAULT_SENSORS = 3
"""Accelerometers of the rig by default."""


def run_plan(
    plan: Plan, source: Source, work: Work | None = None, *, keep_models: bool = False
) -> StudyResult:
    """Run all tasks of a study that are not finished, and return its table.

    Parameters
    ----------
    source : recordings, or a function that returns those of a seed.
    work : seeds, processes, and the folder of runs (``OUT/STUDY/KEY/result.json``) and
        calibrations. Finished ones are not run again, and an interrupted training continues after
        its last epoch.
    keep_models : whether trained networks are saved in ``OUT/STUDY/KEY/model.safetensors``; a
        finished training without that file is repeated.

    Raises
    ------
    DataError
        The recordings cannot be split as the scenario needs.
    ArtifactError
        A run in the folder is damaged.
    InputError
        The plan has no task, or it has ceilings and `source` is no fleet of the rig.
    """
    started = time.perf_counter()
    work = work or Work()
    if plan.has_ceilings and not callable(source):
        # The truth is drawn by the seed, so recordings of unknown origin have none.
        raise InputError(
            f"{plan.study} reads no recordings: its ceilings need the truth of the virtual rig. "
            "Leave SOURCE out, or select training_sets without ceiling."
        )

    seeds: Sequence[int] = work.seeds
    if plan.repeats:
        # The data are those of the first seed; only the training is repeated.
        source = source(seeds[0]) if callable(source) else source
        plan = replace(plan, split_seed=seeds[0])
        seeds = range(plan.repeats)

    # The number of tasks depends on neither the seed nor the data.
    tasks_per_seed = len(plan.tasks(0, ""))
    if not tasks_per_seed:
        raise InputError(
            f"{plan.study} has no task: {', '.join(plan.training_sets)} is not trained at "
            f"{plan.varied} {', '.join(plan.variants)}."
        )

    runs: list[Run] = []
    # Recordings that are the same under every seed are hashed once.
    data = "" if callable(source) else fingerprint_recordings(source)
    for seed_number, seed in enumerate(seeds, 1):
        seed_work = work
        if len(seeds) > 1:
            seed_work = work.part(f"seed {seed_number} of {len(seeds)}")
        if callable(source):
            recordings = source(seed)
            data = fingerprint_recordings(recordings)
        else:
            recordings = source

        tasks = plan.tasks(seed, data, work.device)
        open_tasks = []
        for task in tasks:
            if work.out is not None and _is_finished(task, plan, work.out, keep_models):
                runs.append(load_run(task.folder(work.out)))
            else:
                open_tasks.append(task)

        n_finished = tasks_per_seed - len(open_tasks)
        if n_finished:
            activity = f"{n_finished} of seed {seed} already finished"
            work.progress(activity, len(runs), tasks_per_seed * len(seeds))

        trainings = _prepare_trainings(plan, recordings, seed, open_tasks, seed_work, keep_models)
        # Networks first: they take longest, and should not start when the other cores are idle.
        trainings.sort(key=lambda training: not plan.model_of(training.task).is_network)
        runs += seed_work.map("training", _Training.run, [(training,) for training in trainings])

    study = build_study(plan, runs, out=work.out)
    return replace(
        study, wall_s=time.perf_counter() - started, command=work.command or study.command
    )


def _is_finished(task: Task, plan: Plan, out: Path, keep_models: bool) -> bool:
    needs_model = keep_models and plan.model_of(task).is_network
    if needs_model and not model_file(task.folder(out)).is_file():
        return False
    return task.is_finished(out)


def model_file(folder: Path) -> Path:
    """Return the file of a task's trained network in its folder."""
    return folder / "model.safetensors"


@dataclass(frozen=True, eq=False)
class _Training:
    """A task with its data, as it is sent to a process."""

    task: Task
    plan: Plan
    dataset: StudyDataset
    synthetic: WindowSet
    values: Mapping[str, float]
    """Metrics of the synthetic windows."""
    facts: Mapping[str, Any]
    """Further contents of its run: keys of the calibrations, origin, command."""
    out: Path | None
    keep_model: bool

    def run(self) -> Run:
        """Return the run, saved as soon as it is finished."""
        if self.keep_model and self.out is not None:
            # A run without its model counts as finished in its file, but must be repeated.
            folder = self.task.folder(self.out)
            if not model_file(folder).is_file():
                (folder / "result.json").unlink(missing_ok=True)

        return self.task.run(self.out, self._compute)

    def _compute(self) -> dict[str, Any]:
        result = train_and_test(
            self.task,
            self.plan,
            self.dataset,
            self.synthetic,
            self.values,
            self.out,
            keep_model=self.keep_model,
        )
        return {**self.facts, **result}


def _prepare_trainings(
    plan: Plan,
    recordings: Sequence[Recording],
    seed: int,
    tasks: Sequence[Task],
    work: Work,
    keep_models: bool,
) -> list[_Training]:
    """Calibrate the twins, fill the cells, and return the tasks with their data."""
    data_seed = plan.data_seed(seed)

    trainings: list[_Training] = []
    fillings: dict[str, tuple[WindowSet, dict[str, float]]] = {}
    filled_scenario: Scenario | None = None
    for variant in dict.fromkeys(task.factors.get(plan.varied, "") for task in tasks):
        variant_tasks = [task for task in tasks if task.factors.get(plan.varied, "") == variant]
        scenario = plan.scenario_of(variant)

        # A calibration takes long, and training sets without calibrated twins do without.
        searches = []
        if any(plan.needs_twins(task) for task in variant_tasks):
            searches = calibration_tasks(recordings, scenario, data_seed)
        calibrations = work.map(
            "calibration", run_calibration, [(search, work.out) for search in searches]
        )
        dataset = prepare_dataset(
            recordings,
            scenario,
            data_seed,
            zip(searches, calibrations, strict=True),
            noisy_tests=bool(plan.perturbations),
            rig=plan.rig,
        )

        # A reference changes windows after they are made: scenarios with and without share them.
        if replace(scenario, with_reference=False) != filled_scenario:
            filled_scenario = replace(scenario, with_reference=False)
            fillings = {}
        names = list(dict.fromkeys(task.factors["training_set"] for task in variant_tasks))
        missing = [name for name in names if name not in fillings]
        new_fillings = work.map(
            "filling cells", fill_cells, [(dataset, plan.training_sets[name]) for name in missing]
        )
        fillings.update(zip(missing, new_fillings, strict=True))
        synthetic_by_name = {
            name: for_training(dataset, plan.training_sets[name], fillings[name][0])
            for name in names
        }

        facts = {
            "calibrations": [search.key for search in searches],
            "origin": describe_origin(recordings),
            "command": work.command,
        }
        # The cells are filled: without the calibrations less is sent to each process.
        training_dataset = dataset.for_training()
        for task in variant_tasks:
            name = task.factors["training_set"]
            trainings.append(
                _Training(
                    task,
                    plan,
                    training_dataset,
                    synthetic_by_name[name],
                    fillings[name][1],
                    facts,
                    work.out,
                    keep_models,
                )
            )

    return trainings


def build_study(
    plan: Plan,
    runs: Sequence[Run],
    *,
    out: Path | None = None,
    calibrations: Sequence[Calibration] | None = None,
) -> StudyResult:
    """Return the table of a study from the runs that are finished.

    Parameters
    ----------
    out : folder of the calibrations.
    calibrations : calibrations of the first seed; by default those whose files are in `out`.
    """
    ordered = sorted(runs, key=lambda run: (plan.position(run["factors"]), run["seed"]))
    if calibrations is None:
        calibrations = _load_first_calibrations(ordered, out)

    metrics = dict(METRICS)
    for name in ordered[0]["classes"]:
        metrics[f"recall_{name}"] = f"recall {name.replace('_', ' ')}"
    value_names = {"wall_s"}.union(*(run["values"] for run in ordered))
    for name, heading in RUN_METRICS.items():
        if name in value_names:
            metrics[name] = heading

    # Runs may come from several calls, each with its command and device.
    commands = dict.fromkeys(run["command"] for run in ordered if run["command"])
    study = StudyResult(
        study=plan.study,
        title=plan.title,
        metrics=metrics,
        trials=build_trials(ordered),
        answer=(),
        settings=_collect_settings(ordered),
        origin=ordered[0]["origin"],
        wall_s=sum(run["wall_s"] for run in ordered),
        command=" && ".join(commands),
        notes=plan.notes,
        device=", ".join(sorted({run["device"] for run in ordered})),
        size=ordered[0]["size"],
        runs=tuple(ordered),
        reference_values=plan.reference_values,
        metric=plan.metric,
        contrasts=plan.contrasts,
        unfilled_variant=plan.unfilled_variant,
        calibrations=tuple(calibrations),
    )
    return replace(study, answer=study.sentences())


def _load_first_calibrations(runs: Sequence[Run], out: Path | None) -> list[Calibration]:
    """Return the calibrations of the first seed whose files are in `out`."""
    first_seed = min(run["seed"] for run in runs)
    keys: dict[str, None] = {}
    for run in runs:
        if run["seed"] == first_seed:
            keys.update(dict.fromkeys(run["calibrations"]))

    calibrations = [load_finished_calibration(out, key) for key in keys]
    return [calibration for calibration in calibrations if calibration is not None]


def _collect_settings(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the settings of all runs together.

    These are the scenario, what differs from it by variant, and the training sets and classifiers
    by name.
    """
    scenarios: dict[str, Mapping[str, Any]] = {}
    for run in runs:
        variant = name_run(run, "classifier", "training_set")
        scenarios[variant] = run["settings"]["scenario"]

    varied = []
    for name in sorted(set().union(*scenarios.values())):
        # Compared as text, because lists and dicts have no hash.
        values = {repr(scenario.get(name)) for scenario in scenarios.values()}
        if len(values) > 1:
            varied.append(name)

    first = runs[0]["settings"]
    settings = {name: value for name, value in first["scenario"].items() if name not in varied}
    if varied:
        variants: dict[str, Any] = {}
        for variant, scenario in scenarios.items():
            variants[variant] = {name: scenario[name] for name in varied if name in scenario}
        settings["variants"] = variants
    settings["tests"] = first["tests"]
    settings["training_sets"] = {
        run["factors"]["training_set"]: run["settings"]["training_set"] for run in runs
    }
    settings["models"] = {run["factors"]["classifier"]: run["settings"]["model"] for run in runs}
    return settings


def find_fleets(
    folder: Path, size: str, version: str, work: Work, sensors: int = DEFAULT_SENSORS
) -> Callable[[int], Sequence[Recording]]:
    """Return a function that returns the fleet of the virtual rig of a seed.

    A fleet is built once and kept in `folder` as ``rig-SIZE-SEED``, or ``rigVERSION-SIZE-SEED`` if
    the version is not 1, with ``-13`` appended for 13 sensors.
    """
    prefix = "rig" if version == RIG_VERSION else f"rig{version}"
    suffix = "" if sensors == DEFAULT_SENSORS else f"-{sensors}"

    def show_recording(count: int, total: int) -> None:
        work.progress("recording on the rig", count, total)

    def load_fleet(seed: int) -> Sequence[Recording]:
        fleet_folder = Path(folder) / f"{prefix}-{size}-{seed}{suffix}"
        if not (fleet_folder / "recordings.toml").is_file():
            build_rig(
                fleet_folder,
                seed=seed,
                size=size,
                version=version,
                sensors=sensors,
                jobs=work.jobs,
                progress=show_recording,
            )

        recordings = list(load_recordings(fleet_folder))
        require_rig(fleet_folder, recordings, SIZES[size], version)
        return recordings

    return load_fleet


def require_rig(
    folder: Path, recordings: Sequence[Recording], size: RigSize, version: str = RIG_VERSION
) -> None:
    """Refuse a folder that does not contain a complete rig of that size and version.

    Raises
    ------
    DataError
        The version or the number of recordings differs.
    """
    origin = recordings[0].attributes.get("origin", "")
    is_complete = len(recordings) == size.specimens * size.repeats * RECORDINGS_PER_REPEAT
    if not (origin.endswith(f"version {version}") and is_complete):
        raise DataError(
            f"{folder} contains other recordings than this rig.",
            field="out",
            remedy="Delete it, or choose another folder with {out}.",
        )
