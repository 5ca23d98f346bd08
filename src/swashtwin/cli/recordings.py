"""Commands of recordings: index, inspect, check, and of the group data convert and split."""

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from swashtwin.cli.options import (
    GroupName,
    Index,
    Json,
    ReadingOptions,
    Seed,
    Sources,
    Window,
    read_pairs,
    reads_files,
    spell_as_option,
)
from swashtwin.cli.outputs import Force, require_output
from swashtwin.cli.sources import is_collection, load_sources
from swashtwin.foundation import Spelling, plural, shell_command, spell_for_index

if TYPE_CHECKING:
    from swashtwin.learning import DataCheck
    from swashtwin.recordings import Finding, InspectionReport


# Whether the recordings suffice for a use, as it is printed.
_SUFFICIENCY = {"yes": "enough", "partly": "partly enough", "no": "not enough"}


@reads_files
def index(
    folder: Annotated[Path, typer.Argument(help="Folder of measurements. It is only read.")],
    reading_options: ReadingOptions,
    out: Annotated[
        Path | None, typer.Option(help="Index file. Default: recordings.toml in the folder.")
    ] = None,
    label_pattern: Annotated[
        str | None,
        typer.Option(
            help="Regular expression that is searched in each path. Its named groups become facts."
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
            help="Column of the table that holds a key of the index. Repeatable.",
        ),
    ] = None,
    include: Annotated[
        list[str] | None, typer.Option(help="Pattern of paths to include. Repeatable.")
    ] = None,
    pressure_unit: Annotated[
        str | None,
        typer.Option(
            help='Unit of pressures without a unit in names, tables and headers, such as "bar".'
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Propose an index of the recordings in a folder, for you to check and correct.

    On a terminal you are asked for facts that neither the files nor the options specify.
    """
    from swashtwin.recordings import propose_index, save_index

    path = out or folder / "recordings.toml"
    require_output(path, suffixes=[".toml"], inputs=[csv_table], force=force)

    # A progress bar would overwrite the questions.
    is_interactive = not as_json and sys.stdin.isatty()
    with nullcontext() if is_interactive else progress("reading files"):
        proposal = propose_index(
            folder,
            label_pattern=label_pattern,
            table=csv_table,
            columns=read_pairs(columns, "--column"),
            include=include or [],
            pressure_unit=pressure_unit,
            index_folder=path.parent,
            ask=_ask if is_interactive else None,
            **reading_options,
        )
    save_index(proposal.index, path)

    skipped = [finding.describe(spell_as_option) for finding in proposal.skipped]
    notes = [finding.describe(spell_as_option) for finding in proposal.notes]
    n_recordings = len(proposal.index["recording"])
    classes = proposal.index.get("classes", [])
    result = {
        "index": path,
        "recordings": n_recordings,
        "classes": classes,
        "fact_sources": list(proposal.facts),
        "skipped": skipped,
        "notes": notes,
    }

    def show() -> None:
        for reason in skipped:
            print_note(f"excluded: {reason}")
        for text in notes:
            print_note(f"note: {text}")
        for text in proposal.facts:
            print_text(text)
        class_names = ", ".join(map(format_label, classes)) or "the classes in the files"
        print_text(f"{path}: {plural(n_recordings, 'recording')} of {class_names}")
        print_text(f"Check it, then: {shell_command('inspect', path)}")

    print_result(result, as_json, show)


def _ask(key: str, question: str) -> str | None:
    answer: str = typer.prompt(f"{question} [{key}]", default="", show_default=False, err=True)
    return answer.strip() or None


@reads_files
def inspect(
    paths: Sources,
    reading_options: ReadingOptions,
    as_json: Json = False,
) -> None:
    """Search recordings for defects. The exit code is 3 if a recording must not be used."""
    from swashtwin.recordings import inspect_recordings

    with progress("inspecting recordings") as bar:
        unreadable: list[Finding] = []
        recordings = load_sources(paths, unreadable, **reading_options)
        report = inspect_recordings(recordings, unreadable=unreadable, progress=bar)

    has_index = any(is_collection(path, {}) for path in paths)
    result = {**report.to_dict(), "has_errors": report.has_errors}
    spelling = spell_for_index if has_index else spell_as_option
    print_result(result, as_json, lambda: _print_inspection(report, spelling))
    if report.has_errors:
        raise typer.Exit(BAD_DATA)


def _print_inspection(report: "InspectionReport", spelling: Spelling) -> None:
    rows: list[tuple[object, ...]] = []
    for recording in report.recordings:
        rate = recording.sample_rate
        for channel in recording.channels:
            rows.append(
                (
                    recording.recording_id,
                    format_label(recording.label),
                    int(rate) if rate.is_integer() else rate,
                    round(recording.duration, 3),
                    channel.name,
                    channel.minimum,
                    channel.maximum,
                    channel.rms,
                    recording.unit,
                )
            )
    header = (
        "recording",
        "class",
        "rate [Hz]",
        "length [s]",
        "channel",
        "minimum",
        "maximum",
        "rms",
        "unit",
    )
    print_rows(plural(len(report.recordings), "recording"), header, rows)

    findings = report.merged(by_kind=len(rows) > MAX_ROWS, spelling=spelling)
    for severity, text in findings:
        print_text(f"{severity}: {text}")
    if not findings:
        print_text("No defect detected.")


def check(
    source: Index,
    window: Window = 2048,
    as_json: Json = False,
) -> None:
    """Check whether recordings are sound and sufficient, and for which uses.

    The exit code is 3 if a recording must not be used, and 5 if the recordings are sound but too
    few to train and test a classifier.
    """
    from swashtwin.learning import check_recordings

    with progress("checking recordings") as bar:
        unreadable: list[Finding] = []
        recordings = load_sources([source], unreadable)
        result = check_recordings(recordings, window=window, unreadable=unreadable, progress=bar)

    print_result(result.to_dict(), as_json, lambda: _print_check(result))
    if not result.is_sound:
        raise typer.Exit(BAD_DATA)
    if not result.is_enough:
        raise typer.Exit(NOT_ENOUGH)


def _print_check(result: "DataCheck") -> None:
    print_text(result.answer)
    _print_counts(result)
    for use in result.uses:
        print_text(f"{_SUFFICIENCY[use.state]}: {use.name}: {use.reason}")
    for severity, text in result.inspection.merged(by_kind=True):
        print_text(f"{severity}: {text}")
    for label, condition in result.gaps:
        print_text(f"warning: {format_label(label)} was not measured at {condition}.")
    for text in result.notes:
        print_text(f"note: {text}")


def _print_counts(result: "DataCheck") -> None:
    """Print the number of recordings by class and operating point."""
    labels = list(dict.fromkeys(count.label for count in result.counts))
    conditions = list(dict.fromkeys(count.condition for count in result.counts))
    counts = {(count.label, count.condition): count for count in result.counts}

    rows: list[tuple[object, ...]] = []
    for label in labels:
        cells = [counts.get((label, condition)) for condition in conditions]
        numbers = [cell.recordings if cell else 0 for cell in cells]
        machines: set[str] = set()
        for cell in cells:
            if cell:
                machines.update(cell.specimens)
        rows.append((format_label(label), *numbers, len(machines)))
    if not rows:
        return

    columns = [
        condition if condition != "-" else "operating point unknown" for condition in conditions
    ]
    print_table("Recordings by class and operating point", ("class", *columns, "machines"), rows)


@reads_files
def convert(
    paths: Sources,
    out: Annotated[Path, typer.Option(help="Store to write, .h5. It appears when it is complete.")],
    reading_options: ReadingOptions,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write recordings of any format to one HDF5 store; they may be larger than the memory."""
    from swashtwin.recordings import write_store

    require_output(out, inputs=paths, force=force)
    recordings = load_sources(paths, **reading_options)
    with progress("MB") as bar:
        write_store(recordings, out, progress=bar)

    duration = sum(recording.duration for recording in recordings)
    size = out.stat().st_size
    result = {"store": out, "recordings": len(recordings), "seconds": duration, "bytes": size}

    def show() -> None:
        count = plural(len(recordings), "recording")
        print_text(f"{out}: {count}, {duration:.4g} s, {size / 1e6:.4g} MB")
        print_text(f"Next: {shell_command('inspect', out)}")

    print_result(result, as_json, show)


def split(
    source: Index,
    out: Annotated[
        Path | None, typer.Option(help="Folder for both files. Default: the index's folder.")
    ] = None,
    test_fraction: Annotated[
        float, typer.Option(help="Share of the recordings to test on, above 0 and at most 0.5.")
    ] = 0.2,
    group: GroupName = "recording",
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Split an index by recording into train.toml and test.toml.

    Calibration is training too: use train.toml for calibrate, synthesize and train, and test.toml
    for evaluate.
    """
    from swashtwin.recordings import load_recordings, write_subset_index

    folder = out or (source if source.is_dir() else source.parent)
    paths = {name: folder / f"{name}.toml" for name in ("train", "test")}
    require_output(*paths.values(), inputs=[source], force=force)

    recordings = load_recordings(source)
    parts = recordings.split(test_fraction, by=group, seed=seed)
    files: dict[str, Path] = {}
    ids: dict[str, list[str]] = {}
    for (name, path), part in zip(paths.items(), parts, strict=True):
        ids[name] = sorted(part.recording_ids)
        files[name] = write_subset_index(source, recordings, ids[name], path)

    result = {
        "seed": seed,
        "group": group,
        **files,
        "train_recordings": ids["train"],
        "test_recordings": ids["test"],
    }

    def show() -> None:
        for name, file in files.items():
            print_text(f"{file}: {plural(len(ids[name]), 'recording')}")

    print_result(result, as_json, show)
