"""Functions in a child process: their results and errors, and what happens if they never return."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from swashtwin.foundation import (
    ChildDiedError,
    ChildProcess,
    ChildTimeoutError,
    DataError,
    run_in_child,
)


def refuse(name: str) -> None:
    raise DataError(f"{name} is damaged.", field="unit", remedy="Set {unit='g'}.")


def fail_without_pickle() -> None:
    class LocalError(Exception):
        pass

    raise LocalError("local")


def fill_memory(size: int) -> int:
    return int(np.ones(size // 8).sum())


def test_a_function_runs_in_another_process_and_returns_its_result() -> None:
    child = ChildProcess()
    try:
        pid = child.call(os.getpid, timeout_s=60)
        assert pid not in (os.getpid(), None)
        assert child.call(os.getpid, timeout_s=60) == pid == child.pid
        np.testing.assert_array_equal(child.call(np.arange, 3, timeout_s=60), [0, 1, 2])
    finally:
        child.stop()

    assert child.pid is None


def test_errors_of_the_function_are_raised_with_their_traceback_as_a_note() -> None:
    with pytest.raises(DataError, match=r"a.csv is damaged. Set unit='g'.") as caught:
        run_in_child(refuse, "a.csv", timeout_s=60)
    assert caught.value.field == "unit"
    assert "in refuse" in caught.value.__notes__[0]

    with pytest.raises(RuntimeError, match="LocalError: local"):
        run_in_child(fail_without_pickle, timeout_s=60)


def test_a_crash_and_a_timeout_end_the_child_and_the_next_call_starts_another() -> None:
    child = ChildProcess()
    try:
        with pytest.raises(ChildDiedError, match=r"crashed \((signal 6|exit code \d+)\)"):
            child.call(os.abort, timeout_s=60)
        with pytest.raises(ChildTimeoutError, match="no result within 1 s"):
            child.call(time.sleep, 60, timeout_s=0.8)
        assert child.call(abs, -1, timeout_s=60) == 1
    finally:
        child.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
def test_a_function_that_takes_more_memory_than_its_limit_raises_a_memory_error() -> None:
    with pytest.raises(MemoryError):
        run_in_child(fill_memory, 3_000_000_000, timeout_s=60, memory_bytes=1_000_000_000)
    assert run_in_child(fill_memory, 8_000, timeout_s=60, memory_bytes=1_000_000_000) == 1000


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
def test_a_lower_limit_of_the_system_is_kept() -> None:
    code = (
        "import resource; from swashtwin.foundation.child_processes import limit_memory\n"
        "resource.setrlimit(resource.RLIMIT_DATA, (2**31, 2**31)); limit_memory(4 * 10**9)\n"
        "print(resource.getrlimit(resource.RLIMIT_DATA))"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )

    assert process.stdout.strip() == f"({2**31}, {2**31})"
