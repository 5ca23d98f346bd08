"""Pressure of every chamber of a pump over the shaft angle.

Each chamber follows dp/dtheta = B / (omega V) [Q_suction - Q_discharge - G (p - p_case)] - B / V
dV/dtheta, and the outlet line follows the sum of the flows into it less that of its relief valve
(docs/explanation/physics.md, section 5). The backward differentiation formula of second order
(BDF2) over a uniform grid of the shaft angle,

    p = (4 p1 - p0) / 3 + 2/3 h f(p),

with p1 and p0 one and two steps earlier: as stable as backward Euler where an open port is stiff,
and of second order (Hairer and Wanner, *Solving Ordinary Differential Equations II*, V.1). Each
step is solved by Newton's method, whose matrix is an arrow (chambers meet only in the line), with a
step halved wherever it changes sign. The loop over the angles is compiled.
"""

import math
from typing import no_type_check

import numpy as np

from swashtwin.foundation import compiled

SMOOTHING = 2e4
"""Pressure difference [Pa] below which the square root law of an orifice turns linear."""
FLOOR = 1e3
"""Lowest pressure [Pa]; oil cavitates rather than fall below it."""
AIR_FLOOR = 5e4
"""Lowest pressure [Pa] at which free air is still compressed as a gas."""
ATMOSPHERE = 1e5
"""Pressure [Pa] at which the fraction of free air is stated."""
TOLERANCE = 100.0
"""Newton step [Pa] after which a pressure is solved: the next one would be smaller by orders of
magnitude, and the error of the steps in the angle is some 10 kPa.
"""
ITERATIONS = 60
"""Newton iterations of one step before it counts as failed."""

_RATE_WEIGHT = 2 / 3
"""Weight of the rate in BDF2; the weights of the two earlier pressures are 4/3 and -1/3."""


@compiled
@no_type_check
def march(over_angle, over_pistons, constants, revolutions, iterations, chamber, line):
    """Fill `chamber` (angle, piston) and `line` (angle) with the last of `revolutions`.

    Returns the step that failed, or 0. Element k of both belongs to the shaft angle
    2 pi (k + 1) / angles. The number of angles must be a multiple of the pistons'. The tables:

    - `over_angle` (angle, 6), of a piston that stands there: flow over the root of the pressure
      difference through the suction and the discharge port [m^3/(s Pa^0.5)], time of a step over
      the volume [s/m^3], growth of the volume [m^3/s], leakage to the case [m^3/(s Pa)], leakage
      along the piston over its clearance cubed [1/(s Pa)];
    - `over_pistons` (2, piston): cube of the clearance [m^3], leakage of a single chamber [m^3/(s
      Pa)];
    - `constants` (8): pressures in the suction port, of the outlet line at the start, and in the
      case [Pa]; 1 over the bulk modulus [1/Pa]; fraction of free air times `ATMOSPHERE` [Pa]; time
      of a step times bulk modulus over the line's volume [Pa s/m^3]; flow of the relief valve over
      the pressure above cracking [m^3/(s Pa)]; that pressure [Pa].
    """
    n_angles, n_pistons = chamber.shape
    suction = constants[0]
    discharge = constants[1]
    case = constants[2]
    softness = constants[3]
    air = constants[4]
    pressure = np.empty(n_pistons)
    step = np.empty((5, n_pistons))
    work = np.empty((5, n_pistons))

    # Chambers whose pistons go in start at the discharge pressure, the others at the suction's.
    for j in range(n_pistons):
        rising = math.sin(2 * math.pi * j / n_pistons) < -1e-9
        pressure[j] = discharge if rising else suction
    line_pressure = discharge

    # The pump has rested before the start.
    earlier_pressure = pressure.copy()
    earlier_line = line_pressure

    stride = n_angles // n_pistons
    for index in range(1, revolutions * n_angles + 1):
        end = (index - 1) % n_angles
        for j in range(n_pistons):
            row = end + 1 + j * stride
            here = over_angle[row if row < n_angles else row - n_angles]
            history = (4 * pressure[j] - earlier_pressure[j]) / 3
            expected = 2 * pressure[j] - earlier_pressure[j]
            earlier_pressure[j] = pressure[j]
            pressure[j] = max(expected, FLOOR)

            # Compressibility of oil and of its free air, which is isothermal.
            total_softness = softness + air / max(expected, AIR_FLOOR) ** 2
            compliance = _RATE_WEIGHT * here[2] / total_softness
            leakage = here[4] + here[5] * over_pistons[0, j] + over_pistons[1, j]
            step[0, j] = here[0]
            step[1, j] = here[1]
            step[2, j] = compliance
            step[3, j] = leakage
            step[4, j] = history + compliance * (leakage * case - here[3])

        line_history = (4 * line_pressure - earlier_line) / 3
        earlier_line = line_pressure
        line_pressure = _newton(
            step, constants, iterations, work, pressure, line_pressure, line_history
        )
        if math.isnan(line_pressure):
            return index
        chamber[end] = pressure
        line[end] = line_pressure
    return 0


