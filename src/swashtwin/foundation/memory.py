"""Limits of memory, and how a process keeps and returns it."""

import ctypes
import os
import sys
from collections.abc import Callable
from functools import cache

from swashtwin.foundation.errors import DataError, InputError

MEMORY_VARIABLE = "SWASHTWIN_MEMORY_GB"
"""Environment variable that sets the memory limit of one file [GB]."""
_DEFAULT_LIMIT_GB = 4.0


# Parameters of mallopt, and the largest threshold that it accepts on 64 bits.
_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3
_MAX_THRESHOLD_BYTES = 1 << 25

# Value of MALLOC_TRIM_THRESHOLD_ that Dask sets for its workers.
_TRIM_THRESHOLD_OF_DASK = "65536"


def memory_limit() -> int:
    """Return the memory limit of one file's content [bytes]: 4 GB, or ``SWASHTWIN_MEMORY_GB``.

    Raises
    ------
    InputError
        The variable is not a positive number.
    """
    text = os.environ.get(MEMORY_VARIABLE, "").strip() or str(_DEFAULT_LIMIT_GB)
    try:
        gigabytes = float(text)
    except ValueError:
        gigabytes = 0.0
    if not 0 < gigabytes < 1e6:
        raise InputError(
            f"{MEMORY_VARIABLE} = {text[:40]!r} must be a positive number of gigabytes, such as 8."
        )
    return int(gigabytes * 1e9)


def require_memory(name: object, size: float, *, reason: str = "is read whole and takes") -> None:
    """Raise an error if content needs more memory than `memory_limit`, before it is allocated.

    Parameters
    ----------
    name : file or recording, the subject of the message.
    size : bytes that its header, or a request, requires.
    reason : predicate of the message, before the number.

    Raises
    ------
    DataError
        It exceeds the limit; the message holds both numbers and the variable that sets the limit.
    """
    limit = memory_limit()
    if size > limit:
        raise DataError(
            f"{name} {reason} {size / 1e9:.3g} GB, more than the limit of {limit / 1e9:.3g} GB; "
            f"if the file is right, set {MEMORY_VARIABLE}={max(1, round(1.3 * size / 1e9 + 0.5))}."
        )


@cache
def keep_freed_memory() -> None:
    """Let this process keep freed arrays of up to 32 MB for the next ones, about 60 MB in all.

    Linux's malloc gives them back to the system and asks for their pages anew. Thresholds that a
    user sets by variables stay (mallopt(3)), but not the one that Dask sets for its workers.
    Without glibc, nothing happens. `return_memory` gives back what is not needed.
    """
    trim_threshold = os.environ.get("MALLOC_TRIM_THRESHOLD_", _TRIM_THRESHOLD_OF_DASK)
    is_set_by_user = trim_threshold != _TRIM_THRESHOLD_OF_DASK
    set_option = _find_in_libc("mallopt")
    if set_option is None or is_set_by_user or "MALLOC_MMAP_THRESHOLD_" in os.environ:
        return
    if set_option(_M_MMAP_THRESHOLD, _MAX_THRESHOLD_BYTES):
        # Twice as much, as malloc sets it itself when the other threshold grows.
        set_option(_M_TRIM_THRESHOLD, 2 * _MAX_THRESHOLD_BYTES)


def return_memory() -> None:
    """Return freed memory to the system.

    A process that runs for days otherwise keeps it in ever smaller pieces. Without glibc's
    malloc_trim, nothing happens.
    """
    trim = _find_in_libc("malloc_trim")
    if trim is not None:
        trim(0)


def _find_in_libc(name: str) -> Callable[..., int] | None:
    """Return a function of the C library; None if it has none of this name."""
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), name, None)
