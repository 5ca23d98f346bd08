"""What is told of an alarm, to people and to programs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from swashtwin.foundation import escape_controls


@dataclass(frozen=True)
class AlarmMessage:
    """One message; a receiver that gets it twice sees so by its `identity`."""

    machine: str
    """Name of the machine."""
    point: str
    """Name of the operating point."""
    kind: str
    """Alarm of the ``pump`` or of a ``sensor``."""
    event: str
    """What happened to the alarm: ``opened``, ``cleared`` or ``closed``."""
    time: str
    """When, ISO 8601 in UTC."""
    identity: str
    """Unique for each message, such as ``alarm-17-opened``."""
    reasons: Sequence[str] = ()
    """What moved or what is wrong, in sentences."""
    link: str | None = None
    """Address of the alarm on the page."""

    @property
    def title(self) -> str:
        """The message in a few words, on one line.

        Examples
        --------
        >>> AlarmMessage("pump-1", "860 rpm, 10 MPa", "pump", "opened", "2026-01-02T03:04:05+00:00", "1").title
        'pump-1: pump alarm opened (860 rpm, 10 MPa)'
        """
        return escape_controls(f"{self.machine}: {self.kind} alarm {self.event} ({self.point})")

    @property
    def text(self) -> str:
        """The message in lines, for a person."""
        lines = [self.title, f"Time: {self.time}", *(f"- {reason}" for reason in self.reasons), self.link or ""]
        return "\n".join(escape_controls(line) for line in lines if line) + "\n"

    @property
    def line(self) -> str:
        """The message on one line, for a log."""
        return escape_controls(" ".join([self.time, f"{self.title}.", *self.reasons, self.link or ""]).rstrip())

    @property
    def reference(self) -> str:
        """`identity` in characters that a mail's header allows."""
        return re.sub(r"[^\w.-]", "-", self.identity, flags=re.ASCII)
