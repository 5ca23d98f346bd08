"""The matrix of wrong twins and extreme true values.

Each case has one known mistake along one axis, in one channel or in one value.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
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
"""Family of the twins without a mistake."""

# Largest factor between a true interface value and the nominal one.
_MAX_VALUE_FACTOR = 30.0

# Factors on a stiffness or a gain that is wrong by 20 %.
_WRONG_FACTORS = (0.8, 1.2)

# Share of each channel (column) that each other channel (row) reads when all pairs are coupled.
_CROSS_TALK = np.array([[0, 0.1, -0.1], [0.1, 0, 0.1], [-0.1, 0.1, 0]])


def _unchanged(original: Any) -> Any:
    return original


@dataclass(frozen=True)
class MatrixCase:
    """One mistake, and how to make it."""

    family: str
    """Kind of mistake."""
    name: str
    """Description of the mistake."""
    twin: ChangeOfTwin = _unchanged
    """Function that puts the mistake into a twin."""
    recording: ChangeOfRecording = _unchanged
    """Function that puts the mistake into a recording."""
    expected_warning: str = ""
    """Text by which a warning names the mistake; empty if no warning can."""
    on_rig: bool = False
    """Whether the recordings are those of the virtual rig instead of the twin's own."""


def matrix_cases() -> tuple[MatrixCase, ...]:
    """Return every case."""
    return (
        *(MatrixCase(RIGHT, f"nothing, truth {number}") for number in range(1, 11)),
        *_mounts(),
        *_bearings(),
        *_gains(),
        *_cross_talk(),
        *_extreme_values(),
        *_piston_counts(),
        *_pressures(),
        *_units(),
        *_rig_cases(),
        *_unlikely_supports(),
        *_wiring(),
    )


def _format_percent(factor: float) -> str:
    return f"{100 * (factor - 1):+.0f}"


def _describe_factors(factors: Sequence[float]) -> str:
    return "/".join(_format_percent(factor) for factor in factors) + " %"


def _single_factors(count: int) -> Iterator[tuple[float, ...]]:
    """Yield sets of `count` factors, a single one of which is wrong: too small, then too large."""
    for index in range(count):
        for wrong_factor in _WRONG_FACTORS:
            factors = [1.0] * count
            factors[index] = wrong_factor
            yield tuple(factors)


def _mount_case(family: str, *factors: float, on_rig: bool = False) -> MatrixCase:
    return MatrixCase(
        family,
        f"mounting {_describe_factors(factors)}",
        on_pump(with_mount, *factors),
        expected_warning="the mounting's stiffness",
        on_rig=on_rig,
    )


def _bearing_case(family: str, *factors: float, on_rig: bool = False) -> MatrixCase:
    return MatrixCase(
        family,
        f"bearings {_describe_factors(factors)}",
        on_pump(with_bearings, *factors),
        expected_warning="stiffness of bearing",
        on_rig=on_rig,
    )


def _mounts() -> Iterator[MatrixCase]:
    for factors in (*_single_factors(4), (1.2, 0.85, 0.85, 1.0), (0.8, 1.15, 1.15, 1.0)):
        yield _mount_case("mount", *factors)


def _bearings() -> Iterator[MatrixCase]:
    for factors in (*_single_factors(3), (1.2, 0.8, 1.2), (0.8, 1.2, 0.8)):
        yield _bearing_case("bearing", *factors)


def _gains() -> Iterator[MatrixCase]:
    for gains in (*_single_factors(len(CHANNELS)), (1.1, 0.9, 1.1), (0.8, 1.2, 0.8)):
        yield MatrixCase(
            "gain",
            f"gains {_describe_factors(gains)}",
            recording=with_mixing(CHANNELS, np.diag(gains)),
            expected_warning="the gain of",
        )


