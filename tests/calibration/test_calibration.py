"""Calibration from recordings to result: recovery of known values, and what a file keeps."""

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import torch
from twin_recordings import DAMPER, SIX_VALUES, recording_of

from swashtwin.calibration import (
    IPINN,
    PAPER_CALIBRATION,
    Calibration,
    GaussNewton,
    Nuisances,
    calibrate,
    load_calibration,
)
from swashtwin.foundation import ArtifactError, InputError, MissingFileError, MPa
from swashtwin.physics import SensorPath, Twin
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording, build_manifest

PAPER = np.array([0.778 / 1.86, 1, 1, 1, 15.3 / 3.4, 1])
"""Truth over nominal: the paper's two published results."""
FAR = np.array([1.5, 0.5, 0.25, 0.3, 2.7, 3])
"""Truth over nominal: most values far from where the search starts."""


def errors(calibration: Calibration, factors: np.ndarray) -> dict[str, float]:
    """Estimated over true value, by symbol."""
    return {
        estimate.symbol: estimate.value / (factor * estimate.nominal)
        for estimate, factor in zip(calibration.estimates, factors, strict=True)
    }


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    attributes = {"origin": "swashtwin virtual rig, version 1"}
    return replace(recording_of(twin, DAMPER), attributes=attributes)


@pytest.fixture(scope="module")
def calibration(twin: Twin, recording: Recording) -> Calibration:
    # at another pressure than the twin's, so that it is excluded
    at_10 = twin.condition.replace(discharge_pressure=MPa(10))
    excluded = replace(recording, recording_id="excluded", condition=at_10)
    return calibrate(twin, [excluded, recording], method=GaussNewton(starts=2), **SIX_VALUES)


@pytest.mark.nightly
@pytest.mark.parametrize("factors", [DAMPER, PAPER], ids=["damper", "paper"])
def test_the_papers_recipe_recovers_the_values_that_the_spectrum_determines(
    twin: Twin, factors: np.ndarray
) -> None:
    calibration = calibrate(twin, [recording_of(twin, factors)], **PAPER_CALIBRATION)

    error = errors(calibration, factors)
    assert error["C_v"] == pytest.approx(1, abs=0.1)
    assert error["C_Hz"] == pytest.approx(1, abs=0.1)
    assert error["K_v"] == pytest.approx(1, abs=0.3)

    assert calibration.estimate("C_v").verdict == "identified"
    assert calibration.estimate("C_Hz").verdict == "identified"
    # physics.md 6: K_sw changes the lines by 0.02 % if it doubles
    assert calibration.estimate("K_sw").verdict == "not identified"

    assert all(share > 0.5 for share in calibration.improvement.values())
    assert calibration.simulations == 500


@pytest.mark.parametrize("factors", [PAPER, FAR], ids=["paper", "far"])
def test_gauss_newton_recovers_every_identified_value_within_its_interval(
    twin: Twin, factors: np.ndarray
) -> None:
    recording = recording_of(twin, factors)
    calibration = calibrate(twin, [recording], method=GaussNewton(starts=1), **SIX_VALUES)

    error = errors(calibration, factors)
    assert error["C_v"] == pytest.approx(1, abs=0.05)
    assert error["C_Hz"] == pytest.approx(1, abs=0.05)
    for estimate, true in zip(calibration.estimates, twin.values.numpy() * factors, strict=True):
        assert estimate.interval[0] < true < estimate.interval[1]

    # a tenth of the 500 simulations of the paper's recipe
    assert calibration.simulations < 50


def test_pressures_that_are_fitted_together_determine_the_values_better(twin: Twin) -> None:
    pressures = [MPa(15), MPa(10), MPa(5)]
    twins = [twin.at(twin.condition.replace(discharge_pressure=p)) for p in pressures]
    recordings = [recording_of(each, DAMPER, seed=seed) for seed, each in enumerate(twins)]
    recordings = [
        replace(recording, label=each.label, condition=each.condition)
        for recording, each in zip(recordings, twins, strict=True)
    ]

    joint = calibrate(twins, recordings, method=GaussNewton(starts=1), **SIX_VALUES)
    assert joint.recording_ids == ("rec-0", "rec-1", "rec-2")
    assert joint.excluded_recordings == ()
    assert [fit.condition.discharge_pressure for fit in joint.fits] == pressures

    # the twin at 15 MPa excludes the recordings of other pressures
    single = calibrate(twin, recordings, method=GaussNewton(starts=1), **SIX_VALUES)
    assert len(single.excluded_recordings) == 2

    for symbol in ("C_v", "K_v", "C_Hz", "K_Hz"):
        log_std = joint.estimate(symbol).log_std
        assert log_std < single.estimate(symbol).log_std
        assert errors(joint, DAMPER)[symbol] == pytest.approx(1, abs=3 * log_std)


def test_twins_that_differ_in_more_than_condition_are_not_calibrated_together(
    twin: Twin, recording: Recording
) -> None:
    with_another_topology = replace(twin, topology="T2")
    with pytest.raises(InputError, match="differ in condition only"):
        calibrate([twin, with_another_topology], [recording], **PAPER_CALIBRATION)


