"""How far slippers follow a recess: what `calibrate(law=...)` finds on the virtual rig, beside the hidden truth.

``python benchmarks/recess_law.py --fleets 100,101,102 --pumps ABC``. Each pump is calibrated on its healthy recordings,
and its law searched on those of the recess at 5 and 10 MPa. Version 1 of the rig falls by 1 / (1 + (f / corner)^2), the
law by 2^-(f / corner)^fall: at the corner both leave half.
"""

import argparse

import numpy as np

from swashtwin.calibration import GaussNewton, Nuisances, calibrate
from swashtwin.foundation import MPa, mm
from swashtwin.pump import SwashPlateDefect
from swashtwin_bench.rigs.writing import SIZES, rig_recordings


def main() -> None:
    """Print a row for each pump, and how many are identified, and within 30 %."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", default="100,101,102")
    parser.add_argument("--pumps", default="ABC")
    options = parser.parse_args()
    identified, near = 0, []
    for fleet in map(int, options.fleets.split(",")):
        pairs = list(rig_recordings(fleet, SIZES["short"], labels=("normal", "swash_plate")))
        for name in options.pumps:
            own = [(recording, run) for recording, run in pairs if recording.specimen == name]
            known = [r for r, run in own if run.fault is None or r.condition.discharge_pressure < MPa(12)]
            method, nuisances = GaussNewton(starts=1), Nuisances.housing()
            law = calibrate(
                "25scy14-1b", known, law=SwashPlateDefect(depth=mm(0.07)), method=method, nuisances=nuisances,
                phases=False, explain_misfit=False,
            ).law  # fmt: skip
            corner = next(item for item in law.estimates if item.letter == "corner")
            ratio = corner.value / own[0][1].specimen.following_cutoff
            ends = [end / own[0][1].specimen.following_cutoff for end in corner.interval]
            evidence = {key: round(value, 1) for key, value in law.evidence.items()}
            print(fleet, name, f"{ratio:.2f} ({ends[0]:.2f} to {ends[1]:.2f}) of the truth, {corner.verdict}", evidence)
            if corner.verdict == "identified":
                identified += 1
                near.append(abs(ratio - 1) < 0.3)
    print(f"identified: {identified}, of these within 30 %: {int(np.sum(near))}")


if __name__ == "__main__":
    main()
