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
    ReadingOptions,
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

# Keys of a saved calibration that the command prints; the others describe its twin.
_RESULT_KEYS = (
    "method",
    "settings",
    "estimates",
    "nominal_agreement",
    "calibrated_agreement",
    "recording_ids",
    "recording_hashes",
    "law",
    "excluded_recordings",
    "notes",
)


class Method(StrEnum):
    """Methods that search the six interface values."""

    gauss_newton = "gauss-newton"
    ipinn = "ipinn"


@reads_files
def calibrate(
    source: Source,
    reading_options: ReadingOptions,
    pump: PumpName = "25scy14-1b",
    fault: FaultText = "normal",
    speed: Annotated[
        str | None, typer.Option(help='Use only recordings at this shaft speed, such as "860 rpm".')
    ] = None,
    pressure: Annotated[
        list[str] | None,
        typer.Option(
            help='Use only recordings at this absolute discharge pressure, such as "15 MPa". '
            "Repeatable."
        ),
    ] = None,
    specimen: Specimen = None,
    method: Annotated[
        Method | None,
        typer.Option(help="Search method. Default: gauss-newton. The paper's is ipinn."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Setting of the method (starts=8), or: nuisances=none, typical, housing or "
            "by-axis (further unknown constants that are estimated), phases=false, lines=shaft or "
            "spectrum, solver=rk4, bounds=10 (factor around the nominal values). Repeatable.",
        ),
    ] = None,
    law: Annotated[
        str | None,
        typer.Option(
            metavar="KIND[:NAME=QUANTITY,...]",
            help="Recess whose contact law is estimated too, from the recordings of its class: "
            "swash_plate:depth=0.07mm.",
        ),
    ] = None,
    preset: PresetName = Preset.recommended,
    band: Annotated[
        str | None, typer.Option(help='Frequency band whose lines are compared: "0-1 kHz".')
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="Calibration file to write, .json, and NAME-interfaces.toml beside it."),
    ] = Path("calibration.json"),
    report: Report = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Estimate a twin's six interface values from recordings, with their uncertainty.

    Speed and pressure are taken from the recordings. Several operating points are fitted together
    with one set of values. Calibration is training: the recordings used must not test a classifier
    later (swashtwin data split).
    """
    import swashtwin.calibration as calibration
    from swashtwin import presets
    from swashtwin.pump import load_pump

    interfaces_file = out.with_name(f"{out.stem}-interfaces.toml")
    inputs = [source, Path(pump)]
    require_output(out, suffixes=[".json"], inputs=inputs, force=force)
    require_output(interfaces_file, inputs=inputs, force=force)
    require_page(report, inputs=inputs, force=force)

    # Options overrule the recipe of the preset.
    recipe = dict((presets.paper if preset is Preset.paper else presets.recommended).calibration)
    calibrators = {Method.gauss_newton: calibration.GaussNewton, Method.ipinn: calibration.IPINN}
    if method is None:
        calibrator = type(recipe.pop("method", calibration.GaussNewton()))
    else:
        calibrator = calibrators[method]
    method_name = next(name for name, kind in calibrators.items() if kind is calibrator)
    general_settings, method_settings = _read_settings(
        settings, defaults_of(calibrator()), f"--method {method_name.value}"
    )
    recipe |= general_settings
    if band is not None:
        recipe["band"] = band_from(band)

    drawing = load_pump(pump)
    defect = fault_from(fault)
    label = "normal" if defect is None else defect.label
    if law is not None and not is_collection(source, reading_options):
        raise typer.BadParameter(
            "requires an index with healthy recordings and recordings of the fault.",
            param_hint="--law",
        )
    pressures = pressure or []
    candidates = _load_recordings(
        source,
        reading_options,
        speed,
        pressures,
        assumed_label=label,
        selected_label=label if law is None else None,
        specimen=specimen,
    )
    start, recordings = _select_start(drawing, defect, candidates, speed, pressures)

    with progress("calibrating") as bar:
        result = calibration.calibrate(
            start,
            recordings,
            # A start of twins already has the fault.
            fault=defect if start is drawing else None,
            law=None if law is None else fault_from(law),
            method=calibrator(**method_settings),
            seed=seed,
            progress=lambda count, total, loss: bar(count, total, f"calibrating, loss {loss:.4g}"),
            **recipe,
        )

    used = [recording for recording in recordings if recording.recording_id in result.recording_ids]
    page = write_page(report, result, recordings=used, about={"Calibration": out})
    result.save(out)
    result.save_interfaces(interfaces_file)
    saved = result.to_dict()
    answer = {
        "calibration": out,
        "interfaces": interfaces_file,
        **{key: saved[key] for key in _RESULT_KEYS},
        "doubt": result.doubt,
        "simulations": result.simulations,
        "wall_s": result.wall_s,
        "report": page,
    }
    print_result(answer, as_json, lambda: _print_calibration(result, out, page))


def _load_recordings(
    source: Path,
    reading_options: ReadingOptions,
    speed: str | None,
    pressures: Sequence[str],
    *,
    assumed_label: str,
    selected_label: str | None,
    specimen: str | None,
) -> "Recordings":
    """Return the recordings of an index, or of a single file.

    Parameters
    ----------
    speed, pressures : operating point of a single file.
    assumed_label : class of a single file that has none.
    selected_label : class that is selected from an index; all classes by default.
    """
    from swashtwin.recordings import Recordings, load_recordings

    if is_collection(source, reading_options):
        return load_recordings(source, label=selected_label, specimen=specimen)

    if speed is not None and pressures:
        if len(pressures) > 1:
            raise typer.BadParameter(
                f"allows one pressure, because {source} is one recording.",
                param_hint="--pressure",
            )
        reading_options = {**reading_options, "speed": speed, "pressure": pressures[0]}
    (recording,) = load_sources([source], **reading_options)
    if recording.label is None:
        print_note(
            f"note: {source} is taken as a recording of the class {assumed_label}. Specify another "
            "class with --fault."
        )
        recording = recording.replace(label=assumed_label)
    return Recordings([recording])


def _select_start(
    pump: "Pump",
    fault: "Fault | None",
    recordings: "Recordings",
    speed: str | None,
    pressures: Sequence[str],
) -> "tuple[Pump | Sequence[Twin], Sequence[Recording]]":
    """Return where the search starts, and the recordings to fit.

    If speed and pressures are both given, the start is a twin at each operating point, so that no
    recording has to specify its own. Otherwise it is the pump, and the recordings are those at the
    given speed or pressures.
    """
    from swashtwin.physics import Twin
    from swashtwin.pump import read_condition

    if speed is not None and pressures:
        conditions = [read_condition(speed=speed, discharge_pressure=text) for text in pressures]
        return [Twin(pump, condition, fault) for condition in conditions], recordings

    if speed is not None:
        recordings = recordings.where(speed=parse_quantity(speed, "rad/s", name="--speed"))
    if not pressures:
        return pump, recordings

    # A recording may match two pressures that lie within their tolerance: it counts once.
    selected: dict[str, Recording] = {}
    for text in pressures:
        pressure = parse_quantity(text, "Pa", name="--pressure")
        for recording in recordings.where(pressure=pressure):
            selected[recording.recording_id] = recording
    return pump, list(selected.values())


def _read_settings(
    texts: Sequence[str] | None, method_defaults: dict[str, Any], owner: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the settings of `calibrate`, and those of its method."""
    from swashtwin.calibration import Nuisances
    from swashtwin.physics import RK4

    # Settings that are typed as a word; the first word is the default.
    values_by_word: dict[str, dict[str, Any]] = {
        "lines": {name: name for name in ("piston", "shaft", "spectrum")},
        "nuisances": {
            "none": Nuisances(),
            "typical": Nuisances.typical(),
            "housing": Nuisances.housing(),
            "by-axis": Nuisances.by_axis(),
        },
        "solver": {"harmonic-balance": None, "rk4": RK4()},
    }
    defaults: dict[str, Any] = {"bounds": 10.0, "phases": True}
    for name, values in values_by_word.items():
        defaults[name] = next(iter(values))

    settings = read_settings(texts, {**defaults, **method_defaults}, owner)
    for name, values in values_by_word.items():
        if name not in settings:
            continue
        word = settings[name]
        if word not in values:
            raise typer.BadParameter(
                f"{name}={word} must be one of {', '.join(values)}.", param_hint="--set"
            )
        settings[name] = values[word]

    general_names = ("lines", "nuisances", "phases", "bounds")
    general_settings = {name: settings.pop(name) for name in general_names if name in settings}
    return general_settings, without_none(**settings)


