"""Collects the finished runs of a folder into studies."""

from collections.abc import Sequence, Set
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError
from swashtwin_bench.results.result import StudyResult, varied_of
from swashtwin_bench.results.runs import OtherFormatError, Run, load_run
from swashtwin_bench.studies.dataset import load_finished_calibration
from swashtwin_bench.studies.registry import PLANS, plan_of
from swashtwin_bench.studies.runner import assemble_result, first_calibrations


def collect_studies(folder: Path) -> list[StudyResult]:
    """Every study whose runs lie below a folder, in the order of `PLANS`, each size by itself.

    Runs that another version wrote are left out. The latest run of a study says which recordings it is about, under
    each seed the latest one of these, and so do scenario and settings of each row; runs of others are left out, and a
    note says how many.

    Raises
    ------
    DataError
        There is no such folder, or no finished run in it.
    ArtifactError
        A run is damaged.
    """
    if not Path(folder).is_dir():
        raise DataError(f"{folder} does not exist, or is no folder; give the --out of a study of swashtwin bench.")
    paths = sorted(Path(folder).rglob("result.json"), key=lambda path: (path.stat().st_mtime_ns, path.as_posix()))
    runs, older = [], 0
    for path in paths:
        try:
            runs.append(load_run(path.parent))
        except OtherFormatError:
            older += 1
    if not runs:
        raise DataError(
            f"{folder} holds no finished run of a study{f' but {older} of another version' if older else ''}; give the "
            "--out of a study of swashtwin bench."
        )
    order = {name: position for position, name in enumerate(PLANS)}
    kinds = sorted({(run.task.study, run.task.size) for run in runs}, key=lambda kind: (order.get(kind[0], 99), kind))
    shown_calibrations: set[str] = set()
    studies = []
    for kind in kinds:
        of_kind = [run for run in runs if (run.task.study, run.task.size) == kind]
        studies.append(_study(Path(folder), of_kind, shown_calibrations))
        shown_calibrations |= set(first_calibrations(studies[-1].runs))
    if older:
        note = f"{older} runs of another version of swashtwin lie in the folder and are left out."
        studies[0] = replace(studies[0], notes=(*studies[0].notes, note))
    return studies


def _study(folder: Path, runs: Sequence[Run], shown_calibrations: Set[str]) -> StudyResult:
    """Study of some runs, with the calibrations of its first seed that no study before it has shown."""
    latest = _latest(runs)
    task = runs[0].task
    if task.study not in PLANS:
        raise DataError(f"{folder} holds runs of {task.study!r}, which is none of {', '.join(PLANS)}.")
    plan = plan_of(task.study, task.size)
    if len(latest) < len(runs):
        left_out = f"{len(runs) - len(latest)} runs of other settings or recordings lie in the folder and are left out."
        plan = replace(plan, notes=(*plan.notes, left_out))
    calibrations = [
        load_finished_calibration(folder, key) for key in first_calibrations(latest) if key not in shown_calibrations
    ]
    return assemble_result(
        plan, latest, calibrations=[calibration for calibration in calibrations if calibration is not None]
    )


def _latest(runs: Sequence[Run]) -> list[Run]:
    """Runs of the latest recordings and settings, one for each row and seed; `runs` are in the order of time."""
    candidates = [run for run in runs if run.origin == runs[-1].origin]
    split_anew = len({(run.task.data, run.task.seed) for run in candidates}) > len(
        {run.task.data for run in candidates}
    )
    if split_anew:  # not a fleet for each seed: other recordings under other seeds are another study
        candidates = [run for run in candidates if run.task.data == runs[-1].task.data]
    seed, data, settings = (attrgetter(f"task.{name}") for name in ("seed", "data", "settings"))
    for agreeing, value_of in ((varied_of, _scenario_and_tests), (_row, settings), (seed, data)):
        latest = {agreeing(run): value_of(run) for run in candidates}
        candidates = [run for run in candidates if value_of(run) == latest[agreeing(run)]]
    return list({(_row(run), run.task.seed): run for run in candidates}.values())


def _row(run: Run) -> tuple[tuple[str, str], ...]:
    return tuple(run.task.factors.items())


def _scenario_and_tests(run: Run) -> tuple[Any, Any]:
    return run.task.settings["scenario"], run.task.settings["tests"]
