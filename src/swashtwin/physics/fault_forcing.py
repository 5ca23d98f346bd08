"""Forces of a fault on the 13 degrees of freedom, line by line.

Displacements in `excitation` become forces through the interfaces that they strain, so these forces
depend on the interface values; the pressures' forces (`loads`) do not. Equations:
docs/explanation/physics.md, sections 2.4, 2.5 and 5.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.physics.dynamics import N_DOF, Dof, Structure, cast_like, off_axis_vector
from swashtwin.physics.excitation import (
    bore_lines,
    canonical_recess,
    displacement_lines,
    find_recess,
    followed_share,
)
from swashtwin.physics.lost_contact import riding_lines
from swashtwin.physics.periodic import PeriodicTerm
from swashtwin.pump import (
    BoreDefect,
    Fault,
    Interface,
    Interfaces,
    OperatingCondition,
    Pump,
    TiltedBlockFace,
    ValvePlateWear,
)
from swashtwin.pump import InterfaceValue as Value

Frequency: TypeAlias = Float[np.ndarray, " line"]
Lines: TypeAlias = Complex[np.ndarray, " line"]


def excitation_lines(
    pump: Pump, condition: OperatingCondition, fault: Fault | None, n_lines: int
) -> Lines:
    """Return lines 0...`n_lines` of a fault's displacement [m], with zero for the mean."""
    return np.concatenate([[0.0], motion_lines(fault, pump, condition, n_lines)])


@singledispatch
def motion_lines(
    fault: Fault | None, pump: Pump, condition: OperatingCondition, n_lines: int
) -> Lines:
    """Lines 1...`n_lines` of a fault's displacement [m], which `fault_action` takes.

    Unless registered otherwise, those of its recess (`find_recess`), or zero.
    """
    recess = find_recess(fault)
    if recess is None:
        return np.zeros(n_lines, dtype=complex)
    if recess.contact == "lift_off":
        return riding_lines(pump, condition, canonical_recess(recess), n_lines)
    return displacement_lines(pump, condition, recess, n_lines)


@motion_lines.register(BoreDefect)
def _(fault: BoreDefect, pump: Pump, condition: OperatingCondition, n_lines: int) -> Lines:
    return bore_lines(pump, fault, n_lines)


UNCHANGED = Interfaces.from_values([1.0] * 6)
"""Factors of a fault that leaves all films unchanged."""


@singledispatch
def interface_factors(fault: Fault | None, pump: Pump) -> Interfaces:
    """Factors of a fault on the six interface values; `UNCHANGED`, unless registered otherwise."""
    return UNCHANGED


@interface_factors.register(ValvePlateWear)
def _(fault: ValvePlateWear, pump: Pump) -> Interfaces:
    """A thicker film is softer: K_v with (h0 / h)^exponent, C_v with the cube."""
    ratio = pump.valve_plate.film / (pump.valve_plate.film + fault.film_increase)
    return replace(
        UNCHANGED,
        block_valve=Interface(damping=ratio**3, stiffness=ratio**fault.stiffness_exponent),
    )


def wear_factors(pump: Pump, fault: Fault | None) -> Float[np.ndarray, " 6"]:
    """Factors of a fault on the interface values, in the order of `pump.PARAMETERS`."""
    return np.array(interface_factors(fault, pump).values())


def worn_values(
    pump: Pump, fault: Fault | None, values: Float[Tensor, "*batch 6"]
) -> Float[Tensor, "*batch 6"]:
    """Interface values as a fault leaves them."""
    return values * torch.as_tensor(wear_factors(pump, fault)).to(values)


@dataclass(frozen=True, eq=False)
class FaultAction:
    """How a fault acts at any interface values, on one twin or on a batch.

    Force lines = (K_sw X + C_sw V) film + (K_Hz X + C_Hz V) bore + direct g0, where X is the
    displacement, V its rate, and g0 the slippers' mean normal approach. Interface values multiply
    complex lines as real numbers only, which gives the same bits in any batch.
    """

    motion: Complex[Tensor, "*batch line"]
    """Lines X of the displacement [m]."""
    rate: Complex[Tensor, "*batch line"]
    """Lines V of its rate [m/s]."""
    film: Float[Tensor, "*batch 13"]
    """Along which the slippers' films act when the displacement strains them."""
    bore: Float[Tensor, "*batch 13"]
    """Along which the pistons' films in the bores do."""
    direct: Complex[Tensor, "*batch line"]
    """Lines of a force along g0 that no interface value changes [N]."""
    strains: bool = False
    """Whether `film` or `bore` is anything but zero."""
    pushes: bool = False
    """Whether `direct` is."""

    def forces(
        self,
        values: Float[Tensor, "*rows 6"],
        slipper_vector: Float[Tensor, " 13"],
        gain: Float[Tensor, "*rows"],
    ) -> Complex[Tensor, "*fault line 13"]:
        """Return the force lines [N, N m] at the frequencies of the displacement, times `gain`."""
        direct = self.direct * gain[..., None] if self.pushes else self.direct
        force = direct[..., None] * slipper_vector
        if not self.strains:
            return force

        scaled_values = (values * gain[..., None])[..., None]
        for vector, damping, stiffness in (
            (self.film, Value.SLIPPER_SWASH_DAMPING, Value.SLIPPER_SWASH_STIFFNESS),
            (self.bore, Value.PISTON_BORE_DAMPING, Value.PISTON_BORE_STIFFNESS),
        ):
            film_force = (
                scaled_values[..., stiffness, :] * self.motion
                + scaled_values[..., damping, :] * self.rate
            )
            force = force + film_force[..., None] * vector[..., None, :]
        return force

    def mapped(self, function: Callable[[Tensor], Tensor]) -> "FaultAction":
        """Return the action with `function` applied to each of its tensors."""
        return replace(
            self,
            motion=function(self.motion),
            rate=function(self.rate),
            film=function(self.film),
            bore=function(self.bore),
            direct=function(self.direct),
        )


