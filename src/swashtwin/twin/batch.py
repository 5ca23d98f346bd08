"""Many twins at once."""

from collections.abc import Sequence

from swashtwin.errors import InputError
from swashtwin.loads import force_lines
from swashtwin.twin.model import Twin


def prepare(twins: Sequence[Twin]) -> None:
    """Compute the chamber pressures of many twins in one batch, much faster than one by one.

    The twins must share the topology; each keeps its own lines as `Twin.pressure`.
    """
    if len({twin.topology for twin in twins}) > 1:
        raise InputError("twins of different topologies cannot be prepared together; prepare each kind by itself.")
    most = max(twin.n_lines for twin in twins)
    lines = force_lines([twin.load_case for twin in twins], most, topology=twins[0].topology)
    for twin, row in zip(twins, lines, strict=True):
        twin.__dict__["pressure"] = row[: twin.n_lines + 1]  # where cached_property keeps it
