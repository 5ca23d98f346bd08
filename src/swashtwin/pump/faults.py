"""Faults of a pump that the model can simulate, with their dimensions.

A *class* is a label of a classifier; a *fault* is something that the model can simulate. Several
faults share a class. Each fault is a frozen dataclass whose first field is its severity, which
`scaled` multiplies. Its effects on the pump are defined in `physics`, in one registry for each kind
of effect; CONTRIBUTING.md, "Add a fault", lists them. Severities follow our derivation,
`docs/explanation/physics.md`, and the sources cited there; the swash plate defect is the paper's
(DOI 10.1177/00202940261419020).
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeVar, get_args, get_origin, get_type_hints

from swashtwin.foundation import InputError, UnitError, deg, mm, parse_quantity, um
from swashtwin.pump.labels import canonical_label
from swashtwin.pump.parameters import format_quantity

_F = TypeVar("_F", bound="Fault")


@dataclass(frozen=True)
class Fault:
    """Base class of all faults that the model can simulate.

    A new fault is a frozen dataclass derived from this one and registered by `register_fault`. The
    metadata of a field with a dimension hold its SI unit, ``field(metadata={"unit": "m"})``.
    """

    label: ClassVar[str]
    """Class of the fault."""

    def __post_init__(self) -> None:
        for dimension in fields(self):
            name = f"{type(self).__name__}.{dimension.name}"
            value = getattr(self, dimension.name)
            is_number = isinstance(value, float | int)
            if is_number and not (math.isfinite(value) and value >= 0):
                raise InputError(f"{name} ({value:g}) must be zero or a positive number.")

            choices = get_args(dimension.type) if get_origin(dimension.type) is Literal else ()
            if choices and value not in choices:
                raise InputError(f"{name} ({value!r}) must be one of {', '.join(choices)}.")

            # Catches millimeters given as meters, the likely slip.
            maximum = dimension.metadata.get("maximum", math.inf)
            if is_number and value > maximum:
                raise InputError(
                    f"{name} ({value:g} m) exceeds {maximum:g} m. "
                    "Lengths are in meters: 30 mm is mm(30)."
                )

    @property
    def units(self) -> Mapping[str, str]:
        """SI unit of each dimension that has one."""
        return {
            dimension.name: dimension.metadata["unit"]
            for dimension in fields(self)
            if "unit" in dimension.metadata
        }

    @property
    def severity(self) -> float:
        """Value of the first field, in its unit."""
        return float(getattr(self, fields(self)[0].name))

    def scaled(self: _F, factor: float) -> _F:
        """Return the fault with its severity times `factor`."""
        changes: dict[str, Any] = {fields(self)[0].name: self.severity * factor}
        return replace(self, **changes)


def _dimension(unit: str, default: Any = MISSING, *, maximum: float = math.inf) -> Any:
    """Return a field with an SI unit and the largest value that is not a slip of the unit."""
    return field(default=default, metadata={"unit": unit, "maximum": maximum})


SHARED_DEPTH = mm(0.1)
"""Depth [m] of a recess up to which the linear law of the films is used by default.

