"""What the tests of commands share."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from commandline import FACTS, run, write_tones


@pytest.fixture(scope="module", autouse=True)
def _no_misfit_hypotheses() -> Iterator[None]:
    """Calibrate without the refits that explain a misfit, half of the time of each calibration of
    the rig.

    Their notes are tested in tests/calibration, and counted in the golden answers of calibrations.
    """
    with pytest.MonkeyPatch.context() as patch:
        if find_spec("torch"):
            patch.setattr("swashtwin.calibration.misfit_hypotheses.try_mistakes", lambda *_: ())
        yield


@pytest.fixture(scope="session")
def tones(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of three text tables of each of two classes, with their index."""
    folder = write_tones(tmp_path_factory.mktemp("tones"), 3)
    run("index", folder, *FACTS)
    return folder
