"""Coverage and size of the prediction sets of the ordinary training on pumps that it has not heard.

    python benchmarks/prediction_sets.py --fleets 110,111 --version 2 --pumps 2

Each fleet prints one line of JSON, without and with the healthy recordings of the tested pumps. The
smallest size is that of sets with one threshold for all recordings, selected on the tested
recordings themselves to cover nine in ten: no calibration of the same p-values does better.
"""

import argparse
import json
from collections.abc import Sequence

import numpy as np

from swashtwin.diagnosis import Diagnosis, FaultClassifier
from swashtwin.recordings import Recording
from swashtwin_bench import SIZES, rig_recordings

COVERAGE = 0.9


def score_sets(answers: Sequence[Diagnosis], tested: Sequence[Recording]) -> dict[str, float]:
    """Return accuracy, coverage, mean size, the worst pump's coverage, and the smallest size."""
    labels = [str(recording.label) for recording in tested]
    pumps = np.array([recording.specimen for recording in tested])
    covered = np.array(
        [label in answer.prediction_set for label, answer in zip(labels, answers, strict=True)]
    )
    by_pump = [covered[pumps == name].mean() for name in np.unique(pumps)]

    true_p_values = [
        answer.plausibility[name] for name, answer in zip(labels, answers, strict=True)
    ]
    threshold = np.sort(true_p_values)[int((1 - COVERAGE) * len(labels))]
    smallest = [
        max(1, sum(p_value >= threshold for p_value in answer.plausibility.values()))
        for answer in answers
    ]
    return {
        "accuracy": float(
            np.mean([answer.label == name for answer, name in zip(answers, labels, strict=True)])
        ),
        "coverage": float(covered.mean()),
        "size": float(np.mean([len(answer.prediction_set) for answer in answers])),
        "worst_pump": float(min(by_pump)),
        "smallest_size": float(np.mean(smallest)),
    }


def score_fleet(fleet: int, version: str, n_pumps: int) -> dict[str, object]:
    """Return the figures of a fleet, trained on some of its pumps and tested on the others."""
    recordings = [pair[0] for pair in rig_recordings(fleet, SIZES["short"], version=version)]
    names = np.roll(np.unique([recording.specimen or "" for recording in recordings]), -2 * fleet)
    trained = set(names[:n_pumps].tolist())
    tested = [recording for recording in recordings if recording.specimen not in trained]
    classifier = FaultClassifier().fit(
        [recording for recording in recordings if recording.specimen in trained]
    )
    compared = classifier.with_healthy([item for item in tested if item.label == "normal"])
    return {
        "fleet": fleet,
        "version": version,
        "pumps": n_pumps,
        "n": len(tested),
        "alone": score_sets([classifier.diagnose(item) for item in tested], tested),
        "with_own_healthy": score_sets([compared.diagnose(item) for item in tested], tested),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", required=True, help="such as 110,111")
    parser.add_argument("--version", default="2", help="version of the rig")
    parser.add_argument("--pumps", type=int, default=2, help="training pumps, of six")
    arguments = parser.parse_args()
    for number in map(int, arguments.fleets.split(",")):
        row = score_fleet(number, arguments.version, arguments.pumps)
        print(json.dumps(row), flush=True)
