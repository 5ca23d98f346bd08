"""The posterior: what is drawn from it follows its covariance and stays within the bounds."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton, Objective, Posterior, measure, objective_of
from swashtwin.calibration.uncertainty.posterior import posterior_covariance
from swashtwin.foundation import InputError, mm
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect
from swashtwin.signals import add_noise


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6)), bandwidth=1100)


@pytest.fixture(scope="module")
def posterior(twin: Twin) -> Posterior:
    recording = twin.simulate(1.3, 6400.0, recording_id="rec")
    recording = replace(recording, signal=add_noise(recording.signal, 30, 0))
    objective: Objective = objective_of(twin, measure(twin, [recording], (0, 1000)))
    point = GaussNewton(starts=1).search(objective, seed=0).point
    return Posterior(objective.unknowns, objective.channels, point, posterior_covariance(objective, point))


def test_draws_follow_the_covariance_within_the_bounds(posterior: Posterior) -> None:
    wide = replace(posterior, unknowns=replace(posterior.unknowns, lower=np.full(6, -99.0), upper=np.full(6, 99.0)))
    draws = wide.draws(2000, seed=1)
    np.testing.assert_allclose(draws.mean(axis=0), posterior.point, atol=0.1 * draws.std(axis=0).max())
    np.testing.assert_allclose(np.cov(draws.T), posterior.covariance, atol=0.1 * posterior.covariance.max())
    cut = posterior.draws(200, seed=1)
    assert (cut >= posterior.unknowns.lower).all()
    assert (cut <= posterior.unknowns.upper).all()


def test_a_draw_depends_on_the_seed_and_not_on_how_many_are_drawn(twin: Twin, posterior: Posterior) -> None:
    draws = posterior.draws(5, seed=2)
    np.testing.assert_array_equal(draws[:2], posterior.draws(2, seed=2))
    assert not np.array_equal(draws, posterior.draws(5, seed=3))
    values = [drawn.values.numpy() for drawn in posterior.twins(twin, 2, seed=2)]
    np.testing.assert_allclose(values, np.exp(draws[:2, :6]))
    with pytest.raises(InputError, match="must be at least 1"):
        posterior.draws(0, seed=0)
