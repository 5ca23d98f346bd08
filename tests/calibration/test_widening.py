"""Bounds that nobody stated widen while the optimum touches one; stated ones stay."""

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of

from swashtwin.calibration import IPINN, GaussNewton, calibrate, is_warning
from swashtwin.foundation import MPa
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording

QUICK = GaussNewton(starts=1)
THICK = np.array([9e4 / 1.86e6, 1, 1, 1, 1, 1])


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def thick(twin: Twin) -> Recording:
    return recording_of(twin, THICK)


def test_a_truth_beyond_the_tenfold_bounds_is_found_and_said_to_lie_there(
    twin: Twin, thick: Recording
) -> None:
    calibration = calibrate(twin, [thick], method=QUICK)
    for estimate, truth in zip(calibration.estimates, twin.values.numpy() * THICK, strict=True):
        assert estimate.interval[0] <= truth <= estimate.interval[1], estimate.symbol
    estimate = calibration.estimate("C_sw")
    assert estimate.verdict == "identified"
    assert estimate.bounds == pytest.approx((1.86e4, 1.86e8))
    assert any(note.startswith("C_sw: the bounds were widened") for note in calibration.notes)
    assert not any(map(is_warning, calibration.notes))


def test_stated_bounds_stay_and_a_value_they_stop_is_named_with_the_advice(
    twin: Twin, thick: Recording
) -> None:
    for bounds in (10.0, {"C_sw": (1.86e5, 1.86e7)}):
        stopped = calibrate(
            twin, [thick], method=QUICK, bounds=bounds, explain_misfit=False, **SIX_VALUES
        )
        assert stopped.estimate("C_sw").verdict == "at bound"
        assert stopped.estimate("C_sw").bounds == pytest.approx((1.86e5, 1.86e7))
        assert any("specify wider bounds of C_sw" in note for note in stopped.notes)


def test_the_papers_network_keeps_its_bounds_where_a_value_crosses_one(
    twin: Twin, thick: Recording
) -> None:
    calibration = calibrate(
        twin, [thick], method=IPINN(learning_rate=0.3, epochs=4), explain_misfit=False, **SIX_VALUES
    )
    assert (calibration.history.boundary_loss > 0).any()
    assert calibration.simulations == 4
    for estimate in calibration.estimates:
        assert estimate.bounds == pytest.approx((estimate.nominal / 10, estimate.nominal * 10))
        assert estimate.bounds[0] * (1 - 1e-9) <= estimate.value <= estimate.bounds[1] * (1 + 1e-9)
