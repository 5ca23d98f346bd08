"""Fewer and fewer attempts to log in after wrong passwords."""

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

FREE_ATTEMPTS = 5
"""Wrong passwords in a row before the first wait."""
FIRST_WAIT = 2.0
"""Length of the first wait [s]; each further wrong password doubles it."""
LONGEST_WAIT = 900.0
"""Longest wait [s], and how long a quiet key is remembered."""
_MOST_KEYS = 10_000


@dataclass
class Throttle:
    """Counts failures by key, such as an address or a user's name, in bounded memory."""

    clock: Callable[[], float] = time.monotonic
    """Time [s]."""
    _failures: OrderedDict[str, tuple[int, float]] = field(default_factory=OrderedDict, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def wait(self, *keys: str) -> int:
        """Whole seconds until the next attempt under all of these keys; 0 where it may be made now."""
        now = self.clock()
        with self._lock:
            return max(0, *(math.ceil(self._until(key, now) - now) for key in keys))

    def _until(self, key: str, now: float) -> float:
        count, last = self._failures.get(key, (0, -math.inf))
        if count < FREE_ATTEMPTS:
            return now
        return last + min(FIRST_WAIT * 2.0 ** min(count - FREE_ATTEMPTS, 20), LONGEST_WAIT)

    def fail(self, *keys: str) -> None:
        """Count a wrong password under each key."""
        now = self.clock()
        with self._lock:
            for key in keys:
                count, last = self._failures.pop(key, (0, now))
                self._failures[key] = (count + 1 if now - last < LONGEST_WAIT else 1, now)
            while len(self._failures) > _MOST_KEYS:
                self._failures.popitem(last=False)

    def succeed(self, *keys: str) -> None:
        """Forget the failures under each key."""
        with self._lock:
            for key in keys:
                self._failures.pop(key, None)
