"""Faults that a training did not hold: how often they are unknown, by the classifier alone and with
the pump prior.

    python benchmarks/left_out.py --fleets 100,101 --version 2

Each fault in turn is left out of the training on four pumps of the virtual rig, which stands in for
a machine. Two thirds of their recordings train; the others test, and those of two new pumps, whose
healthy recordings are known. One line of JSON a fleet, with shares of recordings; a fault that is
"named" is the one that the answer says it resembles.
"""

import argparse
import json
from dataclasses import replace

import numpy as np

from swashtwin.diagnosis import FaultClassifier
from swashtwin.pump import CLASSES
from swashtwin.recordings import Recording
from swashtwin_bench import SIZES, rig_recordings


def fleet_row(fleet: int, version: str) -> dict[str, object]:
    """Figures of one fleet."""
    recordings: list[Recording] = [
        pair[0] for pair in rig_recordings(fleet, SIZES["small"], version=version)
    ]
    names = sorted({str(item.specimen) for item in recordings})
    known = names[:4]
    trains = [
        item
        for item in recordings
        if item.specimen in known and not item.recording_id.endswith("_1")
    ]
    tests = {
        "same": [
            item
            for item in recordings
            if item.specimen in known and item.recording_id.endswith("_1")
        ],
        "new": [item for item in recordings if item.specimen not in known],
    }
    healthy = [
        item
        for item in tests["new"]
        if item.label == "normal" and not item.recording_id.endswith("_1")
    ]
    tests["new"] = [item for item in tests["new"] if item not in healthy]
    hits: dict[str, list[bool]] = {}
    for left_out in CLASSES[1:]:
        taught = [item for item in trains if item.label != left_out]
        classifier = FaultClassifier(prior="25scy14-1b").fit(taught).with_healthy(healthy)
        for level, group in tests.items():
            for item in group:
                bare = replace(item, label=None)
                joined = classifier.diagnose(bare)
                classifier.resemblance_, kept = None, classifier.resemblance_
                alone = classifier.diagnose(bare)
                classifier.resemblance_ = kept
                what = "caught" if item.label == left_out else "false"
                hits.setdefault(f"{level}_{what}_alone", []).append(alone.unknown)
                hits.setdefault(f"{level}_{what}_joined", []).append(joined.unknown)
                if item.label == left_out:
                    word = f"resembles {left_out.replace('_', ' ')}"
                    hits.setdefault(f"{level}_named", []).append(
                        any(word in text for text in joined.reasons)
                    )
    counts = {}
    for level in tests:
        for what in ("caught", "false"):
            counts[f"n_{level}_{what}"] = len(hits[f"{level}_{what}_joined"])
    return {
        "fleet": fleet,
        "version": version,
        **counts,
        **{name: float(np.mean(hit)) for name, hit in hits.items()},
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", required=True, help="such as 100,101")
    parser.add_argument("--version", default="2", help="version of the rig")
    asked = parser.parse_args()
    for number in map(int, asked.fleets.split(",")):
        print(json.dumps(fleet_row(number, asked.version)), flush=True)
