"""What couples the shaft orders of a twin: parts of K and C that turn with the shaft, slippers that lift off."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.physics.contacts.periodic import periodic_films
from swashtwin.physics.contacts.settings import SlipperContact
from swashtwin.physics.contacts.steady import slipper_steady_state
from swashtwin.physics.dynamics import N_DOF, Dof, Structure, Topology
from swashtwin.physics.fault_forcing import FaultAction, turning_terms
from swashtwin.physics.solvers.periodic import periodic_steady_state
from swashtwin.physics.solvers.steady import HarmonicBalance, SteadySolver
from swashtwin.physics.twin.scales import SUPPORTS
from swashtwin.pump import Fault, OperatingCondition, Pump
from swashtwin.pump import InterfaceValue as Value

MOST = 2000
"""Iterations for slippers that differ: they take much of the film with them, and the motion settles slowly."""
FORCE_TOLERANCE = 1e-5
"""Share of the steady forces up to which the bores may carry any of them where slippers lift off."""
TRIES = 30
"""Marches after which the steady force of lifting slippers counts as unsettled."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Equations of motion of some rows of one twin, orders 0 and up."""

    structure: Structure
    """Constant matrices."""
    values: Float[Tensor, "row 6"]
    """Interface values, wear included."""
    scales: Float[Tensor, "row 11"]
    """Factors in the order of `Scales`."""
    pressure: Complex[Tensor, "1 line 13"]
    """Lines of the chamber pressures and of the unbalance [N, N m]."""
    action: FaultAction
    """How the fault acts."""
    speed: float
    """Speed of the shaft [rad/s]."""

    @property
    def excitation(self) -> Float[Tensor, " row"]:
        """Factor on the forces of the fault."""
        return self.scales[:, 2]

    @property
    def stiffness(self) -> Float[Tensor, "row 13 13"]:
        """K of equal slippers [N/m]."""
        mount, bearing, *_ = self.scales.unbind(-1)
        return self.structure.stiffness(self.values, mount, bearing, self.scales[..., SUPPORTS])

    @property
    def damping(self) -> Float[Tensor, "row 13 13"]:
        """C of equal slippers [N s/m]."""
        return self.structure.damping(self.values)

    def force(self, action: FaultAction) -> Complex[Tensor, "row line 13"]:
        """Lines of all forces where the fault acts by `action` [N, N m]."""
        forces = action.forces(self.values, self.structure.slipper_vector, self.excitation)
        return (self.pressure + forces).expand(len(self.values), -1, -1)


@runtime_checkable
class Coupling(Protocol):
    """What couples orders, and the motion it leads to."""

    def motion(self, problem: Problem, solver: SteadySolver) -> Complex[Tensor, "row line 13"]:
        """Displacement lines [m, rad], orders 0 and up."""
        ...


@dataclass(frozen=True)
class TurningFace:
    """A fault that lets stiffness turn with the shaft, such as a cylinder block's face out of square."""

    pump: Pump
    fault: Fault | None

    def motion(self, problem: Problem, solver: SteadySolver) -> Complex[Tensor, "row line 13"]:
        """Displacement lines; see `Coupling`."""
        terms = turning_terms(self.fault, self.pump, problem.values)
        force = problem.force(problem.action)
        mass, damping, stiffness = problem.structure.mass, problem.damping, problem.stiffness
        return periodic_steady_state(solver, mass, damping, stiffness, problem.speed, force, terms)


@dataclass(frozen=True)
class SlippersApart:
    """Slippers that differ from each other or lift off."""

    pump: Pump
    topology: Topology
    contact: SlipperContact
    condition: OperatingCondition
    fault: Fault | None

    def motion(self, problem: Problem, solver: SteadySolver) -> Complex[Tensor, "row line 13"]:
        """Displacement lines; see `Coupling`. Where slippers can lift off the march has a solver of its own."""
        rest = problem.force(replace(problem.action, film=torch.zeros_like(problem.action.film)))
        if not self.contact.one_sided:
            return self._turning(problem, rest, solver)
        if not isinstance(solver, HarmonicBalance):
            raise InputError(
                "slippers that lift off are marched by a step of their own; leave the solver at HarmonicBalance() "
                "(--solver harmonic-balance)."
            )
        return self._lifting(problem, rest)

    def _lifting(self, problem: Problem, rest: Tensor) -> Tensor:
        """Motion in which the bores carry no steady axial force, although the films pull the mean about as they lift.

        The mean elongation e between retainer and block that the relief assumes must be the one that comes out: a
        secant finds it, and one Newton step on it passes its derivatives on.
        """
        between = _between(problem.values)
        bore = problem.values[:, Value.PISTON_BORE_STIFFNESS, None]
        mount, bearing, excitation, *_ = problem.scales.unbind(-1)

        def motion_at(assumed: Tensor) -> tuple[Tensor, Tensor]:
            steady = (bore * assumed[:, None] - self.pump.coupling.spring_preload) * between
            force = torch.cat([rest[:, :1] + steady[:, None], rest[:, 1:]], dim=1)
            motion = slipper_steady_state(
                self.pump,
                problem.structure,
                self.topology,
                self.contact,
                self.condition,
                self.fault,
                problem.values,
                force,
                mount=mount,
                bearing=bearing,
                parts=problem.scales[..., SUPPORTS],
                excitation=excitation,
            )
            return motion, motion[:, 0].real @ between - assumed

        scale = rest[:, 0].real.abs().sum(dim=-1) / bore[:, 0]
        with torch.no_grad():
            assumed, slope = _secant(lambda e: motion_at(e)[1], _sliding(self.pump, problem, rest), scale)
        if torch.is_grad_enabled():
            assumed = assumed - motion_at(assumed)[1] / slope
        return motion_at(assumed)[0]

    def _turning(self, problem: Problem, force: Tensor, solver: SteadySolver) -> Tensor:
        structure, values = problem.structure, problem.values
        n_lines = force.shape[1] - 1
        films = periodic_films(self.pump, self.topology, self.contact, self.condition, self.fault, values, n_lines)
        shape = films.mean_shape - structure.interface_shapes[0]
        damping = problem.damping + values[:, Value.SLIPPER_SWASH_DAMPING, None, None] * shape
        stiffness = problem.stiffness + values[:, Value.SLIPPER_SWASH_STIFFNESS, None, None] * shape
        loads = held_down(self.pump, problem, force + problem.excitation[:, None, None] * films.force)
        return periodic_steady_state(
            solver, structure.mass, damping, stiffness, problem.speed, loads, films.terms, most=MOST
        )


