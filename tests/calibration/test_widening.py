"""Default bounds widen while the optimum touches one; specified bounds stay."""

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of

from swashtwin.calibration import IPINN, Calibration, GaussNewton, calibrate, is_warning
from swashtwin.foundation import MPa
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording

QUICK = GaussNewton(starts=1)
THICK_FILM = np.array([9e4 / 1.86e6, 1, 1, 1, 1, 1])
"""Truth over nominal: C_sw lies beyond the bounds of a tenth of its nominal value."""


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return recording_of(twin, THICK_FILM)


@pytest.fixture(scope="module")
def calibration(twin: Twin, recording: Recording) -> Calibration:
    return calibrate(twin, [recording], method=QUICK)


def test_a_truth_beyond_the_tenfold_bounds_is_recovered(
    twin: Twin, calibration: Calibration
) -> None:
    true_values = twin.values.numpy() * THICK_FILM
    for estimate, true in zip(calibration.estimates, true_values, strict=True):
        assert estimate.interval[0] <= true <= estimate.interval[1], estimate.symbol
    assert calibration.estimate("C_sw").verdict == "identified"


def test_widened_bounds_are_noted_without_a_warning(calibration: Calibration) -> None:
    assert calibration.estimate("C_sw").bounds == pytest.approx((1.86e4, 1.86e8))
    assert any(note.startswith("C_sw: the bounds were widened") for note in calibration.notes)
    assert not any(map(is_warning, calibration.notes))


@pytest.mark.parametrize(
    "bounds", [10.0, {"C_sw": (1.86e5, 1.86e7)}], ids=["factor", "bounds of one value"]
)
def test_specified_bounds_stay_and_a_value_at_one_is_reported_with_the_remedy(
    twin: Twin, recording: Recording, bounds: float | dict[str, tuple[float, float]]
) -> None:
    calibration = calibrate(
        twin, [recording], method=QUICK, bounds=bounds, explain_misfit=False, **SIX_VALUES
    )
    estimate = calibration.estimate("C_sw")
    assert estimate.verdict == "at bound"
    assert estimate.bounds == pytest.approx((1.86e5, 1.86e7))
    assert any("specify wider bounds of C_sw" in note for note in calibration.notes)


def test_the_papers_network_keeps_its_bounds_if_a_value_crosses_one(
    twin: Twin, recording: Recording
) -> None:
    # a learning rate at which four epochs reach a bound
    method = IPINN(learning_rate=0.3, epochs=4)
    calibration = calibrate(twin, [recording], method=method, explain_misfit=False, **SIX_VALUES)
    assert (calibration.history.boundary_loss > 0).any()
    assert calibration.simulations == 4

    for estimate in calibration.estimates:
        low, high = estimate.bounds
        assert (low, high) == pytest.approx((estimate.nominal / 10, estimate.nominal * 10))
        assert low * (1 - 1e-9) <= estimate.value <= high * (1 + 1e-9)
