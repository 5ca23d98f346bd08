"""Whether pumps of the virtual rig learn from each other: calibrated alone, and as one fleet.

    python benchmarks/fleet_calibration.py --seeds 2 3 --json

Each of the six pumps of a fleet is calibrated on one healthy recording at 10 MPa and compared with another one there
(and with what really held in the recording used, the films at its temperature included). `alone` is `calibrate`,
`fleet` is `calibrate_fleet`, `sister` calibrates a pump on nothing: the type's mean as five other pumps give it. The
figures say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json

import numpy as np
import torch

from swashtwin.bench import rig_recordings
from swashtwin.bench.rigs.fleet import film_factors
from swashtwin.bench.rigs.measuring import Run
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.calibration import Calibration, GaussNewton, Nuisances, calibrate, calibrate_fleet, measure, objective_of
from swashtwin.foundation import MPa, rpm
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, load_pump
from swashtwin.recordings import Recording
from swashtwin.signals import spectrum_value_error

NUISANCES = {"none": Nuisances(), "usual": Nuisances.usual()}
Pairs = list[tuple[Recording, Run]]


def truth_of(run: Run) -> np.ndarray:
    """Logarithms of the values that held in one recording."""
    oil = run.specimen.pump.oil
    viscosity = oil.viscosity_at(run.condition.oil_temperature) / oil.viscosity
    return np.log(run.specimen.values * film_factors(run.condition.discharge_pressure, viscosity))


def sve_of(twin: Twin, held_out: Recording) -> float:
    """Spectrum value error on a recording that was not used."""
    comparison = objective_of(twin, measure(twin, [held_out])).comparisons[0]
    return spectrum_value_error(comparison.measurement.amplitude, comparison.amplitude_of(twin))


def figures(calibration: Calibration, held_out: Recording, truth: np.ndarray) -> dict[str, list[float]]:
    """What one calibration came to, value by value."""
    values = np.log([estimate.value for estimate in calibration.estimates])
    low, high = np.log([estimate.interval for estimate in calibration.estimates]).T
    sure = np.array([estimate.verdict in ("identified", "weak") for estimate in calibration.estimates])
    is_covered = (low <= truth) & (truth <= high)
    return {
        "sve": [sve_of(calibration.twin, held_out)],
        "error": np.abs(values - truth).tolist(),
        "coverage": is_covered.astype(float).tolist(),
        "coverage_identified": is_covered[sure].astype(float).tolist(),
        "width": (high - low).tolist(),
    }


def of_fleet(seed: int, name: str) -> list[tuple[str, dict[str, list[float]]]]:
    """Figures of every pump of one fleet."""
    pairs: dict[str, Pairs] = {}
    for recording, run in rig_recordings(seed, RigSize(specimens=6, repeats=2), labels=("normal",)):
        if recording.condition is not None and recording.condition.discharge_pressure == MPa(10):
            pairs.setdefault(run.specimen.name, []).append((recording, run))
    twin = Twin(load_pump("25scy14-1b"), OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10)))
    options = {"method": GaussNewton(starts=2), "nuisances": NUISANCES[name], "phases": False}
    fleet = calibrate_fleet(twin, [some[0][0] for some in pairs.values()], **options)
    rows = []
    for pump, ((used, run), (held_out, _)) in pairs.items():
        truth = truth_of(run)
        rows.append(("alone", figures(calibrate(twin, [used], **options), held_out, truth)))
        rows.append(("fleet", figures(fleet.calibrations[pump], held_out, truth)))
        others = calibrate_fleet(twin, [some[0][0] for name, some in pairs.items() if name != pump], **options)
        mean = others.population.mean[:6]
        typical = twin.with_interfaces(Interfaces.from_values(np.exp(mean)))
        rows.append(("sister", {"sve": [sve_of(typical, held_out)], "error": np.abs(mean - truth).tolist()}))
        rows.append(
            (
                "nominal",
                {"sve": [sve_of(twin, held_out)], "error": np.abs(np.log(twin.values.numpy()) - truth).tolist()},
            )
        )
    return rows


def main() -> None:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 3], help="fleets of the rig, six pumps each")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for name in NUISANCES:
        figures_by_kind = [pair for seed in options.seeds for pair in of_fleet(seed, name)]
        for kind in dict.fromkeys(kind for kind, _ in figures_by_kind):
            of_kind = [values for each, values in figures_by_kind if each == kind]
            joined = {metric: np.concatenate([values[metric] for values in of_kind]) for metric in of_kind[0]}
            means = {metric: float(values.mean()) if len(values) else None for metric, values in joined.items()}
            by_value = np.mean([values["error"] for values in of_kind], axis=0).round(3).tolist()
            rows.append({"twin": kind, "nuisances": name, "pumps": len(of_kind), **means, "error_by_value": by_value})
    if options.json:
        print(json.dumps({"rows": rows, "seeds": options.seeds}))
        return
    for row in rows:
        print("  ".join(f"{key} {value:.3f}" if isinstance(value, float) else f"{value}" for key, value in row.items()))


if __name__ == "__main__":
    main()
