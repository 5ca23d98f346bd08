"""Why a new pump is classified wrong after a training on two: the pump's offset, or its faults.

    python benchmarks/fault_signatures.py --fleets 110,111 --version 2

Extra trees on the band powers of whole recordings are trained on two pumps and tested on each of
the other four, for three pairs of a fleet. One line of JSON for each pair holds, by tested pump:
``right``, the share of recordings classified right; ``right_shifted``, the same after the mean of
the pump's healthy recordings was shifted to that of the training; ``called_normal``, the share of
its faulty recordings called normal after the shift; and ``similarity``, the mean cosine between the
change by a fault on this pump and on the training pumps. If the offset of the pump were the cause,
the shift would mend it.
"""

import argparse
import json
from collections.abc import Iterator

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

from swashtwin.learning.recordings.recording_bands import MAX_ORDERS, RecordingBandLayout
from swashtwin_bench import SIZES, rig_recordings

N_TREES = 150
PAIRS = ((0, 1), (2, 3), (4, 5))


def measure_fleet(fleet: int, version: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the band powers of recordings without gains, their classes and their pumps."""
    band_powers = []
    labels = []
    pumps = []
    for recording, _ in rig_recordings(fleet, SIZES["short"], version=version):
        signal = recording.signal
        layout = RecordingBandLayout(recording.sample_rate, signal.shape[1], MAX_ORDERS)
        assert recording.condition is not None
        measured = layout.measure(signal, recording.condition.shaft_frequency)
        band_powers.append(layout.shapes(measured).ravel())
        labels.append(recording.label)
        pumps.append(recording.specimen)
    return np.array(band_powers), np.array(labels), np.unique(pumps, return_inverse=True)[1]


def fault_changes(values: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Return the mean change (fault, band) by each fault against the healthy recordings."""
    healthy = values[label == "normal"].mean(axis=0)
    faults = [name for name in np.unique(label) if name != "normal"]
    return np.stack([values[label == name].mean(axis=0) - healthy for name in faults])


def compare_pairs(fleet: int, version: str) -> Iterator[dict[str, object]]:
    """Yield the figures of each pair of training pumps."""
    values, label, pump = measure_fleet(fleet, version)
    for pair in PAIRS:
        is_trained = np.isin(pump, pair)
        trees = ExtraTreesClassifier(N_TREES, random_state=0)
        trees.fit(values[is_trained], label[is_trained])
        trained_changes = np.mean(
            [fault_changes(values[pump == number], label[pump == number]) for number in pair],
            axis=0,
        )
        trained_healthy = values[is_trained & (label == "normal")].mean(axis=0)

        figures: dict[str, list[float]] = {
            "right": [],
            "right_shifted": [],
            "called_normal": [],
            "similarity": [],
        }
        for number in np.unique(pump[~is_trained]):
            tested = values[pump == number]
            true = label[pump == number]
            shift = trained_healthy - tested[true == "normal"].mean(axis=0)
            shifted = trees.predict(tested + shift)
            changes = fault_changes(tested, true)
            norms = np.linalg.norm(changes, axis=1) * np.linalg.norm(trained_changes, axis=1)

            figures["right"].append(float(np.mean(trees.predict(tested) == true)))
            figures["right_shifted"].append(float(np.mean(shifted == true)))
            is_missed = shifted[true != "normal"] == "normal"
            figures["called_normal"].append(float(is_missed.mean()))
            cosines = (changes * trained_changes).sum(axis=1) / norms
            figures["similarity"].append(float(cosines.mean()))
        yield {"fleet": fleet, "version": version, "trained": pair, **figures}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", required=True, help="such as 110,111")
    parser.add_argument("--version", default="2", help="version of the rig")
    arguments = parser.parse_args()
    for number in map(int, arguments.fleets.split(",")):
        for row in compare_pairs(number, arguments.version):
            print(json.dumps(row), flush=True)
