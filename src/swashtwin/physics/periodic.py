"""Steady state of a system whose stiffness and damping turn with the shaft."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.steady import SteadySolver

STANDSTILL = 40
"""Iterations over which the change must halve; where it does not, and is below `ROUNDING`, it is
rounding.
"""
ROUNDING = 1e-8
"""Change of the lines, relative to the largest, up to which ill-conditioned equations may leave
it.
"""


@dataclass(frozen=True, eq=False)
class PeriodicTerm:
    """Part of K and C that turns with the shaft: K(t) += Re(stiffness exp(i order omega t)), C
    likewise.
    """

    order: int
    """Shaft order, at least 1."""
    stiffness: Complex[Tensor, "*batch 13 13"]
    """Complex amplitude [N/m]."""
    damping: Complex[Tensor, "*batch 13 13"] | None = None
    """Complex amplitude [N s/m], or None for no damping term."""


def periodic_steady_state(
    solver: SteadySolver,
    mass: Float[Tensor, "13 13"],
    damping: Float[Tensor, "*batch 13 13"],
    stiffness: Float[Tensor, "*batch 13 13"],
    speed: Float[Tensor, "*#batch"] | float,
    force: Complex[Tensor, "*batch line 13"],
    terms: Sequence[PeriodicTerm],
    *,
    tolerance: float = 1e-10,
    most: int = 200,
) -> Complex[Tensor, "*batch line 13"]:
    """Displacement lines ``k = 0, 1, ...`` of a system whose K and C turn with the shaft.

    Fixed-point iteration: the periodic part acts as a force that is updated until it no longer
    changes. It converges where that part is a minor share of the constant one, and says so where it
    does not. Each of a batch stops by itself. Derivatives are those of the solution, by the same
    iteration on the transposed system: what they keep does not grow with the iterations.

    Parameters
    ----------
    speed : shaft speed [rad/s], one for each of the batch or one for all.
    force : one-sided lines from order 0 (the mean), all orders without gaps.
    terms : what turns, of any orders; what they throw beyond the last line is lost.
    tolerance : change of the lines, relative to the largest, at which the iteration ends; no less
        than the number format resolves, and up to `ROUNDING` where the equations are so
        ill-conditioned that it no longer falls.
    most : iterations after which it counts as failed.

    Raises
    ------
    InputError
        The periodic part is too large for the iteration.
    """
    orders = torch.arange(force.shape[-2], dtype=stiffness.dtype, device=stiffness.device)
    frequency = orders * (speed[..., None] if isinstance(speed, Tensor) else speed)
    iteration = _Iteration(solver, tuple(term.order for term in terms), tolerance, most)
    amplitudes = [part for term in terms for part in (term.stiffness, term.damping)]
    return _Periodic.apply(iteration, mass, damping, stiffness, frequency, force, *amplitudes)


@dataclass(frozen=True)
class _Iteration:
    """The iteration, and what it needs besides tensors; `equations` are M, C, K and the frequencies
    [rad/s].
    """

    solver: SteadySolver
    orders: tuple[int, ...]
    tolerance: float
    most: int
    transposed: bool = False

    def run(
        self, equations: Sequence[Tensor], force: Tensor, amplitudes: Sequence[Tensor | None]
    ) -> Tensor:
        """Lines at which the iteration stands still."""
        lines = self.solve(equations, force)
        tolerance = max(self.tolerance, 4 * torch.finfo(lines.dtype).eps)
        moving = torch.ones(lines.shape[:-2], dtype=torch.bool, device=lines.device)
        before: list[Tensor] = []
        for _ in range(self.most):
            updated = self.update(equations, force, amplitudes, lines)
            change, size = (
                (updated - lines).abs().amax(dim=(-2, -1)),
                updated.abs().amax(dim=(-2, -1)),
            )
            lines = torch.where(moving[..., None, None], updated, lines)
            moving = moving & ~(change <= tolerance * size)
            before.append(change)
            if len(before) > STANDSTILL:  # rounding keeps it going
                moving = moving & ~((change > before.pop(0) / 2) & (change <= ROUNDING * size))
            if not bool(moving.any()):
                return lines
        raise InputError(
            "the periodic part of the stiffness is too large for the iteration "
            f"(still changing by {float((change / size).max()):.1e}); reduce the severity of the periodic fault."
        )

    def update(
        self,
        equations: Sequence[Tensor],
        force: Tensor,
        amplitudes: Sequence[Tensor | None],
        lines: Tensor,
    ) -> Tensor:
        """Motion under `force` and under the answer of the periodic part to the motion `lines`."""
        return self.solve(equations, force - self.reaction(amplitudes, equations[3], lines))

    def solve(self, equations: Sequence[Tensor], force: Tensor) -> Tensor:
        """Motion of the constant part; transposed, that of its adjoint, which runs backwards in
        time.
        """
        mass, damping, stiffness, frequency = equations
        if self.transposed:
            mass, damping, stiffness, frequency = mass.mT, damping.mT, stiffness.mT, -frequency
        return self.solver.steady_state(mass, damping, stiffness, frequency, force)

    def reaction(
        self, amplitudes: Sequence[Tensor | None], frequency: Tensor, lines: Tensor
    ) -> Tensor:
        """One-sided lines of the force with which the periodic part answers the motion `lines`.

        Transposed: the adjoint of that, under Re sum_k conj(a_k) b_k. Over time order 0 weighs
        twice what the others do.
        """
        rate = 1j * frequency[..., None]
        weight = torch.full_like(frequency, 0.5)[..., None]
        weight[..., 0, :] = 1.0
        lines = lines / weight if self.transposed else lines
        total = torch.zeros_like(lines)
        for order, elastic, viscous in zip(
            self.orders, amplitudes[::2], amplitudes[1::2], strict=True
        ):
            if elastic is not None:
                total = total + turning_force(
                    elastic.mT if self.transposed else elastic, order, lines
                )
            if viscous is not None and self.transposed:
                total = total - rate * turning_force(viscous.mT, order, lines)
            elif viscous is not None:
                total = total + turning_force(viscous, order, rate * lines)
        return total * weight if self.transposed else total


class _Periodic(torch.autograd.Function):
    """x = S (F - P x), S the constant system and P the answer of its periodic part, both linear
    over the reals.
    """

    @staticmethod
    def forward(ctx: Any, iteration: _Iteration, *tensors: Tensor | None) -> Tensor:
        equations, force, amplitudes = _parted(tensors)
        lines = iteration.run(equations, force, amplitudes)
        ctx.iteration = iteration
        ctx.save_for_backward(*tensors, lines)
        return lines

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        """With m = S^T (g - P^T m), the gradients are those of S (F - P x) at a fixed x under g -
        P^T m.
        """
        *saved, lines = ctx.saved_tensors
        again = torch.is_grad_enabled()
        with torch.enable_grad():  # aliases, to which no path leads through `lines`
            tensors: list[Any] = [part if part is None else part.view_as(part) for part in saved]
        equations, force, amplitudes = _parted(tensors)
        adjoint = replace(ctx.iteration, transposed=not ctx.iteration.transposed)
        answer = _Periodic.apply(adjoint, *equations, grads[0], *amplitudes)
        seed = grads[0] - adjoint.reaction(amplitudes, equations[3], answer)
        wanted = [index for index, needed in enumerate(ctx.needs_input_grad[1:]) if needed]
        with torch.enable_grad():
            motion = ctx.iteration.update(equations, force, amplitudes, lines)
            inner = torch.autograd.grad(
                motion,
                [tensors[index] for index in wanted],
                seed,
                create_graph=again,
                allow_unused=True,
            )
        gradients = dict(zip(wanted, inner, strict=True))
        return (None, *(gradients.get(index) for index in range(len(tensors))))


def _parted(tensors: Sequence[Any]) -> tuple[Sequence[Tensor], Tensor, Sequence[Tensor | None]]:
    """M, C, K and frequencies; force; amplitudes: of the tensors that `_Periodic` is applied to."""
    return tensors[:4], tensors[4], tensors[5:]


def turning_force(amplitude: Tensor, order: int, lines: Tensor) -> Tensor:
    """Return the force lines of a stiffness or damping that turns with the shaft.

    One-sided lines of Re(amplitude exp(i order theta)) times the motion of one-sided `lines`.
    """
    n = lines.shape[-2]
    positive = torch.cat([lines[..., :1, :].real.to(lines.dtype), lines[..., 1:, :] / 2], dim=-2)
    two_sided = torch.cat(
        [positive[..., 1:, :].flip(-2).conj(), positive], dim=-2
    )  # orders 1 - n ... n - 1
    padded = torch.nn.functional.pad(two_sided, (0, 0, order, order))
    below, above = (
        padded[..., n - 1 : 2 * n - 1, :],
        padded[..., n - 1 + 2 * order : 2 * n - 1 + 2 * order, :],
    )
    half = amplitude.mT / 2
    mixed = below @ half + above @ half.conj()
    return torch.cat([mixed[..., :1, :], 2 * mixed[..., 1:, :]], dim=-2)
