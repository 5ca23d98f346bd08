"""
Calibrate the twin of your pump
===============================

The twin is a model of the pump with 13 degrees of freedom (:doc:`/explanation/physics`). Six of its
values differ from pump to pump and are in no drawing: stiffness and damping of the three lubricated
interfaces. Calibration estimates them from *healthy* recordings, each with an interval and a
verdict. :doc:`/reference/nomenclature` defines the terms.
"""

# %%
# Load the pump
# -------------
# For your own pump, write a parameter file from its nameplate: ``swashtwin twin pump new mine
# --displacement "45 cm3/rev" --pistons 9 --speed "1500 rpm" --pressure "280 bar"``.

import matplotlib.pyplot as plt

import swashtwin as st
from swashtwin_bench import build_rig

pump = st.load_pump("25scy14-1b")
pump

# %%
# Calibrate
# ---------
# The healthy recordings come from one pump of the virtual rig, a simulation. On the command line:
# ``swashtwin calibrate rig --pump 25scy14-1b --specimen A --out twin.json``.

build_rig("rig", seed=0, size="tiny")
healthy = st.load_recordings("rig").where(label="normal", specimen="A")
calibration = st.calibrate(pump, healthy, seed=0)

# %%
# Read the estimates
# ------------------
# A value is *identified* only if the recordings determine it. Do not use the other values.

for estimate in calibration.estimates:
    low, high = estimate.interval
    print(
        f"{estimate.symbol:5} {estimate.value:9.3g} {estimate.unit:7} "
        f"({low:.2g} to {high:.2g})  {estimate.verdict}"
    )
for note in calibration.notes:
    print("-", note)

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for row, estimate in enumerate(calibration.estimates):
    low, high = (end / estimate.nominal for end in estimate.interval)
    axes.plot(
        [low, high],
        [row, row],
        color="tab:blue" if estimate.verdict == "identified" else "lightgray",
        lw=6,
    )
    axes.plot(estimate.value / estimate.nominal, row, "k.")
axes.set_yticks(range(6), [estimate.symbol for estimate in calibration.estimates])
axes.set(xscale="log", xlabel="value over nominal; bar: 90 % interval, blue if identified")
axes.axvline(1, color="k", lw=0.5)
plt.show()

# %%
# Compare with the nominal twin
# -----------------------------
# The reduction of each error of the twin by the calibration. A negative number means that the error
# grew.

for name, share in calibration.improvement.items():
    print(f"{name:5} {100 * share:+.0f} %")
