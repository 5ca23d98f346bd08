"""What the contenders' results are compared with: a quarter of the step, and slopes from other
code.
"""

from typing import Any

from peers.measuring import gains, settle
from peers.numba_adjoint import Numba
from peers.ours import SteadyRungeKutta
from peers.problem import SAMPLED_EVERY, STEPS_PER_REVOLUTION, Problem, pump_twin

REFINED = 4


def references(n_steps: int) -> dict[str, Any]:
    """Mean accelerations between the compared moments, and slopes of the loss by numba's adjoint
    and by ours.
    """
    settle()
    values = pump_twin().values.numpy()
    fine = Problem(REFINED * n_steps, per_revolution=REFINED * STEPS_PER_REVOLUTION)
    return {
        "quarter": gains(Numba(fine).velocities(values)[:: REFINED * SAMPLED_EVERY]),
        "slopes": Numba(Problem(n_steps)).gradient(values)[1] * values,
        "steady_slopes": SteadyRungeKutta(fine).gradient(values)[1] * values,
    }
