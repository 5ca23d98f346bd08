"""Commands that teach twins and use what they learnt: calibrate, synthesize."""

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.exits import require_target
from swashtwin.cli.options import (
    Dimensions,
    FaultDepth,
    FaultLength,
    FaultName,
    FaultWidth,
    Freed,
    FreedName,
    Index,
    Json,
    Length,
    Pressure,
    PumpName,
    Seed,
    Solver,
    SolverName,
    Speed,
    Step,
    Temperature,
    condition_of,
    fault_of,
    given,
    nuisances_of,
    solver_of,
)

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration, Calibrator
    from swashtwin.integrators import SteadySolver


class Method(StrEnum):
    """How the six values are searched."""

    ipinn = "ipinn"
    gauss_newton = "gauss-newton"
    lbfgs = "lbfgs"
    cmaes = "cmaes"


def calibrate(
    source: Index,
    speed: Speed,
    pressure: Pressure,
    pump: PumpName = "25scy14-1b",
    temperature: Temperature = None,
    fault: FaultName = "normal",
    length: FaultLength = None,
    width: FaultWidth = None,
    depth: FaultDepth = None,
    dimensions: Dimensions = None,
    specimen: Annotated[str | None, typer.Option(help="Use the recordings of this machine only.")] = None,
    method: Annotated[
        Method, typer.Option(help="ipinn is the paper's; gauss-newton takes a fiftieth of the time.")
    ] = Method.ipinn,
    epochs: Annotated[int | None, typer.Option(min=1, help="Epochs of ipinn; 500 by default.")] = None,
    nuisances: FreedName = Freed.none,
    solver: SolverName = Solver.harmonic_balance,
    step: Step = None,
    bounds: Annotated[float | None, typer.Option(help="Search each value within this factor of the nominal.")] = None,
    up_to: Annotated[
        str | None,
        typer.Option(help='Compare lines up to this frequency: "1000 Hz" before severity; 2500 Hz by default.'),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="File to write, .json; the values go beside it as NAME-interfaces.toml.")
    ] = Path("calibration.json"),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Find a twin's six interface values from recordings of its class at its condition, and how far to trust them.

    Calibrating is training: the recordings used must not test a classifier later (swashtwin split).
    """  # fmt: skip
    import swashtwin.calibration as calibration
    from swashtwin.pump_files import load_pump
    from swashtwin.readers import read_recordings
    from swashtwin.recording import select
    from swashtwin.twin import Twin
    from swashtwin.units import parse

    values_file = out.with_name(f"{out.stem}-interfaces.toml")
    require_target(out, ".json")
    if method is not Method.ipinn and epochs is not None:
        raise typer.BadParameter("belongs to --method ipinn.", param_hint="--epochs")
    condition = condition_of(speed, pressure, temperature)
    twin = Twin(load_pump(pump), condition, fault_of(fault, length, width, depth, dimensions))
    recordings = select(read_recordings(source), specimen=specimen)
    with progress("calibrating") as bar:
        found = calibration.calibrate(
            twin,
            recordings,
            method=_method(method, epochs, solver_of(solver, step)),
            seed=seed,
            bounds=bounds,
            band=None if up_to is None else (0.0, parse(up_to, "Hz", name="up_to")),
            nuisances=nuisances_of(nuisances),
            progress=lambda done, total, loss: bar(done, total, f"calibrating, loss {loss:.4g}"),
        )
    found.save(out)
    values = found.save_interfaces(values_file)
    kept = ("method", "settings", "estimates", "fit_before", "fit_after", "recording_ids", "recording_hashes")
    facts = found.to_dict()
    result = {"calibration": out, "interfaces": values, **{name: facts[name] for name in (*kept, "left_out", "notes")}}
    result |= {"simulations": found.simulations, "wall_s": found.wall_s}
    tell(result, as_json, lambda: _show_calibration(found, out))


def synthesize(
    calibration: Annotated[Path, typer.Argument(help="Saved calibration (swashtwin calibrate).")],
    like: Annotated[Path, typer.Option(help="Index of the training recordings: layout, classes, noise.")],
    label: Annotated[str, typer.Option(help="Class of the windows; the twin's.")],
    count: Annotated[int, typer.Option(help="How many.")],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    pressure: Annotated[str | None, typer.Option(help="Take the twin to another outlet pressure.")] = None,
    nominal: Annotated[bool, typer.Option("--nominal", help="Use the twin as it was before calibration.")] = False,
    background: Annotated[bool, typer.Option(help="Lay the windows over noise as measured.")] = True,
    length: Length = 2048,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Make synthetic windows of one class with a calibrated twin.

    Their noise is that of the recordings of --like, which are training data from then on: give train.toml of a split.
    """
    from swashtwin import augmentation
    from swashtwin.calibration import load_calibration
    from swashtwin.readers import read_recordings
    from swashtwin.units import parse
    from swashtwin.windows import cut_windows, save_windows

    found = load_calibration(calibration)
    twin = found.nominal if nominal else found.twin
    if pressure is not None:
        twin = twin.at(twin.condition.replaced(discharge_pressure=parse(pressure, "Pa", name="pressure")))
    recordings = read_recordings(like)
    classes = sorted({one.label for one in recordings if one.label is not None} | {label})
    measured = cut_windows(recordings, length=length, classes=classes)
    windows = augmentation.synthesize(twin, label=label, count=count, like=measured, seed=seed, background=background)
    manifest = {*found.recording_ids, *measured.recording_id.tolist()}
    save_windows(windows, out, manifest=manifest)
    result = {
        "windows": out,
        "label": label,
        "count": len(windows),
        "length": windows.length,
        "manifest": sorted(manifest),
    }
    result |= {"classes": windows.classes, "seed": seed}
    tell(result, as_json, lambda: say(f"{out}: {len(windows)} windows of {label}\nNext: swashtwin train --add {out}"))


def _method(name: Method, epochs: int | None, solver: "SteadySolver") -> "Calibrator":
    from swashtwin.calibration import CMAES, IPINN, LBFGS, GaussNewton

    if name is Method.ipinn:
        return IPINN(solver=solver, **given(epochs=epochs))
    return {Method.gauss_newton: GaussNewton, Method.lbfgs: LBFGS, Method.cmaes: CMAES}[name](solver=solver)


def _show_calibration(found: "Calibration", out: Path) -> None:
    rows = [
        (one.letter, one.name, one.nominal, one.value, f"{one.interval[0]:.3g} ... {one.interval[1]:.3g}", one.unit,
         one.verdict)
        for one in found.estimates
    ]  # fmt: skip
    header = ("", "parameter", "nominal", "calibrated", "90 % interval", "unit", "verdict")
    table(f"{found.method} on {len(found.recording_ids)} recordings", header, rows)
    before, after = asdict(found.fit_before), asdict(found.fit_after)
    table("Against the measurement", ("figure", "nominal", "calibrated"), [(n, before[n], after[n]) for n in before])
    for text in found.notes:
        note(f"note: {text}")
    say(str(out))
