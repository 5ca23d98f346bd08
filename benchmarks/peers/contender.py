"""What every contender offers, and the parts that all those share that run in PyTorch."""

from abc import ABC, abstractmethod

import numpy as np
import torch
from torch import Tensor

from peers.problem import Problem


class Contender(ABC):
    """One way of computing the loss of a problem; making it does what needs doing once."""

    per_step = 2
    """Forces it wants per step."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @classmethod
    def rehearsal(cls, problem: Problem) -> "Contender":
        """The same for a small problem, whose gradient is taken first, so that what libraries do
        once is not counted.

        Parameters
        ----------
        problem : one of few steps.
        """
        return cls(problem)

    @property
    def steps(self) -> int:
        """Steps that it takes."""
        return self.problem.n_steps

    def prepare(self, values: np.ndarray) -> float:
        """Compile what computes the gradient; returns how long it took [s]."""
        return 0.0

    @abstractmethod
    def value(self, values: np.ndarray) -> float:
        """Loss at the six values."""

    @abstractmethod
    def gradient(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and its slopes."""

    @abstractmethod
    def velocities(self, values: np.ndarray) -> np.ndarray:
        """Velocities (step, sensor) of the sensors [m/s], from the start on, without the mean."""


class TorchLoss(Contender):
    """A loss in PyTorch; a subclass says which."""

    @abstractmethod
    def _loss(self, values: Tensor) -> Tensor:
        """Loss at the six values."""

    def value(self, values: np.ndarray) -> float:
        with torch.no_grad():
            return self._loss(torch.as_tensor(values)).item()

    def gradient(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        at = torch.tensor(values, requires_grad=True)
        loss = self._loss(at)
        return loss.item(), torch.autograd.grad(loss, at)[0].numpy()


class TorchTrajectory(TorchLoss):
    """A loop over the states in PyTorch; a subclass says which."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.slopes = torch.as_tensor(problem.state_slopes)
        self.load = torch.as_tensor(problem.load)
        self.motion = torch.as_tensor(problem.motion)
        self.weight = torch.as_tensor(problem.push_weight)
        self.rows = torch.as_tensor(problem.sensor_rows)
        self.start = torch.as_tensor(problem.start)
        self.bin_scale = torch.as_tensor(problem.bin_scale)
        self.target = torch.as_tensor(problem.target)

    @abstractmethod
    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        """States (step, 26) of x' = `state` x + `push`, the start first."""

    def _velocities(self, values: Tensor) -> Tensor:
        state = self.slopes[0] + torch.tensordot(values, self.slopes[1:], 1)
        push = torch.addmm(self.load, self.motion, self.weight @ values)
        return self.states(values, state, push) @ self.rows.T

    def _loss(self, values: Tensor) -> Tensor:
        gains = torch.diff(self._velocities(values), dim=0)
        amplitude = torch.fft.rfft(gains, dim=0)[1 : len(self.target) + 1].abs() * self.bin_scale
        return ((amplitude - self.target).square().mean() / self.target.square().mean()).sqrt()

    def velocities(self, values: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return self._velocities(torch.as_tensor(values)).numpy()
