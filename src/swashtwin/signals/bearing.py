"""Kinematics of rolling bearings: how often a flaw is struck in a turn of the shaft."""

import math
from typing import NamedTuple

from swashtwin.foundation import InputError


class DefectOrders(NamedTuple):
    """Events per turn of the shaft, with the outer race standing still."""

    inner_race: float
    """A rolling body meets a flaw on the inner race (BPFI)."""
    outer_race: float
    """A rolling body meets a flaw on the outer race (BPFO)."""
    ball: float
    """A flaw on a rolling body meets a race: twice in each of its own turns (2 BSF)."""
    cage: float
    """Turns of the cage (FTF)."""


def defect_orders(bodies: int, diameter_ratio: float, contact_angle: float = 0.0) -> DefectOrders:
    """Return the events per turn of the shaft, without sliding.

    With g = (d / D) cos a: cage (1 - g) / 2, outer race Z (1 - g) / 2, inner race Z (1 + g) / 2,
    ball (1 - g²) D / d (a flaw on a body meets both races in each of its turns; Randall and Antoni
    2011, doi:10.1016/j.ymssp.2010.07.017).

    Parameters
    ----------
    bodies : number Z of rolling bodies in a row.
    diameter_ratio : diameter d of a body over the pitch diameter D, both in one unit.
    contact_angle : a [rad].

    Examples
    --------
    >>> print(f"{defect_orders(9, 0.3126 / 1.537).inner_race:.4f}")
    5.4152
    """
    ratio = diameter_ratio * math.cos(contact_angle)
    if bodies < 3 or not 0 < ratio < 1:
        raise InputError(
            f"Invalid bearing of {bodies} bodies with d / D = {diameter_ratio:g}: use 3 bodies or "
            "more, and a ratio of diameters between 0 and 1."
        )
    return DefectOrders(
        inner_race=bodies * (1 + ratio) / 2,
        outer_race=bodies * (1 - ratio) / 2,
        ball=(1 - ratio**2) / diameter_ratio,
        cage=(1 - ratio) / 2,
    )
