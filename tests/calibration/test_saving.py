"""What a calibration's file says of its recordings and its fit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of, worn_twin

from swashtwin.calibration import Calibration, GaussNewton, calibrate, load_calibration
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording, manifest_of
from swashtwin.signals import spectral_correlation


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return worn_twin(pump, at_15)


@pytest.fixture(scope="module")
def recordings(twin: Twin) -> list[Recording]:
    return [recording_of(twin, seed=seed) for seed in range(2)]


@pytest.fixture(scope="module")
def calibration(twin: Twin, recordings: list[Recording]) -> Calibration:
    return calibrate(twin, recordings, method=GaussNewton(starts=1), **SIX_VALUES)


def test_the_file_names_each_recording_by_the_hash_of_its_samples(
    calibration: Calibration, recordings: list[Recording], tmp_path: Path
) -> None:
    again = load_calibration(calibration.save(tmp_path / "calibration.json"))
    assert dict(again.recording_hashes) == manifest_of(recordings)
    assert len(set(again.recording_hashes.values())) == 2


def test_the_file_says_where_recordings_of_no_machine_come_from(
    twin: Twin, recordings: list[Recording], tmp_path: Path
) -> None:
    rig = replace(recordings[0], attributes={"origin": "swashtwin virtual rig, version 1"})
    calibration = calibrate(twin, [rig], method=GaussNewton(starts=1), **SIX_VALUES)
    path = calibration.save(tmp_path / "calibration.json")
    assert load_calibration(path).origin == "swashtwin virtual rig, version 1"


def test_the_correlation_of_levels_ignores_gain_and_what_lies_in_the_noise() -> None:
    measured = np.array([[1.0, 0.1, 0.01], [0.3, 0.03, 1e-4]])
    assert spectral_correlation(measured, 5 * measured) > 0.98
    assert spectral_correlation(measured, 1 / measured) < -0.9
    assert spectral_correlation(measured, np.ones_like(measured)) == 0.0
    silent = measured * (measured > 1e-3)
    assert spectral_correlation(measured, silent) == pytest.approx(1.0)
