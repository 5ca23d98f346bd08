"""Parallel work in processes that end with their parent, and a limit of threads."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from threadpoolctl import get_cached_controller

from swashtwin.foundation.cluster import ambient_client, run_on_cluster
from swashtwin.foundation.memory import keep_freed_memory

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
        initializer=_prepare_process,
        initargs=(os.getpid(),),
        return_as="generator",
    )
    yield from processes(delayed(function)(*case) for case in cases)


def _prepare_process(parent: int) -> None:
    exit_with_parent(parent)
    keep_freed_memory()


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
    # Looked for anew only if another module has been loaded, which takes some milliseconds.
    with get_cached_controller().limit(limits=1, user_api="openmp"):
        yield
