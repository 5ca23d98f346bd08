"""Virtual pumps: power spectra of recordings, with everything drawn at random that no twin knows.

The pump answers as a twin does (`physics`). Drawn on top are what differs between pumps and between
recordings, what a fault strikes and what else is heard (`PumpPrior`).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Complex, Float

from swashtwin import physics
from swashtwin.pump import BoreDefect, Fault, OperatingCondition, PistonWear, Pump, SwashPlateDefect
from swashtwin.synthesis.pump_prior import (
    FORCE_REVERSALS,
    Impacts,
    PumpPrior,
    Trouble,
    TroubleSource,
    draw_modes,
    log_uniform,
    operating_range,
    smooth_curves,
    spread,
)

CELLS = 8
"""Cells of a spectrum from order to order: segments are eight turns long."""

# Segments whose spectra a recording averages: 4 s at 14 turns a second hold 13 that overlap by
# half.
_AVERAGES = 12

# Minimum factor on a piston's clearance: a normal draw could close the gap.
_MIN_CLEARANCE = 0.3


@dataclass(eq=False)
class VirtualPump:
    """One pump of a prior: everything that its recordings have in common.

    All draws come from one generator, in the order of the code: another order gives other pumps
    under the same seed.
    """

    prior: PumpPrior
    rng: np.random.Generator
    drawing: Pump
    highest: int
    """Highest shaft order that is computed."""

    def __post_init__(self) -> None:
        rng = self.rng
        prior = self.prior
        self.program = int(rng.integers(3))  # see `TroubleSource.program`
        self.pump = self._draw_pump()

        group = self.drawing.rotating_group
        self.count = group.piston_count
        clearance_factors = rng.normal(1, prior.clearances, self.count)
        self.clearances = group.piston_clearance * np.clip(clearance_factors, _MIN_CLEARANCE, None)
        self.slippers = rng.normal(1, prior.slippers, self.count)

        # How much differs from one recording of this pump to the next.
        self.care = log_uniform(rng, prior.care)
        self.setting = log_uniform(rng, prior.care)
        self.warming = rng.random()

        speed_range, pressure_range = operating_range(self.drawing, prior)
        self.speed = rng.uniform(*speed_range)
        self.pressure = rng.uniform(*pressure_range)
        nominal_values = np.array(self.drawing.interfaces.values())
        self.values = nominal_values * spread(rng, prior.interfaces, 6)
        self.exponent = rng.uniform(*prior.viscosity)
        self.following = log_uniform(rng, prior.following)

        self.orders = np.arange(self.highest + 1)
        self.structure = physics.assemble(self.pump)
        self.sensors = len(self.structure.sensor_rows)

        self.pulse = log_uniform(rng, prior.pulse)
        self.irregular = rng.uniform(*prior.irregular)
        self.jitter = math.radians(rng.uniform(0, 3))
        self.one_sided = rng.random()
        self.ringing = draw_modes(rng, int(rng.integers(0, 4)), 1, prior.ringing, 0.5)
        self.rattle = self._draw_rattle()

    def _draw_pump(self) -> Pump:
        """Return the drawing with port timing and unbalance as this pump was made."""
        timing = self.rng.normal(0, self.prior.timing, 2)
        plate = self.drawing.valve_plate
        plate = replace(
            plate,
            discharge_open=plate.discharge_open + timing[0],
            suction_open=plate.suction_open + timing[1],
        )

        masses = self.drawing.masses
        unbalance = float(spread(self.rng, self.prior.unbalance, 1)[0])
        masses = replace(masses, rotor_eccentricity=masses.rotor_eccentricity * unbalance)
        return replace(self.drawing, masses=masses, valve_plate=plate)

    def _draw_rattle(self) -> tuple[Impacts, ...]:
        """Return the impacts of the healthy pump, at the `FORCE_REVERSALS` of each piston.

        Half of the pumps whose faults strike also rattle without a fault.
        """
        rng = self.rng
        if not self.program or rng.random() >= 0.5:
            return ()

        # Weaker than a fault's impacts: 1/2 to 1/8 of the ends of their range.
        lowest, highest = self.prior.impulse
        impulse = log_uniform(rng, (lowest / 2, highest / 8))
        shares = spread(rng, 0.2, self.count)
        return (Impacts(impulse, FORCE_REVERSALS, shares, int(rng.choice([0, 2]))),)

    def spectra(self, labels: tuple[str, ...]) -> Float[np.ndarray, "recording sensor cell"]:
        """Return the power of one recording of each class, in cells of an eighth of an order.

        The first label must be that of a healthy recording: noise and foreign lines are scaled by
        its power.
        """
        trouble_source = TroubleSource(self.prior, self.rng, self.program, self.pump)
        troubles = [trouble_source.draw(label) for label in labels]
        conditions = self._draw_conditions(len(labels))
        speeds = np.array([condition.speed for condition in conditions])
        frequency = speeds[:, None] * self.orders
        hertz = frequency / (2 * math.pi)

        shell, floors, transfer = self._respond(troubles, conditions, frequency)
        path = self._path(hertz)
        mixing = self._draw_mixing(len(labels))
        lines = np.abs(mixing @ (shell * path)) ** 2 / 2
        healthy_power = float(lines[0].sum(axis=-1).mean())

        transmission = np.abs(transfer[None] * path[:, None]) ** 2
        floor = np.einsum("rdl,rdsl->rsl", floors, transmission)
        floor = floor + self._noise(hertz, np.abs(path) ** 2, troubles) * healthy_power
        floor_cells = np.repeat(floor, CELLS, axis=-1)[..., : CELLS * self.highest] / CELLS

        power = lines[..., 1:] @ self._smear() + floor_cells
        power += healthy_power * self._foreign(troubles)
        # The mean of independent periodograms scatters as a gamma distribution.
        averages = self.rng.gamma(_AVERAGES, 1 / _AVERAGES, power.shape)
        return np.asarray(power * averages)

    def _draw_conditions(self, count: int) -> list[OperatingCondition]:
        """Return the operating point of each recording, near the one that the pump is set to."""
        prior = self.prior
        rng = self.rng
        mean_temperature = rng.uniform(*prior.temperature)
        speed_setting = prior.speed_setting * self.setting
        pressure_setting = prior.pressure_setting * self.setting

        conditions = []
        for _ in range(count):
            speed = self.speed * (1 + speed_setting * rng.uniform(-1, 1))
            pressure = self.pressure * (1 + pressure_setting * rng.uniform(-1, 1))
            drift = rng.uniform(*prior.temperature) - mean_temperature
            conditions.append(
                OperatingCondition(
                    speed=speed,
                    discharge_pressure=pressure,
                    oil_temperature=mean_temperature + drift * self.warming,
                )
            )
        return conditions

    def _respond(
        self,
        troubles: Sequence[Trouble],
        conditions: Sequence[OperatingCondition],
        frequency: Float[np.ndarray, "recording line"],
    ) -> tuple[
        Complex[np.ndarray, "recording sensor line"],
        Float[np.ndarray, "recording direction line"],
        Complex[np.ndarray, "direction sensor line"],
    ]:
        """Return what ideal sensors read, the power of irregular impacts, and their transfer.

        The second is a power of force [N^2 per order] along each direction of `_directions`, the
        third what the sensors read of a unit force along each.
        """
        forces = []
        worn_values = []
        floors = []
        for trouble, condition, lines in zip(troubles, conditions, frequency, strict=True):
            force, values = self._forces(trouble, condition, lines)
            impact_force, floor = self._impacts(trouble, condition)
            forces.append(force + torch.as_tensor(impact_force))
            worn_values.append(values)
            floors.append(floor)

        supports = torch.as_tensor(spread(self.rng, self.prior.supports, 9))
        supports = supports.expand(len(troubles), 9)
        values = torch.stack(worn_values)
        damping = self.structure.damping(values)
        stiffness = self.structure.stiffness(
            values, supports[:, 0], supports[:, 1], supports[:, 2:]
        )

        solver = physics.HarmonicBalance()
        mass = self.structure.mass
        along = torch.as_tensor(frequency)
        motion = solver.steady_state(mass, damping, stiffness, along, torch.stack(forces))

        # A stiffness that turns with the shaft acts to first order only: the iteration of a twin
        # would not converge for the largest of these faults.
        for row, trouble in enumerate(troubles):
            recording = slice(row, row + 1)
            equations = (mass, damping[recording], stiffness[recording], along[recording])
            for term in self._turning_terms(trouble, worn_values[row]):
                reaction = physics.turning_force(term.stiffness, term.order, motion[recording])
                motion[recording] -= solver.steady_state(*equations, reaction)

        directions = torch.stack(list(_directions(self.structure)))[:, None, :]
        unit_forces = directions.expand(-1, self.orders.size, -1).to(motion.dtype)
        struck = solver.steady_state(mass, damping[:1], stiffness[:1], along[:1], unit_forces)

        shell = self._read(along, motion)
        transfer = self._read(along[:1], struck)
        return shell, np.array(floors), transfer

    def _turning_terms(
        self, trouble: Trouble, values: Float[torch.Tensor, " 6"]
    ) -> Iterator[physics.PeriodicTerm]:
        """Yield the terms of stiffness that turn with the shaft, of all faults of a recording."""
        for fault in trouble.faults:
            yield from physics.turning_terms(fault, self.pump, values)

    def _read(
        self, frequency: torch.Tensor, motion: torch.Tensor
    ) -> Complex[np.ndarray, "row sensor line"]:
        """Return what ideal sensors read of a motion."""
        gain = torch.ones(len(motion), dtype=torch.float64)
        signal: np.ndarray = physics.read_sensors(self.structure, frequency, motion, gain).numpy()
        return signal

    def _draw_mixing(self, count: int) -> Float[np.ndarray, "recording sensor sensor"]:
        """Return how much each sensor (row) reads of each direction (column), by recording."""
        cross_talk = self.rng.normal(
            0, self.prior.cross_talk, (count + 1, self.sensors, self.sensors)
        )
        cross_talk *= 1 - np.eye(self.sensors)
        return np.asarray(np.eye(self.sensors) + cross_talk[0] + self.care * cross_talk[1:])

    def _forces(
        self, trouble: Trouble, condition: OperatingCondition, frequency: Float[np.ndarray, " line"]
    ) -> tuple[Complex[torch.Tensor, "line 13"], Float[torch.Tensor, " 6"]]:
        """Return the force lines of pressures and faults from order 0 on, and interface values."""
        pump = self.pump
        viscosity = pump.oil.viscosity_at(condition.oil_temperature) / pump.oil.viscosity
        assembled = self.values * spread(self.rng, self.prior.assembly * self.care, 6)
        assembled[::2] *= viscosity**self.exponent  # the damping values

        values = torch.as_tensor(assembled)
        clearances = self.clearances.copy()
        pressing: Fault | None = None  # the fault that changes the chamber pressures
        straining = torch.zeros(self.orders.size, 13, dtype=torch.complex128)
        for fault in trouble.faults:
            values = physics.worn_values(pump, fault, values)
            if isinstance(fault, PistonWear):
                clearances[fault.piston] += fault.clearance
                continue

            if not isinstance(fault, BoreDefect):
                pressing = fault
            motion = self._fault_motion(fault, condition, frequency)
            force = physics.fault_forces(
                pump, self.structure, "T1", fault, values, frequency, motion
            )
            if isinstance(fault, BoreDefect) and self.program:
                force = force * self.one_sided
            straining += force
            contact = physics.contact_lines(fault, pump, condition, self.highest, "T1")
            if contact is not None:
                straining += torch.as_tensor(contact)

        eccentricity = pump.masses.rotor_eccentricity * trouble.unbalance
        unbalanced = replace(pump, masses=replace(pump.masses, rotor_eccentricity=eccentricity))
        case = physics.LoadCase(unbalanced, condition, pressing, tuple(clearances.tolist()))
        loads = torch.as_tensor(physics.force_lines(case, self.highest))
        return straining + loads, values

    def _fault_motion(
        self, fault: Fault, condition: OperatingCondition, frequency: Float[np.ndarray, " line"]
    ) -> Complex[np.ndarray, " line"]:
        """Return the displacement lines that a fault imposes, with unequal slippers."""
        motion = physics.excitation_lines(self.pump, condition, fault, self.highest)
        if not isinstance(fault, SwashPlateDefect):
            return motion

        is_lifting = fault.contact == "lift_off"
        follow_recess = physics.riding_lines if is_lifting else physics.displacement_lines
        motion[1:] = follow_recess(self.pump, condition, fault, self.highest, scatter=self.slippers)
        if fault.contact == "shared":
            hertz = frequency / (2 * math.pi)
            motion = motion / (1 + (hertz / self.following) ** 2)
        return motion

    def _impacts(
        self, trouble: Trouble, condition: OperatingCondition
    ) -> tuple[Complex[np.ndarray, "line 13"], Float[np.ndarray, "direction line"]]:
        """Return the force lines of impacts, and the power of their irregularity.

        The power [N^2 per order] is along each direction of `_directions`.
        """
        shaft_frequency = condition.shaft_frequency
        directions = [row.numpy() for row in _directions(self.structure)]
        frequency = self.orders * shaft_frequency
        piston_angles = 2 * np.pi * np.arange(self.count) / self.count

        # Spectrum of a half-sine pulse; its removable pole at half a cycle is filled in.
        cycles = frequency * self.pulse
        pulse_shape = np.where(
            np.abs(cycles - 0.5) < 1e-3,
            math.pi / 4,
            np.cos(np.pi * cycles) / (1 - 4 * cycles**2 + 1e-12),
        )
        ringing = self.ringing.response(torch.as_tensor(frequency)).numpy()[0]
        transmitted = pulse_shape * ringing

        lines = np.zeros((self.orders.size, 13), dtype=complex)
        floor = np.zeros((len(directions), self.orders.size))
        coherence = np.exp(-((self.orders * self.jitter) ** 2) / 2)
        scatter = 1 + self.irregular**2 - coherence**2
        for impacts in (*self.rattle, *trouble.impacts):
            impulse = impacts.impulse * float(spread(self.rng, 0.3 * self.care, 1)[0])
            angles = (np.array(impacts.angles)[:, None] - piston_angles).ravel()
            shares = np.tile(impacts.shares, len(impacts.angles))
            strikes = np.exp(-1j * self.orders[:, None] * angles) @ shares
            amplitude = 2 * shaft_frequency * impulse * transmitted

            direction = impacts.direction
            lines += (amplitude * coherence * strikes)[:, None] * directions[direction]
            floor[direction] += np.abs(amplitude) ** 2 / 2 * (shares**2).sum() * scatter

        lines[0] = 0
        return lines, floor

    def _path(
        self, hertz: Float[np.ndarray, "recording line"]
    ) -> Complex[np.ndarray, "recording sensor line"]:
        """Return the factor of housing, mounting and gain on what each sensor reads."""
        prior = self.prior
        rng = self.rng
        modes = draw_modes(rng, prior.modes, self.sensors, prior.mode_frequency, prior.mode_share)
        housing = modes.response(torch.as_tensor(hertz)).numpy()

        resonance = np.array([log_uniform(rng, prior.mounting) for _ in range(self.sensors)])
        resonance = resonance * spread(rng, 0.03 * self.care, (len(hertz), self.sensors))
        ratio = hertz[:, None] / resonance[..., None]
        gain = spread(rng, 0.05 * self.care, (len(hertz), self.sensors, 1))
        return housing * gain / (1 - ratio**2 + 0.1j * ratio)

    def _noise(
        self,
        hertz: Float[np.ndarray, "recording line"],
        response: Float[np.ndarray, "recording sensor line"],
        troubles: list[Trouble],
    ) -> Float[np.ndarray, "recording sensor line"]:
        """Return the power of the noise in each order over that of a healthy recording.

        It is pink below 300 Hz, colored by the housing and at random. A fault raises all of it, or
        mainly the high frequencies.
        """
        prior = self.prior
        rng = self.rng
        frequency = np.maximum(hertz[0], 10)
        tilt = rng.uniform(-0.5, 0.5)
        corner_frequency = log_uniform(rng, (2e3, 8e3))
        pink = 1 + 300 / np.maximum(frequency, 30)
        color = pink / (1 + (frequency / corner_frequency) ** 2)
        color = response * color * (frequency / 1000) ** tilt
        color[..., 0] = 0
        share = color / color[0].sum(axis=-1, keepdims=True)
        size = log_uniform(rng, prior.noise) ** 2 * spread(rng, 0.3, (self.sensors, 1)) * share

        deviation = log_uniform(rng, prior.noise_scatter)
        log_power = rng.normal(0, deviation, (len(troubles), 1, 1))
        log_power = log_power + smooth_curves(
            rng, deviation / 2, (len(troubles), self.sensors), frequency
        )

        rise = np.array([trouble.noise for trouble in troubles])[:, None, None]
        rise_corner = log_uniform(rng, (50.0, 3000.0))
        rise_slope = rng.uniform(0, 2)
        high_pass = 1 / (1 + (rise_corner / frequency) ** rise_slope)
        shape = high_pass * np.exp(smooth_curves(rng, 0.3, (len(troubles), 1), frequency))
        return np.asarray(size * np.exp(log_power + rise * shape))

    def _smear(self) -> Float[np.ndarray, "order cell"]:
        """Return the share of each line's power in each cell.

        That is the taper's main lobe, widened by the wandering of the speed.
        """
        n_cells = CELLS * self.highest
        orders = self.orders[1:, None]
        wandering = log_uniform(self.rng, self.prior.wandering)
        half_width = np.maximum(wandering * orders * CELLS, 0.3)
        margin = math.ceil(half_width.max())
        reach = np.arange(-margin - 3, margin + 4)

        position = np.linspace(-2, 2, 81)
        lobe = np.cumsum(np.cos(np.pi / 4 * position) ** 4)
        lobe /= lobe[-1]
        upper = np.interp(reach + half_width, position, lobe)
        lower = np.interp(reach - half_width, position, lobe)
        shares = upper - lower
        shares /= shares.sum(axis=1, keepdims=True)

        # Cells below the first would be negative indices; they fall into cell 0 and are cut with
        # those beyond the last one.
        matrix = np.zeros((self.highest, n_cells + reach.size))
        np.put_along_axis(matrix, np.maximum(orders * CELLS + reach, 0), shares, axis=1)
        return matrix[:, :n_cells]

    def _foreign(self, troubles: list[Trouble]) -> Float[np.ndarray, "recording sensor cell"]:
        """Return the power of other sources over that of a healthy recording.

        These are single lines, a second machine and a damaged bearing.
        """
        rng = self.rng
        foreign = self.prior.foreign
        power = np.zeros((len(troubles), self.sensors, CELLS * self.highest))

        for _ in range(rng.poisson(3)):
            order = log_uniform(rng, (0.3, 300))
            self._add_line(power, order, log_uniform(rng, foreign))

        if rng.random() < 0.5:
            ratio = log_uniform(rng, (0.3, 10))
            size = log_uniform(rng, foreign)
            decay = rng.uniform(0.3, 2)
            for harmonic in range(1, 20):
                self._add_line(power, ratio * harmonic, size / harmonic**decay)

        for row, trouble in enumerate(troubles):
            if trouble.bearing:
                self._add_bearing(power, row, trouble.bearing)
        return power

    def _add_bearing(self, power: np.ndarray, row: int, size: float) -> None:
        """Add the harmonics of a damaged bearing, with sidebands at the shaft's frequency."""
        ratio = self.rng.uniform(2.5, 9.5)
        decay = self.rng.uniform(0, 1.5)
        for harmonic in range(1, 30):
            for sideband in (-1, 0, 1):
                share = 0.3 if sideband else 1
                line_power = size / 30 * share / harmonic**decay
                self._add_line(power, ratio * harmonic + sideband, line_power, row)

    def _add_line(
        self, power: np.ndarray, order: float, size: float, row: int | None = None
    ) -> None:
        """Add a line over three cells to one recording, or to all with a spread between them."""
        cell = round(order * CELLS)
        if not 1 < cell < power.shape[-1] - 1:
            return

        cells = slice(cell - 1, cell + 2)
        line = size * spread(self.rng, 1.0, (self.sensors, 1)) * np.array([0.2, 0.6, 0.2])
        if row is None:
            power[..., cells] += line * spread(self.rng, 0.5, (len(power), 1, 1))
        else:
            power[row, :, cells] += line


def _directions(structure: physics.Structure) -> tuple[torch.Tensor, ...]:
    """Return the unit forces along which impacts act, in the order of `Impacts.direction`."""
    axial = torch.zeros(13, dtype=torch.float64)
    axial[7] = 1.0
    axial[2] = -1.0
    return structure.slipper_vector, structure.lateral_vector, axial
