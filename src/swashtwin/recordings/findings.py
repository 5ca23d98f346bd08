"""What checks report about recordings."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from swashtwin.foundation import Spelling, render_settings, spell_for_index

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or worth knowing."""

    kind: str
    """Short name, such as ``"clipping"``."""
    severity: Severity
    """``error``: must not be used; ``warning``: look at it; ``note``: worth knowing."""
    channel: str | None
    """Channel that it concerns, or None if it concerns all."""
    message: str
    """Sentence with the numbers."""
    remedy: str = ""
    """Sentence that states what to do, with settings in braces (`foundation.render_settings`)."""

    def describe(self, spelling: Spelling = spell_for_index) -> str:
        """Return message and remedy, with settings spelled for the reader."""
        if not self.remedy:
            return self.message
        return f"{self.message} {render_settings(self.remedy, spelling)}"

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as a dict, with its remedy in the message."""
        return {
            "kind": self.kind,
            "severity": self.severity,
            "channel": self.channel,
            "message": self.describe(),
        }


FileNote = tuple[str, Finding]
"""Name of a file, empty if a note concerns several, and the note."""

# Notes of one kind that are listed; of more, the first is.
_MAX_NOTES_OF_KIND = 3


def join_names(names: Sequence[str], max_count: int = 3) -> str:
    """Return the first names, and how many more there are.

    Examples
    --------
    >>> join_names(["a", "b", "c", "d"])
    'a, b, c and 1 more'
    """
    text = ", ".join(names[:max_count])
    remaining = len(names) - max_count
    return f"{text} and {remaining} more" if remaining > 0 else text


def describe_others(count: int, names: Sequence[str] = ()) -> str:
    """Return what follows the first findings of a kind: where the others are, or their number.

    Parameters
    ----------
    count : number of the other findings.
    names : files or recordings that they concern; empty if each concerns several.

    Examples
    --------
    >>> describe_others(2, ["a.csv", "b.csv"]), describe_others(27)
    ('(Similar: a.csv, b.csv.)', '(Similar: 27 more.)')
    """
    return f"(Similar: {join_names(names) or f'{count} more'}.)"


def merge_notes(notes: Iterable[FileNote]) -> tuple[Finding, ...]:
    """Return one note for many of one kind: the first, and the files of the others."""
    groups: dict[str, dict[Finding, str]] = {}
    for file, note in notes:
        groups.setdefault(note.kind, {}).setdefault(note, file)

    merged: list[Finding] = []
    for group in groups.values():
        first, *others = group
        if len(group) <= _MAX_NOTES_OF_KIND:
            merged += group
        else:
            files = [group[note] for note in others if group[note]]
            suffix = describe_others(len(others), files)
            merged.append(replace(first, message=f"{first.message} {suffix}"))
    return tuple(merged)
