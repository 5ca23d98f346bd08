"""Batch work on a Dask cluster, whose workers may run on other computers.

joblib has a backend for Dask, whose client is used here, but not its scheduling: it stores a large
argument on one worker, so that it is lost with that worker, and it takes a cancelled task for one
that has a result.
"""

import asyncio
import logging
import os
import platform
import sys
import tempfile
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from swashtwin.foundation.errors import ClusterError, MissingFileError, SwashTwinError
from swashtwin.foundation.memory import keep_freed_memory
from swashtwin.foundation.packages import VERSION, load_extra

# Time in which a scheduler, and all workers, must answer.
_ANSWER_TIMEOUT_S = 30.0
# Time in which a first worker must appear: clusters that adapt have none at rest. Also the time
# without any worker after which work is given up.
_WORKER_TIMEOUT_S = 60.0
# Interval at which the cluster is checked while a task runs.
_CHECK_INTERVAL_S = 5.0

# Tasks that each worker has in advance, so that it never waits. Their results wait in its memory.
_TASKS_PER_WORKER = 8

# Packages whose versions decide the last bits of a result.
_NUMERICAL_PACKAGES = ("numpy", "scipy", "scikit-learn", "numba", "torch")

_PAGE = "docs/how-to/cluster.md"
_SAME_PATHS = (
    "Files are named by paths: mount their folder at the same path on each computer, and start "
    "the workers again."
)


@contextmanager
def use_cluster(address: str | None) -> Iterator[None]:
    """Let `parallel` run its tasks on a cluster within the block.

    Parameters
    ----------
    address : address of its scheduler, such as ``"tcp://10.0.0.5:8786"``; None for this computer.

    Raises
    ------
    ClusterError
        The address is invalid, no scheduler answers, or a worker cannot do the work.
    MissingExtraError
        Dask is not installed.
    """
    if address is None:
        yield
        return

    _require_address(address)
    distributed = load_extra("distributed", "cluster", "work on a cluster")
    _silence_logs()
    client = _connect(distributed, address)
    try:
        _require_workers(client)
        from joblib import parallel_config

        with parallel_config("dask", client=client):
            yield
    finally:
        # A cluster that is gone cannot say goodbye.
        with suppress(Exception):
            client.close(timeout=_CHECK_INTERVAL_S)


def _require_address(address: str) -> None:
    try:
        parts = urlsplit(address)
        is_valid = parts.scheme in ("tcp", "tls") and bool(parts.hostname and parts.port)
    except ValueError:  # the port is not a number
        is_valid = False
    if not is_valid:
        raise ClusterError(
            f"Invalid address of a cluster {address!r}: must be tcp://HOST:PORT, such as "
            "tcp://10.0.0.5:8786.",
            field="cluster",
        )


def _silence_logs() -> None:
    """Let only errors of this module state what is wrong, not Dask's log too."""
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _connect(distributed: Any, address: str) -> Any:
    try:
        # A client would wait without end for a program that accepts connections and is silent.
        asyncio.run(asyncio.wait_for(_greet(address), _ANSWER_TIMEOUT_S))
        with warnings.catch_warnings():
            # Of versions that differ, which `_require_workers` checks.
            warnings.simplefilter("ignore")
            return distributed.Client(address, timeout=_ANSWER_TIMEOUT_S, set_as_default=False)
    except Exception as cause:  # also what another program than a scheduler answers
        remedy = "Start it with: dask scheduler; or check the address and the firewall."
        if address.startswith("tls:"):
            remedy = f"tls:// requires certificates in the configuration of Dask, too ({_PAGE})."
        raise ClusterError(
            f"No Dask scheduler answers at {address} ({type(cause).__name__}). {remedy}",
            field="cluster",
        ) from cause


async def _greet(address: str) -> None:
    from distributed.comm.core import connect
    from distributed.security import Security

    comm = await connect(
        address, timeout=_ANSWER_TIMEOUT_S, **Security().get_connection_args("client")
    )
    comm.abort()


