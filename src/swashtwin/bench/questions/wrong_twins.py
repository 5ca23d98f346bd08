"""Twins and recordings that are wrong in one stated way, to see what a calibration makes of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from swashtwin.calibration import GRAVITY
from swashtwin.foundation import deg
from swashtwin.physics import Scales, Twin
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect
from swashtwin.recordings import Recording


def _as_it_is(thing: Any) -> Any:
    return thing


@dataclass(frozen=True)
class Wrong:
    """One mistake."""

    name: str
    """What is wrong."""
    twin: Callable[[Twin], Twin] = _as_it_is
    """The twin with it."""
    recording: Callable[[Recording], Recording] = _as_it_is
    """A recording with it."""
    clue: str = ""
    """Words by which a note names it; empty where no note can."""


def wrong_twins() -> tuple[Wrong, ...]:
    """Every mistake that is tried, after none."""
    return (
        Wrong("nothing"),
        *(_scale("mount", percent) for percent in (-50, -20, 20, 50)),
        *(_scale("bearing", percent) for percent in (-50, 50)),
        Wrong("topology T2", lambda twin: replace(twin, topology="T2"), clue="topology T1"),
        Wrong("defect loads a whole film", _with_defect(contact="literal"), clue="the defect's excitation"),
        Wrong("defect half as deep", _deeper(0.5), clue="the defect's excitation"),
        Wrong("defect twice as deep", _deeper(2.0), clue="the defect's excitation"),
        Wrong("defect 20 % longer", lambda twin: _longer(twin, 1.2)),
        Wrong("defect 20 % shorter", lambda twin: _longer(twin, 0.8)),
        Wrong("defect 4 mm narrower", lambda twin: _narrower(twin, 4e-3), clue="the defect's excitation"),
        Wrong("defect 10° further", lambda twin: _turn(twin, 10)),
        Wrong("ports open 1° later", _on_pump(_later_ports)),
        Wrong("oil 20 % softer", _on_pump(lambda pump: replace(pump, oil=_softer(pump)))),
        Wrong("oil half as viscous", _on_pump(lambda pump: replace(pump, oil=_thinner(pump)))),
        Wrong("9 pistons", _on_pump(nine_pistons), clue="piston count"),
        Wrong("cover_z sensor 40 mm off", _on_pump(_moved_sensor)),
        Wrong("body_x and body_y swapped", recording=_swap, clue="have each other's name"),
        Wrong("cover_z in g", recording=with_unit_error(("cover_z",)), clue="in g?"),
        Wrong("all channels in g", recording=with_unit_error(), clue="in g?"),
        Wrong("unit stated as g", recording=lambda recording: replace(recording, unit="g"), clue="needs m/s^2"),
        Wrong("pressure stated 10 % high", twin_at_pressure(1.1), scale_stated_pressure(1.1)),
        Wrong("pressure stated 10 % low", twin_at_pressure(0.9), scale_stated_pressure(0.9)),
        Wrong("speed stated 3 % high", _at_speed(1.03), _scale_stated_speed(1.03), clue="rev/min"),
    )


_CONSTANTS = {"mount": ("mounting", "the mounting's stiffness"), "bearing": ("bearings", "the bearings' stiffness")}


def _scale(name: str, percent: int) -> Wrong:
    words, clue = _CONSTANTS[name]
    scales = replace(Scales(), **{name: 1 + percent / 100})
    return Wrong(f"{words} {percent:+d} %", lambda twin: replace(twin, scales=scales), clue=clue)


def _defect(twin: Twin) -> SwashPlateDefect:
    assert isinstance(twin.fault, SwashPlateDefect)  # the study's twins have one
    return twin.fault


def _with_defect(**changes: Any) -> Callable[[Twin], Twin]:
    return lambda twin: twin.with_fault(replace(_defect(twin), **changes))


def _deeper(factor: float) -> Callable[[Twin], Twin]:
    return lambda twin: twin.with_fault(_defect(twin).scaled(factor))


def _longer(twin: Twin, factor: float) -> Twin:
    return twin.with_fault(replace(_defect(twin), length=factor * _defect(twin).length))


def _narrower(twin: Twin, by: float) -> Twin:
    return twin.with_fault(replace(_defect(twin), width=_defect(twin).width - by))


def _turn(twin: Twin, degrees: float) -> Twin:
    return twin.with_fault(replace(_defect(twin), angle=_defect(twin).angle + deg(degrees)))


def _on_pump(change: Callable[[Pump], Pump]) -> Callable[[Twin], Twin]:
    return lambda twin: replace(twin, pump=change(twin.pump))


def _later_ports(pump: Pump) -> Pump:
    plate = pump.valve_plate
    opens = {name: getattr(plate, name) + deg(1) for name in ("suction_open", "discharge_open")}
    return replace(pump, valve_plate=replace(plate, **opens))


def _softer(pump: Pump) -> Any:
    return replace(pump.oil, bulk_modulus=0.8 * pump.oil.bulk_modulus)


def _thinner(pump: Pump) -> Any:
    return replace(pump.oil, viscosity=0.5 * pump.oil.viscosity)


def nine_pistons(pump: Pump, count: int = 9) -> Pump:
    """Nine smaller pistons, or another count, of the same displacement."""
    group = pump.rotating_group
    diameter = group.piston_diameter * (group.piston_count / count) ** 0.5
    return replace(pump, rotating_group=replace(group, piston_count=count, piston_diameter=diameter))


def _moved_sensor(pump: Pump) -> Pump:
    moved = [
        replace(sensor, position=(sensor.position[0], sensor.position[1] + 0.04, sensor.position[2]))
        if sensor.name == "cover_z"
        else sensor
        for sensor in pump.sensors
    ]
    return replace(pump, sensors=tuple(moved))


def _swap(recording: Recording) -> Recording:
    partner = {"body_x": "body_y", "body_y": "body_x"}
    rows = [recording.channels.index(partner.get(name, name)) for name in recording.channels]
    return recording.replace(signal=recording.signal[rows])


def with_unit_error(channels: tuple[str, ...] = ()) -> Callable[[Recording], Recording]:
    """Recordings of which `channels`, or all, are in g although m/s^2 is stated."""

    def in_g(recording: Recording) -> Recording:
        signal = recording.signal.copy()
        signal[[recording.channels.index(name) for name in channels or recording.channels]] /= GRAVITY
        return recording.replace(signal=signal)

    return in_g


def twin_at_pressure(factor: float) -> Callable[[Twin], Twin]:
    """The twin at `factor` times its discharge pressure."""
    return lambda twin: twin.at(_scale_pressure(twin.condition, factor))


def scale_stated_pressure(factor: float) -> Callable[[Recording], Recording]:
    """Recordings that state `factor` times their discharge pressure."""
    return lambda recording: replace(recording, condition=_scale_pressure(_condition(recording), factor))


def _scale_pressure(condition: OperatingCondition, factor: float) -> OperatingCondition:
    return condition.replaced(discharge_pressure=factor * condition.discharge_pressure)


def _at_speed(factor: float) -> Callable[[Twin], Twin]:
    return lambda twin: twin.at(twin.condition.replaced(speed=factor * twin.condition.speed))


def _scale_stated_speed(factor: float) -> Callable[[Recording], Recording]:
    return lambda recording: replace(
        recording, condition=_condition(recording).replaced(speed=factor * _condition(recording).speed)
    )


def _condition(recording: Recording) -> OperatingCondition:
    assert recording.condition is not None  # the study's recordings have one
    return recording.condition
