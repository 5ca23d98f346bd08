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
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page on this computer.")] = 8643,
) -> None:
    """Look at recordings in the browser, edit their facts, and fit a twin by eye, until Ctrl-C."""
    require_extra("the explorer")
    from swashtwin.explorer import run_explorer

    require_files([source])
    with stop_signals() as stop:
        run_explorer(
            source,
            port=port,
            stop=stop,
            started=lambda address: note(f"exploring {source} at {address} Ctrl-C ends it."),
        )
