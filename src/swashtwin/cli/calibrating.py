"""The command that fits a twin to recordings: calibrate."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.exits import require_target, resumable
from swashtwin.cli.operating_points import OperatingPoints, OptionalTemperature, Pressures, Speeds
from swashtwin.cli.options import (
    CalibrationFactor,
    Channels,
    FaultText,
    Json,
    Preset,
    PresetName,
    PumpName,
    SampleRate,
    Seed,
    Settings,
    Solver,
    SolverName,
    Source,
    Specimen,
    Unit,
    band_from,
    defaults_of,
    fault_from,
    present,
    read_list,
    read_pairs,
    read_settings,
    solver_from,
)
from swashtwin.cli.pages import Report, write_page
from swashtwin.cli.sources import is_collection, load_sources
from swashtwin.foundation import parse, plural

if TYPE_CHECKING:
    from swashtwin.calibration import (
        Calibration,
        Calibrator,
        Estimate,
        Nuisances,
    )
    from swashtwin.physics import SteadySolver, Twin
    from swashtwin.pump import Pump
    from swashtwin.recordings import Recording, Recordings


class Method(StrEnum):
    """How the six interface values are searched."""

    gauss_newton = "gauss-newton"
    ipinn = "ipinn"


class LineSet(StrEnum):
    """Which lines are compared."""

    piston = "piston"
    shaft = "shaft"


class Freed(StrEnum):
    """Which constants are searched beside the six values."""

    none = "none"
    usual = "usual"
    housing = "housing"
    by_axis = "by-axis"


FreedName = Annotated[
    Freed | None,
    typer.Option(
        "--nuisances",
        help="Unmeasured constants, searched as well: usual (mounting, bearings, excitation, sensors), housing (those, "
        "each channel's gain, and two modes of the housing), by-axis (those, each direction of the mounting, each "
        "bearing, and cross-talk), or none (the paper's).",
    ),
]
Bounds = Annotated[
    list[str] | None,
    typer.Option(
        help="Search each value within this factor of the nominal, such as 10, or one between limits, by letter or "
        'parameter: "C_sw=1e4..1e8 N*s/m"; repeatable, or with commas. Bounds that nobody states widen by themselves.'
    ),
]


def calibrate(
    source: Source,
    pump: PumpName = "25scy14-1b",
    fault: FaultText = "normal",
    speed: Speeds = None,
    pressure: Pressures = None,
    temperature: OptionalTemperature = None,
    specimen: Specimen = None,
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    method: Annotated[
        Method | None, typer.Option(help="How the values are searched; gauss-newton by default, the paper's is ipinn.")
    ] = None,
    settings: Settings = None,
    preset: PresetName = Preset.recommended,
    band: Annotated[str | None, typer.Option(help='Frequencies whose lines are compared: "0-1 kHz".')] = None,
    lines: Annotated[
        LineSet, typer.Option(help="piston-pass lines, or all shaft orders where one piston differs.")
    ] = LineSet.piston,
    phases: Annotated[
        bool | None,
        typer.Option("--phases/--no-phases", help="Compare the lines' phases too; the default, but not the paper's."),
    ] = None,
    nuisances: FreedName = None,
    solver: SolverName = Solver.harmonic_balance,
    bounds: Bounds = None,
    out: Annotated[
        Path, typer.Option(help="File to write, .json; the values go beside it as NAME-interfaces.toml.")
    ] = Path("calibration.json"),
    report: Report = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Find a twin's six interface values from recordings, and how uncertain they are.

    Speed and pressure are those that the recordings state; several operating points are fitted together, with one set
    of values. Calibrating is training: the recordings used must not test a classifier later (swashtwin data split).
    """
    from swashtwin import presets
    from swashtwin.calibration import GaussNewton
    from swashtwin.pump import load_pump

    require_target(out, ".json")
    recipe = dict((presets.paper if preset is Preset.paper else presets.recommended).calibration)
    usual = recipe.pop("method", GaussNewton())
    method = method or next(name for name, kind in _kinds().items() if kind() == usual)
    searcher = _method(method, settings, solver_from(solver))
    edges = None if band is None else band_from(band)
    points = OperatingPoints(speed, pressure or [], temperature)
    drawing, defect = load_pump(pump), fault_from(fault)
    facts = present(
        sample_rate=sample_rate,
        unit=unit,
        calibration_factor=calibration_factor,
        channels=channels,
    )
    label = "normal" if defect is None else defect.label
    recordings = points.select(_recordings(source, facts, points, label).where(specimen=specimen))
    job = _Job(
        start=points.twins(drawing, defect),
        recordings=recordings,
        options={
            "fault": None if points.is_complete else defect,
            "bounds": bounds_from(bounds),
            "band": edges,
            "lines": lines.value,
            **recipe,
            **present(phases=phases, nuisances=nuisances and nuisances_from(nuisances)),
        },
        seed=seed,
        out=out,
    )
    result = job.search(searcher)
    page = None if report is None else job.write_page(result, report)
    result.save(out)
    values = result.save_interfaces(out.with_name(f"{out.stem}-interfaces.toml"))
    shown = ("method", "settings", "estimates", "fit_before", "fit_after", "recording_ids", "recording_hashes")
    facts = result.to_dict()
    answer = {"calibration": out, "interfaces": values, **{name: facts[name] for name in (*shown, "left_out", "notes")}}
    answer |= {"simulations": result.simulations, "wall_s": result.wall_s, "report": page}
    tell(answer, as_json, lambda: _show(result, out))


