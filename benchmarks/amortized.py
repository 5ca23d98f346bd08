"""One network for all recordings of a pump against a search for each.

    python benchmarks/amortized.py --json
    python benchmarks/amortized.py --seeds 1 --read waveform

For each seed a network is trained on twins from the prior (bounds of a factor of 10 around every value), then twins it
never saw are drawn, recorded (1.4 s, 30 dB noise) and calibrated by every method. `error` is |found - true| of ln value
over the values that a recording identifies (standard deviation at the truth up to 0.25, by the exact sensitivities),
median and 90 % quantile; `coverage` the share of all six true values within the 90 % intervals, the network's own where
a pass is not refined, those of the sensitivities else; `spectrum` the spectrum loss (median); `lost` the share of
recordings whose lines are missed by more than their expected deviations. The recordings hold no model error, which
every method expects: intervals ought to hold the truth more often than 90 %. `network_coverage` is that of the
network's intervals on lines that hold it, by value. `break_even` counts the recordings after which training has paid
against a method; None if it never does.
"""

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch

from swashtwin.calibration import (
    IPINN,
    AmortizedIPINN,
    AmortizedTraining,
    Calibrator,
    GaussNewton,
    Objective,
    measure,
    objective_of,
    objective_without_recordings,
)
from swashtwin.calibration.methods.amortized_inputs import corrupted, points_drawn, simulated
from swashtwin.calibration.uncertainty.identifiability_report import IDENTIFIED_STD, estimates_of, posterior_covariance
from swashtwin.foundation import MPa, mm, rpm
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, SwashPlateDefect, load_pump
from swashtwin.signals import add_noise

N_PERTURBED = 200
"""Twins on which the network's intervals are judged with model error."""


@dataclass(frozen=True)
class Outcome:
    """One method on one recording."""

    errors: tuple[float, ...]
    inside: tuple[bool, ...]
    spectrum: float
    misfit: float
    wall_s: float
    simulations: int


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    method: str
    recordings: int
    error: float
    error_90: float
    coverage: float
    spectrum: float
    lost: float
    wall_s: float
    simulations: float
    break_even: int | None


def twin_at_15() -> Twin:
    """The paper's pump, condition and defect."""
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    defect = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    return Twin(load_pump("25scy14-1b"), condition, defect, bandwidth=2600)


def objective_at(twin: Twin, point: np.ndarray, seed: int) -> Objective:
    """Objective of a noisy recording of the twin at `point`."""
    true = twin.with_interfaces(Interfaces.from_values(np.exp(point)))
    quiet = true.simulate(1.4, 25600.0, phase=float(seed), recording_id=f"truth-{seed}")
    return objective_of(twin, measure(twin, [replace(quiet, signal=add_noise(quiet.signal, 30.0, seed))]))


def outcome(method: Calibrator, objective: Objective, true: np.ndarray, seed: int) -> Outcome:
    """What the method makes of the objective."""
    started = time.perf_counter()
    found = method.search(objective, seed=seed)
    wall = time.perf_counter() - started
    identified = np.sqrt(np.diag(posterior_covariance(objective, true))) <= IDENTIFIED_STD
    if isinstance(method, AmortizedIPINN) and method.refine == "none":
        reading = method.read(objective)
        inside = (reading.lower < true) & (true < reading.upper)
    else:
        estimates = estimates_of(objective, found.point, posterior_covariance(objective, found.point))
        ends = np.log([estimate.interval for estimate in estimates])
        inside = (ends[:, 0] < true) & (true < ends[:, 1])
    with torch.no_grad():
        point = torch.as_tensor(found.point)
        losses = float(objective.spectrum_loss(point)), float(objective.weighted_loss(point))
    errors = np.abs(found.point - true)[identified]
    return Outcome(tuple(errors.tolist()), tuple(inside.tolist()), *losses, wall, found.simulations)


def coverage_with_model_error(method: AmortizedIPINN, blank: Objective, seed: int) -> np.ndarray:
    """Share of the true values within the network's intervals, by value; lines off by 5 % and 0.03 m/s^2."""
    points = points_drawn(blank.unknowns, N_PERTURBED, seed)
    clean = simulated(blank, points, "lines").amplitude
    lines = corrupted(clean, torch.tensor(0.03), torch.Generator().manual_seed(seed)).double().numpy()
    (one,) = blank.comparisons
    shape = one.measured.shape
    deviation = np.full(shape, math.sqrt(0.03**2 - 0.02**2))
    inside = []
    for point, row in zip(points, lines, strict=True):
        measurement = replace(one.measurement, amplitude=row.reshape(shape), deviation=deviation)
        reading = method.read(replace(blank, comparisons=(replace(one, measurement=measurement),)))
        inside.append((reading.lower < point) & (point < reading.upper))
    return np.mean(inside, axis=0)


