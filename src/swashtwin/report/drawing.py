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
from jinja2 import Template

from swashtwin.foundation import csv_text, escape_controls, load_templates
from swashtwin.pump import propose_class

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Metadata left out of figures, so that the same data give the same file.
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}

# Colors of figures that the page has a dark form of, by the name of its variable.
_PAGE_COLORS = {
    "#000000": "ink",
    "#ffffff": "paper",
    "#4d4d4d": "measured",
    "#0072b2": "blue",
    "#d9d9d9": "light",
    "#e6e6e6": "grid",
    "#efefef": "faint",
    "#009e73": "green",
    "#d55e00": "orange",
    "#aa4499": "purple",
    "#888888": "gray",
}

_PAGE_COLOR = re.compile("|".join(rf"{color}\b" for color in _PAGE_COLORS))


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
    """The figure as an SVG file."""
    phone_svg: str
    """The same figure laid out for a phone."""
    columns: Mapping[str, Sequence[Any] | np.ndarray]
    """Its data, one entry of each column per row."""
    description: str = ""
    """What it shows, for screen readers."""

    @property
    def csv(self) -> str:
        """The data as text, every number with all its digits."""
        columns = (map(_as_plain_value, column) for column in self.columns.values())
        return csv_text(tuple(self.columns), zip(*columns, strict=True))

    @property
    def link(self) -> str:
        """The data as a data URL, so that a page needs no other file."""
        content = base64.b64encode(self.csv.encode("utf-8", "backslashreplace"))
        return f"data:text/csv;charset=utf-8;base64,{content.decode()}"

    @property
    def within_page(self) -> str:
        """The figure as part of a page: without its prolog and size, its ids unique, its colors the
        page's.
        """
        return _embed(self.svg, self.name)

    @property
    def within_phone(self) -> str:
        """The same of the figure for a phone."""
        return _embed(self.phone_svg, f"{self.name}-phone")


def _embed(svg: str, name: str) -> str:
    """Return a file of SVG as part of a page; `name` makes its ids unique."""
    body = svg[svg.index("<svg") :]
    for size in ("width", "height"):
        body = re.sub(rf'(<svg[^>]*?) {size}="[^"]*"', r"\1", body, count=1)

    # ids of several figures on one page must differ
    body = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', body)
    body = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", body)
    return re.sub(r'style="[^"]*"', _use_page_colors, body)


def _use_page_colors(style: re.Match[str]) -> str:
    """Return a style with the page's variables in place of colors that it has a dark form of."""
    return _PAGE_COLOR.sub(lambda color: f"var(--{_PAGE_COLORS[color[0]]})", style[0])


def render_drawing(
    name: str,
    figure: "Figure",
    columns: Mapping[str, Sequence[Any] | np.ndarray],
    *,
    title: str,
    caption: str,
    description: str = "",
) -> Drawing:
    """Return the figure as SVG with its data; call it within `figure_style`.

    The figure itself is laid out for a phone afterwards.
    """
    # matplotlib is loaded only if a figure is drawn
    from swashtwin.plot import fit_to_phone

    svg = _save_svg(figure)
    fit_to_phone(figure)
    return Drawing(name, title, caption, svg, _save_svg(figure), columns, description)


def _save_svg(figure: "Figure") -> str:
    """Return the figure as a file of SVG."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_NO_METADATA)
    # XML allows no control characters, which names of recordings may have
    return escape_controls(text.getvalue(), keep="\n")


def tabulate(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the columns of rows that all have the same names."""
    columns: dict[str, list[Any]] = {}
    for row in rows:
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    return columns


def _as_plain_value(value: Any) -> Any:
    """Return an entry of a CSV file: empty for `None`, Python's number for NumPy's."""
    if value is None:
        return ""
    if isinstance(value, np.generic):
        return value.item()
    return value


Family = Literal["pistons", "shaft"]

_FAMILY_LINES: Mapping[Family, str] = MappingProxyType(
    {
        "pistons": "Lines at the number of pistons times the shaft, and at multiples of that",
        "shaft": "Lines at every multiple of the shaft, between the piston-pass lines",
    }
)


@dataclass(frozen=True)
class _Mark:
    """What the cutaway shows of a class."""

    parts: tuple[str, ...]
    """Marked parts of the drawing."""
    family: Family
    """Orders that rise."""
    reason: str
    """Why these orders rise."""


# Marks by class. A test compares the families with the lines of the twin
# (docs/explanation/physics.md, section 5).
_MARKS: Mapping[str, _Mark] = MappingProxyType(
    {
        "swash_plate": _Mark(
            ("swash plate", "slipper"),
            "pistons",
            "each slipper in turn rides over the same spot of the plate, so it happens once per "
            "piston.",
        ),
        "piston": _Mark(
            ("piston",),
            "shaft",
            "one piston leaks or knocks more than the others, so it happens once per turn.",
        ),
        "cylinder_block": _Mark(
            ("cylinder block",),
            "shaft",
            "one bore or one side of the block differs from the others, so it happens once per "
            "turn.",
        ),
        "valve_plate": _Mark(
            ("valve plate",),
            "pistons",
            "every cylinder passes the same plate, which stands still, so it happens once per "
            "piston.",
        ),
        "loose_slipper": _Mark(
            ("slipper",),
            "shaft",
            "one slipper strikes its stop twice per turn, and the others do not.",
        ),
    }
)


@dataclass(frozen=True)
class Cutaway:
    """The pump, cut open, with a part marked, and the orders that the part excites."""

    kind: ClassVar[str] = "cutaway"
    label: str
    """Class whose part is marked; empty for no part."""
    pistons: int | None = None
    """Number of pistons; without it the strip of orders names none."""
    shaft: float | None = None
    """Shaft frequency [Hz], to name the frequencies of the orders."""
    is_below_living_pump: bool = False
    """Whether a pump that turns shows the part; the drawing then stands in for it without
    scripts."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that are marked."""
        if not self.label:
            return ()
        return _MARKS[self.label].parts

    @property
    def family(self) -> Family:
        """Orders that rise."""
        return _MARKS[self.label].family

    @property
    def sentence(self) -> str:
        """Which lines rise, and why."""
        return f"{_FAMILY_LINES[self.family]}: {_MARKS[self.label].reason}"

    @property
    def description(self) -> str:
        """The drawing in words."""
        section = "Section through an axial piston pump"
        if not self.parts:
            return f"{section}."
        return f"{section}; marked: {' and '.join(self.parts)}. {self.sentence}"


@cache
def load_template(name: str) -> Template:
    """Return a template of this folder."""
    return load_templates("swashtwin.report", "").get_template(name)


def render_cutaway(label: str, pistons: int | None = None, shaft: float | None = None) -> str:
    """Return the drawing for a class as HTML, to be colored by the page's style.

    If `build_cutaways` has no drawing for the class, no part is marked.
    """
    macro = load_template("cutaway.html.jinja").module.cutaway  # type: ignore[attr-defined]
    cutaways = build_cutaways(label, pistons, shaft) or (Cutaway("", pistons),)
    return "".join(macro(cutaway) for cutaway in cutaways)


def build_cutaways(
    label: str, pistons: int | None = None, shaft: float | None = None
) -> tuple[Cutaway, ...]:
    """Return the drawing for a class; none for a healthy pump, or if the part is not known."""
    for known_class in (label, propose_class(label) or ""):
        if known_class in _MARKS:
            return (Cutaway(known_class, pistons, shaft),)
    return ()
