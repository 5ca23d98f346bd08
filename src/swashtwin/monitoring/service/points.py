"""At which of a machine's operating points a recording is judged; there is a bound to their number."""

from swashtwin.monitoring.alarms import OperatingPoint, choose_point
from swashtwin.monitoring.history import MachineTransaction
from swashtwin.monitoring.sources import UnfitError
from swashtwin.recordings import Recording

_MOST = 200
"""Operating points of a machine: more come of a speed or a pressure that does not stand still."""


def bounded_point(recording: Recording, transaction: MachineTransaction) -> OperatingPoint:
    """The operating point of a recording, one of the machine's or a new one.

    Raises
    ------
    UnfitError
        It would be a new one, and the machine has as many as it may have.
    """
    points = transaction.points()
    point = choose_point(recording, points)
    if len(points) >= _MOST and all(stored.name != point.name for stored in points):
        raise UnfitError(
            "points",
            f"{point.name} would be a new operating point, and {transaction.name} has {len(points)} already, which is "
            "the most; record it at fewer speeds and pressures, then note a maintenance, which forgets all points.",
        )
    return point
