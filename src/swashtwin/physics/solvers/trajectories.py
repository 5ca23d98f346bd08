"""Motions that are not periodic: marching through time, differentiable and batched."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.solvers.recursion import linear_recursion
from swashtwin.physics.solvers.runge_kutta import require_decay, rk4_map, stable_step, state_matrix

INSIDE = 1e-6
"""Share of a step by which a force is asked for inside its segment instead of at the end, where it may jump."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States over time, at steps that need not be equal."""

    time: Float[Tensor, " row"]
    """[s], from 0."""
    states: Float[Tensor, "*batch row 26"]
    """Displacements [m, rad] and velocities [m/s, rad/s]."""


def rk4_trajectory(
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "*#batch 13 13"],
    stiffness: Float[Tensor, "*#batch 13 13"],
    force: Float[Tensor, "*#batch half_step 13"],
    step: float,
    start: Float[Tensor, "*#batch 26"] | None = None,
) -> Float[Tensor, "*#batch step 26"]:
    """States of RK4 from `start` (rest by default), one row a step, the first row being `start`.

    The numbers are those of the textbook recursion k1...k4, which on a linear system is a fixed map (`rk4_map`).

    Parameters
    ----------
    force : forces [N, N m] at 0, h/2, h, 3h/2, ...; an odd number of rows. They should not jump within a step, which
        would drop RK4 to first order (`rk4_trajectory_with_breaks`).
    step : time step h [s].

    Raises
    ------
    StabilityError
        The step lies above the stability limit, which is named.
    """
    if force.shape[-2] % 2 == 0 or force.shape[-2] < 3:
        raise InputError(f"force has {force.shape[-2]} rows; RK4 needs an odd number, at least 3: one every half step.")
    state = state_matrix(mass, damping, stiffness)
    stable_step(state, step)
    return _rk4_states(state, mass, force, step, start)


def rk4_trajectory_of_lines(
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "*#batch 13 13"],
    stiffness: Float[Tensor, "*#batch 13 13"],
    frequency: Float[Tensor, " line"],
    force: Complex[Tensor, "*#batch line 13"],
    step: float,
    n_steps: int,
    start: Float[Tensor, "*#batch 26"] | None = None,
) -> Float[Tensor, "*#batch row 26"]:
    """States of RK4 under periodic forces Re sum_k F_k exp(i w_k t), transient included; `n_steps` + 1 rows.

    As `rk4_trajectory` with those forces, but they are never written out over time: each line drives the recursion by
    a line, and what is kept for the gradient is states.

    Parameters
    ----------
    frequency : w_k [rad/s]; 0 for the mean.
    step : time step h [s].

    Raises
    ------
    StabilityError
        The step lies above the stability limit, which is named.
    """
    state = state_matrix(mass, damping, stiffness)
    stable_step(state, step)
    phi, *inputs = rk4_map(state, step)
    if n_steps < 1:
        raise InputError(f"n_steps ({n_steps}) must be at least 1.")
    driven = torch.zeros_like(force[..., :1])
    for part, delay in zip(inputs, (0.0, 0.5, 1.0), strict=True):
        turned = torch.exp(1j * delay * step * frequency)[:, None] * force
        driven = driven + turned @ _of_forces(part, mass).to(force.dtype)
    rows = _over_steps(driven, frequency * step, n_steps)
    return linear_recursion(phi, rows, _start(start, rows))


def rk4_trajectory_with_breaks(
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "*#batch 13 13"],
    stiffness: Float[Tensor, "*#batch 13 13"],
    force: Callable[[Tensor], Tensor],
    step: float,
    duration: float,
    breaks: Sequence[float],
    start: Float[Tensor, "*#batch 26"] | None = None,
) -> Trajectory:
    """States of RK4 under forces that jump or bend at known times, at its full fourth order.

    The time is cut at the `breaks`, and each piece gets equal steps of its own, the longest that fit and do not exceed
    `step`. A step across a jump, as the half-sine edges of a recess make them in the velocity, would leave an error of
    first order, however smooth the force is elsewhere.

    Parameters
    ----------
    force : forces [N, N m], (*batch, time, 13), at given times [s]. It is asked a millionth of a step inside the ends
        of each piece, and so need not know what holds at a break itself.
    step : longest time step [s].
    duration : end of the last piece [s].
    breaks : times [s] at which a force or one of its first three derivatives jumps; those outside 0...duration are
        passed over.

    Raises
    ------
    StabilityError
        The step lies above the stability limit, which is named.
    """
    state = state_matrix(mass, damping, stiffness)
    stable_step(state, step)
    times: list[Tensor] = [mass.new_zeros(1)]
    states: list[Tensor] = []
    begin = 0.0
    for end in [*sorted(each for each in breaks if 0 < each < duration), duration]:
        n_steps = math.ceil((end - begin) / step - 1e-6)
        if n_steps < 1:  # two breaks at one time
            continue
        h = (end - begin) / n_steps
        time = begin + h / 2 * torch.arange(2 * n_steps + 1, dtype=mass.dtype, device=mass.device)
        within = time.clamp(begin + INSIDE * h, end - INSIDE * h)
        states.append(_rk4_states(state, mass, force(within), h, start)[..., 1 if states else 0 :, :])
        times.append(time[2::2])
        start, begin = states[-1][..., -1, :], end
    return Trajectory(torch.cat(times), torch.cat(states, dim=-2))


