"""Where a linear twin leaves its range: the forces of its slippers' films, and what it says of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.foundation import mm
from swashtwin.physics import HarmonicBalance, Twin, assemble
from swashtwin.physics.excitation import slipper_profile
from swashtwin.physics.twin.contact_check import distance_rows, slipper_lines
from swashtwin.physics.twin.response import motion_of
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect

RECESS = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))


@pytest.mark.parametrize("edge", ["half_sine", "raised_cosine"])
def test_a_recess_displaces_a_slipper_by_the_lines_of_its_profile(
    pump: Pump, at_15: OperatingCondition, edge: str
) -> None:
    defect = replace(RECESS, edge=edge, contact="literal", gain=0.5)
    height = 3.5 * slipper_profile(pump, defect, 2 * math.pi * np.arange(4096) / 4096)[0]
    lines = np.fft.rfft(height)[:21] / 2048
    lines[0] /= 2
    np.testing.assert_allclose(slipper_lines(pump, at_15, defect, 20), lines, atol=1e-5 * abs(lines[0]))


@pytest.mark.parametrize("topology", ["T1", "T2"])
def test_slipper_distances_add_up_to_the_interface_of_the_linear_model(pump: Pump, topology: str) -> None:
    rows, around = distance_rows(pump, topology), 2 * math.pi * np.arange(7) / 7
    each = np.stack([np.ones(7), np.cos(around), np.sin(around)], axis=1)[:, : len(rows)] @ rows
    np.testing.assert_allclose(each.T @ each / 7, assemble(pump, topology).interface_shapes[0].numpy(), atol=1e-12)


def test_the_slippers_carry_what_presses_the_pistons_and_the_spring(pump: Pump, at_15: OperatingCondition) -> None:
    """Equilibrium of retainer and slippers: N cos(gamma) = sum f + preload; over a recess as well."""
    twin = Twin(pump, at_15)
    pressed = -float(twin.pressure[0, 12].real)
    expected = (pressed + pump.coupling.spring_preload) / np.cos(pump.rotating_group.swash_angle)
    for fault in (None, RECESS, replace(RECESS, depth=mm(0.07))):
        assert twin.with_fault(fault).contact_check().hold_down == pytest.approx(expected, rel=0.02)


def test_slipper_forces_are_what_the_films_exert_on_the_retainer(pump: Pump, at_15: OperatingCondition) -> None:
    """F = -(K_sw + i w C_sw) (g0 . X) at each order of a healthy pump, whose films are strained by its motion alone."""
    twin = Twin(pump, at_15, bandwidth=1000)
    lines = np.fft.rfft(twin.slipper_forces().sum(axis=0))[twin.orders] / 2048
    scales = torch.ones(1, 11, dtype=torch.float64)
    motion, frequency = motion_of(twin.drive, twin.values[None], scales, HarmonicBalance())
    film = twin.values[1] + 1j * frequency * twin.values[0]
    exerted = -film * (motion[0] @ twin.structure.slipper_vector.to(motion.dtype))
    np.testing.assert_allclose(lines, exerted.numpy(), atol=1e-9 * float(exerted.abs().max()))


def test_a_twin_says_where_it_pulls_at_its_slippers(pump: Pump, at_15: OperatingCondition) -> None:
    healthy, recess = Twin(pump, at_15), Twin(pump, at_15, RECESS)
    assert healthy.contact_check().within_range
    assert healthy.contact_check().sentence().endswith("within the linear model's range")
    assert healthy.notes() == ()
    check = recess.contact_check()
    assert check.lowest == pytest.approx(-53e3, rel=0.02)  # C_sw / 7 times 0.2 m/s
    assert check.pulling > 0.9
    (note,) = recess.notes()
    assert "the linear twin pulls at its slippers during 94% of the revolution" in note
    assert Twin(pump, at_15, replace(RECESS, contact="lift_off")).notes() == ()
