"""Motion of a linear system under forces at complex frequencies, with derivatives of any order."""

import math
from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError, compiled

MAX_DENSE_SYSTEMS = 8192
"""Systems that `torch.linalg.solve` gets at a time: 22 MB of matrices in double precision."""

LANES = 32
"""Systems that compiled elimination solves side by side, so that the vector unit is full."""

MAX_GROWTH = 1e3
"""Growth of an entry beyond its natural size at which elimination without pivots is given up.

Elimination loses as many digits as entries grow: three of sixteen at this limit.
"""

ROUNDING = 1e-14
"""Size of an entry, or of K_ij - K_ji, that is only rounding, in units of the root of K_ii K_jj."""


def receptance(
    mass: Float[Tensor, "n n"],
    damping: Float[Tensor, "*#batch n n"],
    stiffness: Float[Tensor, "*#batch n n"],
    s: Complex[Tensor, "*#batch line"],
    force: Complex[Tensor, "*#batch line n"],
) -> Complex[Tensor, "*#batch line n"]:
    """Return the displacements X = (M s^2 + C s + K)^-1 F at each complex frequency s [1/s].

    Differentiable with respect to every argument, any number of times: the backward pass calls this
    function again, and stores forces and motions, never a matrix for each line. Leading axes
    broadcast.

    In double precision on a CPU, symmetric systems are solved by compiled elimination without
    pivots, separately for groups of coordinates that nothing couples. That is safe if K and C are
    positive definite; a line at which entries grow by more than `MAX_GROWTH` is solved again with
    pivots, and so is every system that is not symmetric. In single precision and on other devices
    `torch.linalg.solve` does the work, `MAX_DENSE_SYSTEMS` matrices at a time.

    Raises
    ------
    InputError
        A system is singular: a line lies on an undamped resonance, or nothing holds the pump.
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
        """Return the gradients, from the adjoint a = (M s^2 + C s + K)^-H g.

        They are a for F, -Re(conj(a) x^T) for K, that times s for C and times s^2 for M, and
        -conj((2 s M + C) x) . a for s.
        """
        mass, damping, stiffness, s, force, motion = ctx.saved_tensors
        needs_mass, needs_damping, needs_stiffness, needs_s, needs_force = ctx.needs_input_grad
        adjoint = receptance(mass.mT, damping.mT, stiffness.mT, s.conj(), grads[0])
        negative_adjoint = -adjoint.mH
        velocity = s[..., None] * motion
        grad_mass = grad_damping = grad_stiffness = grad_s = grad_force = None

        if needs_mass:
            acceleration = s[..., None] * velocity
            grad_mass = (negative_adjoint @ acceleration).real.sum_to_size(mass.shape)
        if needs_damping:
            grad_damping = (negative_adjoint @ velocity).real.sum_to_size(damping.shape)
        if needs_stiffness:
            grad_stiffness = (negative_adjoint @ motion).real.sum_to_size(stiffness.shape)
        if needs_s:
            slope = velocity @ (2 * mass.mT).to(s.dtype) + motion @ damping.mT.to(s.dtype)
            grad_s = -(adjoint * slope.conj()).sum(dim=-1).sum_to_size(s.shape)
        if needs_force:
            grad_force = adjoint.sum_to_size(force.shape)
        return grad_mass, grad_damping, grad_stiffness, grad_s, grad_force


def _solve(mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor) -> Tensor:
    batch = np.broadcast_shapes(
        damping.shape[:-2], stiffness.shape[:-2], s.shape[:-1], force.shape[:-2]
    )
    mass = mass.contiguous()
    damping = _flatten_batch(damping, batch, 2)
    stiffness = _flatten_batch(stiffness, batch, 2)
    s = _flatten_batch(s, batch, 1)
    force = _flatten_batch(force, batch, 2)

    motion = force.new_empty(math.prod(batch), *force.shape[1:])
    if motion.device.type == "cpu" and motion.dtype == torch.complex128:
        _solve_compiled(mass, damping, stiffness, s, force, motion)
    else:
        all_rows = torch.arange(motion.shape[0] * motion.shape[1], device=motion.device)
        _solve_dense(mass, damping, stiffness, s, force, motion, all_rows)
    return motion.reshape(*batch, *motion.shape[1:])


def _flatten_batch(tensor: Tensor, batch: tuple[int, ...], n_tail: int) -> Tensor:
    """Return `tensor`, contiguous, with one leading axis before its last `n_tail` axes.

    That axis has length 1 if the whole batch shares the values, which then stay uncopied.
    """
    shape = tensor.shape[-n_tail:]
    if math.prod(tensor.shape[:-n_tail]) > 1:
        tensor = tensor.expand(*batch, *shape)
    # Compiled code reads the memory, in which a lazy conjugate or sign is not carried out.
    return tensor.reshape(-1, *shape).resolve_conj().resolve_neg().contiguous()


def _solve_compiled(
    mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor, motion: Tensor
) -> None:
    """Fill `motion` without pivots if the matrices allow it, and the remaining rows with pivots."""
    parts = (mass[None], damping, stiffness)
    clean = [torch.empty_like(part) for part in parts]
    is_symmetric = all(
        remove_rounding(part.numpy(), out.numpy()) for part, out in zip(parts, clean, strict=True)
    )
    failed = torch.full(motion.shape[:2], not is_symmetric, dtype=torch.bool)
    if is_symmetric:
        m, c, k = (part.numpy() for part in clean)
        solve_symmetric(m[0], c, k, s.numpy(), force.numpy(), motion.numpy(), failed.numpy())

    if failed.any():
        rows = failed.flatten().nonzero().squeeze(-1)
        _solve_dense(mass, damping, stiffness, s, force, motion, rows)


def _solve_dense(
    mass: Tensor,
    damping: Tensor,
    stiffness: Tensor,
    s: Tensor,
    force: Tensor,
    motion: Tensor,
    rows: Tensor,
) -> None:
    """Fill those `rows` of `motion` with pivots; a row is a line of one of the batch."""
    motion_rows = motion.flatten(0, 1)
    n_lines = motion.shape[1]

    # Chunks bound the memory: each row needs a matrix here.
    for chunk in rows.split(MAX_DENSE_SYSTEMS):
        batch = chunk // n_lines
        line = chunk % n_lines
        # A shared tensor has length 1 along the batch, and every index modulo 1 is 0.
        rate = s[batch % len(s), line][:, None, None]
        dynamic = (
            stiffness[batch % len(stiffness)]
            + rate * damping[batch % len(damping)]
            + rate**2 * mass
        )
        try:
            motion_rows[chunk] = torch.linalg.solve(dynamic, force[batch % len(force), line])
        except torch.linalg.LinAlgError as failure:  # type: ignore[attr-defined]
            raise InputError(
                "The equations of motion are singular at a line: it lies on a resonance without "
                "damping, or nothing holds the pump. Stiffness and damping values must be positive."
            ) from failure


@compiled
@no_type_check
def remove_rounding(matrices, clean):
    """Fill `clean` with `matrices` less entries of the size of rounding; return success.

    It fails if a matrix is not symmetric to rounding, or not finite. Without such entries,
    coordinates that nothing couples are recognized as such.
    """
    for b in range(matrices.shape[0]):
        for i in range(matrices.shape[1]):
            for j in range(i + 1):
                entry = matrices[b, i, j]
                size = ROUNDING * np.sqrt(abs(matrices[b, i, i] * matrices[b, j, j]))
                # Written so that NaN fails too.
                if not abs(entry - matrices[b, j, i]) <= size:
                    return False

                if abs(entry) <= size:
                    entry = 0.0
                clean[b, i, j] = entry
                clean[b, j, i] = entry
    return True


@compiled
@no_type_check
def find_coupled_groups(mass, damping, stiffness, members, ends):
    """Return the number of groups of coordinates that no matrix of the batch couples.

    Fills `members` with the coordinates, group by group, and `ends` with the end of each group.
    """
    n = mass.shape[0]
    is_coupled = np.zeros((n, n), np.bool_)
    _mark_coupled(mass, is_coupled)
    for matrices in (damping, stiffness):
        for matrix in matrices:
            _mark_coupled(matrix, is_coupled)
    group = np.arange(n)
    _merge_groups(is_coupled, group)

    n_members = 0
    n_groups = 0
    for first in range(n):
        if group[first] == first:
            for i in range(n):
                if group[i] == first:
                    members[n_members] = i
                    n_members += 1
            ends[n_groups] = n_members
            n_groups += 1
    return n_groups


@compiled
@no_type_check
def _mark_coupled(matrix, is_coupled):
    """Mark the pairs of coordinates that `matrix` couples."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[0]):
            is_coupled[i, j] |= matrix[i, j] != 0


