"""Commands that serve a page: the watch with its history, and the explorer."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from swashtwin.cli.console import (
    print_note,
    print_result,
    print_table,
    print_text,
    require_existing,
)
from swashtwin.cli.options import Json
from swashtwin.cli.outputs import Force, require_folder, require_output
from swashtwin.foundation import PressureUnit, shell_command

if TYPE_CHECKING:
    from swashtwin.monitoring import Outcome

ConfigFile = Annotated[
    Path, typer.Argument(metavar="CONFIG", help="Configuration written by watch init.")
]

# Modules of the extra `monitor` that every watch requires.
_MONITOR_MODULES = (
    "argon2",
    "fastapi",
    "prometheus_client",
    "python_multipart",
    "sqlalchemy",
    "uvicorn",
)


class WatchGroup(TyperGroup):
    """Commands of ``watch``; ``run`` may be omitted."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return the remaining arguments; arguments that name no command belong to ``run``."""
        if args and args[0] not in self.commands and args[0] != "--help":
            args = ["run", *args]
        return super().parse_args(ctx, args)


def run(
    config: ConfigFile,
    once: Annotated[
        bool, typer.Option("--once", help="Judge the recordings that have arrived, then exit.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Watch the machines of a configuration until Ctrl-C: judge recordings, raise alarms."""
    require_extra()
    from swashtwin.monitoring import load_watch_config, run_watch

    print_line = print_note if as_json else print_text

    def print_outcome(outcome: "Outcome") -> None:
        machine = f"{outcome.machine}: " if outcome.machine else ""
        print_line(f"{machine}{outcome.file}: {outcome.sentence}")

    watch = load_watch_config(config)
    greeting = f"watching {watch.path}; page at {watch.page.address}. Press Ctrl-C to stop."
    with stop_signals() as stop:
        status = run_watch(
            watch,
            once=once,
            stop=stop,
            started=lambda _: print_note(greeting),
            progress=print_outcome,
        )
    counters = {name: round(value, 3) for name, value in status.counters.items()}

    def show() -> None:
        n_judged = int(counters["judged"])
        n_rejected = int(counters["rejected"])
        print_text(f"{n_judged} judged, {n_rejected} rejected, {status.waiting} waiting.")
        for problem in status.problems:
            print_note(f"note: {problem}")

    result = {**counters, "waiting": status.waiting, "problems": list(status.problems)}
    print_result(result, as_json, show)


def init(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="File to write.")] = Path(
        "watch.toml"
    ),
    as_json: Json = False,
) -> None:
    """Write an example configuration in which each line is explained, for you to edit."""
    from swashtwin.monitoring import write_example

    path = write_example(config)
    next_step = f"Wrote {path}. Edit it, then: {shell_command('watch', path)}"
    print_result({"config": path}, as_json, lambda: print_text(next_step))


def event(
    config: ConfigFile,
    machine: Annotated[str, typer.Argument(metavar="MACHINE", help="Name of the machine.")],
    maintenance: Annotated[
        bool,
        typer.Option(
            "--maintenance",
            help="The machine was repaired: learn its baseline again, and close its alarms.",
        ),
    ] = False,
    text: Annotated[str, typer.Option("--note", help="What was done.")] = "",
    finding: Annotated[
        str,
        typer.Option(
            "--found",
            help='Defect that was found, such as "piston 3, 30 um". It is stored with the suspect '
            "of the machine's newest alarm.",
        ),
    ] = "",
    as_json: Json = False,
) -> None:
    """Record in the history what was done to a machine."""
    require_extra()
    from swashtwin.monitoring import History, load_watch_config, record_event

    watch = load_watch_config(config)
    history = History.open(watch.history_url, watch.folder, watch.retention)
    try:
        number = record_event(
            watch,
            history,
            machine,
            who=_user_name(),
            note=text,
            finding=finding,
            maintenance=maintenance,
        )
    finally:
        history.close()

    consequences = []
    if finding:
        consequences.append("stored the finding with the suspect of its newest alarm")
    if maintenance:
        consequences.append("learning its baseline again; its alarms are closed")
    else:
        consequences.append("recorded in the history")
    result = {"event": number, "machine": machine, "found": finding or None}
    print_result(result, as_json, lambda: print_text(f"{machine}: {'; '.join(consequences)}."))


def user(
    config: ConfigFile,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the person or program.")],
    token: Annotated[
        bool,
        typer.Option("--token", help="Print a token for a program instead of asking a password."),
    ] = False,
    control: Annotated[
        bool,
        typer.Option(
            "--control",
            help="Let the program also acknowledge and silence alarms and record maintenance.",
        ),
    ] = False,
    remove: Annotated[bool, typer.Option("--remove", help="Remove the entry.")] = False,
    as_json: Json = False,
) -> None:
    """Let a person see the page and acknowledge alarms, or let a program read and upload.

    Required if the page is reachable from other computers.
    """
    require_extra()
    from swashtwin.foundation import InputError
    from swashtwin.monitoring import add_token, add_user, load_watch_config, remove_entry

    if control and not token:
        raise InputError("--control applies to the token of a program. Add --token.")
    path = load_watch_config(config).page.users
    if path is None:
        raise InputError(
            f'{config} specifies no file of users. Add users = "users.json" under [page].'
        )

    secret = ""
    if remove:
        remove_entry(path, name)
    elif token:
        secret = add_token(path, name, control=control)
    else:
        add_user(path, name, typer.prompt("Password", hide_input=True, confirmation_prompt=True))

    def show() -> None:
        print_text(f"Removed {name} from {path}." if remove else f"Added {name} to {path}.")
        if secret:
            print_text(f"Token, shown only once: {secret}")

    print_result({"name": name, "file": path, "token": secret or None}, as_json, show)


def require_extra(purpose: str = "a watch") -> None:
    """Raise an error if the packages of a watch, or of another page, are not installed."""
    from swashtwin.foundation import require_modules

    require_modules(*_MONITOR_MODULES, extra="monitor", need=purpose)


def _user_name() -> str:
    import getpass

    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        # A service account without an entry, and Windows without the variable.
        return "unknown"


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """Yield an event that is set by Ctrl-C and by a request of the system to terminate."""
    stop = threading.Event()
    handlers = {
        number: signal.signal(number, lambda *_: stop.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield stop
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def export(
    database: Annotated[
        str,
        typer.Argument(
            metavar="CONFIG|URL", help="Configuration of the watch, or URL of its database."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the tables.", callback=require_folder)],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write the history as CSV tables: recordings, indicators by machine, alarms, events."""
    from swashtwin.monitoring import History, load_watch_config

    existing_tables = [*out.glob("*.csv"), *out.glob("indicators/*.csv")]
    require_output(*existing_tables, inputs=[Path(database)], force=force)
    if "://" in database:
        url = database
        folder = out
    else:
        config = load_watch_config(Path(database))
        url = config.history_url
        folder = config.folder

    history = History.open(url, folder, is_new=False)
    try:
        counts = history.export(out, print_note)
    finally:
        history.close()

    def show() -> None:
        rows = [(f"{name}.csv", count) for name, count in counts.items()]
        print_table("history", ("file", "rows"), rows)
        print_text(f"The tables are in {out}.")

    print_result({"folder": str(out), "rows": counts}, as_json, show)


def explore(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER|INDEX|FILE|CALIBRATION",
            help="What to look at. A folder requires no index.",
        ),
    ],
    model: Annotated[
        Path | None,
        typer.Option(help="Model to diagnose with. Others can be dropped on the page."),
    ] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port of the page on this computer.")
    ] = 8643,
    pressure_unit: Annotated[
        PressureUnit, typer.Option(help="Unit in which the page shows pressures.")
    ] = "MPa",
) -> None:
    """Look at recordings in the browser, edit their facts, fit a twin by eye, and diagnose.

    Press Ctrl-C to stop.
    """
    require_extra("the explorer")
    from swashtwin.explorer import run_explorer

    require_existing([source, model])

    def print_address(address: str) -> None:
        # The blank before the stop keeps it out of the address if a terminal makes it a link.
        print_note(f"exploring {source} at {address} . Press Ctrl-C to stop.")

    with stop_signals() as stop:
        run_explorer(
            source,
            model=model,
            pressure_unit=pressure_unit,
            port=port,
            stop=stop,
            started=print_address,
        )
