"""The matrices against physics.md: reference entries, invariants, and the 13 equations written out
one by one.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from rigid_body import rigid_motions

from swashtwin.physics import assemble
from swashtwin.physics.dynamics import (
    block_valve_shape,
    displacement_rows,
    off_axis_vector,
    piston_bore_shape,
    slipper_swash_shape,
)
from swashtwin.pump import Pump


@pytest.fixture
def matrices(pump: Pump) -> tuple[np.ndarray, np.ndarray]:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    return structure.stiffness(values).numpy(), structure.damping(values).numpy()


def test_the_nominal_stiffness_has_the_reference_entries(
    matrices: tuple[np.ndarray, np.ndarray],
) -> None:
    stiffness, damping = matrices
    entries = {
        (2, 2): 4.21646e8,
        (3, 3): 5.64753e6,
        (6, 6): 6.5e8,
        (7, 7): 1.8005e8,
        (8, 8): 2.30371e6,
    }
    entries |= {(11, 11): 5.83539e7, (12, 12): 1.41696e8, (1, 2): -2.76696e7}
    for index, value in entries.items():
        assert stiffness[index] == pytest.approx(value, rel=2e-6)
    assert np.trace(stiffness) == pytest.approx(3.5759724e9, rel=1e-8)
    assert np.trace(damping) == pytest.approx(4086761.2, rel=1e-7)


@pytest.mark.parametrize("topology", ["T1", "T2"])
def test_interfaces_and_bearings_answer_no_rigid_motion(pump: Pump, topology: str) -> None:
    structure = assemble(pump, topology)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    floating = structure.stiffness(values, mount=0.0).numpy()
    assert np.abs(floating @ rigid_motions(pump)).max() < 1e-15 * np.abs(floating).max() * 10


@pytest.mark.parametrize("angle", [0.1, 0.37, 0.9, 2.0])
def test_interface_matrices_do_not_depend_on_the_shaft_angle(pump: Pump, angle: float) -> None:
    for topology in ("T1", "T2"):
        at_zero, turned = (
            slipper_swash_shape(pump, topology)[0],
            slipper_swash_shape(pump, topology, angle)[0],
        )
        np.testing.assert_allclose(turned, at_zero, atol=1e-15)
    np.testing.assert_allclose(piston_bore_shape(pump, angle), piston_bore_shape(pump), atol=1e-15)


def test_discrete_rings_sum_to_the_closed_forms(pump: Pump) -> None:
    radius, n = pump.valve_plate.film_radius, 24
    ring = np.zeros((13, 13))
    for angle in 2 * np.pi * np.arange(n) / n:
        point = np.array(
            [radius * np.sin(angle), radius * np.cos(angle), pump.positions.valve_plate]
        )
        row = displacement_rows(pump, "C", point)[2] - displacement_rows(pump, "F", point)[2]
        ring += np.outer(row, row) / n
    np.testing.assert_allclose(block_valve_shape(pump), ring, atol=1e-15)


def scalar_right_hand_side(
    pump: Pump, q: np.ndarray, v: np.ndarray, load: np.ndarray, depth: float, rate: float
) -> np.ndarray:
    """The 13 scalar equations behind the matrices of physics.md 2.3, before dividing by mass."""
    x_f, y_f, z_f, a_f, b_f, x_c, y_c, z_c, a_c, b_c, x_p, y_p, z_p = range(13)
    mount, masses, positions, joints = pump.mount, pump.masses, pump.positions, pump.interfaces
    zeta_f, zeta_c = positions.shell, positions.rotor
    arm = positions.mount - zeta_f
    total = masses.shell + masses.rotor + masses.retainer
    inertia = masses.shell_inertia + masses.shell * arm**2

    def element(stiffness: float, damping: float, *terms: tuple[int, float]) -> float:
        return sum(stiffness * w * q[i] + damping * w * v[i] for i, w in terms)

    def modal(stiffness: float, mass: float) -> float:
        return 2 * mount.damping_ratio * math.sqrt(stiffness * mass)

    mx = element(mount.stiffness_x, modal(mount.stiffness_x, total), (x_f, 1), (b_f, arm))
    my = element(mount.stiffness_y, modal(mount.stiffness_y, total), (y_f, 1), (a_f, -arm))
    mz = element(mount.stiffness_z, modal(mount.stiffness_z, total), (z_f, 1))
    ma = element(mount.stiffness_tilt, modal(mount.stiffness_tilt, inertia), (a_f, 1))
    mb = element(mount.stiffness_tilt, modal(mount.stiffness_tilt, inertia), (b_f, 1))
    sums = np.zeros(6)
    for position, k in zip(pump.bearings.positions, pump.bearings.stiffnesses, strict=True):
        c, ci, fi = pump.bearings.damping_time * k, position - zeta_c, position - zeta_f
        fx = element(k, c, (x_c, 1), (b_c, ci), (x_f, -1), (b_f, -fi))
        fy = element(k, c, (y_c, 1), (a_c, -ci), (y_f, -1), (a_f, fi))
        sums += np.array([fx, fy, fi * fx, fi * fy, ci * fx, ci * fy])
    k_ba = pump.bearings.axial_stiffness
    axial = element(k_ba, pump.bearings.damping_time * k_ba, (z_c, 1), (z_f, -1))
    k_v, c_v = joints.block_valve.stiffness, joints.block_valve.damping
    k_h, c_h = joints.piston_bore.stiffness, joints.piston_bore.damping
    film = element(k_v, c_v, (z_c, 1), (z_f, -1))
    rv, r = pump.valve_plate.film_radius**2 / 2, pump.rotating_group.pitch_radius**2 / 2
    ta = element(rv * k_v + r * k_h, rv * c_v + r * c_h, (a_c, 1), (a_f, -1))
    tb = element(rv * k_v + r * k_h, rv * c_v + r * c_h, (b_c, 1), (b_f, -1))
    bore = element(k_h + pump.coupling.spring_stiffness, c_h, (z_p, 1), (z_c, -1))
    side_x = element(k_h, c_h, (x_p, 1), (x_c, -1), (b_c, zeta_c))
    side_y = element(k_h, c_h, (y_p, 1), (y_c, -1), (a_c, -zeta_c))
    sine, cosine = (
        math.sin(pump.rotating_group.swash_angle),
        math.cos(pump.rotating_group.swash_angle),
    )
    k_s, c_s = joints.slipper_swash.stiffness, joints.slipper_swash.damping
    approach = ((y_p, -sine), (y_f, sine), (z_p, cosine), (z_f, -cosine), (a_f, zeta_f * sine))
    normal = (
        element(k_s, c_s, *approach) + (k_s * depth + c_s * rate) / pump.rotating_group.piston_count
    )
    return load + np.array(
        [
            -mx + sums[0],
            -my + sums[1] - sine * normal,
            -mz + film + axial + cosine * normal,
            -ma + arm * my - sums[3] + ta - zeta_f * sine * normal,
            -mb - arm * mx + sums[2] + tb,
            -sums[0] + side_x,
            -sums[1] + side_y,
            -film - axial + bore,
            sums[5] - ta + zeta_c * side_y,
            -sums[4] - tb - zeta_c * side_x,
            -side_x,
            -side_y + sine * normal,
            -bore - cosine * normal,
        ]
    )


def test_the_thirteen_scalar_equations_are_the_matrix_form(
    pump: Pump, matrices: tuple[np.ndarray, np.ndarray]
) -> None:
    rng = np.random.default_rng(0)
    q, v, load = rng.normal(size=13) * 1e-6, rng.normal(size=13) * 1e-3, rng.normal(size=13) * 10
    depth, rate = 6e-4, 0.1
    stiffness, damping = matrices
    joint = pump.interfaces.slipper_swash
    push = (joint.stiffness * depth + joint.damping * rate) / pump.rotating_group.piston_count
    expected = load - stiffness @ q - damping @ v - push * assemble(pump).slipper_vector.numpy()
    written_out = scalar_right_hand_side(pump, q, v, load, depth, rate)
    assert np.abs(written_out - expected).max() < 1e-13 * np.abs(expected).max()


def test_the_off_axis_force_does_no_work_on_rigid_motions(pump: Pump) -> None:
    for topology in ("T1", "T2"):
        work = off_axis_vector(pump, topology, math.radians(200)) @ rigid_motions(pump)
        assert np.abs(work).max() < 1e-15


def test_a_factor_on_one_direction_or_bearing_is_that_of_the_pump_file(pump: Pump) -> None:
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    factors = torch.tensor([1.2, 0.8, 1.1, 0.9, 1.3, 0.7, 1.0], dtype=torch.float64)
    x, y, z, tilt, first, second, _ = factors.tolist()
    mount, bearings = pump.mount, pump.bearings
    changed = replace(
        pump,
        mount=replace(
            mount,
            stiffness_x=x * mount.stiffness_x,
            stiffness_y=y * mount.stiffness_y,
            stiffness_z=z * mount.stiffness_z,
            stiffness_tilt=tilt * mount.stiffness_tilt,
        ),
        bearings=replace(
            bearings,
            stiffnesses=(
                first * bearings.stiffnesses[0],
                second * bearings.stiffnesses[1],
                bearings.stiffnesses[2],
            ),
        ),
    )
    scaled = assemble(pump).stiffness(values, parts=factors)
    torch.testing.assert_close(scaled, assemble(changed).stiffness(values), rtol=1e-12, atol=1e-6)
    assert torch.equal(
        assemble(pump).stiffness(values, parts=torch.ones(7)), assemble(pump).stiffness(values)
    )