def _recordings(source: Path, facts: dict[str, Any], points: OperatingPoints, label: str) -> "Recordings":
    """Recordings of an index, or that of a file; what it does not state of class and operating point, options do."""
    from swashtwin.recordings import Recordings, load_recordings

    if is_collection(source, facts):
        return load_recordings(source)
    (recording,) = load_sources([source], **facts)
    if recording.condition is None and points.is_complete:
        if len(points.pressures) > 1:
            raise typer.BadParameter(f"{source} is one recording, at one pressure.", param_hint="--pressure")
        stated = {"speed": points.speed, "discharge_pressure": points.pressures[0]}
        (recording,) = load_sources([source], **stated, **facts)
    if recording.label is None:
        note(f"note: {source} is taken as a recording of a pump that is {label}; --fault names another class.")
        recording = recording.relabeled(label)
    return Recordings([recording])


@dataclass(frozen=True)
class _Job:
    """A calibration."""

    start: "Pump | Sequence[Twin]"
    recordings: Sequence["Recording"]
    options: Mapping[str, Any]
    seed: int
    out: Path

    def search(self, method: "Calibrator") -> "Calibration":
        """Calibration by `method`."""
        from swashtwin.calibration import calibrate

        with resumable("the same command again ends at the same result"), progress("calibrating") as bar:
            return calibrate(
                self.start,
                self.recordings,
                method=method,
                seed=self.seed,
                progress=lambda count, total, loss: bar(count, total, f"calibrating, loss {loss:.4g}"),
                **self.options,
            )

    def write_page(self, result: "Calibration", target: Path) -> Path | None:
        """Page of the calibration and of what the recordings can determine."""
        from swashtwin.calibration import identifiability

        limits = identifiability(result, self.recordings)
        return write_page(target, result, limits, recordings=self.recordings, about={"Calibration": self.out})


def _kinds() -> dict[Method, Any]:
    """What makes each method, with its settings as arguments."""
    from swashtwin.calibration import IPINN, GaussNewton

    return {
        Method.gauss_newton: GaussNewton,
        Method.ipinn: IPINN,
    }


def _method(name: Method, texts: list[str] | None, solver: "SteadySolver") -> "Calibrator":
    """The method with its settings; one that it does not have is a wrong command line."""
    kind = _kinds()[name]
    defaults = defaults_of(kind())
    settings = read_settings(texts, defaults, f"--method {name.value}")
    calibrator: Calibrator = kind(solver=solver, **settings)
    return calibrator


def bounds_from(texts: Sequence[str] | None) -> dict[str, tuple[float, float]] | float | None:
    """Bounds of the search: one factor, or limits by letter or parameter name; units may be left out."""
    parts = [part.strip() for text in texts or () for part in text.split(",") if part.strip()]
    if len(parts) == 1 and "=" not in parts[0]:
        return (read_list(parts[0], float, "--bounds") or [0.0])[0]
    return {name: _limits(name, text) for name, text in read_pairs(parts, "--bounds").items()} or None


def _limits(name: str, text: str) -> tuple[float, float]:
    """Least and greatest value of ``1e4..1e8 N*s/m``."""
    least, dots, rest = (part.strip() for part in text.partition(".."))
    greatest, _, unit = rest.partition(" ")
    wanted = "N*s/m" if name.startswith("C") or name.endswith("damping") else "N/m"
    if not dots:
        reason = f'{name}={text} must be two limits, such as "{name}=1e4..1e8 {wanted}".'
        raise typer.BadParameter(reason, param_hint="--bounds")
    limits = (least if " " in least else f"{least} {unit or wanted}", f"{greatest} {unit or wanted}")
    low, high = (parse(limit, wanted, name=f"--bounds {name}") for limit in limits)
    return low, high


def nuisances_from(name: Freed) -> "Nuisances":
    """Constants to be searched, with their priors."""
    from swashtwin.calibration import Nuisances

    if name is Freed.by_axis:
        return Nuisances.by_axis()
    return {Freed.none: Nuisances(), Freed.usual: Nuisances.usual(), Freed.housing: Nuisances.housing()}[name]


def _interval(estimate: "Estimate") -> str:
    """The interval in words; an end that only the bound sets is left out."""
    low, high = (f"{end:.3g}" for end in estimate.interval)
    open_below, open_above = estimate.open_sides
    if open_below and open_above:
        return "no limits"
    return f"at most {high}" if open_below else f"at least {low}" if open_above else f"{low} ... {high}"


def _show(result: "Calibration", out: Path) -> None:
    rows = [
        (estimate.letter, estimate.name, estimate.nominal, estimate.value, _interval(estimate), estimate.unit,
         estimate.verdict)
        for estimate in result.estimates
    ]  # fmt: skip
    header = ("", "parameter", "nominal", "calibrated", "90 % interval", "unit", "verdict")
    table(f"{result.method} on {plural(len(result.recording_ids), 'recording')}", header, rows)
    before, after = asdict(result.fit_before), asdict(result.fit_after)
    fits = [(name, before[name], after[name]) for name in before]
    table("Against the measurement", ("figure", "nominal", "calibrated"), fits)
    for text in result.notes:
        note(f"note: {text}")
    say(str(out))
