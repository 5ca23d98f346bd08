"""Displacements that faults impose, as functions of the shaft angle and as order lines.

Also the changes that faults make to ports and leaks. Sources and equations: the paper for the swash
plate defect (DOI 10.1177/00202940261419020), docs/explanation/physics.md, sections 3 and 5, for the
others. Lines are exact Fourier coefficients, not transforms of samples: a half-sine entry has jumps
of velocity, so its lines fall slowly and would alias. Their clock is the shaft angle theta, 0 at
top dead center of piston 0, and piston j stands at theta + 2 pi j / n. Line k - 1 is X_k of x(t) =
Re sum_k X_k exp(i k theta), without the mean.

A slipper's way through a recess (entry, dwell and exit) is a function of the shaft angle instead of
time, so that chamber pressures and excitation share one clock. Its stages are symmetric about the
middle of the recess.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np
from jaxtyping import Complex, Float, Int

from swashtwin.foundation import InputError
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    OperatingCondition,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    ValvePlateWear,
)

CONTACT_CUTOFF = 4000.0
"""Frequency [Hz] above which a slipper's contact no longer follows a recess that strains no film.

An estimate."""


@singledispatch
def find_recess(fault: Fault | None) -> SwashPlateDefect | None:
    """Return the recess that a fault makes in the slippers' track, or None.

    A new fault with a recess registers a function here.
    """
    return None


@find_recess.register(SwashPlateDefect)
def _(fault: SwashPlateDefect) -> SwashPlateDefect:
    return fault


@dataclass(frozen=True)
class Stages:
    """Entry, dwell and exit of one slipper, symmetric about the middle of the recess."""

    rise: float
    """Shaft angle of the entry, and of the exit [rad]: l1 / R."""
    total: float
    """Shaft angle from the start of the entry to the end of the exit [rad]: l3 / R."""
    depth: float
    """Displacement during the dwell [m]."""

    @property
    def dwell(self) -> float:
        """Shaft angle between entry and exit [rad]: (l2 - l1) / R."""
        return self.total - 2 * self.rise


def stages(pump: Pump, defect: SwashPlateDefect) -> Stages:
    """Return the stages of one slipper of `pump` in `defect`.

    With a the slipper's diameter and b the defect's length, (l1, l2, l3) is (a/2, b - a/2, b) for
    ``entry="center"`` and (a, b, a + b) for ``entry="edge"``. If b < a, which the paper excludes, a
    and b are exchanged in l1 and l2, and the slipper bridges the recess
    (`SwashPlateDefect.effective_depth`).

    Raises
    ------
    InputError
        The recess is longer than the track.
    """
    radius = pump.rotating_group.pitch_radius
    slipper = pump.rotating_group.slipper_diameter
    shorter = min(slipper, defect.length)
    if defect.entry == "center":
        rise = shorter / 2
        total = defect.length
    else:
        rise = shorter
        total = slipper + defect.length

    if total >= 2 * math.pi * radius:
        raise InputError(
            f"SwashPlateDefect.length ({defect.length * 1e3:.4g} mm) fills the slippers' whole "
            f"track of {2e3 * math.pi * radius:.4g} mm (pitch radius {radius * 1e3:.4g} mm, "
            f"slipper {slipper * 1e3:.4g} mm); shorten it."
        )
    return Stages(rise=rise / radius, total=total / radius, depth=defect.effective_depth(slipper))


def followed_share(
    defect: SwashPlateDefect, frequency: Float[np.ndarray, " line"]
) -> Float[np.ndarray, " line"]:
    """Return the share of a recess that slippers follow at `frequency` [Hz].

    It is 2^-(f / corner)^fall, half at the corner: a Gaussian with the fall of 2, nearer to a first
    or second order's with less. Without a corner it is exp(-(f / `CONTACT_CUTOFF`)^2), or 1 if
    films are strained.
    """
    if defect.corner:
        return np.exp2(-((frequency / defect.corner) ** defect.fall))
    cutoff = math.inf if defect.strains_films else CONTACT_CUTOFF
    return np.exp(-((frequency / cutoff) ** 2))


def canonical_recess(defect: SwashPlateDefect) -> SwashPlateDefect:
    """Return the recess with the default gain and corner, which change its force only.

    Recesses that differ only in these share one ride and the same pressures, which are cached.
    """
    return replace(defect, corner=0.0, fall=2.0, gain=1.0)


def slipper_profile(
    pump: Pump, defect: SwashPlateDefect, angle: Float[np.ndarray, "*batch"]
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Return the displacement H [m] of a slipper, and its slope dH/dphi [m/rad].

    Parameters
    ----------
    angle : shaft angle at which the slipper's piston stands [rad].
    """
    stage = stages(pump, defect)
    offset = np.mod(angle - defect.angle + math.pi, 2 * math.pi) - math.pi
    inward = np.clip(stage.total / 2 - np.abs(offset), 0.0, stage.rise) / stage.rise
    # Sign and rate at which `inward` changes; 0 outside the recess and in the dwell.
    rate = -np.sign(offset) * ((inward > 0) & (inward < 1)) / stage.rise

    if defect.edge == "half_sine":
        phase = math.pi / 2 * inward
        shape = np.sin(phase)
        slope = math.pi / 2 * np.cos(phase)
    else:
        phase = math.pi * inward
        shape = (1 - np.cos(phase)) / 2
        slope = math.pi / 2 * np.sin(phase)
    return stage.depth * shape, stage.depth * slope * rate


