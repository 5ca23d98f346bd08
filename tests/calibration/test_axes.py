"""Mountings that are off by axis, bearings each by itself, gains and cross-talk are searched, and
kept by the twin.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from twin_recordings import recording_of

from swashtwin.calibration import Calibration, GaussNewton, Nuisances, calibrate, load_calibration
from swashtwin.foundation import MPa
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump

MIXING = np.array([[1.1, 0.1, -0.15], [0.2, 0.9, 0.05], [-0.1, 0.1, 1.1]])
"""Gains of the channels, and what each reads of the others."""


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def calibration(twin: Twin, pump: Pump) -> Calibration:
    """Mounting off by +20/-15/-15 % by axis, bearings by ±20 %, gains by ±10 %, cross-talk up to 20
    %.
    """
    mount, bearings = pump.mount, pump.bearings
    stiffnesses = [k * f for k, f in zip(bearings.stiffnesses, (1.2, 0.8, 1.2), strict=True)]
    off = {"stiffness_x": 1.2, "stiffness_y": 0.85, "stiffness_z": 0.85}
    mounting = replace(
        mount, **{name: factor * getattr(mount, name) for name, factor in off.items()}
    )
    machine = replace(
        pump, mount=mounting, bearings=replace(bearings, stiffnesses=tuple(stiffnesses))
    )
    recording = recording_of(replace(twin, pump=machine), np.ones(6))
    recording = replace(recording, signal=MIXING @ recording.signal)
    return calibrate(twin, [recording], method=GaussNewton(starts=1), nuisances=Nuisances.by_axis())


def test_intervals_hold_the_truth_where_mounting_bearings_gains_and_cross_talk_are_off(
    twin: Twin, calibration: Calibration
) -> None:
    for estimate, truth in zip(calibration.estimates, twin.values.tolist(), strict=True):
        assert estimate.interval[0] <= truth <= estimate.interval[1], estimate.symbol
    assert (
        calibration.estimate("C_v").verdict == calibration.estimate("C_Hz").verdict == "identified"
    )


def test_each_direction_of_the_mounting_is_found_within_its_own_uncertainty(
    calibration: Calibration,
) -> None:
    posterior = calibration.posterior
    names = posterior.unknowns.names
    for axis, truth in (("x", 1.2), ("y", 0.85), ("z", 0.85)):
        rows = [names.index("mount"), names.index(f"mount_{axis}")]
        deviation = np.sqrt(posterior.covariance[np.ix_(rows, rows)].sum())
        assert posterior.point[rows].sum() == pytest.approx(np.log(truth), abs=2 * deviation), axis
    assert calibration.twin.scales.mount_x > calibration.twin.scales.mount_z


def test_the_calibrated_twin_reads_what_the_search_read(
    calibration: Calibration, tmp_path: Path
) -> None:
    path = calibration.twin.path
    assert path is not None
    assert np.abs(path.cross_talk).max() > 0.1
    again = load_calibration(calibration.save(tmp_path / "a.json"))
    assert again.twin.path == path
    assert calibration.fits[0].calibrated_agreement.spectrum_value_error < 0.05
    assert torch.equal(again.twin.acceleration(), calibration.twin.acceleration())
