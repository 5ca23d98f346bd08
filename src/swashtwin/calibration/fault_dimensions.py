"""Dimensions of a fault that can be searched, their units and priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

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

POSITION_STD_FACTOR = 0.5
"""`Dimension.std_factor` of lengths and widths along the track; chosen on fleets 100-119 of the
virtual rig.
"""
EDGE_LAW_STD = 0.002
"""`Dimension.law_std` of a recess's length, 0.06 mm of 30 mm: where its edges begin; chosen on the
same fleets.
"""


@dataclass(frozen=True)
class Dimension:
    """One dimension of a fault."""

    name: str
    """Field of the fault."""
    unit: str
    """Unit in which it is shown."""
    per_unit: float
    """One such unit in SI."""
    prior_std: float = math.inf
    """Standard deviation of its logarithm before anything is measured [an estimate of ours];
    infinite for severities, of which every value from zero on is equally likely.
    """
    std_factor: float = 1.0
    """Factor on the standard deviation of its logarithm that the lines leave. Less than 1 if it
    decides at which orders lines vanish: errors of levels, which widen the deviation, hardly move
    that.
    """
    law_std: float = 0.0
    """Standard deviation of the logarithm of what the fault's law gives for it. That of a severity,
    which the settings can change, is `SeveritySearch.law_std`.
    """

    def format_value(self, value: float) -> str:
        """Return `value` [SI] in the dimension's unit."""
        return f"{value / self.per_unit:.3g} {self.unit}".rstrip()


HYDRAULIC_LAW_STD = 0.12
"""Standard deviation of the logarithm of what the law of a fault that opens or leaks gives for its
severity; chosen on fleets 100-111 of the virtual rig, as are those of recesses, clearances, bores
and erosion below.
"""
CONTACT_LAW_STD = 0.25
"""The same of a contact that was not studied on a fleet, at which a film would have to pull
(docs/explanation/physics.md, section 2.5) [estimate of ours].
"""


@dataclass(frozen=True)
class SeveritySearch:
    """What a search for the severity of a kind of fault needs to know."""

    dimensions: tuple[Dimension, ...]
    """Dimensions that can be searched, the severity first."""
    law_std: float = HYDRAULIC_LAW_STD
    """Standard deviation of the logarithm of what the fault's law gives for its severity."""
    default_free: tuple[str, ...] = ()
    """Dimensions searched with the severity by default."""
    roll_off_std: float = 0.0
    """Standard deviation of the relative error at 1 kHz of what the fault excites, which grows with
    the square of the frequency: how far parts that are not rigid follow the fault.
    """


_searches: dict[type[Fault], SeveritySearch] = {}


def register_severity(kind: type[Fault], search: SeveritySearch) -> None:
    """Register how the severity of a kind of fault is searched.

    A fault that is not registered is searched by its severity alone, in SI units.

    Raises
    ------
    InputError
        A dimension is not a field of the fault, or the first is not its severity.
    """
    names = [field.name for field in fields(kind)]
    unknown = [dimension.name for dimension in search.dimensions if dimension.name not in names]
    if unknown or not search.dimensions or search.dimensions[0].name != names[0]:
        raise InputError(
            f"{kind.__name__} has the dimensions {', '.join(names)}; the search must begin with "
            f"{names[0]}, its severity, and name others of these (not "
            f"{', '.join(unknown) or 'another first'})."
        )
    _searches[kind] = search


def get_severity_search(fault: Fault) -> SeveritySearch:
    """Return how the severity of a fault is searched."""
    severity = fields(fault)[0].name
    default = SeveritySearch((Dimension(severity, fault.units.get(severity, ""), 1.0),))
    return _searches.get(type(fault), default)


_MM = ("mm", 1e-3)
_UM = ("µm", 1e-6)
_DEG = ("deg", math.pi / 180)

