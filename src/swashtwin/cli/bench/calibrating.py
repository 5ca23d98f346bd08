"""Commands of the studies of what calibrations are worth: wrong twins, and planned recordings."""

from typing import Annotated

import typer

from swashtwin.cli.bench.questions import FleetSeeds
from swashtwin.cli.bench.results import tell_study, typed_command
from swashtwin.cli.console import progress
from swashtwin.cli.exits import resumable
from swashtwin.cli.options import Jobs, Json, ReportFolder, read_seeds, read_words


def wrong_twins(
    seeds: FleetSeeds = "100,101,102,103",
    rounds: Annotated[int, typer.Option(help="How often each case is tried, with another seed each time.", min=1)] = 1,
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """A matrix of wrong twins and odd truths: do values called identified hold, and is a wrong twin warned of?"""
    from swashtwin.bench import run_wrong_twins

    numbers = read_seeds(seeds)
    hint = "finished cases are kept; the same command resumes" if out else "with --out, they would be kept"
    with resumable(hint), progress("wrong twins") as bar:
        study = run_wrong_twins(seeds=numbers, rounds=rounds, jobs=jobs, out=out, progress=bar, command=typed_command())
    tell_study(study, None if out is None else out / "wrong-twins-report", as_json)


def next_recording(
    seeds: FleetSeeds = "100,101,102,103,104,105",
    pumps: Annotated[str, typer.Option(help="Kinds of pumps: own (the twin's recordings), rig.")] = "own,rig",
    added: Annotated[int, typer.Option(min=1, help="Recordings added to the first.")] = 3,
    sequences: Annotated[int, typer.Option(min=1, help="Random sequences for each pump.")] = 2,
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Do intervals narrow faster where `twin next` chooses the recordings than where they are drawn at random?"""
    from swashtwin.bench import run_next_recording

    numbers = read_seeds(seeds)
    hint = "finished sequences are kept; the same command resumes" if out else "with --out, they would be kept"
    with resumable(hint), progress("recording and calibrating") as bar:
        study = run_next_recording(
            seeds=numbers,
            pumps=read_words(pumps),
            added=added,
            draws=sequences,
            jobs=jobs,
            out=out,
            progress=bar,
            command=typed_command(),
        )
    tell_study(study, None if out is None else out / "next-recording-report", as_json)
