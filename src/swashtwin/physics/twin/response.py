"""From what drives twins to what their accelerometers read: one path for a single twin and for a batch.

All that no interface value changes is computed once, as a `Drive`; the rest is a few array operations around one call
of the solver. Rows are computed in chunks of bounded memory, each independent of its neighbors.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from operator import itemgetter

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from swashtwin.foundation import InputError
from swashtwin.physics.contacts.loose_slipper import contact_lines
from swashtwin.physics.contacts.settings import SlipperContact
from swashtwin.physics.dynamics import N_DOF, SHELL, Structure, Topology, assemble, moved
from swashtwin.physics.fault_forcing import FaultAction, active_orders, excitation_lines, fault_action, wear_factors
from swashtwin.physics.loads import LoadCase, force_lines
from swashtwin.physics.solvers.steady import HarmonicBalance, SteadySolver
from swashtwin.physics.twin.coupling import Coupling, Problem, coupling_of, linear_motion
from swashtwin.physics.twin.path import SensorPath
from swashtwin.physics.twin.scales import SUPPORTS, Scales
from swashtwin.pump import PARAMETERS, Fault, OperatingCondition, Pump

WORKSPACE = 64 * 2**20
"""Bytes that one chunk may take, its gradient included; larger batches are computed chunk by chunk."""
_LINE_BYTES = 12 * N_DOF * 16
"""Bytes that one line of one row takes: a dozen complex vectors."""


@dataclass(frozen=True, eq=False)
class Drive:
    """What excites one twin, or a batch of twins of one pump: its first axis has one entry for all rows or one each."""

    structure: Structure
    """Constant matrices."""
    orders: Int[np.ndarray, " read"]
    """Shaft orders that are read."""
    frequency: Float[Tensor, "twin line"]
    """Angular frequency of the lines [rad/s]: those that are read, after order 0 where there is a `coupling`."""
    pressure: Complex[Tensor, "twin line 13"]
    """Lines of the chamber pressures and of the unbalance [N, N m]."""
    action: FaultAction
    """How the fault acts."""
    wear: Float[Tensor, "twin 6"]
    """Factors on the interface values."""
    coupling: Coupling | None = None
    """What couples the orders; then there is one twin only, and its lines begin with order 0."""
    path: Complex[Tensor, "twin sensor read"] | None = None
    """What stands between the shell and each sensor at the orders read; None is nothing."""

    def to(self, like: Float[Tensor, "..."]) -> "Drive":
        """The same drive on the device and in the precision of `like`."""
        if self.wear.device == like.device and self.wear.dtype == like.dtype:
            return self
        there = self.mapped(lambda part: moved(part, like))
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
    contact: SlipperContact,
    path: SensorPath | None,
    n_lines: int,
    *,
    from_rest: bool = False,
) -> Drive:
    """Drive of one twin up to order `n_lines`, float64.

    Parameters
    ----------
    from_rest : let the lines begin with order 0 even where nothing couples the orders.
    """
    structure = assemble(pump, topology)
    pressure = force_lines([LoadCase(pump, condition, fault)], n_lines, topology=topology)[0]
    contact_forces = contact_lines(fault, pump, condition, n_lines, topology)
    if contact_forces is not None:
        pressure = pressure + contact_forces
    motion = excitation_lines(pump, condition, fault, n_lines)
    coupling = coupling_of(pump, condition, fault, topology, contact)
    orders = active_orders(pressure, motion) if coupling is None else np.arange(1, n_lines + 1)
    lines = np.concatenate([[0], orders]) if from_rest or coupling is not None else orders
    action = fault_action(fault, pump, structure, topology, lines * condition.speed, motion[lines])
    if path is not None and path.cross_talk:
        structure = replace(structure, sensor_rows=path.mixing @ structure.sensor_rows)
    return Drive(
        structure=structure,
        orders=orders,
        frequency=torch.as_tensor(lines * condition.speed)[None],
        pressure=torch.as_tensor(pressure[lines])[None],
        action=action.mapped(lambda part: part[None]),
        wear=torch.as_tensor(wear_factors(pump, fault))[None],
        coupling=coupling,
        path=None if path is None else path.response(torch.as_tensor(orders * condition.shaft_frequency))[None],
    )


def respond(
    drive: Drive,
    values: Float[Tensor, "row 6"],
    scales: Float[Tensor, "row 11"],
    solver: SteadySolver,
    *,
    recompute: bool = False,
) -> Complex[Tensor, "row sensor read"]:
    """Lines of acceleration [m/s^2] at the drive's orders, read by each sensor.

    Parameters
    ----------
    drive : on the device and in the precision of `values`.
    recompute : keep nothing for the gradient but compute it again; always so where there are several chunks.
    """
    most = rows_of(drive.orders.size)
    recompute = (recompute or len(values) > most) and torch.is_grad_enabled()
    parts = []
    for start in range(0, len(values), most):
        part = slice(start, start + most)
        driven = drive if len(drive.wear) == 1 else drive.mapped(itemgetter(part))
        arguments = (driven, values[part], scales[part], solver)
        if recompute:
            parts.append(checkpoint(_chunk, *arguments, use_reentrant=False, preserve_rng_state=False))
        else:
            parts.append(_chunk(*arguments))
    return parts[0] if len(parts) == 1 else torch.cat(parts)


def motion_of(
    pump: Pump, drive: Drive, values: Float[Tensor, " 6"], scales: Float[Tensor, " 11"], recess: float, n_lines: int
) -> Complex[Tensor, "line 13"]:
    """Displacement lines 0...`n_lines` [m, rad] of one twin, of a drive `from_rest`.

    Parameters
    ----------
    recess : mean of what a recess adds to a slipper's distance [m].
    """
    require_positive(values, scales)
    frequency = drive.frequency[0]
    speed = float(frequency[1]) / int(drive.orders[0])
    problem = Problem(drive.structure, values[None] * drive.wear, scales[None], drive.pressure, drive.action, speed)
    if drive.coupling is None:
        motion = linear_motion(pump, problem, frequency, recess)[0]
    else:
        motion = drive.coupling.motion(problem, HarmonicBalance())[0]
    out = motion.new_zeros(n_lines + 1, N_DOF)
    out[torch.as_tensor(np.concatenate([[0], drive.orders]))] = motion
    return out


def rows_of(n_lines: int) -> int:
    """How many rows of so many lines make a chunk."""
    return max(1, WORKSPACE // (n_lines * _LINE_BYTES))


def _chunk(drive: Drive, values: Tensor, scales: Tensor, solver: SteadySolver) -> Tensor:
    structure, frequency = drive.structure, drive.frequency if len(drive.wear) > 1 else drive.frequency[0]
    mount, bearing, excitation, sensor, *_ = scales.unbind(-1)
    worn = values * drive.wear
    if drive.coupling is not None:
        problem = Problem(structure, worn, scales, drive.pressure, drive.action, float(frequency[1]))
        motion, frequency = drive.coupling.motion(problem, solver)[:, 1:], frequency[1:]
    else:
        force = drive.pressure
        if drive.action.strains or drive.action.pushes:
            force = force + drive.action.forces(worn, structure.slipper_vector, excitation)
        stiffness, damping = structure.stiffness(worn, mount, bearing, scales[..., SUPPORTS]), structure.damping(worn)
        force = force.expand(len(values), -1, -1)
        motion = solver.steady_state(structure.mass, damping, stiffness, frequency, force)
    shell = motion[..., None, :, SHELL] * structure.sensor_rows[:, None, SHELL]  # sensors sit on the shell
    read = shell.sum(-1) * (-(frequency**2) * sensor[:, None])[:, None]
    return read if drive.path is None else read * drive.path


def require_positive(values: Float[Tensor, "*batch 6"], scales: Float[Tensor, "*scaled 11"]) -> None:
    """Refuse interface values and scales that would make a spring push where it should pull.

    Raises
    ------
    InputError
        One is not positive; it is named.
    """
    names = (*PARAMETERS, *(f"scales.{item.name}" for item in fields(Scales)))
    for tensor, words in ((values, names[: len(PARAMETERS)]), (scales, names[len(PARAMETERS) :])):
        if tensor.is_meta or bool(((tensor.detach() > 0) & torch.isfinite(tensor.detach())).all()):
            continue
        row = tensor.detach().reshape(-1, len(words))
        wrong = ~((row > 0) & torch.isfinite(row))
        row, at = row[wrong.any(dim=1)][0], int(wrong[wrong.any(dim=1)][0].nonzero()[0])
        raise InputError(
            f"{words[at]} ({float(row[at]):g}) must be positive and finite; bounds or logarithms keep it so."
        )
