"""Our march through slippers that lift off: another model, beside which the linear rows show what lines save."""

import numpy as np
import torch
from torch import Tensor

from peers.contender import Contender
from peers.problem import FACTORS, Problem, in_time, pump_twin
from swashtwin.contacts import Marching, SlipperContact, slipper_steady_state

LIFTING = SlipperContact(one_sided=True)


class OneSided(Contender):
    """Periodic motion of the same pump where a film can only push, with its discrete adjoint."""

    per_step = 1
    grows = False
    linear = False

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.twin = pump_twin()
        self.pressure = torch.as_tensor(self.twin.pressure)
        action, n_lines = self.twin.drive.action, len(self.pressure)
        self.strain = torch.zeros(2, n_lines, 13, dtype=torch.complex128)
        for row, lines in zip(self.strain, (action.rate, action.motion), strict=True):
            row[self.twin.orders] = lines.reshape(-1)[:, None] * action.bore.reshape(-1)
        with torch.no_grad():
            self.target = self._lines(torch.as_tensor(problem.nominal * FACTORS)).abs()

    def _lines(self, values: Tensor) -> Tensor:
        """Lines of acceleration (sensor, line), orders 1 and up."""
        twin = self.twin
        force = self.pressure + values[4] * self.strain[0] + values[5] * self.strain[1]
        settings = twin.topology, LIFTING, twin.condition, twin.fault
        marching = Marching(steps=self.problem.per_revolution)
        motion = slipper_steady_state(twin.pump, twin.structure, *settings, values, force, marching=marching)
        frequency = twin.condition.speed * torch.arange(1, len(motion))
        return -(frequency**2) * (twin.structure.sensor_rows.to(motion.dtype) @ motion[1:].T)

    def _loss(self, values: Tensor) -> Tensor:
        difference = self._lines(values).abs() - self.target
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
            lines = self._lines(torch.as_tensor(values)).numpy().T
        orders = np.arange(1, len(lines) + 1)
        rate = 1j * self.twin.condition.speed * orders[:, None]
        return in_time(lines / rate, 1, self.problem.n_steps, self.problem.per_revolution, orders)
