"""The shaft's angle of a piston pump, from the lines at which its pistons pass."""

from swashtwin.order_domain.shaft_angle import ShaftAngle
from swashtwin.order_domain.tracking import tracked_speed
from swashtwin.recording import Recording

_FOLLOWED = 6
"""So many of the lowest piston-pass lines below half the sample rate may be followed; the clearest is."""
_SEARCH = 0.02
"""How far from the stated speed the shaft's may lie, relative."""


def piston_pass_angle(recording: Recording, piston_count: int) -> ShaftAngle:
    """Angle of the shaft from the clearest of the lowest six piston-pass lines, within 2 % of the stated speed.

    Raises
    ------
    InputError
        Nobody stated a speed.
    DataError
        No piston-pass line stands clear enough to be followed (`tracked_speed`).
    """
    return tracked_speed(recording, order=[piston_count * number for number in range(1, _FOLLOWED + 1)], search=_SEARCH)
