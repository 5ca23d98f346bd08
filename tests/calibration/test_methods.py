"""The methods that search: all minimize the same thing, count what they simulate, and leave no
trace behind.
"""

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
from swashtwin.physics import Twin

QUICK: dict[str, Calibrator] = {
    "gauss_newton": GaussNewton(starts=2),
    "ipinn": IPINN(epochs=6),
}
"""Every method, cut short."""
each_method = pytest.mark.parametrize("method", QUICK.values(), ids=QUICK)


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    return build_objective(twin, measure(twin, [recording_of(twin)]))


@pytest.fixture(scope="module")
def constants(twin: Twin) -> Objective:
    """The same, with constants beside the six values."""
    return build_objective(twin, measure(twin, [recording_of(twin)]), None, Nuisances.typical())


@each_method
def test_the_step_of_least_loss_is_kept(objective: Objective, method: Calibrator) -> None:
    assert isinstance(method, Calibrator)
    search = method.search(objective, seed=0)
    history = search.history
    assert history.best_step == np.argmin(history.loss)
    np.testing.assert_array_equal(search.point, history.points[history.best_step])
    point = torch.as_tensor(search.point)
    weighted = objective.weighted_loss(point)
    if not isinstance(method, IPINN):
        assert history.spectrum_loss[history.best_step] == pytest.approx(weighted.item())
        unknowns = objective.unknowns
        away = (
            np.square((search.point - unknowns.center) / unknowns.deviation).sum()
            / objective.measured.numel()
        )
        assert history.min_loss == pytest.approx(np.sqrt(weighted.item() ** 2 + away))
    assert len(history.gradient_norm) == len(history.loss)
    assert (history.gradient_norm > 0).all()


@each_method
def test_the_same_seed_gives_the_same_bits_and_leaves_random_numbers_as_they_were(
    objective: Objective, method: Calibrator
) -> None:
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002  # what a library might change
    expected = torch.rand(1), np.random.rand()  # noqa: NPY002
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002
    first = method.search(objective, seed=5)
    assert (torch.rand(1), np.random.rand()) == expected  # noqa: NPY002
    again = method.search(objective, seed=5)
    np.testing.assert_array_equal(first.history.points, again.history.points)
    np.testing.assert_array_equal(first.point, again.point)


def test_the_papers_recipe_counts_no_prior_of_the_six_values(
    objective: Objective, constants: Objective
) -> None:
    paper = IPINN(epochs=8).search(objective, seed=0).history
    np.testing.assert_array_equal(paper.prior_loss, 0)
    assert (np.diff(paper.points, axis=0) != 0).any()
    assert IPINN(epochs=8).search(constants, seed=0).history.prior_loss[-1] > 0
