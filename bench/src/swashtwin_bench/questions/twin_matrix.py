"""The matrix of wrong twins and odd truths: each case is wrong in one stated way, by axis, channel
or value.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np

from swashtwin.calibration import GRAVITY
from swashtwin.physics import Twin
from swashtwin.pump import PARAMETER_SYMBOLS, PARAMETERS, Interfaces, Pump, Sensor
from swashtwin.recordings import Recording

ChangeOfTwin = Callable[[Twin], Twin]
ChangeOfRecording = Callable[[Recording], Recording]
CHANNELS = ("cover_z", "body_y", "body_x")
RIGHT = "right"
"""Family of the twins that nothing is wrong with."""
FAR = 30.0
"""Greatest factor between a true value and the nominal one."""


def _same(thing: Any) -> Any:
    return thing


@dataclass(frozen=True)
class MatrixCase:
    """One case."""

    family: str
    """What kind of mistake it is."""
    name: str
    """The mistake."""
    twin: ChangeOfTwin = _same
    """The twin with it."""
    recording: ChangeOfRecording = _same
    """A recording with it."""
    clue: str = ""
    """Words by which a warning names it; empty where none can."""
    on_rig: bool = False
    """Whether the recordings are those of the virtual rig; else they are the twin's own."""


def matrix_cases() -> tuple[MatrixCase, ...]:
    """Every case."""
    return (
        *(MatrixCase(RIGHT, f"nothing, truth {number}") for number in range(1, 11)),
        *_mounts(),
        *_bearings(),
        *_gains(),
        *_cross_talk(),
        *_truths(),
        *_counts(),
        *_pressures(),
        *_units(),
        *_on_rig(),
        *_far_supports(),
        *_wiring(),
    )


def _words(factors: Sequence[float]) -> str:
    return "/".join(f"{100 * (factor - 1):+.0f}" for factor in factors) + " %"


def _mount_case(family: str, *factors: float, on_rig: bool = False) -> MatrixCase:
    change = on_pump(with_mount, *factors)
    return MatrixCase(
        family,
        f"mounting {_words(factors)}",
        change,
        clue="the mounting's stiffness",
        on_rig=on_rig,
    )


def _bearing_case(family: str, *factors: float, on_rig: bool = False) -> MatrixCase:
    change = on_pump(with_bearings, *factors)
    return MatrixCase(
        family, f"bearings {_words(factors)}", change, clue="stiffness of bearing", on_rig=on_rig
    )


def _mounts() -> Iterator[MatrixCase]:
    single = [
        tuple(f if i == axis else 1.0 for i in range(4)) for axis in range(4) for f in (0.8, 1.2)
    ]
    for factors in (*single, (1.2, 0.85, 0.85, 1.0), (0.8, 1.15, 1.15, 1.0)):
        yield _mount_case("mount", *factors)


def _bearings() -> Iterator[MatrixCase]:
    single = [
        tuple(f if i == number else 1.0 for i in range(3))
        for number in range(3)
        for f in (0.8, 1.2)
    ]
    for factors in (*single, (1.2, 0.8, 1.2), (0.8, 1.2, 0.8)):
        yield _bearing_case("bearing", *factors)


def _gains() -> Iterator[MatrixCase]:
    single = [
        tuple(f if i == channel else 1.0 for i in range(3))
        for channel in range(3)
        for f in (0.8, 1.2)
    ]
    for factors in (*single, (1.1, 0.9, 1.1), (0.8, 1.2, 0.8)):
        change = with_mixing(CHANNELS, np.diag(factors))
        yield MatrixCase("gain", f"gains {_words(factors)}", recording=change, clue="the gain of")


def _cross_talk() -> Iterator[MatrixCase]:
    for number, (reader, source) in enumerate(permutations(range(3), 2)):
        mixing = np.eye(3)
        mixing[reader, source] = share = (-0.2, 0.2)[number % 2]
        name = f"{CHANNELS[reader]} reads {share:+.0%} of {CHANNELS[source]}"
        yield MatrixCase(
            "cross-talk", name, recording=with_mixing(CHANNELS, mixing), clue="cross-talk"
        )
    for sign in (1, -1):
        change = with_mixing(CHANNELS, np.eye(3) + sign * _TALK)
        yield MatrixCase(
            "cross-talk", f"all pairs by 10 %, signs {sign:+d}", recording=change, clue="cross-talk"
        )


_TALK = np.array([[0, 0.1, -0.1], [0.1, 0, 0.1], [-0.1, 0.1, 0]])


def _truth_case(family: str, letter: str, factor: float, *, on_rig: bool = False) -> MatrixCase:
    name = f"{letter} {'a thirtieth of' if factor < 1 else '30 times'} the nominal one"
    return MatrixCase(
        family, name, on_pump(with_nominal, letter, factor), clue=letter, on_rig=on_rig
    )


def _truths() -> Iterator[MatrixCase]:
    for letter in PARAMETER_SYMBOLS.values():
        for factor in (1 / FAR, FAR):
            yield _truth_case("odd truth", letter, factor)


