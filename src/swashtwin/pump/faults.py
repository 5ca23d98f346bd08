"""Why a pump is not normal: the fault classes, and faults with dimensions.

A *class* is what a classifier names; a *fault* is what the model can simulate. Several faults share
a class. Each fault is a frozen dataclass whose first field is its severity, so that `scaled` can
spread it. How each acts on the pump is written in `physics`, one registry for each effect;
CONTRIBUTING.md, "Add a fault", names them all. Severities follow our own derivation,
`docs/explanation/physics.md`, and the anchors cited there; the swash plate defect is the paper's
(DOI 10.1177/00202940261419020).
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeVar, get_args, get_origin, get_type_hints

from swashtwin.foundation import InputError, deg, mm, parse_quantity, um
from swashtwin.pump.labels import canonical_label

_F = TypeVar("_F", bound="Fault")


@dataclass(frozen=True)
class Fault:
    """Anything that the model can simulate as wrong with a pump; the base of all faults.

    A new fault is a frozen dataclass derived from this one, made known by `register_fault`. A field
    with a dimension has its SI unit in its metadata, ``field(metadata={"unit": "m"})``.
    """

    label: ClassVar[str]
    """Class that a classifier names it by."""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float | int) and not (math.isfinite(value) and value >= 0):
                raise InputError(
                    f"{kind}.{item.name} ({value:g}) must be zero or a positive number."
                )
            choices = get_args(item.type) if get_origin(item.type) is Literal else ()
            if choices and value not in choices:
                words = ", ".join(choices)
                raise InputError(f"{kind}.{item.name} ({value!r}) must be one of {words}.")
            if "longest" in item.metadata and value > item.metadata["longest"]:
                raise InputError(
                    f"{kind}.{item.name} ({value:g} m) exceeds {item.metadata['longest']:g} m. "
                    "Lengths are in meters: 30 mm is mm(30)."
                )

    @property
    def units(self) -> Mapping[str, str]:
        """SI unit of each dimension that is no pure number."""
        return {
            item.name: item.metadata["unit"] for item in fields(self) if "unit" in item.metadata
        }

    @property
    def severity(self) -> float:
        """Value of the first field, in its unit."""
        return float(getattr(self, fields(self)[0].name))

    def scaled(self: _F, factor: float) -> _F:
        """The same fault with its severity times `factor`."""
        changes: dict[str, Any] = {fields(self)[0].name: self.severity * factor}
        return replace(self, **changes)


def _dimension(unit: str, default: Any = MISSING, **longest: float) -> Any:
    return field(default=default, metadata={"unit": unit, **longest})


SHARED_DEPTH = mm(0.1)
"""Depth [m] of a recess up to which the films of the linear law are believed: at 0.07 mm one-sided
films give lines within 7 to 12 %, at the paper's 0.6 mm they would have to pull with ten times what
holds the slippers down (docs/explanation/physics.md, section 2.5).
"""


@dataclass(frozen=True)
class SwashPlateDefect(Fault):
    """Rectangular recess in the swash plate's running surface, on the slippers' track (the paper's
    artificial defect).

    A slipper wider than the recess bridges it: `effective_depth` then falls below `depth` (an
    extrapolation of ours).
    """

    label: ClassVar[str] = "swash_plate"

    depth: float = _dimension("m", longest=0.02)
    """Depth [m]; the paper's is 0.6 mm."""
    length: float = _dimension("m", 0.030, longest=0.3)
    """Length along the track [m]; the paper's by default."""
    width: float = _dimension("m", 0.024, longest=0.3)
    """Width across the track [m]; the paper's by default."""
    angle: float = _dimension("rad", math.radians(270))
    """Shaft angle of its middle, from top dead center [rad]; 180-360 deg is the pressure side."""
    entry: Literal["center", "edge"] = "center"
    """Where the paper's distances l1...l3 start: at the slipper's ``center`` (its word) or leading
    ``edge`` (ours).
    """
    edge: Literal["half_sine", "raised_cosine"] = "half_sine"
    """Rise and fall: the paper's half-sine (its velocity jumps) or a raised cosine (it does
    not).
    """
    contact: Literal["shared", "literal", "physical", "lift_off"] = "shared"
    """What one slipper's displacement loads: its own share of the total stiffness (``shared``), all
    of it (``literal``, the paper's formula as printed), or only inertia, volume and leakage, for a
    film cannot pull (``physical``); with ``lift_off`` slippers also leave the plate where it falls
    away too fast for them, and land with an impact.
    """
    gain: float = 1.0
    """Factor on the excitation; a nuisance that calibration may free."""
    off_axis: bool = True
    """Whether the force acts where the defect is, with its moment, rather than on the shaft's axis
    (our reading).
    """
    corner: float = _dimension("Hz", 0.0)
    """Frequency [Hz] at which slippers follow half of it, 2^-(f / corner)^fall. With 0 it is the
    law's own: they follow all of it where films are strained, else up to
    `physics.excitation.CONTACT_CUTOFF`.
    """
    fall: float = 2.0
    """How steeply they follow less around the corner."""
    leakage: float = 1.0
    """Factor on the leakage that a slipper opens where it does not seal; acts where films are not
    strained.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length == 0 or self.width == 0:
            raise InputError("SwashPlateDefect.length and width must be positive.")

    def with_fitting_contact(self) -> "SwashPlateDefect":
        """The same recess with the law that suits its depth: ``shared`` up to `SHARED_DEPTH`,
        ``lift_off`` beyond.
        """
        return replace(self, contact="shared" if self.depth <= SHARED_DEPTH else "lift_off")

    @property
    def strains_films(self) -> bool:
        """Whether the films are strained, and may be made to pull: ``shared`` and ``literal``."""
        return self.contact in ("shared", "literal")

    def effective_depth(self, slipper_diameter: float) -> float:
        """Depth a rigid slipper reaches [m]: all of it where the recess is longer and wider than
        the slipper.
        """
        along, across = (
            min(1.0, self.length / slipper_diameter),
            min(1.0, self.width / slipper_diameter),
        )
        return self.depth * along**2 * across**2


@dataclass(frozen=True)
class PistonWear(Fault):
    """One piston worn in its bore: its radial clearance is larger, so its chamber leaks once per
    revolution.
    """

    label: ClassVar[str] = "piston"

    clearance: float = _dimension("m", longest=0.002)
    """Added radial clearance [m]; 25...60 um is moderate to severe."""
    piston: int = 0
    """Which piston, from 0."""


@dataclass(frozen=True)
class BoreDefect(Fault):
    """Local defect of the bush in one cylinder bore, loaded once per revolution by the piston's
    side force.

    Source of the mechanism: the cylinder-defect paper cited in `docs/explanation/physics.md`,
    section 1, no. 2.
    """

    label: ClassVar[str] = "cylinder_block"

    depth: float = _dimension("m", longest=0.02)
    """Depth [m]; 50...300 um."""
    half_width: float = _dimension("rad", math.radians(25))
    """Half of the shaft angle over which it is felt [rad]."""
    angle: float = _dimension("rad", math.radians(270))
    """Shaft angle of the bore at which it is loaded most [rad]."""
    bore: int = 0
    """Which bore, from 0."""


@dataclass(frozen=True)
class SealingLandScratch(Fault):
    """Scratch through the cylinder block's sealing land at one bore: that chamber leaks to the
    case.
    """

    label: ClassVar[str] = "cylinder_block"

    conductance: float = _dimension("m^3/(s*Pa)")
    """Added leakage conductance [m^3/(s Pa)]; 6e-13...2.5e-12."""
    bore: int = 0
    """Which bore, from 0."""


@dataclass(frozen=True)
class TiltedBlockFace(Fault):
    """Cylinder block face worn out of square: the valve plate film's stiffness varies around it and
    turns.

    K_v(theta) = K_v (1 + eps cos(theta - omega t)) couples the axial and the tilting motion
    periodically (`fault_forcing.turning_terms`).
    """

    label: ClassVar[str] = "cylinder_block"

    variation: float
    """Relative variation eps of the film stiffness around the face; below 1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.variation >= 1:
            raise InputError(
                f"TiltedBlockFace.variation ({self.variation:g}) must be below 1: a film cannot pull."
            )


