"""The command that calibrates several pumps of one type together: calibrate-fleet."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, note_left_out, progress, say, table, tell
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
    Pressures,
    PumpName,
    Seed,
    Speed,
    Temperature,
    condition_of,
    fault_of,
    nuisances_of,
)

if TYPE_CHECKING:
    from swashtwin.calibration import FleetCalibration


def calibrate_fleet(
    source: Index,
    speed: Speed,
    pressure: Pressures,
    pump: PumpName = "25scy14-1b",
    temperature: Temperature = None,
    fault: FaultName = "normal",
    length: FaultLength = None,
    width: FaultWidth = None,
    depth: FaultDepth = None,
    dimensions: Dimensions = None,
    nuisances: FreedName = Freed.none,
    bounds: Annotated[float | None, typer.Option(help="Search each value within this factor of the nominal.")] = None,
    out: Annotated[
        Path, typer.Option(help="Folder to write: population.json, and SPECIMEN.json for each specimen.")
    ] = Path("fleet"),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Calibrate several pumps of one type together: what one's recordings leave open, it learns from the others.

    The index names each recording's specimen. Calibrating is training: the recordings used must not test a classifier.
    """
    import swashtwin.calibration as calibration
    from swashtwin.physics import Twin
    from swashtwin.pump import load_pump
    from swashtwin.recordings import load_recordings

    defect = fault_of(fault, length, width, depth, dimensions)
    drawing = load_pump(pump)
    twins = [Twin(drawing, condition_of(speed, one, temperature), defect) for one in pressure]
    with progress("calibrating the fleet"):
        found = calibration.calibrate_fleet(
            twins, load_recordings(source), seed=seed, bounds=bounds, nuisances=nuisances_of(nuisances)
        )
    files = found.save(out)
    tell({**found.to_dict(), "files": files}, as_json, lambda: _show(found, out))


def _show(found: "FleetCalibration", out: Path) -> None:
    population = found.population
    rows = []
    for place, name in enumerate(population.names):
        low, high = population.spread_interval[place]
        told = (population.mean[place], population.mean_std[place], population.spread[place])
        rows.append((name, *map(float, told), f"{low:.3g} ... {high:.3g}"))
    header = ("coordinate", "mean of ln", "known to", "spread", "90 % interval of the spread")
    table(f"Population of {len(population.specimens)} pumps", header, rows)
    for name, one in found.calibrations.items():
        pairs = zip(found.alone[name], one.estimates, strict=True)
        values = [(a.letter, a.value, a.log_std, b.value, b.log_std, b.unit, b.verdict) for a, b in pairs]
        columns = ("", "alone", "± of ln", "with the others", "± of ln", "unit", "verdict")
        table(f"{name}: {len(one.recording_ids)} recordings", columns, values)
    note_left_out(found.left_out)
    for text in found.notes:
        note(f"note: {text}")
    say(str(out))
