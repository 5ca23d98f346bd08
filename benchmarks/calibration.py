"""Time of a calibration against the same loss through an eager Runge-Kutta loop.

    python benchmarks/calibration.py --json
    python benchmarks/calibration.py --recovery 5

The rival is what the paper's text describes: plain PyTorch steps the equations with fourth-order Runge-Kutta inside the
loss, drops start-up revolutions, transforms the last one, and differentiates through it all. It is written without
avoidable waste (`addmv`, `unbind`, no indexing of tensors inside the loop). Timed are some hundred of its steps; a full
loss takes hundreds of thousands, to which time and memory are extrapolated in proportion. `error` of a loss is that
against harmonic balance; of a method, that of C_v and C_Hz against the truth. Each row runs in a process of its own, so
that its memory is its own peak.
"""

import argparse
import json
import math
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from peers.measuring import alone, seconds, settle
from peers.problem import FACTORS, Probe, pump_twin
from torch import Tensor

from swashtwin.calibration import (
    IPINN,
    PAPER_CALIBRATION,
    GaussNewton,
    Objective,
    calibrate,
    measure,
    objective_of,
)
from swashtwin.physics import RK4, HarmonicBalance, SteadySolver, Twin
from swashtwin.physics.solvers.runge_kutta import rk4_limits, state_matrix
from swashtwin.pump import Interfaces
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise

REVOLUTIONS = 4
"""The rival's simulated revolutions: three die away, the fourth is compared."""
STEPS = 400
"""Steps of the rival that are timed."""
EPOCHS = 500


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    value_s: float
    gradient_s: float
    memory_mb: float
    error: float


def narrow_twin() -> Twin:
    """The paper's pump, condition and defect, in the band that is compared."""
    return replace(pump_twin(), bandwidth=2600)


def recording_of(twin: Twin, factors: np.ndarray, seed: int = 0) -> Recording:
    """Noisy recording (30 dB) of the twin with its values times `factors`."""
    true = twin.with_interfaces(Interfaces.from_values(twin.values.numpy() * factors))
    recording = true.simulate(1.4, 25600.0, phase=1.0 + seed, recording_id=f"truth-{seed}")
    return replace(recording, signal=add_noise(recording.signal, 30.0, seed))


def objective() -> Objective:
    """What every row minimizes."""
    twin = narrow_twin()
    return objective_of(twin, measure(twin, [recording_of(twin, FACTORS)]))


