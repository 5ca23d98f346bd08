"""A plan carried out: what is done already is read, the rest is done side by side, and each task is kept as it ends."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swashtwin.bench.results.answers import answer_of
from swashtwin.bench.results.result import METRICS, StudyResult, contrasts_of, trials_of, varied_of
from swashtwin.bench.results.runs import Run, Task, load_run, save_run
from swashtwin.bench.results.table import origin_of
from swashtwin.bench.studies.dataset import (
    CalibrationTask,
    Material,
    calibration_file,
    calibration_tasks,
    carry_out_calibration,
    kept_calibration,
    prepare,
    read_for,
)
from swashtwin.bench.studies.plan import Plan, RunFacts, carry_out
from swashtwin.bench.studies.sources import Known, Source
from swashtwin.bench.studies.training_sets import FURTHER, filled_cells
from swashtwin.bench.studies.workers import Workers
from swashtwin.calibration import Calibration
from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.recordings import Recording

Report = Callable[[str, int, int], None]
Calibrated = list[tuple[CalibrationTask, Calibration]]

TASKS_AHEAD = 4
"""Tasks for each process that are prepared together: fewer leave processes idle at the end of a batch, more take
memory."""

MOST_SEEDS = 2
"""Seeds whose recordings are held at once, however few tasks each has; a fleet of the paper's size takes 0.9 GB."""


