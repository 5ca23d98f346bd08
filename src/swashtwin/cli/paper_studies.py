"""Commands of the studies that train classifiers: study case1, case2, and all others that run as a plan of tasks."""

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, progress
from swashtwin.cli.exits import resumable
from swashtwin.cli.options import Json, as_folder, list_of
from swashtwin.cli.studying import StudySize, tell_study, this_command

if TYPE_CHECKING:
    from swashtwin.bench import Plan, Workers


class Backend(StrEnum):
    """What carries tasks out."""

    joblib = "joblib"
    dask = "dask"
    ray = "ray"


class Device(StrEnum):
    """Where networks are trained."""

    cpu = "cpu"
    cuda = "cuda"


Source = Annotated[
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
    typer.Option(help="Folder of the runs, which a re-run takes up, and of STUDY/report.html.", callback=as_folder),
]
TaskJobs = Annotated[int, typer.Option("--jobs", min=1, help="Tasks that run side by side, each on one thread.")]
BackendName = Annotated[Backend, typer.Option(help="What carries tasks out; the numbers are the same.")]
Address = Annotated[
    str | None, typer.Option(help="Scheduler of a running dask or ray cluster: tcp://HOST:8786, ray://HOST:10001.")
]
Models = Annotated[
    str | None, typer.Option(help='Classifiers to train instead of the study\'s: "bitcn,tcn,bitcn_paper".')
]
TrainingSets = Annotated[
    str | None, typer.Option(help='Of the study\'s training sets only these: "measured,calibrated".')
]
Values = Annotated[
    str | None, typer.Option(help='Of the values that the study varies by only these: "0,200" of augmentation.')
]
DeviceName = Annotated[Device, typer.Option(help="Where networks are trained.")]


STUDIES = {
    "case1": "Case I, few samples: what a twin adds where one class has few measured windows.",
    "case2": "Case II, missing condition: a cell without any measured window, which twins fill.",
    "algorithms": "Every network and baseline on Case I's calibrated training set.",
    "ablation": "BiTCN without one of its parts, or trained otherwise, on Case I's calibrated training set.",
    "noise": "White noise added to the tests, for classifiers trained clean and with noise.",
    "shaft-angle": "Case I from windows along the shaft's angle, beside those along time.",
    "augmentation": "Whatever can fill the scarce cell of Case I, by the number of synthetic windows.",
    "calibrators": "Twins calibrated by the paper's IPINN and by Gauss-Newton, and what each teaches in Case I.",
    "few-shot": "From no measured window of the scarce cell to 200, with and without twins.",
    "unseen-pressure": "No fault was ever measured at the test's pressure: filled by twins, and not.",
    "unseen-specimen": "How many pumps one has to know to tell the faults of another.",
}
"""What each study asks, by its name."""


def command_of(study: str) -> Callable[..., None]:
    """The command that runs a study of `STUDIES`; all have the same options."""

    def command(
        source: Source = None,
        rig: Rig = False,
        size: Size = StudySize.quick,
        seeds: Seeds = "0",
        out: Out = None,
        jobs: TaskJobs = 2,
        backend: BackendName = Backend.joblib,
        address: Address = None,
        device: DeviceName = Device.cpu,
        models: Models = None,
        training_sets: TrainingSets = None,
        values: Values = None,
        as_json: Json = False,
    ) -> None:
        if (source is None) is not rig:
            raise typer.BadParameter("give either recordings or --rig.", param_hint="INDEX")
        if rig and out is None:
            raise typer.BadParameter("is needed by --rig: the fleets are built into it.", param_hint="--out")
        from swashtwin.bench import Workers, models_of, plan_of

        plan = plan_of(study, size.value)
        if models is not None:
            asked = models_of(size.value, _names(models))
            plan = replace(plan, models=asked, absent=(), rivals=tuple(asked)[1:] if plan.rivals else ())
        if training_sets is not None:
            plan = plan.of_training_sets(_names(training_sets))
        if values is not None:
            plan = plan.of_values(_names(values))
        workers = Workers(jobs, backend.value, address)
        numbers = list_of(seeds, int, "--seeds") or [0]
        _carry_out(plan, source, numbers, out, workers, device.value, as_json)

    command.__doc__ = STUDIES[study]
    return command


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _carry_out(
    plan: "Plan",
    source: Path | None,
    seeds: list[int],
    out: Path | None,
    workers: "Workers",
    device: str,
    as_json: bool,
) -> None:
    from swashtwin.bench import Fleets, SameRecordings, run_plan
    from swashtwin.recordings import load_recordings

    hint = (
        "with --out, finished runs would be kept" if out is None else "finished runs are kept; the same command resumes"
    )
    with resumable(hint), progress(plan.study) as bar:

        def told(what: str, done: int, total: int) -> None:
            if what.endswith("done before"):
                note(f"{what}, in {out}")
            bar(done, total, f"{plan.study}: {what}")

        if source is not None:
            data: SameRecordings | Fleets = SameRecordings(load_recordings(source))
        else:
            rig = {"quick": "small", "paper": "paper"}[plan.size]
            data = Fleets(Path(out or "."), rig, workers.jobs, lambda *count: told("recording on the rig", *count))
        result = run_plan(
            plan,
            data,
            seeds=seeds,
            workers=workers,
            out=out,
            device=device,
            progress=told,
            command=this_command(),
        )
    tell_study(result, None if out is None else out / plan.study, as_json)
