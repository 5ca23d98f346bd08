"""Searches that follow the loss's exact gradient and need nothing of how it is made."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.methods.checkpoint import Checkpoint
from swashtwin.calibration.methods.search import (
    EXACT,
    Decay,
    Progress,
    Search,
    Trace,
    best_of,
    starting_points,
    with_priors,
)
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.foundation import InputError, one_thread, stream
from swashtwin.physics import SteadySolver


@dataclass(frozen=True)
class LBFGS:
    """Quasi-Newton search with bounds (L-BFGS-B) from several starts.

    Minimized is what `GaussNewton` minimizes, the negative logarithm of the posterior density: half the sum of squares
    of (simulated - measured) / sigma over all lines, plus half that of (coordinate - mean of its prior) / prior
    standard deviation. Coordinates are scaled by their priors' deviations. It knows the gradient of that sum, not of
    each line, and so takes more simulations; it needs no sum of squares either.
    """

    starts: int = 4
    """First the nominal values, then others drawn evenly over the logarithms within the bounds."""
    most_iterations: int = 200
    """At most so many steps from each start."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    def __post_init__(self) -> None:
        if self.starts < 1 or self.most_iterations < 1:
            raise InputError(f"starts ({self.starts}) and most_iterations ({self.most_iterations}) must be at least 1.")

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Values of the best start; see `Calibrator`."""
        unknowns, generator = objective.unknowns, stream(seed, "lbfgs", "starts")
        center, scale = unknowns.center, unknowns.deviation
        bounds = np.stack([(unknowns.lower - center) / scale, (unknowns.upper - center) / scale], axis=1)
        runs: list[Search] = []
        with one_thread():
            for number, start in enumerate(starting_points(unknowns, self.starts, generator)):
                density = NegativeLogPosterior(objective, self.solver)
                scipy.optimize.minimize(
                    density,
                    (start - center) / scale,
                    jac=True,
                    method="L-BFGS-B",
                    bounds=bounds,
                    options={"maxiter": self.most_iterations, "ftol": 1e-11, "gtol": 1e-8},
                )
                runs.append(density.trace.search())
                if progress is not None:
                    progress(number + 1, self.starts, min(run.history.least_loss for run in runs))
        return best_of(runs)


class NegativeLogPosterior:
    """Negative logarithm of the posterior density and its gradient, at coordinates scaled by their priors."""

    def __init__(self, objective: Objective, solver: SteadySolver) -> None:
        self.objective, self.solver, self.trace = objective, solver, Trace()

    def __call__(self, scaled: Float[np.ndarray, " unknown"]) -> tuple[float, Float[np.ndarray, " unknown"]]:
        """Value, up to a constant, and gradient."""
        objective, unknowns = self.objective, self.objective.unknowns
        coordinates = torch.as_tensor(scaled).clone().requires_grad_()
        point = torch.as_tensor(unknowns.center) + torch.as_tensor(unknowns.deviation) * coordinates
        weighted = objective.weighted_loss(point, solver=self.solver)
        penalized = with_priors(objective, point, weighted)
        (gradient,) = torch.autograd.grad(penalized, coordinates)
        self.trace.add(point.detach().numpy(), weighted.item(), penalized.item(), float(gradient.norm()))
        count = objective.measured.numel()
        return count / 2 * penalized.item() ** 2, (count * penalized.item() * gradient).numpy()


@dataclass(frozen=True)
class DirectAdam:
    """Adam on the coordinates themselves: what `IPINN` is without its network.

    Minimized is the penalized loss, whose minimum is that of `GaussNewton` and `LBFGS`: the root mean square of
    (simulated - measured) / sigma over all lines, the priors being counted as `with_priors` says. Coordinates are
    scaled by their priors' deviations; after each step they are put back within their bounds.
    """

    starts: int = 1
    """First the nominal values, then others drawn evenly over the logarithms within the bounds; all are moved at once,
    each on its own."""
    learning_rate: float = 0.05
    """Step size of Adam, in prior deviations."""
    decay: Decay = "cosine"
    """How it goes."""
    epochs: int = 500
    """Steps of Adam, one simulation each for each start."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    is_resumable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.starts < 1 or self.epochs < 1:
            raise InputError(f"starts ({self.starts}) and epochs ({self.epochs}) must be at least 1.")
        if not 0 < self.learning_rate < 1:
            raise InputError(f"learning_rate ({self.learning_rate:g}) must lie within 0...1, such as 0.05.")

    def search(
        self,
        objective: Objective,
        *,
        seed: int,
        progress: Progress | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Search:
        """Values of the best step of the best start; see `Calibrator` and, for `checkpoint`, `ResumableCalibrator`."""
        unknowns, generator = objective.unknowns, stream(seed, "direct_adam", "starts")
        center, scale = torch.as_tensor(unknowns.center), torch.as_tensor(unknowns.deviation)
        lower = (torch.as_tensor(unknowns.lower) - center) / scale
        upper = (torch.as_tensor(unknowns.upper) - center) / scale
        first = torch.as_tensor(np.stack(list(starting_points(unknowns, self.starts, generator))))
        scaled = ((first - center) / scale).requires_grad_()
        optimizer = torch.optim.Adam([scaled], lr=self.learning_rate)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.epochs)
        traces = [Trace() for _ in range(self.starts)]
        if checkpoint is not None:
            traces = _continued(checkpoint, scaled, optimizer, schedule) or traces
        with one_thread():
            for epoch in range(len(traces[0]), self.epochs):
                point = center + scale * scaled
                weighted = objective.weighted_loss(point, solver=self.solver)
                penalized = with_priors(objective, point, weighted)
                optimizer.zero_grad()
                penalized.sum().backward()
                assert scaled.grad is not None
                rows = (point.detach().numpy(), weighted.tolist(), penalized.tolist(), scaled.grad.norm(dim=1).tolist())
                for trace, *row in zip(traces, *rows, strict=True):
                    trace.add(*row)
                optimizer.step()
                if self.decay == "cosine":
                    schedule.step()
                with torch.no_grad():
                    scaled.clamp_(lower, upper)
                if checkpoint is not None and checkpoint.is_due(epoch + 1):
                    checkpoint.save({"scaled": scaled}, optimizer, schedule, _records(traces))
                if progress is not None:
                    progress(epoch + 1, self.epochs, min(trace.last_loss for trace in traces))
        return best_of([trace.search() for trace in traces])


def _records(traces: Sequence[Trace]) -> dict[str, np.ndarray]:
    """Steps of all starts."""
    return {f"{number}.{name}": array for number, trace in enumerate(traces) for name, array in trace.arrays().items()}


def _continued(
    checkpoint: Checkpoint,
    scaled: torch.Tensor,
    optimizer: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
) -> list[Trace]:
    """Steps so far, after the coordinates were set to the checkpoint's; none where there is no file."""
    weights, records = checkpoint.load(optimizer, schedule)
    if not records:
        return []
    with torch.no_grad():
        scaled.copy_(weights["scaled"])
    return [Trace.of(records[f"{n}.points"], records[f"{n}.rows"]) for n in range(len(scaled))]
