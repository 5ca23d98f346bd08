"""`run_paper`: every experiment of the paper, run or read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

from swashtwin.foundation import InputError
from swashtwin_bench.paper.identification import STUDY as IDENTIFICATION
from swashtwin_bench.paper.identification import run_identification
from swashtwin_bench.paper.plans import PAPER_PLANS, REPEATS, SIZES
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.rigs.writing import DEEP_VERSION, RIG_VERSION
from swashtwin_bench.studies.runner import run_plan
from swashtwin_bench.studies.sources import Fleets, SameRecordings, Source
from swashtwin_bench.studies.training_sets import PAPER_TRAINING_SETS
from swashtwin_bench.studies.workers import Workers

RECESS = "paper-recess"
"""Study on fleets with the paper's recess."""

REPEATED = "paper-algorithms"
"""Study whose seeds are trainings on the same data, not fleets."""

EXPERIMENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "case1": ("paper-case1", "paper-case1-random"),
        "case2": ("paper-case2", "paper-case2-random"),
        "recess": (RECESS,),
        "algorithms": (REPEATED,),
        "ablation": ("paper-ablation",),
        "noise": ("paper-noise",),
        "related": ("paper-related",),
        "identification": (IDENTIFICATION,),
    }
)
"""Studies of each experiment of the paper, in the order of the page."""


def run_paper(
    out: Path,
    *,
    size: str = "small",
    seeds: Sequence[int] = (20,),
    experiments: Sequence[str] = tuple(EXPERIMENTS),
    training_sets: Sequence[str] | None = None,
    jobs: int = 1,
    device: str = "cpu",
    precision: str = "float32",
    progress: Callable[[str, int, int], None] | None = None,
    command: str = "",
) -> dict[str, StudyTable]:
    """Result of every study of some experiments, by its name; finished runs below `out` are read.

    Parameters
    ----------
    out : folder of fleets, runs and checkpoints of trainings.
    size : name in `plans.SIZES`.
    seeds : fleets of the virtual rig; the algorithms are repeated on the first.
    experiments : names in `EXPERIMENTS`.
    training_sets : names in `PAPER_TRAINING_SETS`, for the experiments that compare them; the others, and all where
        it is None, take their own.
    jobs : tasks side by side.
    device : where networks are trained.
    precision : in which numbers (`TrainingSettings.precision`).
    progress : called with (activity, finished, in all).
    command : command line that repeats it.

    Raises
    ------
    InputError
        No such size, experiment or training set, or no seed.
    """
    unknown = [name for name in experiments if name not in EXPERIMENTS]
    if size not in SIZES or unknown or not experiments:
        raise InputError(
            f"no experiment {', '.join(unknown) or 'is named'} of size {size!r}; there are {', '.join(EXPERIMENTS)}, "
            f"of size {' or '.join(SIZES)}."
        )
    if foreign := [name for name in training_sets or () if name not in PAPER_TRAINING_SETS]:
        raise InputError(f"no training set {foreign[0]!r}; the paper has {', '.join(PAPER_TRAINING_SETS)}.")
    if not seeds:
        raise InputError("give at least one seed, which draws a fleet of pumps.")
    rig_size = "small" if size == "small" else "paper"
    report = progress or (lambda activity, finished, total: None)

    def fleets_of(version: str) -> Fleets:
        show = partial(report, "recording on the rig")
        return Fleets(Path(out), rig_size, version, jobs=jobs, progress=show)

    fleets = fleets_of(RIG_VERSION)
    results: dict[str, StudyTable] = {}
    for study in (study for name in EXPERIMENTS if name in experiments for study in EXPERIMENTS[name]):

        def show(activity: str, finished: int, total: int, study: str = study) -> None:
            report(f"{study}: {activity}", finished, total)

        if study == IDENTIFICATION:
            results[study] = run_identification(
                fleets,
                size=size,
                seeds=seeds,
                jobs=jobs,
                out=out,
                progress=lambda *count, show=show: show("search", *count),
                command=command,
            )
            continue
        plan, numbers = PAPER_PLANS[study](size), tuple(seeds)
        models = {name: model.with_training(precision=precision) for name, model in plan.models.items()}
        plan = replace(plan, models=models)
        if wanted := [name for name in training_sets or () if name in plan.training_sets]:
            plan = plan.of_training_sets(wanted)
        source: Source = fleets_of(DEEP_VERSION) if study == RECESS else fleets
        if study == REPEATED:
            plan = replace(plan, split_seed=seeds[0])
            source = SameRecordings(fleets.recordings_for(seeds[0])[0])
            numbers = tuple(range(REPEATS[size]))
        results[study] = run_plan(
            plan,
            source,
            seeds=numbers,
            workers=Workers(jobs),
            out=out,
            device=device,
            progress=show,
            command=command,
            checkpoints=True,
        )
    return results
