"""Slow down repeated wrong passwords."""

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

FREE_ATTEMPTS = 5
"""Wrong passwords in a row before the first wait."""
FIRST_WAIT_S = 2.0
"""Length of the first wait; each further wrong password doubles it."""
MAX_WAIT_S = 900.0
"""Longest wait, and how long a quiet key is remembered."""

# Doublings after which the wait has long been `MAX_WAIT_S`; it keeps the power finite.
_MAX_DOUBLINGS = 20

# Keys that are remembered; a stranger who invents names must not fill the memory.
_MAX_KEYS = 10_000


class Throttle:
    """Waits between attempts to log in, by key, such as an address or a user's name.

    Parameters
    ----------
    clock : returns the time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: OrderedDict[str, tuple[int, float]] = OrderedDict()
        self._lock = threading.Lock()

    def attempt(self, *keys: str) -> int:
        """Start an attempt, and return 0; or return the seconds to wait before the next one.

        An attempt counts as wrong until `succeed`. Guesses that arrive together therefore cannot
        all pass before the first of them is counted.
        """
        now = self._clock()
        with self._lock:
            wait = self._wait(keys, now)
            if wait:
                return wait

            for key in keys:
                count, failed_at = self._failures.pop(key, (0, now))
                if now - failed_at >= MAX_WAIT_S:
                    count = 0
                self._failures[key] = (count + 1, now)

            drop_oldest(self._failures, _MAX_KEYS)
            return 0

    def wait(self, *keys: str) -> int:
        """Return the whole seconds until the next attempt under all keys; 0 if none is needed."""
        with self._lock:
            return self._wait(keys, self._clock())

    def succeed(self, *keys: str) -> None:
        """Forget the failures under each key."""
        with self._lock:
            for key in keys:
                self._failures.pop(key, None)

    def _wait(self, keys: tuple[str, ...], now: float) -> int:
        waits = [math.ceil(self._blocked_until(key, now) - now) for key in keys]
        return max(0, *waits)

    def _blocked_until(self, key: str, now: float) -> float:
        count, failed_at = self._failures.get(key, (0, -math.inf))
        if count < FREE_ATTEMPTS:
            return now

        doublings = min(count - FREE_ATTEMPTS, _MAX_DOUBLINGS)
        return failed_at + min(FIRST_WAIT_S * 2.0**doublings, MAX_WAIT_S)


def drop_oldest(entries: OrderedDict[Any, Any], max_count: int) -> None:
    """Remove the oldest entries until at most `max_count` remain."""
    while len(entries) > max_count:
        entries.popitem(last=False)
