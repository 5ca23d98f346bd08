"""A pump's vibration whose lines are known."""

import numpy as np

from swashtwin.foundation import MPa
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

RATE = 10000.0
TIME = np.arange(40000) / RATE
SHAFT = 15.0


def pump(scale: float = 1.0, name: str = "run", seed: int = 0, **facts: object) -> Recording:
    """Two channels of a seven-piston pump at 900 rev/min, the second 90 degrees behind the first at
    order 7.
    """
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * SHAFT * TIME
    rows = [
        scale
        * (0.3 * np.cos(angle - 1.0) + np.cos(7 * angle + shift) + 0.4 * np.cos(14 * angle + 0.2))
        + 0.05 * rng.standard_normal(len(TIME))
        for shift in (0.5, 0.5 - np.pi / 2)
    ]
    condition = OperatingCondition(2 * np.pi * SHAFT, MPa(15))
    fields = {
        "channels": ("cover", "body"),
        "condition": condition,
        "specimen": "P1",
        **facts,
    }

    return Recording(np.stack(rows), RATE, name, **fields)  # type: ignore[arg-type]
