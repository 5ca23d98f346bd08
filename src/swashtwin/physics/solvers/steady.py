"""Steady state under force lines, line by line: of the equations themselves, and of the paper's recursion."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.physics.solvers.receptances import receptance
from swashtwin.physics.solvers.runge_kutta import require_stable, rk4_limits, rk4_poles, state_matrix


@runtime_checkable
class SteadySolver(Protocol):
    """What turns force lines into motion lines."""

    def steady_state(
        self,
        mass: Float[Tensor, "13 13"],
        damping: Float[Tensor, "*#batch 13 13"],
        stiffness: Float[Tensor, "*#batch 13 13"],
        frequency: Float[Tensor, "*#batch line"],
        force: Complex[Tensor, "*#batch line 13"],
    ) -> Complex[Tensor, "*#batch line 13"]:
        """Displacement lines [m, rad] under `force` lines [N, N m] at angular frequencies `frequency` [rad/s]."""
        ...


@dataclass(frozen=True)
class HarmonicBalance:
    """Exact steady state: X_k = (K + i w_k C - w_k^2 M)^-1 Q_k."""

    def steady_state(
        self,
        mass: Float[Tensor, "13 13"],
        damping: Float[Tensor, "*#batch 13 13"],
        stiffness: Float[Tensor, "*#batch 13 13"],
        frequency: Float[Tensor, "*#batch line"],
        force: Complex[Tensor, "*#batch line 13"],
    ) -> Complex[Tensor, "*#batch line 13"]:
        """Displacement lines; see `SteadySolver`."""
        return receptance(mass, damping, stiffness, 1j * frequency, force)


@dataclass(frozen=True)
class RK4:
    """Steady state of the classical fourth-order Runge-Kutta recursion, the paper's solver.

    Exact for the recursion: its answer to a line is that of four receptances (`runge_kutta.rk4_poles`). Differentiable
    with respect to matrices and forces; step and frequencies are taken as given.
    """

    step: float | None = None
    """Time step [s]; None takes, for each of a batch, 0.8 of its stability limit at the values given."""

    def steady_state(
        self,
        mass: Float[Tensor, "13 13"],
        damping: Float[Tensor, "*#batch 13 13"],
        stiffness: Float[Tensor, "*#batch 13 13"],
        frequency: Float[Tensor, "*#batch line"],
        force: Complex[Tensor, "*#batch line 13"],
    ) -> Complex[Tensor, "*#batch line 13"]:
        """Displacement lines; see `SteadySolver`. Raises `StabilityError` above the stability limit."""
        state = state_matrix(mass.detach(), damping.detach(), stiffness.detach())
        if self.step is None:
            step = 0.8 * rk4_limits(state)[..., None]
        else:
            require_stable(state, self.step)
            step = torch.tensor(self.step, dtype=torch.float64)
        poles, weights = rk4_poles((frequency.detach().cpu().double() * step).numpy())
        s = torch.as_tensor(poles).to(force) / step[..., None].to(force.device)
        share = torch.as_tensor(weights).to(force)[..., None] * force[..., None, :]
        motion = receptance(mass, damping, stiffness, s.to(force).flatten(-2), share.flatten(-3, -2))
        return motion.unflatten(-2, (-1, 4)).sum(dim=-2)
