"""One piston with play in its slipper's ball joint, and its chamber, over one revolution, as machine code."""

from typing import no_type_check

from swashtwin.foundation import compiled
from swashtwin.physics.chambers import AIR_FLOOR, ATMOSPHERE, FLOOR, orifice

SLIDING = 0.01
"""Sliding speed [m/s] below which a piston's friction fades, so that it does not switch."""
_MOST = 80


@compiled
@no_type_check
def rattle(
    step,
    clearance,
    stop,
    damper,
    mass,
    area,
    friction,
    bulk,
    air,
    suction,
    case,
    tables,
    start,
    displacement,
    speed,
    pressure,
):
    """Fill displacement, velocity and pressure from `start`; the state at the revolution's end.

    Rows of `tables`: volume [m^3], its growth [m^3/s], suction and discharge opening, leakage, outlet pressure, rigid
    velocity [m/s], rigid acceleration [m/s^2]. Velocities first, then displacements and, implicitly, the pressure.
    """
    steps = tables.shape[1]
    u, v, p = start[0], start[1], start[2]
    for i in range(steps):
        displacement[i], speed[i], pressure[i] = u, v, p
        force = -area * (p - case) - mass * tables[7, i]
        if u < 0:
            force += max(0.0, -stop * u - damper * v)
        if u > clearance:
            force -= max(0.0, stop * (u - clearance) + damper * v)
        force -= friction * max(-1.0, min(1.0, (tables[6, i] + v) / SLIDING))
        v += step * force / mass
        u += step * v
        k = (i + 1) % steps
        gas = air * ATMOSPHERE / max(p, AIR_FLOOR) ** 2
        compliance = step / (tables[0, k] * (1 / bulk + gas))
        before, damping, last = p, 1.0, 0.0
        for _ in range(_MOST):
            inward, falling = orifice(tables[2, k], suction - p)
            outward, rising = orifice(tables[3, k], p - tables[5, k])
            flow = inward - outward - tables[4, k] * (p - case) - tables[1, k] + area * v
            change = (before + compliance * flow - p) / (1 + compliance * (falling + rising + tables[4, k]))
            damping = 0.5 * damping if change * last < 0 else min(1.0, 1.5 * damping)
            last = change
            p = max(p + damping * change, FLOOR)
            if abs(change) < 1e-3:
                break
    return u, v, p
