"""Zero-shot accuracy of pump priors: the shipped one, more virtual pumps, and pumps like those of the fleet.

    python benchmarks/pump_priors.py --seeds 100,101,102,103 --folder studies --json

Each row's prior is adapted to the fleet's healthy recordings and tested as in `swashtwin bench zero-shot --size prior`.
*Like the fleet*: the known pumps' healthy recordings are calibrated together, and the interface values of the virtual
pumps follow what came out. No test recording has a part in this. The test "same pump" is of other recordings of those
pumps, "unseen pump" of pumps that are not in it. Differences are against the shipped prior, in balanced accuracy by
recording, paired by fleet. Figures on the virtual rig say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np

from swashtwin.bench import Fleets
from swashtwin.bench.questions.zero_shot_data import split_zero_shot
from swashtwin.bench.questions.zero_shot_prior import PRIOR, prior_trials
from swashtwin.bench.results.contrasts import paired_interval
from swashtwin.calibration import calibrate_fleet
from swashtwin.diagnosis import PriorClassifier, fit_prior, load_prior
from swashtwin.recordings import Recording
from swashtwin.synthesis import PumpPrior, simulate_changes

METRIC = "recording_balanced_accuracy"


def trained(prior: PumpPrior, count: int, jobs: int) -> PriorClassifier:
    """Prior of so many virtual pumps."""
    changes = simulate_changes(prior, count, seed=1, jobs=jobs)
    return fit_prior(
        changes.bands,
        changes.change,
        changes.label,
        pump=prior.pump,
        speed=prior.speed,
        pressure=prior.pressure,
        n_pumps=count,
        seed=1,
    )


def scores(recordings: list[Recording], seed: int, prior: PriorClassifier) -> dict[str, float]:
    """Balanced accuracy by recording of each test."""
    split = split_zero_shot(recordings, 2, seed)
    trials = prior_trials(recordings, split, seed, prior)
    return {trial.factors["test"]: trial.values[METRIC] for trial in trials if trial.factors["training_set"] == PRIOR}


def main() -> None:
    """Print a line for each fleet and row, then means and differences; or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100,101,102,103", help="fleets of the rig")
    parser.add_argument("--folder", type=Path, default=Path("studies"), help="where fleets lie or are built")
    parser.add_argument("--count", type=int, default=4000, help="virtual pumps like those of a fleet")
    parser.add_argument("--more", type=int, default=10_000, help="virtual pumps of the drawing; 0 leaves the row out")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    seeds = [int(seed) for seed in options.seeds.split(",")]
    drawn = {"shipped": load_prior("25scy14-1b")}
    if options.more:
        drawn[f"{options.more} of the drawing"] = trained(PumpPrior(), options.more, options.jobs)
    rows: dict[str, list[dict[str, float]]] = {}
    populations = {}
    for seed in seeds:
        recordings = list(Fleets(options.folder, "paper", jobs=options.jobs).recordings_for(seed)[0])
        split = split_zero_shot(recordings, 2, seed)
        healthy = [r for r in recordings if r.recording_id in split.healthy and r.specimen in split.pumps]
        began = time.process_time()
        fleet = calibrate_fleet("25scy14-1b", healthy)
        population = fleet.population
        populations[seed] = population.to_dict() | {"cpu_s": time.process_time() - began}
        like_fleet = trained(PumpPrior(population=population), options.count, options.jobs)
        for name, prior in (drawn | {f"{options.count} like the fleet": like_fleet}).items():
            rows.setdefault(name, []).append(scores(recordings, seed, prior))
            if not options.json:
                print(seed, name, rows[name][-1], flush=True)
    table = {
        name: {
            test: {
                "mean": float(np.mean([row[test] for row in of_row])),
                "values": [row[test] for row in of_row],
                "less_shipped": [
                    bound if math.isfinite(bound) else None
                    for bound in paired_interval(
                        [row[test] - base[test] for row, base in zip(of_row, rows["shipped"], strict=True)]
                    )
                ],
            }
            for test in of_row[0]
        }
        for name, of_row in rows.items()
    }
    if options.json:
        print(json.dumps({"seeds": seeds, "rows": table, "populations": populations}, indent=1))
        return
    for name, of_test in table.items():
        for test, figures in of_test.items():
            print(f"{name:28} {test:28} {figures['mean']:.3f}  less shipped {figures['less_shipped']}")


if __name__ == "__main__":
    main()
