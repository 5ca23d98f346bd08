"""When the ports open: small differences from the pump file.

A valve plate made within its tolerances opens its ports some tenths of a degree earlier or later
than drawn. That changes the chamber pressures, and only them. Half a degree of the discharge port
changes the upper lines of their forces by as much as these lines are, so a derivative would not do:
forces are computed at angles `KNOT_STEP` apart, and interpolated between them by the cubic splines
of Catmull and Rom (1974, doi:10.1016/B978-0-12-079050-0.50020-5), with an error below 1 % of the
largest line. An angle can then be searched, drawn and differentiated like a factor of `Scales`.

The two ports open half a turn apart, so that their effects add (within 0.1 %).
"""

from dataclasses import astuple, dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.foundation import InputError, deg
from swashtwin.physics.dynamics import Topology, cast_like
from swashtwin.physics.loads import LoadCase, force_lines
from swashtwin.pump import OperatingCondition, Pump

PORT_ANGLES = ("discharge_open", "suction_open")
"""Angles of `pump.ValvePlate` that `PortTiming` changes."""
PORT_TOLERANCE = deg(0.7)
"""Standard deviation of the angle at which a port opens from the pump file's [rad]: a tolerance of
manufacturing, our estimate.
"""
KNOT_STEP = deg(0.25)
"""Distance of the angles [rad] at which forces are computed."""
CACHED_PORTS = 32
"""Operating points whose forces at these angles are remembered, of up to 2 MB each."""


@dataclass(frozen=True)
class PortTiming:
    """Angles by which ports open later than in the pump file [rad]; negative is earlier."""

    discharge_open: float = 0.0
    """Of the discharge port."""
    suction_open: float = 0.0
    """Of the suction port."""

    def values(self) -> tuple[float, ...]:
        """Return the angles in the order of `PORT_ANGLES`."""
        return astuple(self)

    def apply(self, pump: Pump) -> Pump:
        """Return the pump with these ports."""
        plate = pump.valve_plate
        angles = {
            name: getattr(plate, name) + change
            for name, change in zip(PORT_ANGLES, self.values(), strict=True)
        }
        return replace(pump, valve_plate=replace(plate, **angles))


AS_DRAWN = PortTiming()
"""All ports as in the pump file."""


class PortForces:
    """Change of a healthy pump's `force_lines` with the angles at which its ports open."""

    def __init__(
        self, pump: Pump, condition: OperatingCondition, topology: Topology, n_lines: int
    ) -> None:
        self._pump = pump
        self._condition = condition
        self._topology = topology
        self._n_lines = n_lines
        self._drawn = self._force_lines(AS_DRAWN)
        self._knots: dict[tuple[str, int], Complex[np.ndarray, "order 13"]] = {}

    def change(
        self, timing: Float[Tensor, "row 2"], lines: Int[np.ndarray, " line"]
    ) -> Complex[Tensor, "row line 13"]:
        """Return the change of the forces [N, N m], differentiable.

        Parameters
        ----------
        timing : angles [rad] in the order of `PORT_ANGLES`.
        lines : shaft orders.
        """
        parts = []
        for column, name in enumerate(PORT_ANGLES):
            position = timing[:, column] / KNOT_STEP
            knot = position.detach().floor()
            first = int(knot.min()) - 1
            last = int(knot.max()) + 2

            weights = _interpolation_weights(position - knot)
            columns = knot.long()[:, None] - 1 - first + torch.arange(4, device=timing.device)
            spread = timing.new_zeros(len(timing), last - first + 1)
            spread = spread.scatter(-1, columns, weights)

            table = np.stack([self._knot(name, index)[lines] for index in range(first, last + 1)])
            changes = cast_like(torch.as_tensor(table), timing)
            parts.append((spread.to(changes.dtype) @ changes.flatten(1)).unflatten(1, (-1, 13)))
        return parts[0] + parts[1]

    def _knot(self, name: str, index: int) -> Complex[np.ndarray, "order 13"]:
        """Return the change of the forces if a port opens `index` steps later; computed once."""
        key = (name, index)
        if key not in self._knots:
            timing = PortTiming(**{name: index * KNOT_STEP})
            try:
                self._knots[key] = self._force_lines(timing) - self._drawn
            except InputError:
                # the ports would overlap: no pump opens as early as that
                self._knots[key] = self._knot(name, index - int(np.sign(index)))
        return self._knots[key]

    def _force_lines(self, timing: PortTiming) -> Complex[np.ndarray, "order 13"]:
        case = LoadCase(timing.apply(self._pump), self._condition)
        return force_lines(case, self._n_lines, topology=self._topology)


@lru_cache(maxsize=CACHED_PORTS)
def port_forces(
    pump: Pump, condition: OperatingCondition, topology: Topology, n_lines: int
) -> PortForces:
    """Return the change of the forces with the ports up to order `n_lines`; computed once."""
    return PortForces(pump, condition, topology, n_lines)


def _interpolation_weights(share: Float[Tensor, " row"]) -> Float[Tensor, "row 4"]:
    """Return the weights of the four knots around a position, a `share` of a step after the
    second.
    """
    square = share**2
    cube = share**3
    return torch.stack(
        [
            (-share + 2 * square - cube) / 2,
            (2 - 5 * square + 3 * cube) / 2,
            (share + 4 * square - 3 * cube) / 2,
            (cube - square) / 2,
        ],
        dim=-1,
    )