At 0.07 mm one-sided films give lines within 7 to 12 %; at the paper's 0.6 mm films would have to
pull with ten times the force that holds the slippers down (docs/explanation/physics.md, section
2.5).
"""


@dataclass(frozen=True)
class SwashPlateDefect(Fault):
    """Rectangular recess in the swash plate, on the slippers' track: the paper's artificial defect.

    A slipper wider than the recess bridges it: `effective_depth` then falls below `depth` (our
    extrapolation).
    """

    label: ClassVar[str] = "swash_plate"

    depth: float = _dimension("m", maximum=0.02)
    """Depth [m]; the paper's is 0.6 mm."""
    length: float = _dimension("m", 0.030, maximum=0.3)
    """Length along the track [m]; the paper's by default."""
    width: float = _dimension("m", 0.024, maximum=0.3)
    """Width across the track [m]; the paper's by default."""
    angle: float = _dimension("rad", math.radians(270))
    """Shaft angle of its middle, from top dead center [rad]; 180-360 deg is the pressure side."""
    entry: Literal["center", "edge"] = "center"
    """Start of the paper's distances l1...l3: the slipper's ``center`` (the paper's word) or its
    leading ``edge`` (ours).
    """
    edge: Literal["half_sine", "raised_cosine"] = "half_sine"
    """Shape of entry and exit: the paper's half-sine, whose velocity jumps, or a raised cosine,
    whose velocity is continuous.
    """
    contact: Literal["shared", "literal", "physical", "lift_off"] = "shared"
    """Load of one slipper's displacement on the pump.

    - ``shared``: one slipper's share of the total stiffness and damping;
    - ``literal``: all of it, the paper's formula as printed;
    - ``physical``: only inertia, volume and leakage, because a film cannot pull;
    - ``lift_off``: as physical; slippers also leave the plate if it falls away faster than they
      can follow, and land with an impact.
    """
    gain: float = 1.0
    """Factor on the excitation; a nuisance parameter that calibration may free."""
    off_axis: bool = True
    """Apply the force at the defect, with its moment, rather than on the shaft's axis (our
    reading).
    """
    corner: float = _dimension("Hz", 0.0)
    """Frequency [Hz] at which slippers follow half of the recess, 2^-(f / corner)^fall.

    With 0 they follow all of it if films are strained, and otherwise up to
    `physics.excitation.CONTACT_CUTOFF`.
    """
    fall: float = 2.0
    """Steepness of the fall around the corner."""
    leakage: float = 1.0
    """Factor on the leakage of a slipper in the recess; without effect if films are strained."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length == 0 or self.width == 0:
            raise InputError("SwashPlateDefect.length and width must be positive.")

    def with_fitting_contact(self) -> "SwashPlateDefect":
        """Return the recess with the contact law that suits its depth.

        ``shared`` up to `SHARED_DEPTH`, ``lift_off`` beyond.
        """
        return replace(self, contact="shared" if self.depth <= SHARED_DEPTH else "lift_off")

    @property
    def strains_films(self) -> bool:
        """Whether the law strains the films, which then may pull: ``shared`` and ``literal``."""
        return self.contact in ("shared", "literal")

    def effective_depth(self, slipper_diameter: float) -> float:
        """Return the depth [m] that a rigid slipper reaches.

        It is the whole depth if the recess is longer and wider than the slipper.
        """
        along = min(1.0, self.length / slipper_diameter)
        across = min(1.0, self.width / slipper_diameter)
        return self.depth * along**2 * across**2


@dataclass(frozen=True)
class PistonWear(Fault):
    """One piston worn in its bore, whose larger clearance leaks once per revolution."""

    label: ClassVar[str] = "piston"

    clearance: float = _dimension("m", maximum=0.002)
    """Added radial clearance [m]; 25...60 um is moderate to severe."""
    piston: int = 0
    """Index of the piston, from 0."""


@dataclass(frozen=True)
class BoreDefect(Fault):
    """Local defect of the bush in one cylinder bore.

    The piston's side force loads it once per revolution. Source of the mechanism: the
    cylinder-defect paper cited in `docs/explanation/physics.md`, section 1, no. 2.
    """

    label: ClassVar[str] = "cylinder_block"

    depth: float = _dimension("m", maximum=0.02)
    """Depth [m]; 50...300 um."""
    half_width: float = _dimension("rad", math.radians(25))
    """Half of the shaft angle over which the piston is displaced [rad]."""
    angle: float = _dimension("rad", math.radians(270))
    """Shaft angle of the bore at which it is loaded most [rad]."""
    bore: int = 0
    """Index of the bore, from 0."""


@dataclass(frozen=True)
class SealingLandScratch(Fault):
    """Scratch through the cylinder block's sealing land, by which one chamber leaks to the case."""

    label: ClassVar[str] = "cylinder_block"

    conductance: float = _dimension("m^3/(s*Pa)")
    """Added leakage conductance [m^3/(s Pa)]; 6e-13...2.5e-12."""
    bore: int = 0
    """Index of the bore, from 0."""


