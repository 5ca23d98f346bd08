"""The posterior by sampling, where a normal density about the optimum is not enough.

Differential evolution of an ensemble of walkers (ter Braak 2006, doi:10.1007/s11222-006-8769-1; ter Braak and Vrugt
2008, doi:10.1007/s11222-008-9104-9) by emcee (Foreman-Mackey et al. 2013, doi:10.1086/670067). All walkers that move
together are simulated in one batch.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import scipy.linalg
import torch
from jaxtyping import Float

from swashtwin.calibration.methods.search import Progress
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.discrepancy import estimate_discrepancy, linearize, noise_covariance
from swashtwin.calibration.uncertainty.posterior import Posterior, posterior_covariance
from swashtwin.foundation import InputError, MissingExtraError, derive_seed, one_thread

TIMES = 50
"""Autocorrelation times that a chain must be long: below, emcee's own estimate of that time is not to be trusted."""
ALIKE = 1.05
"""Ratio of the spread of all halves of walkers to that within them up to which they agree."""


@dataclass(frozen=True, eq=False)
class Sampling:
    """Draws from the posterior, and whether to trust them."""

    posterior: Posterior
    """The density as its draws: `Posterior.draws` and `Posterior.twins` take them."""
    acceptance: float
    """Share of the proposals that were taken; 0.2 to 0.5 is usual."""
    autocorrelation_time: float
    """Steps after which the slowest coordinate has forgotten where it was."""
    effective_size: float
    """Number of independent draws with as much information on the slowest coordinate."""
    spread_ratio: Float[np.ndarray, " unknown"]
    """Spread of all halves of walkers over that within them, for each coordinate (Gelman and Rubin's R-hat, although
    walkers of one ensemble are not independent); 1 where all agree."""
    steps: int
    """Steps of each walker after the burn-in."""
    simulations: int
    """How many parameter sets were simulated."""

    @property
    def is_converged(self) -> bool:
        """Whether the chain is long enough, and its parts agree."""
        return self.steps >= TIMES * self.autocorrelation_time and bool((self.spread_ratio < ALIKE).all())

    @property
    def words(self) -> str:
        """Whether to trust the draws."""
        length = (
            f"{self.steps} steps are {self.steps / self.autocorrelation_time:.3g} autocorrelation times, and parts of "
            f"the chain differ by up to {self.spread_ratio.max():.3f}"
        )
        if self.is_converged:
            return f"converged: {length}; {self.effective_size:.0f} independent draws."
        steps = int(np.ceil(1.2 * TIMES * self.autocorrelation_time / 100) * 100)
        return (
            f"NOT converged: {length}, of {TIMES} and {ALIKE} that are needed; try steps={max(steps, 2 * self.steps)}."
        )


def sample_posterior(
    objective: Objective,
    point: Float[np.ndarray, " unknown"],
    *,
    seed: int,
    steps: int = 2000,
    walkers: int | None = None,
    progress: Progress | None = None,
) -> Sampling:
    """Draws from the density of all coordinates given what was measured.

    Density of the lines: normal, with the covariance of `discrepancy` at `point`. It may therefore lie beside `point`,
    which weighs all lines as independent. Priors: normal for nuisances as for the six values, cut at the bounds.

    Parameters
    ----------
    point : a solution, around which the walkers start as its linearized posterior says.
    steps : of each walker; half as many before them are discarded.
    walkers : four for each coordinate by default, at least 24.
    progress : called with (steps done, steps in all, least misfit of a walker).

    Raises
    ------
    MissingExtraError
        emcee is not installed.
    """
    emcee = _emcee()
    size = len(objective.unknowns)
    walkers = max(24, 4 * size) if walkers is None else walkers
    if walkers < 2 * size or walkers % 2 or steps < 10:
        raise InputError(f"walkers ({walkers}) must be even and at least {2 * size}, steps ({steps}) at least 10.")
    density = _Density(objective, point)
    laplace = Posterior(
        objective.unknowns, objective.channels, np.asarray(point), posterior_covariance(objective, point)
    )
    burn_in, moves = steps // 2, [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    sampler = emcee.EnsembleSampler(walkers, size, density, moves=moves, vectorize=True)
    generator = np.random.RandomState(derive_seed(seed, "emcee") % 2**32)  # the only kind that emcee takes
    start = emcee.State(laplace.draws(walkers, seed), random_state=generator.get_state())
    with one_thread():
        for number, state in enumerate(sampler.sample(start, iterations=burn_in + steps), 1):
            if progress is not None and number % 20 == 0:
                progress(number, burn_in + steps, float(-2 * state.log_prob.max()))
    chain = sampler.get_chain(discard=burn_in)
    time, ratio = chain_quality(chain)
    draws = chain.reshape(-1, size)
    posterior = Posterior(objective.unknowns, objective.channels, np.asarray(point), np.cov(draws.T), thin(chain, time))
    return Sampling(
        posterior=posterior,
        acceptance=float(sampler.acceptance_fraction.mean()),
        autocorrelation_time=time,
        effective_size=len(draws) / time,
        spread_ratio=ratio,
        steps=steps,
        simulations=density.simulations,
    )


class _Density:
    """Logarithm of the density at each row."""

    def __init__(self, objective: Objective, point: np.ndarray) -> None:
        around = linearize(objective, point)
        self.objective, self.simulations = objective, 1
        self.root = np.linalg.cholesky(noise_covariance(around, estimate_discrepancy(around)))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        unknowns = self.objective.unknowns
        inside = ((points >= unknowns.lower) & (points <= unknowns.upper)).all(axis=1)
        result = np.full(len(points), -np.inf)
        if inside.any():
            rows = torch.as_tensor(points[inside])
            self.simulations += len(rows)
            with torch.no_grad():
                missed = (self.objective.observables(rows) - self.objective.measured).numpy()
                prior = self.objective.prior_loss(rows).numpy()
            white = scipy.linalg.solve_triangular(self.root, missed.T, lower=True)
            result[inside] = -0.5 * (np.square(white).sum(axis=0) + prior)
        return result


def chain_quality(
    chain: Float[np.ndarray, "step walker unknown"],
) -> tuple[float, Float[np.ndarray, " unknown"]]:
    """Autocorrelation time of the slowest coordinate [steps], and the spread ratio of each."""
    time = float(np.max(_emcee().autocorr.integrated_time(chain, tol=0, quiet=True)))
    half = len(chain) // 2
    parts = np.concatenate([chain[:half], chain[half : 2 * half]], axis=1)
    within, between = parts.var(axis=0, ddof=1).mean(axis=0), parts.mean(axis=0).var(axis=0, ddof=1)
    return max(1.0, time), np.sqrt((half - 1) / half + between / within)


def thin(chain: Float[np.ndarray, "step walker unknown"], time: float) -> Float[np.ndarray, "draw unknown"]:
    """At most about 2000 draws, no nearer than half an autocorrelation time in each walker."""
    stride = max(1, int(time / 2), len(chain) * chain.shape[1] // 2000)
    return chain[::stride].reshape(-1, chain.shape[-1])


def _emcee() -> Any:
    try:
        return import_module("emcee")
    except ImportError as cause:
        raise MissingExtraError(
            'sampling a posterior needs emcee, which is not installed: pip install "swashtwin[posterior]".'
        ) from cause
