"""Commands that begin a user's work: index, inspect, check."""

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, tell
from swashtwin.cli.exits import BAD_DATA, NOT_ENOUGH
from swashtwin.cli.options import Index, Json, Reading, Sources, Window, read_pairs, reads_files
from swashtwin.cli.outputs import Force, require_output
from swashtwin.cli.sources import by_options, is_collection, load_sources, single_file_options
from swashtwin.cli.summaries import class_words, show_check, show_inspection
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.recordings import Finding


@reads_files
def index(
    folder: Annotated[Path, typer.Argument(help="Folder of measurements; it is only read.")],
    reading: Reading,
    out: Annotated[Path | None, typer.Option(help="Index file; recordings.toml in the folder by default.")] = None,
    label_pattern: Annotated[
        str | None, typer.Option(help="Regular expression searched in each path; its named groups become facts.")
    ] = None,
    csv_table: Annotated[Path | None, typer.Option("--table", help="CSV table with one row per file.")] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option("--column", metavar="KEY=COLUMN", help="Column of the table that holds a key; repeatable."),
    ] = None,
    include: Annotated[list[str] | None, typer.Option(help="Pattern of paths to include; repeatable.")] = None,
    pressure_unit: Annotated[
        str | None, typer.Option(help='Unit of pressures in names, tables and headers that have none: "bar".')
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Propose an index of a folder's files, for you to check and correct.

    On a terminal you are asked for facts that neither the files nor the options state.
    """
    from swashtwin.recordings import propose_index, save_index

    path = out or folder / "recordings.toml"
    require_output(path, suffixes=[".toml"], inputs=[csv_table], force=force)
    ask = None if as_json or not sys.stdin.isatty() else _ask
    with progress("reading files") if ask is None else nullcontext(), single_file_options():
        proposal = propose_index(
            folder,
            label_pattern=label_pattern,
            table=csv_table,
            columns=read_pairs(columns, "--column"),
            include=include or [],
            pressure_unit=pressure_unit,
            index_folder=path.parent,
            ask=ask,
            **reading,
        )
    save_index(proposal.index, path)
    entries = proposal.index["recording"]
    result: dict[str, Any] = {"index": path, "recordings": len(entries), "classes": proposal.index.get("classes", [])}
    result |= {"fact_sources": list(proposal.facts), "skipped": list(proposal.skipped), "notes": list(proposal.notes)}

    def show() -> None:
        for reason in proposal.skipped:
            note(f"left out: {reason}")
        for remark in proposal.notes:
            note(f"note: {remark}")
        for sentence in proposal.facts:
            say(sentence)
        classes = ", ".join(map(class_words, result["classes"])) or "classes that the files name"
        say(f"{path}: {plural(len(entries), 'recording')} of {classes}")
        say(f"Check it, then: swashtwin inspect {path}")

    tell(result, as_json, show)


def _ask(key: str, question: str) -> str | None:
    """Answer of the person at the terminal; None where it is empty."""
    answer: str = typer.prompt(f"{question} [{key}]", default="", show_default=False, err=True)
    return answer.strip() or None


@reads_files
def inspect(
    paths: Sources,
    reading: Reading,
    as_json: Json = False,
) -> None:
    """Look for what is wrong with recordings. Exit code 3 where a recording must not be used."""
    from swashtwin.recordings import inspect_recordings

    with progress("inspecting recordings") as bar:
        unreadable: list[Finding] = []
        recordings = load_sources(paths, unreadable, **reading)
        report = inspect_recordings(recordings, unreadable=unreadable, progress=bar)
    result = {**report.to_dict(), "has_errors": report.has_errors}
    words = str if any(is_collection(path, {}) for path in paths) else by_options
    tell(result, as_json, lambda: show_inspection(report, recordings, words))
    if report.has_errors:
        raise typer.Exit(BAD_DATA)


def check(
    source: Index,
    window: Window = 2048,
    as_json: Json = False,
) -> None:
    """Say whether recordings are sound and enough, and for what.

    Exit code 3 where a recording must not be used, 5 where the recordings are sound but too few to train and to test.
    """
    from swashtwin.learning import check_recordings

    with progress("checking recordings") as bar:
        unreadable: list[Finding] = []
        recordings = load_sources([source], unreadable)
        result = check_recordings(recordings, window=window, unreadable=unreadable, progress=bar)
    tell(result.to_dict(), as_json, lambda: show_check(result))
    if not result.is_sound:
        raise typer.Exit(BAD_DATA)
    if not result.is_enough:
        raise typer.Exit(NOT_ENOUGH)
