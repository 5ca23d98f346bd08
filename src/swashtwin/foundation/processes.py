"""Processes that work side by side and end with the process that started them, and work on one thread."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from joblib import Parallel
from threadpoolctl import threadpool_limits

_SECONDS = 1.0
"""Between two looks at the parent."""


def parallel(jobs: int, **options: Any) -> Parallel:
    """`joblib.Parallel` whose processes end when this process does, however it ends.

    Parameters
    ----------
    jobs : processes; 1 works in this process.
    options : of `joblib.Parallel`.
    """
    return Parallel(n_jobs=jobs, backend="loky", initializer=end_with, initargs=(os.getpid(),), **options)


def end_with(parent: int) -> None:
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

    Only the calling thread's number of OpenMP threads changes; that of the process and of other threads stays.
    """
    if (torch := sys.modules.get("torch")) is not None:
        torch.get_num_threads()  # torch sets up a new thread when it is first asked, which would undo the limit
    with threadpool_limits(limits=1, user_api="openmp"):
        yield
