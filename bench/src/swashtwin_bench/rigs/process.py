"""What a test stand records beside vibration: pressure and flow at the outlet, and the temperature of the tank.

Pressure and flow are those of the chambers and the outlet line (docs/explanation/physics.md, section 5) of the same
run, at the shaft angle of its vibration; each instrument has an error and a noise of its own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import stream
from swashtwin.physics import ChamberPressures, LoadCase, chamber_pressures
from swashtwin_bench.rigs.measuring import Run, with_steps

PRESSURE_STEP = 25e6 / 2**15
"""Smallest difference [Pa] that the 16-bit converter of the pressure transducer tells apart; its range is 25 MPa."""


@dataclass(frozen=True)
class ProcessChannel:
    """One instrument."""

    name: str
    """Channel name, and name of its index."""
    unit: str
    """Unit of its samples."""
    sample_rate: float
    """Samples per second [Hz]."""


OUTLET_PRESSURE = ProcessChannel("outlet_pressure", "Pa", 25600.0)
OUTLET_FLOW = ProcessChannel("outlet_flow", "m^3/s", 10.0)
TANK_TEMPERATURE = ProcessChannel("tank_temperature", "K", 10.0)

PROCESS = (OUTLET_PRESSURE, OUTLET_FLOW, TANK_TEMPERATURE)
"""Every instrument: the pressure is as fast as the accelerometers and shows its ripple, the others are slow."""


def process_signals(
    run: Run, angle: Float[np.ndarray, " time"], seed: int, name: str
) -> dict[ProcessChannel, Float[np.ndarray, " sample"]]:
    """Samples of each instrument in recording `name`.

    Parameters
    ----------
    angle : shaft angle [rad] at each sample of `OUTLET_PRESSURE`.
    seed : which fleet; it draws the instruments' errors and noise.
    """
    rng = stream(seed, "process", name)
    case = LoadCase(run.specimen.pump, run.condition, run.fault, run.specimen.clearances)
    pressures = with_steps(lambda steps: chamber_pressures([case], steps=steps))
    return {
        OUTLET_PRESSURE: _pressure(pressures, angle, rng),
        OUTLET_FLOW: _flow(pressures, run, angle, rng),
        TANK_TEMPERATURE: _temperature(run, angle, rng),
    }


def _pressure(pressures: ChamberPressures, angle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Absolute pressure of the outlet line [Pa]: gain within 0.2 %, noise of 2 kPa."""
    line = np.interp(angle, pressures.angle, pressures.discharge[0], period=2 * np.pi)
    signal = line * rng.normal(1, 0.002) + rng.normal(0, 2e3, len(angle))
    return np.round(signal / PRESSURE_STEP) * PRESSURE_STEP


def _flow(pressures: ChamberPressures, run: Run, angle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Mean flow of each tenth of a second [m^3/s], which follows the speed: gain within 0.5 %, noise of 0.2 %."""
    ends = np.append(angle, 2 * angle[-1] - angle[-2])[:: round(OUTLET_PRESSURE.sample_rate / OUTLET_FLOW.sample_rate)]
    speed = np.diff(ends) * OUTLET_FLOW.sample_rate
    flow = pressures.flow[0] * speed / run.condition.speed
    return np.asarray(flow * rng.normal(1, 0.005) * rng.normal(1, 0.002, len(flow)))


def _temperature(run: Run, angle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Temperature of the tank [K], 2 K below that of the oil in the pump and slowly changing, to 0.1 K."""
    time = np.arange(len(angle) * TANK_TEMPERATURE.sample_rate // OUTLET_PRESSURE.sample_rate)
    time = time / TANK_TEMPERATURE.sample_rate
    tank = run.condition.oil_temperature - rng.normal(2, 0.5) + rng.uniform(-0.02, 0.02) * time
    return np.round(10 * (tank + rng.normal(0, 0.02, len(time)))) / 10
