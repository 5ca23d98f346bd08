"""Chamber pressures and their forces: the numbers of physics.md, and invariants of any pump."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy.integrate
from rigid_body import rigid_motions

from swashtwin.foundation import InputError, MPa, celsius, deg, mm, rpm, um
from swashtwin.physics import LoadCase, force_lines
from swashtwin.physics.dynamics import Dof
from swashtwin.physics.films import (
    piston_leakage,
    slipper_leakage,
    valve_plate_leakage,
)
from swashtwin.physics.loads import (
    DEFAULT_STEPS,
    chamber_pressures,
    force_and_moments,
    port_openings,
    pressure_shares,
)
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

RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="physical")


class Reference(NamedTuple):
    """Numbers of the independent implementation behind physics.md for one fault.

    They are extrapolated to steps of no length.
    """

    fault: Fault | None
    mean_mpa: float
    """Mean of the outlet pressure [MPa]."""
    ripple_mpa: float
    """Peak-to-peak value of the outlet pressure [MPa]."""
    forces: tuple[float, ...]
    """Amplitudes of the piston force [N] at the multiples of f_s in `REFERENCE_ORDERS`."""


FINE_STEPS = 14336
"""Steps of a revolution with which the solver's own error is far below that of the references."""

REFERENCE_ORDERS = np.array([1, 7, 14, 21, 28, 35, 70])
REFERENCES = (
    Reference(None, 15.004, 0.146, (0, 1886, 734.8, 152.2, 341.2, 120.0, 38.32)),
    Reference(RECESS, 14.850, 0.155, (0, 1869, 729.0, 145.3, 339.6, 120.0, 38.61)),
    Reference(PistonWear(um(25)), 14.996, 0.166, (22.84, 1872, 740.7, 139.4, 334.3, 123.2, 39.15)),
    Reference(PistonWear(um(60)), 14.944, 0.295, (105.4, 1812, 741.8, 119.7, 301.8, 116.7, 36.53)),
    Reference(
        SealingLandScratch(6e-13), 14.993, 0.171, (40.65, 1862, 743.5, 132.1, 328.4, 124.1, 38.71)
    ),
    Reference(
        SealingLandScratch(2.5e-12), 14.957, 0.249, (109.2, 1815, 741.4, 121.8, 302.0, 115.4, 35.80)
    ),
    Reference(ValvePlateWear(um(12)), 14.963, 0.148, (0, 1793, 782.0, 78.6, 296.6, 142.8, 43.58)),
    Reference(DamScratch(1e-6), 14.983, 0.184, (0, 2113, 567.4, 268.2, 319.9, 163.6, 8.74)),
    Reference(GrooveErosion(deg(6)), 15.003, 0.158, (0, 1945, 713.7, 252.3, 435.8, 108.7, 34.16)),
)


def fault_name(fault: Fault | None) -> str:
    return "healthy" if fault is None else type(fault).__name__


EACH_REFERENCE = pytest.mark.parametrize(
    "reference", REFERENCES, ids=lambda reference: fault_name(reference.fault)
)
FAULTS_OF_ONE_PISTON = (PistonWear, SealingLandScratch)


def pressure_lines(case: LoadCase, n_lines: int, **arguments: Any) -> np.ndarray:
    """Lines without the mean: entry k - 1 for order k."""
    return force_lines(case, n_lines, **arguments)[1:]


@pytest.fixture(scope="module")
def reference_forces(pump: Pump, at_15: OperatingCondition) -> dict[Reference, np.ndarray]:
    """Lines 1 to 100 of the piston force, which the retainer takes."""
    return {
        reference: pressure_lines(LoadCase(pump, at_15, reference.fault), 100, steps=FINE_STEPS)[
            :, Dof.RETAINER_Z
        ]
        for reference in REFERENCES
    }


def test_the_mean_piston_force_is_the_reference(pump: Pump, at_15: OperatingCondition) -> None:
    pressures = chamber_pressures(LoadCase(pump, at_15), steps=FINE_STEPS)
    force = pump.rotating_group.piston_area * (pressures.chamber - at_15.case_pressure).sum(axis=0)
    assert force.mean() == pytest.approx(11388, abs=1)


