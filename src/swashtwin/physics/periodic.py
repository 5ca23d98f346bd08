"""Steady state of a system whose stiffness and damping turn with the shaft."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.steady import SteadySolver

STALL_ITERATIONS = 40
"""Iterations within which the change must halve; a small change that does not is rounding."""

MAX_ROUNDING = 1e-8
"""Change of the lines, relative to the largest, up to which a stalled iteration has converged."""


@dataclass(frozen=True, eq=False)
class PeriodicTerm:
    """Part of K and C that turns with the shaft: K(t) += Re(stiffness exp(i order omega t))."""

    order: int
    """Shaft order, at least 1."""
    stiffness: Complex[Tensor, "*batch 13 13"]
    """Complex amplitude [N/m]."""
    damping: Complex[Tensor, "*batch 13 13"] | None = None
    """Complex amplitude [N s/m] of the part of C, or None for no damping term."""


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
    max_iterations: int = 200,
) -> Complex[Tensor, "*batch line 13"]:
    """Return displacement lines ``k = 0, 1, ...`` of a system whose K and C turn with the shaft.

    Fixed-point iteration: the periodic part acts as a force that is updated until it no longer
    changes. It converges if that part is a minor share of the constant one, and raises an error
    otherwise. Each member of a batch stops by itself. Derivatives are those of the solution, by the
    same iteration on the transposed system, so their memory does not grow with the iterations.

    Parameters
    ----------
    speed : shaft speed [rad/s], one for each of the batch or one for all.
    force : one-sided lines from order 0 (the mean), all orders without gaps.
    terms : turning parts, of any orders; motion beyond the last line is not computed.
    tolerance : change of the lines, relative to the largest, at which the iteration ends. It is
        raised to what the number format resolves, and to `MAX_ROUNDING` if the equations are so
        ill-conditioned that the change no longer falls.
    max_iterations : iterations after which the solution fails.

    Raises
    ------
    InputError
        The periodic part is too large for the iteration.
    """
    orders = torch.arange(force.shape[-2], dtype=stiffness.dtype, device=stiffness.device)
    shaft_speed = speed[..., None] if isinstance(speed, Tensor) else speed
    iteration = _Iteration(solver, tuple(term.order for term in terms), tolerance, max_iterations)
    amplitudes: list[Tensor | None] = []
    for term in terms:
        amplitudes += [term.stiffness, term.damping]
    return _Periodic.apply(
        iteration, mass, damping, stiffness, orders * shaft_speed, force, *amplitudes
    )


@dataclass(frozen=True)
class _Iteration:
    """Fixed-point iteration with its settings.

    In its methods `equations` are M, C, K and the frequencies [rad/s], and `amplitudes` are the
    stiffness and the damping of each term in turn.
    """

    solver: SteadySolver
    orders: tuple[int, ...]
    tolerance: float
    max_iterations: int
    is_transposed: bool = False

    def run(
        self, equations: Sequence[Tensor], force: Tensor, amplitudes: Sequence[Tensor | None]
    ) -> Tensor:
        """Return the lines at which the iteration converges."""
        lines = self.solve(equations, force)
        tolerance = max(self.tolerance, 4 * torch.finfo(lines.dtype).eps)
        is_moving = torch.ones(lines.shape[:-2], dtype=torch.bool, device=lines.device)
        recent_changes: list[Tensor] = []
        for _ in range(self.max_iterations):
            updated = self.update(equations, force, amplitudes, lines)
            change = (updated - lines).abs().amax(dim=(-2, -1))
            size = updated.abs().amax(dim=(-2, -1))

            # A member that has converged stays, so that it gets the same bits in any batch.
            lines = torch.where(is_moving[..., None, None], updated, lines)
            is_moving = is_moving & ~(change <= tolerance * size)

            recent_changes.append(change)
            if len(recent_changes) > STALL_ITERATIONS:
                has_stalled = change > recent_changes.pop(0) / 2
                is_moving = is_moving & ~(has_stalled & (change <= MAX_ROUNDING * size))
            if not bool(is_moving.any()):
                return lines

        raise InputError(
            "The periodic part of the stiffness is too large for the iteration (still changing by "
            f"{float((change / size).max()):.1e}); reduce the severity of the periodic fault."
        )

    def update(
        self,
        equations: Sequence[Tensor],
        force: Tensor,
        amplitudes: Sequence[Tensor | None],
        lines: Tensor,
    ) -> Tensor:
        """Return the motion under `force` and the reaction of the periodic part to `lines`."""
        return self.solve(equations, force - self.reaction(amplitudes, equations[3], lines))

    def solve(self, equations: Sequence[Tensor], force: Tensor) -> Tensor:
        """Return the motion of the constant part, or of its adjoint if transposed.

        The adjoint runs backward in time.
        """
        mass, damping, stiffness, frequency = equations
        if self.is_transposed:
            return self.solver.steady_state(mass.mT, damping.mT, stiffness.mT, -frequency, force)
        return self.solver.steady_state(mass, damping, stiffness, frequency, force)

    def reaction(
        self, amplitudes: Sequence[Tensor | None], frequency: Tensor, lines: Tensor
    ) -> Tensor:
        """Return one-sided lines of the force by which the periodic part reacts to a motion.

        Transposed, it is the adjoint of that under Re sum_k conj(a_k) b_k.
        """
        rate = 1j * frequency[..., None]
        # The mean square over time of order 0 is twice that of another order of equal amplitude.
        weight = torch.full_like(frequency, 0.5)[..., None]
        weight[..., 0, :] = 1.0
        if self.is_transposed:
            lines = lines / weight

        total = torch.zeros_like(lines)
        for order, elastic, viscous in zip(
            self.orders, amplitudes[::2], amplitudes[1::2], strict=True
        ):
            if elastic is not None:
                amplitude = elastic.mT if self.is_transposed else elastic
                total = total + turning_force(amplitude, order, lines)
            if viscous is not None and self.is_transposed:
                total = total - rate * turning_force(viscous.mT, order, lines)
            elif viscous is not None:
                total = total + turning_force(viscous, order, rate * lines)
        return total * weight if self.is_transposed else total


class _Periodic(torch.autograd.Function):
    """x = S (F - P x), with the constant system S and the reaction P of its periodic part.

    Both are linear over the real numbers only: P couples a line with the conjugate of another.
    """

    @staticmethod
    def forward(ctx: Any, iteration: _Iteration, *tensors: Tensor | None) -> Tensor:
        equations, force, amplitudes = _split_arguments(tensors)
        lines = iteration.run(equations, force, amplitudes)
        ctx.iteration = iteration
        ctx.save_for_backward(*tensors, lines)
        return lines

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        """Return the gradients by implicit differentiation.

        With the adjoint lines m = S^T (g - P^T m) for the incoming gradient g, they are those of
        S (F - P x) at a fixed x under g - P^T m.
        """
        *saved, lines = ctx.saved_tensors
        needs_graph = torch.is_grad_enabled()
        # Aliases, so that no path of the graph leads through `lines` back to the arguments.
        with torch.enable_grad():
            tensors: list[Any] = [part if part is None else part.view_as(part) for part in saved]
        equations, force, amplitudes = _split_arguments(tensors)

        adjoint = replace(ctx.iteration, is_transposed=not ctx.iteration.is_transposed)
        adjoint_lines = _Periodic.apply(adjoint, *equations, grads[0], *amplitudes)
        seed = grads[0] - adjoint.reaction(amplitudes, equations[3], adjoint_lines)

        indices = [index for index, is_needed in enumerate(ctx.needs_input_grad[1:]) if is_needed]
        with torch.enable_grad():
            motion = ctx.iteration.update(equations, force, amplitudes, lines)
            partial_gradients = torch.autograd.grad(
                motion,
                [tensors[index] for index in indices],
                seed,
                create_graph=needs_graph,
                allow_unused=True,
            )
        gradients = dict(zip(indices, partial_gradients, strict=True))
        return (None, *(gradients.get(index) for index in range(len(tensors))))


def _split_arguments(
    tensors: Sequence[Any],
) -> tuple[Sequence[Tensor], Tensor, Sequence[Tensor | None]]:
    """Return equations, force and amplitudes of the tensors that `_Periodic` is applied to."""
    return tensors[:4], tensors[4], tensors[5:]


def turning_force(amplitude: Tensor, order: int, lines: Tensor) -> Tensor:
    """Return the force lines of a stiffness or damping that turns with the shaft.

    One-sided lines of Re(amplitude exp(i order theta)) times the motion of one-sided `lines`.
    """
    n = lines.shape[-2]
    positive = torch.cat([lines[..., :1, :].real.to(lines.dtype), lines[..., 1:, :] / 2], dim=-2)
    negative = positive[..., 1:, :].flip(-2).conj()
    two_sided = torch.cat([negative, positive], dim=-2)

    # Multiplication by exp(i order theta) shifts the two-sided lines, here of orders 1 - n...n - 1.
    padded = torch.nn.functional.pad(two_sided, (0, 0, order, order))
    below = padded[..., n - 1 : 2 * n - 1, :]
    above = padded[..., n - 1 + 2 * order : 2 * n - 1 + 2 * order, :]
    half = amplitude.mT / 2
    mixed = below @ half + above @ half.conj()
    return torch.cat([mixed[..., :1, :], 2 * mixed[..., 1:, :]], dim=-2)
