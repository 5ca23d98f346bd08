"""Motion of a linear system under forces at complex frequencies, with exact derivatives of any
order.
"""

import math
from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError, compiled

ROWS = 8192
"""Systems that are factored at once where pivots are needed; 22 MB of matrices in double
precision.
"""
LANES = 32
"""Systems that are eliminated side by side, so that the vector unit is full."""
GROWTH = 1e3
"""Growth of an entry beyond its natural size at which elimination without pivots is given up."""
ROUNDING = 1e-14
"""Entry, or difference between K_ij and K_ji, that is nothing but rounding; in units of the root of
K_ii K_jj.
"""


def receptance(
    mass: Float[Tensor, "n n"],
    damping: Float[Tensor, "*#batch n n"],
    stiffness: Float[Tensor, "*#batch n n"],
    s: Complex[Tensor, "*#batch line"],
    force: Complex[Tensor, "*#batch line n"],
) -> Complex[Tensor, "*#batch line n"]:
    """Displacement amplitudes X = (M s^2 + C s + K)^-1 F at each complex frequency s [1/s].

    Differentiable with respect to every argument, any number of times: the backward pass is a call
    of this very function, and what it keeps is forces and motions, never a matrix a line. Leading
    axes broadcast.

    In double precision on a CPU, symmetric systems are solved by compiled elimination without
    pivots, coordinates that nothing couples apart from each other. That is safe for K and C
    positive definite; a line at which entries grow by more than 1e3 is solved again with pivots,
    and so is every system that is not symmetric. Elsewhere `torch.linalg.solve` does the work,
    `ROWS` matrices at a time.

    Raises
    ------
    InputError
        A system is singular: a line lies on a resonance without damping, or nothing holds the pump.
    """
    return _Receptance.apply(mass, damping, stiffness, s, force)


class _Receptance(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor
    ) -> Tensor:
        motion = _solve(mass, damping, stiffness, s, force)
        ctx.save_for_backward(mass, damping, stiffness, s, force, motion)
        return motion

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        """With a = (M s^2 + C s + K)^-H g: the gradients are a for F, -Re(conj(a) x^T) for K, and
        so on.
        """
        mass, damping, stiffness, s, force, motion = ctx.saved_tensors
        of_mass, of_damping, of_stiffness, of_s, of_force = ctx.needs_input_grad
        adjoint = receptance(mass.mT, damping.mT, stiffness.mT, s.conj(), grads[0])
        left, velocity = -adjoint.mH, s[..., None] * motion
        turned = (
            (velocity @ (2 * mass.mT).to(s.dtype) + motion @ damping.mT.to(s.dtype))
            if of_s
            else motion
        )
        return (
            (left @ (s[..., None] * velocity)).real.sum_to_size(mass.shape) if of_mass else None,
            (left @ velocity).real.sum_to_size(damping.shape) if of_damping else None,
            (left @ motion).real.sum_to_size(stiffness.shape) if of_stiffness else None,
            -(adjoint * turned.conj()).sum(dim=-1).sum_to_size(s.shape) if of_s else None,
            adjoint.sum_to_size(force.shape) if of_force else None,
        )


def _solve(mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor) -> Tensor:
    leading = (damping.shape[:-2], stiffness.shape[:-2], s.shape[:-1], force.shape[:-2])
    batch = np.broadcast_shapes(*leading)
    damping, stiffness = _flat(damping, batch, 2), _flat(stiffness, batch, 2)
    s, force, mass = _flat(s, batch, 1), _flat(force, batch, 2), mass.contiguous()
    motion = force.new_empty(math.prod(batch), *force.shape[1:])
    if motion.device.type == "cpu" and motion.dtype == torch.complex128:
        _solve_compiled(mass, damping, stiffness, s, force, motion)
    else:
        everything = torch.arange(motion.shape[0] * motion.shape[1], device=motion.device)
        _solve_pivoted(mass, damping, stiffness, s, force, motion, everything)
    return motion.reshape(*batch, *motion.shape[1:])


def _flat(tensor: Tensor, batch: tuple[int, ...], tail: int) -> Tensor:
    """One leading axis, of length 1 where all of the batch share the values, which lie in memory in
    their order.
    """
    shape = tensor.shape[-tail:]
    if math.prod(tensor.shape[:-tail]) > 1:
        tensor = tensor.expand(*batch, *shape)
    return tensor.reshape(-1, *shape).resolve_conj().resolve_neg().contiguous()