@dataclass(frozen=True)
class ValvePlateWear(Fault):
    """Even wear of the valve plate: its film is thicker, leaks with the cube of the thickness, and
    is softer.
    """

    label: ClassVar[str] = "valve_plate"

    film_increase: float = _dimension("m", longest=0.002)
    """Added film thickness [m]; 5...15 um."""
    stiffness_exponent: float = 1.0
    """K_v falls with (h0/h) to this power, 1 or 2; C_v falls with the third power."""


@dataclass(frozen=True)
class DamScratch(Fault):
    """Scratch across the valve plate's dam at bottom dead center: chambers meet the high pressure
    early.
    """

    label: ClassVar[str] = "valve_plate"

    area: float = _dimension("m^2")
    """Largest opening [m^2]; around 1e-6."""
    width: float = _dimension("rad", math.radians(5))
    """Standard deviation of the opening over the shaft angle [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width == 0:
            raise InputError("DamScratch.width must be positive.")


@dataclass(frozen=True)
class GrooveErosion(Fault):
    """Eroded relief grooves: the ports open earlier, and the grooves are wider."""

    label: ClassVar[str] = "valve_plate"

    advance: float = _dimension("rad")
    """How much earlier the ports open [rad]; 6 deg is much."""
    area_factor: float = 4.0
    """Factor on the groove's area."""


@dataclass(frozen=True)
class LooseSlipper(Fault):
    """Worn ball joint of one slipper: its piston rattles in the play, with impacts at the stops."""

    label: ClassVar[str] = "loose_slipper"

    clearance: float = _dimension("m", longest=0.02)
    """Play of the joint [m]; 0.05...0.2 mm."""
    slipper: int = 0
    """Which slipper, from 0."""
    restitution: float = 0.0
    """Coefficient of restitution of the impacts, 0...1."""
    pulse: float = _dimension("s", 2e-4)
    """Duration of one impact [s]; 0.1...0.3 ms."""


