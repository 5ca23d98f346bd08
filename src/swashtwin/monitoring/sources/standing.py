"""How a source is doing, for the page and for other tools."""

from swashtwin.foundation import escape_controls

_LONGEST = 300


class Standing:
    """Whether a source is reached, and what it delivered; its own thread writes, any thread reads."""

    def __init__(self, name: str, kind: str) -> None:
        self.name = name
        self.kind = kind
        self.received = 0
        """Recordings that it delivered since the start."""
        self.problem: str | None = None
        """What is wrong, in one line; None while it works."""

    def succeed(self, count: int = 0) -> None:
        """It is reached, and delivered `count` more."""
        self.received += count
        self.problem = None

    def fail(self, problem: str) -> None:
        """It is not reached, or what it has cannot be taken."""
        self.problem = escape_controls(problem)[:_LONGEST]
