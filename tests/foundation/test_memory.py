"""How a process keeps freed memory."""

import ctypes
import os
import subprocess
import sys

import pytest

PAGE_FAULTS = """
import resource
import numpy as np
from swashtwin.foundation import keep_freed_memory

keep_freed_memory()
for _ in range(2):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(50):
        np.ones(1_000_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


needs_glibc = pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallopt"), reason="malloc of glibc"
)


def count_page_faults(trim_threshold: str) -> int:
    """Return the page faults of fifty arrays of 8 MB, one after the other, in a new process."""
    environment = {**os.environ, "MALLOC_TRIM_THRESHOLD_": trim_threshold}
    command = [sys.executable, "-c", PAGE_FAULTS]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return int(answer.stdout)


@needs_glibc
def test_freed_arrays_are_kept_for_the_next_where_dask_would_return_them() -> None:
    # Fifty arrays of 8 MB have 100,000 pages of 4 kB, or 200 huge pages.
    assert count_page_faults("65536") < 100


@needs_glibc
def test_a_threshold_that_a_user_sets_stays() -> None:
    assert count_page_faults("70000") > 100
