"""Solvers of M x'' + C x' + K x = Q, differentiable and batched.

In steady state every solver works line by line: forces and motions are one-sided complex amplitudes of the shaft orders
``k = 0, 1, ...``, with ``x(t) = X_0 + Re sum_k X_k exp(i k omega t)``.

- `HarmonicBalance` is exact for the equations.
- `RK4` is the periodic steady state that the fourth-order Runge-Kutta recursion itself reaches at its step: on a linear
  system the recursion is a fixed map, whose response to each line is known in closed form (docs/simulator.md).

For motions that are not periodic, `rk4_trajectory` and `first_order_hold_trajectory` march through time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.errors import InputError, StabilityError

RK4_REACH = 6.0
"""No point of RK4's stability region is farther from the origin than this."""


@dataclass(frozen=True, eq=False)
class PeriodicTerm:
    """Part of K and C that turns with the shaft: K(t) += Re(stiffness exp(i order omega t)), C likewise."""

    order: int
    """Shaft order, at least 1."""
    stiffness: Complex[Tensor, "*batch 13 13"]
    """Complex amplitude [N/m]."""
    damping: Complex[Tensor, "*batch 13 13"] | None = None
    """Complex amplitude [N s/m], or None for no damping term."""


@runtime_checkable
class SteadySolver(Protocol):
    """What turns force lines into motion lines."""

    def steady_state(
        self,
        mass: Float[Tensor, "13 13"],
        damping: Float[Tensor, "*batch 13 13"],
        stiffness: Float[Tensor, "*batch 13 13"],
        frequency: Float[Tensor, " line"],
        force: Complex[Tensor, "*batch line 13"],
    ) -> Complex[Tensor, "*batch line 13"]:
        """Displacement lines [m, rad] under `force` lines [N, N m] at angular frequencies `frequency` [rad/s]."""
        ...


@dataclass(frozen=True)
class HarmonicBalance:
    """Exact steady state: X_k = (K + i w_k C - w_k^2 M)^-1 Q_k."""

    def steady_state(
        self,
        mass: Float[Tensor, "13 13"],
        damping: Float[Tensor, "*batch 13 13"],
        stiffness: Float[Tensor, "*batch 13 13"],
        frequency: Float[Tensor, " line"],
        force: Complex[Tensor, "*batch line 13"],
    ) -> Complex[Tensor, "*batch line 13"]:
        """Displacement lines; see `SteadySolver`."""
        w = frequency[:, None, None]
        dynamic = stiffness[..., None, :, :] - w**2 * mass + 1j * w * damping[..., None, :, :]
        return torch.linalg.solve(dynamic, force[..., None]).squeeze(-1)


@dataclass(frozen=True)
class RK4:
    """Steady state of the classical fourth-order Runge-Kutta recursion, the paper's solver."""

    step: float | None = None
    """Time step [s]; None takes 0.8 of the stability limit at the values given."""

    def steady_state(
        self,
        mass: Float[Tensor, "13 13"],
        damping: Float[Tensor, "*batch 13 13"],
        stiffness: Float[Tensor, "*batch 13 13"],
        frequency: Float[Tensor, " line"],
        force: Complex[Tensor, "*batch line 13"],
    ) -> Complex[Tensor, "*batch line 13"]:
        """Displacement lines; see `SteadySolver`. Raises `StabilityError` above the stability limit."""
        state = state_matrix(mass, damping, stiffness)
        step = stable_step(state, self.step)
        phi, g0, g1, g2 = rk4_map(state, step)
        z = torch.exp(1j * frequency * step)[:, None, None]
        middle = torch.exp(0.5j * frequency * step)[:, None, None]
        inputs = g0[..., None, :, :] + middle * g1[..., None, :, :] + z * g2
        acceleration = force[..., None] / mass.diagonal()[:, None]
        driven = (inputs[..., 13:] @ acceleration).squeeze(-1)
        eye = torch.eye(26, dtype=state.dtype)
        motion = torch.linalg.solve(z * eye - phi[..., None, :, :], driven[..., None]).squeeze(-1)
        return motion[..., :13]


