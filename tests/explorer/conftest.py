"""A folder of recordings that an explorer shows."""

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
    shutil.copytree(plant.folder / "recordings", folder / "recordings")
    (folder / "recordings" / "broken.h5").write_bytes(b"nothing")

    index = plant.pair.read_text(encoding="utf-8")
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
