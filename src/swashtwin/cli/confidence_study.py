"""The study of confidence: study confidence."""

from typing import Annotated

import typer

from swashtwin.cli.console import progress
from swashtwin.cli.options import Jobs, Json, ReportFolder, list_of
from swashtwin.cli.studying import tell_study, this_command


def confidence(
    seeds: Annotated[str, typer.Option(help='Fleets of the virtual rig: "2,3,4".')] = "2,3,4",
    error_rate: Annotated[float, typer.Option(help="Asked of prediction sets and of calling unknown.")] = 0.1,
    out: ReportFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Whether a classifier knows when it may be wrong: calibration, coverage, and faults that nobody trained."""
    from swashtwin.bench import ConfidenceStudySettings, run_confidence

    with progress("training on pumps of the virtual rig") as bar:
        found = run_confidence(
            seeds=list_of(seeds, int, "--seeds") or [2],
            settings=ConfidenceStudySettings(error_rate=error_rate),
            jobs=jobs,
            progress=bar,
            command=this_command(),
        )
    tell_study(found, out, as_json)
