"""Commands of the group twin that use a twin or a pump file: severity, next, pump show and pump
new.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict
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
from swashtwin.foundation import parse_quantity, plural

if TYPE_CHECKING:
    from swashtwin.calibration import RecordingPlan, SeverityTrend
    from swashtwin.pump import Pump
    from swashtwin.recordings import Recording


def plan_next(
    calibration: CalibrationFile,
    speeds: Annotated[
        str | None,
        typer.Option(
            help='Speeds that can be run: "600 rpm, 1200 rpm"; by default 2/3, 1 and 3/2 of the mean, as rated.'
        ),
    ] = None,
    pressures: Annotated[
        str | None,
        typer.Option(
            help='Absolute discharge pressures that can be run: "5 MPa, 15 MPa"; by default as the speeds.'
        ),
    ] = None,
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            help='Sensors of the pump file that record together: "cover_z, body_y"; repeatable, once for each set. By '
            "default those calibrated on."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """What to record next: which operating point and sensors narrow the calibrated values'
    intervals most.

    Each combination counts as one further recording as long as those before and in the same state,
    healthy where the calibration is. Name what your machine can run.
    """
    from swashtwin.calibration import load_calibration, plan_recording

    speed = [parse_quantity(part, "rad/s", name="--speeds") for part in split_names(speeds)]
    pressure = [parse_quantity(part, "Pa", name="--pressures") for part in split_names(pressures)]
    sets = [split_names(text) for text in sensors or ()]
    calibrated = load_calibration(calibration)
    with progress("expected widths"):
        plan = plan_recording(
            calibrated, speeds=speed or None, pressures=pressure or None, sensors=sets or None
        )
    print_result({"calibration": calibration, **asdict(plan)}, as_json, lambda: _show_plan(plan))


_SHOWN = 10
"""Candidates that are printed; --json has all."""


def _show_plan(plan: "RecordingPlan") -> None:
    rows = []
    for item in plan.candidates[:_SHOWN]:
        letter, factor = max(item.narrowing_factors.items(), key=lambda pair: pair[1])
        gain = 1 - item.total_width / plan.total_width
        rows.append(
            (
                f"{item.speed * 30 / math.pi:.0f} rpm",
                f"{item.discharge_pressure / 1e6:.3g} MPa",
                f"{item.duration:.3g} s",
                ", ".join(item.channels),
                f"{item.total_width:.2f}",
                f"{gain:.1%}" if gain > 0 else "none",
                f"{letter}, {factor:.2g} times" if factor > 1 else "-",
            )
        )
    header = ("speed", "pressure", "length", "sensors", "width after", "narrower by", "most")
    print_table(
        f"What to record next; total ln width of the six intervals now {plan.total_width:.2f}",
        header,
        rows,
    )
    if plan.candidates[-1].total_width >= plan.total_width:
        print_text(
            "none: the twin errs there by more than a further recording can tell, so the intervals are no narrower."
        )
    more = len(plan.candidates) - len(rows)
    if more > 0:
        print_text(f"{more} more, which narrow less: --json")


def new_pump(
    name: Annotated[str, typer.Argument(help="Name of the new pump.")],
    original: Annotated[
        str, typer.Option("--pump", help="Pump to copy or to scale, by name or .toml file.")
    ] = ("25scy14-1b"),
    displacement: Annotated[
        str | None,
        typer.Option(
            help='Nameplate: volume per revolution, such as "45 cm3/rev"; scales the pump.'
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
            help='Discharge pressure that the port timing is made for, such as "280 bar".'
        ),
    ] = None,
    mass: Annotated[
        str | None,
        typer.Option(help='Mass without oil, such as "21 kg"; that of catalogs by default.'),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder where NAME.toml is written.", callback=require_folder)
    ] = Path(),
    as_json: Json = False,
) -> None:
    """Write a pump file for you to edit: scaled from a nameplate, or a commented copy.

    Each number's source says whether it is the nameplate's, scaled, or a guess.
    """
    import swashtwin.pump as pump

    plate = None
    if (
        displacement is not None
        and pistons is not None
        and speed is not None
        and pressure is not None
    ):
        plate = pump.read_nameplate(
            displacement=displacement, pistons=pistons, speed=speed, pressure=pressure, mass=mass
        )
    elif stated := without_none(
        displacement=displacement, pistons=pistons, speed=speed, pressure=pressure, mass=mass
    ):
        missing = [
            name for name in ("displacement", "pistons", "speed", "pressure") if name not in stated
        ]
        reason = f"a nameplate needs {', '.join(f'--{name}' for name in missing)} too."
        raise typer.BadParameter(reason, param_hint=f"--{next(iter(stated))}")
    path = pump.new_pump(name.removesuffix(".toml"), like=original, nameplate=plate, folder=out)
    next_step = f"{path}\nEdit it, then: swashtwin twin pump show {path} --effects. A twin is no better than its numbers."
    print_result({"pump": path}, as_json, lambda: print_text(next_step))


def _effects(pump: "Pump") -> list[dict[str, Any]]:
    """Effect of each number on the healthy pump's lines at its rated point, the largest first, and
    its origin.
    """
    from swashtwin.foundation import InputError
    from swashtwin.physics import Twin, sensitivities
    from swashtwin.pump import OperatingCondition

    if pump.rated is None:
        raise InputError(
            f"{pump.name} states no [rated] speed and discharge_pressure; add them to its file."
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


def show_pump(
    name: Annotated[str, typer.Argument(help="Name of a pump, or its .toml file.")] = "25scy14-1b",
    effects: Annotated[
        bool,
        typer.Option(
            "--effects",
            help="Show how much the vibration depends on each number, the largest first.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Every number of a pump in the units of the trade, with its source; with --json in SI
    units.
    """
    from swashtwin.pump import available_pumps, load_pump, pump_numbers

    pump = load_pump(name)
    numbers = list(pump_numbers(pump))
    derived = list(_derived(pump))
    result: dict[str, Any] = {
        "name": pump.name,
        "parameters": [
            {"name": path, "value": value, "unit": unit, "source": pump.sources.get(path, "")}
            for path, value, unit in numbers
        ],
        "channels": pump.channels,
        "available": available_pumps(),
        "derived": [
            {"name": words, "value": value, "unit": unit} for words, value, unit in derived
        ],
    }
    if effects:
        result["effects"] = _effects(pump)

    def show() -> None:
        rows = [
            (path, _in_trade_units(value, unit), pump.sources.get(path, ""))
            for path, value, unit in numbers
        ]
        print_table(pump.name, ("parameter", "value", "source"), rows)
        print_table(
            "What follows",
            ("", "value"),
            [(words, _in_trade_units(value, unit)) for words, value, unit in derived],
        )
        if effects:
            lines = [
                (item["name"], item["step"], f"{item['effect']:.2%}", item["source"])
                for item in result["effects"]
            ]
            header = ("parameter", "changed by", "line amplitudes change by", "source")
            print_table(
                "What the vibration of the healthy pump depends on at its rated point",
                header,
                lines,
            )

    print_result(result, as_json, show)


