"""What Case I's scores on the virtual rig lack: would more recordings, or more pumps, be enough?

    python benchmarks/more_recordings.py --fleets 3 --json

The study's default network learns from Case I's measured windows at paper size, and from those with further measured
recordings at 15 MPa beside them, all classes alike: of the training pumps, or of other pumps of the same fleet.
The tests are the study's, and no test recording is among what is added. The rows with more stand for nothing that
anybody has; they tell errors that come from few recordings from errors that no number of them would mend. Figures on
the virtual rig say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json
from collections.abc import Iterator

import torch
from joblib import Parallel, delayed

from swashtwin.bench import SIZES, rig_recordings
from swashtwin.bench.results.table import spread
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.bench.rivals.models import DEFAULT, MODELS, train_model
from swashtwin.bench.studies.cases import SCENARIOS
from swashtwin.bench.studies.cells import cut_evenly
from swashtwin.bench.studies.dataset import StudyDataset, prepare
from swashtwin.learning import WindowSet, evaluate
from swashtwin.recordings import Recording

SCENARIO = SCENARIOS["paper"]
MORE_REPEATS, MORE_PUMPS = 12, 20
ROWS = {"as measured": (), "12 more of each": ("repeats",), "20 more pumps": ("pumps",)}
METRICS = ("accuracy", "recording_accuracy")


def further(seed: int, size: RigSize) -> Iterator[Recording]:
    """Recordings of a larger fleet of the same seed at the tested pressure, those of the paper-sized one left out."""
    size_paper = SIZES["paper"]
    for recording, run in rig_recordings(seed, size):
        repeat = int(recording.recording_id.rpartition("_")[2])
        index = ord(run.specimen.name) - ord("A")
        if SCENARIO.is_near(recording) and not (index < size_paper.specimens and repeat <= size_paper.repeats):
            yield recording


def cut(recordings: Iterator[Recording], like: WindowSet) -> WindowSet:
    """As many windows of each as the study takes; the recordings themselves are not kept."""
    windows = like.subset(like.synthetic)
    for recording in recordings:
        windows = windows + cut_evenly([recording], length=SCENARIO.length, count=SCENARIO.windows, like=like)
    return windows


def of_fleet(seed: int) -> dict[str, dict[str, dict[str, float]]]:
    """Scores by row and level of the study on one fleet."""
    torch.set_num_threads(1)
    size_paper = SIZES["paper"]
    dataset: StudyDataset = prepare(
        [recording for recording, _ in rig_recordings(seed, size_paper)], SCENARIO, seed, ()
    )
    measured = dataset.measured
    trained_on = set(measured.specimen.tolist())
    repeats = RigSize(size_paper.specimens, size_paper.repeats + MORE_REPEATS)
    more = {
        "repeats": cut((r for r in further(seed, repeats) if r.specimen in trained_on), measured),
        "pumps": cut(further(seed, RigSize(size_paper.specimens + MORE_PUMPS, size_paper.repeats)), measured),
    }
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for row, added in ROWS.items():
        train = measured
        for name in added:
            train = train + more[name]
        classifier = train_model(MODELS["paper"][DEFAULT], train, seed=seed, manifest=dataset.manifest)
        scores = {level: evaluate(classifier, test, level=level) for level, test in dataset.tests.items()}
        rows[row] = {level: {name: getattr(score, name) for name in METRICS} for level, score in scores.items()}
    return rows


def main() -> None:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=3, help="seeds 0... of the rig")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    fleets = Parallel(n_jobs=options.jobs)(delayed(of_fleet)(seed) for seed in range(options.fleets))
    rows = [
        {"trained on": row, "level": level}
        | {name: spread([fleet[row][level][name] for fleet in fleets]) for name in METRICS}
        for row in ROWS
        for level in SCENARIO.levels
    ]
    if options.json:
        print(json.dumps({"rows": rows, "fleets": options.fleets}))
        return
    for row in rows:
        words = ", ".join(f"{name} {row[name]['mean']:.3f}" for name in METRICS)
        print(f"{row['trained on']:16s} {row['level']}: {words}")


if __name__ == "__main__":
    main()
