"""From what drives twins to what their accelerometers read: one path for a single twin and for a
batch.

All that no interface value changes is computed once, as a `Drive`; the rest is a few array
operations around one call of the solver. Rows are computed in chunks of bounded memory, each
independent of its neighbors.

A real housing bends from 1 to 2 kHz on, which rigid bodies cannot. Each mode m adds to channel c
what a light oscillator on the shell would: H_c(f) = g_c [1 + sum_m r_cm f^2 / (f_m^2 - f^2 + 2 i
zeta_m f_m f)]. A sensor also reads a share x_cd of what another channel d would: H_c multiplies a_c
+ sum_d x_cd a_d.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from operator import itemgetter

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from swashtwin.foundation import InputError
from swashtwin.physics.dynamics import N_DOF, SHELL, Structure, Topology, assemble, cast_like
from swashtwin.physics.fault_forcing import (
    FaultAction,
    active_orders,
    excitation_lines,
    fault_action,
    turning_terms,
    wear_factors,
)
from swashtwin.physics.loads import LoadCase, force_lines
from swashtwin.physics.lost_contact import contact_lines
from swashtwin.physics.periodic import PeriodicTerm, periodic_steady_state
from swashtwin.physics.steady import SteadySolver
from swashtwin.pump import PARAMETERS, Fault, OperatingCondition, Pump


@dataclass(frozen=True)
class Scales:
    """Factors on constants of the pump file that nobody measured."""

    mount: float = 1.0
    """On the mounting's stiffness."""
    bearing: float = 1.0
    """On the bearings' stiffness."""
    excitation: float = 1.0
    """On the forces of a fault."""
    sensor: float = 1.0
    """On what the sensors read."""
    mount_x: float = 1.0
    """On the mounting's stiffness along x, in addition to `mount`."""
    mount_y: float = 1.0
    """The same along y."""
    mount_z: float = 1.0
    """The same along z."""
    mount_tilt: float = 1.0
    """The same in tilt about x and y."""
    bearing_1: float = 1.0
    """On the stiffness of the first bearing, in addition to `bearing`."""
    bearing_2: float = 1.0
    """The same of the second."""
    bearing_3: float = 1.0
    """The same of all further ones, the axial one included."""

    def values(self) -> tuple[float, ...]:
        """Return the factors in the order of the fields."""
        return tuple(getattr(self, scale.name) for scale in fields(self))


UNSCALED = Scales()
"""All constants as the pump file says."""
SUPPORTS = slice(4, None)
"""Indices in `Scales` of the factors on the parts of mounting and bearings."""


@dataclass(frozen=True)
class SensorPath:
    """Gains of the channels and modes of the housing between the shell and them."""

    gain: tuple[float, ...]
    """Factor g_c of each channel."""
    frequency: tuple[float, ...] = ()
    """Natural frequency f_m of each mode [Hz]."""
    damping_ratio: tuple[float, ...] = ()
    """Damping ratio zeta_m of each mode."""
    residue: tuple[tuple[float, ...], ...] = ()
    """Share r_cm of each mode (inner) in each channel (outer)."""
    cross_talk: tuple[tuple[float, ...], ...] = ()
    """Share x_cd of each channel (inner) in each channel (outer), zero of a channel in itself;
    empty without crosstalk.
    """

    def __post_init__(self) -> None:
        n_modes = len(self.frequency)
        n_channels = len(self.gain)
        residue_counts = [len(row) for row in self.residue]
        has_residues = not n_modes or residue_counts == [n_modes] * n_channels
        if len(self.damping_ratio) != n_modes or not has_residues:
            raise InputError(
                f"a path of {n_modes} modes and {n_channels} channels needs as many damping ratios "
                "and a residue for each channel and mode."
            )

        if self.cross_talk and [len(row) for row in self.cross_talk] != [n_channels] * n_channels:
            raise InputError(
                f"cross_talk of a path of {n_channels} channels needs a share for each pair of "
                "channels."
            )
        if any(value <= 0 for value in (*self.gain, *self.frequency, *self.damping_ratio)):
            raise InputError(
                "gains, natural frequencies and damping ratios of a sensor path must be positive."
            )

    @property
    def mixing(self) -> Float[Tensor, "channel channel"]:
        """Share of each rigid, ideal sensor (column) in what each channel (row) reads."""
        unit = torch.eye(len(self.gain), dtype=torch.float64)
        if not self.cross_talk:
            return unit
        return unit + torch.tensor(self.cross_talk, dtype=torch.float64)

    def response(
        self, frequency: Float[Tensor, "*#batch line"]
    ) -> Complex[Tensor, "*#batch channel line"]:
        """H_c at `frequency` [Hz]."""
        gain, modes, damping = (
            torch.tensor(row, dtype=torch.float64, device=frequency.device)
            for row in (self.gain, self.frequency, self.damping_ratio)
        )
        residue = torch.tensor(
            self.residue or [[]] * len(self.gain), dtype=torch.float64, device=frequency.device
        )
        return path_response(frequency, gain, modes, damping, residue)


