"""What the default training costs, and a diagnosis after loading: seconds, and as a ratio to extra trees on the same.

    python benchmarks/default_training.py --windows 3000 --json

Windows are of a fleet of the virtual rig: recordings of 4 s, drawn from all pumps, classes and pressures, until there
are enough. Both classifiers are trained by `FaultClassifier` with nothing set but the seed; the peer is the extra trees
of scikit-learn on vibration features of the same windows. A diagnosis begins with a recording in memory and the model
loaded from its file (the peer has no file) and ends with the verdict; the first one stands by itself.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.bench import SIZES, rig_recordings
from swashtwin.diagnosis import FaultClassifier
from swashtwin.recordings import Recording

PEER = "extra_trees"


def training_recordings(seed: int, windows: int, length: int) -> tuple[list[Recording], Recording]:
    """(recordings that hold so many windows, one more)."""
    size = SIZES["paper"]
    recordings = [recording for recording, _ in rig_recordings(seed, size)]
    count = -(-windows // (recordings[0].n_samples // length))
    if count >= len(recordings):
        raise SystemExit(f"a fleet holds {len(recordings)} recordings, too few for {windows} windows of {length}")
    order = np.random.default_rng(seed).permutation(len(recordings))
    return [recordings[index] for index in order[:count]], recordings[order[-1]]


def timed(work: Callable[[], Any]) -> tuple[float, float, Any]:
    """(time by the clock [s], processor time [s], result)."""
    clock, processor = time.perf_counter(), time.process_time()
    result = work()
    return time.perf_counter() - clock, time.process_time() - processor, result


def loaded(classifier: FaultClassifier, name: str) -> FaultClassifier:
    """The classifier as read from its file; the peer as it is."""
    if name == PEER:
        return classifier
    with tempfile.TemporaryDirectory() as folder:
        return FaultClassifier.load(classifier.save(Path(folder) / "model.safetensors"))


def row_of(
    name: str, classifier: FaultClassifier, recordings: list[Recording], test: Recording, repeats: int
) -> dict[str, Any]:
    """Times of one classifier."""
    clock, processor, fitted = timed(lambda: classifier.fit(recordings))
    ready = loaded(fitted, name)
    diagnoses = 1000 * np.array([timed(lambda: ready.diagnose(test))[:2] for _ in range(repeats + 1)])
    return {
        "classifier": name,
        "window": ready.fitted_.layout.length,
        "training_s": clock,
        "training_cpu_s": processor,
        "first_diagnosis_ms": float(diagnoses[0, 0]),
        "diagnosis_ms": float(np.median(diagnoses[1:, 0])),
        "diagnosis_cpu_ms": float(np.median(diagnoses[1:, 1])),
    }


def main() -> None:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=3000, help="windows to train on, about")
    parser.add_argument("--length", type=int, default=8192, help="samples of the default's windows, for counting")
    parser.add_argument("--seed", type=int, default=0, help="fleet of the rig, and seed of the trainings")
    parser.add_argument("--repeats", type=int, default=20, help="diagnoses after the first one; the median counts")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    recordings, test = training_recordings(options.seed, options.windows, options.length)
    default = FaultClassifier(seed=options.seed)
    rows = [row_of("default", default, recordings, test, options.repeats)]
    peer = FaultClassifier(PEER, window=rows[0]["window"], seed=options.seed)
    rows.append(row_of(PEER, peer, recordings, test, options.repeats))
    times = [name for name in rows[0] if name.endswith(("_s", "_ms"))]
    ratios = {name: rows[0][name] / rows[1][name] for name in times}
    if options.json:
        print(json.dumps({"recordings": len(recordings), "rows": rows, "ratios": ratios}))
        return
    for name in ("classifier", "window", *times):
        ratio = f"{ratios[name]:10.2f} times" if name in ratios else ""
        print(f"{name:20s}", *(f"{row[name]:>14.4g}" if name in times else f"{row[name]:>14}" for row in rows), ratio)


if __name__ == "__main__":
    main()
