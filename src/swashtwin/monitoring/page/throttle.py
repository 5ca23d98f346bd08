"""Slow down repeated wrong passwords."""

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

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


class Origin(NamedTuple):
    """Who attempts to log in, and from where."""

    address: str
    """Address that the attempt comes from."""
    person: str
    """Digest of the name that was typed."""

    @property
    def keys(self) -> tuple[str, str]:
        """Keys under which wrong passwords are counted: the address, and the name."""
        return f"address {self.address}", f"name {self.person}"


class _Failures(NamedTuple):
    total: int
    """Wrong passwords."""
    failed_at: float
    """Time of the last one [s]."""


class Throttle:
    """Waits between attempts to log in, by address and by name.

    Failures are kept by origin under each key: a right password forgets what was typed under the
    same name at the same address, and nothing else. Otherwise somebody with a login could guess
    the passwords of others without end, by a login of his own after every few guesses.

    Parameters
    ----------
    clock : returns the time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: OrderedDict[str, dict[Origin, _Failures]] = OrderedDict()
        self._lock = threading.Lock()

    def attempt(self, origin: Origin, *keys: str) -> int:
        """Start an attempt, and return 0; or return the seconds to wait before the next one.

        An attempt counts as wrong until `succeed`. Guesses that arrive together therefore cannot
        all pass before the first of them is counted.

        Parameters
        ----------
        keys : those of `origin` under which the attempt counts.
        """
        now = self._clock()
        with self._lock:
            wait = self._wait(keys, now)
            if wait:
                return wait

            for key in keys:
                failures = self._failures.pop(key, {})
                if now - _last_failure(failures) >= MAX_WAIT_S:
                    failures = {}
                count = failures[origin].total if origin in failures else 0
                failures[origin] = _Failures(count + 1, now)
                self._failures[key] = failures

            drop_oldest(self._failures, _MAX_KEYS)
            return 0

    def wait(self, *keys: str) -> int:
        """Return the whole seconds until the next attempt under all keys; 0 if none is needed."""
        with self._lock:
            return self._wait(keys, self._clock())

    def succeed(self, origin: Origin) -> None:
        """Forget the failures of an origin; those of others under the same keys remain."""
        with self._lock:
            for key in origin.keys:
                failures = self._failures.get(key, {})
                failures.pop(origin, None)
                if not failures:
                    self._failures.pop(key, None)

    def _wait(self, keys: tuple[str, ...], now: float) -> int:
        waits = [math.ceil(self._blocked_until(key, now) - now) for key in keys]
        return max(0, *waits)

    def _blocked_until(self, key: str, now: float) -> float:
        failures = self._failures.get(key, {})
        count = sum(failure.total for failure in failures.values())
        if count < FREE_ATTEMPTS:
            return now

        doublings = min(count - FREE_ATTEMPTS, _MAX_DOUBLINGS)
        return _last_failure(failures) + min(FIRST_WAIT_S * 2.0**doublings, MAX_WAIT_S)


def _last_failure(failures: Mapping[Origin, _Failures]) -> float:
    return max((failure.failed_at for failure in failures.values()), default=-math.inf)


def drop_oldest(entries: OrderedDict[Any, Any], max_count: int) -> None:
    """Remove the oldest entries until at most `max_count` remain."""
    while len(entries) > max_count:
        entries.popitem(last=False)
