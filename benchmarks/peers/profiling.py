"""Where the time of one value and gradient in steady state goes: arithmetic, or what surrounds it."""

from typing import Any

import torch
from torch.profiler import ProfilerActivity, profile

from peers.measuring import seconds, settle
from peers.ours import Steady
from peers.problem import Probe, Problem, pump_twin
from peers.throughput import gradient_of_sets
from swashtwin.physics import HarmonicBalance

SETS = 200
CALLS = 20


def shares() -> dict[str, Any]:
    """Times [s] of one value and gradient, and the shares of its parts.

    `arithmetic` is what one more set of values costs in a batch, where nothing is done once per call but work on
    numbers; the rest, `fixed`, is paid once however many sets there are: Python, and PyTorch's handling of its
    operations. `solves` is what the two solutions of the equations, forward and backward, take by themselves.
    """
    settle()
    contender = Steady(Problem())
    values = pump_twin().values.numpy()
    contender.gradient(values)
    per_gradient = seconds(lambda: contender.gradient(values))
    single, many = (gradient_of_sets(count) for count in (1, SETS))
    single(), many()
    in_batch = (seconds(many) - seconds(single)) / (SETS - 1)
    probe = Probe()
    pump_twin().acceleration(solver=probe)
    solve = seconds(lambda: HarmonicBalance().steady_state(*probe.given))
    with profile(activities=[ProfilerActivity.CPU]) as record:
        for _ in range(CALLS):
            contender.gradient(values)
    operations = sum(event.count for event in record.key_averages() if event.key.startswith("aten::")) / CALLS
    return {
        "one_s": per_gradient,
        "one_more_set_s": in_batch,
        "one_solve_s": solve,
        "operations": round(operations),
        "threads": torch.get_num_threads(),
        "shares": {
            "arithmetic": in_batch / per_gradient,
            "fixed": 1 - in_batch / per_gradient,
            "solves": 2 * solve / per_gradient,
        },
    }
