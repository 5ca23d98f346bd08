"""Commands of recordings: index, inspect, check, and of the group data convert and split."""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import (
    BAD_DATA,
    MAX_ROWS,
    NOT_ENOUGH,
    format_label,
    print_note,
    print_result,
    print_rows,
    print_table,
    print_text,
    progress,
)
from swashtwin.cli.files import (
    Force,
    by_options,
    is_collection,
    load_sources,
    require_output,
    single_file_options,
)
from swashtwin.cli.options import (
    GroupName,
    Index,
    Json,
    Reading,
    Seed,
    Sources,
    Window,
    read_pairs,
    reads_files,
)
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.learning import DataCheck
    from swashtwin.recordings import Finding, InspectionReport


@reads_files
def index(
    folder: Annotated[Path, typer.Argument(help="Folder of measurements; it is only read.")],
    reading: Reading,
    out: Annotated[
        Path | None, typer.Option(help="Index file; recordings.toml in the folder by default.")
    ] = None,
    label_pattern: Annotated[
        str | None,
        typer.Option(
            help="Regular expression searched in each path; its named groups become facts."
        ),
    ] = None,
    csv_table: Annotated[
        Path | None, typer.Option("--table", help="CSV table with one row per file.")
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--column",
            metavar="KEY=COLUMN",
            help="Column of the table that holds a key; repeatable.",
        ),
    ] = None,
    include: Annotated[
        list[str] | None, typer.Option(help="Pattern of paths to include; repeatable.")
    ] = None,
    pressure_unit: Annotated[
        str | None,
        typer.Option(help='Unit of pressures in names, tables and headers that have none: "bar".'),
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
    result: dict[str, Any] = {
        "index": path,
        "recordings": len(entries),
        "classes": proposal.index.get("classes", []),
    }
    result |= {
        "fact_sources": list(proposal.facts),
        "skipped": list(proposal.skipped),
        "notes": list(proposal.notes),
    }

    def show() -> None:
        for reason in proposal.skipped:
            print_note(f"left out: {reason}")
        for remark in proposal.notes:
            print_note(f"note: {remark}")
        for sentence in proposal.facts:
            print_text(sentence)
        classes = ", ".join(map(format_label, result["classes"])) or "classes that the files name"
        print_text(f"{path}: {plural(len(entries), 'recording')} of {classes}")
        print_text(f"Check it, then: swashtwin inspect {path}")

    print_result(result, as_json, show)


def _ask(key: str, question: str) -> str | None:
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
    print_result(result, as_json, lambda: _show_inspection(report, words))
    if report.has_errors:
        raise typer.Exit(BAD_DATA)


def check(
    source: Index,
    window: Window = 2048,
    as_json: Json = False,
) -> None:
    """Say whether recordings are sound and enough, and for what.

    Exit code 3 where a recording must not be used, 5 where the recordings are sound but too few to
    train and to test.
    """
    from swashtwin.learning import check_recordings

    with progress("checking recordings") as bar:
        unreadable: list[Finding] = []
        recordings = load_sources([source], unreadable)
        result = check_recordings(recordings, window=window, unreadable=unreadable, progress=bar)
    print_result(result.to_dict(), as_json, lambda: _show_check(result))
    if not result.is_sound:
        raise typer.Exit(BAD_DATA)
    if not result.is_enough:
        raise typer.Exit(NOT_ENOUGH)


@reads_files
def convert(
    paths: Sources,
    out: Annotated[Path, typer.Option(help="Store to write, .h5; it appears when it is complete.")],
    reading: Reading,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write recordings of any format to one chunked HDF5 store; they may be larger than memory."""
    from swashtwin.recordings import write_store

    require_output(out, inputs=paths, force=force)
    recordings = load_sources(paths, **reading)
    with progress("MB") as bar:
        write_store(recordings, out, progress=bar)
    seconds, size = sum(recording.duration for recording in recordings), out.stat().st_size
    result = {"store": out, "recordings": len(recordings), "seconds": seconds, "bytes": size}

    def show() -> None:
        print_text(
            f"{out}: {plural(len(recordings), 'recording')}, {seconds:.4g} s, {size / 1e6:.4g} MB"
        )
        print_text(f"Next: swashtwin inspect {out}")

    print_result(result, as_json, show)


def split(
    source: Index,
    out: Annotated[
        Path | None, typer.Option(help="Folder for both files; that of the index by default.")
    ] = None,
    test_fraction: Annotated[
        float, typer.Option(help="Share to test on, above 0 and at most 0.5.")
    ] = 0.2,
    group: GroupName = "recording",
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Split an index by recording into train.toml and test.toml, for a twin and a classifier alike.

    Calibrating is training: calibrate, synthesize and train with train.toml, and evaluate with
    test.toml.
    """
    from swashtwin.recordings import load_recordings, write_subset_index

    folder = out or (source if source.is_dir() else source.parent)
    paths = {name: folder / f"{name}.toml" for name in ("train", "test")}
    require_output(*paths.values(), inputs=[source], force=force)
    recordings = load_recordings(source)
    sides = dict(zip(paths, recordings.split(test_fraction, by=group, seed=seed), strict=True))
    ids = {name: sorted(side.recording_ids) for name, side in sides.items()}
    files = {
        name: write_subset_index(source, recordings, ids[name], path)
        for name, path in paths.items()
    }
    result = {
        "seed": seed,
        "group": group,
        **files,
        **{f"{name}_recordings": ids[name] for name in ids},
    }

    def show() -> None:
        for name, file in files.items():
            print_text(f"{file}: {plural(len(ids[name]), 'recording')}")

    print_result(result, as_json, show)


_STATES = {"yes": "enough", "partly": "in part", "no": "not enough"}


def _show_inspection(report: "InspectionReport", words: Callable[[str], str]) -> None:
    rows = [
        (item.recording_id, format_label(item.label),
         int(item.sample_rate) if item.sample_rate.is_integer() else item.sample_rate, round(item.duration, 3),
         channel.name, channel.minimum, channel.maximum, channel.rms, item.unit)
        for item in report.recordings
        for channel in item.channels
    ]  # fmt: skip
    header = (
        "recording",
        "class",
        "rate [Hz]",
        "length [s]",
        "channel",
        "least",
        "greatest",
        "rms",
        "unit",
    )
    print_rows(plural(len(report.recordings), "recording"), header, rows)
    sentences = report.merged(by_kind=len(rows) > MAX_ROWS)
    for severity, text in sentences:
        print_text(f"{severity}: {words(text)}")
    if not sentences:
        print_text("Nothing suspicious was found.")


def _show_check(check: "DataCheck") -> None:
    print_text(check.answer)
    labels = list(dict.fromkeys(count.label for count in check.counts))
    conditions = list(dict.fromkeys(count.condition for count in check.counts))
    counts = {(count.label, count.condition): count for count in check.counts}
    rows = []
    for label in labels:
        cells = [counts.get((label, condition)) for condition in conditions]
        specimens = {name for cell in cells if cell for name in cell.specimens}
        rows.append(
            (
                format_label(label),
                *(cell.recordings if cell else 0 for cell in cells),
                len(specimens),
            )
        )
    if rows:
        names = (
            condition if condition != "-" else "condition not stated" for condition in conditions
        )
        print_table("Recordings by class and condition", ("class", *names, "specimens"), rows)
    for use in check.uses:
        print_text(f"{_STATES[use.state]}: {use.name}: {use.reason}")
    for severity, text in check.inspection.merged(by_kind=True):
        print_text(f"{severity}: {text}")
    for label, condition in check.gaps:
        print_text(f"warning: {format_label(label)} was not measured at {condition}.")
    for text in check.notes:
        print_text(f"note: {text}")
