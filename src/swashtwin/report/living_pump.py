"""The pump that turns on a page: its geometry, one revolution of its twin, and its fault.

`static/living_pump.js` draws it, in mm, rad, MPa or bar, N and m/s^2.
"""

import base64
import math
import re
from dataclasses import dataclass, replace
from functools import cache, lru_cache, singledispatch
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from swashtwin.foundation import (
    PASCALS,
    PressureUnit,
    SwashTwinError,
    convert_pressures,
    json_text,
    load_extra,
    plural,
    rpm,
    to_table,
)
from swashtwin.plot import format_label
from swashtwin.pump import (
    FAULT_KINDS,
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    Nameplate,
    OperatingCondition,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
    load_pump,
    propose_class,
    scaled_pump,
)
from swashtwin.report.drawing import build_cutaways

if TYPE_CHECKING:
    from swashtwin.physics import Twin

DRAWN_SIZE_MM = 4.0
"""Size at which a fault of micrometers is drawn, so that it is seen on a pump of a hand's width."""

_LARGEST_INTEGER = 32767

# A comment of script or style; no text of them contains its signs.
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True, eq=False)
class LivingPump:
    """A block of a page: a twin's pump that turns, with its pressures and its waveform."""

    kind: ClassVar[str] = "living_pump"
    content: dict[str, Any]
    """What `describe_turn` returns."""
    caption: str
    """Which pump is drawn, and how far it is that of the reader."""

    @property
    def html(self) -> Markup:
        """The block as HTML; the page also needs `static/living_pump.js` and its style."""
        # The numbers must not end the element that holds them.
        numbers = Markup(json_text(self.content).replace("<", "\\u003c"))
        frame = Markup(
            '<div class="living-pump"><script type="application/json">{}</script></div>\n'
            '<p class="soft">{}</p>'
        )
        return frame.format(numbers, self.caption)


@cache
def load_pump_source(suffix: Literal["js", "css"]) -> Markup:
    """Return the script or the style of `LivingPump.html`, for a page that needs no other file.

    Comments and indentation, a third of the script, are left out: every page holds a copy.
    """
    file = resources.files("swashtwin.report") / "static" / f"living_pump.{suffix}"
    source = _COMMENT.sub("", file.read_text(encoding="utf-8"))
    lines = [line.strip() for line in source.splitlines()]
    return Markup("\n".join(line for line in lines if line and not line.startswith("//")))


SHIPPED_PUMP = "25scy14-1b"
"""Pump that is drawn if the machine's is not known."""

# Pumps that are kept, since an open page of an alarm may be loaded again and again.
_CACHED_PUMPS = 16

_MIN_BANDWIDTH_HZ = 3000.0


@lru_cache(maxsize=_CACHED_PUMPS)
def build_living_pumps(
    label: str,
    pump: str | Path | None = None,
    pistons: int | None = None,
    speed: float | None = None,
    pressure: float | None = None,
    pressure_unit: PressureUnit = "MPa",
) -> tuple[LivingPump, ...]:
    """Return a pump that turns with a typical fault of a class.

    The result is empty if the class has no fault that can be simulated, if the pump cannot run at
    the operating point, or if an extra is not installed: a page is complete without it.

    Parameters
    ----------
    label : class of the fault.
    pump : name or file of the machine's pump; by default `SHIPPED_PUMP`, scaled to `pistons`.
    pistons : number of pistons of a machine whose pump is not known.
    speed : shaft speed [rad/s]; by default the pump's rated one.
    pressure : discharge pressure [Pa]; by default the rated one.
    pressure_unit : unit in which pressures are shown.
    """
    fault = FAULT_KINDS.get(propose_class(label) or label)
    if fault is None:
        return ()
    if isinstance(fault, SwashPlateDefect):
        fault = fault.with_fitting_contact()
    try:
        drawn_pump = _load_pump(pump, pistons)
        assert drawn_pump.rated is not None
        condition = OperatingCondition(
            speed or drawn_pump.rated.speed, pressure or drawn_pump.rated.discharge_pressure
        )
        piston_pass = drawn_pump.rotating_group.piston_count * condition.shaft_frequency
        bandwidth = max(_MIN_BANDWIDTH_HZ, 1.05 * piston_pass)
        physics = load_extra("swashtwin.physics", "twin", "a pump that turns")
        twin = physics.Twin(drawn_pump, condition, fault, bandwidth=bandwidth)
        content = describe_turn(twin, pressure_unit)
    except SwashTwinError:
        return ()

    subject = f"Pump {drawn_pump.name}"
    if pump is None:
        subject = f"Not this machine, but a pump like {SHIPPED_PUMP}"
    caption = (
        f"{subject} with {drawn_pump.rotating_group.piston_count} pistons, simulated at "
        f"{condition.speed / rpm(1):.4g} rpm and {1e-6 * condition.discharge_pressure:.3g} MPa "
        f"with a typical fault of the class {format_label(label)}."
    )
    return (LivingPump(content, convert_pressures(caption, pressure_unit)),)


