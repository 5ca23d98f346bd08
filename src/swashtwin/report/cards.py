"""The first screen of a page: a card for each subject, or a table where there are many."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from swashtwin.foundation import plural
from swashtwin.report.page import Bullets, Cell, Group, Paragraph, Part, Section, SectionOrder, Table, Tone

MOST_CARDS = 2
"""Subjects that each have a card; of more, a table says what came out."""


@dataclass(frozen=True, eq=False)
class Card:
    """What the first screen says of one subject."""

    about: str
    """What it is about; empty where the title says it."""
    verdict: str
    """The result in a few words."""
    tone: Tone
    """Whether that is good news."""
    answer: tuple[str, ...]
    """The result in plain words."""
    certainty: tuple[str, ...]
    """How sure it is."""
    actions: tuple[str, ...]
    """What to do."""
    glance: tuple[Any, ...]
    """Blocks right below."""


def cards_of(parts: Sequence[Part]) -> list[Card]:
    """A card for each subject, in the order of the parts."""
    groups: dict[str, list[Part]] = {}
    for number, part in enumerate(parts):
        groups.setdefault(part.subject or f"part {number}", []).append(part)
    firsts = [group[0] for group in groups.values()]
    stated = [dict(part.facts) for part in firsts if part.facts]
    first = stated[0] if stated else {}
    shared = {name for name, value in first.items() if all(facts.get(name) == value for facts in stated)}
    return [_card(group, shared, len(groups) > 1) for group in groups.values()]


def _card(parts: Sequence[Part], shared: Collection[str], is_named: bool) -> Card:
    first = parts[0]
    differing_facts = [f"{name.lower()} {value}" for name, value in first.facts if name not in shared]
    about = ", ".join([first.title, *differing_facts]) if is_named else ""
    return Card(
        "" if about == first.verdict else about,
        first.verdict,
        first.tone,
        tuple(text for part in parts for text in part.answer),
        tuple(text for part in parts for text in part.certainty),
        tuple(dict.fromkeys(text for part in parts for text in part.actions)),
        tuple(block for part in parts for block in part.glance),
    )


def overview_of(parts: Sequence[Part], cards: Sequence[Card]) -> Table | None:
    """Table of what came out for each subject, where there are many; None otherwise."""
    subjects = list(dict.fromkeys(part.subject for part in parts))
    if len(cards) <= MOST_CARDS or "" in subjects:
        return None
    firsts = [next(part for part in parts if part.subject == subject) for subject in subjects]
    names = list(dict.fromkeys(name for part in firsts for name, _ in part.facts if name != "File"))
    rows = [
        (
            Cell(part.subject),
            Cell(part.verdict),
            *(Cell(dict(part.facts).get(name, "—")) for name in names),
            Cell(part.certainty[0] if part.certainty else " ".join(part.answer)),
        )
        for part in firsts
    ]
    caption = f"What came out for {plural(len(rows), 'recording')}; the details are below, each to be unfolded."
    return Table(caption, ("recording", "result", *(name.lower() for name in names), "how sure"), tuple(rows))


def folded_section(parts: Sequence[Part], cards: Sequence[Card]) -> Section:
    """One section with a group for each of many subjects, folded away: its card and all of its sections."""
    groups = []
    for card, subject in zip(cards, dict.fromkeys(part.subject for part in parts), strict=True):
        sections = [section for part in parts if part.subject == subject for section in part.sections]
        blocks = (
            *map(Paragraph, card.answer),
            Bullets("How sure", card.certainty),
            Bullets("What to do", card.actions),
            *card.glance,
            *(Group(section.title, section.blocks) for section in sections),
        )
        groups.append(Group(f"{subject}: {card.verdict}", blocks, is_open=False))
    return Section(SectionOrder.VERDICT, "Each recording", tuple(groups))
