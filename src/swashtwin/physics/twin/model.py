"""Twin of a pump with a fault: the readings of its accelerometers, and their sensitivities."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.foundation import InputError, html_table, shorten
from swashtwin.physics.dynamics import Structure, Topology, assemble
from swashtwin.physics.excitation import find_recess
from swashtwin.physics.steady import HarmonicBalance, SteadySolver
from swashtwin.physics.twin.port_timing import AS_DRAWN, PortTiming, port_forces
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
    PARAMETERS,
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
"""Samples that are computed at a time."""


@dataclass(frozen=True, eq=False)
class Twin:
    """Model of one pump at one operating condition, linear and in steady state.

    It computes the acceleration at the multiples of the shaft frequency up to `bandwidth`. A defect
    with half-sine edges excites all of them, so a level depends on the band. `notes` reports how a
    twin leaves the range of the linear model.
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
    """Modes and gains between the rigid shell and the sensors; None for a rigid path."""
    port_timing: PortTiming = AS_DRAWN
    """When the ports open, relative to the pump file."""

    def __post_init__(self) -> None:
        piston_pass = self.pump.rotating_group.piston_count * self.condition.shaft_frequency
        # Below it a pump with equal pistons has no line but that of its unbalance.
        if self.bandwidth < piston_pass:
            raise InputError(
                f"bandwidth ({self.bandwidth:g} Hz) lies below the piston-pass frequency "
                f"({piston_pass:.1f} Hz); raise it."
            )

    def __repr__(self) -> str:
        fault = ""
        if self.fault is not None:
            severity = next(iter(fields(self.fault))).name
            fault = f", {type(self.fault).__name__}({severity}={getattr(self.fault, severity):.4g})"
        return shorten(
            f"<Twin of {self.pump.name} ({self.label}) at "
            f"{format_quantity(self.condition.speed, 'rad/s')}, "
            f"{format_quantity(self.condition.discharge_pressure, 'Pa')}{fault}>"
        )

    def _repr_html_(self) -> str:
        values = self.interfaces or self.pump.interfaces
        rows = []
        for name, nominal, value in zip(
            PARAMETERS, self.pump.interfaces.values(), values.values(), strict=True
        ):
            unit = "N*s/m" if name.endswith("damping") else "N/m"
            rows.append((name, f"{value:.4g} {unit}", f"{nominal:.4g} {unit}"))
        pump = repr(self.pump).strip("<>")
        return html_table(repr(self), ("interface", "value", "nominal"), rows, pump)

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
        """Excitation of the twin, the same for all interface values; computed once."""
        pump = self.pump
        if self.port_timing != AS_DRAWN:
            pump = self.port_timing.apply(pump)
        return drive_of(pump, self.condition, self.fault, self.topology, self.path, self.n_lines)

    @property
    def orders(self) -> Int[np.ndarray, " line"]:
        """Shaft orders that anything excites (`fault_forcing.active_orders`)."""
        return self.drive.orders

    def notes(self) -> tuple[str, ...]:
        """Return the ways in which this twin leaves the model's range, as sentences."""
        recess = find_recess(self.fault)
        if recess is None:
            return ()

        notes = []
        slipper = self.pump.rotating_group.slipper_diameter
        effective_depth = recess.effective_depth(slipper)
        if effective_depth != recess.depth:
            notes.append(
                f"The defect ({recess.length * 1e3:.4g} mm x {recess.width * 1e3:.4g} mm) is "
                f"smaller than a slipper ({slipper * 1e3:.4g} mm), which bridges it: its depth of "
                f"{recess.depth * 1e3:.4g} mm counts as {effective_depth * 1e3:.4g} mm. The paper "
                "has no such defect; this is our extrapolation."
            )
        if recess.strains_films:
            notes.append(
                f"In a recess {recess.depth * 1e3:.4g} mm deep with contact={recess.contact} films "
                "are strained: from some hundredths of a millimeter on the linear twin pulls at "
                "its slippers, which no film can. With contact=lift_off slippers may leave the "
                "plate."
            )
        return tuple(notes)

    def at(self, condition: OperatingCondition) -> "Twin":
        """Return the twin at another condition: an extrapolation from where it was calibrated."""
        return replace(self, condition=condition)

    def with_fault(self, fault: Fault | None) -> "Twin":
        """Return the twin with another fault."""
        return replace(self, fault=fault)

    def with_interfaces(self, interfaces: Interfaces, scales: Scales | None = None) -> "Twin":
        """Return the twin with other interface values, and other `scales` if given."""
        twin = replace(self, interfaces=interfaces, scales=scales or self.scales)
        # The drive depends on neither, and its pressures are expensive: it is handed on in the
        # place in which cached_property stores it.
        if "drive" in self.__dict__:
            twin.__dict__["drive"] = self.drive
        return twin

    def acceleration(
        self,
        values: Float[Tensor, "*batch 6"] | None = None,
        *,
        scales: Float[Tensor, "*batch 11"] | None = None,
        port_timing: Float[Tensor, "*batch 2"] | None = None,
        solver: SteadySolver | None = None,
    ) -> Complex[Tensor, "*batch sensor line"]:
        """Return the lines of acceleration [m/s^2] at `orders`, read by each sensor.

        Differentiable with respect to `values`, `scales` and `port_timing`.

        Parameters
        ----------
        values : interface values in the order of `pump.PARAMETERS`; by default the twin's. Their
            device and precision are those of the whole computation; in single precision lines are
            off by up to 1e-4 of the largest one, and gradients by up to 1e-3.
        scales : factors in the order of `Scales`; by default the twin's.
        port_timing : angles [rad] in the order of `PortTiming`; by default the twin's.
        solver : `HarmonicBalance` by default, `RK4` for the paper's.

        Raises
        ------
        InputError
            A value or a scale is not positive.
        """
        if values is None:
            values = self.values
        if scales is None:
            scales = values.new_tensor(self.scales.values())
        require_positive(values, scales)

        parameters = [values, scales]
        if port_timing is not None:
            parameters.append(port_timing)

        batch = np.broadcast_shapes(*(parameter.shape[:-1] for parameter in parameters))
        value_rows = values.expand(*batch, 6).reshape(-1, 6)
        scale_rows = scales.expand(*batch, -1).reshape(-1, scales.shape[-1])
        added_force = None
        if port_timing is not None:
            added_force = self._added_force(port_timing.expand(*batch, -1).reshape(-1, 2))

        drive = self.drive.to(values)
        lines = respond(
            drive, value_rows, scale_rows, solver or HarmonicBalance(), added_force=added_force
        )
        return lines.reshape(*batch, *lines.shape[1:])

    def _added_force(self, port_timing: Float[Tensor, "row 2"]) -> Complex[Tensor, "row line 13"]:
        """Return what other angles of the ports than the twin's add to its drive [N, N m].

        A fault changes this little, so the healthy pump's forces are taken.
        """
        forces = port_forces(self.pump, self.condition, self.topology, self.n_lines)
        lines = self.drive.lines
        change = forces.change(port_timing, lines)
        if self.port_timing != AS_DRAWN:
            current_timing = port_timing.new_tensor([self.port_timing.values()])
            change = change - forces.change(current_timing, lines)
        return change

    def simulate(
        self,
        duration: float,
        sample_rate: float,
        *,
        solver: SteadySolver | None = None,
        phase: float = 0.0,
        recording_id: str = "simulated",
    ) -> Recording:
        """Return the steady acceleration as a synthetic recording.

        Parameters
        ----------
        duration : length [s].
        sample_rate : samples per second [Hz], above twice the `bandwidth`.
        phase : shaft angle at the first sample [rad].

        Raises
        ------
        InputError
            The sample rate is below twice the bandwidth, or the duration holds no sample.
        """
        blocks = self.blocks(
            duration, sample_rate, solver=solver, phase=phase, recording_id=recording_id
        )
        return join_blocks(blocks)

    def blocks(
        self,
        duration: float,
        sample_rate: float,
        *,
        solver: SteadySolver | None = None,
        phase: float = 0.0,
        recording_id: str = "simulated",
    ) -> Iterator[Recording]:
        """Yield the recording of `simulate` in blocks, whose memory does not grow with its length.

        See `simulate` for the parameters and errors.
        """
        if sample_rate < 2 * self.bandwidth:
            raise InputError(
                f"sample_rate ({sample_rate:g} Hz) is below twice the twin's bandwidth "
                f"({self.bandwidth:g} Hz); raise it, or use a twin with a bandwidth of "
                f"{sample_rate / 2:g}."
            )

        n_samples = round(duration * sample_rate)
        if n_samples < 1:
            raise InputError(
                f"duration ({duration:g} s) must hold at least one sample at {sample_rate:g} Hz."
            )

        with torch.no_grad():
            lines = self.acceleration(solver=solver).numpy()
        for start in range(0, n_samples, BLOCK_SAMPLES):
            sample = np.arange(start, min(start + BLOCK_SAMPLES, n_samples))
            angle = phase + self.condition.speed * sample / sample_rate
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


