"""The command that lays two calibrations side by side: compare."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, say, table, tell
from swashtwin.cli.options import Json, as_folder

if TYPE_CHECKING:
    from swashtwin.calibration import Difference


def compare(
    first: Annotated[Path, typer.Argument(help="Saved calibration (swashtwin calibrate).")],
    second: Annotated[Path, typer.Argument(help="Another.")],
    report: Annotated[
        Path | None, typer.Option(help="Folder for a page with both and their differences.", callback=as_folder)
    ] = None,
    as_json: Json = False,
) -> None:
    """Say which values of two calibrations differ by more than they are uncertain, and what else differs."""
    from swashtwin.calibration import difference, load_calibration

    found = [load_calibration(path) for path in (first, second)]
    apart = difference(*found)
    page = None
    if report is not None:
        from swashtwin.report import write_report

        page = write_report(apart, *found, folder=report)
    result = {"first": first, "second": second, **apart.to_dict(), "report": page}
    tell(result, as_json, lambda: _show(apart, first.name, second.name))


def _show(apart: "Difference", first: str, second: str) -> None:
    rows = [
        (one.letter, *map(float, one.values), *(f"{low:.3g} ... {high:.3g}" for low, high in one.intervals),
         f"{one.verdicts[0]}, {one.verdicts[1]}", one.deviations, "yes" if one.overlap else "no")
        for one in apart.values
    ]  # fmt: skip
    header = ("", "A", "B", "90 % of A", "90 % of B", "verdicts", "B - A in std of ln", "overlap")
    table(f"A {first}, B {second}", header, rows)
    if apart.constants:
        constants = [(one.name, *one.coordinates, *one.log_stds) for one in apart.constants]
        table("Constants searched (logarithms; residues as they are)", ("", "A", "B", "std A", "std B"), constants)
    fits = [(name, *map(float, pair)) for name, pair in apart.fits.items()]
    table("Against the measurement, calibrated", ("figure", "A", "B"), fits)
    if apart.settings:
        table("What differs", ("setting", "A", "B"), [(name, *map(str, pair)) for name, pair in apart.settings.items()])
    say(f"recordings: {len(apart.shared)} shared, {len(apart.alone[0])} of A only, {len(apart.alone[1])} of B only")
    for text in apart.notes:
        note(f"note: {text}")
