"""How much nearer to the virtual rig's recordings a calibrated twin is than the nominal one.

    python benchmarks/rig_calibration.py --fleets 5 --json

Each pump of each fleet is calibrated on its swash plate recordings at 10 MPa. Errors are those on these recordings
(``calibration``) and on its recordings at 15 MPa, which the calibration never saw (``held_out``). Figures on the
virtual rig say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json
from collections.abc import Sequence

import torch
from joblib import Parallel, delayed

from swashtwin.bench import SIZES, rig_recordings
from swashtwin.bench.results.table import spread
from swashtwin.bench.rigs.fleet import RECESS
from swashtwin.calibration import (
    IPINN,
    Agreement,
    Calibrator,
    GaussNewton,
    Nuisances,
    agreement,
    calibrate,
    measure,
    objective_of,
)
from swashtwin.foundation import MPa
from swashtwin.physics import Twin
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording

METHODS: dict[str, tuple[Calibrator, Nuisances]] = {
    "ipinn": (IPINN(), Nuisances()),
    "ipinn_improved": (IPINN.improved(), Nuisances()),
    "gauss_newton": (GaussNewton(), Nuisances()),
    "gauss_newton_usual": (GaussNewton(), Nuisances.usual()),
    "gauss_newton_housing": (GaussNewton(), Nuisances.housing()),
}
METRICS = ("rmse", "relative_rmse", "peak_error", "spectrum_value_error")


def agreement_with(twin: Twin, recordings: Sequence[Recording]) -> Agreement:
    """How near `twin`, taken to the recordings' condition, is to them."""
    assert recordings[0].condition is not None
    there = twin.at(recordings[0].condition)
    measurement = measure(there, recordings)
    (comparison,) = objective_of(there, measurement).comparisons
    return agreement(comparison.measurement, there, comparison.amplitude_of(there))[0]


def of_pump(recordings: Sequence[Recording]) -> dict[tuple[str, str], Agreement]:
    """Agreement of the nominal and of each calibrated twin of one pump, on both sets of recordings."""
    torch.set_num_threads(1)
    at = {p: [r for r in recordings if r.condition and r.condition.discharge_pressure == p] for p in (MPa(10), MPa(15))}
    condition = at[MPa(10)][0].condition
    assert condition is not None
    nominal = Twin(load_pump("25scy14-1b"), condition, RECESS)
    twins = {"nominal": nominal}
    for name, (method, nuisances) in METHODS.items():
        twins[name] = calibrate(nominal, at[MPa(10)], method=method, nuisances=nuisances, phases=False).twin
    tests = {"calibration": at[MPa(10)], "held_out": at[MPa(15)]}
    return {(twin, test): agreement_with(twins[twin], of) for twin in twins for test, of in tests.items()}


def main() -> None:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=5, help="seeds 0... of the rig")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    pumps: list[list[Recording]] = []
    for seed in range(options.fleets):
        recordings = [r for r, _ in rig_recordings(seed, SIZES["small"], labels=("swash_plate",), jobs=options.jobs)]
        pumps += [
            [r for r in recordings if r.specimen == name] for name in sorted({str(r.specimen) for r in recordings})
        ]
    results = Parallel(n_jobs=options.jobs)(delayed(of_pump)(pump) for pump in pumps)
    rows = [
        {"twin": twin, "test": test}
        | {metric: spread([getattr(result[twin, test], metric) for result in results]) for metric in METRICS}
        for twin, test in results[0]
    ]
    if options.json:
        print(json.dumps({"rows": rows, "pumps": len(pumps), "fleets": options.fleets}))
        return
    for row in rows:
        words = "  ".join(f"{metric} {row[metric]['mean']:.3f} +- {row[metric]['std']:.3f}" for metric in METRICS)
        print(f"{row['test']:12s} {row['twin']:24s} {words}")


if __name__ == "__main__":
    main()
