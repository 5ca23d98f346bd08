"""The twin that most tests of calibrations start from."""

from typing import TYPE_CHECKING

import pytest

from swashtwin.foundation import mm
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect

if TYPE_CHECKING:
    from swashtwin.physics import Twin


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> "Twin":
    """A recess, up to 2.6 kHz."""
    from swashtwin.physics import Twin  # which needs torch

    recess = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    return Twin(pump, at_15, recess, bandwidth=2600)
