"""The search methods: all minimize the same loss, are reproducible, and leave no trace."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from twin_recordings import recording_of

from swashtwin.calibration import (
    IPINN,
    Calibrator,
    GaussNewton,
    Nuisances,
    Objective,
    build_objective,
    measure,
)
from swashtwin.calibration.search import EXPECTED_LOSS
from swashtwin.physics import Scales, Twin

QUICK: dict[str, Calibrator] = {
    "gauss_newton": GaussNewton(starts=2),
    "ipinn": IPINN(epochs=6),
}
"""Every method, with few iterations."""
EACH_METHOD = pytest.mark.parametrize("method", QUICK.values(), ids=QUICK)


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    return build_objective(twin, measure(twin, [recording_of(twin)]))


@pytest.fixture(scope="module")
def objective_with_constants(twin: Twin) -> Objective:
    """The same, with constants of the pump in addition to the six values."""
    return build_objective(twin, measure(twin, [recording_of(twin)]), None, Nuisances.typical())


@EACH_METHOD
def test_a_search_returns_the_step_of_least_loss(objective: Objective, method: Calibrator) -> None:
    assert isinstance(method, Calibrator)

    search = method.search(objective, seed=0)

    history = search.history
    assert history.best_step == np.argmin(history.loss)
    np.testing.assert_array_equal(search.point, history.points[history.best_step])
    assert len(history.gradient_norm) == len(history.loss)
    assert (history.gradient_norm > 0).all()


def test_the_loss_of_gauss_newton_adds_the_prior_to_the_lines(objective: Objective) -> None:
    search = QUICK["gauss_newton"].search(objective, seed=0)
    history = search.history
    spectrum_loss = objective.weighted_loss(torch.as_tensor(search.point)).item()
    assert history.spectrum_loss[history.best_step] == pytest.approx(spectrum_loss)

    unknowns = objective.unknowns
    deviations = (search.point - unknowns.center) / unknowns.deviation
    prior_loss = np.square(deviations).sum() / objective.measured.numel()
    assert history.min_loss == pytest.approx(np.sqrt(spectrum_loss**2 + prior_loss))


@EACH_METHOD
def test_the_same_seed_gives_the_same_bits(objective: Objective, method: Calibrator) -> None:
    first = method.search(objective, seed=5)
    second = method.search(objective, seed=5)
    np.testing.assert_array_equal(first.history.points, second.history.points)
    np.testing.assert_array_equal(first.point, second.point)


@EACH_METHOD
def test_a_search_does_not_change_the_global_random_state(
    objective: Objective, method: Calibrator
) -> None:
    def seed_global_generators() -> None:
        torch.manual_seed(1)
        np.random.seed(1)  # noqa: NPY002  # what a library might change

    seed_global_generators()
    expected = (torch.rand(1), np.random.rand())  # noqa: NPY002

    seed_global_generators()
    method.search(objective, seed=5)

    assert (torch.rand(1), np.random.rand()) == expected  # noqa: NPY002


def test_the_papers_recipe_has_no_prior_on_the_six_values(objective: Objective) -> None:
    history = IPINN(epochs=8).search(objective, seed=0).history
    np.testing.assert_array_equal(history.prior_loss, 0)
    # although the values move
    assert (np.diff(history.points, axis=0) != 0).any()


def test_the_papers_recipe_has_a_prior_on_further_constants(
    objective_with_constants: Objective,
) -> None:
    history = IPINN(epochs=8).search(objective_with_constants, seed=0).history
    assert history.prior_loss[-1] > 0


def test_further_starts_find_the_valley_that_the_nominal_values_miss(twin: Twin) -> None:
    stiff = recording_of(replace(twin, scales=Scales(mount=1.8)))
    objective = build_objective(twin, measure(twin, [stiff]), None, Nuisances(mount=0.4))

    def stiffness_found(starts: int) -> tuple[float, float]:
        search = GaussNewton(starts=starts).search(objective, seed=0)
        factor = np.exp(search.point[objective.unknowns.scale_index("mount")])
        return float(factor), search.history.min_loss

    factor, loss = stiffness_found(starts=1)
    assert factor != pytest.approx(1.8, rel=0.1)
    assert loss > EXPECTED_LOSS

    factor, loss = stiffness_found(starts=4)
    assert factor == pytest.approx(1.8, rel=0.05)
    assert loss < EXPECTED_LOSS


def test_a_start_that_meets_the_lines_is_the_only_one(objective: Objective) -> None:
    several = GaussNewton(starts=4).search(objective, seed=0)
    assert several.history.min_loss < EXPECTED_LOSS
    assert several.simulations == GaussNewton(starts=1).search(objective, seed=0).simulations