def path_response(
    frequency: Float[Tensor, "*#batch line"],
    gain: Float[Tensor, "*#batch channel"],
    modes: Float[Tensor, "*#batch mode"],
    damping_ratio: Float[Tensor, "*#batch mode"],
    residue: Float[Tensor, "*#batch channel mode"],
) -> Complex[Tensor, "*#batch channel line"]:
    """Return H_c at `frequency` [Hz], differentiable in every argument; see `SensorPath`."""
    f = frequency[..., None, :]
    mode = modes[..., :, None]
    mode_response = f**2 / torch.complex(mode**2 - f**2, 2 * damping_ratio[..., :, None] * mode * f)
    bending = residue.to(mode_response.dtype) @ mode_response
    return gain[..., None] * (1 + bending)


WORKSPACE = 64 * 2**20
"""Memory of a chunk [bytes], its gradient included; larger batches are split into chunks."""

# Bytes that one line of one row takes: a dozen complex vectors.
_LINE_BYTES = 12 * N_DOF * 16


@dataclass(frozen=True, eq=False)
class Drive:
    """What excites one twin, or a batch of twins of one pump: its first axis has one entry for all
    rows or one each.
    """

    structure: Structure
    """Constant matrices."""
    orders: Int[np.ndarray, " read"]
    """Shaft orders that are read."""
    frequency: Float[Tensor, "twin line"]
    """Angular frequency of the lines [rad/s]: those that are read, after order 0 where something is
    `turning`.
    """
    pressure: Complex[Tensor, "twin line 13"]
    """Lines of the chamber pressures and of the unbalance [N, N m]."""
    action: FaultAction
    """How the fault acts."""
    wear: Float[Tensor, "twin 6"]
    """Factors on the interface values."""
    turning: Callable[[Tensor], list[PeriodicTerm]] | None = None
    """Parts of K that turn with the shaft and so couple the orders, for interface values; then
    there is one twin only, and its lines begin with order 0.
    """
    path: Complex[Tensor, "twin sensor read"] | None = None
    """What stands between the shell and each sensor at the orders read; None is nothing."""

    @property
    def lines(self) -> Int[np.ndarray, " line"]:
        """Shaft orders of the lines that are solved."""
        if self.turning is None:
            return self.orders
        return np.concatenate([[0], self.orders])

    def to(self, like: Float[Tensor, "..."]) -> "Drive":
        """The same drive on the device and in the precision of `like`."""
        if self.wear.device == like.device and self.wear.dtype == like.dtype:
            return self
        there = self.mapped(lambda part: cast_like(part, like))
        return replace(there, structure=self.structure.to(like.device, like.dtype))

    def mapped(self, function: Callable[[Tensor], Tensor]) -> "Drive":
        """The same drive with `function` applied to each tensor that has an entry for each twin."""
        return replace(
            self,
            frequency=function(self.frequency),
            pressure=function(self.pressure),
            action=self.action.mapped(function),
            wear=function(self.wear),
            path=None if self.path is None else function(self.path),
        )


def drive_of(
    pump: Pump,
    condition: OperatingCondition,
    fault: Fault | None,
    topology: Topology,
    path: SensorPath | None,
    n_lines: int,
) -> Drive:
    """Return the drive of one twin up to order `n_lines`, float64."""
    structure = assemble(pump, topology)
    if path is not None and path.cross_talk:
        structure = replace(structure, sensor_rows=path.mixing @ structure.sensor_rows)

    pressure = force_lines(LoadCase(pump, condition, fault), n_lines, topology=topology)
    contact = contact_lines(fault, pump, condition, n_lines, topology)
    if contact is not None:
        pressure = pressure + contact
    motion = excitation_lines(pump, condition, fault, n_lines)

    # Parts that turn with the shaft couple the orders: then all are needed, with the mean.
    nominal_values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    turns = bool(turning_terms(fault, pump, nominal_values))
    if turns:
        orders = np.arange(1, n_lines + 1)
        lines = np.concatenate([[0], orders])
    else:
        orders = active_orders(pressure, motion)
        lines = orders

    frequency = lines * condition.speed
    action = fault_action(fault, pump, structure, topology, frequency, motion[lines])
    response = None
    if path is not None:
        response = path.response(torch.as_tensor(orders * condition.shaft_frequency))[None]
    return Drive(
        structure=structure,
        orders=orders,
        frequency=torch.as_tensor(frequency)[None],
        pressure=torch.as_tensor(pressure[lines])[None],
        action=action.mapped(lambda part: part[None]),
        wear=torch.as_tensor(wear_factors(pump, fault))[None],
        turning=partial(turning_terms, fault, pump) if turns else None,
        path=response,
    )


