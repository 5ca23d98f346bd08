"""Motion of a linear system under forces at complex frequencies, with exact derivatives of any order."""

import math
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.solvers.elimination import solve_symmetric, tidy

ROWS = 8192
"""Systems that are factored at once where pivots are needed; 22 MB of matrices in double precision."""


def receptance(
    mass: Float[Tensor, "n n"],
    damping: Float[Tensor, "*#batch n n"],
    stiffness: Float[Tensor, "*#batch n n"],
    s: Complex[Tensor, "*#batch line"],
    force: Complex[Tensor, "*#batch line n"],
) -> Complex[Tensor, "*#batch line n"]:
    """Displacement amplitudes X = (M s^2 + C s + K)^-1 F at each complex frequency s [1/s].

    Differentiable with respect to every argument, any number of times: the backward pass is a call of this very
    function, and what it keeps is forces and motions, never a matrix a line. Leading axes broadcast.

    In double precision on a CPU, symmetric systems are solved by compiled elimination without pivots, coordinates that
    nothing couples apart from each other. That is safe for K and C positive definite; a line at which entries grow by
    more than 1e3 is solved again with pivots, and so is every system that is not symmetric. Elsewhere
    `torch.linalg.solve` does the work, `ROWS` matrices at a time.

    Raises
    ------
    InputError
        A system is singular: a line lies on a resonance without damping, or nothing holds the pump.
    """
    return _Receptance.apply(mass, damping, stiffness, s, force)


class _Receptance(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor) -> Tensor:
        motion = _solve(mass, damping, stiffness, s, force)
        ctx.save_for_backward(mass, damping, stiffness, s, force, motion)
        return motion

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        """With a = (M s^2 + C s + K)^-H g: the gradients are a for F, -Re(conj(a) x^T) for K, and so on."""
        mass, damping, stiffness, s, force, motion = ctx.saved_tensors
        of_mass, of_damping, of_stiffness, of_s, of_force = ctx.needs_input_grad
        adjoint = receptance(mass.mT, damping.mT, stiffness.mT, s.conj(), grads[0])
        left, velocity = -adjoint.mH, s[..., None] * motion
        turned = (velocity @ (2 * mass.mT).to(s.dtype) + motion @ damping.mT.to(s.dtype)) if of_s else motion
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
    """One leading axis, of length 1 where all of the batch share the values, which lie in memory in their order."""
    shape = tensor.shape[-tail:]
    if math.prod(tensor.shape[:-tail]) > 1:
        tensor = tensor.expand(*batch, *shape)
    return tensor.reshape(-1, *shape).resolve_conj().resolve_neg().contiguous()


def _solve_compiled(mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor, motion: Tensor) -> None:
    failed = torch.ones(motion.shape[:2], dtype=torch.bool)
    tidied = [torch.empty_like(part) for part in (mass[None], damping, stiffness)]
    if all(tidy(part.numpy(), out.numpy()) for part, out in zip((mass[None], damping, stiffness), tidied, strict=True)):
        failed[:] = False
        m, c, k = (part.numpy() for part in tidied)
        solve_symmetric(m[0], c, k, s.numpy(), force.numpy(), motion.numpy(), failed.numpy())
    if failed.any():
        _solve_pivoted(mass, damping, stiffness, s, force, motion, failed.flatten().nonzero().squeeze(-1))


def _solve_pivoted(
    mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor, motion: Tensor, rows: Tensor
) -> None:
    """Fill in those `rows` of `motion`, batch and line counted as one, so many at a time that memory stays bounded."""
    out = motion.flatten(0, 1)
    for chunk in rows.split(ROWS):
        batch, line = chunk // motion.shape[1], chunk % motion.shape[1]
        at = s[batch % len(s), line][:, None, None]
        dynamic = stiffness[batch % len(stiffness)] + at * damping[batch % len(damping)] + at**2 * mass
        try:
            out[chunk] = torch.linalg.solve(dynamic, force[batch % len(force), line])
        except torch.linalg.LinAlgError as failure:  # type: ignore[attr-defined]
            raise InputError(
                "the equations of motion are singular at a line: it lies on a resonance without damping, or nothing "
                "holds the pump. Stiffness and damping values must be positive."
            ) from failure
