"""Fault excitations against the paper's piecewise displacement, physics.md, and transforms of fine
samples.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from swashtwin.foundation import InputError, deg, mm, rpm, um
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
    OperatingCondition,
    Pump,
    SwashPlateDefect,
    ValvePlateWear,
)

DEFECT = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
PAPERS_SPEED = rpm(860)
ENTRIES = ("center", "edge")
EDGES = ("half_sine", "raised_cosine")


def sampled_lines(
    function: Callable[[np.ndarray], np.ndarray], n_lines: int, points: int = 2**18
) -> np.ndarray:
    """Lines of a function of the shaft angle from the trapezoidal rule on many points."""
    angle = 2 * math.pi * np.arange(points) / points
    return np.fft.rfft(function(angle))[1 : n_lines + 1] * 2 / points


def of_radius(pump: Pump, radius: float) -> Pump:
    return replace(pump, rotating_group=replace(pump.rotating_group, pitch_radius=mm(radius)))


@pytest.mark.parametrize(
    ("entry", "radius", "times", "overlap", "in_defect", "total"),
    [
        ("center", 26, (4.70, 3.42, 12.81), 2.85, (1, 2), (0.49, 0.57, 0.60)),
        ("center", 31, (3.94, 2.87, 10.75), 0.78, (1, 2), (0.18, 0.47, 0.60)),
        ("center", 35, (3.49, 2.54, 9.52), -0.45, (0, 1), (0.00, 0.42, 0.60)),
        ("edge", 26, (9.40, 3.42, 22.21), 12.24, (2, 3), (0.82, 0.93, 1.02)),
        ("edge", 35, (6.98, 2.54, 16.50), 6.53, (1, 2), (0.60, 0.69, 0.80)),
    ],
)
def test_the_stages_are_those_tabulated(
    pump: Pump,
    at_15: OperatingCondition,
    entry: Literal["center", "edge"],
    radius: float,
    times: tuple[float, float, float],
    overlap: float,
    in_defect: tuple[int, int],
    total: tuple[float, float, float],
) -> None:
    pump, defect = of_radius(pump, radius), replace(DEFECT, entry=entry)
    stage = stages(pump, defect)
    milliseconds = [1e3 * turned / at_15.speed for turned in (stage.rise, stage.dwell, stage.total)]
    np.testing.assert_allclose(milliseconds, times, atol=0.006)
    assert milliseconds[2] - 1e3 * at_15.period / 7 == pytest.approx(overlap, abs=0.01)
    heights = slipper_displacements(pump, at_15, defect, np.linspace(0, at_15.period, 20001)[:-1])
    count = (heights > 0).sum(axis=0)
    assert (count.min(), count.max()) == in_defect
    summed = 1e3 * heights.sum(axis=0)
    np.testing.assert_allclose([summed.min(), summed.mean(), summed.max()], total, atol=0.006)


def test_the_first_slipper_follows_the_papers_formula(
    pump: Pump, at_15: OperatingCondition
) -> None:
    speed = at_15.speed * mm(26)
    first, second, third = mm(11) / speed, mm(19) / speed, mm(30) / speed
    start = (DEFECT.angle - mm(15) / mm(26)) / at_15.speed
    since = np.array(
        [-1e-4, 0.0, 0.3 * first, first, 0.5 * (first + second), second + 1e-4, third, third + 1e-4]
    )
    expected = mm(0.6) * np.array(
        [
            0,
            0,
            math.sin(0.15 * math.pi),
            1,
            1,
            math.sin(math.pi / 2 * (third - second - 1e-4) / (third - second)),
            0,
            0,
        ]
    )
    heights = slipper_displacements(pump, at_15, DEFECT, start + since)[0]
    np.testing.assert_allclose(heights, expected, atol=1e-12)


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("length", [mm(30), mm(22), mm(16)])
def test_displacement_is_continuous_and_a_raised_cosine_has_no_velocity_jump(
    pump: Pump,
    entry: Literal["center", "edge"],
    edge: Literal["half_sine", "raised_cosine"],
    length: float,
) -> None:
    defect = replace(DEFECT, entry=entry, edge=edge, length=length)
    angle = np.linspace(0, 2 * math.pi, 200001)
    height, slope = slipper_profile(pump, defect, angle)
    spacing = angle[1]
    bound = math.pi / 2 * height.max() / stages(pump, defect).rise
    assert np.abs(np.diff(height)).max() <= 1.01 * spacing * bound
    jump = np.abs(np.diff(slope)).max()
    assert jump > 0.9 * bound if edge == "half_sine" else jump < 1e-3 * bound
    smooth = np.abs(np.diff(slope)) < 0.5 * bound
    np.testing.assert_allclose(
        np.diff(height)[smooth] / spacing,
        (0.5 * (slope[1:] + slope[:-1]))[smooth],
        atol=2e-4 * bound,
    )


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("length", [mm(30), mm(16)])
@pytest.mark.parametrize("scatter", [None, (1.1, 1.0, 1.0, 0.9, 1.0, 1.05, 1.0)])
def test_displacement_lines_are_the_transform_of_the_displacement(
    pump: Pump,
    at_15: OperatingCondition,
    entry: Literal["center", "edge"],
    edge: Literal["half_sine", "raised_cosine"],
    length: float,
    scatter: tuple[float, ...] | None,
) -> None:
    defect = replace(DEFECT, entry=entry, edge=edge, length=length, angle=deg(250))
    weights = np.ones(7) if scatter is None else np.array(scatter)

    def height(angle: np.ndarray) -> np.ndarray:
        return weights @ slipper_displacements(pump, at_15, defect, angle / at_15.speed)

    lines = displacement_lines(pump, at_15, defect, 300, scatter=scatter)
    np.testing.assert_allclose(lines, sampled_lines(height, 300), atol=2e-13)
    assert np.abs(lines).max() > 1e-6


def test_displacement_lines_have_the_reference_amplitudes(
    pump: Pump, at_15: OperatingCondition
) -> None:
    lines = np.abs(displacement_lines(pump, at_15, DEFECT, 70))
    np.testing.assert_allclose(
        lines[[6, 13, 20, 27]], [um(44.3), um(0.0156), um(20.5), um(13.2)], rtol=4e-3
    )
    assert np.all(lines[np.arange(1, 71) % 7 != 0] == 0)
    deeper = np.abs(displacement_lines(pump, at_15, DEFECT, 70, scatter=(1.1, *[1.0] * 6)))
    np.testing.assert_allclose(
        deeper[[0, 1, 6, 20]], [um(15.6), um(14), um(44.9), um(20.8)], rtol=4e-3
    )


@pytest.mark.parametrize("half_width", [5, 25, 180])
@pytest.mark.parametrize("bore", [0, 3])
def test_bore_lines_are_the_transform_of_the_displacement(
    pump: Pump, at_15: OperatingCondition, half_width: float, bore: int
) -> None:
    defect = BoreDefect(um(50), half_width=deg(half_width), bore=bore)

    def height(angle: np.ndarray) -> np.ndarray:
        offset = np.mod(angle + 2 * math.pi * bore / 7 - deg(270) + math.pi, 2 * math.pi) - math.pi
        return (
            um(50)
            * np.cos(math.pi * offset / (2 * deg(half_width)))
            * (np.abs(offset) < deg(half_width))
        )

    np.testing.assert_allclose(
        bore_lines(pump, defect, 200), sampled_lines(height, 200), atol=1e-13
    )


def test_a_worn_valve_plate_softens_its_film(pump: Pump) -> None:
    worn = interface_factors(ValvePlateWear(um(10)), pump)
    assert (worn.block_valve.stiffness, worn.block_valve.damping) == pytest.approx((0.5, 0.125))
    softer = interface_factors(ValvePlateWear(um(10), stiffness_exponent=2.0), pump)
    assert softer.block_valve.stiffness == pytest.approx(0.25)
    for fault in (None, DamScratch(1e-6), ValvePlateWear(0.0)):
        assert interface_factors(fault, pump).values() == (1.0,) * 6


def test_excitation_that_does_not_fit_the_pump_is_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    with pytest.raises(
        InputError, match=r"length \(150 mm\) fills the slippers' whole track of 163.4 mm"
    ):
        displacement_lines(pump, at_15, replace(DEFECT, length=mm(150), entry="edge"), 7)
    with pytest.raises(InputError, match=r"shape \(3,\) of scatter: give one value for each of 7"):
        displacement_lines(pump, at_15, DEFECT, 7, scatter=(1.0, 1.0, 1.0))
    with pytest.raises(InputError, match=r"BoreDefect.bore \(7\) must be 0 to 6"):
        bore_lines(pump, BoreDefect(um(50), bore=7), 7)
    with pytest.raises(InputError, match=r"half_width \(200 deg\) must not exceed 180"):
        bore_lines(pump, BoreDefect(um(50), half_width=deg(200)), 7)
    with pytest.raises(InputError, match=r"n_lines \(0\)"):
        displacement_lines(pump, at_15, DEFECT, 0)


@pytest.mark.parametrize("contact", ["shared", "lift_off"])
def test_half_of_a_recess_is_followed_at_its_corner(
    pump: Pump, at_15: OperatingCondition, contact: Literal["shared", "lift_off"]
) -> None:
    corner = 28 * at_15.shaft_frequency
    own, limited = (
        followed_share(replace(DEFECT, contact=contact, corner=value), np.array([1e-9, corner]))
        for value in (0.0, corner)
    )
    np.testing.assert_allclose(limited, [1, 0.5])
    assert own[1] > 0.98
    lines = [
        displacement_lines(pump, at_15, replace(DEFECT, corner=value), 28)
        for value in (0.0, corner)
    ]
    assert lines[1][-1] == pytest.approx(lines[0][-1] / 2)
