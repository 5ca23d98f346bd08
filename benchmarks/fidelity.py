"""How well synthetic windows of a scarce cell are told from measured ones, from nothing and as changes of healthy ones.

    python benchmarks/fidelity.py --seeds 100,101 --out studies

Case I of the paper's size on the virtual rig (`swashtwin bench case1`, whose fleets and calibrations in ``--out`` are
used again): 150 windows of the swash plate fault at 15 MPa by each training set, compared with the measured windows of
that cell from four pumps that nothing was trained on. The AUROC is that of trees on vibration features, cross-validated
with no recording on both sides (``by_recording``), and with no pump on both sides (``by_pump``): there neither the
peculiarities of a recording nor those of a pump help or mislead the trees. The row ``measured`` compares the other
measured recordings of the cell in place of synthetic ones: it is the best that synthesis could reach. Figures on the
virtual rig say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from swashtwin.bench.studies.cells import cut_evenly
from swashtwin.bench.studies.dataset import (
    StudyDataset,
    calibration_file,
    calibration_tasks,
    load_finished_calibration,
    prepare,
    run_calibration,
)
from swashtwin.bench.studies.registry import plan_of
from swashtwin.bench.studies.sources import Fleets
from swashtwin.bench.studies.training_sets import TWIN_TRAINING_SETS, synthesize_for
from swashtwin.learning import WindowSet
from swashtwin.recordings import Recording
from swashtwin.synthesis import discriminative_score, measure_fidelity

SETS = ("nominal", "calibrated", "posterior", "nominal_change", "change", "posterior_change")


def study_dataset(recordings: list[Recording], seed: int, out: Path) -> StudyDataset:
    """Windows and twins of Case I; calibrations are read from `out`, or run and written there."""
    scenario = plan_of("case1", "paper").scenario
    finished = []
    for task in calibration_tasks(recordings, scenario, seed):
        calibration = load_finished_calibration(out, task.key)
        if calibration is None:
            calibration = run_calibration(task)
            calibration.save(calibration_file(out, task.key))
        finished.append((task, calibration))
    return prepare(recordings, scenario, seed, finished)


def by_pump(windows: WindowSet, pumps: list[str]) -> WindowSet:
    """The windows, all of one pump as one recording; a twin's specimen names its pump last, or its turn does."""
    names = [
        pumps[i % len(pumps)] if name == "twin of 25scy14-1b" else re.findall(r"\w+", name)[-1]
        for i, name in enumerate(windows.specimen.tolist())
    ]
    return replace(windows, recording_id=np.array(names))


def rows_of(recordings: list[Recording], seed: int, out: Path) -> list[dict[str, object]]:
    """Figures of one fleet."""
    data = study_dataset(recordings, seed, out)
    scenario, trained = data.scenario, set(data.measured.recording_id.tolist())
    pumps = sorted(set(data.measured.specimen.tolist()))
    cell = [r for r in recordings if scenario.is_scarce(r) and r.specimen in pumps and r.recording_id not in trained]
    tested = set(data.tests[scenario.levels[0]].recording_id.tolist())

    def windows(chosen: list[Recording]) -> WindowSet:
        return cut_evenly(chosen, length=scenario.length, count=scenario.windows, like=data.measured)

    held_out = windows([r for r in cell if r.recording_id in tested])
    others = windows([r for r in cell if r.recording_id not in tested])
    sets = {"measured": others} | {name: synthesize_for(data, TWIN_TRAINING_SETS[name]) for name in SETS}
    rows = []
    for name, compared in sets.items():
        real = held_out if name == "measured" else held_out + others
        report = measure_fidelity(real, compared, seed=seed)
        row = {
            "seed": seed,
            "windows": name,
            "by_recording": report.auroc,
            "by_pump": discriminative_score(by_pump(real, pumps), by_pump(compared, pumps), seed=seed),
            "distance_db": [round(value, 2) for value in report.spectral_distance_db.values()],
            "told_by": report.features[0].name,
            "told_by_auroc": report.features[0].auroc,
        }
        print(json.dumps(row), flush=True)
        rows.append(row)
    return rows


def main() -> None:
    """Print a row for each fleet and training set, and the means."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100", help="fleets, separated by commas")
    parser.add_argument("--out", type=Path, default=Path("studies"), help="folder of fleets and calibrations")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for seed in (int(text) for text in options.seeds.split(",")):
        recordings, _ = Fleets(options.out, "paper").recordings_for(seed)
        rows += rows_of(list(recordings), seed, options.out)
    for name in dict.fromkeys(row["windows"] for row in rows):
        of_set = [row for row in rows if row["windows"] == name]
        means = {key: float(np.mean([row[key] for row in of_set])) for key in ("by_recording", "by_pump")}
        print(json.dumps({"windows": name, "n": len(of_set), **means}))


if __name__ == "__main__":
    main()
