"""Calibration from recordings to result: recovery of known values, and what is kept of a run."""

import json
import tomllib
from dataclasses import replace
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
from swashtwin.recordings import Recording, build_manifest

PAPER = np.array([0.778 / 1.86, 1, 1, 1, 15.3 / 3.4, 1])
"""Truth over nominal: the paper's two published results."""


def ratios(calibration: Calibration, factors: np.ndarray) -> dict[str, float]:
    """Found over true, by letter."""
    relative = {
        estimate.symbol: estimate.value / estimate.nominal for estimate in calibration.estimates
    }
    return {
        letter: ratio / factor
        for (letter, ratio), factor in zip(relative.items(), factors, strict=True)
    }


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return replace(
        recording_of(twin, DAMPER), attributes={"origin": "swashtwin virtual rig, version 1"}
    )


@pytest.fixture(scope="module")
def calibration(twin: Twin, recording: Recording) -> Calibration:
    other = replace(
        recording,
        recording_id="other",
        condition=twin.condition.replace(discharge_pressure=MPa(10)),
    )
    return calibrate(twin, [other, recording], method=GaussNewton(starts=2), **SIX_VALUES)


@pytest.mark.nightly
@pytest.mark.parametrize("factors", [DAMPER, PAPER], ids=["damper", "paper"])
def test_the_papers_recipe_recovers_what_the_spectrum_shows_and_says_what_it_does_not(
    twin: Twin, factors: np.ndarray
) -> None:
    calibration = calibrate(twin, [recording_of(twin, factors)], **PAPER_CALIBRATION)
    relative = ratios(calibration, factors)
    assert relative["C_v"] == pytest.approx(1, abs=0.1)
    assert relative["C_Hz"] == pytest.approx(1, abs=0.1)
    assert relative["K_v"] == pytest.approx(1, abs=0.3)
    assert calibration.estimate("K_sw").verdict == "not identified"
    assert (
        calibration.estimate("C_v").verdict == calibration.estimate("C_Hz").verdict == "identified"
    )
    assert all(share > 0.5 for share in calibration.improvement.values())
    assert calibration.simulations == 500


@pytest.mark.parametrize(
    "factors", [PAPER, np.array([1.5, 0.5, 0.25, 0.3, 2.7, 3])], ids=["paper", "far"]
)
def test_gauss_newton_recovers_every_identified_value_within_its_interval(
    twin: Twin, factors: np.ndarray
) -> None:
    calibration = calibrate(
        twin, [recording_of(twin, factors)], method=GaussNewton(starts=1), **SIX_VALUES
    )
    relative = ratios(calibration, factors)
    assert relative["C_v"] == pytest.approx(1, abs=0.05)
    assert relative["C_Hz"] == pytest.approx(1, abs=0.05)
    for estimate, true in zip(calibration.estimates, twin.values.numpy() * factors, strict=True):
        assert estimate.interval[0] < true < estimate.interval[1]
    assert calibration.simulations < 50


def test_pressures_that_are_fitted_together_share_one_set_of_values_and_tell_more(
    twin: Twin,
) -> None:
    twins = [
        twin.at(twin.condition.replace(discharge_pressure=MPa(level))) for level in (15, 10, 5)
    ]
    recordings = [
        replace(
            recording_of(other, DAMPER, seed=seed), label=other.label, condition=other.condition
        )
        for seed, other in enumerate(twins)
    ]
    together = calibrate(twins, recordings, method=GaussNewton(starts=1), **SIX_VALUES)
    alone = calibrate(twin, recordings, method=GaussNewton(starts=1), **SIX_VALUES)
    assert together.recording_ids == ("rec-0", "rec-1", "rec-2")
    assert together.excluded_recordings == ()
    assert len(alone.excluded_recordings) == 2
    assert [fit.condition.discharge_pressure for fit in together.fits] == [MPa(15), MPa(10), MPa(5)]
    for letter in ("C_v", "K_v", "C_Hz", "K_Hz"):
        assert together.estimate(letter).log_std < alone.estimate(letter).log_std
        assert ratios(together, DAMPER)[letter] == pytest.approx(
            1, abs=3 * together.estimate(letter).log_std
        )


def test_twins_that_differ_in_more_than_condition_are_not_calibrated_together(
    twin: Twin, recording: Recording
) -> None:
    other = replace(twin, topology="T2")
    with pytest.raises(InputError, match="differ in condition only"):
        calibrate([twin, other], [recording], **PAPER_CALIBRATION)


