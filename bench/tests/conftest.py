"""A tiny rig and one study of it, which the tests of this folder share."""

from pathlib import Path

import pytest
from tiny_case import tiny, tiny_recordings

from swashtwin.recordings import Recording
from swashtwin_bench import StudyResult, Work, run_plan


@pytest.fixture(scope="session")
def recordings() -> list[Recording]:
    """Recordings of three pumps, two of each class and pressure."""
    return tiny_recordings()


@pytest.fixture(scope="session")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the runs and calibrations of `result`; no test writes to it."""
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="session")
def result(recordings: list[Recording], out: Path) -> StudyResult:
    """Case I on the tiny rig under two seeds."""
    return run_plan(
        tiny(), recordings, Work((0, 1), out=out, command="swashtwin bench study case1 rig")
    )
