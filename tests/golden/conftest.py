"""Fixtures of the golden tests: the recordings of the rig, and a workspace of its files."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from golden_commands import Workspace


@pytest.fixture(scope="session")
def rig() -> list[Recording]:
    """Recordings of the small rig."""
    from golden_rig import plant_recordings  # which needs torch

    return plant_recordings()


@pytest.fixture(scope="session")
def workspace(rig: list[Recording], tmp_path_factory: pytest.TempPathFactory) -> "Workspace":
    """Folder with the files of the small rig, in which commands run."""
    from golden_commands import Workspace

    return Workspace(rig, tmp_path_factory.mktemp("golden"))
