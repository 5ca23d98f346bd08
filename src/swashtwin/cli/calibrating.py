"""The command that fits a twin to recordings: calibrate."""

from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import print_note, print_result, print_table, print_text, progress
from swashtwin.cli.options import (
    FaultText,
    Json,
    Preset,
    PresetName,
    PumpName,
    Reading,
    Seed,
    Source,
    Specimen,
    band_from,
    defaults_of,
    fault_from,
    read_settings,
    reads_files,
    without_none,
)
from swashtwin.cli.outputs import Force, Report, require_output, require_page, write_page
from swashtwin.cli.sources import is_collection, load_sources
from swashtwin.foundation import parse_quantity, plural

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration, Estimate
    from swashtwin.physics import Twin
    from swashtwin.pump import Fault, Pump
    from swashtwin.recordings import Recording, Recordings


class Method(StrEnum):
    """How the six interface values are searched."""

    gauss_newton = "gauss-newton"
    ipinn = "ipinn"


@reads_files
def calibrate(
    source: Source,
    reading: Reading,
    pump: PumpName = "25scy14-1b",
    fault: FaultText = "normal",
    speed: Annotated[
        str | None, typer.Option(help='Use recordings at this shaft speed only, such as "860 rpm".')
    ] = None,
    pressure: Annotated[
        list[str] | None,
        typer.Option(
            help='Use recordings at this absolute discharge pressure only, such as "15 MPa"; repeatable.'
        ),
    ] = None,
    specimen: Specimen = None,
    method: Annotated[
        Method | None,
        typer.Option(
            help="How the values are searched; gauss-newton by default, the paper's is ipinn."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="A setting of the method (starts=8), or: nuisances=none, typical, housing or by-axis (unmeasured "
            "constants that are searched as well), phases=false, lines=shaft or spectrum, solver=rk4, bounds=10 "
            "(a factor of the nominal values); repeatable.",
        ),
    ] = None,
    law: Annotated[
        str | None,
        typer.Option(
            metavar="KIND[:NAME=QUANTITY,...]",
            help="Recess whose law is searched too, on the recordings of its class: swash_plate:depth=0.07mm.",
        ),
    ] = None,
    preset: PresetName = Preset.recommended,
    band: Annotated[
        str | None, typer.Option(help='Frequencies whose lines are compared: "0-1 kHz".')
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="File to write, .json; the values go beside it as NAME-interfaces.toml."),
    ] = Path("calibration.json"),
    report: Report = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find a twin's six interface values from recordings, and how uncertain they are.

    Speed and pressure are those that the recordings state; several operating points are fitted
    together, with one set of values. Calibrating is training: the recordings used must not test a
    classifier later (swashtwin data split).
    """
    import swashtwin.calibration as calibration
    from swashtwin import presets
    from swashtwin.pump import load_pump

    values_file, read = out.with_name(f"{out.stem}-interfaces.toml"), [source, Path(pump)]
    require_output(
        out,
        suffixes=[".json"],
        inputs=read,
        marks=['"format": "swashtwin calibration'],
        force=force,
    )
    require_output(values_file, inputs=read, marks=["calibrated with"], force=force)
    require_page(report, inputs=read, force=force)
    recipe = dict((presets.paper if preset is Preset.paper else presets.recommended).calibration)
    kinds = {Method.gauss_newton: calibration.GaussNewton, Method.ipinn: calibration.IPINN}
    kind = (
        type(recipe.pop("method", calibration.GaussNewton())) if method is None else kinds[method]
    )
    name = next(name for name in kinds if kinds[name] is kind)
    arguments, own = _settings(settings, defaults_of(kind()), f"--method {name.value}")
    recipe |= arguments if band is None else {**arguments, "band": band_from(band)}
    drawing, defect = load_pump(pump), fault_from(fault)
    label = "normal" if defect is None else defect.label
    if law is not None and not is_collection(source, reading):
        raise typer.BadParameter(
            "takes an index of healthy recordings and of the fault's.", param_hint="--law"
        )
    there = _recordings(
        source, reading, speed, pressure or [], label, specimen, label if law is None else None
    )
    start, recordings = _start(drawing, defect, there, speed, pressure or [])
    with progress("calibrating") as bar:
        result = calibration.calibrate(
            start,
            recordings,
            fault=defect if start is drawing else None,
            law=None if law is None else fault_from(law),
            method=kind(**own),
            seed=seed,
            progress=lambda count, total, loss: bar(count, total, f"calibrating, loss {loss:.4g}"),
            **recipe,
        )
    page = None
    if report is not None:
        used = [
            recording for recording in recordings if recording.recording_id in result.recording_ids
        ]
        page = write_page(report, result, recordings=used, about={"Calibration": out})
    result.save(out)
    values = result.save_interfaces(values_file)
    shown = (
        "method",
        "settings",
        "estimates",
        "nominal_agreement",
        "calibrated_agreement",
        "recording_ids",
        "recording_hashes",
        "law",
    )
    facts = result.to_dict()
    answer = {
        "calibration": out,
        "interfaces": values,
        **{name: facts[name] for name in (*shown, "excluded_recordings", "notes")},
    }
    answer |= {"simulations": result.simulations, "wall_s": result.wall_s, "report": page}
    print_result(answer, as_json, lambda: _show(result, out, page))


def _recordings(
    source: Path,
    reading: Reading,
    speed: str | None,
    pressures: Sequence[str],
    label: str,
    specimen: str | None,
    wanted: str | None,
) -> "Recordings":
    """Recordings of an index, of one class where one is `wanted`, or that of a file; what it does
    not state of class and operating point, options do.
    """
    from swashtwin.recordings import Recordings, load_recordings

    if is_collection(source, reading):
        return load_recordings(source, label=wanted, specimen=specimen)
    if speed is not None and pressures:
        if len(pressures) > 1:
            raise typer.BadParameter(
                f"{source} is one recording, at one pressure.", param_hint="--pressure"
            )
        reading = {**reading, "speed": speed, "pressure": pressures[0]}
    (recording,) = load_sources([source], **reading)
    if recording.label is None:
        print_note(
            f"note: {source} is taken as a recording of a pump that is {label}; --fault names another class."
        )
        recording = recording.replace(label=label)
    return Recordings([recording])


def _start(
    pump: "Pump",
    fault: "Fault | None",
    recordings: "Recordings",
    speed: str | None,
    pressures: Sequence[str],
) -> "tuple[Pump | Sequence[Twin], Sequence[Recording]]":
    """Where the search starts, and the recordings: twins at the points that are named wholly, so
    that no recording has to state one, or the pump, with the recordings at a speed or pressures
    that are named alone.
    """
    from swashtwin.physics import Twin
    from swashtwin.pump import read_condition

    if speed is not None and pressures:
        points = [read_condition(speed=speed, discharge_pressure=text) for text in pressures]
        return [Twin(pump, point, fault) for point in points], recordings
    chosen: Sequence[Recording] = recordings
    if speed is not None:
        chosen = recordings = recordings.where(speed=parse_quantity(speed, "rad/s", name="--speed"))
    if pressures:
        limits = [parse_quantity(text, "Pa", name="--pressure") for text in pressures]
        by_id = {
            item.recording_id: item for limit in limits for item in recordings.where(pressure=limit)
        }
        chosen = list(by_id.values())
    return pump, chosen


def _settings(
    texts: Sequence[str] | None, defaults: dict[str, Any], owner: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    from swashtwin.calibration import Nuisances
    from swashtwin.physics import RK4

    words: dict[str, dict[str, Any]] = {
        "lines": {name: name for name in ("piston", "shaft", "spectrum")},
        "nuisances": {
            "none": Nuisances(), "typical": Nuisances.typical(), "housing": Nuisances.housing(),
            "by-axis": Nuisances.by_axis(),
        },
        "solver": {"harmonic-balance": None, "rk4": RK4()},
    }  # fmt: skip
    usual = {
        "bounds": 10.0,
        "phases": True,
        **{name: next(iter(options)) for name, options in words.items()},
    }
    chosen = read_settings(texts, {**usual, **defaults}, owner)
    for name in words.keys() & chosen.keys():
        if chosen[name] not in words[name]:
            reason = f"{name}={chosen[name]} must be {', '.join(words[name])}."
            raise typer.BadParameter(reason, param_hint="--set")
        chosen[name] = words[name][chosen[name]]
    own = ("lines", "nuisances", "phases", "bounds")
    arguments: dict[str, Any] = {name: chosen.pop(name) for name in own if name in chosen}
    return arguments, without_none(**chosen)


def _interval(estimate: "Estimate") -> str:
    """The interval in words; an end that only the bound sets is left out."""
    low, high = (f"{end:.3g}" for end in estimate.interval)
    open_below, open_above = estimate.open_sides
    if open_below and open_above:
        return "no limits"
    return (
        f"at most {high}"
        if open_below
        else f"at least {low}"
        if open_above
        else f"{low} ... {high}"
    )


def _show(result: "Calibration", out: Path, page: Path | None) -> None:
    law = () if result.law is None else result.law.estimates
    rows = [
        (estimate.symbol, estimate.name, estimate.nominal, estimate.value, _interval(estimate), estimate.unit,
         estimate.verdict)
        for estimate in (*result.estimates, *law)
    ]  # fmt: skip
    header = ("", "parameter", "nominal", "calibrated", "90 % interval", "unit", "verdict")
    print_table(
        f"{result.method} on {plural(len(result.recording_ids), 'recording')}", header, rows
    )
    if result.law is not None:
        laws = sorted(result.law.evidence.items(), key=lambda item: -item[1])
        print_table(
            "Laws of the recess",
            ("contact, entry", "ln evidence"),
            [(name, f"{value:.1f}") for name, value in laws],
        )
    before, after = asdict(result.nominal_agreement), asdict(result.calibrated_agreement)
    fits = [(name, before[name], after[name]) for name in before]
    print_table("Against the measurement", ("figure", "nominal", "calibrated"), fits)
    for text in result.notes:
        print_note(f"note: {text}")
    print_text(str(out) if page is None else f"{out}\n{page}")
