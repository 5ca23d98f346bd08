"""How slippers stand on the swash plate: all alike, loaded and unloaded, or lifting off.

A slipper on the pressure side is pressed onto the plate, one on the suction side is merely held by the retainer, so its
film may be softer (docs/explanation/physics.md, section 2.3). The weight of a slipper whose piston stands at the shaft
angle phi is

    w(phi) = [eps + (1 - eps) b(phi)] / mean of the same,

b being 1 where its chamber is under pressure and 0 where it is not. The mean is divided out, so that K_sw and C_sw stay
the totals of all slippers. The change from 0 to 1 is a Gaussian's integral: its 2nd and 98th percentiles are one port
ramp apart, and w has no more than a few orders. Its middle lies halfway between the ports' closing and opening.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import InputError
from swashtwin.pump import Pump

FAINTEST = 1e-12
"""Orders of a slipper's weight below this share of its mean are left out."""


@dataclass(frozen=True)
class SlipperContact:
    """What the slippers' films on the swash plate may do; by default what the linear twin assumes."""

    unloaded: float = 1.0
    """Stiffness and damping of a slipper on the suction side relative to a loaded one, 0...1; 1: all alike."""
    one_sided: bool = False
    """Whether a film can only push: a slipper then lifts off where the linear film would pull at it."""

    def __post_init__(self) -> None:
        if not 0 <= self.unloaded <= 1:
            raise InputError(
                f"SlipperContact.unloaded ({self.unloaded:g}) must lie in 0...1: it is the stiffness of a slipper on "
                "the suction side over that of a loaded one."
            )

    @property
    def linear(self) -> bool:
        """Whether the slippers do what the linear twin assumes: all alike, and pulling where need be."""
        return self.unloaded == 1 and not self.one_sided


def weight_orders(pump: Pump, contact: SlipperContact) -> Complex[np.ndarray, " order"]:
    """Orders 0 (which is 1) and up of a slipper's weight: w(phi) = Re sum_m W_m exp(i m phi)."""
    plate = pump.valve_plate
    opens = (plate.suction_close + plate.discharge_open) / 2
    closes = (plate.discharge_close + plate.suction_open) / 2 + math.pi
    spread = plate.port_ramp / 4
    most = math.ceil(math.sqrt(-2 * math.log(FAINTEST)) / spread) if contact.unloaded < 1 else 0
    orders = np.arange(1, most + 1)
    pressed = (closes - opens) / (2 * math.pi)
    window = (np.exp(-1j * orders * opens) - np.exp(-1j * orders * closes)) / (1j * math.pi * orders)
    window = window * np.exp(-((orders * spread) ** 2) / 2)
    mean = contact.unloaded + (1 - contact.unloaded) * pressed
    return np.concatenate([[1.0], (1 - contact.unloaded) / mean * window])


def slipper_weight(
    pump: Pump, contact: SlipperContact, angle: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch"]:
    """Weight w of a slipper whose piston stands at shaft `angle` [rad], 1 in the mean over a revolution."""
    weight = np.zeros_like(angle)
    for order, amplitude in enumerate(weight_orders(pump, contact)):
        weight += (amplitude * np.exp(1j * order * angle)).real
    return np.maximum(weight, 0.0)
