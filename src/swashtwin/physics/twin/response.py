"""From what drives twins to what their accelerometers read: one path for a single twin and for a batch.

All that no interface value changes is computed once, as a `Drive`; the rest is a few array operations around one call
of the solver. Rows are computed in chunks of bounded memory, each independent of its neighbors.
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
from swashtwin.physics.dynamics import N_DOF, SHELL, Structure, Topology, assemble, moved
from swashtwin.physics.fault_forcing import (
    FaultAction,
    active_orders,
    excitation_lines,
    fault_action,
    turning_terms,
    wear_factors,
)
from swashtwin.physics.loads import LoadCase, force_lines
from swashtwin.physics.loose_slipper import contact_lines
from swashtwin.physics.solvers.periodic import PeriodicTerm, periodic_steady_state
from swashtwin.physics.solvers.steady import SteadySolver
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
    """Angular frequency of the lines [rad/s]: those that are read, after order 0 where something is `turning`."""
    pressure: Complex[Tensor, "twin line 13"]
    """Lines of the chamber pressures and of the unbalance [N, N m]."""
    action: FaultAction
    """How the fault acts."""
    wear: Float[Tensor, "twin 6"]
    """Factors on the interface values."""
    turning: Callable[[Tensor], list[PeriodicTerm]] | None = None
    """Parts of K that turn with the shaft and so couple the orders, for interface values; then there is one twin only,
    and its lines begin with order 0."""
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
    path: SensorPath | None,
    n_lines: int,
) -> Drive:
    """Drive of one twin up to order `n_lines`, float64."""
    structure = assemble(pump, topology)
    pressure = force_lines([LoadCase(pump, condition, fault)], n_lines, topology=topology)[0]
    contact = contact_lines(fault, pump, condition, n_lines, topology)
    pressure = pressure if contact is None else pressure + contact
    motion = excitation_lines(pump, condition, fault, n_lines)
    turns = bool(turning_terms(fault, pump, torch.tensor(pump.interfaces.values(), dtype=torch.float64)))
    orders = np.arange(1, n_lines + 1) if turns else active_orders(pressure, motion)
    lines = np.concatenate([[0], orders]) if turns else orders
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
        turning=partial(turning_terms, fault, pump) if turns else None,
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


def rows_of(n_lines: int) -> int:
    """How many rows of so many lines make a chunk."""
    return max(1, WORKSPACE // (n_lines * _LINE_BYTES))


def _chunk(drive: Drive, values: Tensor, scales: Tensor, solver: SteadySolver) -> Tensor:
    structure, frequency = drive.structure, drive.frequency if len(drive.wear) > 1 else drive.frequency[0]
    mount, bearing, excitation, sensor, *_ = scales.unbind(-1)
    worn, force = values * drive.wear, drive.pressure
    if drive.action.strains or drive.action.pushes:
        force = force + drive.action.forces(worn, structure.slipper_vector, excitation)
    stiffness, damping = structure.stiffness(worn, mount, bearing, scales[..., SUPPORTS]), structure.damping(worn)
    force = force.expand(len(values), -1, -1)
    if drive.turning is None:
        motion = solver.steady_state(structure.mass, damping, stiffness, frequency, force)
    else:
        terms, speed = drive.turning(worn), float(frequency[1])
        motion = periodic_steady_state(solver, structure.mass, damping, stiffness, speed, force, terms)[:, 1:]
        frequency = frequency[1:]
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
