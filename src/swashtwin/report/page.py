"""What a page is made of: sections of blocks. `report.html.jinja` draws each kind of block."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from swashtwin.report.drawing import Drawing


@dataclass(frozen=True)
class Cell:
    """One entry of a table."""

    text: str
    """What stands there."""
    title: str = ""
    """What a reader sees who points at it, such as why there is no number."""


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
    """Remarks; the template draws nothing where there is none."""


@dataclass(frozen=True)
class Table:
    """Rows under a header; the first column names each row."""

    kind: ClassVar[str] = "table"
    caption: str
    """What it shows, and how to read it."""
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
    """What stands there when it is folded."""
    blocks: tuple[Any, ...]
    """Blocks of any other kind."""
    is_open: bool = True
    """Whether it starts unfolded; print shows it in either case."""


@dataclass(frozen=True, eq=False)
class Section:
    """Part of the page under one heading."""

    place: int
    """Where on the page: `VERDICT` first, `PROVENANCE` last."""
    title: str
    """Heading."""
    blocks: tuple[Any, ...]
    """Blocks, in order."""


VERDICT, SCORES, CALIBRATION, TRAINING, PROVENANCE = range(5)
"""Order of the sections, whatever the order of the items."""


@dataclass(frozen=True, eq=False)
class Part:
    """What one item adds to the page."""

    title: str
    """Title that a page of this item alone has."""
    answer: tuple[str, ...]
    """What came out, in plain words: it stands first."""
    notice: str
    """What no reader may miss; empty where there is nothing of the kind."""
    sections: tuple[Section, ...]
    """Everything else."""
    results: dict[str, list[Any]]
    """The same for machines, as JSON can hold it, by kind."""


def drawings(blocks: tuple[Any, ...]) -> Iterator[Drawing]:
    """Every figure among the blocks, those in groups included."""
    for block in blocks:
        if isinstance(block, Picture):
            yield block.drawing
        elif isinstance(block, Group):
            yield from drawings(block.blocks)
