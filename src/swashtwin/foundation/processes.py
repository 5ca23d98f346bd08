"""Processes that work side by side and end with their parent; how many threads and how much memory
they take.
"""

import ctypes
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from swashtwin.foundation.errors import DataError, InputError

if TYPE_CHECKING:
    from joblib import Parallel

_SECONDS = 1.0
"""Between two looks at the parent."""


def parallel(jobs: int, **options: Any) -> "Parallel":
    """`joblib.Parallel` whose processes end when this process does, however it ends.

    Parameters
    ----------
    jobs : processes; 1 works in this process.
    options : of `joblib.Parallel`.
    """
    from joblib import Parallel  # which loads numpy, and the shell's help needs none

    return Parallel(
        n_jobs=jobs,
        backend="loky",
        initializer=exit_with_parent,
        initargs=(os.getpid(),),
        **options,
    )


def exit_with_parent(parent: int) -> None:
    """End this process once its parent has ended, whatever it does at that time.

    Parameters
    ----------
    parent : number of the process that started this process.
    """
    threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: int) -> None:
    if sys.platform == "win32":
        import _winapi

        try:
            handle = _winapi.OpenProcess(_winapi.SYNCHRONIZE, False, parent)
            _winapi.WaitForSingleObject(handle, _winapi.INFINITE)
        except OSError:
            pass  # it has ended
    else:
        while os.getppid() == parent:
            time.sleep(_SECONDS)
    os._exit(1)


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it this thread computes alone, since kernels this small only wait for each other
    (docs/explanation/method.md).

    Only the calling thread's number of OpenMP threads changes; that of the process and of other
    threads stays.
    """
    if (torch := sys.modules.get("torch")) is not None:
        torch.get_num_threads()  # torch sets up a new thread when it is first asked, which would undo the limit
    with threadpool_limits(limits=1, user_api="openmp"):
        yield


MEMORY_VARIABLE = "SWASHTWIN_MEMORY_GB"
"""Environment variable that sets the limit."""
_DEFAULT = 4.0
"""Limit without the variable [GB]."""


_FREED_BLOCK = (1 << 25) - (1 << 16)
"""Bytes, a little less than the most that malloc learns from."""


def keep_freed_memory() -> None:
    """Let this process keep freed arrays of up to 32 MB for the next ones.

    Linux's malloc gives them back to the system and asks for their pages anew. Freeing a block
    teaches it to keep as much (mallopt(3), M_MMAP_THRESHOLD). `return_memory` gives back what is
    not needed.
    """
    bytes(_FREED_BLOCK)


def memory_limit() -> int:
    """Bytes that the content of one file may take in memory: 4 GB, or what ``SWASHTWIN_MEMORY_GB``
    says.

    Raises
    ------
    InputError
        The variable holds no positive number.
    """
    text = os.environ.get(MEMORY_VARIABLE, "").strip() or str(_DEFAULT)
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
    """Refuse content of `size` bytes that would take more memory than `memory_limit`, before any is
    taken.

    Parameters
    ----------
    name : file or recording, the subject of the message.
    size : bytes that its header, or a request, asks for.
    reason : predicate of the message, before the number.

    Raises
    ------
    DataError
        It would; the message holds both numbers and the variable that raises the limit.
    """
    limit = memory_limit()
    if size > limit:
        raise DataError(
            f"{name} {reason} {size / 1e9:.3g} GB, more than the limit of {limit / 1e9:.3g} GB; "
            f"if the file is right, set {MEMORY_VARIABLE}={max(1, round(1.3 * size / 1e9 + 0.5))}."
        )


def return_memory() -> None:
    """Give freed memory back to the system, which a process of many days otherwise keeps in ever
    smaller pieces.

    Where the C library cannot (it is glibc's malloc_trim), nothing happens.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