def state_matrix(
    mass: Float[Tensor, "13 13"], damping: Float[Tensor, "*batch 13 13"], stiffness: Float[Tensor, "*batch 13 13"]
) -> Float[Tensor, "*batch 26 26"]:
    """A of x' = A x + B u for the state (displacements, velocities)."""
    lower = -torch.linalg.solve(mass, torch.cat([stiffness, damping], dim=-1))
    upper = torch.zeros_like(lower)
    upper[..., 13:] = torch.eye(13, dtype=lower.dtype)
    return torch.cat([upper, lower], dim=-2)


def rk4_limit(state: Float[Tensor, "*batch 26 26"]) -> float:
    """Largest time step [s] at which RK4 stays bounded, over the whole batch.

    Found by bisection on the amplification factor |1 + z + z^2/2 + z^3/6 + z^4/24| of every eigenvalue.
    """
    rates = torch.linalg.eigvals(state.detach()).reshape(-1)
    low, high = 0.0, RK4_REACH / float(rates.abs().max())
    for _ in range(80):
        middle = (low + high) / 2
        z = middle * rates
        growth = (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24).abs().max()
        low, high = (middle, high) if float(growth) <= 1 + 1e-12 else (low, middle)
    return low


def stable_step(state: Float[Tensor, "*batch 26 26"], step: float | None) -> float:
    """`step` [s] if it is stable, or 0.8 of the limit where `step` is None.

    Raises
    ------
    StabilityError
        The step lies above the limit, which is named.
    """
    limit = rk4_limit(state)
    if step is None:
        return 0.8 * limit
    if not 0 < step <= limit:
        raise StabilityError(
            f"RK4 step {step * 1e6:.4g} us lies above the stability limit {limit * 1e6:.4g} us of this pump; "
            f"use at most {0.95 * limit * 1e6:.3g} us, or HarmonicBalance(), which has no step."
        )
    return step


