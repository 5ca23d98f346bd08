"""What an identifiability report adds to the page."""

from swashtwin.calibration import IdentifiabilityReport
from swashtwin.report.identifiability_figures import coordinate_words, identifiability_drawings
from swashtwin.report.page import CALIBRATION, Bullets, Cell, Part, Picture, Section, Table
from swashtwin.report.wording import number, number_cell, percent


def identifiability_part(report: IdentifiabilityReport, key: str) -> Part:
    """Part of one report that stands alone."""
    return Part(
        title="What the measurement can tell",
        answer=identifiability_answer(report),
        notice="",
        sections=(Section(CALIBRATION, "What the measurement can tell", identifiability_blocks(report, key)),),
        results={"identifiability": [report.to_dict()]},
    )


def identifiability_answer(report: IdentifiabilityReport) -> tuple[str, ...]:
    """What came out, in plain words."""
    standing = dict(zip(report.names[:6], report.standing, strict=False))
    known, weak = ([name for name, word in standing.items() if word == wanted] for wanted in ("identified", "weak"))
    rest = [name for name in standing if name not in (*known, *weak)]
    told = f"The measurement identifies {', '.join(known) or 'none of the six values'}"
    told += f" and tells weakly of {', '.join(weak)}." if weak else "."
    left = f" It does not tell {', '.join(rest)}: no figure for them is a measurement." if rest else ""
    best = (f"The best further measurement: {report.gains[0].words}.",) if report.gains else ()
    return (told + left, *best)


def identifiability_blocks(report: IdentifiabilityReport, key: str) -> tuple:
    """Sentences, tables and figures of one report."""
    return (
        Bullets("In words", report.words),
        coordinates_table(report),
        directions_table(report),
        *(Picture(one) for one in identifiability_drawings(report, key)),
    )


def coordinates_table(report: IdentifiabilityReport) -> Table:
    """Posterior and prior width of each coordinate."""
    rows = [
        (
            Cell(coordinate_words(name)),
            number_cell(post),
            number_cell(prior),
            Cell(percent(post / prior)),
            Cell(word),
        )
        for name, post, prior, word in zip(report.names, report.std, report.prior_std, report.standing, strict=True)
    ]
    return Table(
        "Standard deviations of the logarithms (of residues: as they are) before and after. Dead: no line changes with "
        "it. Flat: nothing learnt. Traded off: the lines change with it, but as with others. Identified: 90 % within a "
        "factor of 1.5 (constants: known at least three times better than before).",
        ("coordinate", "after", "before", "share", "standing"),
        tuple(rows),
    )


def directions_table(report: IdentifiabilityReport) -> Table:
    """Independent combinations of the six values."""
    rows = [
        (Cell(one.words), Cell(number(one.share)), *(Cell(f"{weight:+.2f}") for _, weight in one.weights))
        for one in report.directions
    ]
    return Table(
        "Combinations of the six values that the measurement tells of independently, the best known first: share of "
        "the prior's width that is left, and weights. The Fisher information's greatest eigenvalue is "
        f"{number(report.condition_number)} times its least.",
        ("combination", "share left", *report.names[:6]),
        tuple(rows),
    )
