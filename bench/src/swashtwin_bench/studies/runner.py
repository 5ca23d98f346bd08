"""Runs a plan: finished tasks are read, the others run side by side, and each is saved when it ends."""

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swashtwin.calibration import Calibration
from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.recordings import Recording
from swashtwin_bench.results.answers import answer_of
from swashtwin_bench.results.result import METRICS, StudyResult, contrasts_of, trials_of, varied_of
from swashtwin_bench.results.runs import Run, Task, load_run, save_run
from swashtwin_bench.results.table import origin_of
from swashtwin_bench.studies.dataset import (
    CalibrationTask,
    StudyDataset,
    calibration_file,
    calibration_tasks,
    load_finished_calibration,
    prepare,
    read_for,
    run_calibration,
)
from swashtwin_bench.studies.plan import Plan, RunFacts, run_task
from swashtwin_bench.studies.sources import SameRecordings, Source
from swashtwin_bench.studies.training_sets import FURTHER, fill_cells
from swashtwin_bench.studies.workers import Workers

Report = Callable[[str, int, int], None]
_Case = tuple[int, str]
"""Seed, and name of the plan's variant."""

TASKS_AHEAD = 4
"""Tasks for each process that are prepared together: fewer leave processes idle at the end of a batch, more take
memory."""

MOST_SEEDS = 2
"""Seeds whose recordings are in memory at once, however few tasks each has; a fleet of the paper's size takes
0.9 GB."""


@dataclass(frozen=True, eq=False)
class _SeedTasks:
    """Tasks of one seed that have no result yet."""

    seed: int
    recordings: Sequence[Recording]
    tasks: tuple[Task, ...]
    facts: RunFacts


