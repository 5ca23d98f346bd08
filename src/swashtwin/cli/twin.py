"""Commands of the group twin on twins and pump files: severity, next, pump show and pump new."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import (
    print_merged_notes,
    print_note,
    print_result,
    print_table,
    print_text,
    progress,
)
from swashtwin.cli.options import (
    CalibrationFile,
    Index,
    Json,
    Specimen,
    fault_dimensions,
    require_index,
    split_names,
    without_none,
)
from swashtwin.cli.outputs import require_folder
from swashtwin.foundation import DataError, parse_quantity, plural, shell_command

if TYPE_CHECKING:
    from swashtwin.calibration import (
        Calibration,
        CandidateRecording,
        RecordingPlan,
        RemainingLife,
        SeverityTrend,
    )
    from swashtwin.pump import Fault, Pump
    from swashtwin.recordings import Recording, Recordings

# Candidate recordings that are printed; `--json` prints all.
_MAX_CANDIDATES = 10

# Options without which a nameplate cannot be scaled; the mass has a default.
_REQUIRED_NAMEPLATE = ("displacement", "pistons", "speed", "pressure")

# Factor within which a value counts as known: that of the verdict "identified".
_KNOWN_FACTOR = 1.5


def plan_next(
    calibration: CalibrationFile,
    speeds: Annotated[
        str | None,
        typer.Option(
            help='Speeds that the machine can run, such as "600 rpm, 1200 rpm". Default: 2/3, 1 '
            "and 3/2 of the mean measured speed, within the rated one."
        ),
    ] = None,
    pressures: Annotated[
        str | None,
        typer.Option(
            help='Absolute discharge pressures that the machine can run, such as "5 MPa, 15 MPa". '
            "Default: the same factors of the mean measured pressure."
        ),
    ] = None,
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            help='Sensors of the pump file that record together, such as "cover_z, body_y". Repeat '
            "for each set. Default: the calibrated sensors."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Rank operating points and sensors by how much a further recording narrows the intervals.

    Each candidate counts as one recording that is as long as the previous ones, with the pump in
    the same state. Specify what your machine can run.
    """
    from swashtwin.calibration import load_calibration, plan_recording

    speed_values = [parse_quantity(part, "rad/s", name="--speeds") for part in split_names(speeds)]
    pressure_values = [
        parse_quantity(part, "Pa", name="--pressures") for part in split_names(pressures)
    ]
    sensor_sets = [split_names(text) for text in sensors or ()]
    calibrated = load_calibration(calibration)
    with progress("computing expected widths") as bar:
        plan = plan_recording(
            calibrated,
            speeds=speed_values or None,
            pressures=pressure_values or None,
            sensors=sensor_sets or None,
            progress=bar,
        )
    print_result({"calibration": calibration, **asdict(plan)}, as_json, lambda: _print_plan(plan))


def _print_plan(plan: "RecordingPlan") -> None:
    rows = [_candidate_row(candidate, plan) for candidate in plan.candidates[:_MAX_CANDIDATES]]
    header = (
        "speed",
        "pressure",
        "length",
        "sensors",
        "width then",
        "narrower by",
        "value narrowed most",
        f"then within a factor of {_KNOWN_FACTOR:g}",
    )
    print_table(
        "Candidates for the next recording; total ln width of the six intervals now "
        f"{plan.total_interval_width:.2f}",
        header,
        rows,
    )

    if plan.candidates[-1].total_interval_width >= plan.total_interval_width:
        print_text(
            "none: there, the model error of the twin exceeds what a further recording resolves, "
            "so that no interval becomes narrower."
        )

    n_omitted = len(plan.candidates) - len(rows)
    if n_omitted > 0:
        print_text(f"{n_omitted} further candidates, which narrow less: --json")

    if plan.excluded_speeds:
        speeds = ", ".join(_format_speed(speed) for speed in plan.excluded_speeds)
        print_text(
            f"Left out: {speeds}. A recording as long as the previous ones "
            f"({plan.candidates[0].duration:.3g} s) has too few revolutions there: record at least "
            f"{math.ceil(10 * plan.required_duration) / 10:g} s."
        )

    if len(plan.sequence) > 1:
        print_table(
            "Recorded one after another, the best are expected to leave",
            ("", *header),
            [
                (str(number), *_candidate_row(candidate, plan))
                for number, candidate in enumerate(plan.sequence, start=1)
            ],
        )


