"""What a measurement can tell, and that intervals hold what they promise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, with_amplitudes

from swashtwin.calibration import (
    GaussNewton,
    Nuisances,
    Objective,
    Posterior,
    build_objective,
    calibrate,
    measure,
)
from swashtwin.calibration.discrepancy import (
    estimate_discrepancy,
    linearize,
    noise_covariance,
)
from swashtwin.calibration.posterior import (
    build_estimates,
    posterior_covariance,
    sandwich_covariance,
)
from swashtwin.foundation import InputError, random_stream
from swashtwin.physics import Scales, Twin
from swashtwin.pump import Interfaces
from swashtwin.report.calibration_part import describe_interval
from swashtwin.signals import add_noise

NONE = Nuisances()


def objective_for(
    assumed: Twin, true: Twin, nuisances: Nuisances = NONE, band: float = 2500
) -> Objective:
    """Objective of calibrating `assumed` on a noisy recording (30 dB) of `true`."""
    recording = true.simulate(1.3, 6400.0, phase=1.0, recording_id="rec")
    recording = replace(recording, signal=add_noise(recording.signal, 30, 0))
    return build_objective(assumed, measure(assumed, [recording], (0, band)), None, nuisances)


def solution(objective: Objective) -> np.ndarray:
    return GaussNewton(starts=1).search(objective, seed=0).point


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
def posterior(objective: Objective, point: np.ndarray) -> Posterior:
    return Posterior(objective.unknowns, point, posterior_covariance(objective, point))


@pytest.mark.parametrize("film", ["paper", "thick"])
def test_intervals_hold_the_truth_as_often_as_they_say(twin: Twin, thick: Twin, film: str) -> None:
    base = replace(twin if film == "paper" else thick, bandwidth=1100)
    objective = objective_for(base, base, band=1000)
    truth = objective.unknowns.start
    clean = with_amplitudes(objective, objective.observables(objective.start).detach().numpy())
    is_held, is_far = [], []
    for index in range(20):
        noise = clean.sigma.numpy() * random_stream(0, "coverage", index).standard_normal(
            len(clean.sigma)
        )
        noisy = with_amplitudes(objective, np.abs(clean.measured.numpy() + noise))
        point = GaussNewton(starts=1).search(noisy, seed=0).point
        for estimate, true in zip(
            build_estimates(noisy, point, posterior_covariance(noisy, point)), truth, strict=False
        ):
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
    assert (
        build_estimates(objective, point, posterior_covariance(objective, point))[1].verdict
        == "not identified"
    )
    other = objective_for(thick, thick)
    assert (
        build_estimates(other, solution(other), posterior_covariance(other, solution(other)))[
            1
        ].verdict
        == "identified"
    )


def test_a_twin_that_is_right_lacks_nothing_and_has_the_deviations_of_its_noise(
    objective: Objective, point: np.ndarray
) -> None:
    around = linearize(objective, point)
    discrepancy = estimate_discrepancy(around)
    assert (discrepancy.excitation, discrepancy.path, discrepancy.line) == (0, 0, 0)
    assert all(share == 0 for _, share in discrepancy.constants)
    scaled = around.slope / around.sigma[:, None]
    fisher = scaled.T @ scaled + np.diag(objective.unknowns.deviation**-2.0)
    np.testing.assert_allclose(
        posterior_covariance(objective, point), np.linalg.inv(fisher), rtol=1e-6, atol=1e-12
    )


def test_the_covariance_is_that_of_estimates_under_the_noise_it_names(
    objective: Objective, point: np.ndarray
) -> None:
    """Errors drawn from the covariance of a discrepancy move a linear search by as much as the
    sandwich_covariance says.
    """
    around = linearize(objective, point)
    discrepancy = replace(estimate_discrepancy(around), path=0.1, constants=(("mount", 0.05),))
    noise = noise_covariance(around, discrepancy)
    draws = np.random.default_rng(0).multivariate_normal(
        np.zeros(len(noise)), noise, 4000, method="cholesky"
    )
    scaled = around.slope / around.sigma[:, None]
    precision = np.diag(objective.unknowns.deviation**-2.0)
    moved = np.linalg.solve(scaled.T @ scaled + precision, scaled.T @ (draws / around.sigma).T)
    identified = [2, 4, 5]
    expected = np.sqrt(np.diag(sandwich_covariance(around, noise)))[identified]
    np.testing.assert_allclose(moved.std(axis=1)[identified], expected, rtol=0.06)


@pytest.mark.parametrize("share", [0.0, 0.002, 0.1, 0.5, 0.98, 1.0])
@pytest.mark.parametrize("std", [0.01, 0.3, 3.0])
def test_an_interval_always_holds_its_value(objective: Objective, share: float, std: float) -> None:
    unknowns = objective.unknowns
    point = unknowns.lower + share * (unknowns.upper - unknowns.lower)
    for estimate in build_estimates(objective, point, np.eye(6) * std**2):
        assert estimate.interval[0] <= estimate.value * (1 + 1e-12)
        assert estimate.value <= estimate.interval[1] * (1 + 1e-12)
        assert estimate.open_sides[0] == (estimate.interval[0] <= estimate.bounds[0] * (1 + 1e-9))
        wide = math.log(estimate.interval[1] / estimate.interval[0])
        assert wide == pytest.approx(min(2 * 1.645 * std, wide), rel=1e-3) or any(
            estimate.open_sides
        )


def test_a_one_sided_interval_is_said_to_be_one(objective: Objective) -> None:
    unknowns = objective.unknowns
    on_top = build_estimates(objective, unknowns.upper, np.eye(6) * 0.01)[0]
    assert on_top.verdict == "at bound"
    assert on_top.open_sides == (False, True)
    assert describe_interval(on_top).startswith("at least ")
    middle = (unknowns.lower + unknowns.upper) / 2
    assert " to " in describe_interval(build_estimates(objective, middle, np.eye(6) * 0.01)[0])
    assert describe_interval(build_estimates(objective, middle, np.eye(6) * 400)[0]) != "at least"


def test_a_calibration_on_a_wrong_twin_says_so_and_calls_nothing_identified_that_is_wrong(
    twin: Twin,
) -> None:
    true = replace(twin, scales=Scales(mount=1.2))
    recording = true.simulate(1.3, 6400.0, recording_id="rec")
    calibration = calibrate(twin, [recording], method=GaussNewton(starts=1), **SIX_VALUES)
    point = solution(build_objective(twin, measure(twin, [recording])))
    np.testing.assert_array_equal(calibration.posterior.point, point)  # the intervals move no value
    assert any("miss the measured ones" in note for note in calibration.notes)
    for estimate, value in zip(calibration.estimates, twin.values.tolist(), strict=True):
        if estimate.verdict == "identified":
            assert estimate.interval[0] <= value <= estimate.interval[1]


def test_draws_follow_the_covariance_within_the_bounds(posterior: Posterior) -> None:
    space = replace(posterior.unknowns.space, lower=np.full(6, 1e-30), upper=np.full(6, 1e30))
    wide = replace(posterior, unknowns=replace(posterior.unknowns, space=space))
    draws = wide.draws(2000, seed=1)
    np.testing.assert_allclose(
        draws.mean(axis=0), posterior.point, atol=0.1 * draws.std(axis=0).max()
    )
    np.testing.assert_allclose(
        np.cov(draws.T), posterior.covariance, atol=0.1 * posterior.covariance.max()
    )
    cut = posterior.draws(200, seed=1)
    assert (cut >= posterior.unknowns.lower).all()
    assert (cut <= posterior.unknowns.upper).all()


def test_a_draw_depends_on_the_seed_and_not_on_how_many_are_drawn(
    twin: Twin, posterior: Posterior
) -> None:
    draws = posterior.draws(5, seed=2)
    np.testing.assert_array_equal(draws[:2], posterior.draws(2, seed=2))
    assert not np.array_equal(draws, posterior.draws(5, seed=3))
    values = [drawn.values.numpy() for drawn in posterior.twins(twin, 2, seed=2)]
    np.testing.assert_allclose(values, np.exp(draws[:2, :6]))
    with pytest.raises(InputError, match="must be at least 1"):
        posterior.draws(0, seed=0)
