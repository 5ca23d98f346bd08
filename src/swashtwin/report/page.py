"""What a page is made of: cards, and sections of blocks, which `report.html.jinja` draws.

A block that is a text is a paragraph.
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


def _as_cell(entry: Any) -> Cell:
    if isinstance(entry, Cell):
        return entry
    return Cell(str(entry))


@dataclass(frozen=True)
class Bullets:
    """Short remarks under one heading."""

    kind: ClassVar[str] = "bullets"
    title: str
    """Heading."""
    items: tuple[str, ...]
    """Remarks; if there are none, the template draws nothing."""


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
        return [[_as_cell(entry) for entry in row] for row in self.rows]


@dataclass(frozen=True, eq=False)
class Group:
    """Blocks that can be folded away."""

    kind: ClassVar[str] = "group"
    title: str
    """Text shown when the group is folded."""
    blocks: tuple[Any, ...]
    """Blocks of any other kind."""
    is_open: bool = True
    """Whether it starts unfolded; print omits what is folded."""


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
    urgency: str = ""
    """How soon something must be done."""
    certainty: tuple[str, ...] = ()
    """How sure it is."""
    actions: tuple[str, ...] = ()
    """What to do."""
    glance: tuple[Any, ...] = ()
    """Blocks right below: what a reader wants to see at a glance."""
    subject: str = ""
    """What it is about, such as a recording; parts of one subject share a card."""
    facts: tuple[tuple[str, str], ...] = ()
    """Facts below the title, by name: machine, date, condition, file."""


def iterate_drawings(blocks: tuple[Any, ...]) -> Iterator[Drawing]:
    """Yield every figure among the blocks, those in groups included."""
    for block in blocks:
        if isinstance(block, Drawing):
            yield block
        elif isinstance(block, Group):
            yield from iterate_drawings(block.blocks)


MAX_CARDS = 2
"""Subjects that each have a card; the results of more are shown in a table."""


def build_cards(parts: Sequence[Part]) -> list[Part]:
    """Return what the first screen shows of each subject, in the order of the parts.

    The parts of a subject become one, with a short title.
    """
    groups: dict[str, list[Part]] = {}
    for index, part in enumerate(parts):
        groups.setdefault(part.subject or f"part {index}", []).append(part)
    shared = find_shared_facts([group[0] for group in groups.values()])

    cards = []
    for group in groups.values():
        first = group[0]
        title = ""
        if len(groups) > 1:
            differing = [
                f"{name.lower()} {value}" for name, value in first.facts if name not in shared
            ]
            title = ", ".join([first.title, *differing])
        cards.append(_merge_parts(group, title="" if title == first.verdict else title))
    return cards


def _merge_parts(group: Sequence[Part], title: str) -> Part:
    """Return the parts of one subject as one part."""
    answer: list[str] = []
    certainty: list[str] = []
    actions: list[str] = []
    glance: list[Any] = []
    sections: list[Section] = []
    for part in group:
        answer += part.answer
        certainty += part.certainty
        actions += part.actions
        glance += part.glance
        sections += part.sections

    # several parts of one subject may recommend the same action
    return replace(
        group[0],
        title=title,
        answer=tuple(answer),
        certainty=tuple(certainty),
        actions=tuple(dict.fromkeys(actions)),
        glance=tuple(glance),
        sections=tuple(sections),
    )


def find_shared_facts(parts: Sequence[Part]) -> dict[str, str]:
    """Return the facts in which all parts that have facts agree."""
    tables = [dict(part.facts) for part in parts if part.facts]
    if not tables:
        return {}
    return {
        name: value
        for name, value in tables[0].items()
        if all(table.get(name) == value for table in tables)
    }


def build_overview(parts: Sequence[Part], cards: Sequence[Part]) -> Table | None:
    """Return a table of the results of all subjects if there are many; `None` otherwise."""
    subjects = list(dict.fromkeys(part.subject for part in parts))
    if len(cards) <= MAX_CARDS or "" in subjects:
        return None

    first_parts = [next(part for part in parts if part.subject == subject) for subject in subjects]
    fact_names: dict[str, None] = {}
    for part in first_parts:
        fact_names |= {name: None for name, _ in part.facts if name != "File"}

    rows = []
    for part in first_parts:
        facts = dict(part.facts)
        certainty = part.certainty[0] if part.certainty else " ".join(part.answer)
        values = (facts.get(name, "—") for name in fact_names)
        rows.append((part.subject, part.verdict, *values, certainty))
    caption = f"Results of {plural(len(rows), 'recording')}; unfold the details below."
    header = ("recording", "result", *(name.lower() for name in fact_names), "how sure")
    return Table(caption, header, tuple(rows))
