"""The shaft's angle of a piston pump, from the lines at which its pistons pass."""

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording
from swashtwin.signals.orders.shaft_angle import ShaftAngle
from swashtwin.signals.orders.tracking import tracked_speed

_LOW, _FOLLOWED = 3, 6
"""So many of the lowest piston-pass lines tell the speed, and so many the angle; the clearest of them."""
_SEARCH = 0.02
"""How far from the stated speed the shaft's may lie, relative."""
_SEARCH_SHARE = 0.45
"""Share of the distance to a line's neighbors, one order away, within which it is looked for."""


def piston_pass_angle(recording: Recording, piston_count: int) -> ShaftAngle:
    """Angle of the shaft from the clearest of the lowest six piston-pass lines, within 2 % of the stated speed.

    The lowest three, whose neighbors lie far away, say first how fast the shaft turned; then any of the six is looked
    for near that speed. Where none of the three stands clear, only as near the stated speed as no neighbor of the sixth
    is mistaken for it: about 1 % with seven pistons.

    Raises
    ------
    InputError
        Nobody stated a speed.
    DataError
        No piston-pass line stands clear enough to be followed (`tracked_speed`).
    """
    lines = [piston_count * number for number in range(1, _FOLLOWED + 1)]
    fine = min(_SEARCH, _SEARCH_SHARE / lines[-1])
    try:
        low = tracked_speed(recording, order=lines[:_LOW], search=min(_SEARCH, _SEARCH_SHARE / lines[_LOW - 1]))
    except DataError:  # those above may still be followed
        return tracked_speed(recording, order=lines, search=fine)
    if recording.speed is None:
        return tracked_speed(recording, order=lines, near=low.mean_speed, search=fine)
    along = recording.replace(speed=np.maximum(low.speed, 0))  # a run-up has no one speed to look near
    return tracked_speed(along, order=lines, search=fine)
