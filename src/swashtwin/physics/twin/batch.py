"""Many twins at once: of different conditions, faults, interface values, scales, and even pumps.

Twins of one pump are solved together, each at its own frequencies; how they are grouped changes no
result.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.fault_forcing import FaultAction
from swashtwin.physics.steady import HarmonicBalance, SteadySolver
from swashtwin.physics.twin.model import Twin
from swashtwin.physics.twin.response import Drive, require_positive, respond, rows_of

# Twins are solved together where none has more than so many times the orders of another.
_ALIKE = 1.5


@dataclass(frozen=True, eq=False)
class OrderLines:
    """Lines of acceleration of several twins over the shaft orders of all of them."""

    orders: Int[np.ndarray, " line"]
    """Shaft orders at which any of the twins is computed, rising."""
    lines: Complex[Tensor, "twin *batch sensor line"]
    """Lines [m/s^2]; zero at orders that are not among a twin's own, such as those above its
    bandwidth.
    """


def accelerations(
    twins: Sequence[Twin],
    values: Float[Tensor, "twin *batch 6"] | None = None,
    *,
    scales: Float[Tensor, "twin *batch 11"] | None = None,
    solver: SteadySolver | None = None,
) -> OrderLines:
    """Lines of acceleration of many twins, differentiable with respect to `values` and `scales`.

    Each twin's are those of its own `Twin.acceleration`. Memory beyond the result is bounded: large
    batches are computed chunk by chunk, and their gradient recomputes each chunk.

    Parameters
    ----------
    twins : with the same number of sensors; all else may differ.
    values : interface values of each twin in the order of `pump.PARAMETERS`; None takes the twins'
        own. Their device and their precision are those of the whole computation.
    scales : factors in the order of `Scales`; None takes the twins' own.
    solver : as in `Twin.acceleration`.

    Raises
    ------
    InputError
        No twin, different numbers of sensors, or a value or scale that is not positive.
    """
    if len({len(twin.pump.sensors) for twin in twins}) != 1:
        raise InputError(
            "a batch needs twins of one number of sensors; call once for each kind of pump."
        )
    values = torch.stack([twin.values for twin in twins]) if values is None else values
    if scales is None:
        scales = values.new_tensor([twin.scales.values() for twin in twins])
        scales = scales.reshape(len(twins), *[1] * (values.ndim - 2), -1)
    require_positive(values, scales)
    shape = np.broadcast_shapes(values.shape[:-1], scales.shape[:-1])
    inner = math.prod(shape[1:])
    values = values.expand(*shape, 6).reshape(-1, inner, 6)
    scales = scales.expand(*shape, -1).reshape(-1, inner, scales.shape[-1])
    orders = reduce(np.union1d, (twin.orders for twin in twins))
    columns, parts = [], []
    for indices in _chunks(twins, inner):
        drive = _stacked([twins[i] for i in indices], inner)
        rows = torch.tensor(indices, device=values.device)
        lines = respond(
            drive.to(values),
            values[rows].flatten(0, 1),
            scales[rows].flatten(0, 1),
            solver or HarmonicBalance(),
            recompute=len(twins) * inner > rows_of(orders.size),
        )
        columns.extend(indices)
        parts.append(_spread(lines, np.searchsorted(orders, drive.orders), orders.size))
    order = torch.tensor(np.argsort(columns), device=values.device)
    together = torch.cat(parts).unflatten(0, (len(twins), inner))[order]
    return OrderLines(orders, together.reshape(*shape, *together.shape[2:]))


def _chunks(twins: Sequence[Twin], inner: int) -> Iterator[list[int]]:
    """Indices of twins that are solved together: of one pump, with similar numbers of orders,
    within the memory.
    """
    groups: dict[tuple, list[int]] = {}
    for i, twin in enumerate(twins):
        alone = i if twin.drive.turning is not None else None
        cross_talk = None if twin.path is None else twin.path.cross_talk
        groups.setdefault((twin.pump, twin.topology, cross_talk, alone), []).append(i)
    for group in groups.values():
        chunk: list[int] = []
        for i in sorted(group, key=lambda i: twins[i].orders.size):
            size = twins[i].orders.size
            if chunk and (
                (len(chunk) + 1) * inner > rows_of(size)
                or size > _ALIKE * twins[chunk[0]].orders.size
            ):
                yield chunk
                chunk = []
            chunk.append(i)
        yield chunk


def _stacked(twins: Sequence[Twin], inner: int) -> Drive:
    """One drive of several twins, over the orders of all of them, each twin repeated `inner`
    times.
    """
    drives = [twin.drive for twin in twins]
    if len(drives) == 1:
        return drives[0]
    orders = reduce(np.union1d, (drive.orders for drive in drives))
    columns = [np.searchsorted(orders, drive.orders) for drive in drives]

    def spread(parts: Sequence[Tensor]) -> Tensor:
        """Lines at each twin's own orders, zero at the others."""
        out = torch.zeros(len(drives), orders.size, *parts[0].shape[2:], dtype=parts[0].dtype)
        for row, column, part in zip(out.numpy(), columns, parts, strict=True):
            row[column] = part[0].numpy()
        return out

    path = None
    if any(drive.path is not None for drive in drives):
        path = torch.ones(
            len(drives), len(drives[0].structure.sensor_rows), orders.size, dtype=torch.complex128
        )
        for row, column, drive in zip(path, columns, drives, strict=True):
            if drive.path is not None:
                row[:, torch.as_tensor(column)] = drive.path[0]
    actions = [drive.action for drive in drives]
    together = Drive(
        structure=drives[0].structure,
        orders=orders,
        frequency=torch.as_tensor(np.outer([twin.condition.speed for twin in twins], orders)),
        pressure=spread([drive.pressure for drive in drives]),
        action=FaultAction(
            motion=spread([action.motion for action in actions]),
            rate=spread([action.rate for action in actions]),
            film=torch.cat([action.film for action in actions]),
            bore=torch.cat([action.bore for action in actions]),
            direct=spread([action.direct for action in actions]),
            strains=any(action.strains for action in actions),
            pushes=any(action.pushes for action in actions),
        ),
        wear=torch.cat([drive.wear for drive in drives]),
        path=path,
    )
    return together.mapped(lambda part: part.repeat_interleave(inner, 0)) if inner > 1 else together


def _spread(lines: Tensor, columns: Int[np.ndarray, " own"], n_lines: int) -> Tensor:
    """`lines` at their places among `n_lines`, zero at the others."""
    if lines.shape[-1] == n_lines:
        return lines
    out = lines.new_zeros(*lines.shape[:-1], n_lines)
    return out.index_copy(-1, torch.as_tensor(columns, device=lines.device), lines)
