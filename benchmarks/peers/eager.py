"""PyTorch stepping the equations in a loop that autograd records: what the paper's text
describes.
"""

import torch
from torch import Tensor

from peers.contender import TorchTrajectory


class Eager(TorchTrajectory):
    """The classical Runge-Kutta method, without avoidable waste: `addmv`, `unbind`, no tensor
    indexed in the loop.
    """

    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        h, rows = self.problem.step, push.unbind(0)
        x = self.start
        states = [x]
        for i in range(0, len(rows) - 1, 2):
            k1 = torch.addmv(rows[i], state, x)
            k2 = torch.addmv(rows[i + 1], state, torch.add(x, k1, alpha=h / 2))
            k3 = torch.addmv(rows[i + 1], state, torch.add(x, k2, alpha=h / 2))
            k4 = torch.addmv(rows[i + 2], state, torch.add(x, k3, alpha=h))
            x = torch.add(x, torch.add(k1 + k4, k2 + k3, alpha=2), alpha=h / 6)
            states.append(x)
        return torch.stack(states)