def test_the_range_of_the_chamber_pressure_is_the_reference(
    pump: Pump, at_15: OperatingCondition
) -> None:
    chamber = chamber_pressures(LoadCase(pump, at_15), steps=FINE_STEPS).chamber
    assert chamber.max() == pytest.approx(MPa(15.28), rel=1e-3)
    assert chamber.min() == pytest.approx(MPa(0.0914), rel=1e-2)


@EACH_REFERENCE
def test_each_fault_changes_the_lines_of_the_piston_force_as_in_the_reference(
    reference_forces: dict[Reference, np.ndarray], reference: Reference
) -> None:
    amplitudes = np.abs(reference_forces[reference][REFERENCE_ORDERS - 1])
    # Three digits are given, and a zero is exact. The scratch leaves little of the last line.
    np.testing.assert_allclose(amplitudes, reference.forces, rtol=0.002, atol=0.06)


@EACH_REFERENCE
def test_each_fault_changes_the_outlet_pressure_as_in_the_reference(
    pump: Pump, at_15: OperatingCondition, reference: Reference
) -> None:
    case = LoadCase(pump, at_15, reference.fault)
    discharge = chamber_pressures(case, steps=FINE_STEPS).discharge
    assert discharge.mean() == pytest.approx(MPa(reference.mean_mpa), abs=MPa(0.001))
    assert np.ptp(discharge) == pytest.approx(MPa(reference.ripple_mpa), abs=MPa(0.001))


@pytest.mark.parametrize(
    "reference",
    [each for each in REFERENCES if not isinstance(each.fault, FAULTS_OF_ONE_PISTON)],
    ids=lambda reference: fault_name(reference.fault),
)
def test_equal_pistons_have_no_line_off_multiples_of_the_piston_frequency(
    reference_forces: dict[Reference, np.ndarray], reference: Reference
) -> None:
    off_multiples = np.arange(1, 101) % 7 != 0
    assert np.abs(reference_forces[reference][off_multiples]).max() < 1e-5


def test_one_piston_with_a_larger_clearance_adds_a_line_at_the_shaft_frequency(
    pump: Pump, at_15: OperatingCondition
) -> None:
    clearances = (um(12) + um(25), *[um(12)] * 6)
    scattered = pressure_lines(LoadCase(pump, at_15, piston_clearances=clearances), 10)
    assert abs(scattered[0, Dof.RETAINER_Z]) == pytest.approx(22.84, rel=0.01)

    # wear by as much is the same case
    worn = pressure_lines(LoadCase(pump, at_15, PistonWear(um(25))), 10)
    np.testing.assert_allclose(scattered, worn, rtol=1e-9, atol=1e-9)


def test_wear_of_another_piston_is_the_same_load_at_another_angle(
    pump: Pump, at_15: OperatingCondition
) -> None:
    first_worn = pressure_lines(LoadCase(pump, at_15, PistonWear(um(60), piston=0)), 50)
    third_worn = pressure_lines(LoadCase(pump, at_15, PistonWear(um(60), piston=2)), 50)

    two_pitches = np.exp(2j * math.pi * np.arange(1, 51) * 2 / 7)
    turned = first_worn[:, Dof.RETAINER_Z] * two_pitches
    np.testing.assert_allclose(third_worn[:, Dof.RETAINER_Z], turned, atol=1e-4)


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
    ids=fault_name,
)
def test_a_fault_that_loads_no_chamber_leaves_the_pressures_healthy(
    pump: Pump, at_15: OperatingCondition, fault: Fault
) -> None:
    healthy = chamber_pressures(LoadCase(pump, at_15), steps=224)
    faulty = chamber_pressures(LoadCase(pump, at_15, fault), steps=224)
    np.testing.assert_allclose(faulty.chamber, healthy.chamber, rtol=1e-9)


