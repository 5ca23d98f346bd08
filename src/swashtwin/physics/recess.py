"""How a slipper rides through a recess of the swash plate, over the shaft angle.

The paper's piecewise displacement H_j (DOI 10.1177/00202940261419020), entry, dwell and exit, written over the angle
that the slipper has turned instead of time, so that chamber pressures and excitation share one clock. The shaft angle
is 0 at top dead center of piston 0, and piston j stands at phi_j = theta + 2 pi j / n. A slipper stands in the middle
of its stages where it stands in the middle of the recess.
"""

import math
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.pump import Fault, Pump, SwashPlateDefect


@singledispatch
def recess_of(fault: Fault | None) -> SwashPlateDefect | None:
    """The recess that a fault makes in the slippers' track; None, unless registered otherwise."""
    return None


@recess_of.register(SwashPlateDefect)
def _(fault: SwashPlateDefect) -> SwashPlateDefect:
    return fault


@dataclass(frozen=True)
class Stages:
    """Entry, dwell and exit of one slipper, symmetric about the middle of the recess."""

    rise: float
    """Shaft angle of the entry, and of the exit [rad]: l1 / R."""
    total: float
    """Shaft angle from the start of the entry to the end of the exit [rad]: l3 / R."""
    depth: float
    """Displacement during the dwell [m]."""

    @property
    def dwell(self) -> float:
        """Shaft angle between entry and exit [rad]: (l2 - l1) / R."""
        return self.total - 2 * self.rise


def stages(pump: Pump, defect: SwashPlateDefect) -> Stages:
    """Stages of one slipper of `pump` in `defect`.

    With a the slipper's diameter and b the defect's length, (l1, l2, l3) is (a/2, b - a/2, b) for ``entry="centre"``
    and (a, b, a + b) for ``entry="edge"``. Where b < a, which the paper excludes, a and b change places in l1 and l2,
    and the slipper bridges the recess (`SwashPlateDefect.effective_depth`).

    Raises
    ------
    InputError
        The recess is longer than the track.
    """
    radius, slipper = pump.rotating_group.pitch_radius, pump.rotating_group.slipper_diameter
    shorter = min(slipper, defect.length)
    rise, total = (shorter / 2, defect.length) if defect.entry == "centre" else (shorter, slipper + defect.length)
    if total >= 2 * math.pi * radius:
        raise InputError(
            f"SwashPlateDefect.length ({defect.length * 1e3:.4g} mm) fills the slippers' whole track of "
            f"{2e3 * math.pi * radius:.4g} mm (pitch radius {radius * 1e3:.4g} mm, slipper {slipper * 1e3:.4g} mm); "
            "shorten it."
        )
    return Stages(rise=rise / radius, total=total / radius, depth=defect.effective_depth(slipper))


def slipper_profile(
    pump: Pump, defect: SwashPlateDefect, angle: Float[np.ndarray, "*batch"]
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Displacement H [m] of a slipper whose piston stands at shaft `angle` [rad], and its slope dH/dphi [m/rad]."""
    stage = stages(pump, defect)
    offset = np.mod(angle - defect.angle + math.pi, 2 * math.pi) - math.pi
    inward = np.clip(stage.total / 2 - np.abs(offset), 0.0, stage.rise) / stage.rise
    moving = -np.sign(offset) * ((inward > 0) & (inward < 1)) / stage.rise
    if defect.edge == "half_sine":
        shape, slope = np.sin(math.pi / 2 * inward), math.pi / 2 * np.cos(math.pi / 2 * inward)
    else:
        shape, slope = (1 - np.cos(math.pi * inward)) / 2, math.pi / 2 * np.sin(math.pi * inward)
    return stage.depth * shape, stage.depth * slope * moving
