"""Part of the page about an identifiability report."""

from swashtwin.calibration import VALUES, IdentifiabilityReport
from swashtwin.report.identifiability_figures import coordinate_words, identifiability_drawings
from swashtwin.report.page import Bullets, Cell, Group, Part, Picture, Section, SectionOrder, Table
from swashtwin.report.wording import number, number_cell, percent


def identifiability_part(report: IdentifiabilityReport, key: str) -> Part:
    """Part of the page about one identifiability report."""
    return Part(
        title="What the measurement can tell",
        answer=identifiability_answer(report)[:1],
        notice="",
        sections=(
            Section(SectionOrder.CALIBRATION, "What the measurement can tell", identifiability_blocks(report, key)),
        ),
        results={"identifiability": [report.to_dict()]},
        verdict=f"The measurement tells {report.standing[VALUES].count('identified') or 'none'} of 6 values clearly",
        actions=_NEXT,
    )


_NEXT = ("To tell more of them, record more: swashtwin twin next says at which speed and pressure, and how long.",)
_FEW_COORDINATES = 12
"""Coordinates whose table is not folded away; the figure shows all."""


def identifiability_answer(report: IdentifiabilityReport) -> tuple[str, ...]:
    """What came out, in plain words."""
    standing = dict(zip(report.names[VALUES], report.standing, strict=False))
    identified, weak = (
        [name for name, word in standing.items() if word == verdict] for verdict in ("identified", "weak")
    )
    rest = [name for name in standing if name not in (*identified, *weak)]
    statement = f"The measurement identifies {', '.join(identified) or 'none of the six values'}"
    statement += f" and tells weakly of {', '.join(weak)}." if weak else "."
    left = f" It does not tell {', '.join(rest)}: no figure for them is a measurement." if rest else ""
    return (statement + left,)


def identifiability_blocks(report: IdentifiabilityReport, key: str) -> tuple:
    """Sentences, tables and figures of one report."""
    table: Table | Group = coordinates_table(report)
    if len(report.names) > _FEW_COORDINATES:
        table = Group(f"Table of all {len(report.names)} coordinates", (table,), is_open=False)
    return (
        Bullets("In words", report.words),
        directions_table(report),
        table,
        *(Picture(drawing) for drawing in identifiability_drawings(report, key)),
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
        "it. Flat: the measurement adds nothing. Traded off: the lines change with it as with others. Identified: 90 % "
        "within a factor of 1.5 (constants: interval at least three times narrower than before).",
        ("coordinate", "after", "before", "share", "standing"),
        tuple(rows),
    )


def directions_table(report: IdentifiabilityReport) -> Table:
    """Independent combinations of the six values."""
    rows = [
        (
            Cell(direction.words),
            Cell(number(direction.share)),
            *(Cell(f"{weight:+.2f}") for _, weight in direction.weights),
        )
        for direction in report.directions
    ]
    return Table(
        "Independent combinations of the six values, the best determined first: remaining share of "
        "the prior's width, and weights. The Fisher information's greatest eigenvalue is "
        f"{number(report.condition_number)} times its least.",
        ("combination", "share left", *report.names[VALUES]),
        tuple(rows),
    )