def _orders(n_lines: int) -> Int[np.ndarray, " line"]:
    if n_lines < 1:
        raise InputError(f"n_lines ({n_lines}) must be at least 1.")
    return np.arange(1, n_lines + 1)


def angle_ahead(pump: Pump, index: int, name: str) -> float:
    """Return the shaft angle [rad] by which piston `index` is ahead of piston 0.

    Parameters
    ----------
    name : name of the index in the message of an error.
    """
    count = pump.rotating_group.piston_count
    if index >= count:
        raise InputError(
            f"{name} ({index}) must be 0 to {count - 1}: the pump has {count} pistons."
        )
    return 2 * math.pi * index / count


def slipper_displacements(
    pump: Pump,
    condition: OperatingCondition,
    defect: SwashPlateDefect,
    time: Float[np.ndarray, " time"],
) -> Float[np.ndarray, "piston time"]:
    """Return the displacement H_j(t) [m] of each slipper in the recess.

    Parameters
    ----------
    time : time since top dead center of piston 0 [s].
    """
    count = pump.rotating_group.piston_count
    ahead = 2 * math.pi * np.arange(count)[:, None] / count
    return slipper_profile(pump, defect, condition.speed * time + ahead)[0]


def _integral(rate: Float[np.ndarray, " line"], length: float) -> Complex[np.ndarray, " line"]:
    """Return the integral of exp(i rate s) over s from 0 to `length`."""
    return length * np.exp(0.5j * rate * length) * np.sinc(rate * length / (2 * math.pi))


def _profile_lines(
    pump: Pump, defect: SwashPlateDefect, orders: Float[np.ndarray, " line"]
) -> np.ndarray:
    """Return the lines [m] of one slipper that stands in the middle of the recess at angle 0.

    They are real, because its path is symmetric.
    """
    stage = stages(pump, defect)
    if defect.edge == "half_sine":
        rate = math.pi / (2 * stage.rise)
        rise = (_integral(rate - orders, stage.rise) - _integral(-rate - orders, stage.rise)) / 2j
    else:
        rate = math.pi / stage.rise
        cosine = _integral(rate - orders, stage.rise) + _integral(-rate - orders, stage.rise)
        rise = _integral(-orders, stage.rise) / 2 - cosine / 4

    # Entry and exit are mirror images: twice the real part of the entry's integral.
    entry = (np.exp(0.5j * orders * stage.total) * rise).real
    dwell = np.sin(orders * stage.dwell / 2) / orders
    return 2 / math.pi * stage.depth * (dwell + entry)


def displacement_lines(
    pump: Pump,
    condition: OperatingCondition,
    defect: SwashPlateDefect,
    n_lines: int,
    *,
    scatter: Sequence[float] | Float[np.ndarray, " slipper"] | None = None,
) -> Complex[np.ndarray, " line"]:
    """Return the order lines [m] of the total displacement H.

    Neighboring slippers overlap in the paper's defect, and equal slippers leave only multiples of
    n: the lines of a healthy pump, weighted differently. `SwashPlateDefect.gain` is not applied
    here. If films are strained, only the share that slippers follow counts (`followed_share`).

    Parameters
    ----------
    condition : its speed determines which orders lie above the defect's corner.
    scatter : displacement of each slipper over the nominal one; None is 1 for all.
    """
    orders = _orders(n_lines)
    lines = combined_lines(pump, orders, scatter)
    if defect.strains_films:
        lines = lines * followed_share(defect, orders * condition.shaft_frequency)
    lines = lines * np.exp(-1j * orders * defect.angle)
    return lines * _profile_lines(pump, defect, orders.astype(float))


