"""How like measured windows are those that fill a scarce cell, and what each filler costs, on the virtual rig.

    python benchmarks/augmentation.py --seed 100 --json

Four pumps train, with two recordings of each class at each pressure. Of the swash plate fault at 15 MPa (``scarce``)
one recording of one pump trains; at 10 MPa (``full``) nothing is scarce. 150 windows are made of each cell. They are
compared with third recordings of the same four pumps, which no filler and no calibration saw; ``copied`` looks at the
training windows. The row ``measured`` compares the training windows of the full cell themselves. ``tstr`` is the
balanced accuracy, on the third recordings of all classes at all pressures, of extra trees that saw 60 windows made of
every cell and no measured one. Figures on the virtual rig say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json
import time
from functools import partial

import torch

from swashtwin.bench import FILLERS, rig_recordings
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.bench.studies.cells import cut_evenly
from swashtwin.bench.studies.scenario import MACHINED
from swashtwin.bench.studies.training_sets import RIG_VARIATION
from swashtwin.calibration import GaussNewton, Nuisances, calibrate
from swashtwin.foundation import MPa, rpm
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, load_pump
from swashtwin.recordings import Recording
from swashtwin.synthesis import Filler, TwinFiller, copied_share, discriminative_score, in_cell, spectral_distance
from swashtwin.synthesis.fidelity import train_synthetic_test_real

SIZE = RigSize(specimens=6, repeats=3, duration=3.0)
LABEL = "swash_plate"
CELLS = {"scarce": MPa(15), "full": MPa(10)}
COUNT, PER_CELL, PER_RECORDING = 150, 60, 14


def split(recordings: list[Recording]) -> tuple[list[Recording], list[Recording]]:
    """(training, test) recordings: the first two of four pumps, and the third; the scarce cell keeps one."""
    pumps = sorted({str(recording.specimen) for recording in recordings})[:4]
    of_pumps = [recording for recording in recordings if recording.specimen in pumps]
    last = max(recording.recording_id.rsplit("_", 1)[-1] for recording in of_pumps)
    train = [recording for recording in of_pumps if not recording.recording_id.endswith(f"_{last}")]
    scarce = [
        recording
        for recording in train
        if recording.label == LABEL and recording.condition and recording.condition.discharge_pressure == MPa(15)
    ]
    dropped = {recording.recording_id for recording in scarce[1:]}
    return [recording for recording in train if recording.recording_id not in dropped], [
        recording for recording in of_pumps if recording not in train
    ]


def twins(train: list[Recording]) -> dict[str, Filler]:
    """Nominal twins of every class, and those calibrated over several backgrounds.

    One twin for each pump and class is calibrated on that pump's training recordings of the class at 10 MPa, its fault
    as machined; and one for each pump on its healthy recordings alone, at every pressure, the housing's constants free,
    which then is given every fault.
    """
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10))
    faults = {"normal": (None,), **MACHINED}
    nominal = [
        Twin(load_pump("25scy14-1b"), condition, fault)
        for faults_of_class in faults.values()
        for fault in faults_of_class
    ]
    pumps = sorted({str(recording.specimen) for recording in train})
    calibrations, machines = [], []
    for twin in nominal:
        for pump in pumps:
            of_pump = [r for r in train if r.specimen == pump and r.label == twin.label and r.condition]
            at_10 = [r for r in of_pump if r.condition and r.condition.discharge_pressure == MPa(10)]
            calibrations.append(calibrate(twin, at_10, method=GaussNewton(), nuisances=Nuisances.usual(), phases=False))
            machines.append(pump)
    calibrated, posteriors = (
        [calibration.twin for calibration in calibrations],
        [calibration.posterior for calibration in calibrations],
    )
    healthy = [
        calibrate(
            nominal[0],
            [recording for recording in train if recording.specimen == pump and recording.label == "normal"],
            method=GaussNewton(),
            nuisances=Nuisances.housing(),
            phases=False,
        ).twin
        for pump in pumps
    ]
    fill = partial(TwinFiller, variation=RIG_VARIATION)
    return {
        "nominal twin": fill(nominal),
        "calibrated, bare": fill(calibrated, background="none"),
        "calibrated": fill(calibrated),
        "calibrated, residual": fill(calibrated, background="residual", specimens=machines),
        "calibrated, posterior": fill(calibrated, posterior=posteriors),
        "calibrated on healthy": fill(
            [twin_of_healthy.with_fault(twin.fault) for twin in nominal for twin_of_healthy in healthy]
        ),
    }


def row(name: str, filler: Filler, train: WindowSet, test: WindowSet, seed: int) -> dict[str, object]:
    """Likeness in both cells, cost, and what trees learn from it."""
    figures: dict[str, object] = {"filler": name}
    for cell, pressure in CELLS.items():
        began = time.process_time()
        synthetic = filler(train, label=LABEL, pressure=pressure, count=COUNT, seed=seed)
        figures.setdefault("cpu_s", time.process_time() - began)
        held_out = test.subset(in_cell(test, LABEL, pressure))
        figures[cell] = {
            "distance_db": spectral_distance(held_out, synthetic).tolist(),
            "auroc": discriminative_score(held_out, synthetic, seed=seed),
            "copied": copied_share(train, synthetic),
        }
    scores = train_synthetic_test_real(filler, train, test, per_cell=PER_CELL, seed=seed)
    return figures | {"tstr": scores[0].macro_recall, "measured": scores[1].macro_recall}


def main() -> None:
    """Print one row after another, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100, help="seed of the rig and of the fillers")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    torch.set_num_threads(1)
    recordings, tested = split([recording for recording, _ in rig_recordings(options.seed, SIZE)])
    train = cut_evenly(recordings, length=2048, count=PER_RECORDING)
    test = cut_evenly(tested, length=2048, count=PER_RECORDING, like=train)
    measured_train, measured_test = (
        windows.subset(in_cell(windows, LABEL, CELLS["full"])) for windows in (train, test)
    )
    rows: list[dict[str, object]] = [
        {
            "filler": "measured",
            "full": {
                "distance_db": spectral_distance(measured_test, measured_train).tolist(),
                "auroc": discriminative_score(measured_test, measured_train, seed=options.seed),
            },
        }
    ]
    for name, filler in {**FILLERS, **twins(recordings)}.items():
        rows.append(row(name, filler, train, test, options.seed))
        if not options.json:
            print(json.dumps(rows[-1]), flush=True)
    print(json.dumps({"rows": rows, "seed": options.seed, "windows": len(train)} if options.json else rows[0]))


if __name__ == "__main__":
    main()