def memory() -> float:
    """Peak memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def loss_row(name: str, solver: SteadySolver) -> Row:
    """Value, and value with gradient, of one spectrum loss."""
    target = objective()
    before = memory()
    point = target.start.clone().requires_grad_()

    def gradient() -> Tensor:
        return torch.autograd.grad(target.spectrum_loss(point, solver=solver), point)[0]

    value_s = seconds(lambda: target.spectrum_loss(target.start, solver=solver))
    gradient_s = seconds(gradient)
    exact = target.spectrum_loss(target.start, solver=HarmonicBalance()).item()
    error = abs(target.spectrum_loss(target.start, solver=solver).item() / exact - 1)
    return Row(name, value_s, gradient_s, memory() - before, error)


@dataclass(frozen=True)
class Lines:
    """Matrices and force lines of the equations, with their gradients."""

    mass: Tensor
    damping: Tensor
    stiffness: Tensor
    frequency: Tensor
    force: Tensor


def equations(target: Objective, values: Tensor) -> Lines:
    """Those at the values."""
    probe = Probe()
    target.twin.acceleration(values, solver=probe)
    mass, damping, stiffness, frequency, force = probe.given
    return Lines(mass, damping.reshape(13, 13), stiffness.reshape(13, 13), frequency.reshape(-1), force.reshape(-1, 13))


def forces_in_time(lines: Lines, step: float, n: int) -> Tensor:
    """Forces [N, N m] at every half step."""
    time_of = step / 2 * torch.arange(2 * n + 1, dtype=torch.float64)
    return (torch.exp(1j * time_of[:, None] * lines.frequency) @ lines.force).real


def eager_states(lines: Lines, step: float, n: int) -> Tensor:
    """States after each of `n` Runge-Kutta steps from rest, as a loop that autograd records."""
    state = state_matrix(lines.mass, lines.damping, lines.stiffness)
    force = forces_in_time(lines, step, n) / lines.mass.diagonal()
    push = torch.cat([torch.zeros_like(force), force], dim=1).unbind(0)
    x, states = torch.zeros(26, dtype=torch.float64), []
    for i in range(n):
        k1 = torch.addmv(push[2 * i], state, x)
        k2 = torch.addmv(push[2 * i + 1], state, x + step / 2 * k1)
        k3 = torch.addmv(push[2 * i + 1], state, x + step / 2 * k2)
        k4 = torch.addmv(push[2 * i + 2], state, x + step * k3)
        x = x + step / 6 * (k1 + 2 * (k2 + k3) + k4)
        states.append(x)
    return torch.stack(states)


def eager_loss(target: Objective, values: Tensor, step: float, n: int) -> Tensor:
    """Spectrum loss of the last samples that the loop gave, transformed at the measured orders."""
    states = eager_states(equations(target, values), step, n)
    acceleration = torch.diff(states[:, 13:], dim=0) / step @ target.twin.structure.sensor_rows.T
    angle = target.twin.condition.speed * step * torch.arange(len(acceleration), dtype=torch.float64)
    turns = torch.exp(-1j * angle[:, None] * torch.as_tensor(target.comparisons[0].measurement.orders))
    amplitude = (2 / len(acceleration) * (acceleration.T.to(turns.dtype) @ turns)).abs()
    measured = target.comparisons[0].measured
    return ((amplitude - measured).square().mean() / measured.square().mean()).sqrt()


def eager_row() -> Row:
    """The rival's loss, extrapolated from a few hundred steps."""
    target = objective()
    values = target.twin.values.requires_grad_()
    lines = equations(target, values.detach())
    step = 0.8 * float(rk4_limits(state_matrix(lines.mass, lines.damping, lines.stiffness)))
    share = STEPS / math.ceil(REVOLUTIONS * target.twin.condition.period / step)
    value_s = seconds(lambda: eager_loss(target, values.detach(), step, STEPS)) / share
    before = memory()
    gradient_s = seconds(lambda: torch.autograd.grad(eager_loss(target, values, step, STEPS), values)) / share
    peak = (memory() - before) / share
    return Row("one loss, eager Runge-Kutta loop (extrapolated)", value_s, gradient_s, peak, math.nan)


def method_row(name: str, method: IPINN | GaussNewton) -> Row:
    """A whole search."""
    target = objective()
    before = memory()
    started = time.perf_counter()
    result = method.search(target, seed=0)
    wall = time.perf_counter() - started
    value_s = seconds(lambda: target.spectrum_loss(target.start)) * result.simulations
    ratio = result.values / (target.space.nominal * FACTORS)
    return Row(name, value_s, wall, memory() - before, float(np.abs(ratio[[2, 4]] - 1).max()))


ROWS: tuple[tuple[Callable[..., Row], tuple[object, ...]], ...] = (
    (loss_row, ("one loss, harmonic balance", HarmonicBalance())),
    (loss_row, ("one loss, RK4 as its exact map", RK4())),
    (eager_row, ()),
    (method_row, ("IPINN, 500 epochs, harmonic balance", IPINN(epochs=EPOCHS))),
    (method_row, ("IPINN, 500 epochs, RK4 as its exact map", IPINN(epochs=EPOCHS, solver=RK4()))),
    (method_row, ("Gauss-Newton, 4 starts", GaussNewton())),
)


