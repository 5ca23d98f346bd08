"""M, C and K against physics.md: reference entries, invariants, and the 13 equations written out."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from rigid_body import rigid_motions

from swashtwin.physics import assemble
from swashtwin.physics.dynamics import (
    N_DOF,
    Dof,
    block_valve_shape,
    displacement_rows,
    off_axis_vector,
    piston_bore_shape,
    slipper_swash_shape,
)
from swashtwin.pump import Pump

TOPOLOGIES = ("T1", "T2")


@pytest.fixture
def matrices(pump: Pump) -> tuple[np.ndarray, np.ndarray]:
    """Nominal K [N/m] and C [N s/m]."""
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    return structure.stiffness(values).numpy(), structure.damping(values).numpy()


# From the independent implementation behind physics.md, given to 6 digits.
@pytest.mark.parametrize(
    ("row", "column", "entry"),
    [
        (Dof.SHELL_Z, Dof.SHELL_Z, 4.21646e8),
        (Dof.SHELL_TILT_X, Dof.SHELL_TILT_X, 5.64753e6),
        (Dof.ROTOR_Y, Dof.ROTOR_Y, 6.5e8),
        (Dof.ROTOR_Z, Dof.ROTOR_Z, 1.8005e8),
        (Dof.ROTOR_TILT_X, Dof.ROTOR_TILT_X, 2.30371e6),
        (Dof.RETAINER_Y, Dof.RETAINER_Y, 5.83539e7),
        (Dof.RETAINER_Z, Dof.RETAINER_Z, 1.41696e8),
        (Dof.SHELL_Y, Dof.SHELL_Z, -2.76696e7),
    ],
    ids=lambda parameter: parameter.name if isinstance(parameter, Dof) else None,
)
def test_entries_of_the_nominal_stiffness_are_those_of_the_reference(
    matrices: tuple[np.ndarray, np.ndarray], row: Dof, column: Dof, entry: float
) -> None:
    stiffness, _ = matrices
    assert stiffness[row, column] == pytest.approx(entry, rel=2e-6)


def test_traces_of_the_nominal_matrices_are_those_of_the_reference(
    matrices: tuple[np.ndarray, np.ndarray],
) -> None:
    stiffness, damping = matrices
    assert np.trace(stiffness) == pytest.approx(3.5759724e9, rel=1e-8)
    assert np.trace(damping) == pytest.approx(4086761.2, rel=1e-7)


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_interfaces_and_bearings_do_not_react_to_rigid_motions(pump: Pump, topology: str) -> None:
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    # only the mounting, here removed, may hold the pump as a whole
    floating = assemble(pump, topology).stiffness(values, mount=0.0).numpy()

    reaction = floating @ rigid_motions(pump)

    assert np.abs(reaction).max() < 1e-15 * np.abs(floating).max() * 10


SHAFT_ANGLES = pytest.mark.parametrize("angle", [0.1, 0.37, 0.9, 2.0])


@SHAFT_ANGLES
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_the_slippers_matrix_does_not_depend_on_the_shaft_angle(
    pump: Pump, topology: str, angle: float
) -> None:
    at_zero, _ = slipper_swash_shape(pump, topology)
    turned, _ = slipper_swash_shape(pump, topology, angle)
    np.testing.assert_allclose(turned, at_zero, atol=1e-15)


@SHAFT_ANGLES
def test_the_pistons_matrix_does_not_depend_on_the_shaft_angle(pump: Pump, angle: float) -> None:
    np.testing.assert_allclose(piston_bore_shape(pump, angle), piston_bore_shape(pump), atol=1e-15)


def test_a_ring_of_discrete_springs_is_the_film_of_the_valve_plate(pump: Pump) -> None:
    radius = pump.valve_plate.film_radius
    n = 24

    ring = np.zeros((N_DOF, N_DOF))
    for angle in 2 * np.pi * np.arange(n) / n:
        x = radius * np.sin(angle)
        y = radius * np.cos(angle)
        point = np.array([x, y, pump.positions.valve_plate])
        axial_rotor = displacement_rows(pump, "C", point)[2]
        axial_shell = displacement_rows(pump, "F", point)[2]
        approach = axial_rotor - axial_shell
        ring += np.outer(approach, approach) / n

    np.testing.assert_allclose(block_valve_shape(pump), ring, atol=1e-15)


def scalar_right_hand_side(
    pump: Pump, q: np.ndarray, v: np.ndarray, load: np.ndarray, depth: float, rate: float
) -> np.ndarray:
    """The 13 scalar equations behind the matrices of physics.md 2.3, before dividing by mass.

    Symbols are those of physics.md: F shell, C rotor, P retainer; a and b rotations about x and y.
    """
    x_f, y_f, z_f, a_f, b_f, x_c, y_c, z_c, a_c, b_c, x_p, y_p, z_p = range(13)
    mount = pump.mount
    masses = pump.masses
    bearings = pump.bearings
    group = pump.rotating_group
    zeta_f = pump.positions.shell
    zeta_c = pump.positions.rotor

    def element(stiffness: float, damping: float, *terms: tuple[int, float]) -> float:
        """Force of a spring and a damper on a sum of weighted coordinates."""
        return sum(stiffness * w * q[i] + damping * w * v[i] for i, w in terms)

    # mounting, with modal damping
    arm = pump.positions.mount - zeta_f
    total = masses.shell + masses.rotor + masses.retainer
    inertia = masses.shell_inertia + masses.shell * arm**2

    def mounting(stiffness: float, mass: float, *terms: tuple[int, float]) -> float:
        damping = 2 * mount.damping_ratio * math.sqrt(stiffness * mass)
        return element(stiffness, damping, *terms)

    mx = mounting(mount.stiffness_x, total, (x_f, 1), (b_f, arm))
    my = mounting(mount.stiffness_y, total, (y_f, 1), (a_f, -arm))
    mz = mounting(mount.stiffness_z, total, (z_f, 1))
    ma = mounting(mount.stiffness_tilt, inertia, (a_f, 1))
    mb = mounting(mount.stiffness_tilt, inertia, (b_f, 1))

    # bearings: sums of the radial forces, and of their moments on shell and rotor
    bearing_x = bearing_y = 0.0
    shell_moment_x = shell_moment_y = 0.0
    rotor_moment_x = rotor_moment_y = 0.0
    for position, k in zip(bearings.positions, bearings.stiffnesses, strict=True):
        c = bearings.damping_time * k
        c_i = position - zeta_c
        f_i = position - zeta_f
        fx = element(k, c, (x_c, 1), (b_c, c_i), (x_f, -1), (b_f, -f_i))
        fy = element(k, c, (y_c, 1), (a_c, -c_i), (y_f, -1), (a_f, f_i))
        bearing_x += fx
        bearing_y += fy
        shell_moment_x += f_i * fx
        shell_moment_y += f_i * fy
        rotor_moment_x += c_i * fx
        rotor_moment_y += c_i * fy
    k_ba = bearings.axial_stiffness
    axial = element(k_ba, bearings.damping_time * k_ba, (z_c, 1), (z_f, -1))

    # valve plate film, pistons in their bores, and central spring
    k_v = pump.interfaces.block_valve.stiffness
    c_v = pump.interfaces.block_valve.damping
    k_h = pump.interfaces.piston_bore.stiffness
    c_h = pump.interfaces.piston_bore.damping
    rv = pump.valve_plate.film_radius**2 / 2
    r = group.pitch_radius**2 / 2
    film = element(k_v, c_v, (z_c, 1), (z_f, -1))
    ta = element(rv * k_v + r * k_h, rv * c_v + r * c_h, (a_c, 1), (a_f, -1))
    tb = element(rv * k_v + r * k_h, rv * c_v + r * c_h, (b_c, 1), (b_f, -1))
    bore = element(k_h + pump.coupling.spring_stiffness, c_h, (z_p, 1), (z_c, -1))
    side_x = element(k_h, c_h, (x_p, 1), (x_c, -1), (b_c, zeta_c))
    side_y = element(k_h, c_h, (y_p, 1), (y_c, -1), (a_c, -zeta_c))

    # slippers on the swash plate; one of n carries the defect
    sine = math.sin(group.swash_angle)
    cosine = math.cos(group.swash_angle)
    k_s = pump.interfaces.slipper_swash.stiffness
    c_s = pump.interfaces.slipper_swash.damping
    approach = ((y_p, -sine), (y_f, sine), (z_p, cosine), (z_f, -cosine), (a_f, zeta_f * sine))
    defect = (k_s * depth + c_s * rate) / group.piston_count
    normal = element(k_s, c_s, *approach) + defect

    return load + np.array(
        [
            -mx + bearing_x,
            -my + bearing_y - sine * normal,
            -mz + film + axial + cosine * normal,
            -ma + arm * my - shell_moment_y + ta - zeta_f * sine * normal,
            -mb - arm * mx + shell_moment_x + tb,
            -bearing_x + side_x,
            -bearing_y + side_y,
            -film - axial + bore,
            rotor_moment_y - ta + zeta_c * side_y,
            -rotor_moment_x - tb - zeta_c * side_x,
            -side_x,
            -side_y + sine * normal,
            -bore - cosine * normal,
        ]
    )


def test_the_thirteen_scalar_equations_are_the_matrix_form(
    pump: Pump, matrices: tuple[np.ndarray, np.ndarray]
) -> None:
    stiffness, damping = matrices
    # motions, velocities and loads of the sizes of a running pump, so that no term hides another
    rng = np.random.default_rng(0)
    q = rng.normal(size=13) * 1e-6
    v = rng.normal(size=13) * 1e-3
    load = rng.normal(size=13) * 10
    depth = 6e-4
    rate = 0.1

    joint = pump.interfaces.slipper_swash
    push = (joint.stiffness * depth + joint.damping * rate) / pump.rotating_group.piston_count
    defect_force = push * assemble(pump).slipper_vector.numpy()
    expected = load - stiffness @ q - damping @ v - defect_force

    written_out = scalar_right_hand_side(pump, q, v, load, depth, rate)
    assert np.abs(written_out - expected).max() < 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_the_off_axis_force_does_no_work_on_rigid_motions(pump: Pump, topology: str) -> None:
    work = off_axis_vector(pump, topology, math.radians(200)) @ rigid_motions(pump)
    assert np.abs(work).max() < 1e-15


def test_factors_on_supports_are_the_same_factors_in_the_pump_file(pump: Pump) -> None:
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    factors = torch.tensor([1.2, 0.8, 1.1, 0.9, 1.3, 0.7, 1.0], dtype=torch.float64)
    x, y, z, tilt, first, second, _ = factors.tolist()

    mount = replace(
        pump.mount,
        stiffness_x=x * pump.mount.stiffness_x,
        stiffness_y=y * pump.mount.stiffness_y,
        stiffness_z=z * pump.mount.stiffness_z,
        stiffness_tilt=tilt * pump.mount.stiffness_tilt,
    )
    k_1, k_2, k_3 = pump.bearings.stiffnesses
    bearings = replace(pump.bearings, stiffnesses=(first * k_1, second * k_2, k_3))
    structure = assemble(pump)
    changed = assemble(replace(pump, mount=mount, bearings=bearings))

    torch.testing.assert_close(
        structure.stiffness(values, parts=factors), changed.stiffness(values), rtol=1e-12, atol=1e-6
    )
    # the pump file specifies a damping ratio and a damping time, not dampings
    torch.testing.assert_close(
        structure.damping(values, parts=factors), changed.damping(values), rtol=1e-12, atol=1e-9
    )


def test_the_damping_follows_a_factor_on_the_whole_mounting(pump: Pump) -> None:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    ones = torch.ones(7, dtype=torch.float64)
    batch = torch.tensor([1.0, 4.0], dtype=torch.float64)

    damping = structure.damping(values.expand(2, 6), batch, 1.0, ones)

    assert torch.equal(damping[0], structure.damping(values))
    added = structure.damping_parts[:4].sum(dim=0)
    torch.testing.assert_close(damping[1] - damping[0], added, rtol=1e-12, atol=1e-9)


def test_support_factors_of_one_change_no_bit(pump: Pump) -> None:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    ones = torch.ones(7)
    assert torch.equal(structure.stiffness(values, parts=ones), structure.stiffness(values))
    assert torch.equal(structure.damping(values, parts=ones), structure.damping(values))