def _format_speed(speed: float) -> str:
    return f"{speed * 30 / math.pi:.0f} rpm"


def _candidate_row(candidate: "CandidateRecording", plan: "RecordingPlan") -> tuple[str, ...]:
    gain = 1 - candidate.total_interval_width / plan.total_interval_width
    symbol, factor = max(candidate.narrowing_factors.items(), key=lambda pair: pair[1])
    narrow_values = [
        name
        for name, expected_factor in candidate.expected_factors.items()
        if expected_factor <= _KNOWN_FACTOR
    ]
    return (
        _format_speed(candidate.speed),
        f"{candidate.discharge_pressure / 1e6:.3g} MPa",
        f"{candidate.duration:.3g} s",
        ", ".join(candidate.channels),
        f"{candidate.total_interval_width:.2f}",
        f"{gain:.1%}" if gain > 0 else "none",
        f"{symbol}, {factor:.2g} times" if factor > 1 else "-",
        ", ".join(narrow_values) or "-",
    )


def new_pump(
    name: Annotated[str, typer.Argument(help="Name of the new pump.")],
    original: Annotated[
        str, typer.Option("--pump", help="Pump to copy or to scale, by name or .toml file.")
    ] = "25scy14-1b",
    displacement: Annotated[
        str | None,
        typer.Option(
            help='Nameplate: volume per revolution, such as "45 cm3/rev". Scales the pump.'
        ),
    ] = None,
    pistons: Annotated[
        int | None, typer.Option(min=3, max=19, help="Nameplate: number of pistons.")
    ] = None,
    speed: Annotated[
        str | None, typer.Option(help='Nameplate: rated speed, such as "1500 rpm".')
    ] = None,
    pressure: Annotated[
        str | None,
        typer.Option(
            help='Discharge pressure for which the port timing is designed, such as "280 bar".'
        ),
    ] = None,
    mass: Annotated[
        str | None,
        typer.Option(help='Mass without oil, such as "21 kg". Default: from catalogs.'),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for NAME.toml.", callback=require_folder)
    ] = Path(),
    as_json: Json = False,
) -> None:
    """Write a pump file for you to edit: scaled from a nameplate, or a commented copy.

    The source of each number states whether it is from the nameplate, scaled, or a guess.
    """
    import swashtwin.pump as pump

    plate = None
    values = without_none(
        displacement=displacement, pistons=pistons, speed=speed, pressure=pressure, mass=mass
    )
    if values:
        missing = [f"--{option}" for option in _REQUIRED_NAMEPLATE if option not in values]
        if missing:
            raise typer.BadParameter(
                f"is part of a nameplate, which also requires {', '.join(missing)}.",
                param_hint=f"--{next(iter(values))}",
            )
        plate = pump.read_nameplate(**{"mass": None, **values})

    path = pump.new_pump(name.removesuffix(".toml"), like=original, nameplate=plate, folder=out)

    def show() -> None:
        print_text(str(path))
        next_command = shell_command("twin", "pump", "show", path, "--effects")
        print_text(
            f"Edit it, then: {next_command}. The quality of a twin depends on these numbers."
        )

    print_result({"pump": path}, as_json, show)