@compiled
@no_type_check
def _merge_groups(is_coupled, group):
    """Give each coordinate the lowest coordinate of its group, by passes until nothing changes."""
    previous_sum = -1
    while previous_sum != group.sum():
        previous_sum = group.sum()
        for i in range(group.size):
            for j in range(group.size):
                if is_coupled[i, j]:
                    lowest = min(group[i], group[j])
                    group[i] = lowest
                    group[j] = lowest


@compiled
@no_type_check
def _fill(mass, damping, stiffness, re, im, max_size, batch_index, s_re, s_im, members):
    """Fill the lower triangles of one group, and how large an entry of each row may grow."""
    for i in range(members.shape[0]):
        row = members[i]
        for j in range(i + 1):
            column = members[j]
            inertia = mass[row, column]
            for k in range(LANES):
                viscous = damping[batch_index[0, k], row, column]
                elastic = stiffness[batch_index[1, k], row, column]
                square_re = s_re[k] * s_re[k] - s_im[k] * s_im[k]
                re[i, j, k] = elastic + s_re[k] * viscous + square_re * inertia
                im[i, j, k] = s_im[k] * viscous + 2 * s_re[k] * s_im[k] * inertia

        for k in range(LANES):
            rate = abs(s_re[k]) + abs(s_im[k])
            elastic = abs(stiffness[batch_index[1, k], row, row])
            viscous = abs(damping[batch_index[0, k], row, row])
            natural = elastic + rate * viscous
            max_size[i, k] = MAX_GROWTH * (natural + rate * rate * abs(mass[row, row]))


