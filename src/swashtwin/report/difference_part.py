"""What two calibrations laid side by side add to the page."""

from swashtwin.calibration import Difference
from swashtwin.report.page import CALIBRATION, Bullets, Cell, Part, Section, Table
from swashtwin.report.wording import facts, number, number_cell, parameter_words, plural


def difference_part(apart: Difference, key: str) -> Part:
    """Part of one comparison.

    Parameters
    ----------
    key : how the names of its figures would begin; it has none.
    """
    telling = [one.letter for one in apart.values if one.is_telling]
    said = f"{', '.join(telling)} differ" if telling else "None of the six values differs"
    counts = f"{plural(len(apart.shared), 'recording')} shared"
    return Part(
        title="Two calibrations",
        answer=(f"{said} by more than two standard deviations between the two calibrations; {counts}.",),
        notice="",
        sections=(Section(CALIBRATION, "Two calibrations side by side", _blocks(apart)),),
        results={"differences": [apart.to_dict()]},
    )


def _blocks(apart: Difference) -> tuple:
    rows = [
        (
            Cell(f"{one.letter}, {parameter_words(one.name)} [{one.unit.replace('*', '·')}]"),
            *(Cell(f"{number(v)} ({number(i[0])} to {number(i[1])}), {verdict}")
              for v, i, verdict in zip(one.values, one.intervals, one.verdicts, strict=True)),
            Cell(f"{one.deviations:+.1f}"),
            Cell("yes" if one.overlap else "no"),
        )
        for one in apart.values
    ]  # fmt: skip
    fits = [
        (Cell(name.replace("_", " ")), *(number_cell(value) for value in pair)) for name, pair in apart.fits.items()
    ]
    settings = [(name, f"{pair[0]} | {pair[1]}") for name, pair in apart.settings.items()]
    return (
        Bullets("Look at this first", apart.notes),
        Table(
            "Values with 90 % intervals and verdicts. Difference: second less first, in standard deviations of the "
            "logarithms, as if the two were independent.",
            ("value", "first", "second", "difference", "intervals overlap"),
            tuple(rows),
        ),
        Table("Calibrated twins against their recordings.", ("", "first", "second"), tuple(fits)),
        *((facts("What differs: first | second.", settings),) if settings else ()),
    )
