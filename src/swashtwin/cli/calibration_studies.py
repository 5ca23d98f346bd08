"""The study of calibration methods: study calibration."""

from typing import Annotated

import typer

from swashtwin.cli.console import progress
from swashtwin.cli.options import Jobs, Json, ReportFolder, list_of
from swashtwin.cli.studying import tell_study, this_command


def calibration(
    seeds: Annotated[str, typer.Option(help='Fleets of the virtual rig: "2,3,4,5".')] = "0",
    fault: Annotated[str, typer.Option(help="Class calibrated on: normal or swash_plate.")] = "normal",
    specimens: Annotated[int, typer.Option(min=1, help="Pumps in each fleet.")] = 6,
    repeats: Annotated[int, typer.Option(min=2, help="Recordings of each pump and pressure; one is held out.")] = 3,
    thick_film: Annotated[
        bool, typer.Option("--thick-film", help="Pumps whose slipper films are thick enough for K_sw to show.")
    ] = False,
    methods: Annotated[str | None, typer.Option(help="Ways to calibrate, with commas; all by default.")] = None,
    out: ReportFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Errors on recordings held out, coverage and cost of every way to calibrate, on pumps of the virtual rig."""
    from swashtwin.bench import CONTENDERS, CalibrationStudySettings, run_calibration_study

    chosen = tuple(CONTENDERS) if methods is None else tuple(one.strip() for one in methods.split(","))
    settings = CalibrationStudySettings(
        label=fault, specimens=specimens, repeats=repeats, thick_film=thick_film, contenders=chosen
    )
    with progress("calibrating pumps of the virtual rig") as bar:
        found = run_calibration_study(
            seeds=list_of(seeds, int, "--seeds") or [0],
            settings=settings,
            jobs=jobs,
            progress=bar,
            command=this_command(),
        )
    tell_study(found, out, as_json)
