"""A pump, under a condition, with a fault: what its accelerometers would read."""

from swashtwin.twin.batch import prepare
from swashtwin.twin.model import Scales, Twin

__all__ = ["Scales", "Twin", "prepare"]
