"""Commands of the group history: export."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import note, say, table, tell
from swashtwin.cli.options import Json
from swashtwin.cli.outputs import Force, as_folder, require_output


def export(
    database: Annotated[
        str, typer.Argument(metavar="CONFIG|URL", help="Configuration of the watch, or URL of its database.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the tables.", callback=as_folder)],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write the history to tables: recordings, indicators by machine, alarms, events and the rest."""
    from swashtwin.monitoring import History, load_watch_config

    require_output(*out.glob("*.csv"), *out.glob("indicators/*.csv"), inputs=[Path(database)], force=force)
    if "://" in database:
        url, folder = database, out
    else:
        config = load_watch_config(Path(database))
        url, folder = config.history_url, config.folder
    history = History.open(url, folder, is_new=False)
    try:
        counts = history.export(out, note)
    finally:
        history.close()
    rows = [(f"{name}.csv", count) for name, count in counts.items()]

    def show() -> None:
        table("history", ("file", "rows"), rows)
        say(f"Tables are in {out}.")

    tell({"folder": str(out), "rows": counts}, as_json, show)
