"""Commands of pages: the watch, its history in other programs, and the explorer."""

import signal
import threading
from collections.abc import Iterator, Sequence
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
from swashtwin.cli.files import Force, require_folder, require_output
from swashtwin.cli.options import Json

if TYPE_CHECKING:
    from swashtwin.monitoring import Outcome

_CONFIG = typer.Argument(metavar="CONFIG", help="Configuration that watch init wrote.")
ConfigFile = Annotated[Path, _CONFIG]


class WatchGroup(TyperGroup):
    """Commands of ``watch``, of which ``run`` may be left out."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """What is left of the words; those that name no command belong to ``run``."""
        if args and args[0] not in self.commands and args[0] != "--help":
            args = ["run", *args]
        return super().parse_args(ctx, args)


def run(
    config: ConfigFile,
    once: Annotated[bool, typer.Option("--once", help="Judge what is there now, and end.")] = False,
    as_json: Json = False,
) -> None:
    """Watch the machines of a configuration until Ctrl-C: judge what arrives, raise alarms, show
    the page.
    """
    require_extra()
    from swashtwin.monitoring import load_watch_config, run_watch

    def tell_outcome(outcome: "Outcome") -> None:
        machine = f"{outcome.machine}: " if outcome.machine else ""
        (print_note if as_json else print_text)(f"{machine}{outcome.file}: {outcome.sentence}")

    watch = load_watch_config(config)
    begin = f"watching {watch.path}; the page is at {watch.page.address}. Ctrl-C ends it."
    with stop_signals() as stop:
        status = run_watch(
            watch, once=once, stop=stop, started=lambda _: print_note(begin), progress=tell_outcome
        )
    counters = {name: round(value, 3) for name, value in status.counters.items()}

    def show() -> None:
        judged, rejected = int(counters["judged"]), int(counters["rejected"])
        print_text(f"judged {judged}, filed with a reason {rejected}, waiting {status.waiting}.")
        for problem in status.problems:
            print_note(f"note: {problem}")

    print_result(
        {**counters, "waiting": status.waiting, "problems": list(status.problems)}, as_json, show
    )


def init(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="File to write.")] = Path(
        "watch.toml"
    ),
    as_json: Json = False,
) -> None:
    """Write a configuration with an explanation of each line, to be edited."""
    from swashtwin.monitoring import write_example

    path = write_example(config)
    print_result(
        {"config": path},
        as_json,
        lambda: print_text(f"{path} is written; edit it, then: swashtwin watch {path}"),
    )


def event(
    config: ConfigFile,
    machine: Annotated[str, typer.Argument(metavar="MACHINE", help="Name of the machine.")],
    maintenance: Annotated[
        bool,
        typer.Option(
            "--maintenance",
            help="The machine was repaired: learn its healthy state anew, close alarms.",
        ),
    ] = False,
    text: Annotated[str, typer.Option("--note", help="What was done.")] = "",
    found: Annotated[
        str,
        typer.Option(
            help='What was wrong, such as "piston 3, 30 um"; kept beside the suspect of its newest alarm.'
        ),
    ] = "",
    as_json: Json = False,
) -> None:
    """Keep in the history what was done to a machine; after maintenance its baseline is learned
    anew.
    """
    require_extra()
    from swashtwin.monitoring import History, load_watch_config, record_event

    watch = load_watch_config(config)
    history = History.open(watch.history_url, watch.folder, watch.retention)
    try:
        number = record_event(
            watch, history, machine, who=_user(), note=text, found=found, maintenance=maintenance
        )
    finally:
        history.close()
    after = (
        "its baseline is learned anew, and its alarms are closed"
        if maintenance
        else "kept in the history"
    )
    after = (
        f"what was found stands beside the suspect of its newest alarm; {after}" if found else after
    )
    print_result(
        {"event": number, "machine": machine, "found": found or None},
        as_json,
        lambda: print_text(f"{machine}: {after}."),
    )


def user(
    config: ConfigFile,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the person or the program.")],
    token: Annotated[
        bool, typer.Option("--token", help="Print a token for a program, ask for no password.")
    ] = False,
    control: Annotated[
        bool,
        typer.Option(
            "--control", help="The program may also acknowledge, silence and note maintenance."
        ),
    ] = False,
    remove: Annotated[bool, typer.Option("--remove", help="Take the entry out.")] = False,
    as_json: Json = False,
) -> None:
    """Let a person see and acknowledge on the page, or a program read and upload; needed beyond
    this computer.
    """
    require_extra()
    from swashtwin.foundation import InputError
    from swashtwin.monitoring import add_token, add_user, load_watch_config, remove_entry

    if control and not token:
        raise InputError("--control is of a program's token; give --token too.")
    path = load_watch_config(config).page.users
    if path is None:
        raise InputError(f'{config} names no file for this; add users = "users.json" under [page].')
    secret = ""
    if remove:
        remove_entry(path, name)
    elif token:
        secret = add_token(path, name, control=control)
    else:
        add_user(path, name, typer.prompt("Password", hide_input=True, confirmation_prompt=True))
    words = "was removed from" if remove else "is in"
    lines = [f"{name} {words} {path}.", *([f"Token, shown this once: {secret}"] if secret else [])]
    result = {"name": name, "file": path, "token": secret or None}
    print_result(result, as_json, lambda: print_text("\n".join(lines)))


_EXTRA = ("argon2", "fastapi", "prometheus_client", "python_multipart", "sqlalchemy", "uvicorn")
"""Packages of the extra that every watch needs."""


def require_extra(what: str = "a watch") -> None:
    """Refuse a watch, or another page, whose packages are not installed."""
    from swashtwin.foundation import require_modules

    require_modules(*_EXTRA, extra="monitor", need=what)


def _user() -> str:
    import getpass

    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "unknown"


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """Event that Ctrl-C and a system's request to end set."""
    stop = threading.Event()
    signals: Sequence[signal.Signals] = (signal.SIGINT, signal.SIGTERM)
    handlers = {number: signal.signal(number, lambda *_: stop.set()) for number in signals}
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
    """Write the history to tables: recordings, indicators by machine, alarms, events and the
    rest.
    """
    from swashtwin.monitoring import History, load_watch_config

    require_output(
        *out.glob("*.csv"), *out.glob("indicators/*.csv"), inputs=[Path(database)], force=force
    )
    if "://" in database:
        url, folder = database, out
    else:
        config = load_watch_config(Path(database))
        url, folder = config.history_url, config.folder
    history = History.open(url, folder, is_new=False)
    try:
        counts = history.export(out, print_note)
    finally:
        history.close()
    rows = [(f"{name}.csv", count) for name, count in counts.items()]

    def show() -> None:
        print_table("history", ("file", "rows"), rows)
        print_text(f"Tables are in {out}.")

    print_result({"folder": str(out), "rows": counts}, as_json, show)


def explore(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER|INDEX|FILE|CALIBRATION",
            help="What to look at; a folder needs no index.",
        ),
    ],
    model: Annotated[
        Path | None, typer.Option(help="Model to diagnose with; others can be dropped on the page.")
    ] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port of the page on this computer.")
    ] = 8643,
) -> None:
    """Look at recordings in the browser, edit their facts, fit a twin by eye and diagnose, until
    Ctrl-C.
    """
    require_extra("the explorer")
    from swashtwin.explorer import run_explorer

    require_existing([source, model])

    with stop_signals() as stop:
        run_explorer(
            source, model=model, port=port, stop=stop,
            started=lambda address: print_note(f"exploring {source} at {address} . Ctrl-C ends it."),
        )  # fmt: skip
