"""Slippers that differ but do not lift off: a linear system whose K and C turn with the shaft, order by order.

K(theta) = (K_sw / n) sum_j w(phi_j) g_j g_j^T holds multiples of the piston count n only, and so does what a recess
exerts through it, -(1/n) sum_j w(phi_j) (K_sw + C_sw d/dt) H_j g_j: both are products of Fourier series, without error.
`integrators.periodic_steady_state` solves for the motion; `slipper_steady_state` finds the same by marching.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.physics.contacts.settings import FAINTEST, SlipperContact, weight_orders
from swashtwin.physics.contacts.slippers import distance_rows, slipper_lines
from swashtwin.physics.dynamics import moved
from swashtwin.physics.solvers.periodic import PeriodicTerm
from swashtwin.pump import Fault, OperatingCondition, Pump
from swashtwin.pump import InterfaceValue as Value

_WAYS = (np.array([1.0]), np.array([0, 1.0]), np.array([0, -1j]))
"""Lines of 1, cos and sin: a slipper's distance per unit of each coordinate."""


@dataclass(frozen=True, eq=False)
class PeriodicFilms:
    """The slippers' films over the revolution."""

    mean_shape: Float[Tensor, "13 13"]
    """Outer-product matrix of the mean, in place of the first of `Structure.interface_shapes`."""
    terms: list[PeriodicTerm]
    """What turns with the shaft."""
    force: Complex[Tensor, "*batch line 13"]
    """Lines [N, N m] from order 0 of what a recess exerts through the films, in place of the same from equal films."""


def periodic_films(
    pump: Pump,
    topology: str,
    contact: SlipperContact,
    condition: OperatingCondition,
    fault: Fault | None,
    values: Float[Tensor, "*batch 6"],
    n_lines: int,
) -> PeriodicFilms:
    """Films of such slippers up to order `n_lines`, for interface `values`; `SlipperContact.one_sided` is no matter."""
    count = pump.rotating_group.piston_count
    rows = distance_rows(pump, topology)
    ways, weight = _WAYS[: len(rows)], weight_orders(pump, contact)
    pairs = [[_product(weight, _product(way, other)) for other in ways] for way in ways]
    longest = max(len(series) for line in pairs for series in line)
    stacked = np.array([[np.pad(series, (0, longest - len(series))) for series in line] for line in pairs])
    shapes = np.einsum("abm,ai,bj->mij", stacked, rows, rows)
    damping, stiffness = (
        values[..., i, None, None] for i in (Value.SLIPPER_SWASH_DAMPING, Value.SLIPPER_SWASH_STIFFNESS)
    )
    terms = []
    for order in range(count, min(longest - 1, n_lines) + 1, count):
        if np.abs(stacked[..., order]).max() > FAINTEST:
            shape = moved(torch.as_tensor(shapes[order]), values)
            terms.append(PeriodicTerm(order, stiffness * shape, damping * shape))
    ahead = n_lines + longest
    strain = slipper_lines(pump, condition, fault, ahead)
    rate = 1j * condition.speed * np.arange(ahead + 1) * strain
    weighed = [_product(weight, way) for way in ways]
    is_common = np.arange(n_lines + 1) % count == 0
    pressed, damped = (
        moved(
            torch.as_tensor(
                np.stack([_product(seen, series)[: n_lines + 1] * is_common for seen in weighed], 1) @ rows
            ),
            values,
        )
        for series in (strain, rate)
    )
    return PeriodicFilms(
        mean_shape=moved(torch.as_tensor(shapes[0].real), values),
        terms=terms,
        force=-(stiffness * pressed + damping * damped),
    )


def _product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Lines from order 0 of the product of two series given by theirs."""
    product = np.convolve(_both_sides(left), _both_sides(right))[len(left) + len(right) - 2 :]
    return np.concatenate([[product[0]], 2 * product[1:]])


def _both_sides(lines: np.ndarray) -> np.ndarray:
    half = np.concatenate([lines[:1], lines[1:] / 2])
    return np.concatenate([half[:0:-1].conj(), half])