def rk4_map(state: Float[Tensor, "*batch 26 26"], step: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Phi, G0, G1, G2 of one RK4 step of x' = A x + u: x+ = Phi x + G0 u(t) + G1 u(t + h/2) + G2 u(t + h).

    Phi = I + Z + Z^2/2 + Z^3/6 + Z^4/24 with Z = h A. All are (*batch, 26, 26).
    """
    eye = torch.eye(state.shape[-1], dtype=state.dtype)
    z = step * state
    z2 = z @ z
    z3 = z2 @ z
    phi = eye + z + z2 / 2 + z3 / 6 + z3 @ z / 24
    g0 = step / 6 * (eye + z + z2 / 2 + z3 / 4)
    g1 = step / 6 * (4 * eye + 2 * z + z2 / 2)
    g2 = step / 6 * eye
    return phi, g0, g1, g2


def rk4_trajectory(
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "13 13"],
    stiffness: Float[Tensor, "13 13"],
    force: Float[Tensor, "half_step 13"],
    step: float,
    start: Float[Tensor, " 26"] | None = None,
) -> Float[Tensor, "step 26"]:
    """States of RK4 from `start` (rest by default), one row a step, the first row being `start`.

    Parameters
    ----------
    force : forces [N, N m] at 0, h/2, h, 3h/2, ...; an odd number of rows.
    step : time step h [s].

    Raises
    ------
    StabilityError
        The step lies above the stability limit, which is named.
    """
    if force.shape[0] % 2 == 0 or force.shape[0] < 3:
        raise InputError(f"force has {force.shape[0]} rows; RK4 needs an odd number, at least 3: one every half step.")
    state = state_matrix(mass, damping, stiffness)
    stable_step(state, step)
    phi, g0, g1, g2 = (part for part in rk4_map(state, step))
    acceleration = torch.linalg.solve(mass, force.T).T
    driven = acceleration[:-2:2] @ g0[:, 13:].T + acceleration[1::2] @ g1[:, 13:].T + acceleration[2::2] @ g2[:, 13:].T
    return _march(phi, driven, start)


def first_order_hold_trajectory(
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "13 13"],
    stiffness: Float[Tensor, "13 13"],
    force: Float[Tensor, "time 13"],
    step: float,
    start: Float[Tensor, " 26"] | None = None,
) -> Float[Tensor, "time 26"]:
    """States under forces [N, N m] that run linearly from row to row; exact for such forces, stable at any step [s]."""
    state = state_matrix(mass, damping, stiffness)
    augmented = torch.zeros(52, 52, dtype=state.dtype)
    augmented[:26, :26] = state * step
    augmented[13:26, 26:39] = torch.linalg.inv(mass) * step
    augmented[26:39, 39:] = torch.eye(13, dtype=state.dtype)
    exponential = torch.linalg.matrix_exp(augmented)
    phi, hold, ramp = exponential[:26, :26], exponential[:26, 26:39], exponential[:26, 39:]
    driven = force[:-1] @ hold.T + (force[1:] - force[:-1]) @ ramp.T
    return _march(phi, driven, start)


def _march(phi: Tensor, driven: Tensor, start: Tensor | None) -> Tensor:
    x = torch.zeros(26, dtype=phi.dtype) if start is None else start
    states = [x]
    for row in driven.unbind(0):
        x = torch.mv(phi, x) + row
        states.append(x)
    return torch.stack(states)


def periodic_steady_state(
    solver: SteadySolver,
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "*batch 13 13"],
    stiffness: Float[Tensor, "*batch 13 13"],
    speed: Float[Tensor, ""] | float,
    force: Complex[Tensor, "*batch line 13"],
    terms: Sequence[PeriodicTerm],
    *,
    tolerance: float = 1e-10,
    most: int = 200,
) -> Complex[Tensor, "*batch line 13"]:
    """Displacement lines ``k = 0, 1, ...`` of a system whose K and C turn with the shaft.

    Fixed-point iteration: the periodic part acts as a force that is updated until it no longer changes. It converges
    where that part is a minor share of the constant one, and says so where it does not.

    Parameters
    ----------
    speed : shaft speed [rad/s].
    force : one-sided lines from order 0 (the mean), all orders without gaps.
    terms : what turns.
    """
    n_lines = force.shape[-2]
    frequency = torch.arange(n_lines, dtype=torch.float64) * speed
    lines = solver.steady_state(mass, damping, stiffness, frequency, force)
    for _ in range(most):
        reaction = sum(_reaction(term, lines, frequency) for term in terms)
        updated = solver.steady_state(mass, damping, stiffness, frequency, force - reaction)
        change = float((updated - lines).detach().abs().max() / updated.detach().abs().max())
        lines = updated
        if change < tolerance:
            return lines
    raise InputError(
        f"the periodic part of the stiffness is too large for the iteration (still changing by {change:.1e}); "
        "reduce the severity of the periodic fault."
    )


def _reaction(term: PeriodicTerm, lines: Tensor, frequency: Tensor) -> Tensor:
    """One-sided lines of the force with which a periodic term answers the motion `lines`."""
    n = lines.shape[-2]
    positive = torch.cat([lines[..., :1, :].real.to(lines.dtype), lines[..., 1:, :] / 2], dim=-2)
    two_sided = torch.cat([positive[..., 1:, :].flip(-2).conj(), positive], dim=-2)
    out = _modulated(term.stiffness, term.order, two_sided, n)
    if term.damping is not None:
        rate = 1j * torch.cat([-frequency[1:].flip(0), frequency])[:, None]
        out = out + _modulated(term.damping, term.order, rate * two_sided, n)
    return torch.cat([out[..., :1, :], 2 * out[..., 1:, :]], dim=-2)


def _modulated(amplitude: Tensor, order: int, two_sided: Tensor, n: int) -> Tensor:
    """Orders 0...n-1 of Re(amplitude exp(i order theta)) times a two-sided series of orders -(n-1)...n-1."""
    below = torch.zeros_like(two_sided)
    above = torch.zeros_like(two_sided)
    below[..., order:, :] = two_sided[..., :-order, :]
    above[..., :-order, :] = two_sided[..., order:, :]
    half = amplitude[..., None, :, :] / 2
    mixed = (half @ below[..., None]).squeeze(-1) + (half.conj() @ above[..., None]).squeeze(-1)
    return mixed[..., n - 1 :, :]
