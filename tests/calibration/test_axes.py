"""Mounting by axis, single bearings, gains and crosstalk are searched, and kept by the twin."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from twin_recordings import DAMPER, recording_of

from swashtwin.calibration import Calibration, GaussNewton, Nuisances, calibrate, load_calibration
from swashtwin.foundation import MPa
from swashtwin.physics import Scales, Twin
from swashtwin.pump import OperatingCondition, Pump

MIXING = np.array([[1.1, 0.1, -0.15], [0.2, 0.9, 0.05], [-0.1, 0.1, 1.1]])
"""Gains of the channels (diagonal), and the share that each reads of the others."""
MOUNT_FACTORS = {"x": 1.2, "y": 0.85, "z": 0.85}
BEARING_FACTORS = (1.2, 0.8, 1.2)


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def calibration(twin: Twin, pump: Pump) -> Calibration:
    """From one recording of a machine whose mounting, bearings, gains and crosstalk differ."""
    mount = replace(
        pump.mount,
        stiffness_x=MOUNT_FACTORS["x"] * pump.mount.stiffness_x,
        stiffness_y=MOUNT_FACTORS["y"] * pump.mount.stiffness_y,
        stiffness_z=MOUNT_FACTORS["z"] * pump.mount.stiffness_z,
    )
    stiffnesses = np.array(BEARING_FACTORS) * pump.bearings.stiffnesses
    bearings = replace(pump.bearings, stiffnesses=tuple(stiffnesses.tolist()))
    machine = replace(pump, mount=mount, bearings=bearings)

    recording = recording_of(replace(twin, pump=machine), np.ones(6))
    recording = replace(recording, signal=MIXING @ recording.signal)
    return calibrate(twin, [recording], method=GaussNewton(starts=1), nuisances=Nuisances.by_axis())


def test_intervals_contain_the_truth_of_a_machine_whose_constants_differ(
    twin: Twin, calibration: Calibration
) -> None:
    for estimate, truth in zip(calibration.estimates, twin.values.tolist(), strict=True):
        assert estimate.interval[0] <= truth <= estimate.interval[1], estimate.symbol

    # as wide as they must be, but not so wide that they say nothing
    assert calibration.estimate("C_v").verdict == "identified"
    assert calibration.estimate("C_Hz").verdict == "identified"


@pytest.mark.parametrize("axis", MOUNT_FACTORS)
def test_each_direction_of_the_mounting_is_recovered_within_its_uncertainty(
    calibration: Calibration, axis: str
) -> None:
    # the stiffness along an axis is the product of the common factor and that of the axis
    posterior = calibration.posterior
    names = posterior.unknowns.names
    rows = [names.index("mount"), names.index(f"mount_{axis}")]
    log_factor = posterior.point[rows].sum()
    deviation = np.sqrt(posterior.covariance[np.ix_(rows, rows)].sum())

    assert log_factor == pytest.approx(np.log(MOUNT_FACTORS[axis]), abs=2 * deviation)


def test_the_twin_keeps_the_directions_of_the_mounting(calibration: Calibration) -> None:
    assert calibration.twin.scales.mount_x > calibration.twin.scales.mount_z


def test_the_calibrated_twin_keeps_the_crosstalk_that_the_search_fitted(
    calibration: Calibration,
) -> None:
    path = calibration.twin.path
    assert path is not None
    assert np.abs(path.cross_talk).max() > 0.1
    assert calibration.fits[0].calibrated_agreement.spectrum_value_error < 0.05


def test_a_saved_calibration_keeps_the_sensor_path(
    calibration: Calibration, tmp_path: Path
) -> None:
    loaded = load_calibration(calibration.save(tmp_path / "calibration.json"))
    assert loaded.twin.path == calibration.twin.path
    assert torch.equal(loaded.twin.acceleration(), calibration.twin.acceleration())


FAR_MOUNT = {"mount_x": 1.9, "mount_y": 1.6, "mount_z": 0.7, "mount_tilt": 0.55}
FAR_BEARINGS = {"bearing_1": 0.75, "bearing_2": 1.0, "bearing_3": 0.4}


def test_a_mounting_far_from_the_drawing_strains_no_default_prior(twin: Twin) -> None:
    machine = replace(twin, scales=Scales(**FAR_MOUNT, **FAR_BEARINGS))

    result = calibrate(twin, [recording_of(machine)], explain_misfit=False)

    assert not result.is_in_doubt
    assert "identified" in [estimate.verdict for estimate in result.estimates]
    truth = twin.values.numpy() * DAMPER
    for estimate, value in zip(result.estimates, truth.tolist(), strict=True):
        assert estimate.interval[0] <= value <= estimate.interval[1], estimate.symbol
