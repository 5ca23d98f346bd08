"""Commands of the studies of what calibrations are worth: wrong twins, and planned recordings."""

from typing import Annotated

import typer

from swashtwin.cli import Jobs, Json, ReportFolder, progress, read_seeds, resumable
from swashtwin_bench.cli.questions import FleetSeeds
from swashtwin_bench.cli.results import tell_study, typed_command


def wrong_twins(
    seeds: FleetSeeds = "100,101,102,103",
    rounds: Annotated[int, typer.Option(help="How often each case is tried, with another seed each time.", min=1)] = 1,
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """A matrix of wrong twins and odd truths: do values called identified hold, and is a wrong twin warned of?"""
    from swashtwin_bench import run_wrong_twins

    numbers = read_seeds(seeds)
    hint = "finished cases are kept; the same command resumes" if out else "with --out, they would be kept"
    with resumable(hint), progress("wrong twins") as bar:
        study = run_wrong_twins(seeds=numbers, rounds=rounds, jobs=jobs, out=out, progress=bar, command=typed_command())
    tell_study(study, None if out is None else out / "wrong-twins-report", as_json)
