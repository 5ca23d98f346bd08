"""Time and memory of one contender, measured in a process of its own on one core."""

import importlib
import math
import multiprocessing
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from peers.contender import Contender
from peers.problem import SAMPLED_EVERY, STEPS_PER_REVOLUTION, Problem, pump_twin

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "JAX_PLATFORMS": "cpu",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}
BUDGET = 4.0
"""Time [s] that the calls of one measurement may take together; a call that takes longer is made
once.
"""
WARM_UP_STEPS = 16
"""Steps of the small problem whose gradient is taken first, so that what libraries do once is not
counted.
"""


@dataclass(frozen=True)
class Entry:
    """One contender of the table."""

    key: str
    name: str
    module: str
    """Module and class that compute it."""
    of_class: str
    install: str = ""
    """Package without which it cannot run."""
    refine: int = 1
    """Into how many of its own one of the others' steps is cut."""


def settle(cores: int = 1) -> None:
    """Keep this process to `cores` cores and torch to as many threads."""
    import torch

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-cores:])
    torch.set_num_threads(cores)


def alone(function: Callable, *arguments: Any) -> Any:
    """What `function` returns from a fresh process."""
    os.environ.update(ONE_THREAD)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def seconds(run: Callable[[], object], most: int = 500) -> float:
    """Median time [s] of as many calls as the budget allows."""
    times: list[float] = []
    started = time.perf_counter()
    while not times or (len(times) < most and time.perf_counter() - started < BUDGET):
        before = time.perf_counter()
        run()
        times.append(time.perf_counter() - before)
    return float(np.median(times))


def _status(name: str) -> float:
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(name)) / 1024


def peak_memory(run: Callable[[], object]) -> tuple[float, float]:
    """How much memory a call adds at its peak [MB], NaN where the system does not tell; and its
    time [s].
    """
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts anew
        resident = _status("VmRSS")
    except OSError:
        resident = math.nan
    started = time.perf_counter()
    run()
    took = time.perf_counter() - started
    return (math.nan if math.isnan(resident) else _status("VmHWM") - resident), took


def contender_class(entry: Entry) -> type[Contender]:
    """The class; ImportError where its library is missing."""
    return getattr(importlib.import_module(f"peers.{entry.module}"), entry.of_class)


def measured(entry: Entry, n_steps: int) -> dict[str, Any]:
    """Row of the table for `n_steps` of the common steps, and the sensors' motion for
    comparison.
    """
    settle()
    try:
        kind = contender_class(entry)
    except ImportError:
        return {"key": entry.key, "name": entry.name, "missing": f"pip install {entry.install}"}
    cut = {"per_step": kind.per_step, "per_revolution": STEPS_PER_REVOLUTION * entry.refine}
    values = pump_twin().values.numpy()
    kind.rehearsal(Problem(WARM_UP_STEPS, **cut)).gradient(values)
    contender = kind(Problem(n_steps * entry.refine, **cut))
    compile_s = contender.prepare(values)
    results: list[tuple[float, np.ndarray]] = []
    memory_mb, gradient_s = peak_memory(lambda: results.append(contender.gradient(values)))
    if gradient_s < BUDGET:
        gradient_s = seconds(lambda: contender.gradient(values))
    velocities = contender.velocities(values)
    contender.value(values)  # compiles, where there is a compiler
    value_s = seconds(lambda: contender.value(values))
    loss, slopes = results[0]
    return {
        "key": entry.key,
        "name": entry.name,
        "value_s": value_s,
        "gradient_s": gradient_s,
        "memory_mb": memory_mb,
        "steps": contender.steps,
        "compile_s": compile_s,
        "loss": loss,
        "slopes": list(slopes * values),
        "gains": gains(velocities[:: SAMPLED_EVERY * entry.refine]),
    }


def gains(velocities: np.ndarray) -> np.ndarray:
    """Mean acceleration [m/s^2] of each sensor between the compared moments."""
    return np.diff(velocities, axis=0) / (
        SAMPLED_EVERY * pump_twin().condition.period / STEPS_PER_REVOLUTION
    )
