"""How hard the virtual rig's versions are for trees trained on measured windows alone (docs/bench/rig.md).

Extra trees on time statistics, bands and envelopes of windows of 80 ms; six pumps, every class and pressure, four
recordings of one second. L2: a pump's first, then its last recordings are left out. L4: two pumps at a time are.

python benchmarks/rig_difficulty.py --seeds 100,101,102,103,104
"""

import argparse
from collections.abc import Iterator

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

from swashtwin.bench import rig_recordings
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.learning import WindowSet, cut_windows, extract_features

SIZE = RigSize(specimens=6, repeats=4, duration=1.0)


def folds(windows: WindowSet, level: str) -> Iterator[np.ndarray]:
    """Windows left out at a time."""
    if level == "L4":
        yield from (np.isin(windows.specimen, pumps) for pumps in (["A", "B"], ["C", "D"], ["E", "F"]))
    else:
        repeat = np.array([name[-1] for name in windows.recording_id])
        yield from (repeat == number for number in "14")


def scores(windows: WindowSet, level: str) -> tuple[float, float]:
    """Accuracy by window and by recording, whose windows' log-probabilities are averaged."""
    features, label, recording = extract_features(windows).values, np.array(windows.label), windows.recording_id
    by_window, by_recording = [], []
    for test in folds(windows, level):
        trees = ExtraTreesClassifier(200, random_state=0).fit(features[~test], label[~test])
        share = trees.predict_proba(features[test])
        by_window.append(np.mean(trees.classes_[share.argmax(axis=1)] == label[test]))
        hits = []
        for name in np.unique(recording[test]):
            whole = np.log(share[recording[test] == name] + 1e-3).mean(axis=0)
            hits.append(trees.classes_[whole.argmax()] == label[recording == name][0])
        by_recording.append(np.mean(hits))
    return float(np.mean(by_window)), float(np.mean(by_recording))


def main() -> None:
    """Print a line for each version, fleet and level, and the means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="100,101,102,103,104", help="fleets")
    parser.add_argument("--versions", default="1,2", help="versions of the rig")
    options = parser.parse_args()
    for version in options.versions.split(","):
        collected: dict[str, list[tuple[float, float]]] = {"L2": [], "L4": []}
        for seed in map(int, options.seeds.split(",")):
            recordings = [recording for recording, _ in rig_recordings(seed, SIZE, version=version)]
            windows = cut_windows(recordings, length=2048, stride=3900)
            for level, results in collected.items():
                results.append(scores(windows, level))
                print(
                    f"version {version}, fleet {seed}, {level}: {results[-1][0]:.3f}, {results[-1][1]:.3f}", flush=True
                )
        for level, results in collected.items():
            window, recording = np.mean(results, axis=0)
            print(f"version {version}, {level}: by window {window:.3f}, by recording {recording:.3f}", flush=True)


if __name__ == "__main__":
    main()
