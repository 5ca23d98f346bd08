"""Figures together with the data they show, and the pump cut open with the part that a class stands
for marked.
"""

import base64
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from swashtwin.foundation import csv_text, escape_controls
from swashtwin.pump import propose_class

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
_PAGE_COLORS = {
    "#000000": "ink", "#ffffff": "paper", "#4d4d4d": "measured", "#0072b2": "blue", "#d9d9d9": "light",
    "#e6e6e6": "grid", "#efefef": "faint", "#009e73": "green", "#d55e00": "orange", "#aa4499": "purple",
    "#888888": "gray",
}  # fmt: skip
"""Colors of figures that the page has a dark form of, by the name of its variable."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """One figure of a report."""

    kind: ClassVar[str] = "picture"
    name: str
    """File name without suffix."""
    title: str
    """What it shows."""
    caption: str
    """How to read it."""
    svg: str
    """The figure as a file of its own."""
    columns: Mapping[str, Sequence[Any] | np.ndarray]
    """Its data, one entry of each column per row."""
    description: str = ""
    """What it shows, for those who cannot see it."""

    @property
    def csv(self) -> str:
        """The data as text, every number with all its digits."""
        columns = (map(_plain, column) for column in self.columns.values())
        return csv_text(tuple(self.columns), zip(*columns, strict=True))

    @property
    def link(self) -> str:
        """The data as an address that holds them, so that a page alone is enough."""
        content = base64.b64encode(self.csv.encode("utf-8", "backslashreplace"))
        return f"data:text/csv;charset=utf-8;base64,{content.decode()}"

    @property
    def within_page(self) -> str:
        """The figure as part of a page: without its prolog and size, its ids unique, its colors the
        page's.
        """
        body = self.svg[self.svg.index("<svg") :]
        for size in ("width", "height"):
            body = re.sub(rf'(<svg[^>]*?) {size}="[^"]*"', r"\1", body, count=1)
        body = re.sub(r'\bid="([^"]+)"', rf'id="{self.name}-\1"', body)
        body = re.sub(r'href="#([^"]+)"', rf'href="#{self.name}-\1"', body)
        body = re.sub(r"url\(#([^)]+)\)", rf"url(#{self.name}-\1)", body)
        colors = re.compile("|".join(rf"{color}\b" for color in _PAGE_COLORS))
        return re.sub(
            r'style="[^"]*"',
            lambda style: colors.sub(lambda color: f"var(--{_PAGE_COLORS[color[0]]})", style[0]),
            body,
        )


def render_drawing(
    name: str,
    figure: "Figure",
    columns: Mapping[str, Sequence[Any] | np.ndarray],
    *,
    title: str,
    caption: str,
    description: str = "",
) -> Drawing:
    """The figure as SVG with its data (`Drawing`); call it within `figure_style`."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_NO_METADATA)
    svg = text.getvalue().replace("<svg", "<!-- figure of swashtwin -->\n<svg", 1)
    # XML allows no control characters, which names of recordings may have
    svg = escape_controls(svg, keep="\n")
    return Drawing(name, title, caption, svg, columns, description)


def tabulate(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Columns of rows that all have the same names."""
    rows = list(rows)
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


def _plain(value: Any) -> Any:
    if value is None:
        return ""
    return value.item() if isinstance(value, np.generic) else value


Family = Literal["pistons", "shaft"]

_PISTONS = "Lines at the number of pistons times the shaft, and at multiples of that"
_SHAFT = "Lines at every multiple of the shaft, between the piston-pass lines"

_MARKS: Mapping[str, tuple[tuple[str, ...], Family, str]] = MappingProxyType(
    {
        "swash_plate": (
            ("swash plate", "slipper"),
            "pistons",
            "each slipper in turn rides over the same spot of the plate, so it happens once per piston.",
        ),
        "piston": (
            ("piston",), "shaft", "one piston leaks or knocks more than the others, so it happens once per turn."
        ),
        "cylinder_block": (
            ("cylinder block",),
            "shaft",
            "one bore or one side of the block differs from the others, so it happens once per turn.",
        ),
        "valve_plate": (
            ("valve plate",),
            "pistons",
            "every cylinder passes the same plate, which stands still, so it happens once per piston.",
        ),
        "loose_slipper": (
            ("slipper",), "shaft", "one slipper strikes its stop twice per turn, and the others do not."
        ),
    }
)  # fmt: skip
"""Marked parts of the drawing, which orders rise, and why these, by class. A test compares the
families with the lines of the twin (docs/explanation/physics.md, section 5).
"""


@dataclass(frozen=True)
class Cutaway:
    """The pump, cut open, with a part marked, beside the orders that the part excites."""

    kind: ClassVar[str] = "cutaway"
    label: str
    """Class whose part is marked."""
    pistons: int | None = None
    """Number of pistons; without it the strip of orders names none."""
    shaft: float | None = None
    """Shaft frequency [Hz], to say where the orders are."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that are marked."""
        return _MARKS[self.label][0] if self.label else ()

    @property
    def family(self) -> Family:
        """Which orders rise."""
        return _MARKS[self.label][1]

    @property
    def sentence(self) -> str:
        """Which lines rise, and why."""
        return f"{_PISTONS if self.family == 'pistons' else _SHAFT}: {_MARKS[self.label][2]}"

    @property
    def description(self) -> str:
        """The drawing in words."""
        marked = f"; marked: {' and '.join(self.parts)}. {self.sentence}" if self.parts else "."
        return f"Section through an axial piston pump{marked}"


@cache
def load_template(name: str) -> Template:
    """A template of this folder."""
    loader = PackageLoader("swashtwin.report", "")
    options = {
        "autoescape": True,
        "undefined": StrictUndefined,
        "trim_blocks": True,
        "lstrip_blocks": True,
    }
    return Environment(loader=loader, **options).get_template(name)  # type: ignore[arg-type]


def render_cutaway(label: str, pistons: int | None = None, shaft: float | None = None) -> str:
    """The drawing for a class as HTML, to be colored by the page's style; where `build_cutaways` has
    none, of no part.
    """
    macro = load_template("cutaway.html.jinja").module.cutaway  # type: ignore[attr-defined]
    return "".join(
        macro(drawing)
        for drawing in build_cutaways(label, pistons, shaft) or (Cutaway("", pistons),)
    )


def build_cutaways(
    label: str, pistons: int | None = None, shaft: float | None = None
) -> tuple[Cutaway, ...]:
    """The drawing for a class; none for a healthy pump, or for a class whose part is not known."""
    part = label if label in _MARKS else propose_class(label) or ""
    return (Cutaway(part, pistons, shaft),) if part in _MARKS else ()
