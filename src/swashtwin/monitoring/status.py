"""How a watch and its sources are doing: what the service fills and the page shows."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from swashtwin.foundation import escape_controls

MAX_PROBLEM_LENGTH = 300
"""Characters of a problem; a server's answer may be much longer."""


class SourceStatus:
    """Whether a source works, and what it delivered.

    The thread of the source writes, any thread reads.
    """

    def __init__(self, name: str, kind: str) -> None:
        self.name = name
        self.kind = kind
        self.received = 0
        """Recordings that the source delivered since the start."""
        self.problem: str | None = None
        """What is wrong, in one line; None while the source works."""

    def succeed(self, count: int = 0) -> None:
        """Record that the source works, and that it delivered `count` more recordings."""
        self.received += count
        self.problem = None

    def fail(self, problem: str) -> None:
        """Record why the source cannot be reached, or why its recordings cannot be taken."""
        self.problem = escape_controls(problem)[:MAX_PROBLEM_LENGTH]


@dataclass(frozen=True)
class WatchStatus:
    """How a watch is doing."""

    started: datetime
    """When the watch started (UTC)."""
    waiting: int
    """Recordings that arrived and are not judged yet."""
    outbox: int
    """Messages that are not sent yet."""
    sources: tuple[SourceStatus, ...]
    """Status of each source."""
    free_bytes: int
    """Free space on the disk of the watch's folder."""
    counters: Mapping[str, float]
    """Counts since the start: ``judged``, ``rejected``, ``failures`` (recordings that an internal
    error stopped), and ``seconds_judging`` (processor time).
    """
    problems: tuple[str, ...] = ()
    """What keeps the watch from working, one line each; empty if all is well."""