def first_order_hold_trajectory(
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "*#batch 13 13"],
    stiffness: Float[Tensor, "*#batch 13 13"],
    force: Float[Tensor, "*#batch time 13"],
    step: float,
    start: Float[Tensor, "*#batch 26"] | None = None,
) -> Float[Tensor, "*#batch time 26"]:
    """States under forces [N, N m] that run linearly from row to row; exact for such forces, stable at any step [s].

    A run too long for memory is marched in pieces that share a row: the last state of one, given as `start`, begins the
    next, whose first force is the last of the piece before.

    Raises
    ------
    StabilityError
        The pump's own motion grows.
    """
    state = state_matrix(mass, damping, stiffness)
    require_decay(state)
    unit = torch.eye(13, dtype=mass.dtype, device=mass.device)
    entry = torch.cat([torch.zeros_like(unit), torch.linalg.inv(mass)]).expand(*state.shape[:-2], 26, 13)
    ramp_rate = torch.nn.functional.pad(unit, (39, 0)).expand(*state.shape[:-2], 13, 52)
    upper = torch.nn.functional.pad(torch.cat([state, entry], dim=-1) * step, (0, 13))
    augmented = torch.cat([upper, ramp_rate, torch.zeros_like(ramp_rate)], dim=-2)
    exponential = torch.linalg.matrix_exp(augmented.double()).to(force.dtype)  # single precision would cost 5 %
    phi, hold, ramp = exponential[..., :26, :].split((26, 13, 13), dim=-1)
    driven = force[..., :-1, :] @ (hold - ramp).mT + force[..., 1:, :] @ ramp.mT
    return linear_recursion(phi, driven, _start(start, driven))


def _rk4_states(state: Tensor, mass: Tensor, force: Tensor, step: float, start: Tensor | None) -> Tensor:
    phi, *inputs = rk4_map(state, step)
    at_start, at_middle, at_end = (_of_forces(part, mass) for part in inputs)
    driven = force[..., :-2:2, :] @ at_start + force[..., 1::2, :] @ at_middle + force[..., 2::2, :] @ at_end
    return linear_recursion(phi, driven, _start(start, driven))


def _of_forces(inputs: Tensor, mass: Tensor) -> Tensor:
    """What forces, as rows on its left, add to the state, where `inputs` is what accelerations add."""
    return torch.linalg.solve(mass.mT, inputs[..., 13:].mT)


def _start(start: Tensor | None, driven: Tensor) -> Tensor:
    return torch.zeros_like(driven[..., 0, :]) if start is None else start


def _over_steps(lines: Tensor, turn: Tensor, n_steps: int) -> Tensor:
    """Re sum_k X_k exp(i turn_k n) at n = 0...n_steps-1, by matrix products of about its square root in size."""
    root = math.isqrt(n_steps - 1) + 1
    length = next((size for size in range(root, 3 * root) if n_steps % size == 0), root)  # then nothing is cut off
    count = torch.arange(-(-n_steps // length), dtype=turn.dtype, device=turn.device)[:, None]
    begin = torch.exp(1j * turn * length * count)[..., None] * lines[..., None, :, :]
    within = turn * torch.arange(length, dtype=turn.dtype, device=turn.device)[:, None]
    table = torch.cat([torch.cos(within), -torch.sin(within)], dim=-1)
    rows = table @ torch.cat([begin.real, begin.imag], dim=-2)
    return rows.flatten(-3, -2)[..., :n_steps, :]
