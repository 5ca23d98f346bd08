"""What a calibration's file says of its recordings and its fit."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of, worn_twin

from swashtwin.calibration import Calibration, GaussNewton, calibrate, load_calibration
from swashtwin.foundation import ArtifactError
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


def test_a_recordings_hash_is_of_its_samples_rate_channels_and_unit_alone(recordings: list[Recording]) -> None:
    recording = recordings[0]
    nudged = recording.signal.copy()
    nudged[-1, -1] = np.nextafter(nudged[-1, -1], np.inf)
    same = replace(
        recording, recording_id="renamed", label="normal", condition=None, signal=np.asfortranarray(recording.signal)
    )
    others = [
        replace(recording, signal=nudged),
        replace(recording, sample_rate=6400.5),
        replace(recording, unit="g"),
        replace(recording, channels=recording.channels[::-1]),
    ]
    assert same.fingerprint() == recording.fingerprint()
    assert len({recording.fingerprint(), *(other.fingerprint() for other in others)}) == 5


def test_the_file_says_where_recordings_of_no_machine_come_from(
    twin: Twin, recordings: list[Recording], tmp_path: Path
) -> None:
    rig = replace(recordings[0], attributes={"origin": "swashtwin virtual rig, version 1"})
    calibration = calibrate(twin, [rig], method=GaussNewton(starts=1), **SIX_VALUES)
    path = calibration.save(tmp_path / "calibration.json")
    assert load_calibration(path).origin == "swashtwin virtual rig, version 1"


def test_calibrating_raises_the_correlation_of_the_levels(calibration: Calibration) -> None:
    assert calibration.fit_after.spectral_correlation > max(0.99, calibration.fit_before.spectral_correlation)
    lines = calibration.fits[0].spectra
    expected = np.corrcoef(20 * np.log10(np.stack([lines.measured.ravel(), lines.nominal.ravel()])))[0, 1]
    assert calibration.fit_before.spectral_correlation == pytest.approx(expected, abs=0.02)
    assert "spectral_correlation" not in calibration.improvement


def test_the_correlation_of_levels_ignores_gain_and_what_lies_in_the_noise() -> None:
    measured = np.array([[1.0, 0.1, 0.01], [0.3, 0.03, 1e-4]])
    assert spectral_correlation(measured, 5 * measured) > 0.98
    assert spectral_correlation(measured, 1 / measured) < -0.9
    assert spectral_correlation(measured, np.ones_like(measured)) == 0.0
    silent = measured * (measured > 1e-3)
    assert spectral_correlation(measured, silent) == pytest.approx(1.0)


def test_a_file_of_an_earlier_format_is_refused_with_both_formats(calibration: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "old.json"
    path.write_text(json.dumps({**calibration.to_dict(), "format": "swashtwin calibration 2"}))
    with pytest.raises(ArtifactError, match=r"format is 'swashtwin calibration 2'.* reads 'swashtwin calibration 7'"):
        load_calibration(path)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999", "9" * 5_000_000])
def test_a_calibration_with_a_number_that_is_none_is_refused_in_one_line(calibration, tmp_path, number):
    path = calibration.save(tmp_path / "calibration.json")
    path.write_text(re.sub(r'"wall_s": [\d.e-]+', f'"wall_s": {number}', path.read_text()))
    with pytest.raises(ArtifactError, match="not a calibration, or a damaged one") as caught:
        load_calibration(path)
    assert len(str(caught.value)) < 500
