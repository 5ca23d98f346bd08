"""Many sets of values at once, and many synthetic windows."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from peers.measuring import seconds, settle
from peers.problem import Problem, pump_twin
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.signals import add_noise
from swashtwin.synthesis import simulate_windows

WINDOW, SAMPLE_RATE = 2048, 25600.0
CORES = 2
"""The cores that the windows may use."""


def sets_of_values(count: int) -> np.ndarray:
    """Values (set, 6) spread by 30 % around the nominal ones."""
    spread = np.exp(np.random.default_rng(0).normal(0, 0.3, (count, 6)))
    return pump_twin().values.numpy() * spread


def ours(count: int) -> float:
    """Time [s] of one value and gradient for each of `count` sets, as one batch in steady state."""
    settle()
    run = gradient_of_sets(count)
    run()
    return seconds(run)


def gradient_of_sets(count: int) -> Callable[[], Tensor]:
    """Slopes of the sum of squared lines of so many sets, in one batch."""
    twin = pump_twin()
    values = torch.tensor(sets_of_values(count), requires_grad=True)
    return lambda: torch.autograd.grad(twin.acceleration(values).abs().square().sum(), values)[0]


def eager(count: int, n_steps: int) -> float:
    """The same through a batched eager loop of `n_steps` [s per step]."""
    settle()
    run = eager_batch(count, n_steps)
    run()
    return seconds(run) / n_steps


def eager_batch(count: int, n_steps: int) -> Callable[[], Tensor]:
    """Sum of squares of the velocities of `count` sets, and its slopes, through a loop that autograd records."""
    problem = Problem(n_steps)
    values = torch.tensor(sets_of_values(count), requires_grad=True)
    slopes, weight = torch.as_tensor(problem.state_slopes), torch.as_tensor(problem.push_weight)
    load, motion = torch.as_tensor(problem.load), torch.as_tensor(problem.motion)
    rows = torch.as_tensor(problem.sensor_rows)
    start = torch.as_tensor(problem.start).expand(count, 1, 26)

    def gradient() -> Tensor:
        turned = (slopes[0] + torch.tensordot(values, slopes[1:], 1)).mT
        push = load[:, None, None] + torch.einsum("tm,mdp,bp->tbd", motion, weight, values)[:, :, None]
        h, given, x, states = problem.step, push.unbind(0), start, [start]
        for i in range(0, len(given) - 1, 2):
            k1 = torch.baddbmm(given[i], x, turned)
            k2 = torch.baddbmm(given[i + 1], torch.add(x, k1, alpha=h / 2), turned)
            k3 = torch.baddbmm(given[i + 1], torch.add(x, k2, alpha=h / 2), turned)
            k4 = torch.baddbmm(given[i + 2], torch.add(x, k3, alpha=h), turned)
            x = torch.add(x, torch.add(k1 + k4, k2 + k3, alpha=2), alpha=h / 6)
            states.append(x)
        loss = (torch.stack(states) @ rows.T).square().sum()
        return torch.autograd.grad(loss, values)[0]

    return gradient


def jax(count: int, n_steps: int) -> float:
    """The same through JAX's scan under `vmap` [s per step]."""
    settle()
    run = jax_batch(count, n_steps)
    run()
    return seconds(run) / n_steps


def jax_batch(count: int, n_steps: int) -> Callable[[], Any]:
    """Sum of squares of the velocities of `count` sets, and its slopes, through `vmap` of a jitted scan."""
    import jax as jx
    import jax.numpy as jnp

    from peers.jax_side import JaxScanAgain

    scan = JaxScanAgain(Problem(n_steps))
    values = jnp.asarray(sets_of_values(count))

    def loss(at: jx.Array, tables: tuple[jx.Array, jx.Array]) -> jx.Array:
        return jnp.sum(jx.vmap(lambda values: scan.motion_of(values, tables))(at) ** 2)

    compiled = jx.jit(jx.grad(loss)).lower(values, scan.tables).compile()
    return lambda: jx.block_until_ready(compiled(values, scan.tables))


def measured_windows() -> WindowSet:
    """Windows as a machine would give them, from which synthetic ones take layout and noise."""
    twin = pump_twin()
    label = twin.label
    recordings = []
    for model in (twin, twin.with_fault(None)):
        recording = model.simulate(2.0, SAMPLE_RATE, recording_id=model.label)
        recordings.append(replace(recording, signal=add_noise(recording.signal, 20.0, 0), synthetic=False))
    return cut_windows(recordings, length=WINDOW, classes=("normal", label))


def windows(counts: tuple[int, ...]) -> dict[str, Any]:
    """Wall time [s] of so many synthetic windows, each with its own values, severity, phase and noise."""
    settle(CORES)
    like = measured_windows()
    twin = pump_twin()
    simulate_windows(twin, count=2, like=like, seed=9)
    wall = {}
    for count in counts:
        started = time.perf_counter()
        synthetic = simulate_windows(twin, count=count, like=like, seed=count)
        wall[count] = time.perf_counter() - started
        assert synthetic.signal.shape == (count, len(like.channels), WINDOW)
    return {
        "count": counts[-1],
        "wall_s": wall[counts[-1]],
        "at": {str(count): value for count, value in wall.items()},
        "linear_fit": linear_fit(wall),
    }


def linear_fit(wall: dict[int, float]) -> dict[str, float]:
    """Straight line through time over count, and the power of the count with which the time grows."""
    counts, times = np.array(list(wall)), np.array(list(wall.values()))
    slope, start = np.polyfit(counts, times, 1)
    power = np.polyfit(np.log(counts), np.log(times), 1)[0]
    return {"seconds_per_window": float(slope), "start_s": float(start), "power": float(power)}
