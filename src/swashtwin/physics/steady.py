"""Steady state of M x'' + C x' + K x = Q, line by line: of the equations themselves, and of the
paper's recursion.

Forces and motions are one-sided complex amplitudes of the shaft orders ``k = 0, 1, ...``, with
``x(t) = X_0 + Re sum_k X_k exp(i k omega t)``. `HarmonicBalance` is exact for the equations; `RK4`
is the periodic steady state that the fourth-order Runge-Kutta recursion reaches at its step
(docs/explanation/simulator.md); `periodic.periodic_steady_state` adds parts of K and C that turn
with the shaft to either.

Everything takes leading batch axes, follows the device and the precision of what it is given, and
has exact derivatives that keep forces and motions, never a matrix a line. A batch gives each of its
members what it would get alone. Single precision is off by up to 1e-4 of the largest motion in a
line (2e-6 in the median of lines): the damping of a film exceeds what decides the motion by orders
of magnitude.
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

REACH = 6.0
"""No point of RK4's stability region is farther from the origin than this."""


def state_matrix(
    mass: Mass, damping: Matrices, stiffness: Matrices
) -> Float[Tensor, "*#batch 26 26"]:
    """A of x' = A x + B u for the state (displacements, velocities)."""
    damping, stiffness = torch.broadcast_tensors(damping, stiffness)
    lower = -torch.linalg.solve(mass, torch.cat([stiffness, damping], dim=-1))
    upper = torch.eye(26, dtype=lower.dtype, device=lower.device)[13:].expand_as(lower)
    return torch.cat([upper, lower], dim=-2)


def rk4_limits(state: Float[Tensor, "*batch 26 26"]) -> Float[Tensor, "*batch"]:
    """Largest time step [s] at which RK4 stays bounded, for each of the batch; on the CPU.

    Found by bisection on the amplification factor |1 + z + z^2/2 + z^3/6 + z^4/24| of every
    eigenvalue.

    Raises
    ------
    StabilityError
        No step is stable, for the motion itself grows.
    """
    rates = torch.linalg.eigvals(state.detach().cpu().double())
    limits = torch.empty(rates.shape[:-1], dtype=torch.float64)
    _find_limits(rates.reshape(-1, rates.shape[-1]).numpy(), limits.reshape(-1).numpy())
    if not bool((limits > 0).all()):
        raise StabilityError(
            "no RK4 step is stable, because the pump's own motion grows: is a stiffness or a damping negative?"
        )
    return limits


def rk4_poles(
    turn: Float[np.ndarray, "*batch"],
) -> tuple[Complex[np.ndarray, "*batch 4"], Complex[np.ndarray, "*batch 4"]]:
    """Poles r and weights b with which RK4's answer to F exp(i w t) is X = sum_i b_i (M s^2 + C s +
    K)^-1 F, s = r_i/h.

    A step multiplies the state by R(Z) = 1 + Z + Z^2/2 + Z^3/6 + Z^4/24, Z = h A, and adds h n(Z) u
    with n(Z) = [1 + 4 y + z + (1 + 2 y) Z + (1 + y) Z^2/2 + Z^3/4] / 6, z = exp(i w h), y = exp(i w
    h/2). In steady state (z - R(Z)) x = h n(Z) u. R has one degree more than n, so that the partial
    fractions are first-order systems: r_i are the four roots of R(r) = z, and b_i = n(r_i) /
    R'(r_i). One root is near i w h, the others are RK4's own. They keep apart for every w, for
    where R' vanishes R is below 0.6, and |z| is 1: nothing is ill-conditioned.

    Parameters
    ----------
    turn : w h [rad], by which a line turns in a step.
    """
    beyond = -2 * np.sin(turn / 2) ** 2 + 1j * np.sin(turn)  # z - 1 without loss of digits
    poles = np.empty((turn.size, 4), dtype=complex)
    _find_poles(beyond.reshape(-1), poles)
    poles = poles.reshape(*turn.shape, 4)
    z, y = 1 + beyond[..., None], np.exp(0.5j * turn)[..., None]
    inputs = 1 + 4 * y + z + poles * (1 + 2 * y + poles / 2 * (1 + y + poles / 2))
    return poles, inputs / 6 / (1 + poles * (1 + poles / 2 * (1 + poles / 3)))


