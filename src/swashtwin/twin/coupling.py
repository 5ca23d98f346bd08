"""What couples the shaft orders of a twin: parts of K and C that turn with the shaft, slippers that lift off."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.condition import OperatingCondition
from swashtwin.contacts import SlipperContact, periodic_films, slipper_steady_state
from swashtwin.dynamics import Structure, Topology
from swashtwin.errors import InputError
from swashtwin.faults import Fault, TiltedBlockFace
from swashtwin.forces import FaultAction, periodic_terms
from swashtwin.integrators import HarmonicBalance, SteadySolver, periodic_steady_state
from swashtwin.pump import Pump

MOST = 2000
"""Iterations for slippers that differ: they take much of the film with them, and the motion settles slowly."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Equations of motion of some rows of one twin, orders 0 and up."""

    structure: Structure
    """Constant matrices."""
    values: Float[Tensor, "row 6"]
    """Interface values, wear included."""
    scales: Float[Tensor, "row 4"]
    """Factors on mount, bearing, excitation and sensor."""
    pressure: Complex[Tensor, "1 line 13"]
    """Lines of the chamber pressures and of the unbalance [N, N m]."""
    action: FaultAction
    """How the fault acts."""
    speed: float
    """Speed of the shaft [rad/s]."""

    @property
    def stiffness(self) -> Float[Tensor, "row 13 13"]:
        """K of equal slippers [N/m]."""
        return self.structure.stiffness(self.values, self.scales[:, 0], self.scales[:, 1])

    @property
    def damping(self) -> Float[Tensor, "row 13 13"]:
        """C of equal slippers [N s/m]."""
        return self.structure.damping(self.values)

    def force(self, action: FaultAction) -> Complex[Tensor, "row line 13"]:
        """Lines of all forces where the fault acts by `action` [N, N m]."""
        forces = action.forces(self.values, self.structure.slipper_vector, self.scales[:, 2])
        return (self.pressure + forces).expand(len(self.values), -1, -1)


@runtime_checkable
class Coupling(Protocol):
    """What couples orders, and the motion it leads to."""

    def motion(self, problem: Problem, solver: SteadySolver) -> Complex[Tensor, "row line 13"]:
        """Displacement lines [m, rad], orders 0 and up."""
        ...


@dataclass(frozen=True)
class TurningFace:
    """A cylinder block's face out of square, whose film turns with the shaft."""

    pump: Pump
    fault: TiltedBlockFace

    def motion(self, problem: Problem, solver: SteadySolver) -> Complex[Tensor, "row line 13"]:
        """Displacement lines; see `Coupling`."""
        terms = periodic_terms(self.pump, self.fault, problem.values)
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
        rest = replace(problem.action, film=torch.zeros_like(problem.action.film))
        force = held_down(self.pump, problem, problem.force(rest))
        if not self.contact.one_sided:
            return self._turning(problem, force, solver)
        mount, bearing, excitation, _ = problem.scales.unbind(-1)
        return slipper_steady_state(
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
            excitation=excitation,
        )

    def _turning(self, problem: Problem, force: Tensor, solver: SteadySolver) -> Tensor:
        structure, values = problem.structure, problem.values
        n_lines = force.shape[1] - 1
        films = periodic_films(self.pump, self.topology, self.contact, self.condition, self.fault, values, n_lines)
        shape = films.mean_shape - structure.interface_shapes[0]
        damping = problem.damping + values[:, 0, None, None] * shape
        stiffness = problem.stiffness + values[:, 1, None, None] * shape
        loads = force + problem.scales[:, 2, None, None] * films.force
        return periodic_steady_state(
            solver, structure.mass, damping, stiffness, problem.speed, loads, films.terms, most=MOST
        )


def held_down(pump: Pump, problem: Problem, force: Complex[Tensor, "row line 13"]) -> Complex[Tensor, "row line 13"]:
    """`force`, lines from order 0, with the steady forces between retainer and cylinder block that springs cannot give.

    A piston slides in its bore: it carries no steady axial force, where the linear model's K_Hz would. The slippers
    then carry all of it (topology T1: the sum of the pistons' forces over the cosine of the swash angle) and the
    central spring's preload. Only the order 0 is touched.
    """
    between = problem.values.new_zeros(13)
    between[12], between[7] = 1.0, -1.0
    bore = problem.values[:, 5, None, None]
    sliding = problem.stiffness - bore * torch.outer(between, between)
    mean = force[:, 0].real - pump.coupling.spring_preload * between
    apart = torch.linalg.solve(sliding, mean) @ between
    steady = (bore[:, 0] * apart[:, None] - pump.coupling.spring_preload) * between
    return torch.cat([force[:, :1] + steady[:, None], force[:, 1:]], dim=1)


def linear_motion(pump: Pump, problem: Problem, frequency: Float[Tensor, " line"]) -> Complex[Tensor, "row line 13"]:
    """Displacement lines [m, rad] at `frequency` [rad/s], the first being 0, where nothing couples the orders."""
    force = held_down(pump, problem, problem.force(problem.action))
    structure = problem.structure
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
    if not isinstance(fault, TiltedBlockFace):
        return None if contact.linear else SlippersApart(pump, topology, contact, condition, fault)
    if not contact.linear:
        raise InputError(
            "a TiltedBlockFace turns with the shaft, and slippers that differ or lift off are solved for with a core "
            "that does not; leave contact as it is, or take another fault."
        )
    return TurningFace(pump, fault)
