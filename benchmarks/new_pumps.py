"""The ordinary training on pumps that it has not heard, alone and with their own healthy
recordings, beside trees.

    python benchmarks/new_pumps.py --fleets 30,31 --version 2 --pumps 2

Trees are extra trees on the band powers of whole recordings (`RecordingBandLayout`), and on their
changes from the median of the other healthy recordings of the pump at the pressure. Each fleet
prints one line of JSON.
"""

import argparse
import json
import time
from collections.abc import Sequence

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

from swashtwin.diagnosis import Diagnosis, FaultClassifier
from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.recordings import Recording
from swashtwin_bench import SIZES, rig_recordings


def judged(answers: Sequence[Diagnosis], label: np.ndarray) -> dict[str, float]:
    """Shares of recordings named right, right or doubtful, and sure (0.8 or more) and wrong."""
    right = np.array([answer.label for answer in answers]) == label
    unknown = np.array([answer.unknown for answer in answers])
    doubtful = unknown | np.array([len(answer.prediction_set) > 1 for answer in answers])
    sure = np.array([max(answer.probabilities.values()) >= 0.8 for answer in answers]) & ~unknown
    return {
        "right": float(right.mean()), "right_or_doubtful": float((right | doubtful).mean()),
        "sure_and_wrong": float((sure & ~right).mean()),
    }  # fmt: skip


def trees(values: np.ndarray, label: np.ndarray, trains: np.ndarray) -> float:
    """Share of the other recordings that extra trees name right."""
    grown = ExtraTreesClassifier(300, random_state=0).fit(values[trains], label[trains])
    return float(grown.score(values[~trains], label[~trains]))


def fleet_row(fleet: int, version: str, pumps: int) -> dict[str, object]:
    """Figures of one fleet: trained on as many pumps, in turn by the fleet's number, and tested on
    all others.
    """
    recordings: list[Recording] = [
        pair[0] for pair in rig_recordings(fleet, SIZES["small"], version=version)
    ]
    specimen = np.array([recording.specimen for recording in recordings])
    label = np.array([recording.label for recording in recordings])
    names = np.roll(np.unique(specimen), -2 * fleet)
    trains = np.isin(specimen, names[:pumps])
    begun = time.process_time()
    classifier = FaultClassifier().fit(
        [item for item, use in zip(recordings, trains, strict=True) if use]
    )
    cost = time.process_time() - begun
    tested = [item for item, use in zip(recordings, trains, strict=True) if not use]
    compared = classifier.with_healthy([item for item in tested if item.label == "normal"])
    layout = RecordingBandLayout(recordings[0].sample_rate, 98304, 40)
    shafts = [
        item.condition.speed / (2 * np.pi) for item in recordings if item.condition is not None
    ]
    heard = zip(recordings, shafts, strict=True)
    band_powers = np.stack(
        [layout.measure(item.signal[:, : layout.length], shaft).ravel() for item, shaft in heard]
    )
    pressure = np.array(
        [item.condition.discharge_pressure for item in recordings if item.condition is not None]
    )
    changes = band_powers.copy()
    for row in range(len(band_powers)):
        beside = (label == "normal") & (specimen == specimen[row]) & (pressure == pressure[row])
        beside[row] = False
        changes[row] -= np.median(band_powers[beside], axis=0)
    return {
        "fleet": fleet,
        "version": version,
        "pumps": pumps,
        "n": len(tested),
        "training_cpu_s": cost,
        "default": judged([classifier.diagnose(item) for item in tested], label[~trains]),
        "with_own_healthy": judged([compared.diagnose(item) for item in tested], label[~trains]),
        "trees_on_levels": trees(band_powers, label, trains),
        "trees_on_changes": trees(changes, label, trains),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", required=True, help="such as 30,31")
    parser.add_argument("--version", default="2", help="version of the rig")
    parser.add_argument("--pumps", type=int, default=2, help="training pumps, of six")
    asked = parser.parse_args()
    for number in map(int, asked.fleets.split(",")):
        print(json.dumps(fleet_row(number, asked.version, asked.pumps)), flush=True)