register_severity(
    SwashPlateDefect,
    SeveritySearch(
        (
            Dimension("depth", *_MM),
            Dimension(
                "length",
                *_MM,
                prior_std=0.3,
                std_factor=POSITION_STD_FACTOR,
                law_std=EDGE_LAW_STD,
            ),
            Dimension("width", *_MM, prior_std=0.3),
            Dimension("angle", *_DEG, prior_std=0.1),
            Dimension("corner", "Hz", 1.0, prior_std=1.0),
            Dimension("fall", "", 1.0, prior_std=0.3),
            Dimension("gain", "", 1.0, prior_std=0.5),
            Dimension("leakage", "", 1.0, prior_std=0.7),
        ),
        law_std=0.1,
        default_free=("length",),
        roll_off_std=1.0,
    ),
)
register_severity(PistonWear, SeveritySearch((Dimension("clearance", *_UM),), law_std=0.08))
register_severity(
    BoreDefect,
    SeveritySearch(
        (
            Dimension("depth", *_UM),
            Dimension("half_width", *_DEG, prior_std=0.3, std_factor=POSITION_STD_FACTOR),
            Dimension("angle", *_DEG, prior_std=0.1),
        ),
        law_std=0.08,
        default_free=("half_width",),
    ),
)
register_severity(
    SealingLandScratch, SeveritySearch((Dimension("conductance", "mm³/(s MPa)", 1e-15),))
)
register_severity(
    TiltedBlockFace,
    SeveritySearch((Dimension("variation", "", 1.0),), law_std=CONTACT_LAW_STD),
)
register_severity(ValvePlateWear, SeveritySearch((Dimension("film_increase", *_UM),)))
register_severity(
    DamScratch,
    SeveritySearch((Dimension("area", "mm²", 1e-6), Dimension("width", *_DEG, prior_std=0.3))),
)
register_severity(
    GrooveErosion,
    SeveritySearch(
        (Dimension("advance", *_DEG), Dimension("area_factor", "", 1.0, prior_std=0.5)),
        law_std=0.15,
    ),
)
register_severity(
    LooseSlipper, SeveritySearch((Dimension("clearance", *_MM),), law_std=CONTACT_LAW_STD)
)


@dataclass(frozen=True)
class FaultSpace:
    """A fault with some of its dimensions free.

    Coordinates: the severity over the reference's, from zero on, then the logarithm of each further
    dimension over the reference's.
    """

    reference: Fault
    """The fault at the coordinates of `start`."""
    free: tuple[Dimension, ...]
    """Dimensions that are searched, the severity first."""

    @property
    def start(self) -> Float[np.ndarray, " dimension"]:
        """Coordinates of the reference."""
        return np.array([1.0] + [0.0] * (len(self.free) - 1))

    def fault_at(self, coordinates: Float[np.ndarray, " dimension"]) -> Fault | None:
        """Return the fault of those coordinates; `None` if its severity is zero."""
        if coordinates[0] == 0:
            return None

        dimensions = {
            dimension.name: getattr(self.reference, dimension.name) * math.exp(float(logarithm))
            for dimension, logarithm in zip(self.free[1:], coordinates[1:], strict=True)
        }
        return replace(self.reference, **dimensions).scaled(float(coordinates[0]))


def build_fault_space(fault: Fault, free: Sequence[str] | None = None) -> FaultSpace:
    """Return `fault` with its severity and the named further dimensions free.

    Parameters
    ----------
    free : further dimensions; `None` frees those of `SeveritySearch.default_free`.

    Raises
    ------
    InputError
        The fault does not have such a dimension, or has no severity to scale.
    """
    search = get_severity_search(fault)
    dimensions = {dimension.name: dimension for dimension in search.dimensions}
    severity = search.dimensions[0].name
    names = search.default_free
    if free is not None:
        names = tuple(name for name in free if name != severity)

    kind = type(fault).__name__
    for name in names:
        if name not in dimensions:
            raise InputError(
                f"{kind} has no dimension {name!r} to search; it has {', '.join(dimensions)}."
            )
        if getattr(fault, name) <= 0:
            raise InputError(
                f"{kind}.{name} is 0: specify a typical one, from which the search starts."
            )
    if fault.severity <= 0:
        raise InputError(
            f"{kind}.{severity} is 0: specify a typical one, from which the search starts."
        )

    return FaultSpace(fault, tuple(dimensions[name] for name in dict.fromkeys([severity, *names])))
