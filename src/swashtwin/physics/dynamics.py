"""The 13 degrees of freedom: M, C and K, affine in the six interface values.

Three rigid bodies, after the paper (DOI 10.1177/00202940261419020); the equations are our own
derivation (docs/explanation/physics.md, section 2), for the paper's are not public as text. Degrees
of freedom, in this order::

    x_F y_F z_F a_F b_F | x_C y_C z_C a_C b_C | x_P y_P z_P

F is the shell, C the rotor, P the retainer; a and b are small rotations about x and y. z runs along
the shaft from the swash plate toward the valve plate, and y in the direction in which the swash
plate rises. The retainer is kept parallel to the swash plate (it takes the shell's rotations),
which keeps every interface blind to rigid motion.

Each spring-damper between two bodies is a coefficient vector g with the energy 1/2 k (g . q)^2: it
enters K as k g g^T. Because the pistons are equal and equally spaced, their sum does not depend on
the shaft angle: K and C are constant.
"""

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import lru_cache
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.pump import InterfaceValue as Value
from swashtwin.pump import Pump


class Dof(IntEnum):
    """Index of each degree of freedom; tilts are the rotations about x and y."""

    SHELL_X = 0
    SHELL_Y = 1
    SHELL_Z = 2
    SHELL_TILT_X = 3
    SHELL_TILT_Y = 4
    ROTOR_X = 5
    ROTOR_Y = 6
    ROTOR_Z = 7
    ROTOR_TILT_X = 8
    ROTOR_TILT_Y = 9
    RETAINER_X = 10
    RETAINER_Y = 11
    RETAINER_Z = 12


N_DOF = len(Dof)
SHELL = slice(Dof.SHELL_X, Dof.SHELL_TILT_Y + 1)
"""Degrees of freedom of the shell, which the sensors sit on."""

Topology = Literal["T1", "T2"]
"""T1 (default): slippers move with the retainer: swash plate, retainer and rotor are in series.

T2: slippers are rigid with the rotor."""

_AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class Structure:
    """Constant matrices of one pump, from which K and C follow for any interface values."""

    mass: Float[Tensor, "13 13"]
    """Masses and inertias [kg, kg m^2]."""
    interface_shapes: Float[Tensor, "3 13 13"]
    """Outer products of the slipper-swash, block-valve and piston-bore interfaces; times a
    stiffness, part of K.
    """
    mount_stiffness: Float[Tensor, "13 13"]
    """Stiffness of the mounting [N/m]."""
    bearing_stiffness: Float[Tensor, "13 13"]
    """Stiffness of the bearings [N/m]."""
    support_parts: Float[Tensor, "7 13 13"]
    """Parts of the stiffness of mounting (along x, y, z, and in tilt) and bearings (first, second,
    and all further ones, the axial one included) [N/m].
    """
    spring_stiffness: Float[Tensor, "13 13"]
    """Stiffness of the central spring [N/m]."""
    fixed_damping: Float[Tensor, "13 13"]
    """Damping of mounting and bearings [N s/m]."""
    damping_parts: Float[Tensor, "7 13 13"]
    """Parts of that damping, in the order of `support_parts` [N s/m]."""
    slipper_vector: Float[Tensor, " 13"]
    """Coefficients g0 of the slippers' mean normal approach to the swash plate; forces of a defect
    act along it.
    """
    lateral_vector: Float[Tensor, " 13"]
    """Coefficients of the pistons' lateral displacement in the bores along y; forces of a bore
    defect act along it.
    """
    sensor_rows: Float[Tensor, "sensor 13"]
    """Acceleration read by each sensor per acceleration of each coordinate."""

    def stiffness(
        self,
        values: Float[Tensor, "*batch 6"],
        mount: Float[Tensor, "*#batch"] | float = 1.0,
        bearing: Float[Tensor, "*#batch"] | float = 1.0,
        parts: Float[Tensor, "*#batch 7"] | None = None,
    ) -> Float[Tensor, "*batch 13 13"]:
        """Return K [N/m] for interface `values` in the order of `pump.PARAMETERS`.

        Parameters
        ----------
        mount, bearing : factors on the stiffness of mounting and bearings in the pump file.
        parts : further factors on each of `support_parts`; None is 1.
        """
        stiffness = (
            self._interfaces(values[..., Value.SLIPPER_SWASH_STIFFNESS :: 2])
            + _column(mount) * self.mount_stiffness
            + _column(bearing) * self.bearing_stiffness
            + self.spring_stiffness
        )
        if parts is None:
            return stiffness

        # Added as changes, so that factors of 1 leave the bits of the sum above.
        mounts, bearings = (parts - 1)[..., None, None].split((4, 3), dim=-3)
        mounting = _column(mount) * (mounts * self.support_parts[:4]).sum(dim=-3)
        return (
            stiffness
            + mounting
            + _column(bearing) * (bearings * self.support_parts[4:]).sum(dim=-3)
        )

    def damping(
        self,
        values: Float[Tensor, "*batch 6"],
        mount: Float[Tensor, "*#batch"] | float = 1.0,
        bearing: Float[Tensor, "*#batch"] | float = 1.0,
        parts: Float[Tensor, "*#batch 7"] | None = None,
    ) -> Float[Tensor, "*batch 13 13"]:
        """Return C [N s/m] for interface `values` in the order of `pump.PARAMETERS`.

        The damping of mounting and bearings follows their stiffness as in the pump file: at the
        mounting's damping ratio with the root of its stiffness, at the bearings' damping time in
        proportion to theirs.

        Parameters
        ----------
        mount, bearing, parts : factors on the stiffness; see `stiffness`. None for `parts` leaves
            the damping as in the pump file.
        """
        damping = (
            self._interfaces(values[..., Value.SLIPPER_SWASH_DAMPING :: 2]) + self.fixed_damping
        )
        if parts is None:
            return damping

        # Added as changes, so that factors of 1 leave the bits of the sum above.
        mounts, bearings = parts.split((4, 3), dim=-1)
        mount_changes = (_row(mount) * mounts).sqrt() - 1
        bearing_changes = _row(bearing) * bearings - 1
        return (
            damping
            + (mount_changes[..., None, None] * self.damping_parts[:4]).sum(dim=-3)
            + (bearing_changes[..., None, None] * self.damping_parts[4:]).sum(dim=-3)
        )

    def _interfaces(self, factors: Tensor) -> Tensor:
        """Return the sum of the interfaces' shapes, each times its factor."""
        # Unlike a matrix product, this sum has the same bits in any batch.
        return (factors[..., None, None] * self.interface_shapes).sum(dim=-3)

    def to(self, device: torch.device | str, dtype: torch.dtype) -> "Structure":
        """Return the matrices on `device` in `dtype`, or this object if they already are."""
        if self.mass.device == torch.device(device) and self.mass.dtype == dtype:
            return self
        return Structure(
            **{matrix.name: getattr(self, matrix.name).to(device, dtype) for matrix in fields(self)}
        )


def _column(factor: Tensor | float) -> Tensor | float:
    """Return a factor of each of the batch in the shape in which it multiplies matrices."""
    return factor[..., None, None] if isinstance(factor, Tensor) else factor


def _row(factor: Tensor | float) -> Tensor | float:
    """Return a factor of each of the batch in the shape in which it multiplies rows."""
    return factor[..., None] if isinstance(factor, Tensor) else factor


def cast_like(
    tensor: Shaped[Tensor, "*shape"], like: Float[Tensor, "..."]
) -> Shaped[Tensor, "*shape"]:
    """Return `tensor`, real or complex, on the device and in the precision of `like`."""
    dtype = like.dtype.to_complex() if tensor.is_complex() else like.dtype
    return tensor.to(like.device, dtype)


def displacement_rows(
    pump: Pump, body: str, point: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "3 13"]:
    """Return the displacement of a point of a body per unit of each coordinate.

    Parameters
    ----------
    body : ``"F"``, ``"C"`` or ``"P"``.
    point : position of the point [m].
    """
    first = {"F": Dof.SHELL_X, "C": Dof.ROTOR_X, "P": Dof.RETAINER_X}[body]
    center = {"F": pump.positions.shell, "C": pump.positions.rotor, "P": 0.0}[body]
    # The retainer turns with the swash plate: a retainer without rotation would be an inertial
    # anchor, and damp the rocking mode five times too much.
    rotation = Dof.ROTOR_TILT_X if body == "C" else Dof.SHELL_TILT_X

    x, y = point[:2]
    z = point[2] - center
    rows = np.zeros((3, N_DOF))
    rows[:, first : first + 3] = np.eye(3)
    rows[:, rotation] += (0.0, -z, y)
    rows[:, rotation + 1] += (z, 0.0, -x)
    return rows


