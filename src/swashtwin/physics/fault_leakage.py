"""What faults change at the ports and leaks of the chambers: one registry for each of the two effects.

Equations: docs/explanation/physics.md, section 5.
"""

import math
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.pump import DamScratch, Fault, GrooveErosion, PistonWear, Pump, SealingLandScratch, ValvePlateWear


@dataclass(frozen=True)
class PortChange:
    """How a fault changes when, and how far, a bore opens onto the ports."""

    advance: float = 0.0
    """How much earlier the ports open [rad]."""
    groove_factor: float = 1.0
    """Factor on the area of the relief grooves."""
    discharge_opening: float | Float[np.ndarray, " angle"] = 0.0
    """Area [m^2] added to the opening onto the discharge port, at each shaft angle."""


@singledispatch
def port_change(fault: Fault | None, angle: Float[np.ndarray, " angle"]) -> PortChange:
    """How a fault changes the ports at a bore's shaft `angle` [rad]; not at all, unless registered otherwise."""
    return PortChange()


@port_change.register(GrooveErosion)
def _(fault: GrooveErosion, angle: Float[np.ndarray, " angle"]) -> PortChange:
    return PortChange(advance=fault.advance, groove_factor=fault.area_factor)


@port_change.register(DamScratch)
def _(fault: DamScratch, angle: Float[np.ndarray, " angle"]) -> PortChange:
    from_bottom = np.mod(angle, 2 * math.pi) - math.pi
    return PortChange(discharge_opening=fault.area * np.exp(-0.5 * (from_bottom / fault.width) ** 2))


@dataclass(frozen=True)
class AddedLeakage:
    """What a fault adds to the gaps through which the chambers leak; each value for all pistons, or one for each."""

    piston_clearance: float | Float[np.ndarray, " piston"] = 0.0
    """Added to the radial clearance of the pistons [m]."""
    conductance: float | Float[np.ndarray, " piston"] = 0.0
    """Added conductance from the chambers to the case [m^3/(s Pa)]."""
    valve_plate_film: float = 0.0
    """Added to the thickness of the valve plate's film [m]."""


@singledispatch
def added_leakage(fault: Fault | None, pump: Pump) -> AddedLeakage:
    """What a fault adds to the gaps through which chambers leak; nothing, unless registered otherwise.

    Raises
    ------
    InputError
        The fault names a piston that the pump has not.
    """
    return AddedLeakage()


@added_leakage.register(PistonWear)
def _(fault: PistonWear, pump: Pump) -> AddedLeakage:
    return AddedLeakage(piston_clearance=_at_piston(pump, fault.piston, fault.clearance, "PistonWear.piston"))


@added_leakage.register(SealingLandScratch)
def _(fault: SealingLandScratch, pump: Pump) -> AddedLeakage:
    return AddedLeakage(conductance=_at_piston(pump, fault.bore, fault.conductance, "SealingLandScratch.bore"))


@added_leakage.register(ValvePlateWear)
def _(fault: ValvePlateWear, pump: Pump) -> AddedLeakage:
    return AddedLeakage(valve_plate_film=fault.film_increase)


def _at_piston(pump: Pump, piston: int, value: float, name: str) -> Float[np.ndarray, " piston"]:
    """`value` at one piston and 0 at the others."""
    count = pump.rotating_group.piston_count
    if piston >= count:
        raise InputError(f"{name} ({piston}) is none of the {count} pistons; count from 0.")
    return np.where(np.arange(count) == piston, value, 0.0)
