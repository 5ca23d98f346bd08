"""Processes that work side by side and end with the process that started them."""

import os
import sys
import threading
import time
from typing import Any

from joblib import Parallel

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
