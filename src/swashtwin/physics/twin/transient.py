"""What the accelerometers read while speed and pressure change: a twin marched along a profile.

M x'' + C x' + K x = Q(t) with the forces of `operating_grid` at the angle of the shaft, by the step that is exact for
forces which run linearly from instant to instant. The shell's acceleration is the derivative of its velocity by
differences of the sixth order: taken from the forces, it would be a small difference of large ones, for a film carries
forty times what accelerates the shell. Left out: the unbalance's force along the shaft's turning, which goes with its
angular acceleration. K and C are constant: films do not stiffen with the profile's pressure.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.dynamics import N_DOF
from swashtwin.physics.fault_forcing import turning_terms, worn_values
from swashtwin.physics.solvers.steady import HarmonicBalance
from swashtwin.physics.solvers.trajectories import first_order_hold_trajectory
from swashtwin.physics.twin.model import Twin
from swashtwin.physics.twin.operating_grid import OperatingGrid, operating_grid
from swashtwin.physics.twin.operating_profile import OperatingProfile, Shaft
from swashtwin.physics.twin.response import require_positive
from swashtwin.physics.twin.scales import SUPPORTS
from swashtwin.recordings import Recording, join_blocks

STEPS = 20.0
"""Steps within the shortest period of the twin's bandwidth, at least: the steady state is then met to 0.05 %."""
SLOPE = {-3: -1 / 60, -2: 9 / 60, -1: -45 / 60, 1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
"""Weights of the velocities at neighboring instants whose sum over a step is the acceleration."""
BLOCK = 16384
"""Readings that are computed at a time."""


def simulate_profile(
    twin: Twin,
    profile: OperatingProfile,
    sample_rate: float,
    *,
    phase: float = 0.0,
    seed: int = 0,
    start: Literal["steady", "rest"] = "steady",
    oversampling: int | None = None,
    recording_id: str = "simulated",
) -> Recording:
    """Acceleration while speed and pressure follow a profile, as a synthetic recording that knows its speed.

    Parameters
    ----------
    twin : pump, fault and interface values; of its condition only what the profile leaves open counts.
    sample_rate : samples per second [Hz], at least twice the twin's bandwidth.
    phase : shaft angle at the first sample [rad].
    seed : draws the profile's jitter.
    start : ``steady``, as if the first instant's speed and pressure had always held; ``rest``, at rest and unloaded,
        so that the load comes at once and the start-up is heard.
    oversampling : steps from one sample to the next; None takes `STEPS` within the shortest period of the bandwidth.

    Raises
    ------
    InputError
        The sample rate is below twice the bandwidth, the fault turns with the shaft, or the pump cannot hold its
        pressure at the profile's highest speed.
    """
    return join_blocks(
        profile_blocks(
            twin, profile, sample_rate, phase=phase, seed=seed, start=start, oversampling=oversampling,
            recording_id=recording_id,
        )
    )  # fmt: skip


def profile_blocks(
    twin: Twin,
    profile: OperatingProfile,
    sample_rate: float,
    *,
    phase: float = 0.0,
    seed: int = 0,
    start: Literal["steady", "rest"] = "steady",
    oversampling: int | None = None,
    recording_id: str = "simulated",
) -> Iterator[Recording]:
    """The recording of `simulate_profile` in blocks, so that memory does not grow with its length."""
    if oversampling is None:
        oversampling = max(1, math.ceil(STEPS * twin.bandwidth / sample_rate))
    n_samples = round(profile.duration * sample_rate)
    _refuse_unfit(twin, profile, sample_rate, oversampling, n_samples, start)
    shaft = profile.shaft(phase=phase, seed=seed)
    spans = [(first, min(first + BLOCK, n_samples)) for first in range(0, n_samples, BLOCK)]
    rate = sample_rate * oversampling

    def instants(first: int, last: int) -> Float[np.ndarray, " time"]:
        return np.arange(first * oversampling - 3, last * oversampling + 4) / rate

    grid = operating_grid(twin, profile, shaft, (instants(*span) for span in spans))
    tables, march = grid.tables(1 / rate), _march_of(twin, 1 / rate)
    state = (
        march.steady_start(grid, profile, shaft) if start == "steady" else torch.zeros(2 * N_DOF, dtype=torch.float64)
    )
    for span in spans:
        instant = instants(*span)
        force = tables.force(*shaft.at(instant), profile.pressure_at(instant))
        signal, state = march.block(force, state, oversampling)
        speed = np.maximum(shaft.at(np.arange(*span) / sample_rate)[1], 0.0)
        yield Recording(
            signal=signal,
            sample_rate=sample_rate,
            recording_id=recording_id,
            channels=twin.pump.channels,
            label=twin.label,
            condition=profile.mean(twin.condition),
            speed=speed,
            specimen=twin.pump.name,
            synthetic=True,
        )


def _refuse_unfit(
    twin: Twin, profile: OperatingProfile, sample_rate: float, oversampling: int, n_samples: int, start: str
) -> None:
    if turning_terms(twin.fault, twin.pump, twin.values):
        raise InputError(
            f"a {type(twin.fault).__name__} lets the stiffness turn with the shaft, which no transient follows yet; "
            "simulate it at a steady condition (Twin.simulate), or take another fault of the class, such as BoreDefect."
        )
    if not twin.contact.linear:
        raise InputError(
            "slippers that differ or lift off are solved for in steady state only; leave out SlipperContact "
            "(--one-sided, --unloaded), or hold speed and pressure."
        )
    if twin.path is not None and twin.path.frequency:
        raise InputError(
            "the housing's modes of a sensor path are known for steady lines only; take a twin whose path has gains "
            "alone (calibrated without Nuisances.modes), or hold speed and pressure."
        )
    if start not in ("steady", "rest"):
        raise InputError(f"start ({start!r}) must be 'steady' or 'rest'.")
    if oversampling < 1 or n_samples < 1:
        raise InputError(f"oversampling ({oversampling}) and the number of samples ({n_samples}) must be at least 1.")
    twin.require_rate(sample_rate)
    top = float(profile.speed.max())
    for pressure in (float(profile.discharge_pressure.min()), float(profile.discharge_pressure.max())):
        twin.at(twin.condition.replaced(speed=top, discharge_pressure=pressure))  # refuses what is no condition


@dataclass(frozen=True, eq=False)
class _March:
    """Equations of motion of one twin, ready to be marched."""

    mass: Tensor
    damping: Tensor
    stiffness: Tensor
    sensors: Tensor
    """Reading of each sensor per acceleration of each coordinate."""
    step: float
    """Time from one instant to the next [s]."""

    def steady_start(self, grid: OperatingGrid, profile: OperatingProfile, shaft: Shaft) -> Float[Tensor, " 26"]:
        """State three steps before the first sample, had its speed and pressure always held."""
        speed = float(shaft.speed[0])
        lines = torch.as_tensor(grid.lines_at(speed, float(profile.discharge_pressure[0])))
        orders = torch.arange(lines.shape[0], dtype=torch.float64)
        motion = HarmonicBalance().steady_state(self.mass, self.damping, self.stiffness, orders * speed, lines)
        turned = motion * torch.exp(1j * orders * (float(shaft.angle[0]) - 3 * self.step * speed))[:, None]
        return torch.cat([turned.sum(0).real, (1j * speed * orders[:, None] * turned).sum(0).real])

    def block(
        self, force: Float[np.ndarray, "instant 13"], state: Float[Tensor, " 26"], every: int
    ) -> tuple[Float[np.ndarray, "sensor time"], Float[Tensor, " 26"]]:
        """Readings [m/s^2] at each `every`-th instant from the fourth on, and the state where the next block begins.

        Parameters
        ----------
        force : forces from three instants before the first sample to three after the next block's first.
        state : at the first of these instants.
        """
        forces = torch.as_tensor(force)
        states = first_order_hold_trajectory(self.mass, self.damping, self.stiffness, forces, self.step, state)
        velocity = states[:, N_DOF:] @ self.sensors.T / self.step
        length = len(force) - 7
        slope = sum(weight * velocity[3 + ahead : 3 + ahead + length : every] for ahead, weight in SLOPE.items())
        return np.ascontiguousarray(torch.as_tensor(slope).T.numpy()), states[length]


def _march_of(twin: Twin, step: float) -> _March:
    structure, scales = twin.structure, twin.scales
    factors = torch.tensor(scales.values(), dtype=torch.float64)
    require_positive(twin.values, factors)
    rows = structure.sensor_rows
    if twin.path is not None:
        rows = torch.tensor(twin.path.gain, dtype=torch.float64)[:, None] * (twin.path.mixing @ rows)
    worn = worn_values(twin.pump, twin.fault, twin.values)
    return _March(
        mass=structure.mass,
        damping=structure.damping(worn),
        stiffness=structure.stiffness(worn, scales.mount, scales.bearing, factors[SUPPORTS]),
        sensors=scales.sensor * rows,
        step=step,
    )