@pytest.mark.parametrize("pressure_mpa", [5, 10, 15])
@pytest.mark.parametrize(
    "fault", [None, PistonWear(um(60)), ValvePlateWear(um(12))], ids=fault_name
)
def test_pressures_repeat_after_two_revolutions(
    pump: Pump, pressure_mpa: float, fault: Fault | None
) -> None:
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(pressure_mpa))
    case = LoadCase(pump, condition, fault)

    second = chamber_pressures(case, steps=448, revolutions=2)
    third = chamber_pressures(case, steps=448, revolutions=3)

    np.testing.assert_allclose(second.chamber, third.chamber, rtol=1e-6, atol=100)
    assert second.discharge.mean() == pytest.approx(MPa(pressure_mpa), rel=0.01)


def test_halving_the_step_quarters_the_error(pump: Pump, at_15: OperatingCondition) -> None:
    case = LoadCase(pump, at_15)

    def force(steps: int) -> np.ndarray:
        return pressure_lines(case, 35, steps=steps)[:, Dof.RETAINER_Z]

    fine = force(2 * FINE_STEPS)
    coarse_error = np.linalg.norm(force(DEFAULT_STEPS) - fine)
    half_step_error = np.linalg.norm(force(2 * DEFAULT_STEPS) - fine)
    # BDF2 is of the second order.
    assert coarse_error / half_step_error == pytest.approx(4.0, abs=0.4)


@EACH_REFERENCE
def test_the_default_steps_miss_the_limit_by_less_than_one_percent_of_the_lines(
    pump: Pump,
    at_15: OperatingCondition,
    reference_forces: dict[Reference, np.ndarray],
    reference: Reference,
) -> None:
    lines = pressure_lines(LoadCase(pump, at_15, reference.fault), 35)[:, Dof.RETAINER_Z]
    piston_pass = np.arange(7, 36, 7) - 1
    fine = reference_forces[reference][piston_pass]
    error = np.abs(lines[piston_pass] - fine).sum() / np.abs(fine).sum()

    # A port that a fault opens suddenly takes more steps than the usual ones.
    is_sudden = isinstance(reference.fault, (DamScratch, GrooveErosion))
    assert error < (0.009 if is_sudden else 0.003)


def chamber_rates(pump: Pump, condition: OperatingCondition, theta: float, state: Any) -> Any:
    """Return the rates [Pa/rad] of the chambers' and the outlet's pressures.

    Written down from physics.md, section 5, apart from the solver.
    """
    group = pump.rotating_group
    oil = pump.oil
    chamber, outlet = state[:-1], state[-1]
    angle = theta + 2 * math.pi * np.arange(group.piston_count) / group.piston_count
    viscosity = oil.viscosity_at(condition.oil_temperature)

    withdrawn = group.pitch_radius * math.tan(group.swash_angle) * (1 - np.cos(angle))
    volume = group.dead_volume + group.piston_area * withdrawn
    growth = group.piston_area * group.pitch_radius * math.tan(group.swash_angle) * np.sin(angle)
    leakage = (
        group.piston_clearance**3
        * piston_leakage(pump, viscosity)
        / (group.piston_guide_length - withdrawn)
    )
    leakage = leakage + slipper_leakage(pump, group.slipper_film, viscosity)
    leakage = leakage + valve_plate_leakage(pump, pump.valve_plate.film, viscosity)

    def flow(area: np.ndarray, difference: np.ndarray) -> np.ndarray:
        jet = oil.discharge_coefficient * math.sqrt(2 / oil.density)
        return jet * area * difference / np.sqrt(np.abs(difference) + 2e4)

    suction_area, discharge_area = port_openings(pump, None, angle)
    inward = flow(suction_area, condition.suction_pressure - chamber)
    outward = flow(discharge_area, chamber - outlet)
    gained = inward - outward - leakage * (chamber - condition.case_pressure)
    air = oil.air_fraction * 1e5 / np.maximum(chamber, 5e4) ** 2
    stiffness = 1 / (1 / oil.bulk_modulus + air)
    chamber_rate = stiffness / volume * (gained / condition.speed - growth)

    full_flow = group.displacement * condition.shaft_frequency
    opening = (outlet - condition.discharge_pressure) / pump.line.relief_override + 0.95
    line_flow = outward.sum() - full_flow * max(opening, 0.0)
    line_rate = oil.bulk_modulus / pump.line.volume * line_flow / condition.speed
    return np.append(chamber_rate, line_rate)


