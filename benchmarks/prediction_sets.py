"""Coverage and size of the prediction sets of the ordinary training on pumps that it has not heard.

    python benchmarks/prediction_sets.py --fleets 110,111 --version 2 --pumps 2

Each fleet prints one line of JSON, without and with the healthy recordings of the tested pumps. Of
the same answers it scores three kinds of sets: those of the product, those that the held-out
recordings of the training alone give (``held_out``), and those of the held-out machine that was
hardest to classify (``hardest_machine``), which was the rule before virtual problems. The smallest
size is that of sets with one threshold for all recordings, selected on the tested recordings
themselves to cover nine in ten: no calibration of the same scores does better.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swashtwin.diagnosis import FaultClassifier
from swashtwin.learning import Confidence, FittedClassifier
from swashtwin.learning.evaluation.confidence_calibration import predict_recordings
from swashtwin.learning.training.confidence import nonconformity_scores
from swashtwin.recordings import Recording
from swashtwin_bench import SIZES, rig_recordings

COVERAGE = 0.9


def of_hardest_machine(confidence: Confidence, fitted: FittedClassifier) -> Confidence:
    """Return the confidence of the held-out machine with the highest mean score."""
    reference = fitted.training_reference
    assert reference is not None
    machine = np.array(reference.specimen)
    score = confidence.nonconformity_score
    hardest = max(np.unique(machine), key=lambda name: score[-1, machine == name].mean())
    selected = machine == hardest
    return replace(
        confidence,
        nonconformity_score=score[:, selected],
        target=confidence.target[selected],
        ood_score=np.sort(confidence.ood_score[selected]),
        n_machines=0,
    )


def score_sets(fitted: FittedClassifier, tested: Sequence[Recording]) -> dict[str, object]:
    """Return the accuracy, the smallest size, and the figures of each kind of sets.

    They are coverage, mean size, the share of recordings called unknown although their class was
    trained, and the coverage of each pump.
    """
    confidence = fitted.confidence_of(str(tested[0].specimen))
    assert confidence is not None
    predictions = predict_recordings(fitted, fitted.cut_windows(tested))
    pump_of = {recording.recording_id: recording.specimen for recording in tested}
    pumps = np.array([pump_of[name] for name in predictions.recording_id])
    probability = predictions.probability
    target = predictions.target
    rows = np.arange(len(target))

    score = nonconformity_scores(probability)
    threshold = np.sort(score[rows, target])[int(COVERAGE * len(target))]
    figures: dict[str, object] = {
        "accuracy": float((probability.argmax(axis=1) == target).mean()),
        "smallest_size": float(np.maximum((score <= threshold).sum(axis=1), 1).mean()),
    }
    rules = {
        "product": confidence,
        "held_out": replace(confidence, n_machines=10),  # so many machines need no adjustment
        "hardest_machine": of_hardest_machine(confidence, fitted),
    }
    for name, rule in rules.items():
        in_set = rule.prediction_set(probability, predictions.n_windows)
        covered = in_set[rows, target]
        figures[name] = {
            "coverage": float(covered.mean()),
            "size": float(in_set.sum(axis=1).mean()),
            "called_unknown": float(
                (rule.ood_p_value(predictions.ood_score) <= rule.error_rate).mean()
            ),
            "by_pump": [float(covered[pumps == pump].mean()) for pump in np.unique(pumps)],
        }
    return figures


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
        "alone": score_sets(classifier.fitted_, tested),
        "with_own_healthy": score_sets(compared.fitted_, tested),
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