def _cross_talk() -> Iterator[MatrixCase]:
    for number, (reader, source) in enumerate(permutations(range(3), 2)):
        # The sign alternates, so that both occur for each reader.
        share = -0.2 if number % 2 == 0 else 0.2
        mixing = np.eye(3)
        mixing[reader, source] = share
        yield MatrixCase(
            "cross-talk",
            f"{CHANNELS[reader]} reads {share:+.0%} of {CHANNELS[source]}",
            recording=with_mixing(CHANNELS, mixing),
            expected_warning="cross-talk",
        )

    for sign in (1, -1):
        yield MatrixCase(
            "cross-talk",
            f"all pairs by 10 %, signs {sign:+d}",
            recording=with_mixing(CHANNELS, np.eye(3) + sign * _CROSS_TALK),
            expected_warning="cross-talk",
        )


def _extreme_value_case(
    family: str, symbol: str, factor: float, *, on_rig: bool = False
) -> MatrixCase:
    ratio = "a thirtieth of" if factor < 1 else "30 times"
    return MatrixCase(
        family,
        f"{symbol} {ratio} the nominal one",
        on_pump(with_nominal, symbol, factor),
        expected_warning=symbol,
        on_rig=on_rig,
    )


def _extreme_values() -> Iterator[MatrixCase]:
    for symbol in PARAMETER_SYMBOLS.values():
        for factor in (1 / _MAX_VALUE_FACTOR, _MAX_VALUE_FACTOR):
            yield _extreme_value_case("odd truth", symbol, factor)


def _piston_counts() -> Iterator[MatrixCase]:
    for count in (5, 8, 9):
        yield MatrixCase(
            "piston count",
            f"{count} pistons",
            on_pump(with_piston_count, count),
            expected_warning="piston count",
        )


def _pressures() -> Iterator[MatrixCase]:
    for factor in (0.8, 0.9, 0.95, 1.05, 1.1, 1.2):
        # A recording carries its operating point too: both must specify the same wrong pressure.
        change = _with_pressure_factor(factor)
        yield MatrixCase(
            "pressure",
            f"pressure stated {_format_percent(factor)} %",
            twin=change,
            recording=change,
            expected_warning="the discharge pressure is about",
        )


def _units() -> Iterator[MatrixCase]:
    for name in CHANNELS:
        yield MatrixCase(
            "unit",
            f"{name} in g",
            recording=with_unit_error((name,)),
            expected_warning="in g?",
        )

    yield MatrixCase(
        "unit",
        "all channels in g",
        recording=with_unit_error(CHANNELS),
        expected_warning="in g?",
    )
    yield MatrixCase(
        "unit",
        "unit stated as g",
        recording=lambda recording: replace(recording, unit="g"),
        expected_warning="needs m/s^2",
    )


def _unlikely_supports() -> Iterator[MatrixCase]:
    """Yield supports that differ from the drawing by more than their priors expect."""
    for factor in (0.5, 1.5):
        yield _mount_case("far support", *[factor] * 4)
        yield _bearing_case("far support", *[factor] * 3)


def _wiring() -> Iterator[MatrixCase]:
    for first, second in (("body_x", "body_y"), ("cover_z", "body_y")):
        yield MatrixCase(
            "wiring",
            f"{first} and {second} swapped",
            recording=with_mixing((first, second), np.eye(2)[::-1]),
            expected_warning="have each other's name",
        )

    for name, offset in (("cover_z", (0.0, 0.04, 0.0)), ("body_y", (0.0, 0.0, 0.04))):
        yield MatrixCase("wiring", f"{name} sensor 40 mm off", on_pump(with_sensor, name, offset))


def _rig_cases() -> Iterator[MatrixCase]:
    for number in range(1, 6):
        yield MatrixCase("rig, right", f"nothing, pump {number}", on_rig=True)

    yield _mount_case("rig, wrong", 1.2, 0.85, 0.85, 1.0, on_rig=True)
    yield _bearing_case("rig, wrong", 1.2, 0.8, 1.2, on_rig=True)
    for symbol, factor in (
        ("C_sw", 1 / _MAX_VALUE_FACTOR),
        ("C_v", _MAX_VALUE_FACTOR),
        ("C_Hz", 1 / _MAX_VALUE_FACTOR),
    ):
        yield _extreme_value_case("rig, wrong", symbol, factor, on_rig=True)


