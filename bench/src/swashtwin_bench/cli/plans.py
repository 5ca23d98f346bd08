"""Commands of the studies that train classifiers as a plan of tasks: bench case1, case2, and so on."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli import Json, as_folder, note_done_before, progress, read_seeds, read_words, resumable
from swashtwin_bench.cli.results import tell_study, typed_command
from swashtwin_bench.cli.rig import RigVersionName, VersionOfRig, require_rig_for

if TYPE_CHECKING:
    from swashtwin_bench import Plan, Workers


class StudySize(StrEnum):
    """Counts and epochs of a study."""

    quick = "quick"
    paper = "paper"


class Backend(StrEnum):
    """What runs the tasks."""

    joblib = "joblib"
    dask = "dask"


class Device(StrEnum):
    """Where networks are trained."""

    cpu = "cpu"
    cuda = "cuda"


OptionalIndex = Annotated[
    Path | None,
    typer.Argument(metavar="[INDEX]", help="Index file, the folder that holds recordings.toml, or a store."),
]
Rig = Annotated[
    bool, typer.Option("--rig", help="A fleet of the virtual rig for each seed, built once into OUT/rig-SIZE-SEED.")
]
Size = Annotated[
    StudySize,
    typer.Option(
        help="quick: small counts, short trainings, with --rig the small rig; paper: the paper's counts and epochs, "
        "with --rig the paper-sized rig."
    ),
]
Seeds = Annotated[str, typer.Option(help='Seeds of split, weights and synthesis, with --rig of fleets: "0,1,2".')]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder of the runs, which a re-run continues, and of STUDY/report.html.", callback=as_folder),
]
TaskJobs = Annotated[int, typer.Option("--jobs", min=1, help="Number of parallel tasks, each on one thread.")]
BackendName = Annotated[Backend, typer.Option(help="What runs the tasks; the numbers are the same.")]
Address = Annotated[str | None, typer.Option(help="Scheduler of a running dask cluster: tcp://HOST:8786.")]
Classifiers = Annotated[
    str | None, typer.Option(help='Classifiers to train instead of the study\'s: "bitcn,tcn,bitcn_paper".')
]
TrainingSets = Annotated[
    str | None, typer.Option(help='These training sets instead of the study\'s: "calibrated,posterior".')
]
Values = Annotated[
    str | None, typer.Option(help='Only these values of what the study varies: "0,200" of augmentation.')
]
StudyWindow = Annotated[
    int | None, typer.Option("--window", min=2, help="Samples per window; 2048 by default, 80 ms at 25.6 kHz.")
]
DeviceName = Annotated[Device, typer.Option(help="Where networks are trained.")]


STUDIES = {
    "case1": "Case I, few samples: what a twin adds where one class has few measured windows.",
    "case2": "Case II, missing condition: a cell without any measured window, which twins fill.",
    "algorithms": "Every network and baseline on Case I's calibrated training set.",
    "ablation": "BiTCN without one of its parts, or trained otherwise, on Case I's calibrated training set.",
    "noise": "Noise, gains and speeds in the tests, for classifiers trained clean and with noise.",
    "shaft-angle": "Case I from windows along the shaft's angle, beside those along time.",
    "augmentation": "Every filler of the scarce cell of Case I, by the number of synthetic windows.",
    "calibrators": "Twins calibrated by the paper's IPINN and by Gauss-Newton, and the scores in Case I.",
    "few-shot": "From no measured window of the scarce cell to 200, with and without twins.",
    "unseen-pressure": "No fault was ever measured at the test's pressure: filled by twins, and not.",
    "unseen-specimen": "How many pumps must be known to diagnose the faults of another.",
}
"""Question of each study, by its name."""


def plan_command(study: str) -> Callable[..., None]:
    """The command that runs a study of `STUDIES`; all have the same options."""

    def command(
        source: OptionalIndex = None,
        rig: Rig = False,
        rig_version: VersionOfRig = RigVersionName.first,
        size: Size = StudySize.quick,
        seeds: Seeds = "0",
        out: Out = None,
        jobs: TaskJobs = 2,
        backend: BackendName = Backend.joblib,
        address: Address = None,
        device: DeviceName = Device.cpu,
        classifiers: Classifiers = None,
        training_sets: TrainingSets = None,
        values: Values = None,
        window: StudyWindow = None,
        as_json: Json = False,
    ) -> None:
        if (source is None) is not rig:
            raise typer.BadParameter("give either recordings or --rig.", param_hint="INDEX")
        require_rig_for(rig_version, rig)
        if rig and out is None:
            raise typer.BadParameter("is needed by --rig: the fleets are built into it.", param_hint="--out")
        numbers = read_seeds(seeds)
        from swashtwin_bench import Workers, models_of, plan_of

        plan = plan_of(study, size.value)
        if classifiers is not None:
            plan = plan.of_classifiers(models_of(size.value, read_words(classifiers)))
        if training_sets is not None:
            plan = plan.of_training_sets(read_words(training_sets))
        if values is not None:
            plan = plan.of_values(read_words(values))
        if window is not None:
            plan = plan.of_window(window)
        workers = Workers(jobs, backend.value, address)
        _run_plan(plan, source, rig_version.value, numbers, out, workers, device.value, as_json)

    command.__doc__ = STUDIES[study]
    return command


def _run_plan(
    plan: "Plan",
    source: Path | None,
    rig_version: str,
    seeds: list[int],
    out: Path | None,
    workers: "Workers",
    device: str,
    as_json: bool,
) -> None:
    from swashtwin.recordings import load_recordings
    from swashtwin_bench import Fleets, SameRecordings, run_plan

    hint = "with --out, finished runs would be kept"
    if out is not None:
        hint = "finished runs are kept; the same command resumes"
    with resumable(hint), progress(plan.study) as bar:

        def show_step(step: str, count: int, total: int) -> None:
            note_done_before(step, out)
            bar(count, total, f"{plan.study}: {step}")

        if source is not None:
            data: SameRecordings | Fleets = SameRecordings(load_recordings(source))
        else:
            rig = {"quick": "small", "paper": "paper"}[plan.size]
            plan = plan.of_rig(rig_version)
            data = Fleets(
                Path(out or "."),
                rig,
                rig_version,
                workers.jobs,
                lambda *count: show_step("recording on the rig", *count),
            )
        result = run_plan(
            plan,
            data,
            seeds=seeds,
            workers=workers,
            out=out,
            device=device,
            progress=show_step,
            command=typed_command(),
        )
    tell_study(result, None if out is None else out / plan.study, as_json)
