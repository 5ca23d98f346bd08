"""Forces of a fault on the 13 degrees of freedom, line by line.

Displacements in `excitation` become forces through the interfaces that they strain, so these forces depend on the
interface values; the pressures' forces (`loads`) do not. Equations: docs/physics.md, sections 2.4, 2.5 and 5.
"""

import math

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.condition import OperatingCondition
from swashtwin.dynamics import Structure, off_axis_vector
from swashtwin.excitation import bore_lines, displacement_lines, film_scaling, impact_lines
from swashtwin.faults import BoreDefect, Fault, LooseSlipper, SwashPlateDefect, TiltedBlockFace
from swashtwin.integrators import PeriodicTerm
from swashtwin.pump import Pump

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
    elif isinstance(fault, LooseSlipper):
        lines[1:] = impact_lines(pump, condition, fault, n_lines)
    return lines


def worn_values(pump: Pump, fault: Fault | None, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 6"]:
    """Interface values once a worn valve plate's thicker film has softened them; the same for other faults."""
    film = film_scaling(pump, fault)
    factors = torch.ones(6, dtype=torch.float64)
    factors[2], factors[3] = film.damping, film.stiffness
    return values * factors


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
    share = 1 / pump.rotating_group.piston_count
    jw, motion = torch.as_tensor(1j * frequency), torch.as_tensor(lines)
    if isinstance(fault, SwashPlateDefect):
        if fault.contact == "physical":
            inertia = pump.masses.piston_slipper / math.cos(pump.rotating_group.swash_angle) * jw**2 * motion
            fade = torch.as_tensor(np.exp(-((frequency / (2 * np.pi * CONTACT_CUTOFF)) ** 2)))
            return -fault.gain * (inertia * fade)[:, None] * structure.slipper_vector
        return fault.gain * _contact_forces(pump, structure, topology, fault, values, jw, motion)
    if isinstance(fault, BoreDefect):
        bore = (values[..., 5, None] + jw * values[..., 4, None]) * motion
        return pump.coupling.lateral_ratio * share * bore[..., None] * structure.lateral_vector
    return -motion[:, None] * structure.slipper_vector  # impacts of a loose slipper; zero for every other fault


def _contact_forces(
    pump: Pump,
    structure: Structure,
    topology: str,
    fault: SwashPlateDefect,
    values: Tensor,
    jw: Tensor,
    motion: Tensor,
) -> Tensor:
    share = 1 / pump.rotating_group.piston_count
    taken = share if fault.contact == "shared" else 1.0
    film = (values[..., 1, None] + jw * values[..., 0, None]) * motion
    force = -taken * film[..., None] * structure.slipper_vector
    if not fault.off_axis:
        return force
    arm = torch.as_tensor(off_axis_vector(pump, topology, fault.angle))
    if topology == "T2":
        return force - taken * film[..., None] * arm
    bore = (values[..., 5, None] + jw * values[..., 4, None]) * motion / math.cos(pump.rotating_group.swash_angle)
    return force + share * bore[..., None] * arm


def periodic_terms(pump: Pump, fault: Fault | None, values: Float[Tensor, "*batch 6"]) -> list[PeriodicTerm]:
    """Parts of K that turn with the shaft; none but for a tilted block face."""
    if not isinstance(fault, TiltedBlockFace):
        return []
    axial, tilt_a, tilt_b = (torch.zeros(13, dtype=torch.complex128) for _ in range(3))
    axial[7], axial[2] = 1, -1
    tilt_a[8], tilt_a[3] = 1, -1
    tilt_b[9], tilt_b[4] = 1, -1
    tilt = tilt_a + 1j * tilt_b  # Re((a + i b) exp(i wt)) = a cos wt - b sin wt
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