def _between(values: Tensor) -> Tensor:
    """Elongation between retainer and cylinder block along the shaft, per unit of each coordinate."""
    between = values.new_zeros(N_DOF)
    between[Dof.RETAINER_Z], between[Dof.ROTOR_Z] = 1.0, -1.0
    return between


def _sliding(pump: Pump, problem: Problem, force: Tensor) -> Tensor:
    """Mean elongation between retainer and block of linear films where pistons slide in their bores."""
    between = _between(problem.values)
    bore = problem.values[:, Value.PISTON_BORE_STIFFNESS, None, None]
    stiffness = problem.stiffness - bore * torch.outer(between, between)
    mean = force[:, 0].real - pump.coupling.spring_preload * between
    return torch.linalg.solve(stiffness, mean) @ between


def _secant(gap: Callable[[Tensor], Tensor], start: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Where `gap` of each row vanishes to `FORCE_TOLERANCE` of `scale`, and its slope there."""
    before, now = start, start + gap(start)
    gap_before, gap_now = now - start, gap(now)
    slope = torch.full_like(start, -1.0)
    for _ in range(TRIES):
        moved = now - before
        ratio = (gap_now - gap_before) / moved
        slope = torch.where((moved.abs() > 1e-12 * scale) & torch.isfinite(ratio) & (ratio < 0), ratio, slope)
        if bool((gap_now.abs() <= FORCE_TOLERANCE * scale).all()):
            return now, slope
        before, gap_before = now, gap_now
        now = now - gap_now / slope
        gap_now = gap(now)
    raise SwashTwinError(
        "the slippers' steady force does not settle: the recess throws the retainer off the swash plate. Reduce its "
        'depth, or take contact="physical".'
    )


def held_down(pump: Pump, problem: Problem, force: Complex[Tensor, "row line 13"]) -> Complex[Tensor, "row line 13"]:
    """`force`, lines from order 0, with the steady forces between retainer and cylinder block that springs cannot give.

    A piston slides in its bore: it carries no steady axial force, where the linear model's K_Hz would. The slippers
    then carry all of it (topology T1: the sum of the pistons' forces over the cosine of the swash angle) and the
    central spring's preload. In topology T2, whose slippers are rigid with the rotor, the films of valve plate and
    slippers share the mean as springs do. Only the order 0 is touched.
    """
    bore = problem.values[:, Value.PISTON_BORE_STIFFNESS] * _sliding(pump, problem, force)
    steady = (bore - pump.coupling.spring_preload)[:, None] * _between(problem.values)
    return torch.cat([force[:, :1] + steady[:, None], force[:, 1:]], dim=1)


def linear_motion(
    pump: Pump, problem: Problem, frequency: Float[Tensor, " line"], recess: float
) -> Complex[Tensor, "row line 13"]:
    """Displacement lines [m, rad] at `frequency` [rad/s], the first being 0, where nothing couples the orders.

    Parameters
    ----------
    recess : mean of what a recess adds to a slipper's distance [m], which strains the films steadily.
    """
    structure, force = problem.structure, problem.force(problem.action)
    film = problem.values[:, Value.SLIPPER_SWASH_STIFFNESS]
    strained = (problem.excitation * film * recess)[:, None] * structure.slipper_vector
    force = torch.cat([force[:, :1] - strained[:, None], force[:, 1:]], dim=1)
    force = held_down(pump, problem, force)
    return HarmonicBalance().steady_state(structure.mass, problem.damping, problem.stiffness, frequency, force)


def coupling_of(
    pump: Pump, condition: OperatingCondition, fault: Fault | None, topology: Topology, contact: SlipperContact
) -> Coupling | None:
    """What couples the orders of such a twin; None where nothing does.

    Raises
    ------
    InputError
        Two things would; they cannot be solved for together.
    """
    if not turning_terms(fault, pump, torch.tensor(pump.interfaces.values(), dtype=torch.float64)):
        return None if contact.linear else SlippersApart(pump, topology, contact, condition, fault)
    if not contact.linear:
        raise InputError(
            f"a {type(fault).__name__} turns with the shaft, and slippers that differ or lift off are solved for with "
            "a core that does not; leave out SlipperContact (--one-sided, --unloaded), or take another fault."
        )
    return TurningFace(pump, fault)