@dataclass(frozen=True, eq=False)
class _Seed:
    """What one seed still has to do."""

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
) -> StudyResult:
    """The study's table, after every task of every seed was done or read.

    Parameters
    ----------
    data : recordings, or a source of them by seed.
    workers : where tasks are carried out; one after the other here by default.
    out : folder of the runs (``OUT/STUDY/KEY/result.json``) and calibrations; what lies there is not done again. None
        keeps nothing.
    device : where networks are trained.
    progress : called with (what, done, in all).
    command : command line that repeats the study.

    Raises
    ------
    DataError
        The recordings cannot be split as the scenario wants.
    ArtifactError
        A run in `out` is damaged.
    InputError
        No seed, or nothing to do.
    """
    started, report = time.perf_counter(), progress or (lambda what, done, total: None)
    seeds = tuple(dict.fromkeys(seeds))
    if not seeds:
        raise InputError("a study needs a seed.")
    source, workers = data if isinstance(data, Source) else Known(data), workers or Workers()
    per_seed = len(plan.tasks(0, ""))
    if not per_seed:
        raise InputError(
            f"{plan.study} has nothing to do: {', '.join(plan.fillings)} is not trained at {plan.varied} "
            f"{', '.join(plan.variants)}."
        )
    together = min(MOST_SEEDS, max(1, -(-TASKS_AHEAD * workers.jobs // per_seed)))
    runs: list[Run] = []
    known: dict[str, Calibration] = {}
    with workers.started():
        for start in range(0, len(seeds), together):
            waiting = []
            for seed in seeds[start : start + together]:
                one, done = _looked_up(plan, source, seed, out, RunFacts(device, command))
                runs += done
                waiting += [one] if one.tasks else []
                if done:
                    report(f"{len(done)} of seed {seed} done before", len(runs), per_seed * len(seeds))
            for run in _carried_out(waiting, plan, workers, out, known, report):
                if out is not None:
                    save_run(run, out)
                runs.append(run)
                report("training", len(runs), per_seed * len(seeds))
    found = [known.get(key) or kept_calibration(out, key) for key in first_calibrations(runs)]
    calibrations = tuple(one for one in found if one is not None)
    return assembled(plan, runs, calibrations=calibrations, wall_s=time.perf_counter() - started, command=command)


def _looked_up(plan: Plan, source: Source, seed: int, out: Path | None, facts: RunFacts) -> tuple[_Seed, list[Run]]:
    """What is to be done of a seed, and what is done."""
    recordings, data = source.taken(seed)
    tasks, done = [], []
    for task in plan.tasks(seed, data, facts.device):
        folder = None if out is None else Path(out) / task.study / task.key
        if folder is not None and (folder / "result.json").is_file():
            done.append(load_run(folder))
        else:
            tasks.append(task)
    return _Seed(seed, recordings, tuple(tasks), replace(facts, origin=origin_of(recordings))), done


def _carried_out(
    waiting: Sequence[_Seed],
    plan: Plan,
    workers: Workers,
    out: Path | None,
    known: dict[str, Calibration],
    report: Report,
) -> Iterator[Run]:
    """Every task of some seeds: first their calibrations, then what fills their cells, then the trainings."""
    wanted = {(one.seed, plan.variant_of(task)): one for one in waiting for task in one.tasks}
    filled = {(one.seed, plan.variant_of(task)) for one in waiting for task in one.tasks if plan.needs_twins(task)}
    asked = {
        place: calibration_tasks(one.recordings, plan.scenario_of(place[1]), one.seed) if place in filled else []
        for place, one in wanted.items()
    }
    read = {place: read_for(one.recordings, plan.scenario_of(place[1]), one.seed) for place, one in wanted.items()}
    _calibrate([task for tasks in asked.values() for task in tasks], workers, out, known, report)
    material = {
        place: prepare(
            one.recordings,
            plan.scenario_of(place[1]),
            one.seed,
            [(task, known[task.key]) for task in asked[place]],
            read=read[place],
            noisy_tests=bool(plan.snrs),
            noisy_training=any(one.noise for one in plan.fillings.values()),
        )
        for place, one in wanted.items()
    }
    fills = _filled([(one, task) for one in waiting for task in one.tasks], plan, material, workers, report)
    bare = {place: replace(one, calibrations={}, train_recordings=()) for place, one in material.items()}
    calls = []
    for one in waiting:
        for task in one.tasks:
            place = (one.seed, plan.variant_of(task))
            synthetic, values = fills[(*place, task.factors["training_set"])]
            names = tuple(calibration.key for calibration in asked[place])
            calls.append((task, plan, bare[place], synthetic, replace(one.facts, calibrations=names, values=values)))
    calls.sort(key=lambda call: not plan.models[call[0].factors["classifier"]].is_network)  # the long ones first
    for _, run in workers.each(carry_out, calls):
        yield run


def _calibrate(
    tasks: Sequence[CalibrationTask],
    workers: Workers,
    out: Path | None,
    known: dict[str, Calibration],
    report: Report,
) -> None:
    """Put every calibration into `known`: those that lie in `out` are read, the others made and kept there."""
    by_key = {task.key: task for task in tasks}
    for key in by_key:
        if key not in known and (kept := kept_calibration(out, key)) is not None:
            known[key] = kept
    missing = [key for key in by_key if key not in known]
    calls = [(by_key[key],) for key in missing]
    for done, (place, calibration) in enumerate(workers.each(carry_out_calibration, calls), 1):
        known[missing[place]] = calibration
        if out is not None:
            calibration.save(calibration_file(out, missing[place]))
        report("calibration", done, len(missing))


def _filled(
    tasks: Sequence[tuple[_Seed, Task]],
    plan: Plan,
    material: dict[tuple[int, str], Material],
    workers: Workers,
    report: Report,
) -> dict[tuple[int, str, str], tuple[WindowSet, dict[str, float]]]:
    """Synthetic windows, and what is known of them, by seed, variant and training set."""
    places = list(dict.fromkeys((one.seed, plan.variant_of(task), task.factors["training_set"]) for one, task in tasks))
    calls = [(material[seed, variant], plan.fillings[name]) for seed, variant, name in places]
    found = {}
    for place, made in workers.each(filled_cells, calls):
        found[places[place]] = made
        report("filling cells", len(found), len(calls))
    return found


def first_calibrations(runs: Sequence[Run]) -> list[str]:
    """Names of the calibrations under the first seed."""
    first = min((run.task.seed for run in runs), default=0)
    return list(dict.fromkeys(name for run in runs if run.task.seed == first for name in run.calibrations))


def assembled(
    plan: Plan,
    runs: Sequence[Run],
    *,
    calibrations: Sequence[Calibration] = (),
    wall_s: float | None = None,
    command: str = "",
) -> StudyResult:
    """The study's table of finished runs, however many they are.

    Parameters
    ----------
    calibrations : under the first seed, where they are at hand.
    wall_s : how long the study took [s]; by default its runs together.
    command : command line that repeats it; by default those of its runs (`StudyResult.commands`).
    """
    ordered = sorted(runs, key=lambda run: (plan.place(run.task), run.task.seed))
    trials = trials_of(ordered)
    further = {name for run in ordered for name in run.values}
    found = list(dict.fromkeys(run.task.factors["classifier"] for run in ordered))
    own = next((name for name in plan.models if name in found and name not in plan.rivals), found[0])
    classes = ordered[0].outcomes[0].scores.classes
    told = StudyResult(
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
        notes=tuple(_notes(plan, found)),
        device=", ".join(sorted({run.device for run in ordered})),
        size=ordered[0].task.size,
        runs=tuple(ordered),
        own=own,
        rival_names=tuple(name for name in found if name != own) if plan.rivals else (),
        contrasts=contrasts_of(trials, ordered, plan.compared, plan.bare),
        calibrations=tuple(calibrations),
    )
    return replace(told, answer=answer_of(told))


def _notes(plan: Plan, found: Collection[str]) -> Iterator[str]:
    """What must be read with the numbers of the classifiers that were trained."""
    yield from plan.notes
    yield from (note for name, note in plan.model_notes.items() if name in found)
    if absent := [name for name in plan.absent if name not in found]:
        yield f"Not run here, for want of aeon: {', '.join(absent)}."


def _settings(runs: Sequence[Run]) -> dict[str, Any]:
    """Settings of all runs together: the scenario, what differs from it by what a study varies, and by name the
    training sets and the classifiers."""
    first = runs[0].task.settings
    scenarios = {", ".join(varied_of(run)): run.task.settings["scenario"] for run in runs}
    names = {name for one in scenarios.values() for name in one}
    differing = {name for name in names if len({repr(one.get(name)) for one in scenarios.values()}) > 1}
    variants = {name: {key: one[key] for key in sorted(differing) if key in one} for name, one in scenarios.items()}
    return {
        **{name: value for name, value in first["scenario"].items() if name not in differing},
        **({"variants": variants} if differing else {}),
        "tests": first["tests"],
        "training_sets": {run.task.factors["training_set"]: run.task.settings["training_set"] for run in runs},
        "models": {run.task.factors["classifier"]: run.task.settings["model"] for run in runs},
    }
