"""How like measured windows are those that fill a scarce cell, and what each filler costs, on the virtual rig.

    python benchmarks/augmentation.py --seed 100 --json

Four pumps train, with two recordings of each class at each pressure. Of the swash plate fault at 15 MPa (``scarce``)
one recording of one pump trains; at 10 MPa (``full``) nothing is scarce. 150 windows are made of each cell. They are
compared with third recordings of the same four pumps, which no filler and no calibration saw; ``copied`` looks at the
training windows. The row ``measured`` compares the training windows of the full cell themselves. ``tstr`` is the
balanced accuracy, on the third recordings of all classes at all pressures, of extra trees that saw 60 windows made of
every cell and no measured one. Figures on the virtual rig say nothing about a real pump (docs/rig.md).
"""

import argparse
import json
import time

import torch

from swashtwin.bench import FILLERS, rig_recordings
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.bench.studies.cells import cut_evenly
from swashtwin.bench.studies.scenario import MACHINED
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
    pumps = sorted({str(one.specimen) for one in recordings})[:4]
    own = [one for one in recordings if one.specimen in pumps]
    last = max(one.recording_id.rsplit("_", 1)[-1] for one in own)
    train = [one for one in own if not one.recording_id.endswith(f"_{last}")]
    scarce = [
        one for one in train if one.label == LABEL and one.condition and one.condition.discharge_pressure == MPa(15)
    ]
    dropped = {one.recording_id for one in scarce[1:]}
    return [one for one in train if one.recording_id not in dropped], [one for one in own if one not in train]


def twins(train: list[Recording]) -> dict[str, Filler]:
    """Nominal twins of every class, and those calibrated over several backgrounds.

    One twin for each pump and class is calibrated on that pump's training recordings of the class at 10 MPa, its fault
    as machined; and one for each pump on its healthy recordings alone, at every pressure, the housing's constants free,
    which then is given every fault.
    """
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10))
    faults = {"normal": (None,), **MACHINED}
    nominal = [Twin(load_pump("25scy14-1b"), condition, fault) for one in faults.values() for fault in one]
    pumps = sorted({str(one.specimen) for one in train})
    found, machines = [], []
    for twin in nominal:
        for pump in pumps:
            own = [r for r in train if r.specimen == pump and r.label == twin.label and r.condition]
            known = [r for r in own if r.condition and r.condition.discharge_pressure == MPa(10)]
            found.append(calibrate(twin, known, method=GaussNewton(), nuisances=Nuisances.usual(), phases=False))
            machines.append(pump)
    calibrated, posteriors = [one.twin for one in found], [one.posterior for one in found]
    healthy = [
        calibrate(
            nominal[0],
            [one for one in train if one.specimen == pump and one.label == "normal"],
            method=GaussNewton(),
            nuisances=Nuisances.housing(),
            phases=False,
        ).twin
        for pump in pumps
    ]
    return {
        "nominal twin": TwinFiller(nominal),
        "calibrated, bare": TwinFiller(calibrated, background="none"),
        "calibrated": TwinFiller(calibrated),
        "calibrated, residual": TwinFiller(calibrated, background="residual", specimens=machines),
        "calibrated, posterior": TwinFiller(calibrated, posterior=posteriors),
        "calibrated on healthy": TwinFiller([one.with_fault(twin.fault) for twin in nominal for one in healthy]),
    }


def row(name: str, filler: Filler, train: WindowSet, test: WindowSet, seed: int) -> dict[str, object]:
    """Likeness in both cells, cost, and what trees learn from it."""
    told: dict[str, object] = {"filler": name}
    for cell, pressure in CELLS.items():
        began = time.process_time()
        made = filler(train, label=LABEL, pressure=pressure, count=COUNT, seed=seed)
        told.setdefault("cpu_s", time.process_time() - began)
        held = test.subset(in_cell(test, LABEL, pressure))
        told[cell] = {
            "distance_db": spectral_distance(held, made).tolist(),
            "auroc": discriminative_score(held, made, seed=seed),
            "copied": copied_share(train, made),
        }
    scores = train_synthetic_test_real(filler, train, test, per_cell=PER_CELL, seed=seed)
    return told | {"tstr": scores[0].macro_recall, "measured": scores[1].macro_recall}


def main() -> None:
    """Print one row after another, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100, help="seed of the rig and of the fillers")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    recordings, tested = split([one for one, _ in rig_recordings(asked.seed, SIZE)])
    train = cut_evenly(recordings, length=2048, count=PER_RECORDING)
    test = cut_evenly(tested, length=2048, count=PER_RECORDING, like=train)
    own, held = (one.subset(in_cell(one, LABEL, CELLS["full"])) for one in (train, test))
    rows: list[dict[str, object]] = [
        {
            "filler": "measured",
            "full": {
                "distance_db": spectral_distance(held, own).tolist(),
                "auroc": discriminative_score(held, own, seed=asked.seed),
            },
        }
    ]
    for name, filler in {**FILLERS, **twins(recordings)}.items():
        rows.append(row(name, filler, train, test, asked.seed))
        if not asked.json:
            print(json.dumps(rows[-1]), flush=True)
    print(json.dumps({"rows": rows, "seed": asked.seed, "windows": len(train)} if asked.json else rows[0]))


if __name__ == "__main__":
    main()
