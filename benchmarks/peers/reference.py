"""What the contenders' results are compared with: a quarter of the step, scipy's Radau, and slopes from other code."""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from peers.measuring import gains, settle
from peers.numba_adjoint import Numba
from peers.ours import SteadyRungeKutta
from peers.problem import SAMPLED_EVERY, STEPS_PER_REVOLUTION, Problem, equations, pump_twin

REFINED = 4
RADAU_SHARE = 4
"""Radau follows this fraction of a revolution, which takes it long enough."""


def references(n_steps: int) -> dict[str, Any]:
    """Mean accelerations between the compared moments, and slopes of the loss, all of `n_steps`."""
    settle()
    values = pump_twin().values.numpy()
    fine = Problem(REFINED * n_steps, per_revolution=REFINED * STEPS_PER_REVOLUTION)
    return {
        "quarter": gains(Numba(fine).velocities(values)[:: REFINED * SAMPLED_EVERY]),
        "radau": gains(radau(min(n_steps, STEPS_PER_REVOLUTION // RADAU_SHARE))),
        "steady_slopes": SteadyRungeKutta(fine).gradient(values)[1] * values,
    }


def slopes(n_steps: int) -> np.ndarray:
    """Slopes of the loss of so many steps from numba's discrete adjoint."""
    settle()
    values = pump_twin().values.numpy()
    return Numba(Problem(n_steps)).gradient(values)[1] * values


def radau(n_steps: int) -> np.ndarray:
    """Velocities of the sensors [m/s] at the compared moments, by Radau at a relative tolerance of 1e-10."""
    problem = Problem(n_steps)
    values = problem.nominal
    given = problem.state_slopes
    state = given[0] + np.tensordot(values, given[1:], 1)
    system = equations()
    force = (system.load + system.motion @ (system.weight @ values)) / system.mass
    rates = 1j * pump_twin().condition.speed * pump_twin().orders

    def rate(time: float, x: np.ndarray) -> np.ndarray:
        derivative = state @ x
        derivative[13:] += (np.exp(rates * time) @ force).real
        return derivative

    moments = problem.step * np.arange(0, n_steps + 1, SAMPLED_EVERY)
    floor = 1e-11 * np.abs(problem.start)
    solution = solve_ivp(rate, (0, moments[-1]), problem.start, "Radau", moments, rtol=1e-10, atol=floor, jac=state)
    return solution.y.T @ problem.sensor_rows.T
