"""How a process keeps freed memory."""

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


@pytest.mark.skipif(sys.platform != "linux", reason="malloc of Linux")
def test_a_process_that_dask_started_keeps_freed_arrays_for_the_next() -> None:
    # The variable that Dask sets for its workers, with which malloc returns freed arrays at once.
    environment = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"}
    command = [sys.executable, "-c", PAGE_FAULTS]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)

    # Fifty arrays of 8 MB have 100,000 pages of 4 kB, or 200 huge pages.
    assert int(answer.stdout) < 100
