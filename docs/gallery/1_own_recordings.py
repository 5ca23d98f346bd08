"""
From recordings to a verdict
============================

You have a folder of recordings, and for each of them you know whether the pump was healthy or what was wrong with it.
At the end you have a model that names the state of a new recording and says how sure it is.

Any format that swashtwin reads will do; :doc:`/how-to/recordings` shows how to write the index of your own folder.
Here the virtual rig, a simulation, stands in for a machine. Terms are in :doc:`/reference/nomenclature`.
"""

# %%
# Load
# ----
# A pump of seven pistons at three pressures: healthy, and with four faults.

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
# Look for gaps, clipping, dead channels, copies and rates that differ before you train. On the command line:
# ``swashtwin check rig``.

print(st.inspect_recordings(list(recordings)))

# %%
# Split
# -----
# Whole recordings are held out. The windows (slices) of one recording resemble each other. A model that has seen half
# of them recognizes the other half, and its score says nothing about new recordings (:doc:`/how-to/leakage`).

train, test = recordings.split(test=0.2, by="recording", seed=0)
print(len(train), "recordings to train,", len(test), "to test")

# %%
# Train
# -----
# Without further arguments, training tries two candidates on parts of your training recordings: as
# measured, and with noise, gain and speed changed. It takes the better. On the command line:
# ``swashtwin train rig --out pump.safetensors``.

classifier = st.FaultClassifier(seed=0).fit(train)
print("accuracy on recordings it has not seen:", round(classifier.score(test), 2))

# %%
# Diagnose
# --------
# A diagnosis is a class with its probability, and the reasons to doubt it. On the command line:
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
# What its spectrum looks like
# ----------------------------
# The spectrum of the recording, with the lines of the shaft and of the seven pistons.

st.plot.spectrum(test[0], pistons=7)
plt.show()

# %%
# Which classes are mistaken for each other
# -----------------------------------------
# Rows are the true class, columns the class that was named.

truth = [recording.label for recording in test]
verdicts = [classifier.diagnose(recording).label for recording in test]
counts = np.array(
    [
        [sum(t == a and v == b for t, v in zip(truth, verdicts, strict=True)) for b in names]
        for a in names
    ]
)
st.plot.confusion(counts, names)
plt.show()
