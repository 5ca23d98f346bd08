"""Slow down repeated wrong passwords."""

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

FREE_ATTEMPTS = 5
"""Wrong passwords in a row before the first wait."""
FIRST_WAIT = 2.0
"""Length of the first wait [s]; each further wrong password doubles it."""
LONGEST_WAIT = 900.0
"""Longest wait [s], and how long a quiet key is remembered."""
_MOST_KEYS = 10_000


class Throttle:
    """Fewer and fewer attempts to log in after wrong passwords, by key, such as an address or a
    user's name.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: OrderedDict[str, tuple[int, float]] = OrderedDict()
        self._lock = threading.Lock()

    def attempt(self, *keys: str) -> int:
        """Whole seconds until the next attempt; 0 where one is made now, which counts as wrong
        until `succeed`.

        So guesses that come at the same time do not all pass before the first is counted.
        """
        now = self._clock()
        with self._lock:
            wait = max(0, *(math.ceil(self._until(key, now) - now) for key in keys))
            if not wait:
                for key in keys:
                    count, last = self._failures.pop(key, (0, now))
                    self._failures[key] = (count + 1 if now - last < LONGEST_WAIT else 1, now)
                drop_oldest(self._failures, _MOST_KEYS)
            return wait

    def wait(self, *keys: str) -> int:
        """Whole seconds until the next attempt under all of these keys; 0 where it may be made
        now.
        """
        now = self._clock()
        with self._lock:
            return max(0, *(math.ceil(self._until(key, now) - now) for key in keys))

    def succeed(self, *keys: str) -> None:
        """Forget the failures under each key."""
        with self._lock:
            for key in keys:
                self._failures.pop(key, None)

    def _until(self, key: str, now: float) -> float:
        count, last = self._failures.get(key, (0, -math.inf))
        if count < FREE_ATTEMPTS:
            return now
        return last + min(FIRST_WAIT * 2.0 ** min(count - FREE_ATTEMPTS, 20), LONGEST_WAIT)


def drop_oldest(entries: OrderedDict[Any, Any], count: int) -> None:
    """Remove the oldest entries until `count` remain."""
    while len(entries) > count:
        entries.popitem(last=False)
