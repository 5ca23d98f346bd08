"""The command that fits twins to several pumps of one type together: twin calibrate-fleet."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.calibrating import Bounds, FreedName, bounds_from, nuisances_from
from swashtwin.cli.console import note, note_left_out, progress, say, table, tell
from swashtwin.cli.exits import require_target
from swashtwin.cli.operating_points import OperatingPoints, OptionalTemperature, Pressures, Speeds
from swashtwin.cli.options import FaultText, Index, Json, PumpName, Seed, fault_from, present
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.calibration import FleetCalibration


def calibrate_fleet(
    source: Index,
    pump: PumpName = "25scy14-1b",
    fault: FaultText = "normal",
    speed: Speeds = None,
    pressure: Pressures = None,
    temperature: OptionalTemperature = None,
    nuisances: FreedName = None,
    bounds: Bounds = None,
    out: Annotated[
        Path, typer.Option(help="Folder to write: population.json, and SPECIMEN.json for each specimen.")
    ] = Path("fleet"),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Calibrate several pumps of one type together: each pump's uncertain values are informed by the others.

    The index names each recording's specimen. Calibrating is training: the recordings used must not test a classifier.
    """
    import swashtwin.calibration as calibration
    from swashtwin.pump import load_pump
    from swashtwin.recordings import load_recordings

    require_target(out / "population.json")
    points = OperatingPoints(speed, pressure or [], temperature)
    drawing, defect = load_pump(pump), fault_from(fault)
    with progress("calibrating the fleet"):
        fleet = calibration.calibrate_fleet(
            points.twins(drawing, defect),
            points.select(load_recordings(source)),
            fault=None if points.is_complete else defect,
            seed=seed,
            bounds=bounds_from(bounds),
            **present(nuisances=nuisances and nuisances_from(nuisances)),
        )
    files = fleet.save(out)
    tell({**fleet.to_dict(), "files": files}, as_json, lambda: _show_fleet(fleet, out))


def _show_fleet(fleet: "FleetCalibration", out: Path) -> None:
    population = fleet.population
    rows = []
    for index, name in enumerate(population.names):
        low, high = population.spread_interval[index]
        figures = (population.mean[index], population.mean_std[index], population.spread[index])
        rows.append((name, *map(float, figures), f"{low:.3g} ... {high:.3g}"))
    header = ("coordinate", "mean of ln", "its uncertainty", "spread", "90 % interval of the spread")
    table(f"Population of {len(population.specimens)} pumps", header, rows)
    for name, calibration in fleet.calibrations.items():
        pairs = zip(fleet.alone[name], calibration.estimates, strict=True)
        values = [(a.letter, a.value, a.log_std, b.value, b.log_std, b.unit, b.verdict) for a, b in pairs]
        columns = ("", "alone", "± of ln", "with the others", "± of ln", "unit", "verdict")
        table(f"{name}: {plural(len(calibration.recording_ids), 'recording')}", columns, values)
    note_left_out(fleet.left_out)
    for text in fleet.notes:
        note(f"note: {text}")
    say(str(out))
