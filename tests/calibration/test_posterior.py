"""The posterior: coverage of its intervals, verdicts, discrepancy, and draws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, with_amplitudes

from swashtwin.calibration import (
    Calibration,
    Estimate,
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
    build_estimate,
    build_estimates,
    find_strained_constants,
    is_in_doubt,
    posterior_covariance,
    sandwich_covariance,
)
from swashtwin.foundation import InputError, random_stream
from swashtwin.physics import Scales, Twin
from swashtwin.pump import Interfaces
from swashtwin.recordings import Recording
from swashtwin.report.calibration_part import describe_interval
from swashtwin.signals import add_noise

NO_NUISANCES = Nuisances()
K_SW = 1
IDENTIFIED = [2, 4, 5]
"""Indices of the values that a recording of the twin determines: C_v, C_Hz and K_Hz."""


def objective_for(
    assumed: Twin, true: Twin, nuisances: Nuisances = NO_NUISANCES, band: float = 2500
) -> Objective:
    """Objective of calibrating `assumed` on a noisy recording (30 dB) of `true`."""
    recording = true.simulate(1.3, 6400.0, phase=1.0, recording_id="rec")
    recording = replace(recording, signal=add_noise(recording.signal, 30, 0))
    return build_objective(assumed, measure(assumed, [recording], (0, band)), None, nuisances)


def find_minimum(objective: Objective) -> np.ndarray:
    return GaussNewton(starts=1).search(objective, seed=0).point


@pytest.fixture(scope="module")
def thick_film_twin(twin: Twin) -> Twin:
    """The twin with slippers on 24 um of oil."""
    return twin.with_interfaces(Interfaces.from_values([98523.0, 8.1591e7, *twin.values[2:]]))


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    return objective_for(twin, twin)


@pytest.fixture(scope="module")
def point(objective: Objective) -> np.ndarray:
    return find_minimum(objective)


@pytest.fixture(scope="module")
def posterior(objective: Objective, point: np.ndarray) -> Posterior:
    return Posterior(objective.unknowns, point, posterior_covariance(objective, point))


def estimates_at(objective: Objective, point: np.ndarray) -> tuple[Estimate, ...]:
    return build_estimates(objective, point, posterior_covariance(objective, point))


@pytest.mark.parametrize("film", ["paper", "thick"])
def test_intervals_contain_the_truth_as_often_as_they_promise(
    twin: Twin, thick_film_twin: Twin, film: str
) -> None:
    true_twin = replace(twin if film == "paper" else thick_film_twin, bandwidth=1100)
    objective = objective_for(true_twin, true_twin, band=1000)
    true_logs = objective.unknowns.start
    lines = objective.observables(objective.start).detach().numpy()
    clean = with_amplitudes(objective, lines)
    sigma = clean.sigma.numpy()

    covers = []
    is_far = []
    for index in range(20):
        noise = sigma * random_stream(0, "coverage", index).standard_normal(len(sigma))
        noisy = with_amplitudes(objective, np.abs(clean.measured.numpy() + noise))
        estimates = estimates_at(noisy, find_minimum(noisy))
        for estimate, true_log in zip(estimates, true_logs, strict=False):
            if estimate.verdict == "identified":
                low, high = np.log(estimate.interval)
                covers.append(low <= true_log <= high)
                is_far.append(abs(np.log(estimate.value) - true_log) > 3 * estimate.log_std)

    # around the promised 90 %, by chance of 20 recordings
    assert 0.8 <= np.mean(covers) <= 0.97
    assert np.mean(is_far) <= 0.03


def test_the_slippers_stiffness_is_identified_under_a_thick_film_only(
    objective: Objective, point: np.ndarray, thick_film_twin: Twin
) -> None:
    assert estimates_at(objective, point)[K_SW].verdict == "not identified"

    # physics.md 6: identifiable below C_sw of about 1e5
    assert thick_film_twin.values[0] <= 1e5
    thick_film = objective_for(thick_film_twin, thick_film_twin)
    thick_film_point = find_minimum(thick_film)
    assert estimates_at(thick_film, thick_film_point)[K_SW].verdict == "identified"


def test_a_correct_twin_has_no_discrepancy(objective: Objective, point: np.ndarray) -> None:
    discrepancy = estimate_discrepancy(linearize(objective, point))
    assert discrepancy.excitation == 0
    assert discrepancy.path == 0
    assert discrepancy.line == 0
    assert all(share == 0 for _, share in discrepancy.constants)


def test_the_covariance_of_a_correct_twin_is_the_inverse_fisher_matrix(
    objective: Objective, point: np.ndarray
) -> None:
    linear = linearize(objective, point)
    scaled_slope = linear.slope / linear.sigma[:, None]
    prior_precision = np.diag(objective.unknowns.deviation**-2.0)
    fisher = scaled_slope.T @ scaled_slope + prior_precision

    covariance = posterior_covariance(objective, point)

    np.testing.assert_allclose(covariance, np.linalg.inv(fisher), rtol=1e-6, atol=1e-12)


def test_errors_drawn_from_a_discrepancy_scatter_the_estimates_by_the_sandwich_covariance(
    objective: Objective, point: np.ndarray
) -> None:
    linear = linearize(objective, point)
    discrepancy = replace(estimate_discrepancy(linear), path=0.1, constants=(("mount", 0.05),))
    noise = noise_covariance(linear, discrepancy)

    # least squares of the linear problem, for 4,000 draws of the errors
    errors = np.random.default_rng(0).multivariate_normal(
        np.zeros(len(noise)), noise, 4000, method="cholesky"
    )
    scaled_slope = linear.slope / linear.sigma[:, None]
    scaled_errors = (errors / linear.sigma).T
    prior_precision = np.diag(objective.unknowns.deviation**-2.0)
    estimate_errors = np.linalg.solve(
        scaled_slope.T @ scaled_slope + prior_precision, scaled_slope.T @ scaled_errors
    )

    covariance = sandwich_covariance(linear, noise)
    expected = np.sqrt(np.diag(covariance))[IDENTIFIED]
    np.testing.assert_allclose(estimate_errors.std(axis=1)[IDENTIFIED], expected, rtol=0.06)


@pytest.mark.parametrize("share", [0.0, 0.002, 0.1, 0.5, 0.98, 1.0])
@pytest.mark.parametrize("std", [0.01, 0.3, 3.0])
def test_an_interval_always_contains_its_value(
    objective: Objective, share: float, std: float
) -> None:
    unknowns = objective.unknowns
    point = unknowns.lower + share * (unknowns.upper - unknowns.lower)

    for estimate in build_estimates(objective, point, np.eye(6) * std**2):
        low, high = estimate.interval
        assert low <= estimate.value * (1 + 1e-12)
        assert estimate.value <= high * (1 + 1e-12)
        assert estimate.open_sides[0] == (low <= estimate.bounds[0] * (1 + 1e-9))

        # 90 %, unless a bound cuts it
        log_width = math.log(high / low)
        full_width = min(2 * 1.645 * std, log_width)
        assert log_width == pytest.approx(full_width, rel=1e-3) or any(estimate.open_sides)


@pytest.mark.parametrize(
    ("log_std", "prior_std", "in_doubt", "verdict"),
    [
        # within a factor of 1.5 at 90 %
        (0.25, 1.0, False, "identified"),
        (0.25, 1.0, True, "weak"),
        (0.26, 1.0, False, "weak"),
        # more than 0.7 of what was known before
        (0.69, 1.0, False, "weak"),
        (0.71, 1.0, False, "not identified"),
        (0.20, 0.28, False, "not identified"),
    ],
)
def test_a_verdict_depends_on_the_uncertainty_left_and_on_doubt(
    log_std: float, prior_std: float, in_doubt: bool, verdict: str
) -> None:
    estimate = build_estimate(
        "clearance",
        "h",
        "m",
        nominal=1.0,
        value=1.0,
        log_std=log_std,
        prior_std=prior_std,
        bounds=(1e-3, 1e3),
        in_doubt=in_doubt,
    )
    assert estimate.verdict == verdict


def test_no_value_is_identified_if_a_mistake_is_suspected(
    objective: Objective, point: np.ndarray
) -> None:
    covariance = posterior_covariance(objective, point)
    certain = [
        estimate.verdict
        for estimate in build_estimates(objective, point, covariance, has_suspected_mistake=False)
    ]
    suspected = [
        estimate.verdict
        for estimate in build_estimates(objective, point, covariance, has_suspected_mistake=True)
    ]

    assert "identified" in certain
    expected = ["weak" if verdict == "identified" else verdict for verdict in certain]
    assert suspected == expected


@pytest.fixture(scope="module")
def many_constants(twin: Twin) -> Objective:
    """Objective that also searches a bearing, the gains of the channels and a housing mode."""
    return objective_for(twin, twin, Nuisances(bearing=0.3, gains=0.1, modes=1))


@pytest.mark.parametrize(("distance", "is_strained"), [(2.49, False), (2.51, True), (-2.51, True)])
def test_a_constant_is_strained_far_from_its_prior_mean(
    many_constants: Objective, distance: float, is_strained: bool
) -> None:
    unknowns = many_constants.unknowns
    for index in range(6, len(unknowns.names)):
        point = unknowns.center.copy()
        point[index] += distance * unknowns.deviation[index]

        strained = find_strained_constants(unknowns, point)
        assert strained == ((unknowns.names[index],) if is_strained else ())
        assert is_in_doubt(unknowns, point, misfit=1.0) == is_strained


def test_a_fit_is_in_doubt_from_twice_the_expected_misfit_on(many_constants: Objective) -> None:
    unknowns = many_constants.unknowns
    assert not is_in_doubt(unknowns, unknowns.center, misfit=2.0)
    assert is_in_doubt(unknowns, unknowns.center, misfit=2.01)


def test_a_twin_of_the_posterior_has_the_gains_and_the_housing_of_its_point(
    twin: Twin, many_constants: Objective
) -> None:
    unknowns = many_constants.unknowns
    assert twin.path is None

    posterior = Posterior(unknowns, unknowns.center, np.diag(unknowns.deviation**2))
    calibrated = posterior.twin_at(twin, unknowns.center)

    assert calibrated.path == unknowns.sensor_path_at(unknowns.center, twin.pump.channels)
    assert calibrated.path is not None


def test_an_interval_that_is_open_above_is_described_by_its_lower_end(
    objective: Objective,
) -> None:
    at_upper_bound = build_estimates(objective, objective.unknowns.upper, np.eye(6) * 0.01)[0]
    assert at_upper_bound.verdict == "at bound"
    assert at_upper_bound.open_sides == (False, True)
    assert describe_interval(at_upper_bound).startswith("at least ")


@pytest.mark.parametrize("variance", [0.01, 400], ids=["certain", "uncertain"])
def test_an_interval_within_the_bounds_is_described_by_both_ends(
    objective: Objective, variance: float
) -> None:
    unknowns = objective.unknowns
    middle = (unknowns.lower + unknowns.upper) / 2
    estimate = build_estimates(objective, middle, np.eye(6) * variance)[0]
    assert " to " in describe_interval(estimate)


@pytest.fixture(scope="module")
def stiffer_recording(twin: Twin) -> Recording:
    """Recording of a machine whose mounting is 20 % stiffer than the twin's."""
    true_twin = replace(twin, scales=Scales(mount=1.2))
    return true_twin.simulate(1.3, 6400.0, recording_id="rec")