def _between(
    pump: Pump, direction: np.ndarray, body: str, opposite: str | None, point: np.ndarray
) -> Float[np.ndarray, " 13"]:
    """Return the displacement of `body` at a point against `opposite`; None is the ground."""
    row = direction @ displacement_rows(pump, body, point)
    if opposite is None:
        return row
    return row - direction @ displacement_rows(pump, opposite, point)


def piston_points(pump: Pump, angle: float = 0.0) -> Float[np.ndarray, "piston 3"]:
    """Return the slipper centers on the swash plane [m].

    Parameters
    ----------
    angle : shaft angle of piston 0 past top dead center [rad].
    """
    group = pump.rotating_group
    phi = angle + 2 * np.pi * np.arange(group.piston_count) / group.piston_count
    radius = group.pitch_radius
    slope = math.tan(group.swash_angle)
    return np.stack(
        [radius * np.sin(phi), radius * np.cos(phi), radius * slope * np.cos(phi)], axis=1
    )


def swash_normal(pump: Pump) -> Float[np.ndarray, " 3"]:
    """Return the unit normal of the swash plate, toward the pistons."""
    angle = pump.rotating_group.swash_angle
    return np.array([0.0, -math.sin(angle), math.cos(angle)])


def slipper_swash_shape(
    pump: Pump, topology: str, angle: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the outer-product matrix and the mean vector of the slippers' normal contact.

    Of shapes (13, 13) and (13,).
    """
    body = "P" if topology == "T1" else "C"
    rows = [
        _between(pump, swash_normal(pump), body, "F", point) for point in piston_points(pump, angle)
    ]
    stacked = np.array(rows)
    return stacked.T @ stacked / len(rows), stacked.mean(axis=0)


def block_valve_shape(pump: Pump) -> np.ndarray:
    """Return the outer-product matrix (13, 13) of the valve plate film, a ring of axial springs."""
    axial = _between(pump, _AXES[2], "C", "F", np.array([0.0, 0.0, pump.positions.valve_plate]))
    shape = np.outer(axial, axial)
    for rotor, shell in (
        (Dof.ROTOR_TILT_X, Dof.SHELL_TILT_X),
        (Dof.ROTOR_TILT_Y, Dof.SHELL_TILT_Y),
    ):
        tilt = np.zeros(N_DOF)
        tilt[rotor] = 1.0
        tilt[shell] = -1.0
        shape += pump.valve_plate.film_radius**2 / 2 * np.outer(tilt, tilt)
    return shape


def piston_bore_shape(pump: Pump, angle: float = 0.0) -> np.ndarray:
    """Return the outer-product matrix (13, 13) of the pistons in their bores.

    Axial at each piston, and lateral in the mean.
    """
    points = piston_points(pump, angle)
    rows = [_between(pump, _AXES[2], "P", "C", point) for point in points]
    shape = np.transpose(rows) @ np.array(rows) / len(rows)
    for axis in (0, 1):
        row = _between(pump, _AXES[axis], "P", "C", np.zeros(3))
        shape = shape + pump.coupling.lateral_ratio * np.outer(row, row)
    return shape


def _mount(pump: Pump) -> tuple[np.ndarray, np.ndarray]:
    """Return the mounting's parts of stiffness and of damping, (4, 13, 13) each.

    The parts act along x, y and z, and in tilt.
    """
    mount = pump.mount
    masses = pump.masses
    total = masses.shell + masses.rotor + masses.retainer
    arm = pump.positions.mount - pump.positions.shell
    inertia = masses.shell_inertia + masses.shell * arm**2

    parts = np.zeros((4, N_DOF, N_DOF))
    damping = np.zeros((4, N_DOF, N_DOF))
    point = np.array([0.0, 0.0, pump.positions.mount])
    stiffnesses = (mount.stiffness_x, mount.stiffness_y, mount.stiffness_z)
    for index, (axis, value) in enumerate(zip(_AXES, stiffnesses, strict=True)):
        row = _between(pump, axis, "F", None, point)
        parts[index] += value * np.outer(row, row)
        damping[index] += 2 * mount.damping_ratio * math.sqrt(value * total) * np.outer(row, row)

    for rotation in (Dof.SHELL_TILT_X, Dof.SHELL_TILT_Y):
        parts[3, rotation, rotation] += mount.stiffness_tilt
        damping[3, rotation, rotation] += (
            2 * mount.damping_ratio * math.sqrt(mount.stiffness_tilt * inertia)
        )
    return parts, damping


def _bearings(pump: Pump) -> np.ndarray:
    """Return the stiffness parts (3, 13, 13) of the first, second and all further bearings.

    The axial stiffness belongs to the last part.
    """
    bearings = pump.bearings
    parts = np.zeros((3, N_DOF, N_DOF))
    for index, (position, value) in enumerate(
        zip(bearings.positions, bearings.stiffnesses, strict=True)
    ):
        for axis in (0, 1):
            row = _between(pump, _AXES[axis], "C", "F", np.array([0.0, 0.0, position]))
            parts[min(index, 2)] += value * np.outer(row, row)
    row = _between(pump, _AXES[2], "C", "F", np.array([0.0, 0.0, bearings.positions[-1]]))
    parts[2] += bearings.axial_stiffness * np.outer(row, row)
    return parts


@lru_cache(maxsize=64)
def assemble(pump: Pump, topology: str = "T1") -> Structure:
    """Return the structure of `pump` in float64.

    Equal pumps get the same object, so its matrices must not be written to.

    Parameters
    ----------
    topology : see `Topology`.
    """
    if topology not in ("T1", "T2"):
        raise InputError(f"Invalid topology {topology!r}: must be 'T1' or 'T2'.")

    masses = pump.masses
    diagonal = (
        [masses.shell] * 3
        + [masses.shell_inertia] * 2
        + [masses.rotor] * 3
        + [masses.rotor_inertia] * 2
    )
    slipper_shape, slipper_vector = slipper_swash_shape(pump, topology)
    mounts, mount_damping = _mount(pump)
    bearings = _bearings(pump)
    mount_stiffness = mounts.sum(axis=0)
    bearing_stiffness = bearings.sum(axis=0)
    spring = _between(pump, _AXES[2], "P", "C", np.zeros(3))
    rows = [
        np.array(sensor.direction) @ displacement_rows(pump, "F", np.array(sensor.position))
        for sensor in pump.sensors
    ]

    def tensor(array: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float64)

    return Structure(
        mass=tensor(np.diag(diagonal + [masses.retainer] * 3)),
        interface_shapes=tensor(
            np.stack([slipper_shape, block_valve_shape(pump), piston_bore_shape(pump)])
        ),
        mount_stiffness=tensor(mount_stiffness),
        bearing_stiffness=tensor(bearing_stiffness),
        support_parts=tensor(np.concatenate([mounts, bearings])),
        spring_stiffness=tensor(pump.coupling.spring_stiffness * np.outer(spring, spring)),
        fixed_damping=tensor(
            mount_damping.sum(axis=0) + pump.bearings.damping_time * bearing_stiffness
        ),
        damping_parts=tensor(
            np.concatenate([mount_damping, pump.bearings.damping_time * bearings])
        ),
        slipper_vector=tensor(slipper_vector),
        lateral_vector=tensor(_between(pump, _AXES[1], "P", "C", np.zeros(3))),
        sensor_rows=tensor(np.stack(rows)),
    )


def off_axis_vector(pump: Pump, topology: str, angle: float) -> Float[np.ndarray, " 13"]:
    """Return the coefficients of the moment by which one slipper's load differs from the mean's.

    T1: the axial piston-bore element at the defect, less its mean. T2: the slipper's contact there,
    less its mean.

    Parameters
    ----------
    angle : shaft angle of the slipper [rad].
    """
    group = pump.rotating_group
    slope = math.tan(group.swash_angle)
    point = np.array([math.sin(angle), math.cos(angle), slope * math.cos(angle)])
    point = group.pitch_radius * point
    if topology == "T1":
        mean = _between(pump, _AXES[2], "P", "C", np.zeros(3))
        return _between(pump, _AXES[2], "P", "C", point) - mean

    mean = slipper_swash_shape(pump, topology)[1]
    return _between(pump, swash_normal(pump), "C", "F", point) - mean
