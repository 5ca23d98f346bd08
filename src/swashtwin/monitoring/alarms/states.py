"""When an alarm condition begins and ends: persistence, and hysteresis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

PERSISTENCE = 2
"""Recordings that must speak for an alarm, of the last `RECENT`."""
RECENT = 3
"""Recordings that persistence looks at."""
QUIET = 5
"""Recordings in a row that do not speak for the alarm, until its condition is over."""

Change = Literal["raised", "cleared"]
"""What happened to an alarm condition at a recording."""


@dataclass(frozen=True)
class Condition:
    """Whether an alarm condition holds, and what the last recordings said.

    That a raised alarm stands until a person acknowledged it is kept in the history.
    """

    is_active: bool = False
    """Whether it holds."""
    recent: Sequence[bool] = ()
    """Whether each of the last recordings spoke for it, the newest last, `RECENT` at most."""
    quiet: int = 0
    """Recordings in a row that did not speak for it, `QUIET` at most."""

    def after(self, is_large: bool, *, is_proven: bool = True) -> tuple["Condition", Change | None]:
        """(the condition after one more recording, what changed).

        Parameters
        ----------
        is_large : whether the recording speaks for the alarm.
        is_proven : whether the evidence of all recordings so far suffices to raise it.
        """
        recent = (*self.recent, is_large)[-RECENT:]
        quiet = 0 if is_large else min(self.quiet + 1, QUIET)
        if not self.is_active and is_proven and sum(recent) >= PERSISTENCE:
            return Condition(True, recent, quiet), "raised"
        if self.is_active and quiet == QUIET:
            return Condition(False, recent, quiet), "cleared"
        return Condition(self.is_active, recent, quiet), None
