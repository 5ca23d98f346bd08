"""The one problem that every contender solves, as plain arrays.

The paper's pump (25SCY14-1B, 13 degrees of freedom) at 860 rev/min and 15 MPa with the paper's
defect, its forces cut at 5 kHz as the twin cuts them. Everything that does not depend on the six
interface values is computed beforehand and for nothing: the forces at every fraction of a step,
split into what the values do not touch and a few motions that they weigh.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor

from swashtwin.foundation import MPa, mm, rpm
from swashtwin.physics import HarmonicBalance, Twin
from swashtwin.pump import OperatingCondition, SwashPlateDefect, load_pump

STEPS_PER_REVOLUTION = 72_000
"""A round number just above what stability demands: a step of 0.969 us where the limit is 1.00
us.
"""
FACTORS = np.array([1, 1, 1.6, 0.7, 2.5, 1])
"""Values that the loss compares with, over the nominal ones."""
SAMPLED_EVERY = 72
"""Readings are compared at every so many steps."""


@lru_cache
def pump_twin() -> Twin:
    """The twin whose equations all solve."""
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    defect = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    return Twin(load_pump("25scy14-1b"), condition, defect)


class Probe:
    """A solver that solves nothing, but keeps the equations it was given."""

    def steady_state(
        self, mass: Tensor, damping: Tensor, stiffness: Tensor, frequency: Tensor, force: Tensor
    ) -> Tensor:
        """Zero motion."""
        self.given = mass, damping, stiffness, frequency, force
        parts = damping.reshape(13, 13), stiffness.reshape(13, 13), force.reshape(-1, 13)
        self.parts = tuple(part.detach().numpy() for part in parts)
        return torch.zeros_like(force)


@dataclass(frozen=True, eq=False)
class Equations:
    """M x'' + C x' + K x = Q of a twin, all of it affine in the six values; index 0 is the constant
    part.
    """

    mass: np.ndarray
    """Diagonal of M (13)."""
    damping: np.ndarray
    """C0 and its slopes (7, 13, 13)."""
    stiffness: np.ndarray
    """K0 and its slopes (7, 13, 13)."""
    load: np.ndarray
    """Force lines that the values do not touch (line, 13)."""
    motion: np.ndarray
    """Lines of the motions that the values weigh (line, motion)."""
    weight: np.ndarray
    """Force of each motion per unit of each value (motion, 13, 6)."""
    sensor_rows: np.ndarray
    """Accelerations read, per coordinate (sensor, 13)."""


@lru_cache
def equations() -> Equations:
    """Equations of `pump_twin`, found by asking it at the nominal values, and with each of them
    doubled in turn.
    """
    twin, probe, parts = pump_twin(), Probe(), []
    nominal = twin.values.numpy()
    for factors in 1 + np.concatenate([np.zeros((1, 6)), np.eye(6)]):
        twin.acceleration(torch.as_tensor(nominal * factors), solver=probe)
        parts.append(probe.parts)
    damping, stiffness, force = map(np.stack, zip(*parts, strict=True))
    for array in (damping, stiffness, force):
        array[1:] -= array[0]
        array[0] -= array[1:].sum(axis=0)
    flat = np.moveaxis(force[1:], 0, -1).reshape(force.shape[1], -1)  # line, 13 x 6
    for array in (damping, stiffness):
        array[1:] /= nominal[:, None, None]
    left, size, right = np.linalg.svd(np.concatenate([flat.real, flat.imag]), full_matrices=False)
    is_kept = size > 1e-12 * size[0]
    scores = np.split(left[:, is_kept] * size[is_kept], 2)
    return Equations(
        mass=twin.structure.mass.diagonal().numpy(),
        damping=damping,
        stiffness=stiffness,
        load=force[0],
        motion=scores[0] + 1j * scores[1],
        weight=right[is_kept].reshape(-1, 13, 6) / nominal,
        sensor_rows=twin.structure.sensor_rows.numpy(),
    )


def in_time(
    lines: np.ndarray,
    per_step: int,
    n_steps: int,
    per_revolution: int,
    orders: np.ndarray | None = None,
) -> np.ndarray:
    """Lines at `orders`, by default the twin's, as samples at every 1/`per_step` of a step from 0
    to `n_steps`.
    """
    points = per_step * per_revolution
    spectrum = np.zeros((points // 2 + 1, lines.shape[1]), dtype=complex)
    spectrum[pump_twin().orders if orders is None else orders] = lines * (points / 2)
    return np.fft.irfft(spectrum, points, axis=0)[np.arange(per_step * n_steps + 1) % points]


@lru_cache
def settled_start() -> np.ndarray:
    """State (26) of the settled pump at time 0 and nominal values, without the mean, which no
    acceleration shows.
    """
    probe = Probe()
    pump_twin().acceleration(solver=probe)
    motion = HarmonicBalance().steady_state(*probe.given).reshape(-1, 13).numpy()
    rate = 1j * pump_twin().condition.speed * pump_twin().orders[:, None] * motion
    return np.concatenate([motion.real.sum(axis=0), rate.real.sum(axis=0)])


@dataclass(frozen=True, eq=False)
class Problem:
    """So many steps of the equations, and the loss that is taken of them.

    They start from the settled motion at the nominal values, so that one revolution is enough: from
    rest, the paper's way would need four.
    """

    n_steps: int = STEPS_PER_REVOLUTION
    """Steps taken."""
    per_step: int = 2
    """Forces given per step: 2 for the classical Runge-Kutta method, which asks for them at half
    steps.
    """
    per_revolution: int = STEPS_PER_REVOLUTION
    """Steps of a whole revolution, which say how long one is."""

    @property
    def step(self) -> float:
        """Time step [s]."""
        return pump_twin().condition.period / self.per_revolution

    @property
    def nominal(self) -> np.ndarray:
        """Values at which everything is computed."""
        return pump_twin().values.numpy()

    @property
    def start(self) -> np.ndarray:
        """State (26) at time 0."""
        return settled_start()

    @cached_property
    def load(self) -> np.ndarray:
        """Accelerations (point, 26) from the forces that the values do not touch, the first 13
        being zero.
        """
        return self._pushed(equations().load / equations().mass)

    @cached_property
    def motion(self) -> np.ndarray:
        """Motions (point, motion) that the values weigh."""
        return in_time(equations().motion, self.per_step, self.n_steps, self.per_revolution)

    def _pushed(self, lines: np.ndarray) -> np.ndarray:
        table = np.zeros((self.per_step * self.n_steps + 1, 26))
        table[:, 13:] = in_time(lines, self.per_step, self.n_steps, self.per_revolution)
        return table

    @property
    def state_slopes(self) -> np.ndarray:
        """A of x' = A x + u at zero values, and its slopes (7, 26, 26)."""
        given, slopes = equations(), np.zeros((7, 26, 26))
        slopes[0, :13, 13:] = np.eye(13)
        slopes[:, 13:, :13] = -given.stiffness / given.mass[:, None]
        slopes[:, 13:, 13:] = -given.damping / given.mass[:, None]
        return slopes

    @property
    def push_weight(self) -> np.ndarray:
        """Acceleration of each motion per unit of each value (motion, 26, 6)."""
        given = equations()
        return np.concatenate(
            [np.zeros_like(given.weight), given.weight / given.mass[:, None]], axis=1
        )

    @property
    def sensor_rows(self) -> np.ndarray:
        """Velocity of each sensor per state (sensor, 26)."""
        rows = equations().sensor_rows
        return np.concatenate([np.zeros_like(rows), rows], axis=1)

    @property
    def n_bins(self) -> int:
        """Lines of the stretch that the loss compares, up to 5 kHz."""
        return max(
            1, min(int(pump_twin().bandwidth * self.step * self.n_steps), self.n_steps // 2 - 1)
        )

    @property
    def bin_scale(self) -> np.ndarray:
        """Amplitude of acceleration (bin, 1) per transformed gain of velocity over a step.

        The equations solved for the acceleration would magnify the error of a stiff state a
        millionfold.
        """
        half = np.pi * np.arange(1, self.n_bins + 1) / self.n_steps
        return (2 / self.n_steps / self.step * half / np.sin(half))[:, None]

    @cached_property
    def target(self) -> np.ndarray:
        """Amplitudes (bin, sensor) that the loss compares with: steady motion at other values, as
        long.
        """
        with torch.no_grad():
            lines = pump_twin().acceleration(torch.as_tensor(self.nominal * FACTORS)).numpy().T
        rate = 1j * pump_twin().condition.speed * pump_twin().orders[:, None]
        gains = np.diff(in_time(lines / rate, 1, self.n_steps, self.per_revolution), axis=0)
        return np.abs(np.fft.rfft(gains, axis=0))[1 : self.n_bins + 1] * self.bin_scale
