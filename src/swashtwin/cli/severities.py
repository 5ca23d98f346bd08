"""Commands that tell how severe a fault is: severity, study severity, study fault-map."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, note_left_out, progress, say, table, tell
from swashtwin.cli.options import (
    Dimensions,
    FaultDepth,
    FaultLength,
    FaultWidth,
    Index,
    Jobs,
    Json,
    ReportFolder,
    fault_of,
    list_of,
    pairs_of,
)
from swashtwin.cli.studying import tell_study, this_command

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from swashtwin.calibration import SeverityTrend
    from swashtwin.pump import Fault
    from swashtwin.recordings import Recording


def severity(
    calibration: Annotated[Path, typer.Argument(help="Calibration of this pump on its healthy recordings.")],
    source: Index,
    fault: Annotated[str, typer.Option("--fault", help="Kind of fault, such as swash_plate.")],
    length: FaultLength = None,
    width: FaultWidth = None,
    depth: FaultDepth = None,
    dimensions: Dimensions = None,
    free: Annotated[
        list[str] | None,
        typer.Option(help="Further dimension to search, such as length; repeatable. The usual ones by default."),
    ] = None,
    healthy: Annotated[
        Path | None,
        typer.Option(help="Index of further healthy recordings; those of INDEX that are labeled normal count anyway."),
    ] = None,
    specimen: Annotated[str | None, typer.Option(help="Use the recordings of this machine only.")] = None,
    as_json: Json = False,
) -> None:
    """Tell how severe a fault is in each recording of a pump, in mm or um, with an interval: for one pump's trend.

    The severity (a depth, a clearance) is always searched; a given one is where the search starts. Of the further
    dimensions the usual ones are searched where they are not given. Calibrate with --band "0 Hz" "1 kHz", as far as
    severities are searched.
    """
    from swashtwin.calibration import estimate_severity, load_calibration
    from swashtwin.foundation import DataError
    from swashtwin.recordings import load_recordings

    kind = fault_of(fault, length, width, depth, dimensions)
    if kind is None:
        raise typer.BadParameter(
            "a normal pump has no severity; name a fault, such as swash_plate.", param_hint="--fault"
        )
    known = load_calibration(calibration)
    sound, worn = _sides(load_recordings(source).where(specimen=specimen), known.recording_ids)
    if not worn:
        raise DataError(
            f"{source} holds healthy recordings only ({len(sound)} labeled normal, or calibrated); give some that may "
            f"be worn, labeled {kind.label} or not at all."
        )
    if healthy is not None:
        known_ids = {one.recording_id for one in sound}
        further = load_recordings(healthy).where(label="normal", specimen=specimen)
        sound += [one for one in further if one.recording_id not in known_ids]
    given = {"length": length, "width": width, **pairs_of(dimensions, "--dimension")}
    held = {name for name, text in given.items() if text is not None}
    found = estimate_severity(known, worn, kind, healthy=sound, free=_free(free, held, kind))
    result = {**found.to_dict(), "healthy": [one.recording_id for one in sound]}
    tell(result, as_json, lambda: _show(found, len(sound)))


def _sides(recordings: "Iterable[Recording]", taught: "Collection[str]") -> "tuple[list[Recording], list[Recording]]":
    """(healthy recordings, those that may be worn): healthy is what is labeled normal or was calibrated."""
    sides: tuple[list[Recording], list[Recording]] = ([], [])
    for one in recordings:
        sides[one.label != "normal" and one.recording_id not in taught].append(one)
    return sides


def _free(asked: list[str] | None, held: set[str], fault: "Fault") -> list[str] | None:
    """Further dimensions to search: those asked for, else the usual ones that were not given."""
    from swashtwin.calibration import search_of

    return asked if asked else [name for name in search_of(fault).free if name not in held]


def _show(found: "SeverityTrend", healthy: int) -> None:
    rows = []
    for one in found.estimates:
        limit = one.detection_limit
        rows.append(
            (
                one.recording_id,
                f"{one.condition.discharge_pressure / 1e6:.4g} MPa",
                one.severity.words,
                one.severity.verdict,
                None if limit is None else one.severity.dimension.words(limit),
                ", ".join(f"{other.dimension.name} {other.words}, {other.verdict}" for other in one.dimensions[1:]),
            )
        )
    name = found.estimates[0].severity.dimension.name
    header = ("recording", "at", f"{name} (90 % interval)", "verdict", "least to be told", "further dimensions")
    table(f"Severity of {type(found.reference).__name__} by inversion", header, rows)
    for text in (*found.notes, *(f"{one.recording_id}: {text}" for one in found.estimates for text in one.notes)):
        note(f"note: {text}")
    note_left_out(found.left_out)
    say(f"{len(found.estimates)} recordings, against {healthy} healthy ones")


def study_severity(
    seeds: Annotated[str, typer.Option(help='Fleets of the virtual rig: "2,3,4,5,6".')] = "2,3",
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Severity by inversion on the virtual rig's trends: error against the hidden truth, by fault and dimension."""
    from swashtwin.bench import run_severity

    numbers = list_of(seeds, int, "--seeds") or [2, 3]
    with progress("severities") as bar:
        study = run_severity(numbers, jobs=jobs, progress=bar, command=this_command())
    tell_study(study, out, as_json)


def study_fault_map(
    seeds: Annotated[str, typer.Option(help='Fleets of the virtual rig: "2,3,4,5,6".')] = "2,3",
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Which parameters move with which fault, on the virtual rig, and whether that tells faults apart."""
    from swashtwin.bench import run_fault_map

    numbers = list_of(seeds, int, "--seeds") or [2, 3]
    with progress("moves") as bar:
        study = run_fault_map(numbers, jobs=jobs, progress=bar, command=this_command())
    tell_study(study, out, as_json)
