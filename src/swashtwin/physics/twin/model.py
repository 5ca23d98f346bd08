"""A pump, under a condition, with a fault: what its accelerometers would read, and which numbers
that depends on.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.dynamics import Structure, Topology, assemble
from swashtwin.physics.excitation import find_recess
from swashtwin.physics.steady import HarmonicBalance, SteadySolver
from swashtwin.physics.twin.response import (
    UNSCALED,
    Drive,
    Scales,
    SensorPath,
    drive_of,
    require_positive,
    respond,
)
from swashtwin.pump import (
    Fault,
    Interfaces,
    OperatingCondition,
    Pump,
    format_quantity,
    pump_numbers,
    replace_number,
)
from swashtwin.recordings import Recording, join_blocks
from swashtwin.signals import synchronous_signal

BLOCK_SAMPLES = 65536
"""Readings that are computed at a time."""


@dataclass(frozen=True, eq=False)
class Twin:
    """Model of one pump at one operating condition.

    In steady state and linear: acceleration at the multiples of the shaft frequency up to
    `bandwidth`. A defect with half-sine edges excites all of them, so a level means little without
    the band it was taken in. `notes` says where a linear twin leaves its range.
    """

    pump: Pump
    condition: OperatingCondition
    fault: Fault | None = None
    """None is a healthy pump."""
    interfaces: Interfaces | None = None
    """Interface values; None takes the pump's nominal ones."""
    topology: Topology = "T1"
    """How the bodies are joined (`dynamics.Topology`)."""
    bandwidth: float = 5000.0
    """Highest frequency [Hz] that is computed."""
    scales: Scales = UNSCALED
    """Factors on mounting, bearings, excitation and sensors."""
    path: SensorPath | None = None
    """What stands between the rigid shell and the sensors; None is nothing."""

    def __post_init__(self) -> None:
        if self.bandwidth < self.pump.rotating_group.piston_count * self.condition.shaft_frequency:
            raise InputError(
                f"bandwidth ({self.bandwidth:g} Hz) lies below the piston-pass frequency "
                f"({self.pump.rotating_group.piston_count * self.condition.shaft_frequency:.1f} Hz)."
            )

    @property
    def label(self) -> str:
        """Class of the fault, ``"normal"`` without one."""
        return "normal" if self.fault is None else self.fault.label

    @property
    def values(self) -> Float[Tensor, " 6"]:
        """Interface values in the order of `pump.PARAMETERS`, float64."""
        return torch.tensor((self.interfaces or self.pump.interfaces).values(), dtype=torch.float64)

    @property
    def n_lines(self) -> int:
        """Number of shaft orders within `bandwidth`."""
        return int(self.bandwidth / self.condition.shaft_frequency)

    @property
    def structure(self) -> Structure:
        """Constant matrices."""
        return assemble(self.pump, self.topology)

    @cached_property
    def drive(self) -> Drive:
        """What excites the twin at any interface values; computed once."""
        return drive_of(
            self.pump, self.condition, self.fault, self.topology, self.path, self.n_lines
        )

    @property
    def orders(self) -> Int[np.ndarray, " line"]:
        """Shaft orders at which there is anything to compute (`fault_forcing.active_orders`)."""
        return self.drive.orders

    def notes(self) -> tuple[str, ...]:
        """What a user should know of where this twin's range ends, in sentences; empty where there
        is nothing.
        """
        notes = []
        slipper, recess = self.pump.rotating_group.slipper_diameter, find_recess(self.fault)
        if recess is not None and recess.effective_depth(slipper) != recess.depth:
            size = f"{recess.length * 1e3:.4g} mm x {recess.width * 1e3:.4g} mm"
            notes.append(
                f"The defect ({size}) is smaller than a slipper ({slipper * 1e3:.4g} mm), which bridges it: its depth "
                f"of {recess.depth * 1e3:.4g} mm counts as {recess.effective_depth(slipper) * 1e3:.4g} mm. The "
                "paper has no such defect; this is an extrapolation of ours."
            )
        if recess is not None and recess.strains_films:
            notes.append(
                f"In a recess {recess.depth * 1e3:.4g} mm deep by contact={recess.contact} films are strained: from "
                "some hundredths of a millimeter on the linear twin pulls at its slippers, which no film can. By "
                "contact=lift_off slippers may leave the plate."
            )
        return tuple(notes)

    def at(self, condition: OperatingCondition) -> "Twin":
        """The same pump and fault at another condition, which makes an extrapolation visible where
        it is made.
        """
        return replace(self, condition=condition)

    def with_fault(self, fault: Fault | None) -> "Twin":
        """The same pump with another fault."""
        return replace(self, fault=fault)

    def with_interfaces(self, interfaces: Interfaces, scales: Scales | None = None) -> "Twin":
        """The same pump with other interface values and `scales`; the pressures do not depend on
        them and are kept.
        """
        other = replace(self, interfaces=interfaces, scales=scales or self.scales)
        if "drive" in self.__dict__:
            other.__dict__["drive"] = self.drive  # where cached_property keeps it
        return other

    def acceleration(
        self,
        values: Float[Tensor, "*batch 6"] | None = None,
        *,
        scales: Float[Tensor, "*batch 11"] | None = None,
        solver: SteadySolver | None = None,
    ) -> Complex[Tensor, "*batch sensor line"]:
        """Lines of acceleration [m/s^2] at `orders` read by each sensor, differentiable with
        respect to `values`.

        Parameters
        ----------
        values : interface values in the order of `pump.PARAMETERS`; None takes the twin's own.
            Their device and their precision are those of the whole computation; in single precision
            lines are off by up to 1e-4 of the largest one, and gradients by up to 1e-3.
        scales : factors in the order of `Scales`; None takes the twin's own.
        solver : `HarmonicBalance` by default, `RK4` for the paper's.

        Raises
        ------
        InputError
            A value or a scale is not positive.
        """
        values = self.values if values is None else values
        scales = values.new_tensor(self.scales.values()) if scales is None else scales
        require_positive(values, scales)
        batch = np.broadcast_shapes(values.shape[:-1], scales.shape[:-1])
        rows, factors = (
            values.expand(*batch, 6).reshape(-1, 6),
            scales.expand(*batch, -1).reshape(-1, scales.shape[-1]),
        )
        lines = respond(self.drive.to(values), rows, factors, solver or HarmonicBalance())
        return lines.reshape(*batch, *lines.shape[1:])

    def simulate(
        self,
        duration: float,
        sample_rate: float,
        *,
        solver: SteadySolver | None = None,
        phase: float = 0.0,
        recording_id: str = "simulated",
    ) -> Recording:
        """Steady acceleration as a synthetic recording.

        Parameters
        ----------
        duration : length [s].
        sample_rate : samples per second [Hz], above twice the `bandwidth`.
        phase : shaft angle at the first sample [rad].

        Raises
        ------
        InputError
            The sample rate is below twice the bandwidth, or there is no sample.
        """
        return join_blocks(
            self.blocks(
                duration, sample_rate, solver=solver, phase=phase, recording_id=recording_id
            )
        )

    def blocks(
        self,
        duration: float,
        sample_rate: float,
        *,
        solver: SteadySolver | None = None,
        phase: float = 0.0,
        recording_id: str = "simulated",
    ) -> Iterator[Recording]:
        """The recording of `simulate` in blocks, so that memory does not grow with its length."""
        if sample_rate < 2 * self.bandwidth:
            raise InputError(
                f"sample_rate ({sample_rate:g} Hz) is below twice the twin's bandwidth ({self.bandwidth:g} Hz); "
                f"raise it, or use a twin with a bandwidth of {sample_rate / 2:g}."
            )
        n_samples = round(duration * sample_rate)
        if n_samples < 1:
            raise InputError(
                f"duration ({duration:g} s) must hold at least one sample at {sample_rate:g} Hz."
            )
        with torch.no_grad():
            lines = self.acceleration(solver=solver).numpy()
        for first in range(0, n_samples, BLOCK_SAMPLES):
            angle = (
                phase
                + self.condition.speed
                * np.arange(first, min(first + BLOCK_SAMPLES, n_samples))
                / sample_rate
            )
            yield Recording(
                signal=synchronous_signal(lines, self.orders, angle),
                sample_rate=sample_rate,
                recording_id=recording_id,
                channels=self.pump.channels,
                label=self.label,
                condition=self.condition,
                specimen=self.pump.name,
                synthetic=True,
            )