@dataclass(frozen=True)
class TiltedBlockFace(Fault):
    """Cylinder block face worn out of square.

    The stiffness of the valve plate's film varies around the face and turns with the block:
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
                f"TiltedBlockFace.variation ({self.variation:g}) must be below 1: "
                "a film cannot pull."
            )


@dataclass(frozen=True)
class ValvePlateWear(Fault):
    """Even wear of the valve plate, whose film becomes thicker and softer, and leaks more."""

    label: ClassVar[str] = "valve_plate"

    film_increase: float = _dimension("m", maximum=0.002)
    """Added film thickness [m]; 5...15 um."""
    stiffness_exponent: float = 1.0
    """Power of (h0/h) with which K_v falls, 1 or 2; C_v falls with the third power."""


@dataclass(frozen=True)
class DamScratch(Fault):
    """Scratch across the valve plate's dam at bottom dead center.

    It connects chambers to the discharge pressure early.
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
    """Shaft angle by which the ports open earlier [rad]; 6 deg is severe."""
    area_factor: float = 4.0
    """Factor on the groove's area."""


@dataclass(frozen=True)
class LooseSlipper(Fault):
    """Worn ball joint of one slipper: its piston rattles in the play, with impacts at the stops."""

    label: ClassVar[str] = "loose_slipper"

    clearance: float = _dimension("m", maximum=0.02)
    """Play of the joint [m]; 0.05...0.2 mm."""
    slipper: int = 0
    """Index of the slipper, from 0."""
    restitution: float = 0.0
    """Coefficient of restitution of the impacts, 0...1."""
    pulse: float = _dimension("s", 2e-4)
    """Duration of one impact [s]; 0.1...0.3 ms."""


_faults: dict[str, Fault | None] = {"normal": None}
FAULT_KINDS: Mapping[str, Fault | None] = MappingProxyType(_faults)
"""Registered faults with typical dimensions, by the name that the command line reads.

`register_fault` adds to them.
"""

_ENTRY_POINTS = "swashtwin.faults"


def register_fault(name: str, typical: Fault) -> None:
    """Register a fault by `name`, for `read_fault`, the command line and the loading of twins.

    An installed package is registered automatically, for the command line too, if it has an entry
    point `name` of the group ``swashtwin.faults`` that points at `typical`.

    Parameters
    ----------
    name : one word, such as ``"loose_slipper"``; the name of a class means its most common fault.
    typical : fault with the default dimensions.

    Raises
    ------
    InputError
        Another fault is registered by the name, or has a type of the same name.
    """
    kind = type(typical)
    if not isinstance(typical, Fault) or not fields(kind) or not hasattr(kind, "label"):
        raise InputError(
            f"{kind.__name__} is not a fault: derive a frozen dataclass from Fault, "
            "with a label and its severity as the first field."
        )
    for registered_name, registered in _faults.items():
        registered_kind = type(registered)
        clashes = name == registered_name or kind.__name__ == registered_kind.__name__
        # Compared by name, because a module may be imported twice, with a type each time.
        is_same = (kind.__module__, kind.__qualname__) == (
            registered_kind.__module__,
            registered_kind.__qualname__,
        )
        if clashes and not is_same:
            raise InputError(
                f"{name} ({kind.__name__}) is already registered as {registered_name} "
                f"({registered_kind.__name__}); rename it."
            )
    _faults[name] = typical


def register_installed_faults() -> None:
    """Register the faults that installed packages offer by their entry points."""
    for entry in entry_points(group=_ENTRY_POINTS):
        if entry.name not in _faults:
            register_fault(entry.name, entry.load())


def fault_type(name: str) -> type[Fault]:
    """Return the type of fault with this name (``"PistonWear"``).

    It may be registered, or offered by an installed package.

    Raises
    ------
    InputError
        No registered fault has a type of this name.
    """
    # Entry points are read only if needed: it takes longer than a look-up.
    if name not in {type(fault).__name__ for fault in _faults.values()}:
        register_installed_faults()
    kinds = {type(fault).__name__: type(fault) for fault in _faults.values() if fault is not None}
    if name not in kinds:
        raise InputError(
            f"No fault of the type {name} is registered; there are {', '.join(kinds)}. "
            "Register yours with register_fault before you load a file that uses it."
        )
    return kinds[name]


