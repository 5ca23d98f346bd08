"""The command twin severity: how large a fault is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, note_merged, progress, say, table, tell
from swashtwin.cli.options import Index, Json, Specimen, as_calibration, fault_dimensions
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from swashtwin.calibration import SeverityTrend
    from swashtwin.recordings import Recording


def severity(
    calibration: Annotated[
        Path, typer.Argument(help="Calibration of this pump on its healthy recordings.", callback=as_calibration)
    ],
    source: Index,
    fault: Annotated[
        str,
        typer.Option(
            metavar="KIND[:NAME=QUANTITY,...]", help="Kind of fault; a dimension that is given is a fixed one."
        ),
    ],
    healthy: Annotated[
        Path | None,
        typer.Option(help="Index of further healthy recordings; those of INDEX that are labeled normal always count."),
    ] = None,
    specimen: Specimen = None,
    as_json: Json = False,
) -> None:
    """Estimate how severe a fault is in each recording of a pump, in mm or um, with an interval: for a pump's trend.

    The severity (a depth, a clearance) is always searched; one that is given is where the search starts. Of the further
    dimensions the usual ones are searched unless they are given. Calibrate with --band "0-1 kHz", the band in which
    severities are searched, and with phases, the default.
    """
    from swashtwin.calibration import estimate_severity, load_calibration, search_of
    from swashtwin.foundation import DataError
    from swashtwin.pump import is_healthy, read_fault
    from swashtwin.recordings import load_recordings, manifest_of, seen_recordings

    kind, fixed = fault_dimensions(fault)
    defect = read_fault(kind, **fixed)
    if defect is None:
        raise typer.BadParameter(
            "a normal pump has no severity; name a fault, such as swash_plate.", param_hint="--fault"
        )
    healthy_calibration = load_calibration(calibration)
    recordings = load_recordings(source, specimen=specimen)
    calibrated = seen_recordings(healthy_calibration.recording_hashes, manifest_of(recordings))
    sound, worn = _by_health(recordings, calibrated)
    if not worn:
        raise DataError(
            f"{source} holds healthy recordings only ({len(sound)} labeled normal, or calibrated); give some that may "
            f"be worn, labeled {defect.label} or not at all."
        )
    if healthy is not None:
        ids = {recording.recording_id for recording in sound}
        further = load_recordings(healthy, specimen=specimen)
        sound += [item for item in further if is_healthy(item.label) and item.recording_id not in ids]
    usual = [name for name in search_of(defect).free if name not in fixed]
    with progress("searching severities"):
        trend = estimate_severity(healthy_calibration, worn, defect, healthy=sound, free=usual)
    result = {**trend.to_dict(), "healthy": [recording.recording_id for recording in sound]}
    tell(result, as_json, lambda: _show_severity(trend, len(sound)))


def _by_health(
    recordings: "Iterable[Recording]", calibrated: "Collection[str]"
) -> "tuple[list[Recording], list[Recording]]":
    """(healthy recordings, those that may be worn): healthy is what is labeled so or was calibrated on."""
    from swashtwin.pump import is_healthy

    sides: tuple[list[Recording], list[Recording]] = ([], [])
    for recording in recordings:
        sides[not is_healthy(recording.label) and recording.recording_id not in calibrated].append(recording)
    return sides


def _show_severity(trend: "SeverityTrend", healthy: int) -> None:
    rows = []
    for estimate in trend.estimates:
        limit = estimate.detection_limit
        rows.append(
            (
                estimate.recording_id,
                f"{estimate.condition.discharge_pressure / 1e6:.4g} MPa",
                estimate.severity.words,
                estimate.severity.verdict,
                None if limit is None else estimate.severity.dimension.words(limit),
                ", ".join(f"{item.dimension.name} {item.words}, {item.verdict}" for item in estimate.dimensions[1:]),
            )
        )
    name = trend.estimates[0].severity.dimension.name
    header = ("recording", "at", f"{name} (90 % interval)", "verdict", "detection limit", "further dimensions")
    table(f"Severity of {type(trend.reference).__name__} by inversion", header, rows)
    notes = [f"{estimate.recording_id}: {text}" for estimate in trend.estimates for text in estimate.notes]
    for text in (*trend.notes, *notes):
        note(f"note: {text}")
    note_merged(trend.left_out, "left out")
    say(f"{plural(len(trend.estimates), 'recording')}, against {healthy} healthy ones")
