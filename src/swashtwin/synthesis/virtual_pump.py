"""Virtual pumps: power spectra of recordings what no twin knows drawn at random, and what faults
change.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Int, Shaped
from joblib import delayed

from swashtwin import physics
from swashtwin.foundation import InputError, SwashTwinError, parallel, random_stream
from swashtwin.pump import (
    CLASSES,
    BoreDefect,
    Fault,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
)
from swashtwin.signals import OrderBands
from swashtwin.synthesis.pump_prior import (
    OTHER,
    Impacts,
    PumpPrior,
    Trouble,
    Troubles,
    draw_drawing,
    drawn_modes,
    log_uniform,
    operating_range,
    smooth_curves,
    spread,
)

CELLS = 8
"""Cells of a spectrum from order to order: segments are eight turns long."""
_AVERAGES = 12
"""Segments whose spectra a recording averages: 4 s at 14 turns a second hold 13 that overlap by
half.
"""


@dataclass(eq=False)
class VirtualPump:
    """One pump of a prior, and all that is the same in its recordings."""

    prior: PumpPrior
    rng: np.random.Generator
    drawing: Pump
    highest: int

    def __post_init__(self) -> None:
        prior, rng = self.prior, self.rng
        self.program = int(rng.integers(3))  # `Troubles.program`
        nominal, timing = self.drawing, rng.normal(0, prior.timing, 2)
        plate = nominal.valve_plate
        plate = replace(
            plate,
            discharge_open=plate.discharge_open + timing[0],
            suction_open=plate.suction_open + timing[1],
        )
        eccentricity = nominal.masses.rotor_eccentricity * float(spread(rng, prior.unbalance, 1)[0])
        self.pump = replace(
            nominal,
            masses=replace(nominal.masses, rotor_eccentricity=eccentricity),
            valve_plate=plate,
        )
        self.count = nominal.rotating_group.piston_count
        group = nominal.rotating_group
        self.clearances = group.piston_clearance * np.clip(
            rng.normal(1, prior.clearances, self.count), 0.3, None
        )
        self.slippers = rng.normal(1, prior.slippers, self.count)
        self.care = log_uniform(rng, prior.care)
        self.setting = log_uniform(rng, prior.care)
        self.warming = rng.random()
        speed, pressure = operating_range(nominal, prior)
        self.speed, self.pressure = rng.uniform(*speed), rng.uniform(*pressure)
        self.values = np.array(nominal.interfaces.values()) * spread(rng, prior.interfaces, 6)
        self.exponent = rng.uniform(*prior.viscosity)
        self.following = log_uniform(rng, prior.following)
        self.orders = np.arange(self.highest + 1)
        self.structure = physics.assemble(self.pump)
        self.sensors = len(self.structure.sensor_rows)
        self.pulse = log_uniform(rng, prior.pulse)
        self.irregular, self.jitter = rng.uniform(*prior.irregular), math.radians(rng.uniform(0, 3))
        self.one_sided = rng.random()
        self.ringing = drawn_modes(rng, int(rng.integers(0, 4)), 1, prior.ringing, 0.5)
        self.rattle: tuple[
            Impacts, ...
        ] = ()  # of a healthy pump, where the force on each piston changes its sign
        if self.program and rng.random() < 0.5:
            impulse = log_uniform(rng, (prior.impulse[0] / 2, prior.impulse[1] / 8))
            shares = spread(rng, 0.2, self.count)
            self.rattle = (
                Impacts(impulse, tuple(np.radians([8.0, 188.0])), shares, int(rng.choice([0, 2]))),
            )

    def spectra(self, labels: tuple[str, ...]) -> Float[np.ndarray, "recording sensor cell"]:
        """Power of one recording of each class in each cell of an eighth of an order, from 0 on."""
        prior, rng, pump = self.prior, self.rng, self.pump
        draws = Troubles(prior, rng, self.program, pump)
        troubles = [draws.of(label) for label in labels]
        warm = rng.uniform(*prior.temperature)
        conditions = [
            OperatingCondition(
                speed=self.speed * (1 + prior.speed_setting * self.setting * rng.uniform(-1, 1)),
                discharge_pressure=self.pressure
                * (1 + prior.pressure_setting * self.setting * rng.uniform(-1, 1)),
                oil_temperature=warm + (rng.uniform(*prior.temperature) - warm) * self.warming,
            )
            for _ in labels
        ]
        frequency = np.array([condition.speed for condition in conditions])[:, None] * self.orders
        hertz = frequency / (2 * math.pi)
        forces, worn, floors = [], [], []
        for trouble, condition, along in zip(troubles, conditions, frequency, strict=True):
            force, values = self._forces(trouble, condition, along)
            beating, floor = self._impacts(trouble, condition)
            forces.append(force + torch.as_tensor(beating))
            worn.append(values)
            floors.append(floor)
        supports = torch.as_tensor(spread(rng, prior.supports, 9)).expand(len(labels), 9)
        damping = self.structure.damping(torch.stack(worn))
        stiffness = self.structure.stiffness(
            torch.stack(worn), supports[:, 0], supports[:, 1], supports[:, 2:]
        )
        along, force = torch.as_tensor(frequency), torch.stack(forces)
        solver = physics.HarmonicBalance()
        motion = solver.steady_state(self.structure.mass, damping, stiffness, along, force)
        for row, (trouble, values) in enumerate(zip(troubles, worn, strict=True)):
            for fault in trouble.faults:
                for term in physics.turning_terms(fault, pump, values):
                    further = _turned(term.stiffness, motion[row])
                    one = slice(row, row + 1)
                    motion[row] += solver.steady_state(
                        self.structure.mass, damping[one], stiffness[one], along[one], further[None]
                    )[0]
        directions = torch.stack(list(_directions(self.structure)))[:, None, :].expand(
            -1, self.orders.size, -1
        )
        struck = solver.steady_state(
            self.structure.mass, damping[:1], stiffness[:1], along[:1], directions.to(motion.dtype)
        )
        rows = self.structure.sensor_rows.numpy()
        shell = np.einsum("rlk,sk->rsl", motion.numpy(), rows) * -(frequency[:, None] ** 2)
        transfer = np.einsum("dlk,sk->dsl", struck.numpy(), rows) * -(frequency[:1, None] ** 2)
        path = self._path(hertz)
        cross_talk = rng.normal(0, prior.cross_talk, (len(labels) + 1, self.sensors, self.sensors))
        cross_talk *= 1 - np.eye(self.sensors)
        mixing = np.eye(self.sensors) + cross_talk[0] + self.care * cross_talk[1:]
        lines = np.abs(mixing @ (shell * path)) ** 2 / 2
        healthy = float(lines[0].sum(axis=-1).mean())
        floor = np.einsum(
            "rdl,rdsl->rsl", np.array(floors), np.abs(transfer[None] * path[:, None]) ** 2
        )
        floor = floor + self._noise(hertz, np.abs(path) ** 2, troubles) * healthy
        power = (
            lines[..., 1:] @ self._smear()
            + np.repeat(floor, CELLS, axis=-1)[..., : CELLS * self.highest] / CELLS
        )
        power += healthy * self._foreign(troubles)
        averages = rng.gamma(_AVERAGES, 1 / _AVERAGES, power.shape)
        return np.asarray(power * averages)

    def _forces(
        self, trouble: Trouble, condition: OperatingCondition, frequency: Float[np.ndarray, " line"]
    ) -> tuple[Complex[torch.Tensor, "line 13"], Float[torch.Tensor, " 6"]]:
        """Force lines from order 0 on of pressures and faults, and the interface values."""
        prior, rng, pump = self.prior, self.rng, self.pump
        viscosity = pump.oil.viscosity_at(condition.oil_temperature) / pump.oil.viscosity
        assembled = self.values * spread(rng, prior.assembly * self.care, 6)
        assembled[::2] *= viscosity**self.exponent
        values = torch.as_tensor(assembled)
        clearances = self.clearances.copy()
        pressing: Fault | None = None
        straining = torch.zeros(self.orders.size, 13, dtype=torch.complex128)
        for fault in trouble.faults:
            values = physics.worn_values(pump, fault, values)
            if isinstance(fault, PistonWear):
                clearances[fault.piston] += fault.clearance
                continue
            if not isinstance(fault, BoreDefect):
                pressing = fault
            motion = physics.excitation_lines(pump, condition, fault, self.highest)
            if isinstance(fault, SwashPlateDefect):
                law = (
                    physics.riding_lines
                    if fault.contact == "lift_off"
                    else physics.displacement_lines
                )
                motion[1:] = law(pump, condition, fault, self.highest, scatter=self.slippers)
                if fault.contact == "shared":
                    motion = motion / (1 + (frequency / (2 * math.pi * self.following)) ** 2)
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
        return straining + torch.as_tensor(physics.force_lines(case, self.highest)), values

    def _impacts(
        self, trouble: Trouble, condition: OperatingCondition
    ) -> tuple[Complex[np.ndarray, "line 13"], Float[np.ndarray, "direction line"]]:
        """Force lines of impacts, and the power [N^2 per order] of their irregularity along each
        direction.
        """
        shaft, directions = (
            condition.shaft_frequency,
            [row.numpy() for row in _directions(self.structure)],
        )
        frequency = self.orders * shaft
        turned = 2 * np.pi * np.arange(self.count) / self.count
        product = frequency * self.pulse
        shape = np.where(
            np.abs(product - 0.5) < 1e-3,
            math.pi / 4,
            np.cos(np.pi * product) / (1 - 4 * product**2 + 1e-12),
        )
        heard = shape * self.ringing.response(torch.as_tensor(frequency)).numpy()[0]
        lines = np.zeros((self.orders.size, 13), dtype=complex)
        floor = np.zeros((len(directions), self.orders.size))
        for item in (*self.rattle, *trouble.impacts):
            impulse = item.impulse * float(spread(self.rng, 0.3 * self.care, 1)[0])
            at = (np.array(item.angles)[:, None] - turned).ravel()
            shares = np.tile(item.shares, len(item.angles))
            kept = np.exp(-((self.orders * self.jitter) ** 2) / 2)
            struck = np.exp(-1j * self.orders[:, None] * at) @ shares
            amplitude = 2 * shaft * impulse * heard
            lines += (amplitude * kept * struck)[:, None] * directions[item.direction]
            scatter = 1 + self.irregular**2 - kept**2
            floor[item.direction] += np.abs(amplitude) ** 2 / 2 * (shares**2).sum() * scatter
        lines[0] = 0
        return lines, floor

    def _path(
        self, hertz: Float[np.ndarray, "recording line"]
    ) -> Complex[np.ndarray, "recording sensor line"]:
        """Housing, mounting and gain of each sensor."""
        prior, rng = self.prior, self.rng
        modes = drawn_modes(rng, prior.modes, self.sensors, prior.mode_frequency, prior.mode_share)
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
        """Power of the noise in each order over that of a healthy recording: pink below 300 Hz,
        colored by the housing and at random; a fault raises all of it, or rather the high
        frequencies.
        """
        prior, rng, middle = self.prior, self.rng, np.maximum(hertz[0], 10)
        tilt = rng.uniform(-0.5, 0.5)
        color = (1 + 300 / np.maximum(middle, 30)) / (
            1 + (middle / log_uniform(rng, (2e3, 8e3))) ** 2
        )
        color = response * color * (middle / 1000) ** tilt
        color[..., 0] = 0
        share = color / color[0].sum(axis=-1, keepdims=True)
        size = log_uniform(rng, prior.noise) ** 2 * spread(rng, 0.3, (self.sensors, 1)) * share
        deviation = log_uniform(rng, prior.noise_scatter)
        level = rng.normal(0, deviation, (len(troubles), 1, 1)) + smooth_curves(
            rng, deviation / 2, (len(troubles), self.sensors), middle
        )
        rise = np.array([trouble.noise for trouble in troubles])[:, None, None]
        corner, slope = log_uniform(rng, (50.0, 3000.0)), rng.uniform(0, 2)
        shape = (
            1
            / (1 + (corner / middle) ** slope)
            * np.exp(smooth_curves(rng, 0.3, (len(troubles), 1), middle))
        )
        return np.asarray(size * np.exp(level + rise * shape))

    def _smear(self) -> Float[np.ndarray, "order cell"]:
        """Share of each line's power in each cell: the taper's main lobe, widened by the speed's
        wandering.
        """
        cells, orders = CELLS * self.highest, self.orders[1:, None]
        half = np.maximum(log_uniform(self.rng, self.prior.wandering) * orders * CELLS, 0.3)
        reach = np.arange(-math.ceil(half.max()) - 3, math.ceil(half.max()) + 4)
        at = np.linspace(-2, 2, 81)
        lobe = np.cumsum(np.cos(np.pi / 4 * at) ** 4)
        shares = np.interp(reach + half, at, lobe / lobe[-1]) - np.interp(
            reach - half, at, lobe / lobe[-1]
        )
        shares /= shares.sum(axis=1, keepdims=True)
        matrix = np.zeros((self.highest, cells + reach.size))
        np.put_along_axis(matrix, np.maximum(orders * CELLS + reach, 0), shares, axis=1)
        return matrix[:, :cells]

    def _foreign(self, troubles: list[Trouble]) -> Float[np.ndarray, "recording sensor cell"]:
        """Power over that of a healthy recording of what else runs: single lines, a second machine,
        a bad bearing.
        """
        prior, rng = self.prior, self.rng
        power = np.zeros((len(troubles), self.sensors, CELLS * self.highest))

        def add(order: float, row: slice | int, size: float) -> None:
            cell = round(order * CELLS)
            if 1 < cell < power.shape[-1] - 1:
                of_sensor = size * spread(rng, 1.0, (self.sensors, 1))
                power[row, :, cell - 1 : cell + 2] += (
                    of_sensor
                    * np.array([0.2, 0.6, 0.2])
                    * (spread(rng, 0.5, (len(troubles), 1, 1)) if isinstance(row, slice) else 1)
                )

        for _ in range(rng.poisson(3)):
            add(log_uniform(rng, (0.3, 300)), slice(None), log_uniform(rng, prior.foreign))
        if rng.random() < 0.5:
            ratio, size, fall = (
                log_uniform(rng, (0.3, 10)),
                log_uniform(rng, prior.foreign),
                rng.uniform(0.3, 2),
            )
            for harmonic in range(1, 20):
                add(ratio * harmonic, slice(None), size / harmonic**fall)
        for row, trouble in enumerate(troubles):
            if trouble.bearing:
                ratio, fall = rng.uniform(2.5, 9.5), rng.uniform(0, 1.5)
                for harmonic in range(1, 30):
                    for side in (-1, 0, 1):
                        size = trouble.bearing / 30 * (0.3 if side else 1) / harmonic**fall
                        add(ratio * harmonic + side, row, size)
        return power


def _directions(structure: physics.Structure) -> tuple[torch.Tensor, ...]:
    """Unit forces along which impacts act."""
    axial = torch.zeros(13, dtype=torch.float64)
    axial[7], axial[2] = 1.0, -1.0
    return structure.slipper_vector, structure.lateral_vector, axial


def _turned(matrix: torch.Tensor, motion: torch.Tensor) -> torch.Tensor:
    """Force lines -Re(M exp(i theta)) x of a stiffness that turns with the shaft, to first
    order.
    """
    force = torch.zeros_like(motion)
    force[1:] += motion[:-1] @ matrix.T / 2
    force[1] += motion[0] @ matrix.T / 2
    force[:-1] += motion[1:] @ matrix.conj().T / 2
    return -force


_REFERENCES = 4
"""Healthy recordings of a virtual pump, of which one to all are its reference."""
_TESTED = ("normal", "normal", *(label for label in CLASSES if label != "normal"), OTHER)
"""Classes of the recordings of a virtual pump that are compared with its references."""


@dataclass(frozen=True, eq=False)
class OrderChanges:
    """Changes of the levels of simulated recordings against the healthy ones of their pumps."""

    bands: OrderBands
    """Bands of the drawing's levels; a pump of another number of pistons has as many."""
    change: Float[np.ndarray, "recording channel level"]
    """Level (`OrderBands.log_powers`), less its mean over the pump's reference recordings."""
    label: Shaped[np.ndarray, " recording"]
    pump: Int[np.ndarray, " recording"]
    """Row of its pump."""
    scatter: Float[np.ndarray, "pump channel level"]
    """Standard deviation of the levels between healthy recordings of each pump."""
    drawn: Bool[np.ndarray, " pump"]
    """Whether each pump has a drawing of its own."""


