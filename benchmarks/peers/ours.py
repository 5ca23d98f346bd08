"""Our own engines."""

import numpy as np
import torch
from torch import Tensor

from peers.contender import Contender, TorchTrajectory
from peers.problem import FACTORS, Problem, equations, in_time, pump_twin
from swashtwin.integrators import RK4, SteadySolver, first_order_hold_trajectory, rk4_trajectory


class Steady(Contender):
    """The loss of the settled pump: what a trajectory comes near to after several revolutions."""

    grows = False

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.twin = pump_twin()
        with torch.no_grad():
            self.target = self.twin.acceleration(torch.as_tensor(problem.nominal * FACTORS)).abs()

    def solver(self) -> SteadySolver | None:
        """None takes the twin's default, harmonic balance."""
        return None

    def _loss(self, values: Tensor) -> Tensor:
        difference = self.twin.acceleration(values, solver=self.solver()).abs() - self.target
        return (difference.square().mean() / self.target.square().mean()).sqrt()

    def value(self, values: np.ndarray) -> float:
        """Loss at the six values."""
        with torch.no_grad():
            return self._loss(torch.as_tensor(values)).item()

    def gradient(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and its slopes."""
        at = torch.tensor(values, requires_grad=True)
        loss = self._loss(at)
        return loss.item(), torch.autograd.grad(loss, at)[0].numpy()

    def velocities(self, values: np.ndarray) -> np.ndarray:
        """Velocities of the sensors after each step [m/s]."""
        with torch.no_grad():
            lines = self.twin.acceleration(torch.as_tensor(values), solver=self.solver()).numpy().T
        rate = 1j * self.twin.condition.speed * self.twin.orders[:, None]
        return in_time(lines / rate, 1, self.problem.n_steps, self.problem.per_revolution)


class SteadyRungeKutta(Steady):
    """The periodic steady state of the Runge-Kutta recursion itself."""

    def solver(self) -> SteadySolver:
        """At the problem's step."""
        return RK4(step=self.problem.step)


class Trajectory(TorchTrajectory):
    """Runge-Kutta as its exact map, the start included."""

    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        """States, the start first."""
        structure, mass = pump_twin().structure, torch.as_tensor(equations().mass)
        damping, stiffness = structure.damping(values), structure.stiffness(values)
        force = push[:, 13:] * mass
        return rk4_trajectory(structure.mass, damping, stiffness, force, self.problem.step, self.start)


class FirstOrderHold(TorchTrajectory):
    """The exact step under forces that run linearly; longer steps will do."""

    per_step = 1

    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        """States, the start first."""
        structure, mass = pump_twin().structure, torch.as_tensor(equations().mass)
        damping, stiffness = structure.damping(values), structure.stiffness(values)
        force = push[:, 13:] * mass
        return first_order_hold_trajectory(structure.mass, damping, stiffness, force, self.problem.step, self.start)
