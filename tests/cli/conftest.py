"""What the tests of commands share."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", autouse=True)
def _no_misfit_hypotheses() -> Iterator[None]:
    """Calibrate without the refits that explain a misfit, half of the time of each calibration of the rig.

    Their notes are tested in tests/calibration, and counted in the golden answers of calibrations.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin.calibration.notes.misfit_hypotheses", lambda *_: ())
        yield
