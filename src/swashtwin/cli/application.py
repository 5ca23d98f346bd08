"""The application: every command by name, and the options and setup that all share."""

import gc
import os
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Annotated, Any

import typer

from swashtwin.cli import (
    calibrating,
    diagnosing,
    live,
    models,
    recordings,
    signal,
    simulating,
    training,
    twin,
    watching,
)
from swashtwin.cli.console import GuardedGroup, safe_streams
from swashtwin.foundation import InputError, keep_freed_memory

Commands = Mapping[str, Callable[..., None]]
"""Commands of a group by name."""

FIRST_SCREEN: Commands = {
    "record": live.record,
    "index": recordings.index,
    "explore": watching.explore,
    "inspect": recordings.inspect,
    "check": recordings.check,
    "train": training.train,
    "evaluate": models.evaluate,
    "diagnose": diagnosing.diagnose,
    "calibrate": calibrating.calibrate,
    "synthesize": simulating.synthesize,
    "report": diagnosing.report,
}
"""Commands of the first screen, in the order of a user's work."""

WATCH: Commands = {
    "run": watching.run,
    "init": watching.init,
    "event": watching.event,
    "user": watching.user,
}
"""Commands of ``swashtwin watch``."""

PUMPS: Commands = {"show": twin.show_pump, "new": twin.new_pump}
"""Commands of ``swashtwin twin pump``."""

GROUPS: Mapping[str, tuple[str, Commands]] = {
    "data": (
        "Convert and split recordings.",
        {"convert": recordings.convert, "split": recordings.split},
    ),
    "signal": (
        "Compute indicators, spectra and trends, without a classifier.",
        {"features": signal.features, "spectrum": signal.spectrum, "trend": signal.trend},
    ),
    "twin": (
        "Simulate, compare and use twins of pumps.",
        {
            "simulate": simulating.simulate,
            "severity": twin.severity,
            "next": twin.plan_next,
            "prior": models.prior,
            "export": simulating.export_twin,
        },
    ),
    "history": (
        "Use the history of watched machines in other programs.",
        {"export": watching.export},
    ),
    "model": (
        "Adapt a shipped model to a machine, share measured faults, or export a model.",
        {"adapt": models.adapt, "library": models.library, "export": models.export},
    ),
}
"""Help and commands of the other groups."""

DESCRIPTION = (
    "Learn a digital twin of an axial piston pump from its vibration, and diagnose the pump with "
    "it."
)

app = typer.Typer(
    name="swashtwin",
    cls=GuardedGroup,
    help=DESCRIPTION,
    epilog=(
        "Exit codes: 0 success, 1 a bug, 2 invalid command line, 3 invalid data or value, 4 no "
        "verdict, 5 too few data, 130 interrupted."
    ),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _group_of(help_text: str, commands: Commands, **settings: Any) -> typer.Typer:
    """Return a group of commands."""
    group = typer.Typer(no_args_is_help=True, help=help_text, **settings)
    for name, function in commands.items():
        group.command(name)(function)
    return group


for _name, _function in FIRST_SCREEN.items():
    app.command(_name, rich_help_panel="Commands")(_function)

_watch = _group_of(
    "Watch pumps at a plant: swashtwin watch CONFIG starts it.", WATCH, cls=watching.WatchGroup
)
app.add_typer(_watch, name="watch", rich_help_panel="Commands")

for _name, (_help, _commands) in GROUPS.items():
    _group = _group_of(_help, _commands)
    if _name == "twin":
        _pump_group = _group_of("Print and write the parameter files of pumps.", PUMPS)
        _group.add_typer(_pump_group, name="pump")
    app.add_typer(_group, name=_name, rich_help_panel="More commands")


def add_installed_commands() -> None:
    """Add the commands of other distributions.

    Each entry point of the group ``swashtwin.commands`` is a function that takes the application.
    If ``swashtwin-bench`` is not installed, its commands state how to install it.
    """
    installed = entry_points(group="swashtwin.commands")
    for entry in installed:
        entry.load()(app)
    if "bench" in installed.names:
        return

    any_arguments = {"allow_extra_args": True, "ignore_unknown_options": True}
    for group, name in ((app, "demo"), (app, "bench"), (_watch, "demo")):
        group.command(name, hidden=True, add_help_option=False, context_settings=any_arguments)(
            _require_bench
        )


def _require_bench() -> None:
    raise InputError(
        "This command belongs to swashtwin-bench, which is not installed: pip install "
        "swashtwin-bench."
    )


add_installed_commands()


def _print_version(is_requested: bool) -> bool:
    if is_requested:
        from swashtwin.foundation import VERSION

        typer.echo(VERSION)
        raise typer.Exit
    return is_requested


@app.callback(help=DESCRIPTION)
def _global_options(
    debug: Annotated[
        bool, typer.Option("--debug", help="Print the traceback of an unexpected error.")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Declare the options of every command; their effects are elsewhere."""


def main() -> None:
    """Run the command line and exit with its code."""
    # Before torch loads: its kernels are small here, and threads that spin between them slow
    # everything down. To use more threads, set OMP_NUM_THREADS.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # Importing torch makes about a million objects that stay. Looking through them for cycles,
    # while they are imported and again when the process ends, took a quarter of a diagnosis.
    gc.set_threshold(100_000, 50, 100)
    keep_freed_memory()  # a sixth of the time of signal features
    safe_streams()
    try:
        app()
    finally:
        gc.freeze()
