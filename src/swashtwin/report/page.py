"""What a page is made of: cards, and sections of blocks (a text is a paragraph), which
`report.html.jinja` draws.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, ClassVar, Literal

from swashtwin.foundation import plural
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
    rows: tuple[tuple[Any, ...], ...]
    """Entries: cells, or what becomes the text of one."""

    @property
    def cells(self) -> list[list[Cell]]:
        """Every entry as a cell."""
        return [
            [entry if isinstance(entry, Cell) else Cell(str(entry)) for entry in row]
            for row in self.rows
        ]


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
    answer: tuple[str, ...] = ()
    """The result in plain words, shown first."""
    notice: str = ""
    """Warning that no reader may miss, or empty."""
    sections: tuple[Section, ...] = ()
    """Everything else."""
    results: dict[str, list[Any]] = field(default_factory=dict)
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


def iterate_drawings(blocks: tuple[Any, ...]) -> Iterator[Drawing]:
    """Every figure among the blocks, those in groups included."""
    for block in blocks:
        if isinstance(block, Drawing):
            yield block
        elif isinstance(block, Group):
            yield from iterate_drawings(block.blocks)


MOST_CARDS = 2
"""Subjects that each have a card; of more, a table says what came out."""


def build_cards(parts: Sequence[Part]) -> list[Part]:
    """What the first screen says of each subject, in the order of the parts: its parts as one, by a
    short title.
    """
    groups: dict[str, list[Part]] = {}
    for number, part in enumerate(parts):
        groups.setdefault(part.subject or f"part {number}", []).append(part)
    shared, cards = find_shared_facts([group[0] for group in groups.values()]), []
    for group in groups.values():
        first = group[0]
        differing = (f"{name.lower()} {value}" for name, value in first.facts if name not in shared)
        about = ", ".join([first.title, *differing]) if len(groups) > 1 else ""
        cards.append(
            replace(
                first,
                title="" if about == first.verdict else about,
                answer=tuple(text for part in group for text in part.answer),
                certainty=tuple(text for part in group for text in part.certainty),
                actions=tuple(dict.fromkeys(text for part in group for text in part.actions)),
                glance=tuple(block for part in group for block in part.glance),
                sections=tuple(section for part in group for section in part.sections),
            )
        )
    return cards


def find_shared_facts(parts: Sequence[Part]) -> dict[str, str]:
    """What all parts that state facts agree in."""
    stated = [dict(part.facts) for part in parts if part.facts]
    first = stated[0] if stated else {}
    return {
        name: value
        for name, value in first.items()
        if all(facts.get(name) == value for facts in stated)
    }


def build_overview(parts: Sequence[Part], cards: Sequence[Part]) -> Table | None:
    """Table of what came out for each subject, where there are many; None otherwise."""
    subjects = list(dict.fromkeys(part.subject for part in parts))
    if len(cards) <= MOST_CARDS or "" in subjects:
        return None
    firsts = [next(part for part in parts if part.subject == subject) for subject in subjects]
    names = list(dict.fromkeys(name for part in firsts for name, _ in part.facts if name != "File"))
    rows = [
        (part.subject, part.verdict, *(dict(part.facts).get(name, "—") for name in names),
         part.certainty[0] if part.certainty else " ".join(part.answer))
        for part in firsts
    ]  # fmt: skip
    caption = f"What came out for {plural(len(rows), 'recording')}; the details are below, each to be unfolded."
    return Table(
        caption, ("recording", "result", *(name.lower() for name in names), "how sure"), tuple(rows)
    )
