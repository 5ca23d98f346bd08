"""The command of the zero-shot study."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import progress
from swashtwin.cli.options import Jobs, Json, ReportFolder, list_of
from swashtwin.cli.studying import StudySize, tell_study, this_command


def zero_shot(
    source: Annotated[Path | None, typer.Argument(help="Index file, or the folder that holds recordings.toml.")] = None,
    fleet: Annotated[bool, typer.Option("--fleet", help="A fleet of the virtual rig for each seed.")] = False,
    size: Annotated[
        StudySize, typer.Option(help="Settings: quick, or as many windows as there are.")
    ] = StudySize.quick,
    seeds: Annotated[str, typer.Option(help='Seeds of fleets, split, twins, faults and weights: "2,3,4".')] = "0",
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Zero-shot: faults that nobody has measured, taught by twins of healthy recordings, tested on measured faults."""
    from swashtwin.bench import run_zero_shot
    from swashtwin.recordings import load_recordings

    if (source is None) is not fleet:
        raise typer.BadParameter("give either recordings or --fleet.", param_hint="INDEX")
    numbers = list_of(seeds, int, "--seeds") or [0]
    with progress("zero-shot") as bar:
        study = run_zero_shot(
            None if source is None else list(load_recordings(source)),
            size=size.value,
            seeds=numbers,
            jobs=jobs,
            progress=lambda what, done, total: bar(done, total, f"zero-shot: {what}"),
            command=this_command(),
        )
    tell_study(study, out, as_json)