RELATIVE_STEP = 0.05
"""Relative change of a number in `sensitivities`."""

ANGLE_STEP = math.radians(2)
"""Change of the edge of a kidney [rad]: 5 % of its angle would be another valve plate."""

TEMPERATURE_STEP = 5.0
"""Change of a temperature [K]: 5 % of an absolute temperature would be some 16 K."""


@dataclass(frozen=True)
class Sensitivity:
    """Effect of one of a pump's numbers on the vibration."""

    path: str
    """Path of the number, such as ``masses.shell``."""
    step: str
    """Change of the number, such as ``+5%``."""
    effect: float
    """Norm of the change of all line amplitudes of all sensors, over the norm of these."""


def sensitivities(twin: Twin) -> tuple[Sensitivity, ...]:
    """Return the effect of each number of the twin's pump on its lines, the largest first.

    Each number is changed alone, by 5 % (a kidney's edge by 2 degrees, a temperature by 5 K). It is
    raised, or lowered if a pump with the raised number could not be built. Effects are those on
    this twin's amplitudes below its bandwidth, not on the phases.
    """
    amplitudes = _amplitudes(twin)
    effects = []
    for path, value, unit in pump_numbers(twin.pump):
        # The count is not continuous, and ratings do not enter the equations.
        if path == "rotating_group.piston_count" or path.startswith("rated."):
            continue

        pump, step = _change_number(twin.pump, path, value, unit)
        changed_twin = Twin(pump, twin.condition, twin.fault, bandwidth=twin.bandwidth)
        change = np.linalg.norm(_amplitudes(changed_twin) - amplitudes)
        effects.append(Sensitivity(path, step, float(change / np.linalg.norm(amplitudes))))
    return tuple(sorted(effects, key=lambda sensitivity: -sensitivity.effect))


