"""The command twin severity: how large a fault is, and how it goes on."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, note_left_out, progress, say, table, tell
from swashtwin.cli.options import Index, Json, Specimen, as_calibration, fault_dimensions, fault_from, read_list
from swashtwin.foundation import parse, plural

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from swashtwin.calibration import SeverityForecast, SeverityTrend
    from swashtwin.pump import Fault
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
    free: Annotated[
        list[str] | None,
        typer.Option(help="Further dimension to search, such as length; repeatable. The usual ones by default."),
    ] = None,
    healthy: Annotated[
        Path | None,
        typer.Option(help="Index of further healthy recordings; those of INDEX that are labeled normal always count."),
    ] = None,
    times: Annotated[
        str | None,
        typer.Option(
            help='When each recording that may be worn was made, in their order, such as running hours: "100,400,900". '
            "With three or more there is a forecast."
        ),
    ] = None,
    ahead: Annotated[
        str | None,
        typer.Option(help="Times to forecast, in the same unit; by default as far ahead as the recordings span."),
    ] = None,
    limit: Annotated[
        str | None, typer.Option(metavar="QUANTITY", help='Severity whose date is forecast, such as "120 um".')
    ] = None,
    specimen: Specimen = None,
    as_json: Json = False,
) -> None:
    """Estimate how severe a fault is in each recording of a pump, in mm or um, with an interval: for a pump's trend.

    The severity (a depth, a clearance) is always searched; one that is given is where the search starts. Of the further
    dimensions the usual ones are searched unless they are given. Calibrate with --band "0-1 kHz", the band in which
    severities are searched, and with phases, the default.
    """
    from swashtwin.calibration import LEAST_ESTIMATES, estimate_severity, load_calibration, search_of
    from swashtwin.foundation import DataError
    from swashtwin.pump import is_healthy
    from swashtwin.recordings import load_recordings, manifest_of, seen_recordings

    defect = fault_from(fault)
    if defect is None:
        raise typer.BadParameter(
            "a normal pump has no severity; name a fault, such as swash_plate.", param_hint="--fault"
        )
    instants, later, most = _read_forecast(times, ahead, limit, defect)
    healthy_calibration = load_calibration(calibration)
    recordings = load_recordings(source).where(specimen=specimen)
    calibrated = seen_recordings(healthy_calibration.recording_hashes, manifest_of(recordings))
    sound, worn = _by_health(recordings, calibrated)
    if not worn:
        raise DataError(
            f"{source} holds healthy recordings only ({len(sound)} labeled normal, or calibrated); give some that may "
            f"be worn, labeled {defect.label} or not at all."
        )
    if instants is not None and len(set(instants)) < LEAST_ESTIMATES:
        raise typer.BadParameter(
            f"a forecast needs recordings at {LEAST_ESTIMATES} different times, not at {len(set(instants))}.",
            param_hint="--times",
        )
    if instants is not None and len(instants) != len(worn):
        names = ", ".join(recording.recording_id for recording in worn[:5])
        raise typer.BadParameter(
            f"{plural(len(instants), 'time')} for {plural(len(worn), 'recording')} ({names}); give one for each.",
            param_hint="--times",
        )
    if healthy is not None:
        ids = {recording.recording_id for recording in sound}
        further = load_recordings(healthy).where(specimen=specimen)
        sound += [item for item in further if is_healthy(item.label) and item.recording_id not in ids]
    fixed = fault_dimensions(fault)[1]
    usual = [name for name in search_of(defect).free if name not in fixed]
    with progress("searching severities"):
        trend = estimate_severity(healthy_calibration, worn, defect, healthy=sound, free=free or usual)
    forecast = (
        None if instants is None else trend.forecast(instants, later or [2 * max(instants) - min(instants)], most)
    )
    result = {**trend.to_dict(), "healthy": [recording.recording_id for recording in sound],
              "forecast": None if forecast is None else forecast.to_dict()}  # fmt: skip

    def show() -> None:
        _show_severity(trend, len(sound))
        if forecast is not None:
            _show_forecast(forecast, trend)

    tell(result, as_json, show)


def _read_forecast(
    times: str | None, ahead: str | None, limit: str | None, defect: "Fault"
) -> tuple[list[float] | None, list[float] | None, float | None]:
    """Times of the recordings, times to forecast and the severity [SI] whose date is wanted; None where not given."""
    from swashtwin.calibration import search_of

    instants, later = read_list(times, float, "--times"), read_list(ahead, float, "--ahead")
    if instants is None and (later is not None or limit is not None):
        raise typer.BadParameter("a forecast needs --times, one for each recording.", param_hint="--times")
    for option, numbers in (("--times", instants), ("--ahead", later)):
        if not all(map(math.isfinite, numbers or ())):
            raise typer.BadParameter("must be finite numbers.", param_hint=option)
    if limit is None:
        return instants, later, None
    most = parse(limit, defect.units.get(search_of(defect).dimensions[0].name, ""), name="--limit")
    if not 0 < most < math.inf:
        raise typer.BadParameter(f"{limit} must be a severity above 0.", param_hint="--limit")
    return instants, later, most


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
    note_left_out(trend.left_out)
    say(f"{plural(len(trend.estimates), 'recording')}, against {healthy} healthy ones")


def _show_forecast(forecast: "SeverityForecast", trend: "SeverityTrend") -> None:
    dimension = trend.estimates[0].severity.dimension
    rows = [
        (f"{time:g}", *(dimension.words(float(end)) for end in ends))
        for time, *ends in zip(forecast.times, forecast.value, forecast.low, forecast.high, strict=True)
    ]
    table("Forecast, a straight line with a band of 90 %", ("time", dimension.name, "at least", "at most"), rows)
    if forecast.limit is not None:
        not_yet = f"not by {forecast.times[-1]:g}"
        likely, earliest, latest = (
            not_yet if time is None else f"{time:.4g}" for time in (forecast.reached[i] for i in (1, 0, 2))
        )
        say(f"{dimension.words(forecast.limit)} is reached: {likely} (earliest: {earliest}; latest: {latest})")
