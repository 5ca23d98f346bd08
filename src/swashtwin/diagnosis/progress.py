"""Report how much of a long computation on recordings is finished."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias, TypeVar

Progress: TypeAlias = Callable[[int, int, str], None]
"""Called with the number of finished units of an activity, their total, and its name."""

T = TypeVar("T")


def ignore_progress(count: int, total: int, activity: str) -> None:
    """Report to nobody."""


def iterate(entries: Sequence[T], progress: Progress, activity: str) -> Iterator[T]:
    """Yield the entries, and report each one when the next is taken, or the last has ended."""
    for count, entry in enumerate(entries, start=1):
        yield entry
        progress(count, len(entries), activity)