@compiled
@no_type_check
def _eliminate(re, im, y_re, y_im, max_size, n):
    """Factor the matrices into L D L^T in place, and replace y by L^-1 y.

    Leaves L below the diagonal, the inverse pivots on it, and above it what L was before it was
    divided by them. A row that grows beyond `max_size` gets -1 there.
    """
    # Short loops over few arrays, for only these does the compiler turn into vector code.
    for j in range(n):
        for k in range(LANES):
            inverse = 1 / (re[j, j, k] * re[j, j, k] + im[j, j, k] * im[j, j, k])
            re[j, j, k] = re[j, j, k] * inverse
            im[j, j, k] = -im[j, j, k] * inverse

        for i in range(j + 1, n):
            for k in range(LANES):
                re[j, i, k] = re[i, j, k]
                im[j, i, k] = im[i, j, k]
            for k in range(LANES):
                re[i, j, k] = re[j, i, k] * re[j, j, k] - im[j, i, k] * im[j, j, k]
                im[i, j, k] = re[j, i, k] * im[j, j, k] + im[j, i, k] * re[j, j, k]
            for k in range(LANES):
                factor = abs(re[i, j, k]) + abs(im[i, j, k])
                product = factor * (abs(re[j, i, k]) + abs(im[j, i, k]))
                max_size[i, k] = max_size[i, k] if product <= max_size[i, k] else -1.0
            for t in range(j + 1, i + 1):
                for k in range(LANES):
                    re[i, t, k] -= re[i, j, k] * re[j, t, k] - im[i, j, k] * im[j, t, k]
                    im[i, t, k] -= re[i, j, k] * im[j, t, k] + im[i, j, k] * re[j, t, k]
            for k in range(LANES):
                y_re[i, k] -= re[i, j, k] * y_re[j, k] - im[i, j, k] * y_im[j, k]
                y_im[i, k] -= re[i, j, k] * y_im[j, k] + im[i, j, k] * y_re[j, k]


