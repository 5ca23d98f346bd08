"""What a page is made of: sections of blocks. `report.html.jinja` draws each kind of block."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Literal

from swashtwin.report.drawing import Drawing

Tone = Literal["good", "bad", "unsure", "plain"]


@dataclass(frozen=True)
class Cell:
    """One entry of a table."""

    text: str
    """Text of the cell."""
    title: str = ""
    """Tooltip, such as the reason for a missing number."""


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    kind: ClassVar[str] = "paragraph"
    text: str
    """The text."""


@dataclass(frozen=True)
class Bullets:
    """Short remarks under one heading."""

    kind: ClassVar[str] = "bullets"
    title: str
    """Heading."""
    items: tuple[str, ...]
    """Remarks; without any, the template draws nothing."""


@dataclass(frozen=True)
class Table:
    """Rows under a header; the first column names each row."""

    kind: ClassVar[str] = "table"
    caption: str
    """What the table shows, and how to read it."""
    header: tuple[str, ...]
    """Names of the columns."""
    rows: tuple[tuple[Cell, ...], ...]
    """Entries."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure, inlined."""

    kind: ClassVar[str] = "picture"
    drawing: Drawing
    """The figure and its data."""


@dataclass(frozen=True, eq=False)
class Group:
    """Blocks that can be folded away."""

    kind: ClassVar[str] = "group"
    title: str
    """Text shown when it is folded."""
    blocks: tuple[Any, ...]
    """Blocks of any other kind."""
    is_open: bool = True
    """Whether it starts unfolded; print leaves out what is folded away."""


class SectionOrder(IntEnum):
    """Position of a section on the page, whatever the order of the items."""

    VERDICT = 0
    SCORES = 1
    CALIBRATION = 2
    TRAINING = 3
    PROVENANCE = 4


@dataclass(frozen=True, eq=False)
class Section:
    """Part of the page under one heading."""

    position: SectionOrder
    """Position on the page."""
    title: str
    """Heading."""
    blocks: tuple[Any, ...]
    """Blocks, in order."""


@dataclass(frozen=True, eq=False)
class Part:
    """Content of one item on the page."""

    title: str
    """Title of a page with this item alone."""
    answer: tuple[str, ...]
    """The result in plain words, shown first."""
    notice: str
    """Warning that no reader may miss, or empty."""
    sections: tuple[Section, ...]
    """Everything else."""
    results: dict[str, list[Any]]
    """The same as JSON values, by kind."""
    verdict: str = ""
    """The result in a few words, in large type."""
    tone: Tone = "plain"
    """Whether that is good news."""
    certainty: tuple[str, ...] = ()
    """How sure it is."""
    actions: tuple[str, ...] = ()
    """What to do."""
    glance: tuple[Any, ...] = ()
    """Blocks right below: what a reader wants to see at a glance."""
    subject: str = ""
    """What it is about, such as a recording; parts of one subject share a card."""
    facts: tuple[tuple[str, str], ...] = ()
    """What stands below the title: machine, date, condition, file; by name."""


def drawings(blocks: tuple[Any, ...]) -> Iterator[Drawing]:
    """Every figure among the blocks, those in groups included."""
    for block in blocks:
        if isinstance(block, Picture):
            yield block.drawing
        elif isinstance(block, Group):
            yield from drawings(block.blocks)