@pytest.mark.nightly
def test_a_stiff_solver_gives_the_same_lines(pump: Pump, at_15: OperatingCondition) -> None:
    pressures = chamber_pressures(LoadCase(pump, at_15))
    pitch = 2 * math.pi / 7
    steps_per_pitch = DEFAULT_STEPS // 7
    start = np.append(pressures.chamber[:, -1], pressures.discharge[-1])

    solution = scipy.integrate.solve_ivp(
        lambda theta, state: chamber_rates(pump, at_15, theta, state),
        (0.0, 2 * pitch),
        start,
        method="Radau",
        # The second pitch, on the grid of the march.
        t_eval=pitch * (1 + np.arange(1, steps_per_pitch + 1) / steps_per_pitch),
        rtol=1e-6,
        atol=1.0,
        max_step=math.radians(0.5),  # the relief grooves begin at once
    )

    def lines(chamber: np.ndarray) -> np.ndarray:
        force = pump.rotating_group.piston_area * chamber.sum(axis=0)
        return np.asarray(2 * np.fft.rfft(force)[1:6] / force.size)

    exact = lines(solution.y[:-1])
    error = np.abs(lines(pressures.chamber[:, :steps_per_pitch]) - exact).sum()
    assert error < 0.005 * np.abs(exact).sum()


@pytest.mark.parametrize("speed", [300, 3000])
@pytest.mark.parametrize("temperature", [0, 90])
@EACH_REFERENCE
def test_every_fault_converges_far_from_the_papers_condition(
    pump: Pump, speed: int, temperature: int, reference: Reference
) -> None:
    condition = OperatingCondition(
        speed=rpm(speed),
        discharge_pressure=MPa(15),
        suction_pressure=0.05e6,
        oil_temperature=celsius(temperature),
    )
    chamber = chamber_pressures(LoadCase(pump, condition, reference.fault), steps=448).chamber
    assert np.isfinite(chamber).all()
    assert chamber.min() >= 1e3


def test_the_pump_delivers_its_displacement_less_its_leakage(
    pump: Pump, at_15: OperatingCondition
) -> None:
    def flow(case: LoadCase) -> float:
        return chamber_pressures(case, steps=896).flow

    cold = flow(LoadCase(pump, at_15))
    displaced = pump.rotating_group.displacement * at_15.shaft_frequency
    assert 0.9 < cold / displaced < 1

    # thin oil and a worn plate leak more
    at_60_celsius = at_15.replace(oil_temperature=celsius(60))
    assert flow(LoadCase(pump, at_60_celsius)) < cold
    assert flow(LoadCase(pump, at_15, ValvePlateWear(um(12)))) < cold


def test_ports_open_at_their_angles_and_grooves_before_them(pump: Pump) -> None:
    area = 0.55 * pump.rotating_group.piston_area
    # physics.md 5: suction is open from 10 to 178 degrees, discharge from 194 to 358
    angle = np.radians([0.9, 5, 10, 35, 100, 178.5, 186, 194, 250, 358.5])
    suction, discharge = port_openings(pump, None, angle)

    assert suction[0] == 0
    assert 0 < suction[1] < suction[2] < 0.02 * area
    np.testing.assert_allclose(suction[3:5], area)
    np.testing.assert_array_equal(suction[5:], 0)

    assert discharge[6] > 0
    assert discharge[8] == pytest.approx(area)
    np.testing.assert_array_equal(discharge[[0, 1, 2, 3, 4, 5, 9]], 0)


def test_an_eroded_groove_opens_the_discharge_earlier(pump: Pump) -> None:
    _, discharge = port_openings(pump, GrooveErosion(deg(6)), np.radians([181.0]))
    assert discharge[0] > 0


