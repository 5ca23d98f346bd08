"""Chamber pressures and their forces against the numbers in physics.md and against what must hold
for any pump.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa, celsius, deg, mm, rpm, um
from swashtwin.physics import LoadCase, force_lines
from swashtwin.physics.loads import chamber_pressures, generalized_forces, port_openings
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    OperatingCondition,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)


def pressure_lines(case: LoadCase, n_lines: int, **choices: Any) -> np.ndarray:
    """Lines 1... alone, entry k - 1 for order k."""
    return force_lines(case, n_lines, **choices)[1:]


RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="physical")

REFERENCE: tuple[tuple[Fault | None, float, float, tuple[float, ...]], ...] = (
    (None, 15.00, 0.146, (0, 1880, 748, 140, 344, 130, 39.6)),
    (RECESS, 14.85, 0.153, (0, 1860, 742, 133, 342, 130, 39.9)),
    (PistonWear(um(25)), 15.00, 0.162, (23.4, 1860, 753, 128, 337, 133, 40.4)),
    (PistonWear(um(60)), 14.95, 0.265, (106, 1810, 754, 113, 305, 125, 37.2)),
    (SealingLandScratch(6e-13), 14.99, 0.171, (40.5, 1850, 756, 121, 331, 134, 40)),
    (SealingLandScratch(2.5e-12), 14.96, 0.248, (109, 1810, 753, 114, 305, 125, 36.9)),
    (ValvePlateWear(um(12)), 14.96, 0.147, (0, 1780, 793, 74.4, 298, 151, 45)),
    (DamScratch(1e-6), 14.98, 0.186, (0, 2120, 544, 294, 310, 150, 12.8)),
    (GrooveErosion(deg(6)), 15.00, 0.162, (0, 1940, 730, 233, 437, 125, 39.7)),
)
"""Fault; mean and peak-to-peak of the outlet pressure [MPa]; amplitudes of the piston force at 1, 7
... 70 f_s [N].
"""

ORDERS = (1, 7, 14, 21, 28, 35, 70)


@pytest.fixture(scope="module")
def cases(pump: Pump, at_15: OperatingCondition) -> list[LoadCase]:
    return [LoadCase(pump, at_15, fault) for fault, *_ in REFERENCE]


@pytest.fixture(scope="module")
def lines(cases: list[LoadCase]) -> np.ndarray:
    return np.stack([pressure_lines(case, 100) for case in cases])


def test_the_mean_piston_force_is_the_reference(pump: Pump, at_15: OperatingCondition) -> None:
    pressures = chamber_pressures(LoadCase(pump, at_15))
    force = pump.rotating_group.piston_area * (pressures.chamber - at_15.case_pressure).sum(axis=0)
    assert force.mean() == pytest.approx(11378, abs=1)
    assert pressures.chamber.max() == pytest.approx(MPa(15.28), rel=1e-3)
    assert pressures.chamber.min() == pytest.approx(MPa(0.091), rel=1e-2)


@pytest.mark.parametrize("row", range(len(REFERENCE)))
def test_each_fault_weights_the_lines_as_the_reference(lines: np.ndarray, row: int) -> None:
    amplitudes = np.abs(lines[row, [order - 1 for order in ORDERS], 12])
    np.testing.assert_allclose(amplitudes, REFERENCE[row][3], rtol=0.006, atol=1e-4)


def test_each_fault_changes_the_outlet_pressure_as_the_reference(cases: list[LoadCase]) -> None:
    for case, (_, mean, ripple, _) in zip(cases, REFERENCE, strict=True):
        discharge = chamber_pressures(case).discharge
        assert discharge.mean() == pytest.approx(MPa(mean), abs=MPa(0.006))
        assert np.ptp(discharge) == pytest.approx(MPa(ripple), abs=MPa(0.0015))


def test_equal_pistons_leave_no_line_off_the_piston_frequency(lines: np.ndarray) -> None:
    off = np.arange(1, 101) % 7 != 0
    for row, (fault, *_) in enumerate(REFERENCE):
        if not isinstance(fault, PistonWear | SealingLandScratch):
            assert np.abs(lines[row, off, 12]).max() < 1e-5


def test_one_piston_of_another_clearance_brings_a_line_at_the_shaft_frequency(
    pump: Pump, at_15: OperatingCondition
) -> None:
    clearances = (um(12) + um(25), *[um(12)] * 6)
    scattered = pressure_lines(LoadCase(pump, at_15, piston_clearances=clearances), 10)
    worn = pressure_lines(LoadCase(pump, at_15, PistonWear(um(25))), 10)
    assert abs(scattered[0, 12]) == pytest.approx(23.4, rel=0.01)
    np.testing.assert_allclose(scattered, worn, rtol=1e-9, atol=1e-9)


def test_wear_of_another_piston_is_the_same_load_at_another_angle(
    pump: Pump, at_15: OperatingCondition
) -> None:
    first, third = (
        pressure_lines(LoadCase(pump, at_15, PistonWear(um(60), piston=k)), 50) for k in (0, 2)
    )
    turned = first[:, 12] * np.exp(2j * math.pi * np.arange(1, 51) * 2 / 7)
    np.testing.assert_allclose(third[:, 12], turned, atol=1e-4)


@pytest.mark.parametrize(
    "fault",
    [
        PistonWear(0.0),
        SealingLandScratch(0.0),
        ValvePlateWear(0.0),
        DamScratch(0.0),
        GrooveErosion(0.0, area_factor=1.0),
        replace(RECESS, depth=0.0),
        replace(RECESS, contact="shared"),
        replace(RECESS, contact="literal"),
        BoreDefect(um(300)),
        TiltedBlockFace(0.2),
        LooseSlipper(mm(0.2)),
    ],
    ids=lambda fault: type(fault).__name__,
)
def test_a_fault_that_loads_no_chamber_leaves_the_pressures_healthy(
    pump: Pump, at_15: OperatingCondition, fault: Fault
) -> None:
    sound, faulty = (
        chamber_pressures(LoadCase(pump, at_15, each), steps=224).chamber for each in (None, fault)
    )
    np.testing.assert_allclose(faulty, sound, rtol=1e-9)


@pytest.mark.parametrize("level", [5, 10, 15])
@pytest.mark.parametrize("fault", [None, PistonWear(um(60)), ValvePlateWear(um(12))])
def test_pressures_repeat_after_two_revolutions(
    pump: Pump, level: float, fault: Fault | None
) -> None:
    case = LoadCase(pump, OperatingCondition(speed=rpm(860), discharge_pressure=MPa(level)), fault)
    second, third = (chamber_pressures(case, steps=448, revolutions=count) for count in (2, 3))
    np.testing.assert_allclose(second.chamber, third.chamber, rtol=1e-6, atol=100)
    assert second.discharge.mean() == pytest.approx(MPa(level), rel=0.01)


def test_halving_the_step_halves_the_error(pump: Pump, at_15: OperatingCondition) -> None:
    case = LoadCase(pump, at_15)
    fine = pressure_lines(case, 35, steps=7168)[:, 12]
    errors = [
        np.linalg.norm(pressure_lines(case, 35, steps=steps)[:, 12] - fine) for steps in (448, 896)
    ]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.4)


@pytest.mark.parametrize("speed", [300, 3000])
@pytest.mark.parametrize("temperature", [0, 90])
def test_every_fault_converges_far_from_the_papers_condition(
    pump: Pump, speed: int, temperature: int
) -> None:
    condition = OperatingCondition(
        speed=rpm(speed),
        discharge_pressure=MPa(15),
        suction_pressure=0.05e6,
        oil_temperature=celsius(temperature),
    )
    for fault, *_ in REFERENCE:
        chamber = chamber_pressures(LoadCase(pump, condition, fault), steps=448).chamber
        assert np.isfinite(chamber).all()
        assert chamber.min() >= 1e3


def test_the_pump_delivers_its_displacement_less_its_leakage(
    pump: Pump, at_15: OperatingCondition
) -> None:
    hot = at_15.replace(oil_temperature=celsius(60))
    batch = [
        LoadCase(pump, at_15),
        LoadCase(pump, hot),
        LoadCase(pump, at_15, ValvePlateWear(um(12))),
    ]
    cold, warm, worn = (chamber_pressures(case, steps=896).flow for case in batch)
    assert 0.9 < cold / (pump.rotating_group.displacement * at_15.shaft_frequency) < 1
    assert warm < cold
    assert worn < cold


def test_ports_open_at_their_angles_and_grooves_before_them(pump: Pump) -> None:
    angle = np.radians([0.9, 5, 10, 35, 100, 178.5, 186, 194, 250, 358.5])
    suction, discharge = port_openings(pump, None, angle)
    area = 0.55 * pump.rotating_group.piston_area
    assert suction[0] == 0
    assert 0 < suction[1] < suction[2] < 0.02 * area
    np.testing.assert_allclose(suction[3:5], area)
    np.testing.assert_array_equal(suction[5:], 0)
    assert discharge[6] > 0
    assert discharge[8] == pytest.approx(area)
    np.testing.assert_array_equal(discharge[[0, 1, 2, 3, 4, 5, 9]], 0)
    assert port_openings(pump, GrooveErosion(deg(6)), np.radians([181.0]))[1][0] > 0


def test_the_pressure_load_does_no_work_on_rigid_motions(pump: Pump) -> None:
    motions = np.zeros((13, 5))
    for axis in range(3):
        motions[[axis, 5 + axis, 10 + axis], axis] = 1
    for body, height in ((0, pump.positions.shell), (5, pump.positions.rotor), (10, 0.0)):
        motions[body + 1, 3], motions[body, 4] = -height, height
    motions[[3, 8], 3] = motions[[4, 9], 4] = 1
    generator = np.random.default_rng(0)
    force = generator.uniform(0, 3400, (7, 5))
    loads = generalized_forces(
        pump, force, 1.1 + 2 * math.pi * np.arange(7)[:, None] / 7 + np.zeros(5)
    )
    assert np.abs(loads).max() > 1000
    np.testing.assert_allclose(loads @ motions, 0, atol=1e-9)


def test_unbalance_turns_with_the_shaft(pump: Pump, at_15: OperatingCondition) -> None:
    balanced = replace(pump, masses=replace(pump.masses, rotor_eccentricity=0.0))
    unbalanced, without = (
        pressure_lines(LoadCase(each, at_15), 2, steps=224) for each in (pump, balanced)
    )
    unbalance = unbalanced - without
    force = 4.6 * 20e-6 * at_15.speed**2
    assert unbalance[0, 5] == pytest.approx(force)
    assert unbalance[0, 6] == pytest.approx(-1j * force)
    assert np.count_nonzero(np.abs(unbalance) > 1e-12) == 2


def test_with_topology_t2_the_rotor_takes_the_piston_force(
    pump: Pump, at_15: OperatingCondition
) -> None:
    case = LoadCase(pump, at_15)
    series, direct = (pressure_lines(case, 14, topology=name, steps=224) for name in ("T1", "T2"))
    np.testing.assert_allclose(direct[..., 7], series[..., 7] + series[..., 12])
    np.testing.assert_array_equal(direct[..., 12], 0)
    np.testing.assert_array_equal(
        np.delete(direct, [7, 12], axis=-1), np.delete(series, [7, 12], axis=-1)
    )


def test_a_pump_of_nine_pistons_has_lines_at_nine_times_the_shaft_frequency(
    pump: Pump, at_15: OperatingCondition
) -> None:
    nine = replace(
        pump, rotating_group=replace(pump.rotating_group, piston_count=9, piston_diameter=mm(15))
    )
    case = LoadCase(nine, at_15)
    assert chamber_pressures(case, steps=448).angle.size == 450
    force = np.abs(pressure_lines(case, 60, steps=448)[:, 12])
    assert force[np.arange(1, 61) % 9 != 0].max() < 1e-5 < 100 < force[8]


def test_a_pump_that_leaks_more_than_it_displaces_is_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    slow = at_15.replace(speed=rpm(60), oil_temperature=celsius(90))
    with pytest.raises(
        InputError, match=r"25scy14-1b, 60 rev/min, 15 MPa, .*leaks all it displaces"
    ):
        chamber_pressures(LoadCase(pump, slow), steps=224)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fault": PistonWear(um(25), piston=7)}, "PistonWear.piston .7. must be 0 to 6"),
        ({"fault": SealingLandScratch(1e-12, bore=9)}, "SealingLandScratch.bore .9."),
        ({"piston_clearances": (um(12),) * 5}, "5 values for 7 pistons"),
    ],
)
def test_a_case_that_does_not_fit_its_pump_is_refused(
    pump: Pump, at_15: OperatingCondition, arguments: dict, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        LoadCase(pump, at_15, **arguments)