def measured(index: int) -> Row:
    """Row of this number, in this process."""
    settle()
    make, arguments = ROWS[index]
    return make(*arguments)


def table() -> dict[str, object]:
    """All rows and the ratios."""
    rows = [alone(measured, index) for index in range(len(ROWS))]
    exact, _, eager, ipinn, ipinn_rk4, newton = rows
    rival_run = ipinn.gradient_s + EPOCHS * (eager.gradient_s - exact.gradient_s)
    ratios = {
        "eager": rival_run / ipinn.gradient_s,
        "eager_rk4": rival_run / ipinn_rk4.gradient_s,
        "eager_loss_alone": eager.gradient_s / exact.gradient_s,
        "eager_memory": eager.memory_mb / max(exact.memory_mb, 1.0),
        "ipinn_over_gauss_newton": ipinn.gradient_s / newton.gradient_s,
    }
    return {"rows": [asdict(row) for row in rows], "ratios": ratios}


def recovery(seeds: int) -> None:
    """Print in how many of `seeds` runs each method finds C_v and C_Hz within 10 % and K_v within 30 %."""
    torch.set_num_threads(1)
    twin = narrow_twin()
    truths = {
        "C_v x1.6, K_v x0.7, C_Hz x2.5": FACTORS,
        "paper: C_sw x0.42, C_Hz x4.5": np.array([0.778 / 1.86, 1, 1, 1, 4.5, 1]),
        "far: 1.5 0.5 0.23 0.21 2.7 3.8": np.array([1.55, 0.48, 0.23, 0.21, 2.74, 3.78]),
        "far: 0.5 0.8 0.22 0.30 1.7 1.6": np.array([0.52, 0.78, 0.22, 0.30, 1.73, 1.61]),
    }
    methods = {
        "IPINN (the paper's)": IPINN(),
        "IPINN, 1e-3": IPINN(learning_rate=1e-3),
        "GaussNewton": GaussNewton(),
    }
    print(f"{'truth over nominal':34}{'method':24}{'found':>7}{'K_sw flagged':>14}{'loss':>9}{'wall s':>8}")
    for title, factors in truths.items():
        recordings = [recording_of(twin, factors, seed) for seed in range(seeds)]
        for name, method in methods.items():
            runs = [
                calibrate(twin, [recording], **{**PAPER_CALIBRATION, "method": method}, seed=seed)
                for seed, recording in enumerate(recordings)
            ]
            ratio = np.array([[e.value / e.nominal for e in run.estimates] for run in runs]) / factors
            is_near = np.abs(ratio[:, [2, 4, 3]] - 1) < (0.1, 0.1, 0.3)
            flagged = sum(run.estimate("K_sw").verdict == "not identified" for run in runs)
            loss = np.median([run.fit_after.spectrum_value_error for run in runs])
            wall = np.median([run.wall_s for run in runs])
            counts = f"{int(is_near.all(axis=1).sum())}/{seeds}"
            print(f"{title:34}{name:24}{counts:>7}{f'{flagged}/{seeds}':>14}{loss:9.4f}{wall:8.2f}", flush=True)


def main() -> None:
    """Print the table, as JSON with ``--json``; or what is recovered with ``--recovery``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--recovery", type=int, metavar="SEEDS", help="print which methods find the truth instead")
    arguments = parser.parse_args()
    if arguments.recovery:
        recovery(arguments.recovery)
        return
    result = table()
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    print(f"{'':50}{'value s':>12}{'gradient s':>12}{'memory MB':>12}{'error':>10}")
    for row in result["rows"]:  # type: ignore[attr-defined]
        print(
            f"{row['name']:50}{row['value_s']:12.4g}{row['gradient_s']:12.4g}{row['memory_mb']:12.4g}{row['error']:10.1e}"
        )
    for name, ratio in result["ratios"].items():  # type: ignore[attr-defined]
        print(f"{name}: {ratio:.3g}")


if __name__ == "__main__":
    main()
