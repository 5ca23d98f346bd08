"""
Train on a fault that was never recorded
========================================

Assume that a worn swash plate was never recorded at one pressure. A calibrated twin can simulate
the fault at that pressure, and all other classes there too, so that no class is more diverse than
another. The classifier then trains on measured and synthetic windows (slices of a recording)
together. :doc:`/reference/nomenclature` defines the terms.
"""

# %%
# Make a gap
# ----------
# Exclude the swash plate fault at the highest pressure from the training. These recordings are the
# test set.

import swashtwin as st
from swashtwin_bench import build_rig

build_rig("rig", seed=0, size="tiny")
recordings = st.load_recordings("rig")
train, test = recordings.split(test=0.4, by="recording", seed=0)
high = max(recording.condition.discharge_pressure for recording in recordings)


def in_gap(recording: st.Recording) -> bool:
    """Return whether a recording shows the fault at the excluded pressure."""
    return recording.label == "swash_plate" and recording.condition.discharge_pressure == high


measured = [recording for recording in train if not in_gap(recording)]
gap = [recording for recording in recordings if in_gap(recording)]
print(len(measured), "recordings to train,", len(gap), "in the gap")

# %%
# Calibrate the twin
# ------------------
# The calibration uses healthy recordings of one pump.

healthy = [
    recording
    for recording in measured
    if recording.label == "normal" and recording.specimen == gap[0].specimen
]
calibration = st.calibrate("25scy14-1b", healthy, seed=0)
calibration

# %%
# Plan what the twin adds
# -----------------------
# The fault is a recess of 0.07 mm in the swash plate. The plan finds the gap, and fills every class
# at its pressure.

fault_of = {"swash_plate": st.SwashPlateDefect(depth=st.mm(0.07))}
plan = st.Filling(calibration, fault_of=fault_of, seed=0).plan(measured)
print(plan)

# %%
# Synthesize the windows
# ----------------------
# They are marked as synthetic, so swashtwin refuses them in a test set.

synthetic = plan.simulate()
synthetic

# %%
# Compare
# -------
# Count the recordings in the gap that each classifier names correctly. One small rig proves
# nothing: :doc:`/bench/evidence` has ten fleets, with intervals.

without = st.FaultClassifier(seed=0).fit(measured)
with_twin = st.FaultClassifier(seed=0).fit(measured, synthetic=synthetic)
for name, classifier in (("measured only", without), ("measured and synthetic", with_twin)):
    labels = [classifier.diagnose(recording).label for recording in gap]
    print(f"{name:23}", labels.count("swash_plate"), "of", len(gap), "correct")