@singledispatch
def fault_action(
    fault: Fault | None,
    pump: Pump,
    structure: Structure,
    topology: str,
    frequency: Frequency,
    lines: Lines,
) -> FaultAction:
    """Return the action of a fault with displacement `lines` at `frequency` [rad/s], float64.

    Unless registered otherwise, that of its recess (`find_recess`), or none.
    """
    recess = find_recess(fault)
    idle = no_action(structure, frequency, lines)
    if recess is None:
        return idle

    slipper = structure.slipper_vector
    share = 1 / pump.rotating_group.piston_count
    tilt = math.cos(pump.rotating_group.swash_angle)

    # Films that cannot pull: only the inertia of piston and slipper resists the displacement.
    if not recess.strains_films:
        inertia = (
            pump.masses.piston_slipper
            / tilt
            * frequency**2
            * followed_share(recess, frequency / (2 * np.pi))
        )
        direct = torch.as_tensor(recess.gain * inertia) * idle.motion
        return replace(idle, direct=direct, pushes=True)

    factor = recess.gain * (share if recess.contact == "shared" else 1.0)
    if not recess.off_axis:
        return replace(idle, film=-factor * slipper, strains=True)

    arm = torch.as_tensor(off_axis_vector(pump, topology, recess.angle))
    if topology == "T2":
        return replace(idle, film=-factor * (slipper + arm), strains=True)
    return replace(
        idle, film=-factor * slipper, bore=recess.gain * share / tilt * arm, strains=True
    )


def no_action(structure: Structure, frequency: Frequency, lines: Lines) -> FaultAction:
    """Return the displacement `lines` at `frequency` [rad/s] without any force.

    `replace` adds what they strain or push.
    """
    motion = torch.as_tensor(lines)
    zero = torch.zeros_like(structure.slipper_vector)
    return FaultAction(
        motion,
        rate=torch.as_tensor(1j * frequency * lines),
        film=zero,
        bore=zero,
        direct=torch.zeros_like(motion),
    )


@fault_action.register(BoreDefect)
def _(
    fault: BoreDefect,
    pump: Pump,
    structure: Structure,
    topology: str,
    frequency: Frequency,
    lines: Lines,
) -> FaultAction:
    share = 1 / pump.rotating_group.piston_count
    bore = pump.coupling.lateral_ratio * share * structure.lateral_vector
    return replace(no_action(structure, frequency, lines), bore=bore, strains=True)


def fault_forces(
    pump: Pump,
    structure: Structure,
    topology: str,
    fault: Fault | None,
    values: Float[Tensor, "*batch 6"],
    frequency: Frequency,
    lines: Lines,
) -> Complex[Tensor, "*fault line 13"]:
    """Return the force lines [N, N m] of a fault with displacement `lines` at a `frequency`."""
    action = fault_action(fault, pump, structure, topology, frequency, lines)
    action = action.mapped(lambda part: cast_like(part, values))
    slipper_vector = cast_like(structure.slipper_vector, values)
    return action.forces(values, slipper_vector, values.new_ones(values.shape[:-1]))


@singledispatch
def turning_terms(
    fault: Fault | None, pump: Pump, values: Float[Tensor, "*batch 6"]
) -> list[PeriodicTerm]:
    """Return the parts of K that a fault lets turn with the shaft: by default none.

    A new fault with such parts registers a function here.
    """
    return []


@turning_terms.register(TiltedBlockFace)
def _(fault: TiltedBlockFace, pump: Pump, values: Float[Tensor, "*batch 6"]) -> list[PeriodicTerm]:
    axial, tilt = values.new_zeros(2, N_DOF, dtype=values.dtype.to_complex())
    axial[Dof.ROTOR_Z] = 1
    axial[Dof.SHELL_Z] = -1
    # Re((a + i b) exp(i w t)) = a cos w t - b sin w t (docs/explanation/physics.md, section 5).
    tilt[Dof.ROTOR_TILT_X] = 1
    tilt[Dof.SHELL_TILT_X] = -1
    tilt[Dof.ROTOR_TILT_Y] = 1j
    tilt[Dof.SHELL_TILT_Y] = -1j
    pair = torch.outer(axial, tilt) + torch.outer(tilt, axial)

    stiffness = values[..., Value.BLOCK_VALVE_STIFFNESS, None, None]
    scale = stiffness * fault.variation * pump.valve_plate.film_radius / 2
    return [PeriodicTerm(1, scale * pair)]


NEGLIGIBLE_SHARE = 1e-7
"""Line over the largest one below which it is rounding: the pressures of equal pistons leave it."""


def active_orders(
    pressure: Complex[np.ndarray, "line 13"], lines: Complex[np.ndarray, " line"]
) -> Int[np.ndarray, " active"]:
    """Return the orders from 1 that pressures or a fault excite.

    A pump with equal pistons and a swash plate defect responds only at multiples of the piston
    count (and at 1, from unbalance); without the others a steady state is several times cheaper.
    """
    load = np.abs(pressure[1:]).max(axis=1)
    motion = np.abs(lines[1:])
    is_active = (load > NEGLIGIBLE_SHARE * load.max()) | (motion > NEGLIGIBLE_SHARE * motion.max())
    return 1 + np.flatnonzero(is_active)
