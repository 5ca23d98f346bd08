"""Excitations by faults: the paper's piecewise displacement, physics.md, and fine transforms."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from swashtwin.foundation import InputError, deg, mm, um
from swashtwin.physics import interface_factors, slipper_displacements
from swashtwin.physics.excitation import (
    bore_lines,
    displacement_lines,
    followed_share,
    slipper_profile,
    stages,
)
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    OperatingCondition,
    Pump,
    SwashPlateDefect,
    ValvePlateWear,
)

DEFECT = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
Entry = Literal["center", "edge"]
Edge = Literal["half_sine", "raised_cosine"]
ENTRIES = pytest.mark.parametrize("entry", ["center", "edge"])
EDGES = pytest.mark.parametrize("edge", ["half_sine", "raised_cosine"])


def sampled_lines(
    function: Callable[[np.ndarray], np.ndarray], n_lines: int, points: int = 2**18
) -> np.ndarray:
    """Lines of a function of the shaft angle from the trapezoidal rule on many points."""
    angle = 2 * math.pi * np.arange(points) / points
    return np.fft.rfft(function(angle))[1 : n_lines + 1] * 2 / points


def with_pitch_radius(pump: Pump, radius: float) -> Pump:
    return replace(pump, rotating_group=replace(pump.rotating_group, pitch_radius=mm(radius)))


# Radii at which neighbors overlap clearly, overlap little, and (R = 35 mm, by centers) do not.
STAGE_CASES = pytest.mark.parametrize(
    ("entry", "radius", "stage_ms", "overlap_ms", "slippers_in_recess", "summed_heights_mm"),
    [
        ("center", 26, (4.70, 3.42, 12.81), 2.85, (1, 2), (0.49, 0.57, 0.60)),
        ("center", 31, (3.94, 2.87, 10.75), 0.78, (1, 2), (0.18, 0.47, 0.60)),
        ("center", 35, (3.49, 2.54, 9.52), -0.45, (0, 1), (0.00, 0.42, 0.60)),
        ("edge", 26, (9.40, 3.42, 22.21), 12.24, (2, 3), (0.82, 0.93, 1.02)),
        ("edge", 35, (6.98, 2.54, 16.50), 6.53, (1, 2), (0.60, 0.69, 0.80)),
    ],
)
"""Entry and radius [mm]; rise, dwell and total time of a slipper; its overlap with the next one;
minimum and maximum number of slippers in the recess; minimum, mean and maximum of their sum.
"""


@STAGE_CASES
def test_the_stages_of_a_passage_are_those_tabulated(
    pump: Pump,
    at_15: OperatingCondition,
    entry: Entry,
    radius: float,
    stage_ms: tuple[float, float, float],
    overlap_ms: float,
    slippers_in_recess: tuple[int, int],
    summed_heights_mm: tuple[float, float, float],
) -> None:
    pump = with_pitch_radius(pump, radius)
    defect = replace(DEFECT, entry=entry)

    # half a unit of the last digit in the table, and a margin
    stage = stages(pump, defect)
    angles = np.array([stage.rise, stage.dwell, stage.total])
    times = 1e3 * angles / at_15.speed
    np.testing.assert_allclose(times, stage_ms, atol=0.006)
    pitch = 1e3 * at_15.period / 7
    assert times[2] - pitch == pytest.approx(overlap_ms, abs=0.01)

    time = np.linspace(0, at_15.period, 20001)[:-1]
    heights = slipper_displacements(pump, at_15, defect, time)
    count = (heights > 0).sum(axis=0)
    assert (count.min(), count.max()) == slippers_in_recess
    summed = 1e3 * heights.sum(axis=0)
    np.testing.assert_allclose(
        [summed.min(), summed.mean(), summed.max()], summed_heights_mm, atol=0.006
    )


def test_the_first_slipper_follows_the_papers_formula(
    pump: Pump, at_15: OperatingCondition
) -> None:
    d = mm(0.6)
    speed = at_15.speed * mm(26)
    t1 = mm(11) / speed  # half a slipper
    t2 = mm(19) / speed  # the recess less half a slipper
    t3 = mm(30) / speed  # the recess
    start = (DEFECT.angle - mm(15) / mm(26)) / at_15.speed
    after_exit_begins = 1e-4
    expected_heights = {
        -1e-4: 0.0,
        0.0: 0.0,
        0.3 * t1: d * math.sin(0.15 * math.pi),
        t1: d,
        0.5 * (t1 + t2): d,
        t2 + after_exit_begins: d
        * math.sin(math.pi / 2 * (t3 - t2 - after_exit_begins) / (t3 - t2)),
        t3: 0.0,
        t3 + 1e-4: 0.0,
    }

    time = start + np.array(list(expected_heights))
    heights = slipper_displacements(pump, at_15, DEFECT, time)[0]

    np.testing.assert_allclose(heights, list(expected_heights.values()), atol=1e-12)


# recesses longer than a slipper (22 mm), as long, and shorter
EACH_SHAPE = pytest.mark.parametrize(
    "defect",
    [
        replace(DEFECT, entry=entry, edge=edge, length=length)
        for entry, edge, length in itertools.product(
            ("center", "edge"), ("half_sine", "raised_cosine"), (mm(30), mm(22), mm(16))
        )
    ],
    ids=lambda defect: f"{defect.entry}-{defect.edge}-{1e3 * defect.length:.0f} mm",
)
FINE_ANGLES = np.linspace(0, 2 * math.pi, 200001)


def steepest_slope(pump: Pump, defect: SwashPlateDefect, height: np.ndarray) -> float:
    """Slope of a quarter sine of this height over the rise [m/rad]."""
    return math.pi / 2 * height.max() / stages(pump, defect).rise


@EACH_SHAPE
def test_displacement_is_continuous(pump: Pump, defect: SwashPlateDefect) -> None:
    height, _ = slipper_profile(pump, defect, FINE_ANGLES)
    max_step = FINE_ANGLES[1] * steepest_slope(pump, defect, height)
    assert np.abs(np.diff(height)).max() <= 1.01 * max_step


@EACH_SHAPE
def test_only_a_raised_cosine_has_no_velocity_jump(pump: Pump, defect: SwashPlateDefect) -> None:
    height, slope = slipper_profile(pump, defect, FINE_ANGLES)
    steepest = steepest_slope(pump, defect, height)
    jump = np.abs(np.diff(slope)).max()
    if defect.edge == "half_sine":
        assert jump > 0.9 * steepest
    else:
        assert jump < 1e-3 * steepest


@EACH_SHAPE
def test_the_slope_is_the_derivative_of_the_displacement(
    pump: Pump, defect: SwashPlateDefect
) -> None:
    height, slope = slipper_profile(pump, defect, FINE_ANGLES)
    steepest = steepest_slope(pump, defect, height)
    difference_quotient = np.diff(height) / FINE_ANGLES[1]
    mean_slope = 0.5 * (slope[1:] + slope[:-1])
    # a difference over a velocity jump has no derivative to be compared with
    is_smooth = np.abs(np.diff(slope)) < 0.5 * steepest
    np.testing.assert_allclose(
        difference_quotient[is_smooth], mean_slope[is_smooth], atol=2e-4 * steepest
    )


@ENTRIES
@EDGES
@pytest.mark.parametrize("length", [mm(30), mm(16)])
@pytest.mark.parametrize(
    "scatter",
    [None, (1.1, 1.0, 1.0, 0.9, 1.0, 1.05, 1.0)],
    ids=["equal slippers", "unequal slippers"],
)
def test_displacement_lines_are_the_transform_of_the_displacement(
    pump: Pump,
    at_15: OperatingCondition,
    entry: Entry,
    edge: Edge,
    length: float,
    scatter: tuple[float, ...] | None,
) -> None:
    defect = replace(DEFECT, entry=entry, edge=edge, length=length, angle=deg(250))
    weights = np.ones(7) if scatter is None else np.array(scatter)

    def height(angle: np.ndarray) -> np.ndarray:
        return weights @ slipper_displacements(pump, at_15, defect, angle / at_15.speed)

    lines = displacement_lines(pump, at_15, defect, 300, scatter=scatter)

    np.testing.assert_allclose(lines, sampled_lines(height, 300), atol=2e-13)
    assert np.abs(lines).max() > 1e-6  # far above the tolerance


def test_equal_slippers_have_the_reference_lines_at_multiples_of_their_count(
    pump: Pump, at_15: OperatingCondition
) -> None:
    lines = np.abs(displacement_lines(pump, at_15, DEFECT, 70))
    amplitudes = lines[[6, 13, 20, 27]]
    reference = [um(44.3), um(0.0156), um(20.5), um(13.2)]
    np.testing.assert_allclose(amplitudes, reference, rtol=4e-3)

    off_multiples = np.arange(1, 71) % 7 != 0
    assert np.all(lines[off_multiples] == 0)


def test_a_slipper_that_differs_adds_the_reference_line_at_the_shaft_frequency(
    pump: Pump, at_15: OperatingCondition
) -> None:
    first_differs = (1.1, *[1.0] * 6)
    lines = np.abs(displacement_lines(pump, at_15, DEFECT, 70, scatter=first_differs))
    amplitudes = lines[[0, 1, 6, 20]]
    np.testing.assert_allclose(amplitudes, [um(15.6), um(14), um(44.9), um(20.8)], rtol=4e-3)


# the whole turn, as its ends meet, is the limit
@pytest.mark.parametrize("half_width", [5, 25, 180])
@pytest.mark.parametrize("bore", [0, 3])
def test_bore_lines_are_the_transform_of_the_displacement(
    pump: Pump, at_15: OperatingCondition, half_width: float, bore: int
) -> None:
    defect = BoreDefect(um(50), half_width=deg(half_width), bore=bore)

    def height(angle: np.ndarray) -> np.ndarray:
        piston = angle + 2 * math.pi * bore / 7
        from_center = np.mod(piston - deg(270) + math.pi, 2 * math.pi) - math.pi
        cap = np.cos(math.pi * from_center / (2 * deg(half_width)))
        return um(50) * cap * (np.abs(from_center) < deg(half_width))

    lines = bore_lines(pump, defect, 200)
    np.testing.assert_allclose(lines, sampled_lines(height, 200), atol=1e-13)


def test_a_worn_valve_plate_softens_its_film(pump: Pump) -> None:
    # the wear doubles the film of 10 um: stiffness falls as 1/h, damping as 1/h^3
    worn = interface_factors(ValvePlateWear(um(10)), pump).block_valve
    assert (worn.stiffness, worn.damping) == pytest.approx((0.5, 0.125))

    softer = interface_factors(ValvePlateWear(um(10), stiffness_exponent=2.0), pump).block_valve
    assert softer.stiffness == pytest.approx(0.25)


@pytest.mark.parametrize(
    "fault",
    [None, DamScratch(1e-6), ValvePlateWear(0.0)],
    ids=["healthy", "dam scratch", "no wear"],
)
def test_without_wear_the_interfaces_are_unchanged(pump: Pump, fault: Fault | None) -> None:
    assert interface_factors(fault, pump).values() == (1.0,) * 6


def test_a_recess_as_long_as_the_track_of_the_slippers_is_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    long_recess = replace(DEFECT, length=mm(150), entry="edge")
    message = r"length \(150 mm\) fills the slippers' whole track of 163.4 mm"
    with pytest.raises(InputError, match=message):
        displacement_lines(pump, at_15, long_recess, 7)


@pytest.mark.parametrize(
    ("defect", "message"),
    [
        (BoreDefect(um(50), bore=7), r"BoreDefect.bore \(7\) must be 0 to 6"),
        (BoreDefect(um(50), half_width=deg(200)), r"half_width \(200 deg\) must not exceed 180"),
    ],
    ids=["bore that the pump lacks", "wider than a turn"],
)
def test_a_bore_defect_that_does_not_fit_the_pump_is_refused(
    pump: Pump, defect: BoreDefect, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        bore_lines(pump, defect, 7)


def test_scatter_needs_one_value_for_each_slipper(pump: Pump, at_15: OperatingCondition) -> None:
    with pytest.raises(InputError, match=r"shape \(3,\) of scatter: give one value for each of 7"):
        displacement_lines(pump, at_15, DEFECT, 7, scatter=(1.0, 1.0, 1.0))


def test_a_number_of_lines_that_is_not_positive_is_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    with pytest.raises(InputError, match=r"n_lines \(0\)"):
        displacement_lines(pump, at_15, DEFECT, 0)


@pytest.mark.parametrize("contact", ["shared", "lift_off"])
def test_half_of_a_recess_is_followed_at_its_corner_frequency(
    at_15: OperatingCondition, contact: Literal["shared", "lift_off"]
) -> None:
    corner = 28 * at_15.shaft_frequency
    frequency = np.array([1e-9, corner])
    unlimited = followed_share(replace(DEFECT, contact=contact, corner=0.0), frequency)
    limited = followed_share(replace(DEFECT, contact=contact, corner=corner), frequency)

    np.testing.assert_allclose(limited, [1, 0.5])
    assert unlimited[1] > 0.98


def test_a_corner_frequency_halves_its_displacement_line(
    pump: Pump, at_15: OperatingCondition
) -> None:
    corner = 28 * at_15.shaft_frequency
    unlimited = displacement_lines(pump, at_15, replace(DEFECT, corner=0.0), 28)
    limited = displacement_lines(pump, at_15, replace(DEFECT, corner=corner), 28)
    assert limited[-1] == pytest.approx(unlimited[-1] / 2)
