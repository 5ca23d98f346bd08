"""One revolution of a twin: pressures, contact forces and waveform are those of the simulation."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import deg, mm, um
from swashtwin.physics import LoadCase, OneTurn, Twin, chamber_pressures, solve_turn
from swashtwin.physics.lost_contact import pressing_force
from swashtwin.pump import (
    BoreDefect,
    Fault,
    LooseSlipper,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
)

Solver = Callable[[Fault | None], OneTurn]


@pytest.fixture(scope="module")
def turn_of(pump: Pump, at_15: OperatingCondition) -> Solver:
    """Returns one turn of the pump with a fault."""

    def solve(fault: Fault | None) -> OneTurn:
        return solve_turn(Twin(pump, at_15, fault, bandwidth=1000.0))

    return solve


def test_chambers_are_those_of_the_simulation_at_the_same_shaft_angle(
    turn_of: Solver, pump: Pump, at_15: OperatingCondition
) -> None:
    turn = turn_of(None)
    pressures = chamber_pressures(LoadCase(pump, at_15))
    angle = 2 * math.pi * np.arange(turn.chamber.shape[1]) / turn.chamber.shape[1]
    nearest = np.searchsorted(pressures.angle, angle - 1e-9)

    step = np.abs(np.diff(pressures.chamber, axis=1)).max()
    assert np.abs(turn.chamber - pressures.chamber[:, nearest]).max() <= step


def test_healthy_slippers_are_pressed_on_by_their_chambers(
    turn_of: Solver, pump: Pump, at_15: OperatingCondition
) -> None:
    turn = turn_of(None)
    angle = 2 * math.pi * np.arange(turn.contact.shape[1]) / turn.contact.shape[1]
    expected = pressing_force(pump, at_15, angle) / math.cos(pump.rotating_group.swash_angle)

    assert turn.contact[0] == pytest.approx(expected)
    assert not turn.displacement.any()


def test_the_waveform_is_that_of_the_simulated_recording(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, bandwidth=1000.0)
    acceleration = solve_turn(twin).acceleration
    points = acceleration.shape[1]

    recording = twin.simulate(at_15.period, points / at_15.period)

    assert recording.signal[:, :points] == pytest.approx(acceleration, abs=1e-9)


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(LooseSlipper(clearance=mm(0.2), slipper=2), id="loose slipper"),
        pytest.param(BoreDefect(depth=um(150), bore=2), id="damaged bore"),
    ],
)
def test_only_the_part_of_the_faulty_piston_is_displaced(turn_of: Solver, fault: Fault) -> None:
    displacement = turn_of(fault).displacement
    assert np.flatnonzero(displacement.any(axis=1)).tolist() == [2]


def test_a_loose_piston_leaves_its_slipper_and_returns(turn_of: Solver) -> None:
    fault = LooseSlipper(clearance=mm(0.2), slipper=2)
    turn = turn_of(fault)
    is_loose = turn.displacement[2] > 0.1 * fault.clearance

    assert 0.1 < is_loose.mean() < 0.9
    assert turn.contact[2][is_loose].mean() < 0.2 * turn.contact[0].max()
    assert turn.displacement[2].max() == pytest.approx(fault.clearance, rel=0.1)


def test_slippers_are_relieved_at_the_edges_of_a_recess_and_sink_into_it(
    turn_of: Solver, pump: Pump
) -> None:
    recess = SwashPlateDefect(depth=mm(0.6), contact="lift_off", angle=deg(270))
    turn = turn_of(recess)
    half = math.degrees(recess.length / pump.rotating_group.pitch_radius / 2)
    shaft_angle = np.arange(turn.contact.shape[1]) * 360 / turn.contact.shape[1]

    for piston, contact in enumerate(turn.contact):
        angle = (shaft_angle + 360 * piston / len(turn.contact)) % 360
        # between the ports' ends
        loaded = np.flatnonzero(np.abs(angle - 270) < 50)
        relieved = angle[loaded[np.argmin(contact[loaded])]]
        assert abs(abs(relieved - 270) - half) < 2
        middle = int(np.argmin(np.abs(angle - 270)))
        assert turn.displacement[piston, middle] == pytest.approx(mm(0.6), rel=0.05)


def test_only_the_worn_piston_loses_pressure(turn_of: Solver) -> None:
    healthy = turn_of(None)
    worn = turn_of(replace(PistonWear(clearance=um(60)), piston=3))
    # from bottom dead center on its chamber is closed until the discharge port opens
    loss = (healthy.chamber - worn.chamber).max(axis=1)
    assert int(np.argmax(loss)) == 3
