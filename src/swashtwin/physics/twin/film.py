"""Films as an option: one thickness instead of C_sw and K_sw, and values that move as the oil moves them.

A twin's six values are free numbers. Here the slippers' two are tied through the thickness h of the film that they ride
on, and a twin is taken to another condition with its films. Both rest on the laws of `films`: hydrostatic and laminar
films between rigid parallel faces, equal slippers. Lift from sliding and tilt, elastic faces and the oil's compression
in the pockets are left out. Derivation: docs/explanation/physics.md, sections 4 and 6.

A film's thickness does not set the leakage of a chamber, which stays that of ``rotating_group.slipper_film`` (12 um):
the pressures then need not be computed again for each thickness. It costs 3 % of a healthy spectrum for a film of
7.5 um and 24 % for one of 25 um; a pump whose ``slipper_film`` is set to the same thickness avoids that.
"""

import math
from dataclasses import dataclass, replace

from jaxtyping import Float
from scipy.optimize import brentq
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics.films import (
    slipper_lift,
    slipper_squeeze_damping,
    slipper_stiffness,
    valve_plate_squeeze_damping,
    valve_plate_stiffness,
)
from swashtwin.physics.twin.model import Twin
from swashtwin.pump import Interface, Interfaces, OperatingCondition, Pump

THICKNESSES = (4.999999e-6, 50.00001e-6)
"""Range [m] of thicknesses, a hair wide for rounding.

Thinner films touch the faces' roughness; beyond 50 um the damping hole turns turbulent at 15 MPa and 45 degC (beyond
30 um at 60 degC), and the stiffness falls again.
"""


@dataclass(frozen=True)
class SlipperFilm:
    """The film under the slippers at one condition, and what it gives."""

    thickness: float
    """Thickness h [m]."""
    damping: float
    """C_sw of all slippers [N s/m]."""
    stiffness: float
    """K_sw of the loaded slippers [N/m]."""
    lift_ratio: float
    """Hydrostatic lift over the force of a loaded piston [1]. Above 1 the film would thicken until it is 1, were it not
    held down; below 1 something else helps to carry, such as lift from sliding."""


def film_of(twin: Twin) -> SlipperFilm:
    """The film whose squeeze damping is the twin's C_sw at its oil temperature; the twin's K_sw has no say.

    Raises
    ------
    InputError
        No film of 5...50 um damps like that.

    Examples
    --------
    >>> from swashtwin import MPa, OperatingCondition, load_pump, rpm
    >>> twin = Twin(load_pump("25scy14-1b"), OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15)))
    >>> film = film_of(twin)
    >>> print(f"{film.thickness * 1e6:.2f} um, K_sw = {film.stiffness:.2g} N/m")
    7.49 um, K_sw = 8.8e+06 N/m
    """
    pump, temperature = twin.pump, twin.condition.oil_temperature
    viscosity = pump.oil.viscosity_at(temperature)
    damping = _interfaces(twin).slipper_swash.damping
    thinnest, thickest = THICKNESSES
    least, most = (slipper_squeeze_damping(pump, film, viscosity) for film in (thickest, thinnest))
    if not least <= damping <= most:
        raise InputError(
            f"slipper_swash.damping ({damping:g} N s/m) is that of no slipper film of {thinnest * 1e6:g}..."
            f"{thickest * 1e6:g} um, which damp with {least:.3g}...{most:.3g} N s/m at {temperature - 273.15:.4g} degC;"
            " check condition.oil_temperature, or choose the film yourself: with_film(twin, um(10))."
        )

    def surplus(film: float) -> float:
        return math.log(slipper_squeeze_damping(pump, film, viscosity) / damping)

    thickness = brentq(surplus, thinnest, thickest, xtol=1e-18)
    pressure = _driving_pressure(twin.condition)
    return SlipperFilm(
        thickness=thickness,
        damping=damping,
        stiffness=slipper_stiffness(pump, thickness, pressure),
        lift_ratio=slipper_lift(pump, thickness, pressure)
        / (pump.rotating_group.piston_area * pressure / math.cos(pump.rotating_group.swash_angle)),
    )


def with_film(twin: Twin, thickness: float) -> Twin:
    """The twin with C_sw and K_sw of a slipper film of that `thickness` [m] under its condition.

    Raises
    ------
    InputError
        The thickness lies outside 5...50 um.
    """
    thinnest, thickest = THICKNESSES
    if not thinnest <= thickness <= thickest:
        raise InputError(
            f"thickness ({thickness:g} m) of the slipper film lies outside {thinnest * 1e6:g}...{thickest * 1e6:g} um, "
            "where its laws hold. Thicknesses are in meters: 10 um is um(10)."
        )
    slipper = Interface(
        damping=slipper_squeeze_damping(
            twin.pump, thickness, twin.pump.oil.viscosity_at(twin.condition.oil_temperature)
        ),
        stiffness=slipper_stiffness(twin.pump, thickness, _driving_pressure(twin.condition)),
    )
    return twin.with_interfaces(replace(_interfaces(twin), slipper_swash=slipper))