def _load_pump(pump: str | Path | None, pistons: int | None) -> Pump:
    """Return the pump that is drawn, with the ratings of the shipped one if it states none."""
    shipped = load_pump(SHIPPED_PUMP)
    assert shipped.rated is not None
    if pump is not None:
        drawn_pump = load_pump(pump)
        return replace(drawn_pump, rated=drawn_pump.rated or shipped.rated)
    if pistons in (None, shipped.rotating_group.piston_count):
        return shipped
    nameplate = Nameplate(
        displacement=shipped.rotating_group.displacement,
        piston_count=pistons,
        speed=shipped.rated.speed,
        discharge_pressure=shipped.rated.discharge_pressure,
    )
    return scaled_pump(shipped, nameplate, f"{SHIPPED_PUMP} scaled to {pistons} pistons")


@dataclass(frozen=True, eq=False)
class MeasuredTurn:
    """One turn of a recording, which is drawn over that of a twin."""

    channels: tuple[str, ...]
    """Channels, each a sensor of the twin's pump."""
    waveform: Float[np.ndarray, "channel angle"]
    """Acceleration [m/s^2] on a uniform grid of the twin's shaft angle from 0."""


def describe_turn(
    twin: "Twin", pressure_unit: PressureUnit = "MPa", measured: MeasuredTurn | None = None
) -> dict[str, Any]:
    """Return what the script draws of a twin: geometry, one revolution, and the fault.

    Parameters
    ----------
    pressure_unit : unit in which pressures are shown.
    measured : turn of a recording; `None` draws the twin's waveform alone.
    """
    from swashtwin.physics import solve_turn

    pump = twin.port_timing.apply(twin.pump)
    turn = solve_turn(twin)
    return {
        "description": _describe(twin),
        "shape": _shape(pump, twin.fault),
        "sensors": [
            {
                "name": sensor.name,
                "position": [round(1e3 * length, 2) for length in sensor.position],
            }
            for sensor in pump.sensors
        ],
        "pressureUnit": pressure_unit,
        "chamber": _packed(turn.chamber / PASCALS[pressure_unit]),
        "discharge": _packed(turn.discharge / PASCALS[pressure_unit]),
        "contact": _packed(turn.contact),
        "displacement": _packed(1e3 * turn.displacement),
        "waveform": _packed(turn.acceleration),
        "measured": None if measured is None else _describe_measured(measured),
        "fault": _describe_fault(twin),
    }


def _describe_measured(measured: MeasuredTurn) -> dict[str, Any]:
    return {"channels": measured.channels, "waveform": _packed(measured.waveform)}


def _packed(values: np.ndarray) -> dict[str, Any]:
    """Return rows of numbers as 16-bit integers in base 64 and their factor.

    A page that is drawn while a slider moves has no time for the digits of ten thousand numbers.
    """
    largest = float(np.abs(values).max()) or 1.0
    integers = np.round(values * (_LARGEST_INTEGER / largest)).astype("<i2")
    return {
        "rows": len(np.atleast_2d(values)),
        "factor": largest / _LARGEST_INTEGER,
        "integers": base64.b64encode(integers.tobytes()).decode(),
    }


def _describe(twin: "Twin") -> str:
    """Return the drawing in words."""
    group = twin.pump.rotating_group
    state = "healthy" if twin.fault is None else f"fault: {format_label(twin.label)}"
    return (
        f"Section through the pump {twin.pump.name} and its valve plate seen along the shaft: "
        f"{plural(group.piston_count, 'piston')} on a circle of {2e3 * group.pitch_radius:.3g} mm, "
        f"swash plate at {math.degrees(group.swash_angle):.3g}°; {state}"
    )


def _shape(pump: Pump, fault: Fault | None) -> dict[str, Any]:
    """Return the geometry that is drawn, in mm and rad; ports as the fault leaves them."""
    from swashtwin.physics import port_change

    group = pump.rotating_group
    plate = pump.valve_plate
    advance = port_change(fault, np.zeros(1)).advance
    lengths = {
        "radius": group.pitch_radius,
        "piston": group.piston_diameter,
        "slipper": group.slipper_diameter,
        "guide": group.piston_guide_length,
        "dead": group.dead_volume / group.piston_area,
        "plate": pump.positions.valve_plate,
        "outer": plate.outer_land_outer_radius,
        "kidney": plate.outer_land_inner_radius - plate.inner_land_outer_radius,
    }
    angles = {
        "swash": group.swash_angle,
        "suctionOpen": plate.suction_open - advance,
        "suctionClose": plate.suction_close,
        "dischargeOpen": plate.discharge_open - advance,
        "dischargeClose": plate.discharge_close,
        "ramp": plate.port_ramp,
        "groove": plate.groove_angle,
    }
    return {
        **{name: round(1e3 * length, 3) for name, length in lengths.items()},
        **{name: round(angle, 5) for name, angle in angles.items()},
    }


