"""Part of the page about an identifiability report."""

import numpy as np

from swashtwin.calibration import VALUES, IdentifiabilityReport
from swashtwin.plot import ON_DARK, ON_SHADE, figure_style, panels, words
from swashtwin.pump import LETTERS
from swashtwin.report.drawing import Drawing, render_drawing
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table
from swashtwin.report.wording import number, number_cell, percent

_NEXT = ("To tell more of them, record more: swashtwin twin next says at which speed and pressure, and how long.",)
_FEW_COORDINATES = 12
"""Coordinates whose table is not folded away."""


def identifiability_part(report: IdentifiabilityReport, key: str) -> Part:
    """Part of the page about one identifiability report."""
    table: Table | Group = coordinates_table(report)
    if len(report.names) > _FEW_COORDINATES:
        table = Group(f"Table of all {len(report.names)} coordinates", (table,), is_open=False)
    blocks = (
        Bullets("In words", report.words),
        directions_table(report),
        table,
        correlations(report, key),
    )
    return Part(
        title="What the measurement can tell",
        answer=(_answer(report),),
        sections=(Section(SectionOrder.CALIBRATION, "What the measurement can tell", blocks),),
        results={"identifiability": [report.to_dict()]},
        verdict=f"The measurement tells {report.standing[VALUES].count('identified') or 'none'} of 6 values clearly",
        actions=_NEXT,
    )


def _answer(report: IdentifiabilityReport) -> str:
    """What came out, in plain words."""
    standing = dict(zip(report.names[VALUES], report.standing, strict=False))
    identified, weak = (
        [name for name, word in standing.items() if word == verdict] for verdict in ("identified", "weak")
    )
    rest = [name for name in standing if name not in (*identified, *weak)]
    statement = f"The measurement identifies {', '.join(identified) or 'none of the six values'}"
    statement += f" and tells weakly of {', '.join(weak)}." if weak else "."
    return statement + (f" It does not tell {', '.join(rest)}: no figure for them is a measurement." if rest else "")


def coordinates_table(report: IdentifiabilityReport) -> Table:
    """Posterior and prior width of each coordinate."""
    rows = [
        (coordinate_words(name), number_cell(post), number_cell(prior), percent(post / prior), word)
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
        (item.words, number(item.share), *(f"{weight:+.2f}" for _, weight in item.weights))
        for item in report.directions
    ]
    return Table(
        "Independent combinations of the six values, the best determined first: remaining share of "
        "the prior's width, and weights. The Fisher information's greatest eigenvalue is "
        f"{number(report.condition_number)} times its least.",
        ("combination", "share left", *report.names[VALUES]),
        tuple(rows),
    )


def coordinate_words(name: str) -> str:
    """Name of a coordinate in words; letters of the six values as they are."""
    return name if name in LETTERS.values() else words(name)


@figure_style()
def correlations(report: IdentifiabilityReport, key: str) -> Drawing:
    """Posterior correlation of all coordinates."""
    count, names = len(report.names), [coordinate_words(name) for name in report.names]
    columns = {
        "first": np.repeat(report.names, count), "second": np.tile(report.names, count),
        "correlation": report.correlation.ravel(),
    }  # fmt: skip
    figure, axes = panels(1, 1, min(8.5, 2.0 + 0.36 * count))
    panel = axes[0, 0]
    image = panel.imshow(report.correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    panel.set_xticks(range(count), names, rotation=90)
    panel.set_yticks(range(count), names)
    panel.grid(False)
    if count <= 12:
        for i, j in np.ndindex(count, count):
            value = report.correlation[i, j]
            color = ON_DARK if abs(value) > 0.6 else ON_SHADE
            panel.text(j, i, f"{value:.1f}".replace("-0.0", "0.0"), ha="center", va="center", fontsize=8, color=color)
    figure.colorbar(image, ax=panel, label="correlation [1]")
    caption = (
        "Correlation of the estimated logarithms. Near 1: only the ratio of the two is well determined; near −1: only "
        "their product."
    )
    title = "What can be traded for what"
    return render_drawing(f"{key}_correlations", figure, columns, title=title, caption=caption)
