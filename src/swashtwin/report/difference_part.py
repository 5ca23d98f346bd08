"""Part of the page about two calibrations side by side."""

from swashtwin.calibration import Difference
from swashtwin.foundation import plural
from swashtwin.report.calibration_part import FIGURES
from swashtwin.report.page import Cell, Part, Section, SectionOrder, Table
from swashtwin.report.wording import facts_table, number, number_cell, parameter_words


def difference_part(difference: Difference, key: str) -> Part:
    """Part of the page about one comparison.

    Parameters
    ----------
    key : not used; a comparison has no figures.
    """
    telling = [change.letter for change in difference.values if change.is_telling]
    statement = f"{', '.join(telling)} differ" if telling else "None of the six values differs"
    shared = f"share {plural(len(difference.shared), 'recording')}" if difference.shared else "share no recording"
    return Part(
        title="Comparison of two calibrations",
        answer=(f"{statement} by more than two standard deviations between the two calibrations, which {shared}.",),
        notice="",
        sections=(Section(SectionOrder.CALIBRATION, "Two calibrations side by side", _blocks(difference)),),
        results={"differences": [difference.to_dict()]},
        certainty=tuple(f"{text[:1].upper()}{text[1:]}" for text in difference.notes),
        actions=_SAME if not telling else _DIFFERENT,
        verdict=f"{len(telling)} of the six values differ" if telling else "No value differs clearly",
    )


_SAME = (
    "Nothing now: as far as these recordings can tell, nothing has changed.",
    "To see smaller changes, calibrate both on more recordings of the same speeds and pressures.",
)
_DIFFERENT = (
    "Check first that both were recorded at the same speed, pressure and oil temperature, with the sensors in the same "
    "places: these move the values too.",
    "Then look at the parts between which the values differ, and record again to see whether the difference stays.",
)


def _blocks(difference: Difference) -> tuple:
    rows = [
        (
            Cell(f"{change.letter}, {parameter_words(change.name)} [{change.unit.replace('*', '·')}]"),
            *(Cell(f"{number(v)} ({number(i[0])} to {number(i[1])}), {verdict}")
              for v, i, verdict in zip(change.values, change.intervals, change.verdicts, strict=True)),
            Cell(f"{change.deviations:+.1f}".replace("-", "−")),
            Cell("yes" if change.overlap else "no"),
        )
        for change in difference.values
    ]  # fmt: skip
    fits = [
        (Cell(FIGURES.get(name, name.replace("_", " "))), *(number_cell(value) for value in pair))
        for name, pair in difference.fits.items()
    ]
    settings = [(name, f"{pair[0]} | {pair[1]}") for name, pair in difference.settings.items()]
    return (
        Table(
            "Values with 90 % intervals and verdicts. Difference: second less first, in standard deviations of the "
            "logarithms, as if the two were independent.",
            ("value", "first", "second", "difference", "intervals overlap"),
            tuple(rows),
        ),
        Table("Calibrated twins against their recordings.", ("", "first", "second"), tuple(fits)),
        *((facts_table("What differs: first | second.", settings),) if settings else ()),
    )
