"""Fixtures that several test modules share, and what is skipped if a package is not installed."""

import os
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)
# the arrays are small: a second thread takes processor time and saves none

import hypothesis
import pytest
import threadpoolctl

if TYPE_CHECKING:
    from plant import Plant

    from swashtwin.pump import OperatingCondition, Pump

# Fixtures import what they build: the process that hands the tests to the workers reads this file
# too, and runs no test.
threadpoolctl.threadpool_limits(1)  # numpy may have been imported before this file
hypothesis.settings.register_profile(
    "busy", deadline=None
)  # other work on the machine is no failure
hypothesis.settings.load_profile("busy")

NEEDS_EXTRA = re.compile(
    r"No module named '(?P<module>torch|numba|onnx\w*|paho|asammdf|distributed|swashtwin_bench"
    r"|imblearn|importlinter|grimp)\b.*"
    r"|\S+ (?:needs|belongs to) (?P<package>[\w.-]+), which is not installed"
)
"""How a test reports that it needs more than the base install."""
BASE = "tests/learning/test_default_without_torch.py"
"""The default way, which may never ask for more."""


def _left_out(report: Any) -> Any:
    """Return the report of a test that lacks an optional package as that of a skipped test."""
    if not report.failed or report.nodeid.startswith(BASE):
        return report

    found = NEEDS_EXTRA.search(report.longreprtext)
    if found and not _is_installed(found["module"] or found["package"]):
        report.outcome, report.longrepr = "skipped", (str(report.nodeid), 0, found[0])
    return report


def _is_installed(name: str) -> bool:
    """Return whether a package is installed, which a test may have hidden."""
    return find_spec(name.partition(".")[0].replace("-", "_")) is not None


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """Skip a module that imports an optional package which is not installed."""
    return _left_out((yield))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo) -> Iterator[None]:
    """Skip a test that requires an optional package which is not installed.

    test_extras.py pins which parts may require one.
    """
    return _left_out((yield))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave tests of wrong types to runs without the checker of array shapes."""
    if config.getoption("jaxtyping_packages", None):
        for item in items:
            if item.get_closest_marker("wrong_types"):
                item.add_marker(pytest.mark.skip(reason="the checker of types refuses first"))


@pytest.fixture(scope="session")
def pump() -> "Pump":
    """The paper's pump."""
    from swashtwin.pump import load_pump

    return load_pump("25scy14-1b")


@pytest.fixture(scope="session")
def at_15() -> "OperatingCondition":
    """The paper's operating point at 15 MPa."""
    from swashtwin.foundation import MPa, rpm
    from swashtwin.pump import OperatingCondition

    return OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of what is built once for all workers; see `build_once.built_once`."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    folder /= "shared"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def plant(shared_folder: Path) -> "Plant":
    """Recordings, models and calibrations on disk."""
    from plant import Plant  # which needs torch

    return Plant(shared_folder)


@pytest.fixture(scope="session")
def public_data() -> Path:
    """Folder of the public data sets, or a skip where it is absent."""
    folder = Path(os.environ.get("SWASHTWIN_DATA", Path(__file__).parents[1] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no public data sets at {folder.name}: set SWASHTWIN_DATA to their folder")
    return folder
