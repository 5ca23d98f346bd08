"""The search for a network's settings: study tune."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import progress
from swashtwin.cli.exits import resumable
from swashtwin.cli.options import Index, Json, Seed, as_folder
from swashtwin.cli.paper_studies import Address, Backend, BackendName, Device, DeviceName, Size, TaskJobs
from swashtwin.cli.studying import StudySize, tell_study, this_command


def tune(
    source: Index,
    out: Annotated[
        Path,
        typer.Option(
            help="Folder of the journal, which a re-run takes up, and of tune/report.html.", callback=as_folder
        ),
    ],
    model: Annotated[str, typer.Option(help="Network whose settings are searched.")] = "spectral_bitcn",
    trials: Annotated[int, typer.Option(min=1, help="Settings to try in all, those of earlier runs included.")] = 20,
    size: Size = StudySize.quick,
    seed: Seed = 0,
    jobs: TaskJobs = 2,
    backend: BackendName = Backend.joblib,
    address: Address = None,
    device: DeviceName = Device.cpu,
    as_json: Json = False,
) -> None:
    """Search a network's settings by Optuna, on validation recordings only: training pumps, each left out in turn."""
    from swashtwin.bench import Workers, run_tuning
    from swashtwin.recordings import load_recordings

    with resumable("candidates that were scored are kept; the same command goes on"), progress("tuning") as bar:
        found = run_tuning(
            list(load_recordings(source)),
            model=model,
            size=size.value,
            trials=trials,
            seed=seed,
            out=out,
            workers=Workers(jobs, backend.value, address),
            device=device.value,
            progress=bar,
            command=this_command(),
        )
    tell_study(found, out / "tune", as_json)