def on_pump(change: Callable[..., Pump], *arguments: Any) -> ChangeOfTwin:
    """Return the function that applies `change` to the pump of a twin."""
    return lambda twin: replace(twin, pump=change(twin.pump, *arguments))


def with_mount(pump: Pump, x: float, y: float, z: float, tilt: float = 1.0) -> Pump:
    """Return the pump with factors on the stiffness of its mounting along each axis and in tilt."""
    mount = replace(
        pump.mount,
        stiffness_x=x * pump.mount.stiffness_x,
        stiffness_y=y * pump.mount.stiffness_y,
        stiffness_z=z * pump.mount.stiffness_z,
        stiffness_tilt=tilt * pump.mount.stiffness_tilt,
    )
    return replace(pump, mount=mount)


def with_bearings(pump: Pump, *factors: float) -> Pump:
    """Return the pump with a factor on the stiffness of each bearing."""
    pairs = zip(pump.bearings.stiffnesses, factors, strict=True)
    stiffnesses = tuple(stiffness * factor for stiffness, factor in pairs)
    return replace(pump, bearings=replace(pump.bearings, stiffnesses=stiffnesses))


def with_nominal(pump: Pump, symbol: str, factor: float) -> Pump:
    """Return the pump whose true value is `factor` times the nominal one.

    The nominal value is divided by `factor`, because the recordings keep the true one.
    """
    values = []
    for name, value in zip(PARAMETERS, pump.interfaces.values(), strict=True):
        if PARAMETER_SYMBOLS[name] == symbol:
            value = value / factor
        values.append(value)
    return replace(pump, interfaces=Interfaces.from_values(values))


def with_piston_count(pump: Pump, count: int) -> Pump:
    """Return the pump with another piston count and the same displacement."""
    group = pump.rotating_group
    diameter = group.piston_diameter * (group.piston_count / count) ** 0.5
    return replace(
        pump, rotating_group=replace(group, piston_count=count, piston_diameter=diameter)
    )


def with_sensor(pump: Pump, name: str, offset: Sequence[float]) -> Pump:
    """Return the pump with the named sensor moved by `offset` [m]."""

    def moved(sensor: Sensor) -> Sensor:
        x, y, z = np.add(sensor.position, offset).tolist()
        return replace(sensor, position=(x, y, z))

    sensors = [moved(sensor) if sensor.name == name else sensor for sensor in pump.sensors]
    return replace(pump, sensors=tuple(sensors))


def with_mixing(channels: Sequence[str], mixing: np.ndarray) -> ChangeOfRecording:
    """Return the function that replaces `channels` of a recording by `mixing` times them."""

    def mix(recording: Recording) -> Recording:
        rows = [recording.channels.index(name) for name in channels]
        signal = recording.signal.copy()
        signal[rows] = (mixing @ recording.signal[rows]).astype(signal.dtype)
        return recording.replace(signal=signal)

    return mix


def with_unit_error(channels: Sequence[str]) -> ChangeOfRecording:
    """Return the function that puts `channels` in g, although the recording specifies m/s^2."""
    return with_mixing(channels, np.eye(len(channels)) / GRAVITY)


def _with_pressure_factor(factor: float) -> Callable[[Any], Any]:
    """Return the function that multiplies the discharge pressure of a twin or a recording."""

    def change(original: Twin | Recording) -> Twin | Recording:
        assert original.condition is not None  # the study's recordings have one
        pressure = factor * original.condition.discharge_pressure
        condition = original.condition.replace(discharge_pressure=pressure)
        return replace(original, condition=condition)

    return change
