"""Parallel work in processes that end with their parent, and limits of threads and memory."""

import ctypes
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from threadpoolctl import ThreadpoolController

from swashtwin.foundation.cluster import ambient_client, run_on_cluster
from swashtwin.foundation.errors import DataError, InputError

# Interval at which a process checks whether its parent is alive.
_POLL_INTERVAL_S = 1.0


def parallel(
    function: Callable[..., Any],
    cases: Sequence[tuple[Any, ...]],
    *,
    jobs: int = 1,
    files: Sequence[Path | None] = (),
    folder: Path | None = None,
) -> Iterator[Any]:
    """Yield the result of `function` for the arguments of each case, in their order.

    The processes end when this process does, however it ends. Within
    ``joblib.parallel_config("dask")``, or ``--cluster`` of a command, the workers of that cluster
    take their place. No other backend is taken from joblib: one that is active is often that of an
    outer loop.

    Parameters
    ----------
    function : function of a module, or a `functools.partial` of one. A cluster gets it once, so
        that large arguments that all cases share belong into a partial.
    cases : arguments of each call.
    jobs : number of processes; 1 to work in this process, -1 for one a core. A cluster works with
        all its workers.
    files : file of each case, which a worker of a cluster must see and errors name; None for a case
        without one.
    folder : folder into which the function writes, which a worker of a cluster must see.

    Raises
    ------
    ClusterError
        The cluster is gone, or a worker of it cannot do the work.
    """
    client = ambient_client()
    if client is not None:
        yield from run_on_cluster(client, function, cases, files, folder)
        return
    if jobs == 1:
        for case in cases:
            yield function(*case)
        return

    from joblib import Parallel, delayed  # which loads numpy, and the shell's help needs none

    processes = Parallel(
        n_jobs=jobs,
        backend="loky",
        initializer=exit_with_parent,
        initargs=(os.getpid(),),
        return_as="generator",
    )
    yield from processes(delayed(function)(*case) for case in cases)


def exit_with_parent(parent: int) -> None:
    """End this process once its parent has ended, whatever it does at that time.

    Parameters
    ----------
    parent : id of the process that started this process.
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
            time.sleep(_POLL_INTERVAL_S)
    os._exit(1)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit the calling thread to one OpenMP thread within the block.

    Kernels as small as ours are slower on several threads, which wait for each other
    (docs/explanation/method.md). The number of threads of the process and of other threads stays.
    """
    torch = sys.modules.get("torch")
    if torch is not None:
        # On its first use in a thread torch sets the number of threads, which would undo the limit.
        torch.get_num_threads()
    loaded = frozenset(_OPENMP_PACKAGES & sys.modules.keys())
    with _thread_pools(loaded).limit(limits=1, user_api="openmp"):
        yield


# Packages that load an OpenMP library.
_OPENMP_PACKAGES = {"torch", "sklearn", "numba"}


@lru_cache(maxsize=8)
def _thread_pools(_: frozenset[str]) -> ThreadpoolController:
    """Return the thread pools of the loaded packages; to find them takes some milliseconds."""
    return ThreadpoolController()


MEMORY_VARIABLE = "SWASHTWIN_MEMORY_GB"
"""Environment variable that sets the memory limit of one file [GB]."""
_DEFAULT_LIMIT_GB = 4.0


# Slightly below the largest block that changes malloc's threshold.
_FREED_BLOCK_BYTES = (1 << 25) - (1 << 16)


def keep_freed_memory() -> None:
    """Let this process keep freed arrays of up to 32 MB for the next ones.

    Linux's malloc gives them back to the system and asks for their pages anew. Freeing a block
    teaches it to keep as much (mallopt(3), M_MMAP_THRESHOLD). `return_memory` gives back what is
    not needed.
    """
    bytes(_FREED_BLOCK_BYTES)


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


def return_memory() -> None:
    """Return freed memory to the system.

    A process that runs for days otherwise keeps it in ever smaller pieces. Without glibc's
    malloc_trim, nothing happens.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
