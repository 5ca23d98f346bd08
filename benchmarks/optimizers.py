"""Which search finds the truth: the rivals, and the IPINN with and without each of its ideas.

    python benchmarks/optimizers.py --truths 6
    python benchmarks/optimizers.py --truths 6 --only Gauss,BFGS --json

Data are the twin's own recordings with noise (30 dB): no model error, so success on a real pump will be lower. Truths
are those of ``benchmarks/calibration.py --recovery`` and others drawn evenly over the logarithms within the bounds (a
tenth to ten times nominal), each searched from the nominal values and from a random start within the bounds. All
methods are given the same recording, start and bounds; further starts are their own. Columns:

floor     runs whose weighted loss is at most 1.1 times that of the truth itself (the noise floor)
optimum   the same, or at most 1.1 times the weighted loss at the posterior's top (found by Gauss-Newton from the
          truth). It may lie above the truth's, for priors buy likelihood with what the measurement hardly shows; it is
          what methods that count priors seek, so ``floor`` is not for them to reach
loss      median of the weighted loss over that of the truth
error     median over the runs of the largest |ln(found / true)| of the values that the measurement identifies;
          ``worst`` is the greatest
simulations, wall s   medians of a run
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch
from calibration import FACTORS, recording_of, twin_at_15

from swashtwin.calibration import (
    CMAES,
    IPINN,
    LBFGS,
    Calibrator,
    DirectAdam,
    GaussNewton,
    Objective,
    measure,
    objective_of,
)
from swashtwin.calibration.methods.search import Search
from swashtwin.calibration.uncertainty.posterior import estimates_of, posterior_covariance
from swashtwin.foundation import stream
from swashtwin.pump import PARAMETERS, Interfaces

TRUTHS = {
    "C_v x1.6, K_v x0.7, C_Hz x2.5": FACTORS,
    "paper: C_sw x0.42, C_Hz x4.5": np.array([0.778 / 1.86, 1, 1, 1, 4.5, 1]),
    "far: 1.5 0.5 0.23 0.21 2.7 3.8": np.array([1.55, 0.48, 0.23, 0.21, 2.74, 3.78]),
    "far: 0.5 0.8 0.22 0.30 1.7 1.6": np.array([0.52, 0.78, 0.22, 0.30, 1.73, 1.61]),
}
"""Truth over nominal."""
REACH = 10.0
"""Random truths and starts lie within this factor of the nominal values, which is also the bounds'."""
FLOOR = 1.1

METHODS: dict[str, Calibrator] = {
    "Gauss-Newton, 1 start": GaussNewton(starts=1),
    "Gauss-Newton, 8 starts": GaussNewton(starts=8),
    "L-BFGS, 1 start": LBFGS(starts=1),
    "L-BFGS, 8 starts": LBFGS(starts=8),
    "CMA-ES": CMAES(),
    "Adam on coordinates, 1 start": DirectAdam(),
    "Adam on coordinates, 8 starts": DirectAdam(starts=8),
    "IPINN, the paper's": IPINN(),
    "IPINN, without base x magnitude": IPINN(values="plain"),
    "IPINN, 1e-3": IPINN(learning_rate=1e-3),
    "IPINN, 1e-3, without boundary loss": IPINN(learning_rate=1e-3, boundary=False),
    "IPINN, logarithms, 1e-3": IPINN(learning_rate=1e-3, values="logarithms"),
    "IPINN.improved": IPINN.improved(),
    "IPINN.improved, without priors": IPINN.improved(priors="constants"),
    "IPINN.improved, linear spectrum": IPINN.improved(spectrum="linear"),
    "IPINN.improved, log spectrum": IPINN.improved(spectrum="logarithmic"),
    "IPINN.improved, base x magnitude": IPINN.improved(values="base_values"),
    "IPINN.improved, without boundary loss": IPINN.improved(boundary=False),
    "IPINN.improved, constant rate": IPINN.improved(decay="constant"),
}


@dataclass(frozen=True)
class Case:
    """One thing to find."""

    objective: Objective
    truth: np.ndarray
    """Coordinates."""
    identified: np.ndarray
    """Which values the measurement identifies, judged at the truth."""
    seed: int
    floor: float
    """Greatest weighted loss that is at the noise floor."""
    optimum: float
    """The same for a method that counts priors."""


