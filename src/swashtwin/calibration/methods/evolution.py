"""A search that needs no gradient: covariance matrix adaptation."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from swashtwin.calibration.methods.search import EXACT, Progress, Search, Trace, load_extra, with_priors
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.foundation import InputError, one_thread, stream
from swashtwin.physics import SteadySolver


@dataclass(frozen=True)
class CMAES:
    """Covariance matrix adaptation evolution strategy (DOI 10.1162/106365601750190398), by the library cma.

    Minimized is the penalized loss, whose minimum is that of `GaussNewton` and `LBFGS`: the root mean square of
    (simulated - measured) / sigma over all lines, the priors being counted as `with_priors` says. It sees values only,
    and so serves where a model has no derivatives. Coordinates are scaled to the width of their bounds; a generation is
    simulated as one batch.

    Needs the extra ``search``.
    """

    most_simulations: int = 3000
    """No generation is begun after so many."""
    width: float = 0.25
    """Standard deviation of the first generation, as a share of the bounds' width."""
    population: int | None = None
    """Points in a generation; the library's choice by default, 9 for six unknowns."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    def __post_init__(self) -> None:
        if self.most_simulations < 1 or (self.population is not None and self.population < 4):
            raise InputError(
                f"most_simulations ({self.most_simulations}) must be at least 1 and population ({self.population}) 4."
            )
        if not 0 < self.width <= 1:
            raise InputError(f"width ({self.width:g}) must lie within 0...1, such as 0.25.")

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Best point of all generations; see `Calibrator`.

        Raises
        ------
        MissingExtraError
            The library is not installed.
        """
        cma = load_extra("cma")
        unknowns, generator = objective.unknowns, stream(seed, "cma_es")
        lower, span = unknowns.lower, unknowns.upper - unknowns.lower
        options = {
            "bounds": [0, 1],
            "randn": lambda *shape: generator.standard_normal(shape),
            "seed": np.nan,  # its own generator is the one above
            "verbose": -9,
            "tolfun": 1e-7,
            "tolx": 1e-5,
            "popsize": self.population,
        }
        start = (unknowns.start - lower) / span
        settings = {name: value for name, value in options.items() if value is not None}
        strategy, trace, simulations = cma.CMAEvolutionStrategy(start, self.width, settings), Trace(), 0
        with one_thread():
            while not strategy.stop() and simulations < self.most_simulations:
                candidates = strategy.ask()
                points = torch.as_tensor(lower + span * np.stack(candidates))
                with torch.no_grad():
                    weighted = objective.weighted_loss(points, solver=self.solver)
                    penalized = with_priors(objective, points, weighted)
                strategy.tell(candidates, penalized.tolist())
                best = int(penalized.argmin())
                trace.add(points[best].numpy(), weighted[best].item(), penalized[best].item())
                simulations += len(candidates)
                if progress is not None:
                    progress(min(simulations, self.most_simulations), self.most_simulations, penalized[best].item())
        search = trace.search(simulations)
        return search if strategy.stop() else replace(search, notes=(*search.notes, self._unsettled))

    @property
    def _unsettled(self) -> str:
        return (
            f"the search ended at its limit of {self.most_simulations} simulations before it converged, and its "
            "intervals are those of an optimum only: raise most_simulations, or use GaussNewton."
        )