def _counts() -> Iterator[MatrixCase]:
    for count in (5, 8, 9):
        change = on_pump(with_piston_count, count)
        yield MatrixCase("piston count", f"{count} pistons", change, clue="piston count")


def _pressures() -> Iterator[MatrixCase]:
    for factor in (0.8, 0.9, 0.95, 1.05, 1.1, 1.2):
        name = f"pressure stated {100 * (factor - 1):+.0f} %"
        changes = partial(_at_stated_pressure, factor=factor)
        yield MatrixCase("pressure", name, changes, changes, clue="the discharge pressure is about")


def _units() -> Iterator[MatrixCase]:
    for name in CHANNELS:
        yield MatrixCase("unit", f"{name} in g", recording=with_unit_error((name,)), clue="in g?")
    yield MatrixCase("unit", "all channels in g", recording=with_unit_error(CHANNELS), clue="in g?")
    yield MatrixCase(
        "unit",
        "unit stated as g",
        recording=lambda each: replace(each, unit="g"),
        clue="needs m/s^2",
    )


def _far_supports() -> Iterator[MatrixCase]:
    """Supports farther off than their priors expect."""
    for factor in (0.5, 1.5):
        yield _mount_case("far support", *[factor] * 4)
        yield _bearing_case("far support", *[factor] * 3)


def _wiring() -> Iterator[MatrixCase]:
    for first, second in (("body_x", "body_y"), ("cover_z", "body_y")):
        change = with_mixing((first, second), np.eye(2)[::-1])
        yield MatrixCase(
            "wiring",
            f"{first} and {second} swapped",
            recording=change,
            clue="have each other's name",
        )
    for name, away in (("cover_z", (0.0, 0.04, 0.0)), ("body_y", (0.0, 0.0, 0.04))):
        yield MatrixCase("wiring", f"{name} sensor 40 mm off", on_pump(with_sensor, name, away))


def _on_rig() -> Iterator[MatrixCase]:
    for number in range(1, 6):
        yield MatrixCase("rig, right", f"nothing, pump {number}", on_rig=True)
    yield _mount_case("rig, wrong", 1.2, 0.85, 0.85, 1.0, on_rig=True)
    yield _bearing_case("rig, wrong", 1.2, 0.8, 1.2, on_rig=True)
    for letter, factor in (("C_sw", 1 / FAR), ("C_v", FAR), ("C_Hz", 1 / FAR)):
        yield _truth_case("rig, wrong", letter, factor, on_rig=True)


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
    stiffnesses = tuple(
        k * factor for k, factor in zip(pump.bearings.stiffnesses, factors, strict=True)
    )
    return replace(pump, bearings=replace(pump.bearings, stiffnesses=stiffnesses))


def with_nominal(pump: Pump, letter: str, factor: float) -> Pump:
    """The pump whose true value is `factor` times the nominal one."""
    values = [
        value / factor if PARAMETER_SYMBOLS[name] == letter else value
        for name, value in zip(PARAMETERS, pump.interfaces.values(), strict=True)
    ]
    return replace(pump, interfaces=Interfaces.from_values(values))


def with_piston_count(pump: Pump, count: int) -> Pump:
    """The pump with another count of pistons, of the same displacement."""
    group = pump.rotating_group
    diameter = group.piston_diameter * (group.piston_count / count) ** 0.5
    return replace(
        pump, rotating_group=replace(group, piston_count=count, piston_diameter=diameter)
    )


def with_sensor(pump: Pump, name: str, away: Sequence[float]) -> Pump:
    """The pump whose sensor of that name stands so far away [m]."""

    def position(sensor: Sensor) -> tuple[float, float, float]:
        x, y, z = np.add(sensor.position, away).tolist() if sensor.name == name else sensor.position
        return x, y, z

    return replace(
        pump, sensors=tuple(replace(sensor, position=position(sensor)) for sensor in pump.sensors)
    )


def with_mixing(channels: Sequence[str], mixing: np.ndarray) -> ChangeOfRecording:
    """Recordings whose `channels` read `mixing` of what they should."""

    def mixed(recording: Recording) -> Recording:
        rows = [recording.channels.index(name) for name in channels]
        signal = recording.signal.copy()
        signal[rows] = (mixing @ recording.signal[rows]).astype(signal.dtype)
        return recording.replace(signal=signal)

    return mixed


def with_unit_error(channels: Sequence[str]) -> ChangeOfRecording:
    """Recordings of which `channels` are in g although m/s^2 is stated."""
    return with_mixing(channels, np.eye(len(channels)) / GRAVITY)


def _at_stated_pressure(thing: Twin | Recording, factor: float) -> Any:
    """The twin or the recording at `factor` times its discharge pressure."""
    assert thing.condition is not None  # the study's recordings have one
    pressure = factor * thing.condition.discharge_pressure
    return replace(thing, condition=thing.condition.replace(discharge_pressure=pressure))
