"""What a measurement can tell, and that intervals hold what they promise."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from twin_recordings import SIX_VALUES

from swashtwin.calibration import (
    GaussNewton,
    Nuisances,
    Objective,
    calibrate,
    identifiability,
    load_calibration,
    measure,
    objective_of,
    profile,
)
from swashtwin.calibration.uncertainty.discrepancy import (
    Linearization,
    estimate_discrepancy,
    linearize,
    noise_covariance,
)
from swashtwin.calibration.uncertainty.identifiability_report import identifiability_at
from swashtwin.calibration.uncertainty.posterior import IDENTIFIED_STD, estimates_of, posterior_covariance, sandwich
from swashtwin.calibration.uncertainty.profiles import profiles
from swashtwin.foundation import DataError, InputError, mm, stream, to_table
from swashtwin.physics import Scales, SensorPath, Twin
from swashtwin.pump import Interfaces, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.report import write_report
from swashtwin.report.calibration_part import interval_words
from swashtwin.signals import add_noise

DEFECT = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
PATH = SensorPath((1.05, 0.97, 1.0), (1150.0, 1900.0), (0.03, 0.03), ((0.1, -0.05), (0.0, 0.1), (-0.08, 0.12)))
NONE = Nuisances()


def objective_for(assumed: Twin, true: Twin, nuisances: Nuisances = NONE, band: float = 2500) -> Objective:
    """Objective of calibrating `assumed` on a noisy recording (30 dB) of `true`."""
    recording = true.simulate(1.3, 6400.0, phase=1.0, recording_id="rec")
    recording = replace(recording, signal=add_noise(recording.signal, 30, 0))
    return objective_of(assumed, measure(assumed, [recording], (0, band)), None, nuisances)


def widened_by_misfit(around: Linearization) -> np.ndarray:
    """Covariance where the information is divided by the mean square misfit."""
    misfit = max(1.0, float(np.mean((around.residual / around.sigma) ** 2)))
    scaled = around.slope / around.sigma[:, None]
    return np.linalg.inv(scaled.T @ scaled / misfit + np.diag(around.objective.unknowns.deviation**-2.0))


def solution(objective: Objective) -> np.ndarray:
    return GaussNewton(starts=1).search(objective, seed=0).point


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, DEFECT, bandwidth=2600)


@pytest.fixture(scope="module")
def thick(twin: Twin) -> Twin:
    """Its slippers ride on 24 um of oil."""
    return twin.with_interfaces(Interfaces.from_values([98523.0, 8.1591e7, *twin.values[2:]]))


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    return objective_for(twin, twin)


@pytest.fixture(scope="module")
def point(objective: Objective) -> np.ndarray:
    return solution(objective)


@pytest.fixture(scope="module")
def off_mount(twin: Twin) -> Objective:
    return objective_for(twin, replace(twin, scales=Scales(mount=1.2)))


@pytest.mark.parametrize("film", ["paper", "thick"])
def test_intervals_hold_the_truth_as_often_as_they_say(twin: Twin, thick: Twin, film: str) -> None:
    base = replace(twin if film == "paper" else thick, bandwidth=1100)
    objective = objective_for(base, base, band=1000)
    truth = objective.unknowns.start
    clean = objective.with_observables(objective.observables(objective.start).detach().numpy())
    is_held, is_far = [], []
    for index in range(20):
        noise = clean.sigma.numpy() * stream(0, "coverage", index).standard_normal(len(clean.sigma))
        noisy = objective.with_observables(np.abs(clean.measured.numpy() + noise))
        point = GaussNewton(starts=1).search(noisy, seed=0).point
        for estimate, true in zip(estimates_of(noisy, point, posterior_covariance(noisy, point)), truth, strict=False):
            if estimate.verdict == "identified":
                low, high = np.log(estimate.interval)
                is_held.append(low <= true <= high)
                is_far.append(abs(np.log(estimate.value) - true) > 3 * estimate.log_std)
    assert 0.8 <= np.mean(is_held) <= 0.97
    assert np.mean(is_far) <= 0.03


def test_the_slippers_stiffness_is_identified_under_a_thick_film_only(
    objective: Objective, point: np.ndarray, thick: Twin
) -> None:
    assert thick.values[0] <= 1e5
    thin = identifiability_at(objective, point)
    other = objective_for(thick, thick)
    wide = identifiability_at(other, solution(other))
    assert thin.estimates[1].verdict == "not identified"
    assert thin.standing[1] in ("dead", "flat")
    assert wide.estimates[1].verdict == wide.standing[1] == "identified"
    assert wide.condition_number < thin.condition_number / 1000


def test_a_twin_that_is_right_lacks_nothing_and_has_the_deviations_of_its_noise(
    objective: Objective, point: np.ndarray
) -> None:
    around = linearize(objective, point)
    discrepancy = estimate_discrepancy(around)
    assert (discrepancy.excitation, discrepancy.path, discrepancy.line) == (0, 0, 0)
    assert all(share == 0 for _, share in discrepancy.constants)
    scaled = around.slope / around.sigma[:, None]
    fisher = scaled.T @ scaled + np.diag(objective.unknowns.deviation**-2.0)
    np.testing.assert_allclose(posterior_covariance(objective, point), np.linalg.inv(fisher), rtol=1e-6, atol=1e-12)


def test_a_wrong_mounting_is_named_with_its_size(off_mount: Objective) -> None:
    report = identifiability_at(off_mount, solution(off_mount))
    assert dict(report.discrepancy.constants)["mount"] == pytest.approx(0.18, abs=0.08)
    assert any("the mount may be off by" in sentence for sentence in report.words)


@pytest.mark.parametrize("wrong", ["mount", "housing"])
def test_a_twin_that_lacks_something_gets_intervals_that_hold_more(twin: Twin, wrong: str) -> None:
    """Against the rule that divides the information by the mean square misfit."""
    generator = np.random.default_rng(1)
    mistaken = replace(twin, scales=Scales(mount=1.2)) if wrong == "mount" else replace(twin, path=PATH)
    is_held: dict[str, list[bool]] = {"misfit": [], "discrepancy": []}
    is_narrow: dict[str, list[bool]] = {"misfit": [], "discrepancy": []}
    for _ in range(5):
        values = twin.values.numpy() * np.exp(generator.normal(0, 0.5, 6))
        objective = objective_for(twin, replace(mistaken, interfaces=Interfaces.from_values(values)))
        point = solution(objective)
        around = linearize(objective, point)
        rules = {"misfit": widened_by_misfit(around), "discrepancy": posterior_covariance(objective, point)}
        for rule, covariance in rules.items():
            estimates = estimates_of(objective, point, covariance)
            is_held[rule] += [e.interval[0] <= v <= e.interval[1] for e, v in zip(estimates, values, strict=True)]
            is_narrow[rule] += [e.log_std <= IDENTIFIED_STD for e in estimates]
            assert all(e.verdict != "identified" for e in estimates)  # the misfit is too large
    narrow = {rule: np.mean(np.array(is_held[rule])[np.array(is_narrow[rule])]) for rule in is_held}
    assert np.mean(is_held["discrepancy"]) > np.mean(is_held["misfit"])
    assert narrow["discrepancy"] > narrow["misfit"]
    assert narrow["discrepancy"] >= 0.8


def test_the_covariance_is_that_of_estimates_under_the_noise_it_names(objective: Objective, point: np.ndarray) -> None:
    """Errors drawn from the covariance of a discrepancy move a linear search by as much as the sandwich says."""
    around = linearize(objective, point)
    discrepancy = replace(estimate_discrepancy(around), path=0.1, constants=(("mount", 0.05),))
    noise = noise_covariance(around, discrepancy)
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(len(noise)), noise, 4000, method="cholesky")
    scaled = around.slope / around.sigma[:, None]
    precision = np.diag(objective.unknowns.deviation**-2.0)
    moved = np.linalg.solve(scaled.T @ scaled + precision, scaled.T @ (draws / around.sigma).T)
    identified = [2, 4, 5]
    expected = np.sqrt(np.diag(sandwich(around, noise)))[identified]
    np.testing.assert_allclose(moved.std(axis=1)[identified], expected, rtol=0.06)


@pytest.mark.parametrize("share", [0.0, 0.002, 0.1, 0.5, 0.98, 1.0])
@pytest.mark.parametrize("std", [0.01, 0.3, 3.0])
def test_an_interval_always_holds_its_value(objective: Objective, share: float, std: float) -> None:
    unknowns = objective.unknowns
    point = unknowns.lower + share * (unknowns.upper - unknowns.lower)
    for estimate in estimates_of(objective, point, np.eye(6) * std**2):
        assert estimate.interval[0] <= estimate.value * (1 + 1e-12)
        assert estimate.value <= estimate.interval[1] * (1 + 1e-12)
        assert estimate.open_sides[0] == (estimate.interval[0] <= estimate.bounds[0] * (1 + 1e-9))
        wide = math.log(estimate.interval[1] / estimate.interval[0])
        assert wide == pytest.approx(min(2 * 1.645 * std, wide), rel=1e-3) or any(estimate.open_sides)


def test_a_one_sided_interval_is_said_to_be_one(objective: Objective) -> None:
    unknowns = objective.unknowns
    on_top = estimates_of(objective, unknowns.upper, np.eye(6) * 0.01)[0]
    assert on_top.verdict == "at bound"
    assert on_top.open_sides == (False, True)
    assert interval_words(on_top).startswith("at least ")
    middle = (unknowns.lower + unknowns.upper) / 2
    assert " to " in interval_words(estimates_of(objective, middle, np.eye(6) * 0.01)[0])
    assert interval_words(estimates_of(objective, middle, np.eye(6) * 400)[0]) != "at least"


def test_profiles_agree_with_the_deviations_where_a_value_is_identified(
    objective: Objective, point: np.ndarray
) -> None:
    std = np.sqrt(np.diag(posterior_covariance(objective, point)))
    pair = profiles(objective, point, ("C_v", "C_Hz"))
    for curve, i in zip(pair, (2, 4), strict=True):
        assert curve.is_identified
        low, high = curve.interval
        assert low is not None
        assert high is not None
        assert (high - low) / 2 == pytest.approx(1.645 * std[i], rel=0.1)
        assert (np.diff(curve.coordinate) > 0).all()
        assert curve.rise.min() == 0


def test_six_profiles_cost_few_simulations_and_leave_the_flat_value_open(
    objective: Objective, point: np.ndarray
) -> None:
    curves = {curve.name: curve for curve in profiles(objective, point)}
    assert sum(curve.simulations for curve in curves.values()) < 250
    assert curves["K_sw"].interval == (None, None)
    assert curves["K_sw"].words == "K_sw: not identified, open on both sides"
    assert curves["C_sw"].words == "C_sw: only a lower limit"
    assert curves["K_v"].is_identified
    assert to_table(profile(objective, point, "K_sw")) == to_table(curves["K_sw"])


def test_a_profile_is_the_least_over_all_other_coordinates(objective: Objective, point: np.ndarray) -> None:
    """Fitted anew from elsewhere with the value held, nothing lower is found."""
    from swashtwin.calibration.uncertainty.profiles import _WhitenedProblem

    curve = profile(objective, point, "K_Hz")
    problem = _WhitenedProblem(objective, point)
    index = int(np.argmax(curve.rise))
    start = point + 0.3
    start[5] = curve.coordinate[index]
    _, height = problem.descend(start, 5)
    _, least = problem.descend(point, None)
    assert height - least == pytest.approx(curve.rise[index], abs=0.15)


def test_an_unknown_coordinate_has_no_profile(objective: Objective, point: np.ndarray) -> None:
    with pytest.raises(InputError, match="no coordinate 'K_x' was searched"):
        profile(objective, point, "K_x")


def test_directions_name_what_can_be_traded(objective: Objective, point: np.ndarray) -> None:
    report = identifiability_at(objective, point)
    assert report.directions[-1].words == "not determined: K_sw"
    assert [direction.share for direction in report.directions] == sorted(
        direction.share for direction in report.directions
    )
    np.testing.assert_allclose([sum(w**2 for _, w in direction.weights) for direction in report.directions], 1)
    np.testing.assert_allclose(np.diag(report.correlation), 1)
    assert (report.share <= 1 + 1e-9).all()


def test_a_constant_without_effect_is_dead(twin: Twin) -> None:
    """A healthy pump has no excitation by a fault."""
    healthy = twin.with_fault(None)
    objective = objective_for(healthy, healthy, Nuisances.usual())
    report = identifiability_at(objective, objective.unknowns.start)
    assert dict(zip(report.names, report.standing, strict=True))["excitation"] == "dead"


def test_what_was_learned_is_reported_with_figures_and_as_json(
    objective: Objective, point: np.ndarray, tmp_path: Path
) -> None:
    report = identifiability_at(objective, point, with_profiles=True)
    page = write_report(report, folder=tmp_path).read_text(encoding="utf-8")
    assert "not determined: K_sw" in page
    assert "K_sw: not identified, open on both sides" in page
    figures = {path.stem.removeprefix("identifiabilityreport_") for path in (tmp_path / "figures").glob("*.svg")}
    assert figures == {"shares", "correlations", "profiles"}
    answer = json.loads((tmp_path / "results.json").read_text())["identifiability"][0]
    assert answer["standing"] == list(report.standing)
    assert len(answer["profiles"]) == 6


def test_a_calibration_on_a_wrong_twin_says_so_and_calls_nothing_identified_that_is_wrong(twin: Twin) -> None:
    true = replace(twin, scales=Scales(mount=1.2))
    recording = true.simulate(1.3, 6400.0, recording_id="rec")
    calibration = calibrate(twin, [recording], method=GaussNewton(starts=1), **SIX_VALUES)
    point = solution(objective_of(twin, measure(twin, [recording])))
    np.testing.assert_array_equal(calibration.posterior.point, point)  # the intervals move no value
    assert any("miss the measured ones" in note for note in calibration.notes)
    for estimate, value in zip(calibration.estimates, twin.values.tolist(), strict=True):
        if estimate.verdict == "identified":
            assert estimate.interval[0] <= value <= estimate.interval[1]


def test_a_saved_calibration_and_its_recordings_are_enough(twin: Twin, tmp_path: Path) -> None:
    recordings = [twin.simulate(1.3, 6400.0, recording_id=name) for name in ("a", "b")]
    calibration = calibrate(twin, recordings[:1], method=GaussNewton(starts=1), **SIX_VALUES)
    again = load_calibration(calibration.save(tmp_path / "calibration.json"))
    report = identifiability(again, recordings)
    np.testing.assert_allclose(report.std, np.sqrt(np.diag(calibration.posterior.covariance)))
    with pytest.raises(DataError, match="a is missing, on which the twin was calibrated"):
        identifiability(again, recordings[1:])