def show_pump(
    name: Annotated[str, typer.Argument(help="Name of a pump, or its .toml file.")] = "25scy14-1b",
    effects: Annotated[
        bool,
        typer.Option(
            "--effects",
            help="Print how much the vibration depends on each number, the largest effect first.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Print every number of a pump with its source, in trade units (with --json in SI units)."""
    from swashtwin.pump import available_pumps, load_pump, pump_numbers

    pump = load_pump(name)
    numbers = list(pump_numbers(pump))
    derived = list(_derived_numbers(pump))
    result: dict[str, Any] = {
        "name": pump.name,
        "parameters": [
            {"name": path, "value": value, "unit": unit, "source": pump.sources.get(path, "")}
            for path, value, unit in numbers
        ],
        "channels": pump.channels,
        "available": available_pumps(),
        "derived": [
            {"name": title, "value": value, "unit": unit} for title, value, unit in derived
        ],
    }
    if effects:
        result["effects"] = _compute_effects(pump)

    def show() -> None:
        print_table(
            pump.name,
            ("parameter", "value", "source"),
            [
                (path, _format_in_trade_units(value, unit), pump.sources.get(path, ""))
                for path, value, unit in numbers
            ],
        )

        print_table(
            "Derived quantities",
            ("", "value"),
            [(title, _format_in_trade_units(value, unit)) for title, value, unit in derived],
        )

        if effects:
            print_table(
                "Effect of each number on the vibration of the healthy pump at its rated point",
                ("parameter", "changed by", "line amplitudes change by", "source"),
                [
                    (effect["name"], effect["step"], f"{effect['effect']:.2%}", effect["source"])
                    for effect in result["effects"]
                ],
            )

    print_result(result, as_json, show)


def _compute_effects(pump: "Pump") -> list[dict[str, Any]]:
    """Return the effect of each number on the healthy pump's lines, the largest first."""
    from swashtwin.foundation import InputError
    from swashtwin.physics import Twin, sensitivities
    from swashtwin.pump import OperatingCondition

    if pump.rated is None:
        raise InputError(
            f"{pump.name} has no rated operating point. Add speed and discharge_pressure under "
            "[rated] to its file."
        )
    with progress("changing one number at a time"):
        twin = Twin(pump, OperatingCondition(pump.rated.speed, pump.rated.discharge_pressure))
        return [
            {
                "name": effect.path,
                "step": effect.step,
                "effect": effect.effect,
                "source": pump.sources[effect.path],
            }
            for effect in sensitivities(twin)
        ]


def _derived_numbers(pump: "Pump") -> Iterator[tuple[str, float, str]]:
    """Yield (title, value, SI unit) of quantities that follow from a pump's numbers."""
    from swashtwin.pump import stroke_of

    group = pump.rotating_group
    yield "displacement per revolution", group.displacement, "m^3"
    yield "stroke of a piston", stroke_of(group), "m"
    yield "diameter of the pitch circle", 2 * group.pitch_radius, "m"
    if pump.rated is None:
        return

    shaft_frequency = pump.rated.speed / (2 * math.pi)
    rated_speed = _format_in_trade_units(pump.rated.speed, "rad/s")
    yield (
        f"piston-pass frequency at {rated_speed}",
        group.piston_count * shaft_frequency,
        "Hz",
    )
    yield f"theoretical flow at {rated_speed}", group.displacement * shaft_frequency, "m^3/s"


def _format_in_trade_units(value: Any, unit: str) -> str:
    """Return a number, or several, with five digits in the units of the trade."""
    from swashtwin.pump import format_quantity

    numbers = value if isinstance(value, tuple) else (value,)
    return ", ".join(format_quantity(number, unit, 5) for number in numbers)


def severity(
    calibration: Annotated[
        Path,
        typer.Argument(
            metavar="CALIBRATION", help="Calibration of this pump on its healthy recordings."
        ),
    ],
    source: Index,
    fault: Annotated[
        str,
        typer.Option(
            metavar="KIND[:NAME=QUANTITY,...]",
            help="Kind of fault. A further dimension that is given is held fixed.",
        ),
    ],
    healthy: Annotated[
        Path | None,
        typer.Option(
            help="Index of further healthy recordings. Recordings of INDEX that are labeled normal "
            "are always used.",
            callback=require_index,
        ),
    ] = None,
    limit: Annotated[
        str | None,
        typer.Option(
            metavar="QUANTITY",
            help='Severity at which the pump has to be stopped, such as "200 um": the time until '
            "then is estimated from the dates of the recordings.",
        ),
    ] = None,
    specimen: Specimen = None,
    as_json: Json = False,
) -> None:
    """Estimate the severity of a fault in each recording of a pump, with an interval.

    The severity (a depth or a clearance, in mm or um) is always estimated; a given one is the
    starting value of the search. Of the further dimensions, those that are usually unknown are
    estimated unless they are given. Calibrate with --band "0-1 kHz", the band in which severities
    are estimated, and with phases, which is the default.
    """
    from swashtwin.calibration import (
        estimate_remaining_life,
        estimate_severity,
        get_severity_search,
        load_calibration,
    )
    from swashtwin.pump import read_fault, read_severity
    from swashtwin.recordings import load_recordings, summarize_recordings

    kind, fixed_dimensions = fault_dimensions(fault)
    defect = read_fault(kind, **fixed_dimensions)
    if defect is None:
        raise typer.BadParameter(
            "must be a fault with a severity, such as swash_plate.", param_hint="--fault"
        )
    limit_value = None if limit is None else read_severity(kind, limit)

    healthy_calibration = load_calibration(calibration)
    recordings = load_recordings(source, specimen=specimen)
    if specimen is not None:
        _warn_of_other_machine(calibration, healthy_calibration, source, specimen)
    healthy_recordings, worn_recordings = _divide_by_health(
        source, recordings, healthy_calibration, defect
    )
    if healthy is not None:
        healthy_recordings += _further_healthy(healthy, specimen, healthy_recordings)
    dates = {} if limit is None else _dates_of(worn_recordings)

    free_dimensions = [
        name for name in get_severity_search(defect).default_free if name not in fixed_dimensions
    ]
    with progress("estimating severities") as bar:
        trend = estimate_severity(
            healthy_calibration,
            worn_recordings,
            defect,
            healthy=healthy_recordings,
            free=free_dimensions,
            progress=bar,
        )
    life = None
    if limit_value is not None:
        estimated_dates = [dates[estimate.recording_id] for estimate in trend.estimates]
        life = estimate_remaining_life(trend, estimated_dates, limit_value)

    healthy_ids = [recording.recording_id for recording in healthy_recordings]
    date_texts = {
        recording.recording_id: summarize_recordings([recording]).date
        for recording in worn_recordings
    }
    result = {**trend.to_dict(), "healthy": healthy_ids}
    for row in result["estimates"]:
        row["date"] = date_texts[row["recording_id"]]
    if life is not None:
        result["remaining_life"] = life.to_dict()

    def print_all() -> None:
        _print_severity(trend, len(healthy_ids), date_texts)
        if life is not None:
            _print_remaining_life(trend, life)

    print_result(result, as_json, print_all)


def _dates_of(recordings: "Iterable[Recording]") -> dict[str, datetime]:
    """Return the date of each recording by its id."""
    from swashtwin.recordings import summarize_recordings

    dates = {}
    for recording in recordings:
        text = summarize_recordings([recording]).date
        try:
            date = datetime.fromisoformat(text)
        except ValueError:
            problem = "no date"
            if text:
                problem = f"the date {text!r}, which is not like 2024-05-31 08:30"
            raise DataError(
                f"{recording.recording_id} has {problem}. --limit needs the date of each "
                'recording: specify attributes = {date = "2024-05-31 08:30"} in the index.'
            ) from None
        # a date without a time zone is taken as UTC, so that all can be compared
        dates[recording.recording_id] = date if date.tzinfo else date.replace(tzinfo=UTC)
    return dates


def _print_remaining_life(trend: "SeverityTrend", life: "RemainingLife") -> None:
    dimension = trend.estimates[0].severity.dimension
    limit = f"{dimension.name} {dimension.format_value(life.limit)}"
    since = "" if life.as_of is None else f", from {life.as_of:%Y-%m-%d %H:%M}"
    print_text(f"remaining time until {limit}{since}: {life.text}")


def _warn_of_other_machine(
    calibration_file: Path, calibration: "Calibration", source: Path, specimen: str
) -> None:
    """Print a note if the calibration rests on recordings of another machine in the index."""
    from swashtwin.recordings import build_manifest, find_copies, load_recordings

    of_other_machines = [
        recording
        for recording in load_recordings(source)
        if recording.recording_id in calibration.recording_ids
        and recording.specimen not in (None, specimen)
    ]
    if find_copies(calibration.recording_hashes, build_manifest(of_other_machines)):
        print_note(
            f"note: {calibration_file} is of machine {of_other_machines[0].specimen}, but the "
            f"recordings are of {specimen}. Calibrate {specimen}."
        )


def _divide_by_health(
    source: Path, recordings: "Recordings", calibration: "Calibration", defect: "Fault"
) -> "tuple[list[Recording], list[Recording]]":
    """Return the healthy recordings, and those that may be worn.

    Healthy are those that are labeled so, or on which the healthy pump was calibrated.
    """
    from swashtwin.foundation import DataError
    from swashtwin.pump import is_healthy
    from swashtwin.recordings import build_manifest, find_copies

    calibrated_ids = find_copies(calibration.recording_hashes, build_manifest(recordings))
    healthy_recordings: list[Recording] = []
    worn_recordings: list[Recording] = []
    for recording in recordings:
        if is_healthy(recording.label) or recording.recording_id in calibrated_ids:
            healthy_recordings.append(recording)
        else:
            worn_recordings.append(recording)

    if not worn_recordings:
        raise DataError(
            f"{source} has only healthy recordings ({len(healthy_recordings)} labeled normal or "
            f"used for calibration). Add recordings that may be worn, labeled {defect.label} or "
            "without a label."
        )
    return healthy_recordings, worn_recordings


def _further_healthy(
    index: Path, specimen: str | None, known_recordings: "list[Recording]"
) -> "list[Recording]":
    """Return the healthy recordings of a further index that are not known yet."""
    from swashtwin.pump import is_healthy
    from swashtwin.recordings import load_recordings

    known_ids = {recording.recording_id for recording in known_recordings}
    return [
        recording
        for recording in load_recordings(index, specimen=specimen)
        if is_healthy(recording.label) and recording.recording_id not in known_ids
    ]


def _print_severity(trend: "SeverityTrend", n_healthy: int, dates: Mapping[str, str]) -> None:
    rows = []
    for estimate in trend.estimates:
        limit = estimate.detection_limit
        further_dimensions = [
            f"{dimension.dimension.name} {dimension.text}, {dimension.verdict}"
            for dimension in estimate.dimensions[1:]
        ]
        rows.append(
            (
                estimate.recording_id,
                dates[estimate.recording_id] or "not specified",
                f"{estimate.condition.discharge_pressure / 1e6:.4g} MPa",
                estimate.severity.text,
                estimate.severity.verdict,
                None if limit is None else estimate.severity.dimension.format_value(limit),
                ", ".join(further_dimensions),
            )
        )
    dimension_name = trend.estimates[0].severity.dimension.name
    header = (
        "recording",
        "recorded",
        "pressure",
        f"{dimension_name} (90 % interval)",
        "verdict",
        "detection limit",
        "further dimensions",
    )
    print_table(f"Severity of {type(trend.reference).__name__} by inversion", header, rows)

    for text in trend.notes:
        print_note(f"note: {text}")
    for estimate in trend.estimates:
        for text in estimate.notes:
            print_note(f"note: {estimate.recording_id}: {text}")
    print_merged_notes(trend.excluded_recordings, "excluded")
    count = plural(len(trend.estimates), "recording")
    print_text(f"{count}, compared with {n_healthy} healthy ones")