def run_plan(
    plan: Plan,
    data: Source | Sequence[Recording],
    *,
    seeds: Sequence[int] = (0,),
    workers: Workers | None = None,
    out: Path | None = None,
    device: str = "cpu",
    progress: Report | None = None,
    command: str = "",
    checkpoints: bool = False,
    models: bool = False,
) -> StudyResult:
    """The study's table, after every task of every seed was run or read.

    Parameters
    ----------
    data : recordings, or a source of them by seed.
    workers : where tasks run; one after the other in this process by default.
    out : folder of the runs (``OUT/STUDY/KEY/result.json``) and calibrations; what lies there is not run again. None
        writes nothing.
    device : where networks are trained.
    progress : called with (activity, finished, in all); with checkpoints also from another thread, of epochs.
    command : command line that repeats the study.
    checkpoints : whether a training that was interrupted goes on from its last epoch. Needs `out`, on a disk that the
        workers share.
    models : whether trained networks are saved, in ``OUT/STUDY/KEY/model.safetensors``; one that lacks it is trained
        again. Needs `out`.

    Raises
    ------
    DataError
        The recordings cannot be split as the scenario needs.
    ArtifactError
        A run in `out` is damaged.
    InputError
        No seed, or no task.
    """
    started, report = time.perf_counter(), progress or (lambda activity, finished, total: None)
    seeds = tuple(dict.fromkeys(seeds))
    if not seeds:
        raise InputError("a study needs a seed.")
    source, workers = data if isinstance(data, Source) else SameRecordings(data), workers or Workers()
    per_seed = len(plan.tasks(0, ""))
    if not per_seed:
        raise InputError(
            f"{plan.study} has nothing to do: {', '.join(plan.training_sets)} is not trained at {plan.varied} "
            f"{', '.join(plan.variants)}."
        )
    together = min(MOST_SEEDS, max(1, -(-TASKS_AHEAD * workers.jobs // per_seed)))
    runs: list[Run] = []
    calibrations: dict[str, Calibration] = {}
    with workers.started():
        for start in range(0, len(seeds), together):
            batch = []
            for seed in seeds[start : start + together]:
                unfinished, finished = _look_up(plan, source, seed, out, RunFacts(device, command), models)
                runs += finished
                batch += [unfinished] if unfinished.tasks else []
                if finished:
                    report(f"{len(finished)} of seed {seed} done before", len(runs), per_seed * len(seeds))
            for run in _run_seeds(batch, plan, workers, out, calibrations, report, checkpoints, models):
                if out is not None:
                    save_run(run, out)
                runs.append(run)
                report("training", len(runs), per_seed * len(seeds))
    first = (calibrations.get(key) or load_finished_calibration(out, key) for key in first_calibrations(runs))
    return assemble_result(
        plan,
        runs,
        calibrations=[calibration for calibration in first if calibration is not None],
        wall_s=time.perf_counter() - started,
        command=command,
    )


def model_file(out: Path, task: Task) -> Path:
    """Where the trained network of a task lies."""
    return Path(out) / task.study / task.key / "model.safetensors"


def _is_finished(out: Path, task: Task, needs_model: bool) -> bool:
    file = model_file(out, task)
    return (file.parent / "result.json").is_file() and (file.is_file() or not needs_model)


def _look_up(
    plan: Plan, source: Source, seed: int, out: Path | None, facts: RunFacts, models: bool
) -> tuple[_SeedTasks, list[Run]]:
    """(tasks of a seed without a result, finished runs)."""
    recordings, data = source.recordings_for(seed)
    tasks, finished = [], []
    for task in plan.tasks(seed, data, facts.device):
        needs_model = models and plan.models[task.factors["classifier"]].is_network
        if out is not None and _is_finished(out, task, needs_model):
            finished.append(load_run(Path(out) / task.study / task.key))
        else:
            tasks.append(task)
    return _SeedTasks(seed, recordings, tuple(tasks), replace(facts, origin=origin_of(recordings))), finished


def _run_seeds(
    batch: Sequence[_SeedTasks],
    plan: Plan,
    workers: Workers,
    out: Path | None,
    calibrations: dict[str, Calibration],
    report: Report,
    checkpoints: bool,
    models: bool,
) -> Iterator[Run]:
    """Run every task of some seeds: first their calibrations, then what fills their cells, then the trainings."""
    pairs = [(group, task) for group in batch for task in group.tasks]
    groups = {(group.seed, plan.variant_of(task)): group for group, task in pairs}
    with_twins = {(group.seed, plan.variant_of(task)) for group, task in pairs if plan.needs_twins(task)}
    calibration_tasks_of = {
        case: calibration_tasks(group.recordings, plan.scenario_of(case[1]), plan.data_seed(group.seed))
        if case in with_twins
        else []
        for case, group in groups.items()
    }
    read = {
        case: read_for(group.recordings, plan.scenario_of(case[1]), plan.data_seed(group.seed))
        for case, group in groups.items()
    }
    every_task = [task for tasks in calibration_tasks_of.values() for task in tasks]
    _calibrate(every_task, workers, out, calibrations, report)
    datasets = {
        case: prepare(
            group.recordings,
            plan.scenario_of(case[1]),
            plan.data_seed(group.seed),
            [(task, calibrations[task.key]) for task in calibration_tasks_of[case]],
            read=read[case],
            noisy_tests=bool(plan.perturbations),
            noisy_training=any(training_set.noise for training_set in plan.training_sets.values()),
        )
        for case, group in groups.items()
    }
    fills = _fill_cells(pairs, plan, datasets, workers, report)
    sent = {case: replace(dataset, calibrations={}, train_recordings=()) for case, dataset in datasets.items()}
    calls = []
    for group, task in pairs:
        case = (group.seed, plan.variant_of(task))
        synthetic, values = fills[(*case, task.factors["training_set"])]
        names = tuple(calibration_task.key for calibration_task in calibration_tasks_of[case])
        path = None if out is None or not checkpoints else Path(out) / task.study / task.key / "training.safetensors"
        model = None if out is None or not models else model_file(out, task)
        facts = replace(group.facts, calibrations=names, values=values, checkpoint=path, model=model)
        calls.append((task, plan, sent[case], synthetic, facts))
    calls.sort(key=lambda call: not plan.models[call[0].factors["classifier"]].is_network)  # the long ones first
    for _, run in workers.each(run_task, calls):
        yield run


def _calibrate(
    tasks: Sequence[CalibrationTask],
    workers: Workers,
    out: Path | None,
    calibrations: dict[str, Calibration],
    report: Report,
) -> None:
    """Put every calibration into `calibrations`: read from `out` where it lies there, else run and saved there."""
    by_key = {task.key: task for task in tasks}
    for key in by_key:
        if key not in calibrations and (calibration := load_finished_calibration(out, key)) is not None:
            calibrations[key] = calibration
    missing = [key for key in by_key if key not in calibrations]
    calls = [(by_key[key],) for key in missing]
    for count, (index, calibration) in enumerate(workers.each(run_calibration, calls), 1):
        calibrations[missing[index]] = calibration
        if out is not None:
            calibration.save(calibration_file(out, missing[index]))
        report("calibration", count, len(missing))


def _fill_cells(
    pairs: Sequence[tuple[_SeedTasks, Task]],
    plan: Plan,
    datasets: Mapping[_Case, StudyDataset],
    workers: Workers,
    report: Report,
) -> dict[tuple[int, str, str], tuple[WindowSet, dict[str, float]]]:
    """Synthetic windows and their figures, by seed, variant and training set."""
    keys = list(
        dict.fromkeys((group.seed, plan.variant_of(task), task.factors["training_set"]) for group, task in pairs)
    )
    calls = [(datasets[seed, variant], plan.training_sets[name]) for seed, variant, name in keys]
    fills = {}
    for index, fill in workers.each(fill_cells, calls):
        fills[keys[index]] = fill
        report("filling cells", len(fills), len(calls))
    return fills


def first_calibrations(runs: Sequence[Run]) -> list[str]:
    """Names of the calibrations under the first seed."""
    first = min((run.task.seed for run in runs), default=0)
    return list(dict.fromkeys(name for run in runs if run.task.seed == first for name in run.calibrations))


def assemble_result(
    plan: Plan,
    runs: Sequence[Run],
    *,
    calibrations: Sequence[Calibration] = (),
    wall_s: float | None = None,
    command: str = "",
) -> StudyResult:
    """Table of a study, from finished runs, however many they are.

    Parameters
    ----------
    calibrations : those of the first seed, as far as there are files of them.
    wall_s : how long the study took [s]; by default its runs together.
    command : command line that repeats it; by default those of its runs (`StudyResult.commands`).
    """
    ordered = sorted(runs, key=lambda run: (plan.position(run.task), run.task.seed))
    trials = trials_of(ordered)
    further = {name for run in ordered for name in run.values}
    classifiers = list(dict.fromkeys(run.task.factors["classifier"] for run in ordered))
    main = next((name for name in plan.models if name in classifiers and name not in plan.rivals), classifiers[0])
    classes = ordered[0].outcomes[0].scores.classes
    result = StudyResult(
        study=plan.study,
        title=plan.title,
        metrics={
            **METRICS,
            **{f"recall_{name}": f"recall {name.replace('_', ' ')}" for name in classes},
            **{name: heading for name, heading in FURTHER.items() if name in further},
            "wall_s": "time of one run [s]",
        },
        trials=trials,
        answer=(),
        settings=_settings(ordered),
        origin=ordered[0].origin,
        wall_s=sum(run.wall_s for run in ordered) if wall_s is None else wall_s,
        version=ordered[-1].version,
        command=command,
        notes=tuple(_notes(plan, classifiers)),
        device=", ".join(sorted({run.device for run in ordered})),
        size=ordered[0].task.size,
        runs=tuple(ordered),
        main_classifier=main,
        rival_names=tuple(name for name in classifiers if name != main) if plan.rivals else (),
        contrasts=contrasts_of(trials, ordered, plan.compared, plan.bare),
        calibrations=tuple(calibrations),
    )
    return replace(result, answer=answer_of(result))


def _notes(plan: Plan, classifiers: Collection[str]) -> Iterator[str]:
    """What must be read with the numbers of the classifiers that were trained."""
    yield from plan.notes
    yield from (note for name, note in plan.model_notes.items() if name in classifiers)


def _settings(runs: Sequence[Run]) -> dict[str, Any]:
    """Settings of all runs together: the scenario, what differs from it by what a study varies, and by name the
    training sets and the classifiers."""
    first = runs[0].task.settings
    scenarios = {", ".join(varied_of(run)): run.task.settings["scenario"] for run in runs}
    names = {name for scenario in scenarios.values() for name in scenario}
    differing = {name for name in names if len({repr(scenario.get(name)) for scenario in scenarios.values()}) > 1}
    variants = {
        name: {key: scenario[key] for key in sorted(differing) if key in scenario}
        for name, scenario in scenarios.items()
    }
    return {
        **{name: value for name, value in first["scenario"].items() if name not in differing},
        **({"variants": variants} if differing else {}),
        "tests": first["tests"],
        "training_sets": {run.task.factors["training_set"]: run.task.settings["training_set"] for run in runs},
        "models": {run.task.factors["classifier"]: run.task.settings["model"] for run in runs},
    }