@compiled
@no_type_check
def _find_poles(beyond, poles):
    """Fill in the four roots of r + r^2/2 + r^3/6 + r^4/24 = `beyond`, by Aberth's simultaneous
    Newton iteration.
    """
    for line in range(beyond.shape[0]):
        r = poles[line]
        r[0], r[1], r[2], r[3] = 0.3 + 0.2j, -2.785 + 0.1j, -0.6 + 2.9j, -0.7 - 2.8j
        for _ in range(60):
            change = 0.0
            for i in range(4):
                value = r[i] * (1 + r[i] / 2 * (1 + r[i] / 3 * (1 + r[i] / 4))) - beyond[line]
                slope = 1 + r[i] * (1 + r[i] / 2 * (1 + r[i] / 3))
                others = 0j
                for j in range(4):
                    if j != i:
                        others += 1 / (r[i] - r[j])
                step = value / (slope - value * others)
                r[i] -= step
                change = max(change, abs(step))
            if change < 1e-15:
                break


@compiled
@no_type_check
def _find_limits(rates, limits):
    """Fill in the largest step at which no growth factor of a row of eigenvalues exceeds 1, or 0
    for none.
    """
    for row in range(rates.shape[0]):
        farthest = REACH / np.abs(rates[row]).max()
        low, high = 0.0, farthest
        for _ in range(80):
            middle = (low + high) / 2
            stable = True
            for rate in rates[row]:
                z = middle * rate
                stable &= abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) <= 1 + 1e-12
            low, high = (middle, high) if stable else (low, middle)
        limits[row] = low if low > 1e-6 * farthest else 0.0


@runtime_checkable
class SteadySolver(Protocol):
    """What turns force lines into motion lines."""

    def steady_state(
        self,
        mass: Mass,
        damping: Matrices,
        stiffness: Matrices,
        frequency: Frequencies,
        force: Lines,
    ) -> Lines:
        """Displacement lines [m, rad] under `force` lines [N, N m] at angular frequencies
        `frequency` [rad/s].
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
        """Displacement lines; see `SteadySolver`."""
        return receptance(mass, damping, stiffness, 1j * frequency, force)


@dataclass(frozen=True)
class RK4:
    """Steady state of the classical fourth-order Runge-Kutta recursion, the paper's solver.

    Exact for the recursion: its answer to a line is that of four receptances (`rk4_poles`).
    Differentiable with respect to matrices and forces; step and frequencies are taken as given.
    """

    step: float | None = None
    """Time step [s]; None takes, for each of a batch, 0.8 of its stability limit at the values
    given.
    """

    def steady_state(
        self,
        mass: Mass,
        damping: Matrices,
        stiffness: Matrices,
        frequency: Frequencies,
        force: Lines,
    ) -> Lines:
        """Displacement lines; see `SteadySolver`. Raises `StabilityError` above the stability
        limit.
        """
        state = state_matrix(mass.detach(), damping.detach(), stiffness.detach())
        if self.step is None:
            step = 0.8 * rk4_limits(state)[..., None]
        else:
            limit = 1e6 * float(rk4_limits(state).min())
            if not 0 < self.step <= limit / 1e6:
                raise StabilityError(
                    f"RK4 step {self.step * 1e6:.4g} us must be positive and below the stability limit of this pump, "
                    f"{limit:.4g} us: use at most {0.95 * limit:.3g} us, or harmonic balance: it has none."
                )
            step = torch.tensor(self.step, dtype=torch.float64)
        poles, weights = rk4_poles((frequency.detach().cpu().double() * step).numpy())
        s = torch.as_tensor(poles).to(force) / step[..., None].to(force.device)
        share = torch.as_tensor(weights).to(force)[..., None] * force[..., None, :]
        motion = receptance(
            mass, damping, stiffness, s.to(force).flatten(-2), share.flatten(-3, -2)
        )
        return motion.unflatten(-2, (-1, 4)).sum(dim=-2)
