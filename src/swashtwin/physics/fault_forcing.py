"""Forces of a fault on the 13 degrees of freedom, line by line.

Displacements in `excitation` become forces through the interfaces that they strain, so these forces depend on the
interface values; the pressures' forces (`loads`) do not. Equations: docs/physics.md, sections 2.4, 2.5 and 5.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.physics.dynamics import Structure, moved, off_axis_vector
from swashtwin.physics.excitation import bore_lines, displacement_lines, film_scaling, impact_lines
from swashtwin.physics.solvers.periodic import PeriodicTerm
from swashtwin.pump import BoreDefect, Fault, LooseSlipper, OperatingCondition, Pump, SwashPlateDefect, TiltedBlockFace

CONTACT_CUTOFF = 4000.0
"""Frequency [Hz] above which a slipper's contact no longer follows a recess (``contact="physical"``); an estimate."""


def excitation_lines(
    pump: Pump, condition: OperatingCondition, fault: Fault | None, n_lines: int
) -> Complex[np.ndarray, " line"]:
    """Lines 0...`n_lines` of a fault's displacement [m] or impacts [N], zero where it has none; without the mean."""
    lines = np.zeros(n_lines + 1, dtype=complex)
    if isinstance(fault, SwashPlateDefect):
        lines[1:] = displacement_lines(pump, condition, fault, n_lines)
    elif isinstance(fault, BoreDefect):
        lines[1:] = bore_lines(pump, condition, fault, n_lines)
    elif isinstance(fault, LooseSlipper) and fault.motion == "pulses":
        lines[1:] = impact_lines(pump, condition, fault, n_lines)
    return lines


def wear_factors(pump: Pump, fault: Fault | None) -> Float[np.ndarray, " 6"]:
    """Factors on the interface values of a worn valve plate, whose thicker film is softer; 1 for any other fault."""
    film = film_scaling(pump, fault)
    return np.array([1.0, 1.0, film.damping, film.stiffness, 1.0, 1.0])


def worn_values(pump: Pump, fault: Fault | None, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 6"]:
    """Interface values once a worn valve plate's thicker film has softened them; the same for other faults."""
    return values * torch.as_tensor(wear_factors(pump, fault)).to(values)


@dataclass(frozen=True, eq=False)
class FaultAction:
    """How a fault acts at any interface values, on one twin or on a batch.

    Force lines = (K_sw X + C_sw V) film + (K_Hz X + C_Hz V) bore + direct g0, where X is the displacement, V its rate,
    and g0 the slippers' mean normal approach. Interface values multiply complex lines as real numbers only, which gives
    the same bits in any batch.
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
        """Force lines [N, N m] at the frequencies of the displacement's lines, times `gain`."""
        strained = (values * gain[..., None])[..., None]
        force = (self.direct * gain[..., None] if self.pushes else self.direct)[..., None] * slipper_vector
        if self.strains:
            for vector, damping, stiffness in ((self.film, 0, 1), (self.bore, 4, 5)):
                film = strained[..., stiffness, :] * self.motion + strained[..., damping, :] * self.rate
                force = force + film[..., None] * vector[..., None, :]
        return force

    def mapped(self, function: Callable[[Tensor], Tensor]) -> "FaultAction":
        """The same action with `function` applied to each of its tensors."""
        return replace(
            self,
            motion=function(self.motion),
            rate=function(self.rate),
            film=function(self.film),
            bore=function(self.bore),
            direct=function(self.direct),
        )


def fault_action(
    pump: Pump,
    structure: Structure,
    topology: str,
    fault: Fault | None,
    frequency: Float[np.ndarray, " line"],
    lines: Complex[np.ndarray, " line"],
) -> FaultAction:
    """Action of a fault whose displacement or impact `lines` are given at `frequency` [rad/s], float64."""
    slipper, motion = structure.slipper_vector, torch.as_tensor(lines)
    share, tilt = 1 / pump.rotating_group.piston_count, math.cos(pump.rotating_group.swash_angle)
    rate, nowhere = torch.as_tensor(1j * frequency * lines), torch.zeros_like(slipper)
    none = FaultAction(motion, rate, film=nowhere, bore=nowhere, direct=torch.zeros_like(motion))
    if isinstance(fault, LooseSlipper) and fault.motion == "pulses":
        return replace(none, direct=-motion, pushes=True)
    if isinstance(fault, BoreDefect):
        return replace(none, bore=pump.coupling.lateral_ratio * share * structure.lateral_vector, strains=True)
    if not isinstance(fault, SwashPlateDefect):
        return none
    if fault.contact == "physical":
        fade = np.exp(-((frequency / (2 * np.pi * CONTACT_CUTOFF)) ** 2))
        inertia = pump.masses.piston_slipper / tilt * frequency**2 * fade
        return replace(none, direct=torch.as_tensor(fault.gain * inertia) * motion, pushes=True)
    taken = fault.gain * (share if fault.contact == "shared" else 1.0)
    if not fault.off_axis:
        return replace(none, film=-taken * slipper, strains=True)
    arm = torch.as_tensor(off_axis_vector(pump, topology, fault.angle))
    if topology == "T2":
        return replace(none, film=-taken * (slipper + arm), strains=True)
    return replace(none, film=-taken * slipper, bore=fault.gain * share / tilt * arm, strains=True)


def fault_forces(
    pump: Pump,
    structure: Structure,
    topology: str,
    fault: Fault | None,
    values: Float[Tensor, "*batch 6"],
    frequency: Float[np.ndarray, " line"],
    lines: Complex[np.ndarray, " line"],
) -> Complex[Tensor, "*fault line 13"]:
    """Force lines [N, N m] of a fault whose displacement or impact `lines` are given at `frequency` [rad/s]."""
    action = fault_action(pump, structure, topology, fault, frequency, lines).mapped(lambda part: moved(part, values))
    return action.forces(values, moved(structure.slipper_vector, values), values.new_ones(values.shape[:-1]))


def periodic_terms(pump: Pump, fault: Fault | None, values: Float[Tensor, "*batch 6"]) -> list[PeriodicTerm]:
    """Parts of K that turn with the shaft; none but for a tilted block face."""
    if not isinstance(fault, TiltedBlockFace):
        return []
    axial, tilt = values.new_zeros(2, 13, dtype=values.dtype.to_complex())
    axial[7], axial[2] = 1, -1
    tilt[8], tilt[3], tilt[9], tilt[4] = 1, -1, 1j, -1j  # Re((a + i b) exp(i wt)) = a cos wt - b sin wt
    pair = torch.outer(axial, tilt) + torch.outer(tilt, axial)
    scale = values[..., 3, None, None] * fault.variation * pump.valve_plate.film_radius / 2
    return [PeriodicTerm(1, scale * pair)]


def active_orders(
    pressure: Complex[np.ndarray, "line 13"], lines: Complex[np.ndarray, " line"]
) -> Int[np.ndarray, " active"]:
    """Orders from 1 at which pressures or fault excite anything.

    A pump with equal pistons and a swash plate defect answers at multiples of the piston count only (and at 1, from
    unbalance); leaving the others out makes a steady state several times cheaper.
    """
    push, motion = np.abs(pressure[1:]).max(axis=1), np.abs(lines[1:])
    return 1 + np.flatnonzero((push > 1e-7 * push.max()) | (motion > 1e-7 * motion.max()))
