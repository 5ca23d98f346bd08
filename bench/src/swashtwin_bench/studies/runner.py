"""Runs a plan: finished tasks are read, the others run side by side, and each is saved when it
ends.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from swashtwin.calibration import Calibration
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowSet
from swashtwin.recordings import Recording, load_recordings
from swashtwin_bench.results.result import FURTHER, METRICS, StudyResult, build_trials
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
from swashtwin_bench.studies.training_sets import fill_cells

Source = Sequence[Recording] | Callable[[int], Sequence[Recording]]
"""Recordings: the same under every seed, or those of a seed."""

_Call = tuple[Task, Plan, StudyDataset, WindowSet, dict[str, Any], Work, bool]


def run_plan(
    plan: Plan, source: Source, work: Work | None = None, *, keep_models: bool = False
) -> StudyResult:
    """The study's table, after every task of every seed was run or read.

    Parameters
    ----------
    source : recordings, or what gives those of a seed.
    work : seeds, processes, and the folder of the runs (``OUT/STUDY/KEY/result.json``) and
        calibrations; what lies there is not run again, and a training that was interrupted goes on
        from its last epoch.
    keep_models : whether trained networks are saved, in ``OUT/STUDY/KEY/model.safetensors``; one
        that lacks it is trained again.

    Raises
    ------
    DataError
        The recordings cannot be split as the scenario needs.
    ArtifactError
        A run in the folder is damaged.
    InputError
        No task.
    """
    started, work = time.perf_counter(), work or Work()
    seeds: Sequence[int] = work.seeds
    if plan.repeats:
        source = source(seeds[0]) if callable(source) else source
        plan, seeds = replace(plan, split_seed=seeds[0]), range(plan.repeats)
    per_seed = len(plan.tasks(0, ""))
    if not per_seed:
        raise InputError(
            f"{plan.study} has nothing to do: {', '.join(plan.training_sets)} is not trained at {plan.varied} "
            f"{', '.join(plan.variants)}."
        )
    runs: list[Run] = []
    data = "" if callable(source) else fingerprint_recordings(source)
    for seed in seeds:
        recordings = source(seed) if callable(source) else source
        data = fingerprint_recordings(recordings) if callable(source) else data
        tasks = plan.tasks(seed, data, work.device)
        todo = [task for task in tasks if not _is_finished(task, plan, work.out, keep_models)]
        runs += [
            load_run(task.folder(work.out))
            for task in tasks
            if work.out is not None and task not in todo
        ]
        if len(todo) < per_seed:
            done = per_seed - len(todo)
            work.progress(f"{done} of seed {seed} done before", len(runs), per_seed * len(seeds))
        calls = _calls(plan, recordings, seed, todo, work, keep_models)
        calls.sort(
            key=lambda call: not plan.models[call[0].factors["classifier"]].is_network
        )  # the long ones first
        runs += work.map("training", _finished_training, calls)
    result = build_study(plan, runs, out=work.out)
    return replace(
        result, wall_s=time.perf_counter() - started, command=work.command or result.command
    )


def _is_finished(task: Task, plan: Plan, out: Path | None, keep_models: bool) -> bool:
    needs_model = keep_models and plan.models[task.factors["classifier"]].is_network
    return (
        out is not None
        and task.is_finished(out)
        and (not needs_model or model_file(task.folder(out)).is_file())
    )


def model_file(folder: Path) -> Path:
    """Where the trained network of a task lies in its folder."""
    return folder / "model.safetensors"


def _calls(
    plan: Plan,
    recordings: Sequence[Recording],
    seed: int,
    todo: Sequence[Task],
    work: Work,
    keep_models: bool,
) -> list[_Call]:
    """What `_finished_training` is called with for each task: first the calibrations, then what
    fills the cells.
    """
    calls: list[_Call] = []
    variants = dict.fromkeys(task.factors.get(plan.varied, "") for task in todo)
    for variant in variants:
        tasks = [task for task in todo if task.factors.get(plan.varied, "") == variant]
        scenario, data_seed = plan.scenario_of(variant), plan.data_seed(seed)
        searches = (
            calibration_tasks(recordings, scenario, data_seed)
            if any(map(plan.needs_twins, tasks))
            else []
        )
        calibrations = work.map(
            "calibration", run_calibration, [(search, work.out) for search in searches]
        )
        dataset = prepare_dataset(
            recordings,
            scenario,
            data_seed,
            zip(searches, calibrations, strict=True),
            noisy_tests=bool(plan.perturbations),
        )
        names = list(dict.fromkeys(task.factors["training_set"] for task in tasks))
        fills = work.map(
            "filling cells", fill_cells, [(dataset, plan.training_sets[name]) for name in names]
        )
        filled = dict(zip(names, fills, strict=True))
        sent = replace(dataset, calibrations={})
        facts = {
            "calibrations": [search.key for search in searches],
            "origin": describe_origin(recordings),
        }
        quiet = Work(work.seeds, out=work.out, command=work.command)
        for task in tasks:
            synthetic, values = filled[task.factors["training_set"]]
            calls.append(
                (task, plan, sent, synthetic, {**facts, "values": values}, quiet, keep_models)
            )
    return calls


def _finished_training(
    task: Task,
    plan: Plan,
    dataset: StudyDataset,
    synthetic: WindowSet,
    facts: Mapping[str, Any],
    work: Work,
    keep_model: bool,
) -> Run:
    """The run of a task, saved as soon as it is done."""
    if keep_model and work.out is not None and not model_file(task.folder(work.out)).is_file():
        (task.folder(work.out) / "result.json").unlink(missing_ok=True)

    def compute() -> dict[str, Any]:
        values = facts["values"]
        result = train_and_test(
            task, plan, dataset, synthetic, values, work.out, keep_model=keep_model
        )
        return {
            **{name: facts[name] for name in ("calibrations", "origin")},
            "command": work.command,
            **result,
        }

    return task.run(work.out, compute)


def build_study(
    plan: Plan,
    runs: Sequence[Run],
    *,
    out: Path | None = None,
    calibrations: Sequence[Calibration] | None = None,
) -> StudyResult:
    """Table of a study, from finished runs, however many they are.

    Parameters
    ----------
    out : folder of the calibrations.
    calibrations : those of the first seed; by default as far as they lie in `out`.
    """
    ordered = sorted(runs, key=lambda run: (plan.position(run["factors"]), run["seed"]))
    first = min(run["seed"] for run in ordered)
    if calibrations is None:
        keys = dict.fromkeys(
            key for run in ordered if run["seed"] == first for key in run["calibrations"]
        )
        calibrations = [
            each for key in keys if (each := load_finished_calibration(out, key)) is not None
        ]
    further = {name for run in ordered for name in (*run["values"], "wall_s")}
    commands = dict.fromkeys(run["command"] for run in ordered if run["command"])
    result = StudyResult(
        study=plan.study,
        title=plan.title,
        metrics={
            **METRICS,
            **{
                f"recall_{name}": f"recall {name.replace('_', ' ')}"
                for name in ordered[0]["classes"]
            },
            **{name: heading for name, heading in FURTHER.items() if name in further},
        },
        trials=build_trials(ordered),
        answer=(),
        settings=_settings(ordered),
        origin=ordered[0]["origin"],
        wall_s=sum(run["wall_s"] for run in ordered),
        command=" && ".join(commands),
        notes=plan.notes,
        device=", ".join(sorted({run["device"] for run in ordered})),
        size=ordered[0]["size"],
        runs=tuple(ordered),
        reference_values=plan.reference_values,
        unfilled_variant=plan.unfilled_variant,
        calibrations=tuple(calibrations),
    )
    return replace(result, answer=result.sentences())


def _settings(runs: Sequence[Run]) -> dict[str, Any]:
    """Settings of all runs together: the scenario, what differs from it by what a study varies, and
    by name the training sets and the classifiers.
    """
    first = runs[0]["settings"]
    scenarios = {
        ", ".join(
            value
            for name, value in run["factors"].items()
            if name not in ("classifier", "training_set")
        ): run["settings"]["scenario"]
        for run in runs
    }
    names = {name for scenario in scenarios.values() for name in scenario}
    differing = {
        name
        for name in names
        if len({repr(scenario.get(name)) for scenario in scenarios.values()}) > 1
    }
    variants = {
        name: {key: scenario[key] for key in sorted(differing) if key in scenario}
        for name, scenario in scenarios.items()
    }
    return {
        **{name: value for name, value in first["scenario"].items() if name not in differing},
        **({"variants": variants} if differing else {}),
        "tests": first["tests"],
        "training_sets": {
            run["factors"]["training_set"]: run["settings"]["training_set"] for run in runs
        },
        "models": {run["factors"]["classifier"]: run["settings"]["model"] for run in runs},
    }


def fleets(
    folder: Path, size: str, version: str, work: Work, sensors: int = 3
) -> Callable[[int], Sequence[Recording]]:
    """What gives the fleet of the virtual rig of a seed, built once and kept as ``rig-SIZE-SEED``
    in `folder`, or ``rigVERSION-SIZE-SEED`` where the version is not 1, with ``-13`` behind it
    where there are 13 sensors.
    """

    def fleet(seed: int) -> Sequence[Recording]:
        name = "rig" if version == RIG_VERSION else f"rig{version}"
        place = Path(folder) / f"{name}-{size}-{seed}{'' if sensors == 3 else f'-{sensors}'}"
        if not (place / "recordings.toml").is_file():
            show = lambda count, total: work.progress("recording on the rig", count, total)  # noqa: E731
            build_rig(
                place,
                seed=seed,
                size=size,
                version=version,
                sensors=sensors,
                jobs=work.jobs,
                progress=show,
            )
        recordings = list(load_recordings(place))
        require_rig(place, recordings, SIZES[size], version)
        return recordings

    return fleet


def require_rig(
    folder: Path, recordings: Sequence[Recording], size: RigSize, version: str = RIG_VERSION
) -> None:
    """Refuse a folder that holds other recordings than a whole rig of that size and version.

    Raises
    ------
    DataError
        It does.
    """
    origin = recordings[0].attributes.get("origin", "")
    is_whole = len(recordings) == size.specimens * size.repeats * 15
    if not (origin.endswith(f"version {version}") and is_whole):
        raise DataError(
            f"{folder} holds other recordings than this rig; delete it, or name another --out."
        )
