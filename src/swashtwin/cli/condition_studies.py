"""The study of conditions that nobody trained on: study conditions."""

from typing import Annotated

import typer

from swashtwin.cli.console import progress
from swashtwin.cli.options import Index, Jobs, Json, ReportFolder, list_of
from swashtwin.cli.studying import tell_study, this_command


def conditions(
    source: Index,
    seeds: Annotated[str, typer.Option(help='Seeds of weights, trees and folds: "0,1,2".')] = "0",
    out: ReportFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """What classifiers score at a speed and pressure they were never trained on, and what helps against it."""
    from swashtwin.bench import run_conditions
    from swashtwin.recordings import load_recordings

    with progress("training for new conditions") as bar:
        found = run_conditions(
            list(load_recordings(source)),
            seeds=list_of(seeds, int, "--seeds") or [0],
            jobs=jobs,
            progress=bar,
            command=this_command(),
        )
    tell_study(found, out, as_json)