@dataclass(frozen=True)
class Row:
    """One method's runs."""

    method: str
    start: str
    runs: int
    floor: int
    optimum: int
    loss: float
    error: float
    worst_error: float
    simulations: float
    wall_s: float


def within(*purpose: object) -> np.ndarray:
    """Factors on the nominal values, drawn evenly over the logarithms."""
    return REACH ** stream(0, "optimizers", *purpose).uniform(-1, 1, 6)


def case(truth: np.ndarray, start: np.ndarray, seed: int) -> Case:
    """The nominal pump's `truth`, searched from `start`; both as factors."""
    twin = twin_at_15()
    nominal = twin.values.numpy()
    bounds = {name: (value / REACH, value * REACH) for name, value in zip(PARAMETERS, nominal, strict=True)}
    measurement = measure(twin, [recording_of(twin, truth, seed)])
    objective, from_truth = (
        objective_of(twin.with_interfaces(Interfaces.from_values(nominal * factors)), measurement, bounds)
        for factors in (start, truth)
    )
    point = np.log(nominal * truth)
    verdicts = estimates_of(objective, point, posterior_covariance(objective, point))
    identified = np.array([verdict.verdict == "identified" for verdict in verdicts])
    floor = FLOOR * weighted(objective, point)
    top = FLOOR * weighted(objective, GaussNewton(starts=8).search(from_truth, seed=seed).point)
    return Case(objective, point, identified, seed, floor, max(floor, top))


def cases(truths: int, start: str) -> list[Case]:
    """Every truth, with a start of its own."""
    factors = [*TRUTHS.values(), *(within("truth", number) for number in range(truths))]
    starts = [np.ones(6) if start == "nominal" else within("start", seed) for seed in range(len(factors))]
    return [case(*pair, seed) for seed, pair in enumerate(zip(factors, starts, strict=True))]


def weighted(objective: Objective, point: np.ndarray) -> float:
    """Weighted loss."""
    with torch.no_grad():
        return float(objective.weighted_loss(torch.as_tensor(point)))


def run(case: Case, method: Calibrator) -> tuple[Search, float]:
    """What was found, and how long it took [s]."""
    started = time.perf_counter()
    return method.search(case.objective, seed=case.seed), time.perf_counter() - started


def row(name: str, start: str, starts: Sequence[Case]) -> Row:
    """A method's runs from one kind of start."""
    floor, optimum, ratios, errors, simulations, walls = 0, 0, [], [], [], []
    for case in starts:
        result, wall = run(case, METHODS[name])
        loss = weighted(case.objective, result.point)
        floor += loss <= case.floor
        optimum += loss <= case.optimum
        ratios.append(FLOOR * loss / case.floor)
        errors.append(float(np.abs(result.point - case.truth)[case.identified].max(initial=0.0)))
        simulations.append(result.simulations)
        walls.append(wall)
    medians = (float(np.median(column)) for column in (ratios, errors))
    middle = (float(np.median(column)) for column in (simulations, walls))
    return Row(name, start, len(starts), floor, optimum, *medians, max(errors), *middle)


def line(row: Row) -> str:
    """A row of the table."""
    counts = f"{f'{row.floor}/{row.runs}':>8}{f'{row.optimum}/{row.runs}':>9}"
    figures = f"{row.loss:8.3f}{row.error:8.3f}{row.worst_error:8.3f}{row.simulations:8.0f}{row.wall_s:8.2f}"
    return f"{row.method:40}{counts}{figures}"


def main() -> None:
    """Print the table, as JSON with ``--json``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truths", type=int, default=6, help="random truths beside the four that are given")
    parser.add_argument("--only", default="", help="parts of the methods' names, with commas between")
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    names = [name for name in METHODS if any(part in name for part in arguments.only.split(","))]
    rows = []
    for start in ("nominal", "random"):
        starts = cases(arguments.truths, start)
        run(starts[0], GaussNewton(starts=1))  # compiles
        if not arguments.json:
            heads = {"floor": 8, "optimum": 9, "loss": 8, "error": 8, "worst": 8, "sims": 8, "wall s": 8}
            print(f"{start + ' start':40}" + "".join(f"{head:>{width}}" for head, width in heads.items()))
        for name in names:
            rows.append(row(name, start, starts))
            if not arguments.json:
                print(line(rows[-1]), flush=True)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