def combined_lines(
    pump: Pump,
    orders: Int[np.ndarray, " line"],
    scatter: Sequence[float] | Float[np.ndarray, " slipper"] | None,
) -> Complex[np.ndarray, " line"]:
    """Return the lines of all slippers over those of the slipper of piston 0.

    See `displacement_lines` for `scatter`.
    """
    count = pump.rotating_group.piston_count
    if scatter is None:
        return np.where(orders % count == 0, float(count), 0.0).astype(complex)

    weights = np.asarray(scatter, dtype=float)
    if weights.shape != (count,):
        raise InputError(
            f"Invalid shape {weights.shape} of scatter: "
            f"give one value for each of {count} slippers."
        )
    # Whole turns are taken off while they are integers, so that high orders lose no digits.
    turns = (orders[:, None] * np.arange(count)) % count / count
    return np.asarray(np.exp(2j * math.pi * turns) @ weights)


def bore_lines(pump: Pump, defect: BoreDefect, n_lines: int) -> Complex[np.ndarray, " line"]:
    """Return the order lines [m] of the lateral displacement H_c of the piston in a damaged bore.

    H_c = depth cos(pi (phi - angle) / (2 half_width)) while the bore's angle phi is within
    `half_width` of the defect's, once a revolution, and 0 otherwise.
    """
    if defect.half_width > math.pi:
        raise InputError(
            f"BoreDefect.half_width ({math.degrees(defect.half_width):.4g} deg) must not exceed "
            "180 deg."
        )
    orders = _orders(n_lines).astype(float)
    middle = defect.angle - angle_ahead(pump, defect.bore, "BoreDefect.bore")
    turns = orders * defect.half_width / math.pi
    # Integral of the arch times cos(k u).
    cosine = defect.half_width * (np.sinc(0.5 - turns) + np.sinc(0.5 + turns))
    return defect.depth / math.pi * np.exp(-1j * orders * middle) * cosine


@dataclass(frozen=True)
class PortChange:
    """How a fault changes when, and how far, a bore opens onto the ports."""

    advance: float = 0.0
    """How much earlier the ports open [rad]."""
    groove_factor: float = 1.0
    """Factor on the area of the relief grooves."""
    discharge_opening: float | Float[np.ndarray, " angle"] = 0.0
    """Area [m^2] added to the opening onto the discharge port, at each shaft angle."""


@singledispatch
def port_change(fault: Fault | None, angle: Float[np.ndarray, " angle"]) -> PortChange:
    """Return how a fault changes the ports at a bore's shaft `angle` [rad]: by default not at all.

    A new fault that changes them registers a function here.
    """
    return PortChange()


@port_change.register(GrooveErosion)
def _(fault: GrooveErosion, angle: Float[np.ndarray, " angle"]) -> PortChange:
    return PortChange(advance=fault.advance, groove_factor=fault.area_factor)


@port_change.register(DamScratch)
def _(fault: DamScratch, angle: Float[np.ndarray, " angle"]) -> PortChange:
    from_bottom = np.mod(angle, 2 * math.pi) - math.pi
    opening = fault.area * np.exp(-0.5 * (from_bottom / fault.width) ** 2)
    return PortChange(discharge_opening=opening)


@dataclass(frozen=True)
class AddedLeakage:
    """What a fault adds to the gaps through which the chambers leak.

    Each value holds for all pistons, or is an array with one for each.
    """

    piston_clearance: float | Float[np.ndarray, " piston"] = 0.0
    """Added to the radial clearance of the pistons [m]."""
    conductance: float | Float[np.ndarray, " piston"] = 0.0
    """Added conductance from the chambers to the case [m^3/(s Pa)]."""
    valve_plate_film: float = 0.0
    """Added to the thickness of the valve plate's film [m]."""


@singledispatch
def added_leakage(fault: Fault | None, pump: Pump) -> AddedLeakage:
    """Return what a fault adds to the gaps through which chambers leak: by default nothing.

    A new fault that adds leakage registers a function here.

    Raises
    ------
    InputError
        The fault names a piston that the pump does not have.
    """
    return AddedLeakage()


@added_leakage.register(PistonWear)
def _(fault: PistonWear, pump: Pump) -> AddedLeakage:
    return AddedLeakage(
        piston_clearance=_at_piston(pump, fault.piston, fault.clearance, "PistonWear.piston")
    )


@added_leakage.register(SealingLandScratch)
def _(fault: SealingLandScratch, pump: Pump) -> AddedLeakage:
    return AddedLeakage(
        conductance=_at_piston(pump, fault.bore, fault.conductance, "SealingLandScratch.bore")
    )


@added_leakage.register(ValvePlateWear)
def _(fault: ValvePlateWear, pump: Pump) -> AddedLeakage:
    return AddedLeakage(valve_plate_film=fault.film_increase)


def _at_piston(pump: Pump, piston: int, value: float, name: str) -> Float[np.ndarray, " piston"]:
    """Return `value` at one piston and 0 at the others."""
    # Called for its check that the pump has this piston.
    angle_ahead(pump, piston, name)
    return np.where(np.arange(pump.rotating_group.piston_count) == piston, value, 0.0)