def _format_interval(estimate: "Estimate") -> str:
    """Return the interval of an estimate as text, without an end that only the bound sets."""
    low, high = (f"{end:.3g}" for end in estimate.interval)
    open_below, open_above = estimate.open_sides
    if open_below and open_above:
        return "unlimited"
    if open_below:
        return f"at most {high}"
    if open_above:
        return f"at least {low}"
    return f"{low} ... {high}"


def _print_calibration(result: "Calibration", out: Path, page: Path | None) -> None:
    from swashtwin.calibration import AGREEMENT_LABELS

    law_estimates = () if result.law is None else result.law.estimates
    rows = [
        (
            estimate.symbol,
            estimate.name,
            estimate.nominal,
            estimate.value,
            _format_interval(estimate),
            estimate.unit,
            estimate.verdict,
        )
        for estimate in (*result.estimates, *law_estimates)
    ]
    print_table(
        f"{result.method} on {plural(len(result.recording_ids), 'recording')}",
        ("", "parameter", "nominal", "calibrated", "90 % interval", "unit", "verdict"),
        rows,
    )

    if result.law is not None:
        by_evidence = sorted(result.law.evidence.items(), key=lambda pair: -pair[1])
        print_table(
            "Contact laws of the recess",
            ("contact, entry", "ln evidence"),
            [(name, f"{evidence:.1f}") for name, evidence in by_evidence],
        )

    nominal = asdict(result.nominal_agreement)
    calibrated = asdict(result.calibrated_agreement)
    lines = plural(result.n_lines, "line")
    unknowns = plural(result.n_unknowns, "unknown")
    print_table(
        f"Agreement with these recordings, which is no test: {unknowns} fitted to {lines} "
        "(errors: 0 is best; correlation: 1 is best)",
        ("score", "nominal", "calibrated"),
        [(label, nominal[name], calibrated[name]) for name, label in AGREEMENT_LABELS.items()],
    )
    for text in result.notes:
        print_note(f"note: {text}")
    if result.doubt:
        print_note(f"note: {result.doubt}")
    print_text(str(out))
    if page is not None:
        print_text(str(page))
