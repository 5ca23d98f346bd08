"""
From recordings to a verdict
============================

You have a folder of recordings, and for each recording you know whether the pump was healthy or
which fault it had. This tutorial trains a model that classifies a new recording and reports how
certain the class is.

:doc:`/how-to/recordings` lists the file formats and shows how to write the index of your own
folder. Here the recordings come from the virtual rig, which simulates a machine.
:doc:`/reference/nomenclature` defines the terms.
"""

# %%
# Load
# ----
# Two pumps with seven pistons at three pressures, healthy and with four faults.

import matplotlib.pyplot as plt
import numpy as np

import swashtwin as st
from swashtwin_bench import build_rig

build_rig("rig", seed=0, size="tiny")
recordings = st.load_recordings("rig")
recordings

# %%
# Check
# -----
# Before you train, look for gaps, clipping, dead channels, copies and sample rates that differ.
# On the command line: ``swashtwin inspect rig``.

print(st.inspect_recordings(list(recordings)))

# %%
# Split
# -----
# Whole recordings are held out, because the windows (slices) of one recording resemble each other.
# A model that was trained on half of them recognizes the other half, so its score says nothing
# about new recordings (:doc:`/how-to/leakage`).

train, test = recordings.split(test=0.2, by="recording", seed=0)
print(len(train), "recordings to train,", len(test), "to test")

# %%
# Train
# -----
# By default, training compares three candidates by cross-validation on the training recordings, as
# measured and with changed noise, gain and speed. It selects the best candidate. On the command
# line: ``swashtwin train rig --out pump.safetensors``.

classifier = st.FaultClassifier(seed=0).fit(train)
print("accuracy on held-out recordings:", round(classifier.score(test), 2))

# %%
# Diagnose
# --------
# A diagnosis is a class with its probability, and the reasons for doubt. On the command line:
# ``swashtwin diagnose pump.safetensors new.csv --report diagnosis/``.

diagnosis = classifier.diagnose(test[0])
print(diagnosis)
for note in diagnosis.notes:
    print("-", note)

# %%
names = list(diagnosis.probabilities)
figure, axes = plt.subplots(figsize=(7, 2.5), layout="constrained")
axes.barh(names, [diagnosis.probabilities[name] for name in names])
axes.set(xlim=(0, 1), xlabel="probability", title=f"truth: {test[0].label}")
plt.show()

# %%
# Plot the spectrum
# -----------------
# The spectrum of the recording, with marked lines of the shaft and of the seven pistons.

st.plot.spectrum(test[0], pistons=7)

# %%
# Plot the confusion matrix
# -------------------------
# Rows are the true class, columns the predicted class.

truth = [recording.label for recording in test]
verdicts = [classifier.diagnose(recording).label for recording in test]
counts = np.array(
    [
        [sum(t == a and v == b for t, v in zip(truth, verdicts, strict=True)) for b in names]
        for a in names
    ]
)
st.plot.confusion(counts, names)
