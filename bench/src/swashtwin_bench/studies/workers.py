"""Where a study's tasks run: processes of this machine, or a dask cluster.

A task is a plain function of its arguments and draws from streams of its own seed, so every backend gives the same
numbers. Results come back to the caller, who alone writes files: workers need no disk in common.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import torch
from joblib import Parallel, delayed, parallel_config

from swashtwin.foundation import InputError, MissingExtraError, keep_freed_memory, parallel

BACKENDS = ("joblib", "dask")
"""Backends of joblib that can run tasks."""


@dataclass(frozen=True)
class Workers:
    """How many tasks run side by side, and where."""

    jobs: int = 1
    """Processes of this machine; of a cluster at an address, whatever it has."""
    backend: str = "joblib"
    """``"joblib"`` or ``"dask"``."""
    address: str | None = None
    """Of a running cluster's scheduler; without one, dask starts `jobs` workers here."""

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise InputError(f"backend {self.backend!r} is none of {', '.join(BACKENDS)}.")
        if self.jobs < 1:
            raise InputError(f"jobs ({self.jobs}) must be at least 1.")
        if self.address is not None and self.backend == "joblib":
            raise InputError("an address belongs to backend dask; joblib's processes run on this machine.")

    @contextmanager
    def started(self) -> Iterator["Workers"]:
        """Within it the workers wait for `each`."""
        with ExitStack() as stack:
            if self.backend == "dask":
                stack.enter_context(_dask(self.jobs, self.address))
            yield self

    def each(self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """(index, result) of `function` for each tuple of arguments, as they come; only within `started`."""
        calls = [delayed(_call_with_index)(function, index, values) for index, values in enumerate(arguments)]
        if self.backend == "joblib":
            yield from parallel(self.jobs, return_as="generator_unordered")(calls)
        else:
            yield from Parallel(return_as="generator_unordered", pre_dispatch="all")(calls)


def _call_with_index(function: Callable[..., Any], index: int, values: tuple[Any, ...]) -> tuple[int, Any]:
    torch.set_num_threads(1)
    keep_freed_memory()  # a training asks for the same large tensors in each step
    return index, function(*values)


@contextmanager
def _dask(jobs: int, address: str | None) -> Iterator[None]:
    try:
        from distributed import Client, LocalCluster
    except ImportError as cause:
        raise MissingExtraError('backend dask needs pip install "swashtwin[dask]".') from cause
    with ExitStack() as stack:
        where: Any = address
        if address is None:
            local = LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
            where = stack.enter_context(local)
        try:
            client = stack.enter_context(Client(where, timeout=20))
        except (OSError, ValueError) as cause:
            raise InputError(f"no dask scheduler answers at {address}; give it as tcp://HOST:8786.") from cause
        threads = client.nthreads()
        if not threads or max(threads.values()) > 1:
            raise InputError(
                f"the dask cluster at {address} must have workers of one thread each, since training draws from the "
                "process's own random state; start them with: dask worker ADDRESS --nthreads 1"
            )
        stack.enter_context(parallel_config(backend="dask", n_jobs=-1))
        yield
