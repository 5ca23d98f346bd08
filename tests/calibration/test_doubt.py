"""No value is called identified where the fit is in doubt, and one warning names the likelier cause."""

from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of

from swashtwin.calibration import Calibration, GaussNewton, calibrate, is_warning, measure, objective_of
from swashtwin.calibration.uncertainty.posterior import MISFIT, estimates_of, misfit_of, posterior_covariance
from swashtwin.foundation import MPa, stream
from swashtwin.physics import Scales, Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording

QUICK = GaussNewton(starts=1)


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replaced(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return replace(recording_of(twin, np.ones(6)), condition=twin.condition)


def warnings(calibration: Calibration) -> list[str]:
    """Notes that say that something may be wrong."""
    return [note for note in calibration.notes if is_warning(note)]


def test_a_direction_of_the_mounting_that_was_not_searched_is_named(twin: Twin) -> None:
    machine = recording_of(replace(twin, scales=Scales(mount_y=1.5)), np.ones(6))
    (warning,) = warnings(calibrate(twin, [machine], method=QUICK, **SIX_VALUES))
    assert "the mounting's stiffness along y is 1.5 times" in warning
    assert "nuisances=by-axis" in warning


def test_a_misfit_beyond_the_model_error_leaves_no_value_identified(twin: Twin, recording: Recording) -> None:
    objective = objective_of(twin, measure(twin, [recording]))
    start = objective.unknowns.start
    covariance = posterior_covariance(objective, start)
    assert "identified" in [estimate.verdict for estimate in estimates_of(objective, start, covariance)]
    factor = np.exp(0.5 * stream(0, "misfit").standard_normal(len(objective.measured)))
    scattered = objective.with_observables(objective.measured.numpy() * factor)
    assert misfit_of(scattered, start) > MISFIT
    assert "identified" not in [estimate.verdict for estimate in estimates_of(scattered, start, covariance)]