def row_of(name: str, outcomes: Sequence[Outcome], training_s: float, own_wall: float | None) -> Row:
    """Summary over recordings."""
    errors = np.concatenate([one.errors for one in outcomes])
    wall = float(np.median([one.wall_s for one in outcomes]))
    saved = 0.0 if own_wall is None else wall - own_wall
    return Row(
        method=name,
        recordings=len(outcomes),
        error=float(np.median(errors)),
        error_90=float(np.quantile(errors, 0.9)),
        coverage=float(np.mean([one.inside for one in outcomes])),
        spectrum=float(np.median([one.spectrum for one in outcomes])),
        lost=float(np.mean([one.misfit > 1 for one in outcomes])),
        wall_s=wall,
        simulations=float(np.mean([one.simulations for one in outcomes])),
        break_even=math.ceil(training_s / saved) if saved > 0 else None,
    )


def table(seeds: int, recordings: int, ipinns: int, training: AmortizedTraining) -> dict[str, object]:
    """All rows, over all seeds."""
    twin = twin_at_15()
    blank = objective_without_recordings(twin)
    pooled: dict[str, list[Outcome]] = {}
    training_s, held_out, coverage = [], [], []
    for seed in range(seeds):
        started = time.perf_counter()
        network = AmortizedIPINN.train(blank, training, seed=seed)
        training_s.append(time.perf_counter() - started)
        held_out.append(network.trained.held_out_loss)
        if training.read == "lines":
            coverage.append(coverage_with_model_error(network, blank, 1000 + seed))
        methods: dict[str, tuple[Calibrator, int]] = {
            "amortized, one pass": (network.with_refinement("none"), recordings),
            "amortized, refined": (network, recordings),
            "GaussNewton, 1 start": (GaussNewton(starts=1), recordings),
            "GaussNewton, 4 starts": (GaussNewton(starts=4), recordings),
            "IPINN": (IPINN(), ipinns),
            "IPINN.improved": (IPINN.improved(), ipinns),
        }
        points = points_drawn(blank.unknowns, recordings, 10_000 + seed)
        for index, point in enumerate(points):
            objective = objective_at(twin, point, 100 * seed + index)
            for name, (method, most) in methods.items():
                if index < most:
                    pooled.setdefault(name, []).append(outcome(method, objective, point, seed))
    cost = float(np.mean(training_s))
    walls = {name: float(np.median([one.wall_s for one in outcomes])) for name, outcomes in pooled.items()}
    refined = walls["amortized, refined"]
    rows = [row_of(n, o, cost, None if n.startswith("amortized") else refined) for n, o in pooled.items()]
    return {
        "rows": [asdict(row) for row in rows],
        "seeds": seeds,
        "training": asdict(training),
        "training_s": {"mean": cost, "std": float(np.std(training_s))},
        "held_out_loss": {"mean": float(np.mean(held_out)), "std": float(np.std(held_out))},
        "network_coverage": dict(zip(blank.unknowns.names, np.mean(coverage, axis=0).tolist(), strict=True))
        if coverage
        else None,
    }


def main() -> None:
    """Print the table, as JSON with ``--json``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--seeds", type=int, default=5, help="networks trained, each with its own recordings")
    parser.add_argument("--recordings", type=int, default=20, help="recordings for each network")
    parser.add_argument("--ipinns", type=int, default=8, help="how many of these IPINN calibrates too")
    parser.add_argument("--read", choices=("lines", "waveform"), default="lines", help="what the network reads")
    parser.add_argument("--twins", type=int, default=AmortizedTraining().twins)
    parser.add_argument("--epochs", type=int, default=AmortizedTraining().epochs)
    parser.add_argument("--physics", type=float, default=0.0, help="weight of the physics loss")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    training = AmortizedTraining(read=chosen.read, twins=chosen.twins, epochs=chosen.epochs, physics=chosen.physics)
    result = table(chosen.seeds, chosen.recordings, chosen.ipinns, training)
    if chosen.json:
        print(json.dumps(result, indent=1))
        return
    columns = ("recordings", "error", "error_90", "coverage", "spectrum", "lost", "wall_s", "simulations", "break_even")
    print(f"{'':24}" + "".join(f"{name:>12}" for name in columns))
    for row in result["rows"]:  # type: ignore[attr-defined]
        figures = ("-" if row[name] is None else f"{row[name]:.4g}" for name in columns)
        print(f"{row['method']:24}" + "".join(f"{figure:>12}" for figure in figures))
    for name in ("training_s", "held_out_loss", "network_coverage"):
        print(f"{name}: {result[name]}")


if __name__ == "__main__":
    main()
