"""Our own engines."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from peers.contender import Contender, TorchTrajectory
from peers.problem import FACTORS, Problem, equations, in_time, pump_twin
from swashtwin.physics import RK4, SlipperContact, SteadySolver, Twin
from swashtwin.physics.contacts.steady import Marching as March
from swashtwin.physics.solvers.trajectories import first_order_hold_trajectory, rk4_trajectory, rk4_trajectory_of_lines


class Steady(Contender):
    """The loss of the settled pump: what a trajectory comes near to after several revolutions."""

    grows = False

    def __init__(self, problem: Problem, bandwidth: float | None = None) -> None:
        super().__init__(problem)
        self.twin = self.made_twin()
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

    def made_twin(self) -> Twin:
        """The twin whose acceleration is taken."""
        return pump_twin()

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


class LiftingOff(Steady):
    """The settled motion where a slipper's film can only push: no linear system, but one that is marched."""

    linear = False

    @property
    def steps(self) -> int:
        """Those of a revolution, the twin's own."""
        return March().steps

    def made_twin(self) -> Twin:
        """The same twin with such slippers."""
        return replace(pump_twin(), contact=SlipperContact(one_sided=True))


class Marching(TorchTrajectory):
    """A march through time under forces of 13 columns; a subclass says which."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.mass = torch.as_tensor(equations().mass)
        self.load, self.weight = self.load[:, 13:] * self.mass, self.weight[:, 13:] * self.mass[:, None]

    def _velocities(self, values: Tensor) -> Tensor:
        structure = pump_twin().structure
        matrices = structure.mass, structure.damping(values), structure.stiffness(values)
        return self.march(matrices, values) @ self.rows.T

    def force(self, values: Tensor) -> Tensor:
        """Forces (point, 13) at the values [N, N m]."""
        return torch.addmm(self.load, self.motion, self.weight @ values)

    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        """Not asked for."""
        raise NotImplementedError

    def march(self, matrices: tuple[Tensor, Tensor, Tensor], values: Tensor) -> Tensor:
        """States (step, 26), the start first."""
        raise NotImplementedError


class Trajectory(Marching):
    """Runge-Kutta as its exact map, the start included."""

    def march(self, matrices: tuple[Tensor, Tensor, Tensor], values: Tensor) -> Tensor:
        """States (step, 26), the start first."""
        return rk4_trajectory(*matrices, self.force(values), self.problem.step, self.start)


class TrajectoryOfLines(Marching):
    """The same from the lines of the forces, which are never written out over time."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        twin, given = pump_twin(), equations()
        self.frequency = torch.as_tensor(twin.orders * twin.condition.speed)
        self.load, self.motion = torch.as_tensor(given.load), torch.as_tensor(given.motion)

    def force(self, values: Tensor) -> Tensor:
        """Lines of the forces (line, 13) [N, N m]."""
        return torch.addmm(self.load, self.motion, (self.weight @ values).to(self.motion.dtype))

    def march(self, matrices: tuple[Tensor, Tensor, Tensor], values: Tensor) -> Tensor:
        """States (step, 26), the start first."""
        length = self.problem.step, self.problem.n_steps
        return rk4_trajectory_of_lines(*matrices, self.frequency, self.force(values), *length, self.start)


class FirstOrderHold(Marching):
    """The exact step under forces that run linearly; longer steps will do."""

    per_step = 1

    def march(self, matrices: tuple[Tensor, Tensor, Tensor], values: Tensor) -> Tensor:
        """States (step, 26), the start first."""
        return first_order_hold_trajectory(*matrices, self.force(values), self.problem.step, self.start)
