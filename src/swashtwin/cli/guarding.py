"""Commands that guard against leaks: guard, audit, study leakage."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import progress, say, tell
from swashtwin.cli.exits import BAD_DATA
from swashtwin.cli.options import Jobs, Json, Length, ReportFolder, Seed, list_of, pairs_of
from swashtwin.cli.studying import tell_study, this_command

if TYPE_CHECKING:
    from swashtwin.recordings import Recording

Source = Annotated[Path, typer.Argument(help="Index file or the folder that holds one, a store, or a --public-set.")]
PublicSet = Annotated[
    str | None, typer.Option(help="Name of the public set that the folder holds, such as pump_cavitation.")
]
Only = Annotated[
    list[str] | None,
    typer.Option(metavar="ATTRIBUTE=VALUE,...", help="Recordings to take, by label, specimen, attribute; repeatable."),
]


def guard(
    source: Source, public_set: PublicSet = None, only: Only = None, seed: Seed = 0, as_json: Json = False
) -> None:
    """Look for what would fool a classifier: copies, and classes that rate, gain, date or one machine give away."""
    from swashtwin.learning import confounding, copied_recordings

    recordings = _taken(source, public_set, only)
    copies, found = copied_recordings(recordings), confounding(recordings, seed=seed)
    result = {
        "recordings": len(recordings),
        "copies": [asdict(one) for one in copies],
        "confounding": [asdict(one) for one in found],
    }

    def show() -> None:
        for one in copies:
            how = "again" if one.exact else f"again, {one.gain:.4g} times as large"
            say(f"copy: {one.again.recording_id}, {one.again.channel} is {one.first.recording_id} {how}; keep one.")
        warnings = [one for one in found if one.is_warning]
        for finding in warnings:
            say(f"warning: {finding.message}")
        said = f"{len(copies)} copies, {len(warnings)} warnings"
        say(f"{said} among {len(recordings)} recordings; {len(found)} facts and levels were looked at.")

    tell(result, as_json, show)


def audit(
    table: Annotated[
        Path, typer.Argument(metavar="FILE.csv|FOLDER", help="One row per window; or a folder that split wrote.")
    ],
    columns: Annotated[
        list[str] | None,
        typer.Option(metavar="FACT=COLUMN", help="Column of recording, role, specimen, start, ...; repeatable."),
    ] = None,
    whole: Annotated[
        list[str] | None,
        typer.Option(help="What must not be on two sides: recording (default), specimen, or a column; repeatable."),
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 3 where a leak is found.")] = False,
    as_json: Json = False,
) -> None:
    """Say what overlaps between the roles of anyone's windows: recordings, machines, moments, copies, classes.

    A leak that is found is the answer, not an error: the exit code is 0 unless --strict is given.
    """
    from swashtwin.learning import audit as audited
    from swashtwin.learning import read_audit_rows, rows_of

    kept = tuple(whole or ["recording"])
    more = tuple(name for name in kept if name not in ("recording", "specimen"))
    named = pairs_of(columns, "--columns")
    rows = rows_of(table) if table.is_dir() else read_audit_rows(table, columns=named, groups=more)
    found = audited(rows, whole=kept)
    result = {"table": table, "rows": len(rows), **asdict(found), "has_leak": found.has_leak}

    def show() -> None:
        said = ", ".join(f"{count} of role {role}" for role, count in found.roles.items())
        say(f"{len(rows)} rows: {said}. The table tells {', '.join(found.facts)}.")
        for one in found.findings:
            say(f"{one.severity}: {one.message}")
        if not found.has_leak:
            say(f"No leak was found in what the table tells; kept whole: {', '.join(kept)}.")

    tell(result, as_json, show)
    if strict and found.has_leak:
        raise typer.Exit(BAD_DATA)


def leakage(
    source: Source,
    public_set: PublicSet = None,
    only: Only = None,
    length: Length = 2048,
    group: Annotated[
        list[str] | None, typer.Option(help="What to hold out; all that the recordings allow by default; repeatable.")
    ] = None,
    seeds: Annotated[str, typer.Option(help='Seeds of folds and trees: "0,1,2,3,4".')] = "0,1,2,3,4",
    folds: Annotated[int, typer.Option(min=2, help="Folds at most.")] = 5,
    trees: Annotated[int, typer.Option(min=1, help="Trees.")] = 200,
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """The leak premium: the score on random windows beside that on whole recordings, machines, conditions held out."""
    from swashtwin.bench import run_leakage

    recordings = _taken(source, public_set, only)
    with progress("leakage") as bar:
        study = run_leakage(
            recordings,
            length=length,
            groups=group or None,
            seeds=list_of(seeds, int, "--seeds") or [0],
            n_folds=folds,
            n_trees=trees,
            jobs=jobs,
            progress=bar,
            command=this_command(),
        )
    tell_study(study, out, as_json)


def _taken(source: Path, public_set: str | None, only: list[str] | None) -> "list[Recording]":
    """Recordings of an index, a store or a public set, those alone that are asked for."""
    from swashtwin.bench import read_public_set
    from swashtwin.foundation import DataError
    from swashtwin.recordings import load_recordings

    recordings = list(load_recordings(source)) if public_set is None else read_public_set(public_set, source)
    for name, text in pairs_of(only, "--only").items():
        wanted = {value.strip() for value in text.split(",")}
        recordings = [one for one in recordings if _fact(one, name) in wanted]
        if not recordings:
            raise DataError(f"no recording has {name} = {text}; swashtwin inspect shows what there is.")
    return recordings


def _fact(recording: "Recording", name: str) -> str:
    if name in ("label", "specimen"):
        return getattr(recording, name) or ""
    return str(recording.attributes.get(name, ""))
