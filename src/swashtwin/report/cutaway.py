"""A drawing of the pump, cut open, with the part that a class stands for marked, and the orders that it excites."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import ClassVar, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from swashtwin.pump import propose_class

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
"""Marked parts of the drawing, which orders rise, and why these, by class. A test compares the families with the lines
of the twin (docs/explanation/physics.md, section 5)."""


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
def template(name: str) -> Template:
    """A template of this folder."""
    loader = PackageLoader("swashtwin.report", "")
    options = {"autoescape": True, "undefined": StrictUndefined, "trim_blocks": True, "lstrip_blocks": True}
    return Environment(loader=loader, **options).get_template(name)  # type: ignore[arg-type]


def cutaway_html(label: str, pistons: int | None = None, shaft: float | None = None) -> str:
    """The drawing for a class as HTML, to be colored by the page's style; where `cutaway_of` has none, of no part."""
    macro = template("cutaway.html.jinja").module.cutaway  # type: ignore[attr-defined]
    return "".join(macro(drawing) for drawing in cutaway_of(label, pistons, shaft) or (Cutaway("", pistons),))


def cutaway_of(label: str, pistons: int | None = None, shaft: float | None = None) -> tuple[Cutaway, ...]:
    """The drawing for a class; none for a healthy pump, or for a class whose part is not known."""
    part = label if label in _MARKS else propose_class(label) or ""
    return (Cutaway(part, pistons, shaft),) if part in _MARKS else ()
