"""Whether slippers stay on the swash plate: what their films carry, and a sentence where a linear twin pulls at them.

Slipper j leaves the swash plate by d_j = c_j(theta) . (R q). Where slippers ride on the retainer (topology T1), R is a
row, the same for all; where they turn with the rotor (T2), R has three, the mean and two tilts, and c_j is (1, cos
phi_j, sin phi_j). A recess adds share H_j to d_j, share being 1 for ``contact="shared"`` and the piston count for
``"literal"``. Of a ``"physical"`` or ``"lift_off"`` recess nothing is left here: it strains no film.

What holds the slippers down is the mean force. A piston slides in its bore: it carries no steady axial force, where the
linear model's K_Hz would. The slippers carry all of it (topology T1: the sum of the pistons' forces over the cosine of
the swash angle) and the central spring's preload. In topology T2 the films of valve plate and slippers share the mean
as springs do.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.physics.dynamics import N_DOF, Dof, Structure, displacement_rows, swash_normal
from swashtwin.physics.excitation import displacement_lines, recess_of, stages
from swashtwin.pump import Fault, OperatingCondition, Pump
from swashtwin.pump import InterfaceValue as Value
from swashtwin.signals import periodic_signal


@dataclass(frozen=True)
class ContactCheck:
    """What a film would have to do for the linear twin to be right."""

    lowest: float
    """Lowest force of a slipper [N]; below zero its film pulls."""
    pulling: float
    """Share of the revolution during which at least one film pulls [1]."""
    hold_down: float
    """Mean force of all slippers together [N]."""

    @property
    def within_range(self) -> bool:
        """Whether no film has to pull."""
        return self.lowest >= 0

    def sentence(self) -> str:
        """What there is to say about it."""
        numbers = f"(lowest contact force {self.lowest / 1e3:.3g} kN, mean hold-down {self.hold_down / 1e3:.3g} kN)"
        if self.within_range:
            return f"the slippers' films push throughout the revolution {numbers}: within the linear model's range"
        return (
            f"the linear twin pulls at its slippers during {self.pulling:.0%} of the revolution {numbers}: results lie "
            "outside the linear model's range; slippers of contact=lift_off may leave the plate"
        )


def check_contact(forces: Float[np.ndarray, "piston angle"]) -> ContactCheck:
    """What `slipper_forces` say."""
    return ContactCheck(
        lowest=float(forces.min()),
        pulling=float(np.mean((forces < 0).any(axis=0))),
        hold_down=float(forces.sum(axis=0).mean()),
    )


def distance_rows(pump: Pump, topology: str) -> Float[np.ndarray, "coordinate 13"]:
    """R: mean distance of the slippers from the swash plate and, in topology T2, their cosine and sine parts."""
    body = "P" if topology == "T1" else "C"
    radius, slope = pump.rotating_group.pitch_radius, math.tan(pump.rotating_group.swash_angle)

    def row(angle: float) -> np.ndarray:
        point = radius * np.array([math.sin(angle), math.cos(angle), slope * math.cos(angle)])
        return swash_normal(pump) @ (displacement_rows(pump, body, point) - displacement_rows(pump, "F", point))

    top, side, bottom, other = (row(quarter * math.pi / 2) for quarter in range(4))
    rows = np.stack([(top + bottom) / 2, (top - bottom) / 2, (side - other) / 2])
    return rows[:1] if topology == "T1" else rows


def slipper_lines(
    pump: Pump, condition: OperatingCondition, fault: Fault | None, n_lines: int
) -> Complex[np.ndarray, " line"]:
    """Lines 0...`n_lines` of what a recess adds to the distance of a slipper [m], over its piston's own angle."""
    lines, recess = np.zeros(n_lines + 1, dtype=complex), recess_of(fault)
    if recess is None or not recess.strains_films:
        return lines
    stage = stages(pump, recess)
    edges = stage.rise * (2 / math.pi if recess.edge == "half_sine" else 1 / 2)
    lines[0] = stage.depth * (stage.dwell / 2 + edges) / math.pi
    alone = np.eye(pump.rotating_group.piston_count)[0]
    lines[1:] = displacement_lines(pump, condition, recess, n_lines, scatter=alone)
    return lines * (recess.gain * (pump.rotating_group.piston_count if recess.contact == "literal" else 1.0))


def mean_motion(
    pump: Pump,
    structure: Structure,
    stiffness: Float[Tensor, "13 13"],
    values: Float[Tensor, " 6"],
    force: Float[Tensor, " 13"],
    strain: float,
) -> Float[Tensor, " 13"]:
    """Mean displacement [m, rad] of pistons that slide in their bores.

    Parameters
    ----------
    stiffness : K [N/m].
    force : mean force [N, N m].
    strain : mean of what a recess adds to a slipper's distance [m].
    """
    between = stiffness.new_zeros(N_DOF)  # elongation between retainer and cylinder block, per unit of each coordinate
    between[Dof.RETAINER_Z], between[Dof.ROTOR_Z] = 1.0, -1.0
    sliding = stiffness - values[Value.PISTON_BORE_STIFFNESS] * torch.outer(between, between)
    strained = values[Value.SLIPPER_SWASH_STIFFNESS] * strain * structure.slipper_vector
    return torch.linalg.solve(sliding, force - strained - pump.coupling.spring_preload * between)


def slipper_forces(
    pump: Pump,
    topology: str,
    speed: float,
    values: Float[Tensor, " 6"],
    motion: Complex[np.ndarray, "line 13"],
    recess: Complex[np.ndarray, " line"],
    samples: int,
) -> Float[np.ndarray, "piston angle"]:
    """Force [N] of each slipper's film at `samples` shaft angles of a revolution, positive where it pushes.

    Parameters
    ----------
    speed : shaft speed [rad/s].
    motion : displacement lines from order 0 [m, rad], the mean included: it is what holds the slippers down.
    recess : as many `slipper_lines` [m].
    samples : at least twice the lines. Film forces are computed in the band of the lines; a half-sine's velocity jumps,
        so they overshoot there, and a wider band shows higher peaks.
    """
    count, orders = pump.rotating_group.piston_count, np.arange(len(motion))
    angle = 2 * math.pi * np.arange(samples) / samples + 2 * math.pi * np.arange(count)[:, None] / count
    damping, stiffness = (float(values[i]) for i in (Value.SLIPPER_SWASH_DAMPING, Value.SLIPPER_SWASH_STIFFNESS))
    film = stiffness + 1j * speed * damping * orders
    coordinates = motion @ distance_rows(pump, topology).T
    ways = (np.ones_like(angle), np.cos(angle), np.sin(angle))
    strained = sum(
        way * periodic_signal(film * lines, samples) for way, lines in zip(ways, coordinates.T, strict=False)
    )
    turns = np.exp(2j * math.pi * orders * np.arange(count)[:, None] / count)
    return -(strained + np.stack([periodic_signal(row, samples) for row in film * recess * turns])) / count
