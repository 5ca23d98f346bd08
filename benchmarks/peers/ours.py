"""Our own engines."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from peers.contender import TorchLoss
from peers.problem import FACTORS, Problem, in_time, pump_twin
from swashtwin.physics import RK4, SteadySolver


class Steady(TorchLoss):
    """The loss of the settled pump: what a trajectory comes near to after several revolutions."""

    def __init__(self, problem: Problem, bandwidth: float | None = None) -> None:
        super().__init__(problem)
        self.twin = pump_twin()
        if bandwidth is not None:
            self.twin = replace(self.twin, bandwidth=bandwidth)
        with torch.no_grad():
            self.target = self.twin.acceleration(torch.as_tensor(problem.nominal * FACTORS)).abs()

    @classmethod
    def rehearsal(cls, problem: Problem) -> "Steady":
        """The same with two lines, for its cost does not depend on the steps."""
        return cls(problem, bandwidth=110.0)

    @property
    def steps(self) -> int:
        """None; a line has no step."""
        return 0

    def solver(self) -> SteadySolver | None:
        """None takes the twin's default, harmonic balance."""
        return None

    def _loss(self, values: Tensor) -> Tensor:
        difference = self.twin.acceleration(values, solver=self.solver()).abs() - self.target
        return (difference.square().mean() / self.target.square().mean()).sqrt()

    def velocities(self, values: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            lines = self.twin.acceleration(torch.as_tensor(values), solver=self.solver()).numpy().T
        rate = 1j * self.twin.condition.speed * self.twin.orders[:, None]
        length = self.problem.n_steps, self.problem.per_revolution
        return in_time(lines / rate, 1, *length, self.twin.orders)


class SteadyRungeKutta(Steady):
    """The periodic steady state of the Runge-Kutta recursion itself."""

    @property
    def steps(self) -> int:
        """Those of a revolution, though none is taken."""
        return self.problem.per_revolution

    def solver(self) -> SteadySolver:
        """At the problem's step."""
        return RK4(step=self.problem.step)