def _solve_compiled(
    mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor, motion: Tensor
) -> None:
    failed = torch.ones(motion.shape[:2], dtype=torch.bool)
    tidied = [torch.empty_like(part) for part in (mass[None], damping, stiffness)]
    if all(
        tidy(part.numpy(), out.numpy())
        for part, out in zip((mass[None], damping, stiffness), tidied, strict=True)
    ):
        failed[:] = False
        m, c, k = (part.numpy() for part in tidied)
        solve_symmetric(m[0], c, k, s.numpy(), force.numpy(), motion.numpy(), failed.numpy())
    if failed.any():
        _solve_pivoted(
            mass, damping, stiffness, s, force, motion, failed.flatten().nonzero().squeeze(-1)
        )


def _solve_pivoted(
    mass: Tensor,
    damping: Tensor,
    stiffness: Tensor,
    s: Tensor,
    force: Tensor,
    motion: Tensor,
    rows: Tensor,
) -> None:
    """Fill in those `rows` of `motion`, batch and line counted as one, so many at a time that
    memory stays bounded.
    """
    out = motion.flatten(0, 1)
    for chunk in rows.split(ROWS):
        batch, line = chunk // motion.shape[1], chunk % motion.shape[1]
        at = s[batch % len(s), line][:, None, None]
        dynamic = (
            stiffness[batch % len(stiffness)] + at * damping[batch % len(damping)] + at**2 * mass
        )
        try:
            out[chunk] = torch.linalg.solve(dynamic, force[batch % len(force), line])
        except torch.linalg.LinAlgError as failure:  # type: ignore[attr-defined]
            raise InputError(
                "the equations of motion are singular at a line: it lies on a resonance without damping, or nothing "
                "holds the pump. Stiffness and damping values must be positive."
            ) from failure


@compiled
@no_type_check
def tidy(matrices, tidied):
    """Whether every matrix is symmetric to rounding, and finite; `tidied` gets them without entries
    of that size.
    """
    for b in range(matrices.shape[0]):
        for i in range(matrices.shape[1]):
            for j in range(i + 1):
                entry = matrices[b, i, j]
                size = ROUNDING * np.sqrt(abs(matrices[b, i, i] * matrices[b, j, j]))
                if not abs(entry - matrices[b, j, i]) <= size:
                    return False
                tidied[b, i, j] = tidied[b, j, i] = entry if abs(entry) > size else 0.0
    return True


@compiled
@no_type_check
def coupled_groups(mass, damping, stiffness, order, ends):
    """Count of the groups of coordinates that no matrix of the batch couples; fills in members and
    ends of each.
    """
    n = mass.shape[0]
    coupled, group = np.zeros((n, n), np.bool_), np.arange(n)
    _couple(mass, coupled)
    for matrices in (damping, stiffness):
        for matrix in matrices:
            _couple(matrix, coupled)
    _join(coupled, group)
    filled, count = 0, 0
    for first in range(n):
        if group[first] == first:
            for i in range(n):
                if group[i] == first:
                    order[filled] = i
                    filled += 1
            ends[count] = filled
            count += 1
    return count


