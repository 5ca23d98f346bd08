"""The command that shows recordings and twins in the browser: explore."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import note
from swashtwin.cli.exits import require_files
from swashtwin.cli.watching import require_extra, stop_signals


def explore(
    source: Annotated[
        Path,
        typer.Argument(metavar="FOLDER|INDEX|FILE|CALIBRATION", help="What to look at; a folder needs no index."),
    ],
    model: Annotated[
        Path | None, typer.Option(help="Model to diagnose with; others can be dropped on the page.")
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page on this computer.")] = 8643,
) -> None:
    """Look at recordings in the browser, edit their facts, fit a twin by eye and diagnose, until Ctrl-C."""
    require_extra("the explorer")
    from swashtwin.explorer import run_explorer

    require_files([source, model])

    def tell_start(address: str) -> None:
        note(f"exploring {source} at {address} . Ctrl-C ends it.")

    with stop_signals() as stop:
        run_explorer(source, model=model, port=port, stop=stop, started=tell_start)
