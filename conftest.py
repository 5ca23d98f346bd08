"""Fixtures that several test modules share."""

import os
from pathlib import Path

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
# the arrays are small: a second thread takes processor time and saves none

import pytest
import threadpoolctl
import torch
from plant import Plant

from swashtwin.foundation import MPa, rpm
from swashtwin.pump import OperatingCondition, Pump, load_pump

torch.set_num_threads(1)
threadpoolctl.threadpool_limits(1)  # numpy may have been imported before this file


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave tests of wrong types to runs without the checker of array shapes."""
    if config.getoption("jaxtyping_packages", None):
        for item in items:
            if item.get_closest_marker("wrong_types"):
                item.add_marker(pytest.mark.skip(reason="the checker of types refuses first"))


@pytest.fixture(scope="session")
def pump() -> Pump:
    """The paper's pump."""
    return load_pump("25scy14-1b")


@pytest.fixture(scope="session")
def at_15() -> OperatingCondition:
    """The paper's operating point at 15 MPa."""
    return OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))


@pytest.fixture(scope="session")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Plant:
    """Recordings, models and calibrations on disk, built once for all workers."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    (folder / "plant").mkdir(exist_ok=True)
    return Plant(folder / "plant")


@pytest.fixture(scope="session")
def public_data() -> Path:
    """Folder of the public data sets, or a skip where it is absent."""
    folder = Path(os.environ.get("SWASHTWIN_DATA", Path(__file__).parents[1] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no public data sets at {folder.name}: set SWASHTWIN_DATA to their folder")
    return folder