@compiled
@no_type_check
def _substitute(re, im, y_re, y_im, n):
    """Replace y by L^-T D^-1 y."""
    for j in range(n - 1, -1, -1):
        for k in range(LANES):
            old_re = y_re[j, k]
            old_im = y_im[j, k]
            y_re[j, k] = old_re * re[j, j, k] - old_im * im[j, j, k]
            y_im[j, k] = old_re * im[j, j, k] + old_im * re[j, j, k]

        for i in range(j + 1, n):
            for k in range(LANES):
                y_re[j, k] -= re[i, j, k] * y_re[i, k] - im[i, j, k] * y_im[i, k]
                y_im[j, k] -= re[i, j, k] * y_im[i, k] + im[i, j, k] * y_re[i, k]


@compiled
@no_type_check
def solve_symmetric(mass, damping, stiffness, s, force, motion, failed):
    """Fill `motion`, and mark in `failed` the systems that need pivots.

    A leading axis of length 1 is shared by the whole batch.
    """
    n_batch, n_lines, n = motion.shape
    members = np.empty(n, np.int64)
    ends = np.empty(n, np.int64)
    n_groups = find_coupled_groups(mass, damping, stiffness, members, ends)

    re = np.empty((n, n, LANES))
    im = np.empty((n, n, LANES))
    y_re = np.empty((n, LANES))
    y_im = np.empty((n, LANES))
    max_size = np.empty((n, LANES))
    s_re = np.empty(LANES)
    s_im = np.empty(LANES)
    batch_index = np.empty((4, LANES), np.int64)
    line = np.empty(LANES, np.int64)

    n_systems = n_batch * n_lines
    for first in range(0, n_systems, LANES):
        n_lanes = min(LANES, n_systems - first)
        for k in range(LANES):
            # Lanes beyond the last system repeat it: the loops over lanes have a fixed length.
            system = first + min(k, n_lanes - 1)
            batch = system // n_lines
            line[k] = system % n_lines
            batch_index[0, k] = batch if damping.shape[0] > 1 else 0
            batch_index[1, k] = batch if stiffness.shape[0] > 1 else 0
            batch_index[2, k] = batch if force.shape[0] > 1 else 0
            batch_index[3, k] = batch
            rate = s[batch if s.shape[0] > 1 else 0, line[k]]
            s_re[k] = rate.real
            s_im[k] = rate.imag

        start = 0
        for group in range(n_groups):
            group_members = members[start : ends[group]]
            start = ends[group]
            size = group_members.shape[0]
            for i in range(size):
                for k in range(LANES):
                    load = force[batch_index[2, k], line[k], group_members[i]]
                    y_re[i, k] = load.real
                    y_im[i, k] = load.imag

            _fill(
                mass, damping, stiffness, re, im, max_size, batch_index, s_re, s_im, group_members
            )
            _eliminate(re, im, y_re, y_im, max_size, size)
            _substitute(re, im, y_re, y_im, size)

            for i in range(size):
                for k in range(n_lanes):
                    value = complex(y_re[i, k], y_im[i, k])
                    motion[batch_index[3, k], line[k], group_members[i]] = value
                    if not (max_size[i, k] >= 0 and np.isfinite(value)):
                        failed[batch_index[3, k], line[k]] = True
