"""How often the intervals of a calibration hold the virtual rig's hidden truth.

    python benchmarks/interval_coverage.py --fleets 2 --json

Each recording is calibrated alone, for the rig takes a pump apart between two of them. Its truth are the values that
really held in it: the pump's, as it was put together for this recording, times what its oil's temperature and its
pressure did to the films. A slipper's stiffness turns with the shaft there; its mean counts. `rule` is `discrepancy`
for the intervals that `calibrate` gives, `misfit` for the information divided by the mean square misfit instead, and
`noise` for the bare noise model. Nothing is tuned to these figures, which say nothing about a real pump
(docs/bench/rig.md).
"""

import argparse
import json
from dataclasses import dataclass

import numpy as np
import torch
from joblib import Parallel, delayed

from swashtwin.bench import rig_recordings
from swashtwin.bench.rigs.fleet import RECESS
from swashtwin.bench.rigs.measuring import Run, true_values
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.calibration import GaussNewton, Nuisances, measure, objective_of
from swashtwin.calibration.uncertainty.discrepancy import (
    Linearization,
    estimate_discrepancy,
    linearize,
    noise_covariance,
)
from swashtwin.calibration.uncertainty.posterior import estimates_of, sandwich
from swashtwin.physics import Twin
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording

NUISANCES = {"none": Nuisances(), "usual": Nuisances.usual(), "housing": Nuisances.housing()}
LABELS = ("normal", "swash_plate")
RULES = ("noise", "misfit", "discrepancy")


@dataclass(frozen=True)
class Coverage:
    """One calibration under one rule."""

    is_covered: list[bool]
    verdicts: list[str]
    off: list[float]


def covariance_under(rule: str, around: Linearization) -> np.ndarray:
    """Covariance of the coordinates found."""
    if rule == "discrepancy":
        return sandwich(around, noise_covariance(around, estimate_discrepancy(around)))
    misfit = max(1.0, float(np.mean((around.residual / around.sigma) ** 2))) if rule == "misfit" else 1.0
    prior = around.objective.unknowns.deviation
    scaled = around.slope / around.sigma[:, None] * prior
    return np.linalg.inv(scaled.T @ scaled / misfit + np.eye(len(prior))) * np.outer(prior, prior)


def of_recording(recording: Recording, run: Run) -> dict[tuple[str, str], Coverage]:
    """Intervals of one recording, by nuisances and rule."""
    torch.set_num_threads(1)
    assert recording.condition is not None
    twin = Twin(load_pump("25scy14-1b"), recording.condition, RECESS if recording.label == "swash_plate" else None)
    measurement, truth = measure(twin, [recording]), true_values(run)
    result = {}
    for name, nuisances in NUISANCES.items():
        objective = objective_of(twin, measurement, None, nuisances)
        point = GaussNewton(starts=2).search(objective, seed=0).point
        around = linearize(objective, point)
        for rule in RULES:
            estimates = estimates_of(objective, point, covariance_under(rule, around))
            result[name, rule] = Coverage(
                is_covered=[
                    estimate.interval[0] <= true <= estimate.interval[1]
                    for estimate, true in zip(estimates, truth, strict=True)
                ],
                verdicts=[estimate.verdict for estimate in estimates],
                off=[
                    float(np.log(estimate.value / true) / estimate.log_std)
                    for estimate, true in zip(estimates, truth, strict=True)
                ],
            )
    return result


def row_of(label: str, nuisances: str, rule: str, coverages: list[Coverage]) -> dict[str, object]:
    """One line of the table."""
    is_covered, off = (
        np.array([coverage.is_covered for coverage in coverages]),
        np.abs([coverage.off for coverage in coverages]),
    )
    named = np.array([coverage.verdicts for coverage in coverages])
    sure = named == "identified"
    return {
        "label": label,
        "nuisances": nuisances,
        "rule": rule,
        "recordings": len(coverages),
        "identified": int(sure.sum()),
        "coverage_identified": float(is_covered[sure].mean()) if sure.any() else None,
        "beyond_three": float((off[sure] > 3).mean()) if sure.any() else None,
        "coverage": float(is_covered.mean()),
        "coverage_by_value": is_covered.mean(axis=0).round(3).tolist(),
        "k_sw_not_identified": float(np.isin(named[:, 1], ["not identified", "at bound", "weak"]).mean()),
    }


def main() -> None:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=2, help="seeds 0... of the rig, six pumps each")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows = []
    for label in LABELS:
        pairs = [
            pair
            for seed in range(options.fleets)
            for pair in rig_recordings(seed, RigSize(specimens=6, repeats=1), labels=(label,), jobs=options.jobs)
        ]
        by_recording = Parallel(n_jobs=options.jobs)(delayed(of_recording)(*pair) for pair in pairs)
        rows += [
            row_of(label, name, rule, [coverage[name, rule] for coverage in by_recording])
            for name, rule in by_recording[0]
        ]
    if options.json:
        print(json.dumps({"rows": rows, "fleets": options.fleets}))
        return
    for row in rows:
        sure = "-" if row["coverage_identified"] is None else f"{row['coverage_identified']:.2f}"
        beyond = "-" if row["beyond_three"] is None else f"{row['beyond_three']:.2f}"
        print(
            f"{row['label']:12s} {row['nuisances']:8s} {row['rule']:12s} identified {row['identified']:4d} of "
            f"{6 * int(str(row['recordings']))}: held {sure}, beyond three {beyond}; all {row['coverage']:.2f}  "
            f"{row['coverage_by_value']}"
        )


if __name__ == "__main__":
    main()
