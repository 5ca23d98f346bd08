"""Whether slippers stay on the swash plate: their contact forces, and a sentence where a linear twin pulls at them."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.physics.contacts.settings import SlipperContact, slipper_weight
from swashtwin.physics.contacts.slippers import distance_rows, slipper_lines
from swashtwin.pump import Fault, OperatingCondition, Pump
from swashtwin.pump import InterfaceValue as Value
from swashtwin.signals import periodic_signal


def slipper_forces(
    pump: Pump,
    topology: str,
    contact: SlipperContact,
    condition: OperatingCondition,
    fault: Fault | None,
    values: Float[Tensor, " 6"],
    motion: Complex[Tensor, "line 13"],
    *,
    excitation: float = 1.0,
    samples: int = 4096,
) -> Float[np.ndarray, "piston angle"]:
    """Force [N] of each slipper's film at `samples` shaft angles of a revolution, positive where it pushes.

    Parameters
    ----------
    motion : displacement lines from order 0 [m, rad], the mean included: it is what holds the slippers down.
    excitation : factor on the recess.
    samples : at least twice the lines. Film forces are computed in the band of the lines; a half-sine's velocity jumps,
        so they overshoot there, and a wider band shows higher peaks.
    """
    count, n_lines = pump.rotating_group.piston_count, motion.shape[0] - 1
    angle = 2 * math.pi * np.arange(samples) / samples + 2 * math.pi * np.arange(count)[:, None] / count
    damping, stiffness = (float(values[i]) for i in (Value.SLIPPER_SWASH_DAMPING, Value.SLIPPER_SWASH_STIFFNESS))
    film = stiffness + 1j * condition.speed * damping * np.arange(n_lines + 1)
    coordinates = motion.detach().cpu().numpy() @ distance_rows(pump, topology).T
    ways = (np.ones_like(angle), np.cos(angle), np.sin(angle))
    strained = sum(
        way * periodic_signal(film * lines, samples) for way, lines in zip(ways, coordinates.T, strict=False)
    )
    orders = np.arange(n_lines + 1)
    recess = excitation * film * slipper_lines(pump, condition, fault, n_lines)
    turns = np.exp(2j * math.pi * orders * np.arange(count)[:, None] / count)
    strained = strained + np.stack([periodic_signal(row, samples) for row in recess * turns])
    force = -slipper_weight(pump, contact, angle) / count * strained
    return np.maximum(force, 0.0) if contact.one_sided else force


@dataclass(frozen=True)
class ContactCheck:
    """What a film would have to do for the linear twin to be right."""

    lowest: float
    """Lowest force of a slipper [N]; below zero its film pulls."""
    pulling: float
    """Share of the revolution during which at least one film pulls [1]."""
    hold_down: float
    """Mean force of all slippers together [N]."""

    @property
    def within_range(self) -> bool:
        """Whether no film has to pull."""
        return self.lowest >= 0

    def sentence(self) -> str:
        """What there is to say about it."""
        numbers = f"(lowest contact force {self.lowest / 1e3:.3g} kN, mean hold-down {self.hold_down / 1e3:.3g} kN)"
        if self.within_range:
            return f"the slippers' films push throughout the revolution {numbers}: within the linear model's range"
        return (
            f"the linear twin pulls at its slippers during {self.pulling:.0%} of the revolution {numbers}: results lie "
            "outside the linear model's range; SlipperContact(one_sided=True), or --one-sided, lets slippers lift off"
        )


def check_contact(forces: Float[np.ndarray, "piston angle"]) -> ContactCheck:
    """What `slipper_forces` of a linear twin say."""
    return ContactCheck(
        lowest=float(forces.min()),
        pulling=float(np.mean((forces < 0).any(axis=0))),
        hold_down=float(forces.sum(axis=0).mean()),
    )
