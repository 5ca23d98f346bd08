"""The posterior: by its curvature and by sampling, and whether a chain may be believed."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton, Objective, Posterior, measure, objective_of, sample_posterior
from swashtwin.calibration.uncertainty.posterior import posterior_covariance
from swashtwin.calibration.uncertainty.sampling import Sampling, chain_quality, thin
from swashtwin.foundation import InputError, MissingExtraError, mm
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.signals import add_noise


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    defect = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    thick_film = Interfaces.from_values([98523.0, 8.1591e7, *pump.interfaces.values()[2:]])
    return Twin(pump, at_15, defect, thick_film, bandwidth=1100)


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    """A narrow problem: bounds so near that every prior matters, and all values well known."""
    recording = twin.simulate(1.3, 6400.0, recording_id="rec")
    recording = replace(recording, signal=add_noise(recording.signal, 30, 0))
    return objective_of(twin, measure(twin, [recording], (0, 1000)), 1.3)


@pytest.fixture(scope="module")
def point(objective: Objective) -> np.ndarray:
    return GaussNewton(starts=1).search(objective, seed=0).point


@pytest.fixture(scope="module")
def sampling(objective: Objective, point: np.ndarray) -> Sampling:
    return sample_posterior(objective, point, seed=0, steps=300)


def test_sampling_and_curvature_tell_the_same_where_values_are_well_known(
    objective: Objective, point: np.ndarray, sampling: Sampling
) -> None:
    assert sampling.posterior.sampled is not None
    draws = sampling.posterior.sampled
    laplace = Posterior(objective.unknowns, sampling.posterior.channels, point, posterior_covariance(objective, point))
    curved = laplace.draws(800, seed=1)  # cut at the bounds as the samples are
    np.testing.assert_allclose(draws.std(axis=0), curved.std(axis=0), rtol=0.25)
    assert (np.abs(draws.mean(axis=0) - curved.mean(axis=0)) < 0.4 * curved.std(axis=0)).all()
    assert (draws >= objective.unknowns.lower).all()
    assert (draws <= objective.unknowns.upper).all()


def test_a_short_chain_does_not_call_itself_converged(sampling: Sampling) -> None:
    short = sampling.steps < 50 * sampling.autocorrelation_time
    assert short
    assert not sampling.is_converged
    assert sampling.words.startswith("NOT converged: 300 steps are")
    assert "try steps=" in sampling.words


def test_a_long_chain_of_one_kind_calls_itself_converged(sampling: Sampling) -> None:
    chain = np.random.default_rng(0).standard_normal((2000, 24, 6))
    time, ratio = chain_quality(chain)
    good = replace(sampling, autocorrelation_time=time, spread_ratio=ratio, steps=2000)
    assert time == pytest.approx(1, abs=0.3)
    assert good.is_converged
    assert good.words.startswith("converged: ")
    drifting = chain + np.linspace(0, 2, 2000)[:, None, None]
    assert chain_quality(drifting)[1].min() > 1.05


def test_the_autocorrelation_time_is_that_of_the_process() -> None:
    """x' = a x + e has (1 + a) / (1 - a)."""
    generator, memory = np.random.default_rng(0), 0.9
    chain = np.zeros((6000, 24, 1))
    for step in range(1, len(chain)):
        chain[step] = memory * chain[step - 1] + generator.standard_normal((24, 1))
    assert chain_quality(chain)[0] == pytest.approx(19, rel=0.15)
    assert len(thin(chain, 19.0)) <= 2100


def test_the_same_seed_gives_the_same_draws(objective: Objective, point: np.ndarray) -> None:
    np.random.seed(5)  # what others do with the global generator must not matter  # noqa: NPY002
    first = sample_posterior(objective, point, seed=3, steps=10)
    np.random.seed(6)  # noqa: NPY002
    again = sample_posterior(objective, point, seed=3, steps=10)
    other = sample_posterior(objective, point, seed=4, steps=10)
    assert first.posterior.to_dict() == again.posterior.to_dict()
    assert first.posterior.to_dict() != other.posterior.to_dict()


def test_a_sampled_posterior_draws_from_its_samples_and_is_read_back(twin: Twin, sampling: Sampling) -> None:
    posterior = sampling.posterior
    assert posterior.sampled is not None
    draws = posterior.draws(5, seed=2)
    rows = {tuple(row) for row in posterior.sampled.tolist()}
    assert all(tuple(draw) in rows for draw in draws.tolist())
    np.testing.assert_array_equal(draws[:2], posterior.draws(2, seed=2))
    values = [drawn.values.numpy() for drawn in posterior.twins(twin, 2, seed=2)]
    np.testing.assert_allclose(values, np.exp(draws[:2, :6]))
    again = Posterior.from_dict(json.loads(json.dumps(posterior.to_dict())))
    assert again.to_dict() == posterior.to_dict()


def test_a_posterior_saved_before_there_were_samplers_is_still_read(sampling: Sampling) -> None:
    table = sampling.posterior.to_dict()
    del table["sampled"]
    assert Posterior.from_dict(table).sampled is None


def test_without_the_sampler_the_command_to_install_it_is_named(
    objective: Objective, point: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "emcee", None)
    with pytest.raises(MissingExtraError, match=r'pip install "swashtwin\[posterior\]"'):
        sample_posterior(objective, point, seed=0)


@pytest.mark.parametrize("settings", [{"walkers": 25}, {"walkers": 4}, {"steps": 1}])
def test_impossible_chains_are_refused(objective: Objective, point: np.ndarray, settings: dict[str, int]) -> None:
    with pytest.raises(InputError, match="must be even and at least 12"):
        sample_posterior(objective, point, seed=0, **settings)  # type: ignore[arg-type]