def test_a_saved_calibration_is_loaded_unchanged(
    calibration: Calibration, recording: Recording, tmp_path: Path
) -> None:
    loaded = load_calibration(calibration.save(tmp_path / "calibration.json"))

    assert loaded.to_dict() == calibration.to_dict()
    assert loaded.estimates == calibration.estimates
    assert loaded.origin == "swashtwin virtual rig, version 1"
    assert dict(loaded.recording_hashes) == build_manifest([recording])
    assert loaded.twin.pump == calibration.twin.pump
    assert loaded.twin.fault == calibration.twin.fault
    np.testing.assert_array_equal(
        loaded.twin.acceleration().numpy(), calibration.twin.acceleration().numpy()
    )


def test_a_calibration_is_saved_in_one_file(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "calibration.json")
    assert [file.name for file in tmp_path.iterdir()] == ["calibration.json"]


def test_a_missing_calibration_is_reported(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such calibration"):
        load_calibration(tmp_path / "none.json")


def with_unknown_version(table: dict) -> dict:
    return {**table, "format": "swashtwin calibration 99"}


def without_pump(table: dict) -> dict:
    return {**table, "twin": {**table["twin"], "pump": {}}}


@pytest.mark.parametrize(
    "damage",
    [
        lambda table: json.dumps(table)[:500],
        lambda table: "{}",
        lambda table: "[]",
        lambda table: json.dumps(with_unknown_version(table)),
        lambda table: json.dumps(without_pump(table)),
    ],
    ids=["truncated", "another table", "list", "later version", "no pump"],
)
def test_a_damaged_calibration_is_refused_with_its_file(
    calibration: Calibration, tmp_path: Path, damage: Callable[[dict], str]
) -> None:
    path = tmp_path / "damaged.json"
    path.write_text(damage(calibration.to_dict()))
    with pytest.raises(ArtifactError, match=r"damaged\.json: "):
        load_calibration(path)


def test_the_values_can_be_pasted_into_a_pump_file(
    calibration: Calibration, tmp_path: Path
) -> None:
    original = (resources.files("swashtwin.pump") / "pumps" / "25scy14-1b.toml").read_text()
    head, tail = original.split("[interfaces.slipper_swash]")
    sensors = tail[tail.index("[[sensors]]") :]
    path = tmp_path / "calibrated.toml"
    path.write_text(head + calibration.interfaces_toml() + sensors)

    pump = load_pump(path)

    # as many digits as the text has
    estimated_values = [estimate.value for estimate in calibration.estimates]
    assert pump.interfaces.values() == pytest.approx(estimated_values, rel=1e-7)
    source = pump.sources["interfaces.block_valve.damping"]
    assert source.startswith("calibrated with GaussNewton on rec-0: identified")


def test_the_values_are_saved_as_the_interfaces_of_a_pump_file(
    calibration: Calibration, tmp_path: Path
) -> None:
    saved = calibration.save_interfaces(tmp_path / "interfaces.toml")
    interfaces = tomllib.loads(saved.read_text())["interfaces"]
    assert interfaces.keys() == {"slipper_swash", "block_valve", "piston_bore"}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"epochs": 0}, "at least 1"),
        ({"learning_rate": 0.0}, "such as 1e-4"),
        ({"revolutions": 0.5}, "at least 1"),
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        IPINN(**settings)  # type: ignore[arg-type]


def test_modes_of_the_housing_are_recovered_together_with_the_values(twin: Twin) -> None:
    path = SensorPath(
        gain=(1.1, 1.0, 0.9),
        frequency=(1150.0, 1900.0),
        damping_ratio=(0.03, 0.025),
        residue=((0.1, -0.05), (0.0, 0.1), (-0.08, 0.12)),
    )
    recording = recording_of(replace(twin, path=path), DAMPER)
    method = GaussNewton(starts=1)

    rigid = calibrate(twin, [recording], method=method, **SIX_VALUES)
    bending = calibrate(
        twin, [recording], method=method, nuisances=Nuisances(gains=0.1, modes=2), phases=False
    )

    assert bending.twin.path is not None
    assert bending.twin.path.frequency == pytest.approx(path.frequency, rel=0.02)
    rigid_error = rigid.calibrated_agreement.spectrum_value_error
    assert bending.calibrated_agreement.spectrum_value_error < rigid_error / 5
    assert errors(bending, DAMPER)["C_v"] == pytest.approx(1, abs=0.15)

    # values, gains, frequencies, damping ratios and residues
    assert len(bending.posterior.point) == 6 + 3 + 2 + 2 + 6


def test_the_band_of_each_line_contains_the_calibrated_twin(calibration: Calibration) -> None:
    spectra = calibration.fits[0].spectra
    assert np.all(spectra.low <= spectra.high)
    is_within = (spectra.low <= spectra.calibrated) & (spectra.calibrated <= spectra.high)
    assert is_within.mean() > 0.85


def test_the_band_of_each_line_is_as_wide_as_the_posterior(calibration: Calibration) -> None:
    spectra = calibration.fits[0].spectra
    twins = calibration.posterior.twins(calibration.nominal, 20, seed=3)
    with torch.no_grad():
        lines = np.stack(
            [
                draw.acceleration().abs().numpy()[:, np.isin(draw.orders, spectra.orders)]
                for draw in twins
            ]
        )

    # around the 90 % of the band, by chance of 20 draws
    is_within = (spectra.low <= lines) & (lines <= spectra.high)
    assert 0.75 < is_within.mean() < 0.99