def _call(client: Any, method: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Return what a method of the client returns, which must not take longer than the timeout."""
    try:
        return method(*arguments, callback_timeout=_ANSWER_TIMEOUT_S, **options)
    except Exception as cause:
        raise _lost_cluster(client) from cause


def _lost_cluster(client: Any) -> ClusterError:
    return ClusterError(
        f"The Dask scheduler {_address_of(client)} is gone or does not answer. Start it and its "
        "workers again, then repeat the command: finished parts that it keeps are not computed "
        "again.",
        field="cluster",
    )


def _address_of(client: Any) -> str:
    return str(getattr(client.scheduler, "address", ""))


# ---- what workers must have


def _require_workers(client: Any) -> int:
    """Return the number of workers, each of which can do the work with the same result."""
    expected = _describe_environment()
    deadline = time.monotonic() + _WORKER_TIMEOUT_S
    answers: dict[str, Any] = {}
    while not answers:
        if time.monotonic() > deadline:
            raise _no_worker(client)
        answers = _call(client, client.run, _describe_environment, on_error="return")
        if not answers:
            time.sleep(0.2)

    for worker, answer in answers.items():
        if isinstance(answer, ModuleNotFoundError):
            raise ClusterError(
                f"Worker {worker} has no {answer.name}. Install it there and start the worker "
                f'again: pip install "swashtwin[all]=={VERSION}".',
                field="cluster",
            )
        if isinstance(answer, Exception):
            raise ClusterError(
                f"Worker {worker} cannot run swashtwin ({type(answer).__name__}: {answer}).",
                field="cluster",
            ) from answer
        _require_environment(worker, answer, expected)
    return len(answers)


def _no_worker(client: Any) -> ClusterError:
    address = _address_of(client)
    return ClusterError(
        f"The Dask scheduler {address} has had no worker for {_WORKER_TIMEOUT_S:.0f} s. Start "
        f"workers of one thread on each computer, with this address ({_PAGE}).",
        field="cluster",
    )


def _describe_environment(dask_worker: Any = None) -> dict[str, str]:
    """Return the versions that decide a result, and the threads of a worker.

    Parameters
    ----------
    dask_worker : the worker that runs it, which Dask passes.
    """
    environment = dict(_versions_here())
    if dask_worker is not None:
        environment["threads"] = str(dask_worker.state.nthreads)
    return environment


@cache
def _versions_here() -> dict[str, str]:
    """Return the versions of this process, which each task of a worker compares."""
    versions = {
        "swashtwin": VERSION,
        "Python": ".".join(platform.python_version_tuple()[:2]),
    }
    for package in _NUMERICAL_PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return versions


def _require_environment(
    worker: str, environment: Mapping[str, str], expected: Mapping[str, str]
) -> None:
    for package, expected_version in expected.items():
        if environment.get(package) == expected_version:
            continue
        remedy = "Install the same version there"
        if package != "Python":
            remedy += f': pip install "{package}=={expected_version}"'
        raise ClusterError(
            f"Worker {worker} has {package} {environment.get(package, 'missing')}, and this "
            f"computer {expected_version}: results could differ. {remedy}, and start the worker "
            "again.",
            field="cluster",
        )

    # Numpy, torch and readers hold settings of the whole process while a task runs.
    if environment["threads"] != "1":
        raise ClusterError(
            f"Worker {worker} has {environment['threads']} threads, but a process runs one task at "
            f"a time. Start it again with one thread ({_PAGE}).",
            field="cluster",
        )


def _require_visible(client: Any, files: Sequence[Path | None], folder: Path | None) -> None:
    """Require that workers see one file of each folder, and a new file in `folder`."""
    first_files: dict[Path, Path] = {}
    for file in files:
        if file is not None:
            first_files.setdefault(file.parent, file)

    with nullcontext() if folder is None else _probe_file(folder) as probe:
        sizes = {str(file.absolute()): _size_of(file) for file in first_files.values()}
        if probe is not None:
            sizes[probe] = _size_of(Path(probe))
        if not sizes:
            return
        answers = _call(client, client.run, _find_invisible, sizes, on_error="return")

    for worker, path in answers.items():
        if isinstance(path, Exception):
            raise ClusterError(
                f"Worker {worker} cannot look for files ({type(path).__name__}: {path}).",
                field="cluster",
            ) from path
        if path is not None:
            shown_path = folder if path == probe else path
            raise ClusterError(
                f"Worker {worker} does not see {shown_path} as this computer does. {_SAME_PATHS}",
                field="cluster",
            )


@contextmanager
def _probe_file(folder: Path) -> Iterator[str]:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=folder.absolute(), prefix=".cluster-") as file:
        yield file.name


def _find_invisible(sizes: Mapping[str, int | None]) -> str | None:
    """Return the first file that has another size on this computer, or is not there."""
    for path, size in sizes.items():
        if _size_of(Path(path)) != size:
            return path
    return None


def _size_of(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None


# ---- the work


def run_on_cluster(
    client: Any,
    function: Callable[..., Any],
    cases: Sequence[tuple[Any, ...]],
    files: Sequence[Path | None] = (),
    folder: Path | None = None,
) -> Iterator[Any]:
    """Yield the result of `function` for the arguments of each case, in their order.

    A task whose worker dies runs again on another worker. A worker runs one task at a time.

    Parameters
    ----------
    client : Dask's client of the cluster.
    function, cases, files, folder : see `swashtwin.foundation.parallel`.

    Raises
    ------
    ClusterError
        The scheduler or all workers are gone, a worker cannot do the work or does not see a file,
        or a task ends each worker that runs it.
    RuntimeError
        A task failed with an error that is not one of ours; the message names its file.
    """
    from distributed.protocol.pickle import dumps, loads

    expected = _describe_environment()
    n_ahead = _TASKS_PER_WORKER * _require_workers(client)
    _require_visible(client, files, folder)

    # A task returns the function, so that Dask computes it again if the worker that has it dies.
    shared_function = _submit(client, loads, dumps(function))
    waiting: deque[tuple[str, Any]] = deque()
    for number, case in enumerate(cases):
        file = files[number] if files else None
        name = str(file or f"task {number + 1} of {len(cases)}")
        # Dask would search the arguments for tasks and futures: it gets them pickled.
        future = _submit(client, _run_task, shared_function, dumps(case), file, expected)
        waiting.append((name, future))
        if len(waiting) >= n_ahead:
            yield loads(_result(client, *waiting.popleft()))
    while waiting:
        yield loads(_result(client, *waiting.popleft()))


def _submit(client: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    try:
        with warnings.catch_warnings():
            # A model or a recording in memory may be large; it is sent once.
            warnings.filterwarnings("ignore", message="Sending large graph")
            # pure: equal arguments must not return the result of an earlier task
            return client.submit(function, *arguments, pure=False)
    except Exception as cause:
        if client.status == "running":
            raise
        raise _lost_cluster(client) from cause


def _run_task(
    function: Callable[..., Any],
    case: bytes,
    file: Path | None,
    expected: Mapping[str, str],
) -> bytes:
    """Return the pickled result of one task; runs on a worker.

    Parameters
    ----------
    expected : versions that decide a result, of the computer that gives the task.
    """
    from distributed import get_worker
    from distributed.protocol.pickle import dumps, loads

    dask_worker = get_worker()
    worker = dask_worker.address
    # This worker may have come after the others were checked.
    _require_environment(worker, _describe_environment(dask_worker), expected)
    if file is not None and not os.path.lexists(file):
        raise ClusterError(f"Worker {worker} does not see {file}. {_SAME_PATHS}", field="cluster")

    keep_freed_memory()
    try:
        result: bytes = dumps(function(*loads(case)))
    except MissingFileError as cause:
        raise ClusterError(f"Worker {worker}: {cause} {_SAME_PATHS}", field="cluster") from cause
    return result


def _result(client: Any, name: str, future: Any) -> bytes:
    """Return the pickled result of a task, as soon as it has one.

    Parameters
    ----------
    name : file of the task, for errors.
    """
    last_seen = time.monotonic()
    while True:
        try:
            result: bytes = future.result(timeout=_CHECK_INTERVAL_S)
            return result
        except Exception as cause:
            is_unfinished = isinstance(cause, TimeoutError) and future.status != "error"
            if not is_unfinished:
                failure = _describe_failure(client, name, future, cause)
                raise failure from (None if failure is cause else cause)

        if _call(client, client.nthreads):
            last_seen = time.monotonic()
        elif time.monotonic() - last_seen > _WORKER_TIMEOUT_S:
            raise _no_worker(client)


def _describe_failure(client: Any, name: str, future: Any, cause: Exception) -> Exception:
    """Return the error of a task that failed with `cause`."""
    from distributed.scheduler import KilledWorker

    if isinstance(cause, SwashTwinError):
        return cause
    if isinstance(cause, KilledWorker):
        return ClusterError(
            f"{name}: each worker that ran its task died, which often means too little memory. "
            "Start fewer workers on each computer, or let each take more memory.",
            field="cluster",
        )
    if isinstance(cause, ModuleNotFoundError):
        return ClusterError(
            f"A worker has no {cause.name}, which {name} needs. Install there what this computer "
            "has, and start the worker again.",
            field="cluster",
        )
    if future.status == "error":
        return RuntimeError(f"{name}: {type(cause).__name__}: {cause}")
    # The client cancels all tasks if it loses the scheduler.
    return _lost_cluster(client)


def ambient_client() -> Any:
    """Return the client of ``joblib.parallel_config("dask")``; None without it."""
    if "joblib.parallel" not in sys.modules:  # so that nobody has called it
        return None
    from joblib.parallel import get_active_backend

    backend, _ = get_active_backend()
    return backend.client if type(backend).__name__ == "DaskDistributedBackend" else None
