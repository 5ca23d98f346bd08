"""Commands that put a figure on recordings of real machines: study public, study scarce."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import progress
from swashtwin.cli.options import Jobs, Json, ReportFolder, list_of
from swashtwin.cli.studying import tell_study, this_command

Data = Annotated[Path, typer.Option(help="Folder that holds the public sets, each in a folder of its own name.")]
Seeds = Annotated[str, typer.Option(help='Seeds of draws, inner folds and random splits: "0,1,2".')]


def public(
    data: Data,
    seeds: Seeds = "0,1,2,3,4",
    sets: Annotated[str, typer.Option(help='Which sets: "cwru,pump_cavitation"; all that are there by default.')] = "",
    out: ReportFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Public sets of real recordings: the score on an honest split beside the one on a random split."""
    from swashtwin.bench import run_public

    with progress("public sets") as bar:
        study = run_public(
            data,
            seeds=list_of(seeds, int, "--seeds") or [0],
            jobs=jobs,
            sets=[name for name in sets.split(",") if name],
            progress=lambda what, done, total: bar(done, total, what),
            command=this_command(),
        )
    tell_study(study, out, as_json)


def scarce(
    data: Data, seeds: Seeds = "0,1,2,3,4", out: ReportFolder = None, jobs: Jobs = 2, as_json: Json = False
) -> None:
    """A scarce cell of a real pump's recordings: filling it from data alone against leaving it."""
    from swashtwin.bench import run_scarce

    with progress("scarce cells") as bar:
        study = run_scarce(
            data,
            seeds=list_of(seeds, int, "--seeds") or [0],
            jobs=jobs,
            progress=lambda what, done, total: bar(done, total, what),
            command=this_command(),
        )
    tell_study(study, out, as_json)