@compiled
@no_type_check
def _newton(step, constants, iterations, work, pressure, line, line_history):
    """Solve one step into `pressure`; return the outlet line's pressure, NaN without convergence.

    `pressure` and `line` hold the start of the iteration. `line_history` is what the line's
    pressure would be without a flow.

    The matrix is an arrow: each chamber meets only the line. Its rows are eliminated one by one,
    which leaves one equation for the change of the line's pressure.
    """
    suction = constants[0]
    line_compliance = _RATE_WEIGHT * constants[5]
    relief = constants[6]
    cracking = constants[7]
    residual = work[0]
    diagonal = work[1]
    through = work[2]
    damping = work[3]
    previous_change = work[4]
    damping[:] = 1.0
    previous_change[:] = 0.0
    n_pistons = pressure.size
    for _ in range(iterations):
        flow_sum = 0.0
        slope_sum = 0.0
        pushed = 0.0
        answered = 0.0
        for j in range(n_pistons):
            flow_in, slope_in = orifice(step[0, j], suction - pressure[j])
            flow_out, slope_out = orifice(step[1, j], pressure[j] - line)
            residual[j] = (
                pressure[j]
                - step[4, j]
                - step[2, j] * (flow_in - flow_out - step[3, j] * pressure[j])
            )
            diagonal[j] = 1 + step[2, j] * (slope_in + slope_out + step[3, j])
            through[j] = -step[2, j] * slope_out
            from_chamber = -line_compliance * slope_out / diagonal[j]
            flow_sum += flow_out
            slope_sum += slope_out
            pushed += from_chamber * residual[j]
            answered += from_chamber * through[j]

        excess = line - cracking
        line_residual = (
            line - line_history - line_compliance * (flow_sum - relief * max(excess, 0.0))
        )
        line_diagonal = 1 + line_compliance * (slope_sum + relief * (excess > 0))
        line_change = (pushed - line_residual) / (line_diagonal - answered)

        # A change of the other sign has passed the solution: its step is halved, and then regrows.
        largest_change = 0.0
        min_damping = 1.0
        for j in range(n_pistons):
            change = (-residual[j] - through[j] * line_change) / diagonal[j]
            if change * previous_change[j] < 0:
                damping[j] = 0.5 * damping[j]
            else:
                damping[j] = min(1.0, 1.5 * damping[j])
            previous_change[j] = change
            updated = max(pressure[j] + damping[j] * change, FLOOR)
            largest_change = max(largest_change, abs(updated - pressure[j]))
            min_damping = min(min_damping, damping[j])
            pressure[j] = updated
        line += min_damping * line_change

        if max(largest_change / min_damping, abs(line_change)) < TOLERANCE:
            return line
    return math.nan


@compiled
@no_type_check
def orifice(opening, difference):
    """Return the flow through an orifice under a pressure `difference`, and its derivative."""
    if opening == 0.0:
        return 0.0, 0.0

    root = abs(difference) + SMOOTHING
    slope = opening / math.sqrt(root)
    return slope * difference, slope * (1 - 0.5 * abs(difference) / root)