def _amplitudes(twin: Twin) -> np.ndarray:
    with torch.no_grad():
        return np.abs(twin.acceleration().numpy())


def _change_number(pump: Pump, path: str, value: Any, unit: str) -> tuple[Pump, str]:
    """Return the pump with one number changed, and the change as text."""
    raised, lowered = _changed_values(path, value, unit)
    try:
        return replace_number(pump, path, raised[0]), raised[1]
    except InputError:
        return replace_number(pump, path, lowered[0]), lowered[1]


def _changed_values(path: str, value: Any, unit: str) -> list[tuple[Any, str]]:
    """Return the raised and the lowered value of a number, each with the change as text."""
    is_edge = path.startswith("valve_plate.") and path.endswith(("_open", "_close"))
    changed: list[tuple[Any, str]] = []
    for sign, symbol in ((1, "+"), (-1, "-")):
        factor = 1 + sign * RELATIVE_STEP
        if is_edge:
            angle_text = format_quantity(ANGLE_STEP, "rad")
            changed.append((value + sign * ANGLE_STEP, f"{symbol}{angle_text}"))
        elif unit == "K":
            changed.append((value + sign * TEMPERATURE_STEP, f"{symbol}{TEMPERATURE_STEP:g} K"))
        elif isinstance(value, tuple):
            changed.append(
                (tuple(number * factor for number in value), f"{symbol}{RELATIVE_STEP:.0%}")
            )
        else:
            changed.append((value * factor, f"{symbol}{RELATIVE_STEP:.0%}"))
    return changed