def respond(
    drive: Drive,
    values: Float[Tensor, "row 6"],
    scales: Float[Tensor, "row 11"],
    solver: SteadySolver,
    *,
    added_force: Complex[Tensor, "row line 13"] | None = None,
    recompute: bool = False,
) -> Complex[Tensor, "row sensor read"]:
    """Return the lines of acceleration [m/s^2] at the drive's orders, read by each sensor.

    Parameters
    ----------
    drive : on the device and in the precision of `values`.
    added_force : what each row adds to the drive's pressure [N, N m].
    recompute : keep nothing for the gradient but compute it again; always so if there are several
        chunks.
    """
    chunk_rows = rows_of(drive.orders.size)
    recompute = (recompute or len(values) > chunk_rows) and torch.is_grad_enabled()

    parts = []
    for start in range(0, len(values), chunk_rows):
        rows = slice(start, start + chunk_rows)
        chunk_drive = drive if len(drive.wear) == 1 else drive.mapped(itemgetter(rows))
        chunk_force = None if added_force is None else added_force[rows]
        arguments = (chunk_drive, values[rows], scales[rows], chunk_force, solver)
        if recompute:
            parts.append(
                checkpoint(_chunk, *arguments, use_reentrant=False, preserve_rng_state=False)
            )
        else:
            parts.append(_chunk(*arguments))
    return parts[0] if len(parts) == 1 else torch.cat(parts)


def rows_of(n_lines: int) -> int:
    """Return the number of rows of `n_lines` lines in a chunk."""
    return max(1, WORKSPACE // (n_lines * _LINE_BYTES))


def _chunk(
    drive: Drive,
    values: Tensor,
    scales: Tensor,
    added_force: Tensor | None,
    solver: SteadySolver,
) -> Tensor:
    structure = drive.structure
    frequency = drive.frequency if len(drive.wear) > 1 else drive.frequency[0]
    mount, bearing, excitation, sensor, *_ = scales.unbind(-1)

    worn_values = values * drive.wear
    force = drive.pressure
    if added_force is not None:
        force = force + added_force
    if drive.action.strains or drive.action.pushes:
        force = force + drive.action.forces(worn_values, structure.slipper_vector, excitation)
    force = force.expand(len(values), -1, -1)
    stiffness = structure.stiffness(worn_values, mount, bearing, scales[..., SUPPORTS])
    damping = structure.damping(worn_values, mount, bearing, scales[..., SUPPORTS])

    if drive.turning is None:
        motion = solver.steady_state(structure.mass, damping, stiffness, frequency, force)
    else:
        terms = drive.turning(worn_values)
        speed = float(frequency[1])
        motion = periodic_steady_state(
            solver, structure.mass, damping, stiffness, speed, force, terms
        )[:, 1:]
        frequency = frequency[1:]

    acceleration = read_sensors(structure, frequency, motion, sensor)
    return acceleration if drive.path is None else acceleration * drive.path


def read_sensors(
    structure: Structure,
    frequency: Float[Tensor, "*#row line"],
    motion: Complex[Tensor, "row line 13"],
    gain: Float[Tensor, " row"],
) -> Complex[Tensor, "row sensor line"]:
    """Return the lines of acceleration [m/s^2] that sensors on the shell read of a motion.

    Parameters
    ----------
    frequency : angular frequency of the lines [rad/s], for all rows or for each.
    gain : factor on what the sensors read, of each row.
    """
    # The sensors sit on the shell: the other degrees of freedom do not reach them.
    shell = motion[..., None, :, SHELL] * structure.sensor_rows[:, None, SHELL]
    return shell.sum(-1) * (-(frequency**2) * gain[:, None])[:, None]


def require_positive(
    values: Float[Tensor, "*batch 6"], scales: Float[Tensor, "*scaled 11"]
) -> None:
    """Refuse interface values and scales that are not positive.

    Raises
    ------
    InputError
        It names the first one.
    """
    scale_names = tuple(f"scales.{scale.name}" for scale in fields(Scales))
    for tensor, names in ((values, PARAMETERS), (scales, scale_names)):
        numbers = tensor.detach()
        if tensor.is_meta or bool(((numbers > 0) & torch.isfinite(numbers)).all()):
            continue

        rows = numbers.reshape(-1, len(names))
        is_wrong = ~((rows > 0) & torch.isfinite(rows))
        row, column = (int(index) for index in is_wrong.nonzero()[0])
        raise InputError(
            f"{names[column]} ({float(rows[row, column]):g}) must be positive and finite; "
            "bounds or logarithms keep it so."
        )
