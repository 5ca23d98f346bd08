"""What a defect of the swash plate does to the slippers."""

import numpy as np
from matplotlib.figure import Figure

from swashtwin.foundation import InputError
from swashtwin.physics import Twin, recess_of, slipper_displacements
from swashtwin.plot.style import CALIBRATED, figure_style, panels

N_POINTS = 701
"""Points over one revolution."""


@figure_style()
def excitation(twin: Twin) -> Figure:
    """Displacement of each slipper in the recess of the swash plate and their sum [mm], over one revolution [ms].

    The equations are those of `slipper_displacements` (docs/explanation/physics.md, section 2.4, a derivation of ours).

    Parameters
    ----------
    twin : with a `SwashPlateDefect`, or another fault that has a recess.

    Raises
    ------
    InputError
        The twin's fault has no recess.

    Examples
    --------
    >>> from swashtwin.foundation import MPa, mm, rpm
    >>> from swashtwin.pump import OperatingCondition, SwashPlateDefect, load_pump
    >>> twin = Twin(load_pump("25scy14-1b"), OperatingCondition(rpm(860), MPa(15)), SwashPlateDefect(depth=mm(0.07)))
    >>> len(excitation(twin).axes)
    2
    """
    recess = recess_of(twin.fault)
    if recess is None:
        raise InputError(
            f"the fault of this twin ({twin.label}) has no recess, so no slipper is displaced; give a twin with a "
            "swash plate defect."
        )
    time = np.linspace(0, twin.condition.period, N_POINTS)
    each = slipper_displacements(twin.pump, twin.condition, recess, time)
    figure, axes = panels(2, 1, 4.8, sharex=True)
    (above,), (below,) = axes
    turn = np.exp(2j * np.pi * time / twin.condition.period)
    for j, row in enumerate(each):
        shade = f"{0.15 + 0.5 * j / max(1, len(each) - 1):.2f}"
        above.plot(time * 1e3, row * 1e3, color=shade)
        middle = np.angle(np.sum(row * turn)) % (2 * np.pi) / (2 * np.pi) * twin.condition.period
        above.text(middle * 1e3, each.max() * 1.04e3, str(j + 1), ha="center", va="bottom", fontsize=9)
    total = each.sum(axis=0) * 1e3
    below.plot(time * 1e3, total, color=CALIBRATED)
    above.set(ylabel="each slipper [mm]", ylim=(0, each.max() * 1.2e3), title="Slippers, by their number")
    below.set(xlabel="time [ms], from top dead center of piston 1", ylabel="total [mm]", xlim=(0, time[-1] * 1e3))
    below.set_ylim(0, total.max() * 1.15)
    return figure