def simulate_changes(
    prior: PumpPrior,
    count: int,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> OrderChanges:
    """Healthy recordings and one of each fault, of `count` virtual pumps, as changes against their
    references.

    Every other pump has a drawing of its own (`draw_drawing`), for no machine is its drawing. Only
    spectra of the steady state are computed, no samples: about 0.1 s of a core for a pump. A pump
    does not depend on how many are drawn with it.

    Parameters
    ----------
    jobs : processes side by side.
    progress : called with the number of pumps that are done, and of all.

    Raises
    ------
    InputError
        Fewer than two pumps, or none whose chamber pressures converge.
    """
    if count < 2:
        raise InputError(f"a pump prior needs two pumps at least, not {count}.")
    work = parallel(jobs, return_as="generator")(
        delayed(_changes_of_pump)(prior, seed, number) for number in range(count)
    )
    parts = []
    for number, part in enumerate(work, 1):
        parts.append(part)
        if progress is not None:
            progress(number, count)
    drawn = np.array(
        [number % 2 == 1 for number, part in enumerate(parts) if part is not None], dtype=bool
    )
    if not drawn.size:
        raise InputError(
            f"no chamber pressure of {count} virtual pumps of {prior.pump.name} converges."
        )
    changes, scatter = zip(*(part for part in parts if part is not None), strict=True)
    return OrderChanges(
        OrderBands(prior.pump.rotating_group.piston_count),
        np.concatenate(changes),
        np.tile(np.array(_TESTED), drawn.size),
        np.repeat(np.arange(drawn.size), len(_TESTED)),
        np.stack(scatter),
        drawn,
    )


def _changes_of_pump(
    prior: PumpPrior, seed: int, number: int
) -> tuple[Float[np.ndarray, "recording channel level"], Float[np.ndarray, "channel level"]] | None:
    """(changes of one pump, its healthy scatter); None where the chamber pressures of a recording
    do not converge.
    """
    torch.set_num_threads(1)
    rng = random_stream(seed, "pump prior", number)
    drawing = draw_drawing(rng) if number % 2 else prior.pump
    bands = OrderBands(drawing.rotating_group.piston_count)
    highest = int(bands.highest * bands.piston_count) + 1
    try:
        power = VirtualPump(prior, rng, drawing, highest).spectra(
            ("normal",) * _REFERENCES + _TESTED
        )
    except SwashTwinError:
        return None
    levels = bands.log_powers(power, 1 / CELLS)
    references = levels[: int(rng.integers(1, _REFERENCES + 1))]
    scatter = levels[:_REFERENCES].std(axis=0, ddof=1)
    return (levels[_REFERENCES:] - references.mean(axis=0)).astype(np.float16), scatter.astype(
        np.float16
    )