def test_the_pressure_load_does_no_work_on_rigid_motions(pump: Pump) -> None:
    # any forces do: five sets of seven, up to that of a piston at 15 MPa
    force = np.random.default_rng(0).uniform(0, 3400, (7, 5))
    angle = 1.1 + 2 * math.pi * np.arange(7)[:, None] / 7 + np.zeros(5)

    moments = force_and_moments(pump, force, np.cos(angle), np.sin(angle))
    loads = moments.T @ pressure_shares(pump).T

    assert np.abs(loads).max() > 1000
    np.testing.assert_allclose(loads @ rigid_motions(pump), 0, atol=1e-9)


def test_unbalance_turns_with_the_shaft(pump: Pump, at_15: OperatingCondition) -> None:
    balanced_pump = replace(pump, masses=replace(pump.masses, rotor_eccentricity=0.0))
    unbalanced = pressure_lines(LoadCase(pump, at_15), 2, steps=224)
    balanced = pressure_lines(LoadCase(balanced_pump, at_15), 2, steps=224)

    unbalance = unbalanced - balanced

    force = 4.6 * 20e-6 * at_15.speed**2  # m_C e omega^2
    assert unbalance[0, Dof.ROTOR_X] == pytest.approx(force)
    assert unbalance[0, Dof.ROTOR_Y] == pytest.approx(-1j * force)
    assert np.count_nonzero(np.abs(unbalance) > 1e-12) == 2


def test_with_topology_t2_the_rotor_takes_the_piston_force(
    pump: Pump, at_15: OperatingCondition
) -> None:
    case = LoadCase(pump, at_15)
    series = pressure_lines(case, 14, topology="T1", steps=224)
    direct = pressure_lines(case, 14, topology="T2", steps=224)

    piston_force = series[..., Dof.RETAINER_Z]
    np.testing.assert_allclose(direct[..., Dof.ROTOR_Z], series[..., Dof.ROTOR_Z] + piston_force)
    np.testing.assert_array_equal(direct[..., Dof.RETAINER_Z], 0)

    axial = [Dof.ROTOR_Z, Dof.RETAINER_Z]
    np.testing.assert_array_equal(
        np.delete(direct, axial, axis=-1), np.delete(series, axial, axis=-1)
    )


def test_a_pump_of_nine_pistons_has_lines_at_nine_times_the_shaft_frequency(
    pump: Pump, at_15: OperatingCondition
) -> None:
    nine_pistons = replace(pump.rotating_group, piston_count=9, piston_diameter=mm(15))
    case = LoadCase(replace(pump, rotating_group=nine_pistons), at_15)
    # the next multiple of nine, so that each piston has the same steps
    assert chamber_pressures(case, steps=448).angle.size == 450

    force = np.abs(pressure_lines(case, 60, steps=896)[:, Dof.RETAINER_Z])
    off_multiples = np.arange(1, 61) % 9 != 0
    assert force[off_multiples].max() < 1e-5
    assert force[8] > 100


def test_a_pump_that_leaks_more_than_it_displaces_is_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    slow = at_15.replace(speed=rpm(60), oil_temperature=celsius(90))
    message = r"25scy14-1b, 60 rev/min, 15 MPa, .*leaks all it displaces"
    with pytest.raises(InputError, match=message):
        chamber_pressures(LoadCase(pump, slow), steps=224)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fault": PistonWear(um(25), piston=7)}, "PistonWear.piston .7. must be 0 to 6"),
        ({"fault": SealingLandScratch(1e-12, bore=9)}, "SealingLandScratch.bore .9."),
        ({"piston_clearances": (um(12),) * 5}, "5 values for 7 pistons"),
    ],
    ids=["eighth piston", "tenth bore", "five clearances"],
)
def test_a_case_that_does_not_fit_its_pump_is_refused(
    pump: Pump, at_15: OperatingCondition, arguments: dict, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        LoadCase(pump, at_15, **arguments)
