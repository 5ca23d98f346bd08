"""Which dimensions of a fault can be searched, in which unit they are told, and what is known of them before."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    PistonWear,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)


@dataclass(frozen=True)
class Dimension:
    """One dimension of a fault."""

    name: str
    """Field of the fault."""
    unit: str
    """Unit in which it is told."""
    per_unit: float
    """What one such unit is in SI."""
    deviation: float = math.inf
    """Standard deviation of its logarithm before anything is measured [an estimate of ours]; infinite for severities,
    of which every value from zero on is as likely as any other."""

    def words(self, value: float) -> str:
        """`value` [SI] in the dimension's unit."""
        return f"{value / self.per_unit:.3g} {self.unit}".rstrip()


_MM, _UM, _DEG = ("mm", 1e-3), ("µm", 1e-6), ("deg", math.pi / 180)
DIMENSIONS: Mapping[type, tuple[Dimension, ...]] = MappingProxyType(
    {
        SwashPlateDefect: (
            Dimension("depth", *_MM),
            Dimension("length", *_MM, 0.3),
            Dimension("width", *_MM, 0.3),
            Dimension("angle", *_DEG, 0.1),
        ),
        PistonWear: (Dimension("clearance", *_UM),),
        BoreDefect: (
            Dimension("depth", *_UM),
            Dimension("half_width", *_DEG, 0.3),
            Dimension("angle", *_DEG, 0.1),
        ),
        SealingLandScratch: (Dimension("conductance", "mm³/(s MPa)", 1e-15),),
        TiltedBlockFace: (Dimension("variation", "", 1.0),),
        ValvePlateWear: (Dimension("film_increase", *_UM),),
        DamScratch: (Dimension("area", "mm²", 1e-6), Dimension("width", *_DEG, 0.3)),
        GrooveErosion: (Dimension("advance", *_DEG), Dimension("area_factor", "", 1.0, 0.5)),
        LooseSlipper: (Dimension("clearance", *_MM),),
    }
)
"""Dimensions of each fault, its severity first."""
LAWS: Mapping[type, float] = MappingProxyType(
    {SwashPlateDefect: 0.25, BoreDefect: 0.25, LooseSlipper: 0.25, TiltedBlockFace: 0.25}
)
"""Standard deviation of the logarithm of what a fault's law gives for its severity [estimates of ours]: of contacts,
where a film would have to pull (docs/physics.md, section 2.5)."""
HYDRAULIC_LAW = 0.1
"""The same of all others, which open or leak."""
USUALLY_FREE: Mapping[type, tuple[str, ...]] = MappingProxyType(
    {SwashPlateDefect: ("length",), BoreDefect: ("half_width",)}
)
"""Dimensions searched beside the severity where nothing else is asked for."""


@dataclass(frozen=True)
class FaultSpace:
    """A fault with some of its dimensions free.

    Coordinates: the severity over the reference's, from zero on, then the logarithm of each further dimension over the
    reference's.
    """

    reference: Fault
    """The fault where all coordinates are those of `start`."""
    free: tuple[Dimension, ...]
    """What is searched, the severity first."""

    @property
    def start(self) -> Float[np.ndarray, " dimension"]:
        """Coordinates of the reference."""
        return np.array([1.0] + [0.0] * (len(self.free) - 1))

    def at(self, coordinates: Float[np.ndarray, " dimension"]) -> Fault | None:
        """The fault of those coordinates; None where its severity is zero."""
        if coordinates[0] == 0:
            return None
        further = {
            one.name: getattr(self.reference, one.name) * math.exp(float(moved))
            for one, moved in zip(self.free[1:], coordinates[1:], strict=True)
        }
        changed: Any = replace(self.reference, **further)
        fault: Fault = changed.scaled(float(coordinates[0]))
        return fault


def fault_space(fault: Fault, free: Sequence[str] | None = None) -> FaultSpace:
    """`fault` with its severity free, and the further dimensions named; the usual ones where None.

    Raises
    ------
    InputError
        The fault has no such dimension, or no severity to scale.
    """
    known = {one.name: one for one in DIMENSIONS[type(fault)]}
    severity, *_ = known
    further = USUALLY_FREE.get(type(fault), ()) if free is None else [name for name in free if name != severity]
    for name in further:
        if name not in known:
            raise InputError(f"{type(fault).__name__} has no dimension {name!r} to search; it has {', '.join(known)}.")
    if fault.severity <= 0:
        raise InputError(f"{type(fault).__name__}.{severity} is 0; give a typical one, from which the search starts.")
    return FaultSpace(fault, tuple(known[name] for name in dict.fromkeys([severity, *further])))
