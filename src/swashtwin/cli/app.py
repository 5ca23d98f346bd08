"""The application: every command by name, and what is the same for all of them."""

import os
from collections.abc import Callable
from typing import Annotated

import typer

from swashtwin.cli import (
    augmenting,
    calibrating,
    calibration_studies,
    comparing,
    condition_studies,
    confidence_study,
    diagnosing,
    exporting,
    fleets,
    guarding,
    indicating,
    inspecting,
    learning,
    paper_studies,
    physics,
    pumps,
    real_data,
    recordings,
    reporting,
    severities,
    simulating,
    studying,
    tuning,
    zero_shot,
)
from swashtwin.cli.exits import GuardedGroup

app = typer.Typer(
    name="swashtwin",
    cls=GuardedGroup,
    help="Learn a digital twin of an axial piston pump from its vibration, and diagnose the pump with it.",
    epilog="Exit codes: 0 done, 1 a bug, 2 wrong command line, 3 bad data or value, 130 interrupted.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

studies = typer.Typer(no_args_is_help=True, help="Run one of the studies, on your recordings or on the virtual rig.")

_DEMO, _DATA, _PHYSICS, _LEARNING = "The whole way", "Recordings", "Pump and twin", "Windows and classifiers"
app.command("demo", rich_help_panel=_DEMO)(studying.demo)
_STUDIES: dict[str, Callable[..., None]] = {
    **{name: paper_studies.command_of(name) for name in paper_studies.STUDIES},
    "calibration": calibration_studies.calibration,
    "conditions": condition_studies.conditions,
    "confidence": confidence_study.confidence,
    "fault-map": severities.study_fault_map,
    "leakage": guarding.leakage,
    "misspecification": studying.misspecification,
    "public": real_data.public,
    "scarce": real_data.scarce,
    "severity": severities.study_severity,
    "tune": tuning.tune,
    "zero-shot": zero_shot.zero_shot,
}
for _name, _study in _STUDIES.items():
    studies.command(_name)(_study)
app.add_typer(studies, name="study", rich_help_panel=_DEMO)
app.command("report", rich_help_panel=_DEMO)(reporting.report)
app.command("rig", rich_help_panel=_DATA)(recordings.rig)
app.command("index", rich_help_panel=_DATA)(recordings.index)
app.command("convert", rich_help_panel=_DATA)(recordings.convert)
app.command("inspect", rich_help_panel=_DATA)(inspecting.inspect)
app.command("split", rich_help_panel=_DATA)(recordings.split)
app.command("guard", rich_help_panel=_DATA)(guarding.guard)
app.command("audit", rich_help_panel=_DATA)(guarding.audit)
app.command("features", rich_help_panel=_DATA)(indicating.features)
app.command("spectrum", rich_help_panel=_DATA)(indicating.spectrum)
app.command("trend", rich_help_panel=_DATA)(indicating.trend)
app.add_typer(pumps.pumps, name="pump", rich_help_panel=_PHYSICS)
app.command("simulate", rich_help_panel=_PHYSICS)(simulating.simulate)
app.command("calibrate", rich_help_panel=_PHYSICS)(calibrating.calibrate)
app.command("compare", rich_help_panel=_PHYSICS)(comparing.compare)
app.command("calibrate-fleet", rich_help_panel=_PHYSICS)(fleets.calibrate_fleet)
app.command("severity", rich_help_panel=_PHYSICS)(severities.severity)
app.command("synthesize", rich_help_panel=_PHYSICS)(physics.synthesize)
app.command("augment", rich_help_panel=_LEARNING)(augmenting.augment)
app.command("train", rich_help_panel=_LEARNING)(learning.train)
app.command("evaluate", rich_help_panel=_LEARNING)(diagnosing.evaluate)
app.command("diagnose", rich_help_panel=_LEARNING)(diagnosing.diagnose)
app.command("export", rich_help_panel=_LEARNING)(exporting.export)


def _print_version(wanted: bool) -> bool:
    if wanted:
        from swashtwin.foundation import VERSION

        typer.echo(VERSION)
        raise typer.Exit
    return wanted


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an unexpected error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and leave.")
    ] = False,
) -> None:
    """Learn a digital twin of an axial piston pump from its vibration, and diagnose the pump with it."""


def main() -> None:
    """Run the command line and leave with its exit code."""
    # Before torch loads: its kernels are small here, and threads that spin between them slow everything down. Who wants
    # more threads sets OMP_NUM_THREADS.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    app()
