"""torchdiffeq, fixed grid, differentiated through its own steps."""

import torch
from torch import Tensor
from torchdiffeq import odeint

from peers.contender import TorchTrajectory


class TorchDiffEq(TorchTrajectory):
    """Its ``rk4`` is the 3/8 rule, which asks for forces at thirds of a step."""

    per_step = 3

    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        """States, the start first; time counts steps, so that every force is found by its number."""
        scaled = self.problem.step * state
        scaled_rows = (self.problem.step * push).unbind(0)

        def rate(time: Tensor, x: Tensor) -> Tensor:
            return torch.addmv(scaled_rows[round(3 * time.item())], scaled, x)

        grid = torch.arange(self.problem.n_steps + 1, dtype=torch.float64)
        return odeint(rate, self.start, grid, method="rk4")