_faults: dict[str, Fault | None] = {"normal": None}
FAULT_KINDS: Mapping[str, Fault | None] = MappingProxyType(_faults)
"""Faults by the name that the command line reads, each with its typical dimensions;
`register_fault` adds to them.
"""
_ENTRY_POINTS = "swashtwin.faults"


def register_fault(name: str, typical: Fault) -> None:
    """Make a fault known by `name`: to `read_fault`, to the command line, and to whatever loads
    saved twins.

    A package can have it made automatically, for the command line too, by an entry point `name` of
    the group ``swashtwin.faults`` that points at `typical`.

    Parameters
    ----------
    name : one word, such as ``"loose_slipper"``; a class's own name stands for its commonest fault.
    typical : the fault with the dimensions that are taken where none are given.

    Raises
    ------
    InputError
        The name, or the name of the fault's type, stands for another fault.
    """
    kind = type(typical)
    if not isinstance(typical, Fault) or not fields(kind) or not hasattr(kind, "label"):
        raise InputError(
            f"{kind.__name__} is no fault: derive a frozen dataclass from Fault, with a label and its severity first."
        )
    for other_name, other in _faults.items():
        clashes = name == other_name or kind.__name__ == type(other).__name__
        if clashes and (kind.__module__, kind.__qualname__) != (
            type(other).__module__,
            type(other).__qualname__,
        ):
            raise InputError(
                f"{name} ({kind.__name__}) is taken by {other_name} ({type(other).__name__}); rename it."
            )
    _faults[name] = typical


def register_installed_faults() -> None:
    """Register the faults that installed packages offer by their entry points."""
    for entry in entry_points(group=_ENTRY_POINTS):
        if entry.name not in _faults:
            register_fault(entry.name, entry.load())


def fault_type(name: str) -> type[Fault]:
    """Type of the fault, registered or offered by an installed package, whose type has this name
    (``"PistonWear"``).

    Raises
    ------
    InputError
        None is registered by that name.
    """
    if name not in {type(fault).__name__ for fault in _faults.values()}:
        register_installed_faults()
    kinds = {type(fault).__name__: type(fault) for fault in _faults.values() if fault is not None}
    if name not in kinds:
        raise InputError(
            f"no fault of the type {name} is registered; there are {', '.join(kinds)}. Register your own with "
            "register_fault before loading what names it."
        )
    return kinds[name]


def read_fault(kind: str, **dimensions: str) -> Fault | None:
    """Fault of that kind (`FAULT_KINDS`, or an alias) with some dimensions replaced; None is a
    healthy pump.

    Raises
    ------
    InputError
        No such kind (the nearest is offered), no such dimension, or an impossible number or word.
    UnitError
        A dimension without a unit, or with one of another dimension.

    Examples
    --------
    >>> read_fault("plunger", clearance="60 um")
    PistonWear(clearance=6e-05, piston=0)
    >>> read_fault("swash_plate", contact="lift_off").contact
    'lift_off'
    """
    if kind not in FAULT_KINDS:
        register_installed_faults()
    name = kind if kind in FAULT_KINDS else canonical_label(kind, tuple(FAULT_KINDS))
    fault = FAULT_KINDS[name]
    if fault is None:
        if dimensions:
            raise InputError(
                f"a {name} pump has no {next(iter(dimensions))}; name a fault, such as swash_plate."
            )
        return None
    forms = get_type_hints(type(fault))
    values: dict[str, Any] = {}
    for key, text in dimensions.items():
        form = forms.get(key)
        if get_origin(form) is Literal:
            values[key] = text
        elif form in (float, int):
            number = parse_quantity(text, fault.units.get(key, "1"), name=f"{name}'s {key}")
            if form is int and number != int(number):
                raise InputError(f"{name}'s {key} = {text!r} must be a whole number.")
            values[key] = int(number) if form is int else number
        else:
            known = [
                item
                for item, form in forms.items()
                if form in (float, int) or get_origin(form) is Literal
            ]
            raise InputError(f"{name} has no dimension {key!r}; it has {', '.join(known)}.")
    return replace(fault, **values)


for _name, _typical in {
    "swash_plate": SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24)),
    "piston": PistonWear(clearance=um(40)),
    "cylinder_block": BoreDefect(depth=um(150)),
    "valve_plate": ValvePlateWear(film_increase=um(10)),
    "loose_slipper": LooseSlipper(clearance=mm(0.1)),
    "scratched_block": SealingLandScratch(conductance=1.2e-12),
    "tilted_block": TiltedBlockFace(variation=0.2),
    "scratched_valve_plate": DamScratch(area=1e-6),
    "eroded_grooves": GrooveErosion(advance=deg(4)),
}.items():  # the paper's defect, and moderate severities of docs/explanation/physics.md for the others
    register_fault(_name, _typical)