@dataclass(frozen=True)
class _Effect:
    """How the script draws a fault; lengths are in mm and already enlarged."""

    sentence: str = ""
    """What is seen, and how much larger it is drawn."""
    piston: int | None = None
    """Index of the only faulty piston; `None` if all pistons meet the fault."""
    scale: float = 1.0
    """Factor on displacements."""
    across: bool = False
    """Whether displacements are lateral rather than along the shaft."""
    leak: str = ""
    """Where oil leaks: ``bore``, ``land`` or ``film``."""
    gap: float = 0.0
    """Clearance around the piston, or film on the valve plate."""
    recess: tuple[float, float, float] | None = None
    """Angle of the middle [rad], angle that it spans [rad], and depth."""
    scratch: bool = False
    """Whether a scratch crosses the dam at bottom dead center."""
    tilt: bool = False
    """Whether the face of the block is out of square."""


def _describe_fault(twin: "Twin") -> dict[str, Any] | None:
    """Return which parts a fault marks, where it acts, and how much larger it is drawn."""
    if twin.fault is None:
        return None
    cutaways = build_cutaways(twin.label)
    return {
        "label": format_label(twin.label),
        "parts": cutaways[0].parts if cutaways else (),
        **to_table(_draw_fault(twin.fault, twin.pump)),
    }


def _enlargement(length: float) -> float:
    """Return the round factor by which a length [m] is at most `DRAWN_SIZE_MM`; at least 1."""
    largest = DRAWN_SIZE_MM / (1e3 * length)
    if largest <= 1:
        return 1.0
    power = 10.0 ** math.floor(math.log10(largest))
    return max(factor * power for factor in (1, 2, 5) if factor * power <= largest)


def _micrometers(length: float) -> str:
    return f"{1e6 * length:.3g} µm"


@singledispatch
def _draw_fault(fault: Fault, pump: Pump) -> _Effect:
    """Return how a fault is drawn: unless registered otherwise by its recess, or its part alone."""
    from swashtwin.physics import find_recess

    recess = find_recess(fault)
    if recess is None:
        return _Effect()
    scale = _enlargement(recess.depth)
    span = recess.length / pump.rotating_group.pitch_radius
    return _Effect(
        f"The recess is {_micrometers(recess.depth)} deep, and drawn {scale:g} times as deep.",
        scale=scale,
        recess=(recess.angle, span, 1e3 * scale * recess.depth),
    )


@_draw_fault.register
def _(fault: PistonWear, pump: Pump) -> _Effect:
    scale = _enlargement(fault.clearance)
    return _Effect(
        f"Oil leaks past piston {fault.piston + 1}, whose clearance is larger by "
        f"{_micrometers(fault.clearance)}, drawn {scale:g} times as wide.",
        piston=fault.piston,
        leak="bore",
        gap=1e3 * scale * fault.clearance,
    )


@_draw_fault.register
def _(fault: BoreDefect, pump: Pump) -> _Effect:
    scale = _enlargement(fault.depth)
    return _Effect(
        f"Piston {fault.bore + 1} gives way by up to {_micrometers(fault.depth)} in its damaged "
        f"bore, drawn {scale:g} times as far.",
        piston=fault.bore,
        scale=scale,
        across=True,
    )


@_draw_fault.register
def _(fault: SealingLandScratch, pump: Pump) -> _Effect:
    return _Effect(
        f"Oil leaks from chamber {fault.bore + 1} through a scratch of the sealing land; the jet "
        "is not to scale.",
        piston=fault.bore,
        leak="land",
    )


@_draw_fault.register
def _(fault: TiltedBlockFace, pump: Pump) -> _Effect:
    return _Effect("The worn face of the block is drawn far more tilted than it is.", tilt=True)


@_draw_fault.register
def _(fault: ValvePlateWear, pump: Pump) -> _Effect:
    scale = _enlargement(fault.film_increase)
    return _Effect(
        f"The film on the valve plate is thicker by {_micrometers(fault.film_increase)}, drawn "
        f"{scale:g} times as thick.",
        leak="film",
        gap=1e3 * scale * fault.film_increase,
    )


@_draw_fault.register
def _(fault: DamScratch, pump: Pump) -> _Effect:
    return _Effect(
        "A scratch across the dam connects chambers to the outlet early at bottom dead center; "
        "its width is not to scale.",
        scratch=True,
    )


@_draw_fault.register
def _(fault: GrooveErosion, pump: Pump) -> _Effect:
    advance = math.degrees(fault.advance)
    return _Effect(f"The ports open {advance:.3g}° earlier, drawn to scale.")


@_draw_fault.register
def _(fault: LooseSlipper, pump: Pump) -> _Effect:
    scale = _enlargement(fault.clearance)
    return _Effect(
        f"Piston {fault.slipper + 1} rattles by {_micrometers(fault.clearance)} in its ball "
        f"joint, drawn {scale:g} times as far.",
        piston=fault.slipper,
        scale=scale,
    )
