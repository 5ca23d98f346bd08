"""numba stepping forward, and backward through the same steps (discrete adjoint), as one layer of
PyTorch.
"""

from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor

from peers.contender import TorchTrajectory


@numba.njit(cache=True, error_model="numpy")
def _stages(state, push, x, i, h):
    k1 = state @ x + push[2 * i]
    x2 = x + h / 2 * k1
    k2 = state @ x2 + push[2 * i + 1]
    x3 = x + h / 2 * k2
    k3 = state @ x3 + push[2 * i + 1]
    x4 = x + h * k3
    k4 = state @ x4 + push[2 * i + 2]
    return x2, x3, x4, x + h / 6 * (k1 + 2 * (k2 + k3) + k4)


@numba.njit(cache=True, error_model="numpy")
def _forward(state, push, start, h):
    states = np.zeros((len(push) // 2 + 1, len(state)))
    states[0] = start
    for i in range(len(states) - 1):
        states[i + 1] = _stages(state, push, states[i], i, h)[3]
    return states


@numba.njit(cache=True, error_model="numpy")
def _backward(state, push, h, states, slope):
    transposed = np.ascontiguousarray(state.T)
    of_state, of_push = np.zeros_like(state), np.zeros_like(push)
    adjoint = np.zeros(len(state))
    for i in range(len(states) - 2, -1, -1):
        x = states[i]
        x2, x3, x4, _ = _stages(state, push, x, i, h)
        adjoint = adjoint + slope[i + 1]
        b4 = h / 6 * adjoint
        a4 = transposed @ b4
        b3 = h / 3 * adjoint + h * a4
        a3 = transposed @ b3
        b2 = h / 3 * adjoint + h / 2 * a3
        a2 = transposed @ b2
        b1 = h / 6 * adjoint + h / 2 * a2
        for row in range(len(state)):
            for column in range(len(state)):
                of_state[row, column] += (
                    b1[row] * x[column]
                    + b2[row] * x2[column]
                    + b3[row] * x3[column]
                    + b4[row] * x4[column]
                )
        of_push[2 * i] += b1
        of_push[2 * i + 1] += b2 + b3
        of_push[2 * i + 2] += b4
        adjoint = adjoint + a4 + a3 + a2 + transposed @ b1
    return of_state, of_push


class _Steps(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, state: Tensor, push: Tensor, start: Tensor, step: float) -> Tensor:
        states = _forward(state.detach().numpy(), push.detach().numpy(), start.numpy(), step)
        ctx.kept = state.detach().numpy(), push.detach().numpy(), step, states
        return torch.as_tensor(states)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, Tensor, None, None]:
        state, push, step, states = ctx.kept
        of_state, of_push = _backward(state, push, step, states, slope.contiguous().numpy())
        return torch.as_tensor(of_state), torch.as_tensor(of_push), None, None


class Numba(TorchTrajectory):
    """The classical Runge-Kutta method, stages recomputed on the way back."""

    def states(self, values: Tensor, state: Tensor, push: Tensor) -> Tensor:
        return _Steps.apply(state.contiguous(), push, self.start, self.problem.step)
