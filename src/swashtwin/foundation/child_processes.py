"""Functions that run in a child process, because they can crash it, or take all memory or time.

`run_in_child` runs one function in a fresh process; a `ChildProcess` runs one after the other, and
is started again after it died. Both sides are here: `serve` is what the child runs.

Examples
--------
>>> import math
>>> run_in_child(math.factorial, 5, timeout_s=30)
120
"""

import atexit
import faulthandler
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakSet

from swashtwin.foundation.memory import keep_freed_memory
from swashtwin.foundation.processes import exit_with_parent

_T = TypeVar("_T")

# Memory that the libraries of a function may take beyond its limit when they are loaded.
_LIBRARY_BYTES = 1 << 29

# Time that a child that closed its pipe has to exit, so that its exit code can be reported.
_EXIT_WAIT_S = 0.2

_SERVE = "from swashtwin.foundation.child_processes import serve; serve()"


class ChildDiedError(Exception):
    """The child process ended before it answered.

    Parameters
    ----------
    reason : ``"signal 11"`` or ``"exit code 3"``.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason

    def __str__(self) -> str:
        return f"the child process crashed ({self.reason})"


class ChildTimeoutError(ChildDiedError):
    """The function did not return within its time limit, and the child process was ended."""

    def __str__(self) -> str:
        return f"the child process was ended: {self.reason}"


def run_in_child(
    function: Callable[..., _T],
    *arguments: object,
    timeout_s: float,
    memory_bytes: int | None = None,
) -> _T:
    """Return the result of a function that a fresh child process runs; see `ChildProcess.call`."""
    child = ChildProcess()
    try:
        return child.call(function, *arguments, timeout_s=timeout_s, memory_bytes=memory_bytes)
    finally:
        child.stop()


class ChildProcess:
    """Process that runs functions one after the other; it ends with this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        _child_processes.add(self)

    @property
    def pid(self) -> int | None:
        """Number of the process, or None if it is not running."""
        return None if self._process is None else self._process.pid

    def call(
        self,
        function: Callable[..., _T],
        *arguments: object,
        timeout_s: float,
        memory_bytes: int | None = None,
    ) -> _T:
        """Return the result of a function that the child process runs.

        Threads that call at the same time wait for each other.

        Parameters
        ----------
        function : function of a module, which the child imports.
        arguments : its arguments; they are pickled, and so is the result.
        timeout_s : time limit [s]; a child that exceeds it is ended.
        memory_bytes : memory that the function may take beyond what the process has; Linux only.

        Raises
        ------
        ChildTimeoutError
            The function did not return in time.
        ChildDiedError
            The process crashed. The next call starts another one.
        Exception
            Whatever the function raises, with the child's traceback as a note; a `RuntimeError`
            in place of an exception that cannot be pickled.
        """
        request = pickle.dumps(
            (function, arguments, timeout_s, memory_bytes), pickle.HIGHEST_PROTOCOL
        )
        with self._lock:
            has_failed, result = self._exchange(request, timeout_s)

        if has_failed:
            raise result
        answer: _T = result
        return answer

    def _exchange(self, request: bytes, timeout_s: float) -> tuple[bool, Any]:
        """Return whether the function raised, and its result or exception."""
        process = self._start()
        started_at = time.monotonic()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(request)
            process.stdin.flush()
            answer: tuple[bool, Any] = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as cause:
            has_timed_out = time.monotonic() - started_at >= timeout_s
            exit_code = self._end(_EXIT_WAIT_S)
            if has_timed_out:
                raise ChildTimeoutError(f"no result within {timeout_s:.0f} s") from cause
            reason = f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
            raise ChildDiedError(reason) from cause
        except BaseException:
            # An interrupt between a request and its answer: the next call would read this answer.
            self._end()
            raise

        return answer

    def _start(self) -> "subprocess.Popen[bytes]":
        if self._process is not None and self._process.poll() is None:
            return self._process

        self._end()
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _SERVE],  # -P: no module of the current folder is imported
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        return self._process

    def stop(self) -> None:
        """End the process; the next call starts another one."""
        self._end()

    def _end(self, wait_s: float = 0.0) -> int:
        """Return the exit code of the process, which is killed if it does not exit in `wait_s`."""
        if self._process is None:
            return 0

        process, self._process = self._process, None
        try:
            process.wait(wait_s)
        except subprocess.TimeoutExpired:
            process.kill()
        exit_code = process.wait()
        _close_pipes(process)
        return exit_code

    def _forget(self) -> None:
        """Leave the child to the process that this one was forked from."""
        if self._process is not None:
            self._process.returncode = 0  # or Popen would wait for a child that is not ours
            _close_pipes(self._process)
        self._process = None
        self._lock = threading.Lock()  # another thread may have held it at the fork


_child_processes: "WeakSet[ChildProcess]" = WeakSet()


def _close_pipes(process: "subprocess.Popen[bytes]") -> None:
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # closing flushes, and the reader of a full pipe has died
            if pipe is not None:
                pipe.close()


def _stop_all() -> None:
    for child in list(_child_processes):
        child.stop()


def _forget_all() -> None:
    for child in list(_child_processes):
        child._forget()


atexit.register(_stop_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)


# ---- in the child process


def serve() -> None:
    """Run the requested functions until the standard input is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the parent
    exit_with_parent(os.getppid())
    warnings.simplefilter("ignore")
    keep_freed_memory()

    with os.fdopen(os.dup(1), "wb") as answers, open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(2, 1)  # what a library prints must not get between the answers
        while True:
            try:
                request = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            except Exception as cause:  # the module of the function cannot be imported
                answer = pickle.dumps((True, _picklable(cause)), pickle.HIGHEST_PROTOCOL)
            else:
                function, arguments, timeout_s, memory_bytes = request
                # The watchdog is a thread in C: it ends the process even in a library's loop.
                faulthandler.dump_traceback_later(timeout_s, exit=True, file=nowhere)
                answer = _run(function, arguments, memory_bytes)
                faulthandler.cancel_dump_traceback_later()
            answers.write(answer)
            answers.flush()


def _run(
    function: Callable[..., Any], arguments: tuple[Any, ...], memory_bytes: int | None
) -> bytes:
    """Return the pickled (whether it raised, result or exception) of a function."""
    try:
        if memory_bytes is not None:
            limit_memory(memory_bytes)
        return pickle.dumps((False, function(*arguments)), pickle.HIGHEST_PROTOCOL)
    except Exception as cause:
        return pickle.dumps((True, _picklable(cause)), pickle.HIGHEST_PROTOCOL)


def _picklable(cause: Exception) -> Exception:
    cause.add_note("".join(traceback.format_exception(cause)))
    try:
        pickle.loads(pickle.dumps(cause))
    except Exception:
        return RuntimeError(f"{type(cause).__name__}: {cause}")
    return cause


def limit_memory(size: int) -> None:
    """Let this process take at most `size` bytes more than it has; does nothing but on Linux.

    A lower limit of the system is kept.
    """
    if sys.platform != "linux":
        return
    import resource

    data_pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    limit = data_pages * resource.getpagesize() + size + _LIBRARY_BYTES
    _, hard_limit = resource.getrlimit(resource.RLIMIT_DATA)
    if hard_limit != resource.RLIM_INFINITY:
        limit = min(limit, hard_limit)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard_limit))