def film_values(
    pump: Pump, condition: OperatingCondition, thickness: Float[Tensor, "*batch"]
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """C_sw [N s/m] and K_sw [N/m] of slipper films of that `thickness` [m], differentiable with respect to it.

    For a search in the logarithm of the thickness, whose bounds are the search's own (`THICKNESSES`).

    Examples
    --------
    >>> import torch
    >>> from swashtwin import MPa, OperatingCondition, load_pump, rpm
    >>> twin = Twin(load_pump("25scy14-1b"), OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15)))
    >>> logarithm = torch.tensor(10e-6, dtype=torch.float64).log().requires_grad_()
    >>> damping, stiffness = film_values(twin.pump, twin.condition, logarithm.exp())
    >>> values = torch.cat([torch.stack([damping, stiffness]), twin.values[2:]])  # for twin.acceleration
    >>> print(f"{damping:.3g} {torch.autograd.grad(damping.log(), logarithm)[0]:.3g}")
    8.08e+05 -2.83
    """
    viscosity = pump.oil.viscosity_at(condition.oil_temperature)
    damping = slipper_squeeze_damping(pump, thickness, viscosity)
    return damping, slipper_stiffness(pump, thickness, _driving_pressure(condition))


def carry_over(twin: Twin, condition: OperatingCondition, *, bore_exponent: float = 0.0) -> Twin:
    """The twin at another condition, its values moved as oil moves them; `Twin.at` leaves them as they are.

    Each value keeps its ratio to its film's law, so that what a calibration found goes along; the films need not lie
    within the range of `film_of`.

    - C_sw and C_v move with the viscosity at the oil temperature.
    - K_sw moves with the discharge pressure above the case's.
    - K_v moves with `films.valve_plate_load`: that pressure, and the central spring.
    - K_Hz, a column of oil, stays: its bulk modulus moves by less than 3 % between 5 and 15 MPa.

    Films keep their thickness, which is what hydrostatic balance gives: a slipper floats where its pocket holds a fixed
    share of the pressure, whatever pressure and viscosity are. Films that sliding carries would thin instead,
    h ~ (viscosity speed / pressure)^0.5, and then damp *more* when warm; where that is known, set the thickness at each
    condition by `with_film`. Which of both a pump does is not in the paper: our reading.

    Parameters
    ----------
    condition : where the twin goes.
    bore_exponent : power of the viscosity with which C_Hz moves. The pistons' sliding films damp 1000 times less than
        the paper's C_Hz and their squeeze films 2000 times more, so no film law gives it: 0 keeps it, 1 is pure film.
    """
    pump, here = twin.pump, twin.condition
    (before, after) = (pump.oil.viscosity_at(point.oil_temperature) for point in (here, condition))
    viscosity, film = after / before, pump.valve_plate.film
    there_pressure, here_pressure = _driving_pressure(condition), _driving_pressure(here)
    damping = valve_plate_squeeze_damping(pump, film, after) / valve_plate_squeeze_damping(pump, film, before)
    stiffness = valve_plate_stiffness(pump, film, there_pressure) / valve_plate_stiffness(pump, film, here_pressure)
    factors = Interfaces(
        slipper_swash=Interface(damping=viscosity, stiffness=there_pressure / here_pressure),
        block_valve=Interface(damping=damping, stiffness=stiffness),
        piston_bore=Interface(damping=viscosity**bore_exponent, stiffness=1.0),
    )
    values = [value * factor for value, factor in zip(_interfaces(twin).values(), factors.values(), strict=True)]
    return replace(twin, condition=condition, interfaces=Interfaces.from_values(values))


def _interfaces(twin: Twin) -> Interfaces:
    return twin.interfaces or twin.pump.interfaces


def _driving_pressure(condition: OperatingCondition) -> float:
    """Discharge pressure above the case's [Pa], which feeds the films."""
    if condition.discharge_pressure <= condition.case_pressure:
        raise InputError(
            f"discharge_pressure ({condition.discharge_pressure:g} Pa) must exceed case_pressure "
            f"({condition.case_pressure:g} Pa), or no film carries. Pressures are in Pa: 15 MPa is MPa(15)."
        )
    return condition.discharge_pressure - condition.case_pressure
