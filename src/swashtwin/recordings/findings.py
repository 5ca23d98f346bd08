"""What checks report about recordings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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
