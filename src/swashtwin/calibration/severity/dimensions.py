"""Dimensions of a fault that can be searched, their units and priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
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

POSITION_SHARE = 0.5
"""`Dimension.share` of lengths and widths along the track; chosen on fleets 100-119 of the virtual
rig.
"""
EDGES = 0.002
"""`Dimension.law` of a recess's length, 0.06 mm of 30 mm: where its edges begin; chosen on the same
fleets.
"""


@dataclass(frozen=True)
class Dimension:
    """One dimension of a fault."""

    name: str
    """Field of the fault."""
    unit: str
    """Unit in which it is stated."""
    per_unit: float
    """What one such unit is in SI."""
    deviation: float = math.inf
    """Standard deviation of its logarithm before anything is measured [an estimate of ours];
    infinite for severities, where every value from zero on is equally likely.
    """

    share: float = 1.0
    """Share of the standard deviation of its logarithm that the lines leave. Less than 1 where it
    decides at which orders lines vanish: errors of levels, which widen the deviation, hardly move
    that.
    """
    law: float = 0.0
    """Standard deviation of the logarithm of what the fault's law gives for it. That of a severity,
    which the settings can change, is `SeveritySearch.law`.
    """

    def words(self, value: float) -> str:
        """`value` [SI] in the dimension's unit."""
        return f"{value / self.per_unit:.3g} {self.unit}".rstrip()


HYDRAULIC_LAW = 0.12
"""Standard deviation of the logarithm of what the law of a fault that opens or leaks gives for its
severity; chosen on fleets 100-111 of the virtual rig, as are those of recesses, clearances, bores
and erosion below.
"""
CONTACT_LAW = 0.25
"""The same of a contact that no fleet was asked about, where a film would have to pull
(docs/explanation/physics.md, section 2.5) [estimate of ours].
"""


@dataclass(frozen=True)
class SeveritySearch:
    """What a search for the severity of a kind of fault needs to know."""

    dimensions: tuple[Dimension, ...]
    """Dimensions that can be searched, the severity first."""
    law: float = HYDRAULIC_LAW
    """Standard deviation of the logarithm of what the fault's law gives for its severity."""
    free: tuple[str, ...] = ()
    """Dimensions searched beside the severity by default."""
    roll_off: float = 0.0
    """Standard deviation of the relative error at 1 kHz of what the fault excites, which grows with
    the square of the
    frequency: how far parts that are no rigid bodies follow the fault."""


_searches: dict[type[Fault], SeveritySearch] = {}


def register_severity(kind: type[Fault], search: SeveritySearch) -> None:
    """Say how the severity of a kind of fault is searched; without it, the severity alone is, in SI
    units.

    Raises
    ------
    InputError
        A dimension is no field of the fault, or the first is not its severity.
    """
    names = [item.name for item in fields(kind)]
    wrong = [dimension.name for dimension in search.dimensions if dimension.name not in names]
    if wrong or not search.dimensions or search.dimensions[0].name != names[0]:
        raise InputError(
            f"{kind.__name__} has the dimensions {', '.join(names)}; the search must begin with {names[0]}, its "
            f"severity, and name others of these (not {', '.join(wrong) or 'another first'})."
        )
    _searches[kind] = search


def get_severity_search(fault: Fault) -> SeveritySearch:
    """How the severity of a fault is searched."""
    severity = fields(fault)[0].name
    return _searches.get(
        type(fault), SeveritySearch((Dimension(severity, fault.units.get(severity, ""), 1.0),))
    )


_MM, _UM, _DEG = ("mm", 1e-3), ("µm", 1e-6), ("deg", math.pi / 180)
for _kind, _search in (
    (
        SwashPlateDefect,
        SeveritySearch(
            (
                Dimension("depth", *_MM),
                Dimension("length", *_MM, 0.3, share=POSITION_SHARE, law=EDGES),
                Dimension("width", *_MM, 0.3),
                Dimension("angle", *_DEG, 0.1),
                Dimension("corner", "Hz", 1.0, 1.0),
                Dimension("fall", "", 1.0, 0.3),
                Dimension("gain", "", 1.0, 0.5),
                Dimension("leakage", "", 1.0, 0.7),
            ),
            0.1,
            free=("length",),
            roll_off=1.0,
        ),
    ),
    (PistonWear, SeveritySearch((Dimension("clearance", *_UM),), 0.08)),
    (
        BoreDefect,
        SeveritySearch(
            (
                Dimension("depth", *_UM),
                Dimension("half_width", *_DEG, 0.3, share=POSITION_SHARE),
                Dimension("angle", *_DEG, 0.1),
            ),
            0.08,
            free=("half_width",),
        ),
    ),
    (SealingLandScratch, SeveritySearch((Dimension("conductance", "mm³/(s MPa)", 1e-15),))),
    (TiltedBlockFace, SeveritySearch((Dimension("variation", "", 1.0),), CONTACT_LAW)),
    (ValvePlateWear, SeveritySearch((Dimension("film_increase", *_UM),))),
    (DamScratch, SeveritySearch((Dimension("area", "mm²", 1e-6), Dimension("width", *_DEG, 0.3)))),
    (
        GrooveErosion,
        SeveritySearch((Dimension("advance", *_DEG), Dimension("area_factor", "", 1.0, 0.5)), 0.15),
    ),
    (LooseSlipper, SeveritySearch((Dimension("clearance", *_MM),), CONTACT_LAW)),
):
    register_severity(_kind, _search)


@dataclass(frozen=True)
class FaultSpace:
    """A fault with some of its dimensions free.

    Coordinates: the severity over the reference's, from zero on, then the logarithm of each further
    dimension over the reference's.
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
        further: dict[str, Any] = {
            dimension.name: getattr(self.reference, dimension.name) * math.exp(float(logarithm))
            for dimension, logarithm in zip(self.free[1:], coordinates[1:], strict=True)
        }
        return replace(self.reference, **further).scaled(float(coordinates[0]))


def fault_space(fault: Fault, free: Sequence[str] | None = None) -> FaultSpace:
    """`fault` with its severity free, and the further dimensions named; the usual ones where None.

    An `InputError` where the fault has no such dimension, or no severity to scale.
    """
    search = get_severity_search(fault)
    dimensions = {dimension.name: dimension for dimension in search.dimensions}
    severity, *_ = dimensions
    further = search.free if free is None else [name for name in free if name != severity]
    for name in further:
        if name not in dimensions:
            names = ", ".join(dimensions)
            raise InputError(
                f"{type(fault).__name__} has no dimension {name!r} to search; it has {names}."
            )
        if getattr(fault, name) <= 0:
            raise InputError(
                f"{type(fault).__name__}.{name} is 0; give a typical one, from which the search starts."
            )
    if fault.severity <= 0:
        raise InputError(
            f"{type(fault).__name__}.{severity} is 0; give a typical one, from which the search starts."
        )
    return FaultSpace(
        fault, tuple(dimensions[name] for name in dict.fromkeys([severity, *further]))
    )
