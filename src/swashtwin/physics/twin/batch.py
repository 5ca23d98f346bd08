"""Many twins at once: of different conditions, faults, interface values, scales, and even pumps.

Twins of one pump are solved together, each at its frequencies. The grouping changes no result.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.fault_forcing import FaultAction
from swashtwin.physics.steady import HarmonicBalance, SteadySolver
from swashtwin.physics.twin.model import Twin
from swashtwin.physics.twin.response import Drive, require_positive, respond, rows_of

# Largest ratio of the numbers of orders of twins that are solved together: each is computed at the
# orders of all of them.
_MAX_ORDER_RATIO = 1.5


@dataclass(frozen=True, eq=False)
class OrderLines:
    """Lines of acceleration of several twins over the shaft orders of all of them."""

    orders: Int[np.ndarray, " line"]
    """Shaft orders at which any of the twins is computed, rising."""
    lines: Complex[Tensor, "twin *batch sensor line"]
    """Lines [m/s^2]; zero at orders that a twin does not have, such as those above its
    bandwidth.
    """


def accelerations(
    twins: Sequence[Twin],
    values: Float[Tensor, "twin *batch 6"] | None = None,
    *,
    scales: Float[Tensor, "twin *batch 11"] | None = None,
    solver: SteadySolver | None = None,
) -> OrderLines:
    """Return the lines of acceleration of many twins, as `Twin.acceleration` would one by one.

    Differentiable with respect to `values` and `scales`. Memory beyond the result is bounded: large
    batches are computed chunk by chunk, and their gradient recomputes each chunk.

    Parameters
    ----------
    twins : with the same number of sensors; all else may differ.
    values : interface values of each twin in the order of `pump.PARAMETERS`; by default the twins'.
        Their device and precision are those of the whole computation.
    scales : factors in the order of `Scales`; by default the twins'.
    solver : as in `Twin.acceleration`.

    Raises
    ------
    InputError
        No twin, different numbers of sensors, or a value or scale that is not positive.
    """
    if len({len(twin.pump.sensors) for twin in twins}) != 1:
        raise InputError(
            "A batch needs at least one twin, and the same number of sensors in all: "
            "compute twins with other sensors separately."
        )
    if values is None:
        values = torch.stack([twin.values for twin in twins])
    if scales is None:
        scales = values.new_tensor([twin.scales.values() for twin in twins])
        scales = scales.reshape(len(twins), *[1] * (values.ndim - 2), -1)
    require_positive(values, scales)

    shape = np.broadcast_shapes(values.shape[:-1], scales.shape[:-1])
    n_rows = math.prod(shape[1:])
    values = values.expand(*shape, 6).reshape(-1, n_rows, 6)
    scales = scales.expand(*shape, -1).reshape(-1, n_rows, scales.shape[-1])

    orders = reduce(np.union1d, (twin.orders for twin in twins))
    recompute = len(twins) * n_rows > rows_of(orders.size)
    computed: list[int] = []
    parts = []
    for indices in _chunks(twins, n_rows):
        drive = _stack_drives([twins[index] for index in indices], n_rows)
        selected = torch.tensor(indices, device=values.device)
        lines = respond(
            drive.to(values),
            values[selected].flatten(0, 1),
            scales[selected].flatten(0, 1),
            solver or HarmonicBalance(),
            recompute=recompute,
        )
        computed.extend(indices)
        parts.append(_spread(lines, np.searchsorted(orders, drive.orders), orders.size))

    # Chunks hold the twins in another order than the caller.
    caller_order = torch.tensor(np.argsort(computed), device=values.device)
    lines = torch.cat(parts).unflatten(0, (len(twins), n_rows))[caller_order]
    return OrderLines(orders, lines.reshape(*shape, *lines.shape[2:]))


def _chunks(twins: Sequence[Twin], n_rows: int) -> Iterator[list[int]]:
    """Yield the indices of twins that are solved together, of `n_rows` sets of values each.

    They share pump and sensor path, have similar numbers of orders, and fit in the memory. A twin
    with a turning part stays alone, because its lines are coupled.
    """
    groups: dict[tuple[Any, ...], list[int]] = {}
    for index, twin in enumerate(twins):
        solitary_index = index if twin.drive.turning is not None else None
        cross_talk = None if twin.path is None else twin.path.cross_talk
        key = (twin.pump, twin.topology, cross_talk, solitary_index)
        groups.setdefault(key, []).append(index)

    for group in groups.values():
        chunk: list[int] = []
        for index in sorted(group, key=lambda index: twins[index].orders.size):
            size = twins[index].orders.size
            if chunk:
                is_full = (len(chunk) + 1) * n_rows > rows_of(size)
                if is_full or size > _MAX_ORDER_RATIO * twins[chunk[0]].orders.size:
                    yield chunk
                    chunk = []
            chunk.append(index)
        yield chunk


def _stack_drives(twins: Sequence[Twin], n_rows: int) -> Drive:
    """Return one drive of several twins over all their orders, each twin repeated `n_rows`
    times.
    """
    drives = [twin.drive for twin in twins]
    if len(drives) == 1:
        return drives[0]

    orders = reduce(np.union1d, (drive.orders for drive in drives))
    columns = [np.searchsorted(orders, drive.orders) for drive in drives]

    def spread(parts: Sequence[Tensor]) -> Tensor:
        """Return lines at each twin's orders, zero at the others."""
        lines = torch.zeros(len(drives), orders.size, *parts[0].shape[2:], dtype=parts[0].dtype)
        for row, column, part in zip(lines.numpy(), columns, parts, strict=True):
            row[column] = part[0].numpy()
        return lines

    actions = [drive.action for drive in drives]
    stacked = Drive(
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
        path=_stack_paths(drives, columns, orders.size),
    )
    if n_rows == 1:
        return stacked
    return stacked.mapped(lambda part: part.repeat_interleave(n_rows, 0))


def _stack_paths(
    drives: Sequence[Drive], columns: Sequence[np.ndarray], n_lines: int
) -> Tensor | None:
    """Return the sensor paths of several drives, 1 for a drive without; None if none has one.

    The columns of each drive are integers, as many as it has lines.
    """
    if all(drive.path is None for drive in drives):
        return None

    n_sensors = len(drives[0].structure.sensor_rows)
    paths = torch.ones(len(drives), n_sensors, n_lines, dtype=torch.complex128)
    for path, column, drive in zip(paths, columns, drives, strict=True):
        if drive.path is not None:
            path[:, torch.as_tensor(column)] = drive.path[0]
    return paths


def _spread(lines: Tensor, columns: Int[np.ndarray, " column"], n_lines: int) -> Tensor:
    """Return `lines` at their `columns` of `n_lines`, zero at the others."""
    if lines.shape[-1] == n_lines:
        return lines

    spread = lines.new_zeros(*lines.shape[:-1], n_lines)
    return spread.index_copy(-1, torch.as_tensor(columns, device=lines.device), lines)
