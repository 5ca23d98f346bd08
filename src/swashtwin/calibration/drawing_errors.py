"""Numbers of the drawing and of the operating point that may be wrong, and what a calibration shows
of each.

A wrong piston area, pitch radius, port timing or discharge pressure changes the chamber pressures.
The search can take up most of that in gains and supports, but not all: at an optimum, the part of
the change that no coordinate takes up is compared with what the lines still miss (a score test, Rao
1948, doi:10.1017/S0305004100023987). This costs one set of chamber pressures for each number, so
every calibration can afford it.

The number of pistons is not among them: it moves the lines, and `speed_detection` reports it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from swashtwin.calibration.discrepancy import Linearization
from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.foundation import InputError, deg
from swashtwin.physics import Twin

ALL_PORTS = ("suction_open", "suction_close", "discharge_open", "discharge_close")
"""Angles of the valve plate that a plate in another position moves together."""

PRESSURE_FACTORS = (0.8, 0.9, 1.1, 1.25)
"""Factors on the specified discharge pressure that are tried if the misfit is large."""

MIN_INFORMATION = 1e-6
"""Information below which lines show nothing of a number: its error is then uncertain by a factor
of e^1000, or by 1000 rad.
"""


@dataclass(frozen=True)
class DrawingError:
    """One number that may be wrong."""

    change: Callable[[Twin, float], Twin]
    """Returns the twin with the number changed by a size: a logarithm, or an angle [rad]."""
    describe: Callable[[float], str]
    """Returns the mistake of a size as a clause, with the number to check."""
    step: float
    """Size of the change from which the derivative of the lines is taken."""
    max_size: float
    """Largest size that counts as a mistake of this number."""
    far_sizes: tuple[float, ...] = ()
    """Sizes to try if the misfit is too large for a derivative."""
    coordinate: str = ""
    """Name of the coordinate that is this number if it is searched (`Nuisances.port_timing`)."""

    def apply(self, objective: Objective, size: float) -> Objective | None:
        """Return the objective with the number changed; `None` if no such pump can be built."""
        try:
            comparisons = tuple(
                replace(comparison, twin=self.change(comparison.twin, size))
                for comparison in objective.comparisons
            )
        except InputError:
            return None
        return replace(objective, comparisons=comparisons)


def _change_pressure(twin: Twin, size: float) -> Twin:
    pressure = twin.condition.discharge_pressure * math.exp(size)
    return twin.at(twin.condition.replace(discharge_pressure=pressure))


def _change_area(twin: Twin, size: float) -> Twin:
    group = twin.pump.rotating_group
    # the area goes with the square of the diameter
    diameter = group.piston_diameter * math.exp(size / 2)
    changed = replace(group, piston_diameter=diameter)
    return replace(twin, pump=replace(twin.pump, rotating_group=changed))


def _change_radius(twin: Twin, size: float) -> Twin:
    group = twin.pump.rotating_group
    changed = replace(group, pitch_radius=group.pitch_radius * math.exp(size))
    return replace(twin, pump=replace(twin.pump, rotating_group=changed))


def _change_ports(twin: Twin, size: float, *, names: Sequence[str]) -> Twin:
    plate = twin.pump.valve_plate
    angles = {name: getattr(plate, name) + size for name in names}
    return replace(twin, pump=replace(twin.pump, valve_plate=replace(plate, **angles)))


def _describe_pressure(size: float) -> str:
    return f"the discharge pressure is about {math.exp(size):.2g} times the specified one"


def _describe_area(size: float) -> str:
    return (
        f"the pistons' area is about {math.exp(size):.2g} times the pump file's: check "
        "rotating_group.piston_diameter"
    )


def _describe_radius(size: float) -> str:
    return (
        f"the pitch radius is about {math.exp(size):.2g} times the pump file's: check "
        "rotating_group.pitch_radius"
    )


def _describe_ports(size: float, *, action: str, numbers: str) -> str:
    direction = "later"
    if size < 0:
        direction = "earlier"
    return (
        f"{action} about {abs(math.degrees(size)):.2g} deg {direction} than in the pump file: "
        f"check {numbers}"
    )


def _port_error(
    names: Sequence[str],
    action: str,
    numbers: str,
    far_sizes: tuple[float, ...] = (),
    coordinate: str = "",
) -> DrawingError:
    """Return the error that moves these angles of the valve plate together."""
    return DrawingError(
        partial(_change_ports, names=names),
        partial(_describe_ports, action=action, numbers=numbers),
        step=deg(1),
        max_size=deg(8),
        far_sizes=far_sizes,
        coordinate=coordinate,
    )


def _single_port_error(name: str, action: str) -> DrawingError:
    """Return the error that moves one angle of the valve plate."""
    return _port_error((name,), action, f"valve_plate.{name}", coordinate=name)


DRAWING_ERRORS = (
    DrawingError(
        _change_pressure,
        _describe_pressure,
        step=0.05,
        max_size=math.log(1.5),
        far_sizes=tuple(map(math.log, PRESSURE_FACTORS)),
    ),
    DrawingError(_change_area, _describe_area, step=0.05, max_size=math.log(1.5)),
    DrawingError(_change_radius, _describe_radius, step=0.03, max_size=math.log(1.3)),
    _port_error(
        ALL_PORTS, "all ports open and close", "the angles of valve_plate", (deg(-3), deg(3))
    ),
    _single_port_error("discharge_open", "the discharge port opens"),
    _single_port_error("suction_open", "the suction port opens"),
)
"""Numbers that are tried."""


@dataclass(frozen=True)
class ScoreTest:
    """What the lines at an optimum show of one number."""

    error: DrawingError
    """The number."""
    size: float
    """Its most likely error, to first order."""
    squares_fall: float
    """Fall of the sum of squares that it is expected to bring, priors included."""


def score_drawing(linearization: Linearization) -> tuple[ScoreTest, ...]:
    """Return what the lines at a linearized optimum show of each of `DRAWING_ERRORS` that they
    depend on.

    A number that is searched is left out: its coordinate shows its error.
    """
    objective = linearization.objective
    unknowns = objective.unknowns
    sigma = linearization.sigma
    point = torch.as_tensor(linearization.point)

    distance = (unknowns.center - linearization.point) / unknowns.deviation
    residual = np.concatenate([linearization.residual / sigma, distance])
    slope = np.vstack([linearization.slope / sigma[:, None], np.diag(1 / unknowns.deviation)])
    directions, _ = np.linalg.qr(slope)

    tests = []
    for error in DRAWING_ERRORS:
        if error.coordinate in unknowns.names:
            continue
        changed = error.apply(objective, error.step)
        if changed is None:
            continue
        with torch.no_grad():
            change = changed.observables(point).numpy() - linearization.simulated
        column = np.concatenate([change / error.step / sigma, np.zeros(len(distance))])
        # what no coordinate can take up
        column = column - directions @ (directions.T @ column)
        information = float(column @ column)
        if information < MIN_INFORMATION:
            continue
        score = float(column @ residual)
        tests.append(ScoreTest(error, score / information, score**2 / information))
    return tuple(tests)
