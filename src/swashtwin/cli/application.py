"""The application: every command by name, and what is the same for all of them."""

import gc
import os
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Annotated, Any

import typer

from swashtwin.cli import (
    calibrating,
    diagnosing,
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

FIRST: Mapping[str, Callable[..., None]] = {
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

GROUPS: Mapping[str, tuple[str, Mapping[str, Callable[..., None]]]] = {
    "data": ("Convert and split recordings.", {"convert": recordings.convert, "split": recordings.split}),
    "signal": (
        "Indicators, spectra and trends, without a classifier.",
        {"features": signal.features, "spectrum": signal.spectrum, "trend": signal.trend},
    ),
    "twin": (
        "Simulate, compare and use twins of pumps.",
        {
            "simulate": simulating.simulate, "severity": twin.severity, "next": twin.plan_next,
            "prior": models.prior,
        },
    ),
    "history": ("Use the history of watched machines in other programs.", {"export": watching.export}),
    "model": (
        "Adapt a shipped model to a machine, or use a trained one in other programs.",
        {"adapt": models.adapt, "export": models.export},
    ),
}  # fmt: skip
"""Help and commands of each group."""

WATCH: Mapping[str, Callable[..., None]] = {
    "run": watching.run, "init": watching.init, "event": watching.event, "user": watching.user,
}  # fmt: skip
"""Commands of ``swashtwin watch``."""

PUMPS: Mapping[str, Callable[..., None]] = {"show": twin.show_pump, "new": twin.new_pump}
"""Commands of ``swashtwin twin pump``."""

app = typer.Typer(
    name="swashtwin",
    cls=GuardedGroup,
    help="Learn a digital twin of an axial piston pump from its vibration, and diagnose the pump with it.",
    epilog=(
        "Exit codes: 0 done, 1 a bug, 2 wrong command line, 3 bad data or value, 4 no verdict, 5 too few data, "
        "130 interrupted."
    ),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _filled(
    group: typer.Typer, commands: Mapping[str, Callable[..., None]], **more: Any
) -> typer.Typer:
    for name, function in commands.items():
        group.command(name, **more)(function)
    return group


_filled(app, FIRST, rich_help_panel="Commands")
_words = "Watch pumps at a plant: swashtwin watch CONFIG starts it."
_watch = _filled(typer.Typer(cls=watching.WatchGroup, no_args_is_help=True, help=_words), WATCH)
app.add_typer(_watch, name="watch", rich_help_panel="Commands")
for _name, (_words, _commands) in GROUPS.items():
    _members = _filled(typer.Typer(no_args_is_help=True, help=_words), _commands)
    if _name == "twin":
        _words = "Show and write the parameter files of pumps."
        _members.add_typer(
            _filled(typer.Typer(no_args_is_help=True, help=_words), PUMPS), name="pump"
        )
    app.add_typer(_members, name=_name, rich_help_panel="More commands")


def add_installed_commands() -> None:
    """Add the commands of other distributions: of each entry point of the group
    ``swashtwin.commands``, a function that takes the application. Those of ``swashtwin-bench`` tell
    how to get them where it is not installed.
    """
    installed = entry_points(group="swashtwin.commands")
    for entry in installed:
        entry.load()(app)
    if "bench" not in installed.names:
        anything = {"allow_extra_args": True, "ignore_unknown_options": True}
        for parent, name in ((app, "demo"), (app, "bench"), (_watch, "demo")):
            parent.command(name, hidden=True, add_help_option=False, context_settings=anything)(
                _require_bench
            )


def _require_bench() -> None:
    raise InputError(
        "this command belongs to swashtwin-bench, which is not installed: pip install swashtwin-bench."
    )


add_installed_commands()


def _print_version(is_wanted: bool) -> bool:
    if is_wanted:
        from swashtwin.foundation import VERSION

        typer.echo(VERSION)
        raise typer.Exit
    return is_wanted


@app.callback()
def _options(
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an unexpected error.")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Learn a digital twin of an axial piston pump from its vibration, and diagnose the pump with
    it.
    """


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
