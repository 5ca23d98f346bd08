"""The slippers' films as springs and dampers between few coordinates of the pump.

Slipper j leaves the swash plate by d_j = c_j(theta) . (R q). Where slippers ride on the retainer (topology T1), R is a
row, the same for all; where they turn with the rotor (T2), R has three, the mean and two tilts, and c_j is (1, cos
phi_j, sin phi_j). The derivative of c_j is left out of d_j', as it is from the linear twin's constant matrices.

A recess adds share H_j to d_j, share being 1 for ``contact="shared"`` and the piston count for ``"literal"``: what one
slipper's displacement strains is then its own share of the total stiffness, or all of it. Of a ``"physical"`` or
``"lift_off"`` recess nothing is left here: it strains no film.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.physics.contacts.settings import SlipperContact, slipper_weight
from swashtwin.physics.dynamics import displacement_rows, swash_normal
from swashtwin.physics.excitation import displacement_lines
from swashtwin.physics.recess import Stages, recess_of, slipper_profile, stages
from swashtwin.pump import Fault, OperatingCondition, Pump, SwashPlateDefect


@dataclass(frozen=True, eq=False)
class Slippers:
    """Films of all slippers on a uniform grid of the shaft angle that starts at 0."""

    rows: Float[np.ndarray, "coordinate 13"]
    """R: coordinates of the swash plate's distance from the slippers, per unit of each degree of freedom."""
    directions: Float[np.ndarray, "step piston coordinate"]
    """c_j: distance of each slipper per unit of each coordinate."""
    weights: Float[np.ndarray, "step piston"]
    """Share of each slipper in K_sw and C_sw."""
    displacement: Float[np.ndarray, "step piston"]
    """What a recess adds to a slipper's distance [m]."""
    velocity: Float[np.ndarray, "step piston"]
    """Its rate [m/s], averaged over the two steps around (a hat): a half-sine's rate jumps."""


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


def film_share(pump: Pump, fault: Fault | None) -> float:
    """Factor from a slipper's displacement in a recess to the strain of its film; 0 for faults that strain none."""
    recess = recess_of(fault)
    if recess is None or not recess.strains_films:
        return 0.0
    return recess.gain * (pump.rotating_group.piston_count if recess.contact == "literal" else 1.0)


def slippers_on_grid(
    pump: Pump, topology: str, contact: SlipperContact, fault: Fault | None, speed: float, steps: int
) -> Slippers:
    """Films of the slippers of `pump` at `steps` shaft angles of a revolution at `speed` [rad/s]."""
    count = pump.rotating_group.piston_count
    around = 2 * math.pi * np.arange(count) / count
    angle = 2 * math.pi * np.arange(steps)[:, None] / steps + around
    rows = distance_rows(pump, topology)
    directions = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)[..., : len(rows)]
    displacement, velocity = np.zeros_like(angle), np.zeros_like(angle)
    share, recess = film_share(pump, fault), recess_of(fault)
    if recess is not None and share > 0:
        displacement = share * slipper_profile(pump, recess, angle)[0]
        velocity = share * speed * _mean_slope(pump, recess, angle, 2 * math.pi / steps)
    return Slippers(
        rows=rows,
        directions=np.ascontiguousarray(directions),
        weights=slipper_weight(pump, contact, angle) / count,
        displacement=displacement,
        velocity=velocity,
    )


def _mean_slope(pump: Pump, defect: SwashPlateDefect, angle: np.ndarray, width: float) -> np.ndarray:
    """Slope dH/dphi [m/rad] averaged with a hat that reaches `width` [rad] to either side."""
    stage = stages(pump, defect)
    offset = np.mod(angle - defect.angle + math.pi, 2 * math.pi) - math.pi
    areas = [_area(stage, defect.edge, offset + turned) for turned in (-width, 0.0, width)]
    return (areas[0] - 2 * areas[1] + areas[2]) / width**2


def _area(stage: Stages, edge: str, offset: np.ndarray) -> np.ndarray:
    """Integral of a slipper's displacement [m rad] from the middle of the recess to `offset` [rad]."""
    far = np.abs(offset)
    left = np.clip((stage.total / 2 - far) / stage.rise, 0.0, 1.0)
    if edge == "half_sine":
        edges = 2 / math.pi * np.cos(math.pi / 2 * left)
    else:
        edges = (1 - left) / 2 + np.sin(math.pi * left) / (2 * math.pi)
    return np.sign(offset) * stage.depth * (np.minimum(far, stage.dwell / 2) + stage.rise * edges)


def mean_displacement(pump: Pump, defect: SwashPlateDefect) -> float:
    """Mean of one slipper's displacement H_j [m] over a revolution."""
    stage = stages(pump, defect)
    return float(_area(stage, defect.edge, np.array([math.pi]))[0] / math.pi)


def slipper_lines(
    pump: Pump, condition: OperatingCondition, fault: Fault | None, n_lines: int
) -> Complex[np.ndarray, " line"]:
    """Lines 0...`n_lines` of what a recess adds to the distance of a slipper [m], over its piston's own angle."""
    lines = np.zeros(n_lines + 1, dtype=complex)
    share, recess = film_share(pump, fault), recess_of(fault)
    if recess is not None and share > 0:
        alone = np.eye(pump.rotating_group.piston_count)[0]
        lines[0] = share * mean_displacement(pump, recess)
        lines[1:] = share * displacement_lines(pump, condition, recess, n_lines, scatter=alone)
    return lines
