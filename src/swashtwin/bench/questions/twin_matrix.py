"""The matrix of wrong twins and odd truths: each case is wrong in one stated way, by axis, channel or value."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from swashtwin.bench.questions.wrong_twins import nine_pistons, scale_stated_pressure, twin_at_pressure, with_unit_error
from swashtwin.physics import Twin
from swashtwin.pump import LETTERS, PARAMETERS, Interfaces, Pump
from swashtwin.recordings import Recording

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
    twin: Callable[[Twin], Twin] = _same
    """The twin with it."""
    recording: Callable[[Recording], Recording] = _same
    """A recording with it."""
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
        *_combined(),
        *_truths(),
        *(MatrixCase("piston count", f"{count} pistons", _on_pump(nine_pistons, count)) for count in (5, 8, 9)),
        *_pressures(),
        *(MatrixCase("unit", f"{name} in g", recording=with_unit_error((name,))) for name in CHANNELS),
        MatrixCase("unit", "all channels in g", recording=with_unit_error(CHANNELS)),
        MatrixCase("unit", "unit stated as g", recording=lambda recording: replace(recording, unit="g")),
        *_on_rig(),
    )


def _on_pump(change: Callable[..., Pump], *arguments: Any) -> Callable[[Twin], Twin]:
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


def _words(factors: Sequence[float]) -> str:
    return "/".join(f"{100 * (factor - 1):+.0f}" for factor in factors) + " %"


def _mounts() -> Iterator[MatrixCase]:
    single = [tuple(f if i == axis else 1.0 for i in range(4)) for axis in range(4) for f in (0.8, 1.2)]
    for factors in (*single, (1.2, 0.85, 0.85, 1.0), (0.8, 1.15, 1.15, 1.0)):
        yield MatrixCase("mount", f"mounting {_words(factors)}", _on_pump(with_mount, *factors))


def _bearings() -> Iterator[MatrixCase]:
    single = [tuple(f if i == number else 1.0 for i in range(3)) for number in range(3) for f in (0.8, 1.2)]
    for factors in (*single, (1.2, 0.8, 1.2), (0.8, 1.2, 0.8)):
        yield MatrixCase("bearing", f"bearings {_words(factors)}", _on_pump(with_bearings, *factors))


def with_mixing(mixing: np.ndarray) -> Callable[[Recording], Recording]:
    """Recordings whose channels read `mixing` of what they should."""

    def mixed(recording: Recording) -> Recording:
        rows = [recording.channels.index(name) for name in CHANNELS]
        signal = recording.signal.copy()
        signal[rows] = (mixing @ recording.signal[rows]).astype(signal.dtype)
        return recording.replace(signal=signal)

    return mixed


def _gains() -> Iterator[MatrixCase]:
    single = [tuple(f if i == channel else 1.0 for i in range(3)) for channel in range(3) for f in (0.8, 1.2)]
    for factors in (*single, (1.1, 0.9, 1.1), (0.8, 1.2, 0.8)):
        yield MatrixCase("gain", f"gains {_words(factors)}", recording=with_mixing(np.diag(factors)))


def _cross_talk() -> Iterator[MatrixCase]:
    for number, (reader, source) in enumerate(permutations(range(3), 2)):
        mixing = np.eye(3)
        mixing[reader, source] = share = (-0.2, 0.2)[number % 2]
        name = f"{CHANNELS[reader]} reads {share:+.0%} of {CHANNELS[source]}"
        yield MatrixCase("cross-talk", name, recording=with_mixing(mixing))
    for sign in (1, -1):
        mixing = np.eye(3) + sign * np.array([[0, 0.1, -0.1], [0.1, 0, 0.1], [-0.1, 0.1, 0]])
        yield MatrixCase("cross-talk", f"all pairs by 10 %, signs {sign:+d}", recording=with_mixing(mixing))


def _combined() -> Iterator[MatrixCase]:
    talk = np.array([[0, 0.1, -0.1], [0.1, 0, 0.1], [-0.1, 0.1, 0]])
    for sign in (1, -1):
        mount = [1 + sign * share for share in (0.2, -0.15, -0.15)]
        bearings = [1 + sign * share for share in (0.2, -0.2, 0.2)]
        gains = np.diag([1 + sign * share for share in (0.1, -0.1, 0.1)])
        twin = _both(_on_pump(with_mount, *mount), _on_pump(with_bearings, *bearings))
        yield MatrixCase("combined", f"mounting, bearings, gains {sign:+d}", twin, with_mixing(gains))
        yield MatrixCase("combined", f"and cross-talk {sign:+d}", twin, with_mixing(gains + sign * talk))


def _both(first: Callable[[Twin], Twin], second: Callable[[Twin], Twin]) -> Callable[[Twin], Twin]:
    return lambda twin: second(first(twin))


def with_nominal(pump: Pump, letter: str, factor: float) -> Pump:
    """The pump whose true value is `factor` times the nominal one."""
    values = [
        value / factor if LETTERS[name] == letter else value
        for name, value in zip(PARAMETERS, pump.interfaces.values(), strict=True)
    ]
    return replace(pump, interfaces=Interfaces.from_values(values))


def _truths() -> Iterator[MatrixCase]:
    for letter in LETTERS.values():
        for factor in (1 / FAR, FAR):
            name = f"{letter} {'a thirtieth of' if factor < 1 else '30 times'} the nominal one"
            yield MatrixCase("odd truth", name, _on_pump(with_nominal, letter, factor))


def _pressures() -> Iterator[MatrixCase]:
    for factor in (0.8, 0.9, 0.95, 1.05, 1.1, 1.2):
        name = f"pressure stated {100 * (factor - 1):+.0f} %"
        yield MatrixCase("pressure", name, twin_at_pressure(factor), scale_stated_pressure(factor))


def _on_rig() -> Iterator[MatrixCase]:
    for number in range(1, 6):
        yield MatrixCase("rig, right", f"nothing, pump {number}", on_rig=True)
    off = (1.2, 0.85, 0.85, 1.0)
    yield MatrixCase("rig, wrong", f"mounting {_words(off)}", _on_pump(with_mount, *off), on_rig=True)
    bearings = (1.2, 0.8, 1.2)
    yield MatrixCase("rig, wrong", f"bearings {_words(bearings)}", _on_pump(with_bearings, *bearings), on_rig=True)
    for letter, factor in (("C_sw", 1 / FAR), ("C_v", FAR), ("C_Hz", 1 / FAR)):
        name = f"{letter} {'a thirtieth of' if factor < 1 else '30 times'} the nominal one"
        yield MatrixCase("rig, wrong", name, _on_pump(with_nominal, letter, factor), on_rig=True)
