"""Steady state of M x'' + C x' + K x = Q, line by line: exact, or as the paper's solver gives it.

Forces and motions are one-sided complex amplitudes of the shaft orders ``k = 0, 1, ...``, with
``x(t) = X_0 + Re sum_k X_k exp(i k omega t)``. `HarmonicBalance` is exact for the equations; `RK4`
is the periodic steady state that the fourth-order Runge-Kutta recursion reaches at its step
(docs/explanation/simulator.md). `periodic.periodic_steady_state` adds parts of K and C that turn
with the shaft to either.

All functions take leading batch axes, and compute on the device and in the precision of their
arguments. Their derivatives are exact, and store forces and motions, never a matrix for each line.
A member of a batch gets the result that it would get alone. Single precision is off by up to 1e-4
of the largest motion in a line (2e-6 in the median of lines): the damping of a film exceeds what
decides the motion by orders of magnitude.
"""

from dataclasses import dataclass
from typing import Protocol, TypeAlias, no_type_check, runtime_checkable

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import StabilityError, compiled
from swashtwin.physics.receptances import receptance

Mass: TypeAlias = Float[Tensor, "13 13"]
Matrices: TypeAlias = Float[Tensor, "*#batch 13 13"]
Frequencies: TypeAlias = Float[Tensor, "*#batch line"]
Lines: TypeAlias = Complex[Tensor, "*#batch line 13"]

STABILITY_RADIUS = 6.0
"""No point of RK4's stability region is farther from the origin."""

STEP_SHARE = 0.8
"""Default RK4 step over the largest stable one, near which the stiffest mode hardly decays."""


def state_matrix(
    mass: Mass, damping: Matrices, stiffness: Matrices
) -> Float[Tensor, "*#batch 26 26"]:
    """Return A of x' = A x + B u for the state (displacements, velocities)."""
    damping, stiffness = torch.broadcast_tensors(damping, stiffness)
    lower = -torch.linalg.solve(mass, torch.cat([stiffness, damping], dim=-1))
    upper = torch.eye(26, dtype=lower.dtype, device=lower.device)[13:].expand_as(lower)
    return torch.cat([upper, lower], dim=-2)


def rk4_limits(state: Float[Tensor, "*batch 26 26"]) -> Float[Tensor, "*batch"]:
    """Return the largest time step [s] at which RK4 stays bounded, for each of the batch, on a CPU.

    It is computed by bisection on the amplification factor |1 + z + z^2/2 + z^3/6 + z^4/24| of
    every eigenvalue.

    Raises
    ------
    StabilityError
        No step is stable, because the motion itself grows.
    """
    rates = torch.linalg.eigvals(state.detach().cpu().double())
    limits = torch.empty(rates.shape[:-1], dtype=torch.float64)
    _find_limits(rates.reshape(-1, rates.shape[-1]).numpy(), limits.reshape(-1).numpy())
    if not bool((limits > 0).all()):
        raise StabilityError(
            "No RK4 step is stable, because the pump's own motion grows: "
            "check for a negative stiffness or damping."
        )
    return limits


def rk4_poles(
    turn: Float[np.ndarray, "*batch"],
) -> tuple[Complex[np.ndarray, "*batch 4"], Complex[np.ndarray, "*batch 4"]]:
    """Return poles r and weights b of RK4's steady state.

    RK4's answer to F exp(i w t) at the step h is X = sum_i b_i (M s_i^2 + C s_i + K)^-1 F with
    s_i = r_i / h.

    A step multiplies the state by R(Z) = 1 + Z + Z^2/2 + Z^3/6 + Z^4/24, Z = h A, and adds h n(Z) u
    with n(Z) = [1 + 4 y + z + (1 + 2 y) Z + (1 + y) Z^2/2 + Z^3/4] / 6, z = exp(i w h), y = exp(i w
    h/2). In steady state (z - R(Z)) x = h n(Z) u. R has one degree more than n, so the partial
    fractions are first-order systems: r_i are the four roots of R(r) = z, and b_i = n(r_i) /
    R'(r_i). One root is near i w h, the others belong to RK4 alone. They are distinct for every w,
    because |R| is below 0.6 at the roots of R', while |z| is 1: nothing is ill-conditioned.

    Parameters
    ----------
    turn : w h [rad], the phase by which a line advances in a step.
    """
    # z - 1, without the digits that a difference of two numbers near 1 would lose.
    increment = -2 * np.sin(turn / 2) ** 2 + 1j * np.sin(turn)
    poles = np.empty((turn.size, 4), dtype=complex)
    _find_poles(increment.reshape(-1), poles)
    poles = poles.reshape(*turn.shape, 4)

    z = 1 + increment[..., None]
    y = np.exp(0.5j * turn)[..., None]
    inputs = 1 + 4 * y + z + poles * (1 + 2 * y + poles / 2 * (1 + y + poles / 2))
    return poles, inputs / 6 / (1 + poles * (1 + poles / 2 * (1 + poles / 3)))


