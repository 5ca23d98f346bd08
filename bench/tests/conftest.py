"""A tiny rig and one study of it, which the tests of this folder share.

The fixtures import what they build: every process of a run of tests reads this file at its start,
also the one that hands the tests to the workers.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from swashtwin.recordings import Recording
    from swashtwin_bench import StudyResult


@pytest.fixture(scope="session")
def recordings() -> list["Recording"]:
    """Recordings of three pumps, two of each class and pressure."""
    from tiny_case import tiny_recordings

    return tiny_recordings()


@pytest.fixture(scope="session")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the runs and calibrations of `result`; no test writes to it."""
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="session")
def result(recordings: list["Recording"], out: Path) -> "StudyResult":
    """Case I on the tiny rig under two seeds."""
    from tiny_case import tiny

    from swashtwin_bench import Work, run_plan

    return run_plan(
        tiny(), recordings, Work((0, 1), out=out, command="swashtwin bench study case1 rig")
    )