@pytest.fixture(scope="module")
def wrong_calibration(twin: Twin, stiffer_recording: Recording) -> Calibration:
    # Given bounds are not widened: C_sw ends at its lower one.
    return calibrate(
        twin, [stiffer_recording], method=GaussNewton(starts=1), bounds=10.0, **SIX_VALUES
    )


def test_the_misfit_of_a_wrong_twin_is_noted(wrong_calibration: Calibration) -> None:
    assert any(
        "times as much as noise and model error explain" in note for note in wrong_calibration.notes
    )


def test_the_intervals_of_a_wrong_twin_change_no_value(
    twin: Twin, stiffer_recording: Recording, wrong_calibration: Calibration
) -> None:
    point = find_minimum(build_objective(twin, measure(twin, [stiffer_recording])))
    np.testing.assert_array_equal(wrong_calibration.posterior.point, point)


def test_intervals_of_identified_values_of_a_wrong_twin_contain_the_truth(
    twin: Twin, wrong_calibration: Calibration
) -> None:
    for estimate, true in zip(wrong_calibration.estimates, twin.values.tolist(), strict=True):
        if estimate.verdict == "identified":
            assert estimate.interval[0] <= true <= estimate.interval[1]


def test_draws_follow_the_covariance(posterior: Posterior) -> None:
    # without bounds, which would cut the distribution
    space = replace(posterior.unknowns.space, lower=np.full(6, 1e-30), upper=np.full(6, 1e30))
    unbounded = replace(posterior, unknowns=replace(posterior.unknowns, space=space))

    draws = unbounded.draws(2000, seed=1)

    mean_tolerance = 0.1 * draws.std(axis=0).max()
    np.testing.assert_allclose(draws.mean(axis=0), posterior.point, atol=mean_tolerance)
    covariance_tolerance = 0.1 * posterior.covariance.max()
    np.testing.assert_allclose(np.cov(draws.T), posterior.covariance, atol=covariance_tolerance)


def test_draws_stay_within_the_bounds(posterior: Posterior) -> None:
    draws = posterior.draws(200, seed=1)
    assert (draws >= posterior.unknowns.lower).all()
    assert (draws <= posterior.unknowns.upper).all()


def test_a_draw_depends_on_the_seed_and_not_on_the_number_of_draws(posterior: Posterior) -> None:
    draws = posterior.draws(5, seed=2)
    np.testing.assert_array_equal(draws[:2], posterior.draws(2, seed=2))
    assert not np.array_equal(draws, posterior.draws(5, seed=3))


def test_twins_of_the_posterior_have_the_values_of_its_draws(
    twin: Twin, posterior: Posterior
) -> None:
    draws = posterior.draws(5, seed=2)
    values = [sample.values.numpy() for sample in posterior.twins(twin, 2, seed=2)]
    np.testing.assert_allclose(values, np.exp(draws[:2, :6]))


def test_a_number_of_draws_that_is_not_positive_is_refused(posterior: Posterior) -> None:
    with pytest.raises(InputError, match="must be at least 1"):
        posterior.draws(0, seed=0)
