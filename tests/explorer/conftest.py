"""A folder of recordings that an explorer shows."""

import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from explored import open_explorer, read_workspace
from starlette.testclient import TestClient

from swashtwin.explorer import Workspace

if TYPE_CHECKING:
    from plant import Plant


@pytest.fixture(scope="session")
def pair_folder(plant: "Plant", tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of two pumps, healthy and with a swash plate defect, and an unreadable file."""
    folder = tmp_path_factory.mktemp("explored")
    (folder / "recordings").mkdir()
    (folder / "recordings" / "broken.h5").write_bytes(b"nothing")

    index = plant.pair.read_text(encoding="utf-8")
    for name in re.findall(r'^file = "(.+)"$', index, flags=re.MULTILINE):
        shutil.copy(plant.folder / name, folder / name)
    index += '\n[[recording]]\nfile = "recordings/broken.h5"\nlabel = "normal"\n'
    (folder / "recordings.toml").write_text(index, encoding="utf-8")
    return folder


@pytest.fixture
def folder(pair_folder: Path, tmp_path: Path) -> Path:
    """A copy of the same folder, which a test may change."""
    return Path(shutil.copytree(pair_folder, tmp_path / "pair"))


@pytest.fixture
def workspace(folder: Path) -> Workspace:
    """The explorer's view of the folder, after every recording was inspected."""
    return read_workspace(folder)


@pytest.fixture
def client(workspace: Workspace) -> TestClient:
    """A browser without scripts."""
    return open_explorer(workspace)


@pytest.fixture(scope="session")
def shown(pair_folder: Path) -> Workspace:
    """The explorer's view of the folder for the tests that change nothing."""
    return read_workspace(pair_folder)


@pytest.fixture
def reader(shown: Workspace) -> TestClient:
    """A browser without scripts that changes nothing."""
    return open_explorer(shown)