@compiled
@no_type_check
def _find_poles(increments, poles):
    """Fill the four roots of r + r^2/2 + r^3/6 + r^4/24 = increment.

    By Aberth's simultaneous Newton iteration, whose correction term keeps two roots from meeting.
    """
    for line in range(increments.shape[0]):
        r = poles[line]
        # Near the roots of a line that does not turn, and off the axes of symmetry.
        r[0] = 0.3 + 0.2j
        r[1] = -2.785 + 0.1j
        r[2] = -0.6 + 2.9j
        r[3] = -0.7 - 2.8j
        for _ in range(60):
            largest_step = 0.0
            for i in range(4):
                value = r[i] * (1 + r[i] / 2 * (1 + r[i] / 3 * (1 + r[i] / 4))) - increments[line]
                slope = 1 + r[i] * (1 + r[i] / 2 * (1 + r[i] / 3))
                repulsion = 0j
                for j in range(4):
                    if j != i:
                        repulsion += 1 / (r[i] - r[j])
                step = value / (slope - value * repulsion)
                r[i] -= step
                largest_step = max(largest_step, abs(step))
            if largest_step < 1e-15:
                break


@compiled
@no_type_check
def _find_limits(rates, limits):
    """Fill the largest step at which no eigenvalue of a row grows; 0 if there is none."""
    for row in range(rates.shape[0]):
        largest = STABILITY_RADIUS / np.abs(rates[row]).max()
        low = 0.0
        high = largest
        for _ in range(80):
            middle = (low + high) / 2
            is_stable = True
            for rate in rates[row]:
                z = middle * rate
                is_stable &= abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) <= 1 + 1e-12
            if is_stable:
                low = middle
            else:
                high = middle

        # A bisection that runs to 0 has met no stable step.
        limits[row] = low if low > 1e-6 * largest else 0.0


@runtime_checkable
class SteadySolver(Protocol):
    """Solver of the steady state: force lines in, motion lines out."""

    def steady_state(
        self,
        mass: Mass,
        damping: Matrices,
        stiffness: Matrices,
        frequency: Frequencies,
        force: Lines,
    ) -> Lines:
        """Return the displacement lines [m, rad] under `force` lines [N, N m].

        Parameters
        ----------
        frequency : angular frequency of each line [rad/s].
        """
        ...


@dataclass(frozen=True)
class HarmonicBalance:
    """Exact steady state: X_k = (K + i w_k C - w_k^2 M)^-1 Q_k."""

    def steady_state(
        self,
        mass: Mass,
        damping: Matrices,
        stiffness: Matrices,
        frequency: Frequencies,
        force: Lines,
    ) -> Lines:
        """Return the displacement lines; see `SteadySolver`."""
        return receptance(mass, damping, stiffness, 1j * frequency, force)


@dataclass(frozen=True)
class RK4:
    """Steady state of the classical fourth-order Runge-Kutta recursion, the paper's solver.

    Exact for the recursion: its answer to a line is that of four receptances (`rk4_poles`).
    Differentiable with respect to matrices and forces; step and frequencies are constants.
    """

    step: float | None = None
    """Time step [s]; None is `STEP_SHARE` of the stability limit of each member of the batch."""

    def steady_state(
        self,
        mass: Mass,
        damping: Matrices,
        stiffness: Matrices,
        frequency: Frequencies,
        force: Lines,
    ) -> Lines:
        """Return the displacement lines; see `SteadySolver`.

        Raises
        ------
        StabilityError
            The step lies above the stability limit.
        """
        limits = rk4_limits(state_matrix(mass.detach(), damping.detach(), stiffness.detach()))
        if self.step is None:
            step = STEP_SHARE * limits[..., None]
        else:
            self._require_stable(float(limits.min()))
            step = torch.tensor(self.step, dtype=torch.float64)

        poles, weights = rk4_poles((frequency.detach().cpu().double() * step).numpy())
        s = torch.as_tensor(poles).to(force) / step[..., None].to(force.device)
        weighted_force = torch.as_tensor(weights).to(force)[..., None] * force[..., None, :]
        motion = receptance(
            mass, damping, stiffness, s.to(force).flatten(-2), weighted_force.flatten(-3, -2)
        )
        return motion.unflatten(-2, (-1, 4)).sum(dim=-2)

    def _require_stable(self, limit: float) -> None:
        """Raise an error unless the step lies between 0 and the stability `limit` [s]."""
        if self.step is None or 0 < self.step <= limit:
            return
        limit_us = 1e6 * limit
        raise StabilityError(
            f"RK4 step {self.step * 1e6:.4g} us must be positive and below the stability limit of "
            f"this pump, {limit_us:.4g} us: use at most {0.95 * limit_us:.3g} us, or harmonic "
            "balance, which has no limit."
        )
