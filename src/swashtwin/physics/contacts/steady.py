"""Steady motion of a pump whose slippers may lift off or differ, with its gradient.

The slippers' films are taken out of K and C; the rest, the core, is linear and marches exactly through forces that run
linearly over a step, and the film force at the end of each step is solved for (`marching`). Revolutions are repeated
until the motion does; between them the state is moved by what the same pump with a film of the mean strength would
still have to go, which leaves few revolutions to march. Gradients are those of the periodic motion itself: the adjoint
is marched backward through the last revolution until it repeats as well, so they do not depend on where the march
started. A motion that repeats only after several revolutions, or never, has no order lines and is refused.

A limit of the model shows where slippers lift off: a film damps with the same C_sw at any distance, so a slipper that
is closing pushes before it touches. What holds the slippers down is the mean of the forces given; left alone, the
pistons in their bores (K_Hz) take a third of it in topology T1, which in truth hold no lasting load: `twin` gives that
back.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.physics.contacts.marching import march, march_back
from swashtwin.physics.contacts.settings import SlipperContact
from swashtwin.physics.contacts.slippers import Slippers, slippers_on_grid
from swashtwin.physics.dynamics import N_DOF, Structure, moved
from swashtwin.pump import Fault, OperatingCondition, Pump


@dataclass(frozen=True)
class Marching:
    """How finely and how long the march goes on."""

    steps: int = 8192
    """Steps per revolution. The error falls with their square, but in proportion only where slippers lift off at
    half-sine edges, whose velocity jumps."""
    tolerance: float = 1e-9
    """Change from one revolution to the next, relative to the motion, below which it repeats."""
    most: int = 100
    """Revolutions after which it is given up."""


def slipper_steady_state(
    pump: Pump,
    structure: Structure,
    topology: str,
    contact: SlipperContact,
    condition: OperatingCondition,
    fault: Fault | None,
    values: Float[Tensor, "*batch 6"],
    force: Complex[Tensor, "*#batch line 13"],
    *,
    mount: Float[Tensor, "*#batch"] | float = 1.0,
    bearing: Float[Tensor, "*#batch"] | float = 1.0,
    parts: Float[Tensor, "*#batch 7"] | None = None,
    excitation: Float[Tensor, "*#batch"] | float = 1.0,
    marching: Marching | None = None,
) -> Complex[Tensor, "*batch line 13"]:
    """Displacement lines 0, 1, ... [m, rad] of a pump with such slippers, differentiable and computed in float64.

    Parameters
    ----------
    fault : its recess displaces the slippers (`slippers`); whatever else it does belongs into `force`.
    values : interface values in the order of `pump.PARAMETERS`.
    force : lines [N, N m] of all forces but the slippers' films', from order 0: the mean decides which slippers lift
        off, and holds the central spring's preload if it is to act.
    mount, bearing, excitation : factors on the mounting's and the bearings' stiffness and on the recess.
    parts : further factors on the parts of mounting and bearings (`Structure.stiffness`).
    marching : by default `Marching`.

    Raises
    ------
    InputError
        Too few steps for the lines.
    SwashTwinError
        The motion does not repeat.
    """
    marching = marching or Marching()
    if marching.steps < 4 * force.shape[-2]:
        raise InputError(
            f"{marching.steps} steps a revolution are too few for {force.shape[-2]} lines; take at least four a line."
        )
    slippers = slippers_on_grid(pump, topology, contact, fault, condition.speed, marching.steps)
    batch, exact = values.shape[:-1], values.to("cpu", torch.float64)
    structure = structure.to("cpu", torch.float64)
    core = exact * torch.tensor([0, 0, 1, 1, 1, 1])
    supports = None if parts is None else parts.to("cpu", torch.float64)
    stiffness = structure.stiffness(core, _exactly(mount), _exactly(bearing), supports).expand(*batch, 13, 13)
    damping = structure.damping(core)
    films = torch.stack([exact[..., 1], exact[..., 0], _exactly(excitation).expand(batch)], dim=-1)
    loads = force.to("cpu", torch.complex128).expand(*batch, -1, -1)
    rows = torch.as_tensor(slippers.rows)
    step = 2 * math.pi / condition.speed / marching.steps
    members = []
    for index in np.ndindex(batch):
        phi, hold, ramp = exact_step(structure.mass, damping[index], stiffness[index], step)
        sample = _samples(loads[index], marching.steps)
        driven = sample @ hold.T + (sample.roll(-1, 0) - sample) @ ramp.T
        films_in_step = (hold - ramp) @ rows.T, ramp @ rows.T
        motion = _PeriodicMotion.apply(phi, driven, *films_in_step, films[index], slippers, contact.one_sided, marching)
        members.append(_lines(motion, force.shape[-2]))
    lines = torch.stack(members).reshape(*batch, *members[0].shape)
    return moved(lines, values)


def _exactly(factor: Tensor | float) -> Tensor:
    return torch.as_tensor(factor, dtype=torch.float64, device="cpu")


def exact_step(
    mass: Float[Tensor, "13 13"], damping: Float[Tensor, "13 13"], stiffness: Float[Tensor, "13 13"], step: float
) -> tuple[Float[Tensor, "26 26"], Float[Tensor, "26 13"], Float[Tensor, "26 13"]]:
    """Phi, G1, G2 of x+ = Phi x + G1 u + G2 (u+ - u), exact for forces u that run linearly over a `step` [s].

    Taken of displacements times the root of the mass, velocities per step and forces likewise: numbers of one size,
    without which the gradient of the exponential loses half its digits.
    """
    root = mass.diagonal().sqrt()
    both = root[:, None] * root
    none, identity = torch.zeros_like(mass), torch.eye(13).to(mass)
    augmented = torch.cat(
        [
            torch.cat([none, identity, none, none], dim=1),
            torch.cat([-stiffness / both * step**2, -damping / both * step, identity, none], dim=1),
            torch.cat([none, none, none, identity], dim=1),
            torch.cat([none, none, none, none], dim=1),
        ]
    )
    exponential = _Exponential.apply(augmented)
    state = torch.cat([1 / root, 1 / (root * step)])[:, None]
    load = step**2 / root
    return exponential[:26, :26] * state / state.T, *(exponential[:26, i : i + 13] * state * load for i in (26, 39))


class _Exponential(torch.autograd.Function):
    """Exponential of a matrix; its gradient is taken of an upstream one of norm 1, which torch does not do."""

    @staticmethod
    def forward(ctx: Any, matrix: Tensor) -> Tensor:
        ctx.save_for_backward(matrix)
        return torch.linalg.matrix_exp(matrix)

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> Tensor:
        (turned,) = (saved.T for saved in ctx.saved_tensors)
        norm = upstream[0].norm()
        size = len(turned)
        corner = upstream[0] / norm.clamp_min(torch.finfo(norm.dtype).tiny)
        block = torch.cat(
            [torch.cat([turned, corner], dim=1), torch.cat([torch.zeros_like(turned), turned], dim=1)], dim=0
        )
        return torch.linalg.matrix_exp(block)[:size, size:] * norm


def _samples(lines: Tensor, steps: int) -> Tensor:
    """Values at the steps between which straight lines have the given order lines; torch differentiates it."""
    order = torch.arange(lines.shape[-2], dtype=torch.float64, device=lines.device)
    sharpened = lines / torch.sinc(order / steps)[:, None] ** 2
    half = torch.where(order == 0, 1.0, 0.5).to(lines.dtype)[:, None]
    return torch.fft.irfft(sharpened * half, n=steps, dim=-2) * steps


def _lines(samples: Tensor, count: int) -> Tensor:
    """The first `count` order lines of a period; torch differentiates it."""
    spectrum = torch.fft.rfft(samples, dim=0)[:count] * (2 / len(samples))
    return torch.cat([spectrum[:1] / 2, spectrum[1:]])


class _PeriodicMotion(torch.autograd.Function):
    """Displacements over the revolution that repeats."""

    @staticmethod
    def forward(
        ctx: Any,
        phi: Tensor,
        driven: Tensor,
        before: Tensor,
        after: Tensor,
        film: Tensor,
        slippers: Slippers,
        one_sided: bool,
        marching: Marching,
    ) -> Tensor:
        parts = (np.ascontiguousarray(part.detach().numpy()) for part in (phi, driven, before, after, film))
        core = _Core(slippers.rows, *parts)
        states, forces, touching = core.repeat(slippers, one_sided, marching)
        ctx.core, ctx.slippers, ctx.marching = core, slippers, marching
        ctx.states, ctx.forces, ctx.touching = states, forces, touching
        return torch.as_tensor(states[:-1, :N_DOF])

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> Any:
        core, slippers, touching = ctx.core, ctx.slippers, ctx.touching
        adjoints, pulls = core.repeat_back(slippers, touching, upstream[0].numpy(), ctx.marching)
        ahead = np.roll(adjoints, -1, axis=0)
        forces, states = ctx.forces, ctx.states
        gradients = (
            ahead.T @ states[:-1],
            ahead,
            ahead.T @ forces[:-1],
            ahead.T @ forces[1:],
            core.film_gradient(slippers, touching, states, pulls),
        )
        return *(torch.as_tensor(part) for part in gradients), None, None, None


@dataclass(frozen=True, eq=False)
class _Core:
    """What a march needs besides the slippers."""

    rows: np.ndarray
    phi: np.ndarray
    driven: np.ndarray
    before: np.ndarray
    after: np.ndarray
    film: np.ndarray

    @property
    def strain(self) -> np.ndarray:
        """What takes a state to K d + C d' of the coordinates."""
        return np.hstack([self.film[0] * self.rows, self.film[1] * self.rows])

    def repeat(self, slippers: Slippers, one_sided: bool, marching: Marching) -> tuple[np.ndarray, ...]:
        """States, film forces and contacts of the revolution that repeats, its start included twice."""
        steps, count = slippers.weights.shape
        states, touching = np.zeros((steps + 1, 26)), np.ones((steps + 1, count), dtype=bool)
        forces = np.zeros((steps + 1, len(self.rows)))
        phi, before, after = (np.ascontiguousarray(part.T) for part in (self.phi, self.before, self.after))
        slipper = np.concatenate([slippers.weights[:, None], slippers.directions.transpose(0, 2, 1)], axis=1)
        recess = np.stack([slippers.displacement, slippers.velocity], axis=1)
        change = math.inf
        for revolution in range(marching.most):
            lifting = one_sided and revolution > 0
            result = states, forces, touching
            failed = march(phi, self.driven, before, after, self.strain, slipper, recess, self.film, lifting, *result)
            if failed:
                raise SwashTwinError(f"which slippers touch cannot be decided at {failed} of {steps} steps.")
            gap = states[-1] - states[0]
            change = _relative(gap, states - states.mean(axis=0))
            if change < marching.tolerance and lifting == one_sided:
                return result
            once = np.linalg.matrix_power(self._mean_step(slippers, touching[:-1])[0], steps)
            states[0] += np.linalg.solve(np.eye(2 * N_DOF) - once, gap)
        raise SwashTwinError(
            f"the motion does not repeat within {marching.most} revolutions (it still changes by {change:.1e} of "
            "itself), so it has no order lines; reduce the severity of the fault."
        )

    def repeat_back(
        self, slippers: Slippers, touching: np.ndarray, upstream: np.ndarray, marching: Marching
    ) -> tuple[np.ndarray, np.ndarray]:
        """Adjoints of states and film forces that repeat, for the gradient `upstream` of the displacements."""
        steps = len(upstream)
        wanted = np.zeros((steps, 26))
        wanted[:, :N_DOF] = upstream
        stiffness = self._contact_matrix(slippers, touching[:-1])
        once = np.linalg.matrix_power(self._mean_step(slippers, touching[:-1])[1].T, steps)
        adjoints, pulls = np.zeros((steps, 26)), np.zeros((steps, len(self.rows)))
        start = np.zeros(26)
        for _ in range(marching.most):
            march_back(self.phi, self.before, self.after, self.strain, stiffness, wanted, start, adjoints, pulls)
            gap = adjoints[0] - start
            if _relative(gap, adjoints) < marching.tolerance:  # against their mean too: a steady one hardly varies
                return adjoints, pulls
            start = start + np.linalg.solve(np.eye(2 * N_DOF) - once, gap)
        raise SwashTwinError(f"the gradient of the motion does not repeat within {marching.most} revolutions.")

    def film_gradient(
        self, slippers: Slippers, touching: np.ndarray, states: np.ndarray, pulls: np.ndarray
    ) -> np.ndarray:
        """Gradient with respect to stiffness, damping and the factor on the recess."""
        coordinates = states[:-1].reshape(-1, 2, N_DOF) @ self.rows.T
        near, rate = np.einsum("kja,kda->dkj", slippers.directions, coordinates)
        pull = -np.einsum("kja,ka,kj->kj", slippers.directions, pulls, slippers.weights * touching[:-1])
        stiffness, damping, gain = self.film
        return np.array(
            [
                np.sum(pull * (near + gain * slippers.displacement)),
                np.sum(pull * (rate + gain * slippers.velocity)),
                np.sum(pull * (stiffness * slippers.displacement + damping * slippers.velocity)),
            ]
        )

    @staticmethod
    def _contact_matrix(slippers: Slippers, touching: np.ndarray) -> np.ndarray:
        weights = slippers.weights * touching
        return np.einsum("kj,kja,kjb->kab", weights, slippers.directions, slippers.directions)

    def _mean_step(self, slippers: Slippers, touching: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One step of state and of adjoint if the films were as strong throughout as they are in the mean."""
        mean = self._contact_matrix(slippers, touching).mean(axis=0)
        answer = -mean @ self.strain
        ahead, implicit = self.phi + self.before @ answer, np.eye(2 * N_DOF) - self.after @ answer
        return np.linalg.solve(implicit, ahead), np.linalg.solve(implicit.T, ahead.T).T


def _relative(gap: np.ndarray, sizes: np.ndarray) -> float:
    """Largest change of displacements and of velocities relative to the rms of their `sizes` over a revolution."""
    ratios = [
        np.linalg.norm(gap[part]) / max(np.sqrt(np.mean(np.sum(sizes[:, part] ** 2, axis=1))), 1e-300)
        for part in (slice(0, 13), slice(13, 26))
    ]
    return float(max(ratios))
