"""
From files to a verdict, in ten lines
=====================================

Load recordings, draw two spectra over each other, train a classifier, and get a table of verdicts
on recordings that it has not seen. The recordings come from the virtual rig, a simulation of two
pumps. To use your own, write an index with ``swashtwin index FOLDER`` and load that folder.
"""

# %%
# Load and compare
# ----------------
# The recordings are split before anything is learned from them. The axis counts multiples of the
# shaft's frequency; a worn piston adds lines between those of the seven pistons.

import pandas as pd

import swashtwin as st
from swashtwin_bench import build_rig

build_rig("rig", seed=0, size="tiny")
train, test = st.load_recordings("rig").split(test=0.2, seed=0)
healthy, worn = (train.where(label=name, specimen="A")[0] for name in ("normal", "piston"))
st.plot.spectrum([healthy, worn], pistons=7)

# %%
# Train and diagnose
# ------------------
# Each row is one recording. ``verdict`` is the answer, ``class`` the truth.

classifier = st.FaultClassifier(seed=0).fit(train)
tables = [classifier.diagnose(recording).to_pandas() for recording in test]
verdicts = pd.concat(tables, ignore_index=True)
verdicts[["recording_id", "verdict", "agreement"]].assign(**{"class": test.labels})