SHARE = 0.05
"""Relative change of a number."""
ANGLE = math.radians(2)
"""Change of an angle at which a kidney opens or closes [rad]: 5 % of one would be another valve
plate.
"""
TEMPERATURE = 5.0
"""Change of a temperature [K]."""


@dataclass(frozen=True)
class Sensitivity:
    """What a number of a pump does to the vibration."""

    path: str
    """Path of the number, such as ``masses.shell``."""
    step: str
    """By how much it was changed, in words."""
    effect: float
    """Norm of the change of all line amplitudes over the norm of the amplitudes, all sensors
    together.
    """


def sensitivities(twin: Twin) -> tuple[Sensitivity, ...]:
    """Effect of each number of the twin's pump on its lines, the largest first.

    Each number is changed alone, by 5 % (a kidney's edge by 2 degrees, a temperature by 5 K), up
    or, where the pump could not be built so, down. It is the effect on this twin's amplitudes below
    its bandwidth, not on the phases.
    """
    before = _amplitudes(twin)
    effects = []
    for path, value, unit in pump_numbers(twin.pump):
        if path == "rotating_group.piston_count" or path.startswith("rated."):
            continue
        pump, step = _changed(twin.pump, path, value, unit)
        after = _amplitudes(Twin(pump, twin.condition, twin.fault, bandwidth=twin.bandwidth))
        effects.append(
            Sensitivity(path, step, float(np.linalg.norm(after - before) / np.linalg.norm(before)))
        )
    return tuple(sorted(effects, key=lambda entry: -entry.effect))


def _amplitudes(twin: Twin) -> np.ndarray:
    with torch.no_grad():
        return np.abs(twin.acceleration().numpy())


def _changed(pump: Pump, path: str, value: Any, unit: str) -> tuple[Pump, str]:
    """The pump with one number changed, and by how much."""
    if path.startswith("valve_plate.") and path.endswith(("_open", "_close")):
        steps = [
            (value + sign * ANGLE, f"{'+' if sign > 0 else '-'}{format_quantity(ANGLE, 'rad')}")
            for sign in (1, -1)
        ]
    elif unit == "K":
        steps = [(value + TEMPERATURE, f"+{TEMPERATURE:g} K")]
    else:
        factors = (1 + SHARE, 1 - SHARE)
        changed = [
            tuple(n * f for n in value) if isinstance(value, tuple) else value * f for f in factors
        ]
        steps = list(zip(changed, (f"{SHARE:+.0%}", f"{-SHARE:+.0%}"), strict=True))
    try:
        return replace_number(pump, path, steps[0][0]), steps[0][1]
    except InputError:
        return replace_number(pump, path, steps[-1][0]), steps[-1][1]