def read_severity(kind: str, text: str) -> float:
    """Return a severity of a kind of fault, such as a clearance, from its quantity [SI].

    Raises
    ------
    InputError
        Unknown kind, a kind without a fault, or a number that is not above zero.
    UnitError
        No unit, or one of another dimension.

    Examples
    --------
    >>> round(read_severity("piston", "200 um") * 1e6)
    200
    """
    typical = read_fault(kind)
    if typical is None:
        raise InputError(f"{kind!r} has no severity: use a kind of fault, such as piston.")
    name = fields(typical)[0].name
    severity = parse_quantity(text, typical.units.get(name, "1"), name=f"the severity of {kind}")
    if not (math.isfinite(severity) and severity > 0):
        raise InputError(f"the severity of {kind}, {text!r}, must be above zero.")
    return severity


def read_fault(kind: str, **dimensions: str) -> Fault | None:
    """Return the typical fault of a kind with some dimensions replaced; None is a healthy pump.

    Parameters
    ----------
    kind : a name of `FAULT_KINDS`, or an alias of it.
    dimensions : quantities with units, whole numbers, or words, by the names of the fault's fields.

    Raises
    ------
    InputError
        Unknown kind (the nearest is offered) or dimension, or an impossible number or word.
    UnitError
        A dimension without a unit, or with a unit of another dimension.

    Examples
    --------
    >>> read_fault("plunger", clearance="60 um")
    PistonWear(clearance=6e-05, piston=0)
    >>> read_fault("swash_plate", contact="lift_off").contact
    'lift_off'
    """
    if isinstance(kind, str) and ":" in kind:
        # The words of a class would suggest the typical fault, without these dimensions.
        raise InputError(
            f"Invalid fault {kind!r}: must be the name of a typical fault, such as piston. Specify "
            'its dimensions in Python: read_fault("piston", clearance="60 um").'
        )
    if kind not in FAULT_KINDS:
        register_installed_faults()
    name = kind if kind in FAULT_KINDS else canonical_label(kind, tuple(FAULT_KINDS), noun="fault")
    fault = FAULT_KINDS[name]
    if fault is None:
        if dimensions:
            raise InputError(
                f"A {name} pump has no {next(iter(dimensions))}; name a fault, such as swash_plate."
            )
        return None

    readable_types = {
        field_name: field_type
        for field_name, field_type in get_type_hints(type(fault)).items()
        if field_type in (float, int) or get_origin(field_type) is Literal
    }
    values: dict[str, Any] = {}
    for key, text in dimensions.items():
        if key not in readable_types:
            raise InputError(
                f"{name} has no dimension {key!r}; it has {', '.join(readable_types)}."
            )
        if readable_types[key] not in (float, int):
            values[key] = text
            continue

        unit = fault.units.get(key, "1")
        is_bare = isinstance(text, str) and text.strip().replace(".", "", 1).isdigit()
        if unit != "1" and is_bare:
            example = format_quantity(getattr(fault, key), unit)
            raise UnitError(f"{name}'s {key} = {text!r} has no unit. Write it like {example!r}.")

        number = parse_quantity(text, unit, name=f"{name}'s {key}")
        if readable_types[key] is int and number != int(number):
            raise InputError(f"{name}'s {key} = {text!r} must be a whole number.")
        values[key] = readable_types[key](number)
    return replace(fault, **values)


# The paper's defect, and moderate severities of docs/explanation/physics.md for the others.
register_fault("swash_plate", SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24)))
register_fault("piston", PistonWear(clearance=um(40)))
register_fault("cylinder_block", BoreDefect(depth=um(150)))
register_fault("valve_plate", ValvePlateWear(film_increase=um(10)))
register_fault("loose_slipper", LooseSlipper(clearance=mm(0.1)))
register_fault("scratched_block", SealingLandScratch(conductance=1.2e-12))
register_fault("tilted_block", TiltedBlockFace(variation=0.2))
register_fault("scratched_valve_plate", DamScratch(area=1e-6))
register_fault("eroded_grooves", GrooveErosion(advance=deg(4)))