def _derived(pump: "Pump") -> Iterator[tuple[str, float, str]]:
    """(what, value, SI unit) of what follows from a pump's numbers."""
    from swashtwin.pump import stroke_of

    group = pump.rotating_group
    yield "displacement per revolution", group.displacement, "m^3"
    yield "stroke of a piston", stroke_of(group), "m"
    yield "diameter of the pitch circle", 2 * group.pitch_radius, "m"
    if pump.rated is not None:
        turns = pump.rated.speed / (2 * math.pi)
        at = f"at {_in_trade_units(pump.rated.speed, 'rad/s')}"
        yield f"piston-pass frequency {at}", group.piston_count * turns, "Hz"
        yield f"theoretical flow {at}", group.displacement * turns, "m^3/s"


def _in_trade_units(value: Any, unit: str) -> str:
    from swashtwin.pump import format_quantity

    return ", ".join(
        format_quantity(number, unit, 5)
        for number in (value if isinstance(value, tuple) else (value,))
    )


def severity(
    calibration: Annotated[
        Path, typer.Argument(help="Calibration of this pump on its healthy recordings.")
    ],
    source: Index,
    fault: Annotated[
        str,
        typer.Option(
            metavar="KIND[:NAME=QUANTITY,...]",
            help="Kind of fault; a dimension that is given is a fixed one.",
        ),
    ],
    healthy: Annotated[
        Path | None,
        typer.Option(
            help="Index of further healthy recordings; those of INDEX that are labeled normal always count.",
            callback=require_index,
        ),
    ] = None,
    specimen: Specimen = None,
    as_json: Json = False,
) -> None:
    """Estimate how severe a fault is in each recording of a pump, in mm or um, with an interval:
    for a pump's trend.

    The severity (a depth, a clearance) is always searched; one that is given is where the search
    starts. Of the further dimensions the usual ones are searched unless they are given. Calibrate
    with --band "0-1 kHz", the band in which severities are searched, and with phases, the default.
    """
    from swashtwin.calibration import estimate_severity, get_severity_search, load_calibration
    from swashtwin.foundation import DataError
    from swashtwin.pump import is_healthy, read_fault
    from swashtwin.recordings import build_manifest, find_copies, load_recordings

    kind, fixed = fault_dimensions(fault)
    defect = read_fault(kind, **fixed)
    if defect is None:
        raise typer.BadParameter(
            "a normal pump has no severity; name a fault, such as swash_plate.",
            param_hint="--fault",
        )
    healthy_calibration = load_calibration(calibration)
    recordings = load_recordings(source, specimen=specimen)
    calibrated = find_copies(healthy_calibration.recording_hashes, build_manifest(recordings))
    names, whose = healthy_calibration.recording_ids, (None, specimen)
    others = [
        item
        for item in load_recordings(source)
        if item.recording_id in names and item.specimen not in whose
    ]
    if specimen is not None and find_copies(
        healthy_calibration.recording_hashes, build_manifest(others)
    ):
        print_note(
            f"note: {calibration} is of machine {others[0].specimen}, these are of {specimen}: calibrate {specimen}."
        )
    sound: list[Recording] = []
    worn: list[Recording] = []
    for recording in recordings:  # healthy is what is labeled so or was calibrated on
        is_sound = is_healthy(recording.label) or recording.recording_id in calibrated
        (sound if is_sound else worn).append(recording)
    if not worn:
        raise DataError(
            f"{source} holds healthy recordings only ({len(sound)} labeled normal, or calibrated); give some that may "
            f"be worn, labeled {defect.label} or not at all."
        )
    if healthy is not None:
        ids = {recording.recording_id for recording in sound}
        further = load_recordings(healthy, specimen=specimen)
        sound += [
            item for item in further if is_healthy(item.label) and item.recording_id not in ids
        ]
    usual = [name for name in get_severity_search(defect).free if name not in fixed]
    with progress("searching severities"):
        trend = estimate_severity(healthy_calibration, worn, defect, healthy=sound, free=usual)
    result = {**trend.to_dict(), "healthy": [recording.recording_id for recording in sound]}
    print_result(result, as_json, lambda: _show_severity(trend, len(sound)))


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
                ", ".join(
                    f"{item.dimension.name} {item.words}, {item.verdict}"
                    for item in estimate.dimensions[1:]
                ),
            )
        )
    name = trend.estimates[0].severity.dimension.name
    header = (
        "recording",
        "at",
        f"{name} (90 % interval)",
        "verdict",
        "detection limit",
        "further dimensions",
    )
    print_table(f"Severity of {type(trend.reference).__name__} by inversion", header, rows)
    notes = [
        f"{estimate.recording_id}: {text}"
        for estimate in trend.estimates
        for text in estimate.notes
    ]
    for text in (*trend.notes, *notes):
        print_note(f"note: {text}")
    print_merged_notes(trend.excluded_recordings, "left out")
    print_text(f"{plural(len(trend.estimates), 'recording')}, against {healthy} healthy ones")
