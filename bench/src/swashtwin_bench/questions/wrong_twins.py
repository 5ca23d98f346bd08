"""Ways in which a twin or a recording may be wrong, to see what a calibration makes of them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from swashtwin.calibration import GRAVITY
from swashtwin.physics import Twin
from swashtwin.pump import LETTERS, PARAMETERS, Interfaces, OperatingCondition, Pump
from swashtwin.recordings import Recording

ChangeOfTwin = Callable[[Twin], Twin]
ChangeOfRecording = Callable[[Recording], Recording]


def on_pump(change: Callable[..., Pump], *arguments: Any) -> ChangeOfTwin:
    """Twins whose pump is changed."""
    return lambda twin: replace(twin, pump=change(twin.pump, *arguments))


def with_mount(pump: Pump, x: float, y: float, z: float, tilt: float = 1.0) -> Pump:
    """The pump with factors on the stiffness of its mounting along each axis and in tilt."""
    factors = {"stiffness_x": x, "stiffness_y": y, "stiffness_z": z, "stiffness_tilt": tilt}
    changes = {name: factor * getattr(pump.mount, name) for name, factor in factors.items()}
    return replace(pump, mount=replace(pump.mount, **changes))


def with_bearings(pump: Pump, *factors: float) -> Pump:
    """The pump with a factor on the stiffness of each bearing."""
    stiffnesses = tuple(k * factor for k, factor in zip(pump.bearings.stiffnesses, factors, strict=True))
    return replace(pump, bearings=replace(pump.bearings, stiffnesses=stiffnesses))


def with_nominal(pump: Pump, letter: str, factor: float) -> Pump:
    """The pump whose true value is `factor` times the nominal one."""
    values = [
        value / factor if LETTERS[name] == letter else value
        for name, value in zip(PARAMETERS, pump.interfaces.values(), strict=True)
    ]
    return replace(pump, interfaces=Interfaces.from_values(values))


def with_piston_count(pump: Pump, count: int) -> Pump:
    """The pump with another count of pistons, of the same displacement."""
    group = pump.rotating_group
    diameter = group.piston_diameter * (group.piston_count / count) ** 0.5
    return replace(pump, rotating_group=replace(group, piston_count=count, piston_diameter=diameter))


def with_sensor(pump: Pump, name: str, away: Sequence[float]) -> Pump:
    """The pump whose sensor of that name stands so far away [m]."""
    moved = [
        replace(
            sensor, position=(sensor.position[0] + away[0], sensor.position[1] + away[1], sensor.position[2] + away[2])
        )
        if sensor.name == name
        else sensor
        for sensor in pump.sensors
    ]
    return replace(pump, sensors=tuple(moved))


def with_mixing(channels: Sequence[str], mixing: np.ndarray) -> ChangeOfRecording:
    """Recordings whose `channels` read `mixing` of what they should."""

    def mixed(recording: Recording) -> Recording:
        rows = [recording.channels.index(name) for name in channels]
        signal = recording.signal.copy()
        signal[rows] = (mixing @ recording.signal[rows]).astype(signal.dtype)
        return recording.replace(signal=signal)

    return mixed


def with_swap(first: str, second: str) -> ChangeOfRecording:
    """Recordings in which two channels have each other's name."""
    return with_mixing((first, second), np.array([[0.0, 1.0], [1.0, 0.0]]))


def with_unit_error(channels: Sequence[str]) -> ChangeOfRecording:
    """Recordings of which `channels` are in g although m/s^2 is stated."""
    return with_mixing(channels, np.eye(len(channels)) / GRAVITY)


def twin_at_pressure(factor: float) -> ChangeOfTwin:
    """Twins at `factor` times their discharge pressure."""
    return lambda twin: twin.at(_scale_pressure(twin.condition, factor))


def scale_stated_pressure(factor: float) -> ChangeOfRecording:
    """Recordings that state `factor` times their discharge pressure."""
    return lambda recording: replace(recording, condition=_scale_pressure(_condition(recording), factor))


def _scale_pressure(condition: OperatingCondition, factor: float) -> OperatingCondition:
    return condition.replaced(discharge_pressure=factor * condition.discharge_pressure)


def _condition(recording: Recording) -> OperatingCondition:
    assert recording.condition is not None  # the study's recordings have one
    return recording.condition