def test_a_saved_calibration_is_read_back_whole(
    calibration: Calibration, recording: Recording, tmp_path: Path
) -> None:
    path = calibration.save(tmp_path / "calibration.json")
    again = load_calibration(path)
    assert again.to_dict() == calibration.to_dict()
    assert again.origin == "swashtwin virtual rig, version 1"
    assert dict(again.recording_hashes) == build_manifest([recording])
    assert again.twin.pump == calibration.twin.pump
    assert again.twin.fault == calibration.twin.fault
    assert again.estimates == calibration.estimates
    np.testing.assert_array_equal(
        again.twin.acceleration().numpy(), calibration.twin.acceleration().numpy()
    )
    assert [file.name for file in tmp_path.iterdir()] == ["calibration.json"]


def test_a_damaged_calibration_is_refused(calibration: Calibration, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such calibration"):
        load_calibration(tmp_path / "none.json")
    table = calibration.to_dict()
    broken = {
        "cut": json.dumps(table)[:500],
        "foreign": "{}",
        "list": "[]",
        "version": json.dumps({**table, "format": "swashtwin calibration 99"}),
        "pump": json.dumps({**table, "twin": {**table["twin"], "pump": {}}}),
    }
    for name, text in broken.items():
        path = tmp_path / f"{name}.json"
        path.write_text(text)
        with pytest.raises(ArtifactError, match=f"{name}.json: "):
            load_calibration(path)


def test_the_values_can_be_pasted_into_a_pump_file(
    calibration: Calibration, tmp_path: Path
) -> None:
    from importlib import resources

    from swashtwin.pump import load_pump

    original = (resources.files("swashtwin.pump") / "pumps" / "25scy14-1b.toml").read_text()
    head, rest = original.split("[interfaces.slipper_swash]")
    sensors = rest[rest.index("[[sensors]]") :]
    path = tmp_path / "calibrated.toml"
    path.write_text(head + calibration.interfaces_toml() + sensors)
    pump = load_pump(path)
    assert pump.interfaces.values() == pytest.approx(
        [estimate.value for estimate in calibration.estimates], rel=1e-7
    )
    assert pump.sources["interfaces.block_valve.damping"].startswith(
        "calibrated with GaussNewton on rec-0: identified"
    )
    saved = calibration.save_interfaces(tmp_path / "interfaces.toml")
    assert tomllib.loads(saved.read_text())["interfaces"].keys() == {
        "slipper_swash",
        "block_valve",
        "piston_bore",
    }


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


def test_a_bending_housing_is_found_beside_the_values_and_kept_by_the_twin(twin: Twin) -> None:
    path = SensorPath(
        (1.1, 1.0, 0.9), (1150.0, 1900.0), (0.03, 0.025), ((0.1, -0.05), (0.0, 0.1), (-0.08, 0.12))
    )
    recording = recording_of(replace(twin, path=path), DAMPER)
    blind = calibrate(twin, [recording], method=GaussNewton(starts=1), **SIX_VALUES)
    freed = Nuisances(gains=0.1, modes=2)
    aware = calibrate(
        twin, [recording], method=GaussNewton(starts=1), nuisances=freed, phases=False
    )
    assert aware.twin.path is not None
    assert aware.twin.path.frequency == pytest.approx(path.frequency, rel=0.02)
    assert (
        aware.calibrated_agreement.spectrum_value_error
        < blind.calibrated_agreement.spectrum_value_error / 5
    )
    assert ratios(aware, DAMPER)["C_v"] == pytest.approx(1, abs=0.15)
    assert len(aware.posterior.point) == 6 + 3 + 2 + 2 + 6


def test_the_band_of_each_line_holds_the_calibrated_twin_and_is_as_wide_as_the_posterior(
    calibration: Calibration,
) -> None:
    spectra = calibration.fits[0].spectra
    assert np.all(spectra.low <= spectra.high)
    within = (spectra.low <= spectra.calibrated) & (spectra.calibrated <= spectra.high)
    assert within.mean() > 0.85
    twins = calibration.posterior.twins(calibration.nominal, 20, seed=3)
    with torch.no_grad():
        lines = np.stack(
            [
                draw.acceleration().abs().numpy()[:, np.isin(draw.orders, spectra.orders)]
                for draw in twins
            ]
        )
    is_held = (spectra.low <= lines) & (lines <= spectra.high)
    assert 0.75 < is_held.mean() < 0.99