@compiled
@no_type_check
def _couple(matrix, coupled):
    """Note what `matrix` couples."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[0]):
            coupled[i, j] |= matrix[i, j] != 0


@compiled
@no_type_check
def _join(coupled, group):
    """Give each coordinate the least coordinate of its group; passes over all couplings until
    nothing changes.
    """
    before = -1
    while before != group.sum():
        before = group.sum()
        for i in range(group.size):
            for j in range(group.size):
                if coupled[i, j]:
                    group[i] = group[j] = min(group[i], group[j])


@compiled
@no_type_check
def _fill(mass, damping, stiffness, re, im, size, at, sr, si, members):
    """Lower triangles of one group, and how large an entry of each row may grow."""
    for i in range(members.shape[0]):
        row = members[i]
        for j in range(i + 1):
            column = members[j]
            inertia = mass[row, column]
            for k in range(LANES):
                viscous = damping[at[0, k], row, column]
                elastic = stiffness[at[1, k], row, column]
                re[i, j, k] = elastic + sr[k] * viscous + (sr[k] * sr[k] - si[k] * si[k]) * inertia
                im[i, j, k] = si[k] * viscous + 2 * sr[k] * si[k] * inertia
        for k in range(LANES):
            rate = abs(sr[k]) + abs(si[k])
            natural = abs(stiffness[at[1, k], row, row]) + rate * abs(damping[at[0, k], row, row])
            size[i, k] = GROWTH * (natural + rate * rate * abs(mass[row, row]))


@compiled
@no_type_check
def _eliminate(re, im, yr, yi, size, n):
    """L below the diagonal, inverse pivots on it, what L was before its division above; y becomes
    L^-1 y.
    """
    for j in range(n):
        for k in range(LANES):
            inverse = 1 / (re[j, j, k] * re[j, j, k] + im[j, j, k] * im[j, j, k])
            re[j, j, k] = re[j, j, k] * inverse
            im[j, j, k] = -im[j, j, k] * inverse
        for i in range(j + 1, n):
            for k in range(
                LANES
            ):  # short loops over few arrays, which the compiler turns into vector code
                re[j, i, k] = re[i, j, k]
                im[j, i, k] = im[i, j, k]
            for k in range(LANES):
                re[i, j, k] = re[j, i, k] * re[j, j, k] - im[j, i, k] * im[j, j, k]
                im[i, j, k] = re[j, i, k] * im[j, j, k] + im[j, i, k] * re[j, j, k]
            for k in range(LANES):
                product = (abs(re[i, j, k]) + abs(im[i, j, k])) * (
                    abs(re[j, i, k]) + abs(im[j, i, k])
                )
                size[i, k] = size[i, k] if product <= size[i, k] else -1.0
            for t in range(j + 1, i + 1):
                for k in range(LANES):
                    re[i, t, k] -= re[i, j, k] * re[j, t, k] - im[i, j, k] * im[j, t, k]
                    im[i, t, k] -= re[i, j, k] * im[j, t, k] + im[i, j, k] * re[j, t, k]
            for k in range(LANES):
                yr[i, k] -= re[i, j, k] * yr[j, k] - im[i, j, k] * yi[j, k]
                yi[i, k] -= re[i, j, k] * yi[j, k] + im[i, j, k] * yr[j, k]


@compiled
@no_type_check
def _substitute(re, im, yr, yi, n):
    """y becomes L^-T D^-1 y."""
    for j in range(n - 1, -1, -1):
        for k in range(LANES):
            a, b = yr[j, k], yi[j, k]
            yr[j, k] = a * re[j, j, k] - b * im[j, j, k]
            yi[j, k] = a * im[j, j, k] + b * re[j, j, k]
        for i in range(j + 1, n):
            for k in range(LANES):
                yr[j, k] -= re[i, j, k] * yr[i, k] - im[i, j, k] * yi[i, k]
                yi[j, k] -= re[i, j, k] * yi[i, k] + im[i, j, k] * yr[i, k]


@compiled
@no_type_check
def solve_symmetric(mass, damping, stiffness, s, force, motion, failed):
    """Fill in `motion`, and mark in `failed` the systems that need pivots; a leading axis of 1 is
    shared by all.
    """
    n_batch, n_lines, n = motion.shape
    order, ends = np.empty(n, np.int64), np.empty(n, np.int64)
    count = coupled_groups(mass, damping, stiffness, order, ends)
    re, im = np.empty((n, n, LANES)), np.empty((n, n, LANES))
    yr, yi, size = np.empty((n, LANES)), np.empty((n, LANES)), np.empty((n, LANES))
    sr, si = np.empty(LANES), np.empty(LANES)
    at, line = np.empty((4, LANES), np.int64), np.empty(LANES, np.int64)
    for first in range(0, n_batch * n_lines, LANES):
        lanes = min(LANES, n_batch * n_lines - first)
        for k in range(LANES):
            batch = (first + min(k, lanes - 1)) // n_lines
            line[k] = (first + min(k, lanes - 1)) % n_lines
            at[0, k] = batch if damping.shape[0] > 1 else 0
            at[1, k] = batch if stiffness.shape[0] > 1 else 0
            at[2, k] = batch if force.shape[0] > 1 else 0
            at[3, k] = batch
            value = s[batch if s.shape[0] > 1 else 0, line[k]]
            sr[k], si[k] = value.real, value.imag
        for group in range(count):
            members = order[(ends[group - 1] if group > 0 else 0) : ends[group]]
            for i in range(members.shape[0]):
                for k in range(LANES):
                    value = force[at[2, k], line[k], members[i]]
                    yr[i, k], yi[i, k] = value.real, value.imag
            _fill(mass, damping, stiffness, re, im, size, at, sr, si, members)
            _eliminate(re, im, yr, yi, size, members.shape[0])
            _substitute(re, im, yr, yi, members.shape[0])
            for i in range(members.shape[0]):
                for k in range(lanes):
                    motion[at[3, k], line[k], members[i]] = complex(yr[i, k], yi[i, k])
                    if not (size[i, k] >= 0 and np.isfinite(yr[i, k]) and np.isfinite(yi[i, k])):
                        failed[at[3, k], line[k]] = True
