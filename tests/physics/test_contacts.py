"""Slippers that differ or lift off: against the linear solvers, their own refinement, and finite differences."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg
import torch
from torch import Tensor

from swashtwin.foundation import InputError, SwashTwinError, mm, um
from swashtwin.physics import (
    ContactCheck,
    HarmonicBalance,
    LoadCase,
    SlipperContact,
    assemble,
    force_lines,
    periodic_steady_state,
)
from swashtwin.physics.contacts.check import check_contact, slipper_forces
from swashtwin.physics.contacts.periodic import PeriodicFilms, periodic_films
from swashtwin.physics.contacts.settings import slipper_weight
from swashtwin.physics.contacts.slippers import distance_rows, slipper_lines, slippers_on_grid
from swashtwin.physics.contacts.steady import Marching, exact_step, slipper_steady_state
from swashtwin.physics.recess import slipper_profile
from swashtwin.physics.solvers.runge_kutta import state_matrix
from swashtwin.pump import Fault, OperatingCondition, PistonWear, Pump, SwashPlateDefect

RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
N_LINES = 140
ALIKE, LIFTING = SlipperContact(), SlipperContact(one_sided=True)


@dataclass
class Case:
    """A pump with a recess, and the two ways to its motion."""

    pump: Pump
    condition: OperatingCondition
    topology: str = "T1"
    fault: Fault | None = RECESS
    n_lines: int = N_LINES

    def __post_init__(self) -> None:
        self.structure = assemble(self.pump, self.topology)
        self.values = torch.tensor(self.pump.interfaces.values(), dtype=torch.float64)
        case = LoadCase(self.pump, self.condition)
        self.force = torch.as_tensor(force_lines([case], self.n_lines, topology=self.topology)[0])  # type: ignore[arg-type]

    def films(self, contact: SlipperContact = ALIKE) -> PeriodicFilms:
        return periodic_films(self.pump, self.topology, contact, self.condition, self.fault, self.values, self.n_lines)

    def by_lines(self, contact: SlipperContact = ALIKE) -> Tensor:
        films = self.films(contact)
        change = films.mean_shape - self.structure.interface_shapes[0]
        stiffness = self.structure.stiffness(self.values) + self.values[1] * change
        damping = self.structure.damping(self.values) + self.values[0] * change
        frequency = torch.arange(self.n_lines + 1, dtype=torch.float64) * self.condition.speed
        force, mass = self.force + films.force, self.structure.mass
        if films.terms:
            return periodic_steady_state(
                HarmonicBalance(), mass, damping, stiffness, self.condition.speed, force, films.terms
            )
        return HarmonicBalance().steady_state(mass, damping, stiffness, frequency, force)

    def by_steps(
        self,
        contact: SlipperContact = ALIKE,
        steps: int = 8192,
        values: Tensor | None = None,
        force: Tensor | None = None,
        tolerance: float = 1e-9,
        **factors: Tensor | float,
    ) -> Tensor:
        return slipper_steady_state(
            self.pump,
            self.structure,
            self.topology,
            contact,
            self.condition,
            self.fault,
            self.values if values is None else values,
            self.force if force is None else force,
            marching=Marching(steps=steps, tolerance=tolerance),
            **factors,
        )

    def read(self, motion: Tensor) -> np.ndarray:
        """Acceleration lines at the sensors."""
        frequency = np.arange(motion.shape[-2])[:, None] * self.condition.speed
        return -(frequency**2) * (motion.detach().numpy() @ self.structure.sensor_rows.numpy().T)

    def off(self, motion: Tensor, reference: Tensor, below: int | None = None) -> float:
        """Relative difference of the accelerations of all sensors."""
        actual, expected = self.read(motion)[:below], self.read(reference)[:below]
        return float(np.linalg.norm(actual - expected) / np.linalg.norm(expected))


@pytest.fixture(scope="module", params=["T1", "T2"])
def case(pump: Pump, at_15: OperatingCondition, request: pytest.FixtureRequest) -> Case:
    return Case(pump, at_15, request.param)


@pytest.fixture(scope="module")
def t1(pump: Pump, at_15: OperatingCondition) -> Case:
    return Case(pump, at_15)


# --- the linear limit


def test_equal_slippers_that_may_pull_move_as_by_harmonic_balance_with_an_error_of_second_order(case: Case) -> None:
    exact = case.by_lines()
    errors = [case.off(case.by_steps(steps=steps), exact) for steps in (2048, 4096, 8192)]
    assert errors[-1] < 5e-4
    assert math.log2(errors[0] / errors[2]) / 2 == pytest.approx(2, abs=0.1)


def test_slippers_held_down_hard_enough_never_lift_off(case: Case) -> None:
    force = case.force.clone()
    force[0, 12 if case.topology == "T1" else 7] -= 1e7
    assert case.off(case.by_steps(LIFTING, 2048, force=force), case.by_steps(ALIKE, 2048)) < 1e-7


@pytest.mark.parametrize("unloaded", [0.0, 0.5])
def test_unloaded_slippers_move_a_pump_as_by_periodic_terms(case: Case, unloaded: float) -> None:
    contact = SlipperContact(unloaded=unloaded)
    exact = case.by_lines(contact)
    errors = [case.off(case.by_steps(contact, steps), exact, below=64) for steps in (4096, 8192)]
    assert errors[-1] < 3e-4
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert case.off(case.by_lines(), exact) > 0.1


def test_a_step_is_exact_for_forces_that_run_linearly(t1: Case) -> None:
    mass, damping = t1.structure.mass, t1.structure.damping(t1.values)
    stiffness = t1.structure.stiffness(t1.values)
    step, load = 2e-5, np.random.default_rng(0).normal(size=(2, 13)) * 1e3
    phi, hold, ramp = (part.numpy() for part in exact_step(mass, damping, stiffness, step))
    generator = np.zeros((28, 28))
    generator[:26, :26] = state_matrix(mass, damping, stiffness)
    generator[13:26, 26:] = np.linalg.solve(mass, np.stack([load[0], (load[1] - load[0]) / step], axis=1))
    generator[27, 26] = 1.0
    start = np.random.default_rng(1).normal(size=26) * 1e-6
    exact = (scipy.linalg.expm(generator * step) @ np.concatenate([start, [1.0, 0.0]]))[:26]
    np.testing.assert_allclose(phi @ start + hold @ load[0] + ramp @ (load[1] - load[0]), exact, rtol=1e-9, atol=1e-12)


# --- one-sided contact


def test_a_film_that_cannot_pull_only_pushes_and_the_motion_settles_as_steps_get_shorter(t1: Case) -> None:
    coarse, middle, fine = (t1.by_steps(LIFTING, steps) for steps in (4096, 8192, 32768))
    assert t1.off(middle, fine) < 0.02
    assert t1.off(middle, fine) < 0.5 * t1.off(coarse, fine)
    assert t1.off(t1.by_lines(), fine) > 0.5
    pushing = slipper_forces(t1.pump, "T1", LIFTING, t1.condition, RECESS, t1.values, fine)
    assert pushing.min() == 0
    assert 0.2 < np.mean(pushing == 0) < 0.6


def test_lifting_off_is_of_second_order_as_well_where_no_velocity_jumps(pump: Pump, at_15: OperatingCondition) -> None:
    smooth = Case(pump, at_15, fault=replace(RECESS, edge="raised_cosine"))
    fine = smooth.by_steps(LIFTING, 32768)
    errors = [smooth.off(smooth.by_steps(LIFTING, steps), fine) for steps in (2048, 4096, 8192)]
    assert errors[-1] < 2e-4
    assert math.log2(errors[0] / errors[2]) / 2 == pytest.approx(2, abs=0.2)


def test_a_healthy_pump_keeps_its_slippers_down_and_stays_linear(pump: Pump, at_15: OperatingCondition) -> None:
    healthy = Case(pump, at_15, fault=None)
    assert healthy.off(healthy.by_steps(LIFTING, 2048), healthy.by_steps(ALIKE, 2048)) < 1e-7


def test_the_other_faults_strain_no_film(pump: Pump, at_15: OperatingCondition) -> None:
    for fault in (None, PistonWear(um(25)), replace(RECESS, contact="physical")):
        grid = slippers_on_grid(pump, "T1", ALIKE, fault, at_15.speed, 64)
        assert not grid.displacement.any()
        assert not grid.velocity.any()
        assert not slipper_lines(pump, at_15, fault, 20).any()


def test_a_motion_that_does_not_repeat_is_refused(t1: Case) -> None:
    with pytest.raises(SwashTwinError, match=r"does not repeat within 3 revolutions .* no order lines"):
        slipper_steady_state(
            t1.pump,
            t1.structure,
            "T1",
            LIFTING,
            t1.condition,
            RECESS,
            t1.values,
            t1.force,
            marching=Marching(steps=1024, most=3),
        )


def test_too_few_steps_for_the_lines_are_refused(t1: Case) -> None:
    with pytest.raises(InputError, match="256 steps a revolution are too few for 141 lines"):
        t1.by_steps(steps=256)


@pytest.mark.parametrize("share", [-0.1, 1.5, math.nan])
def test_an_unloaded_share_outside_0_to_1_is_refused(share: float) -> None:
    with pytest.raises(InputError, match=r"SlipperContact.unloaded .* must lie in 0\.\.\.1"):
        SlipperContact(unloaded=share)


def test_only_equal_slippers_that_may_pull_are_linear() -> None:
    assert SlipperContact().linear
    assert not SlipperContact(unloaded=0.5).linear
    assert not LIFTING.linear


# --- gradients and batches


@pytest.mark.parametrize("one_sided", [False, True])
def test_gradients_are_those_of_finite_differences(case: Case, one_sided: bool) -> None:
    contact = SlipperContact(unloaded=0.4, one_sided=one_sided)
    weight = torch.randn(30, 13, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 1e6
    nominal = torch.cat([case.values.log(), torch.ones(4, dtype=torch.float64)])

    def loss(point: Tensor) -> Tensor:
        motion = case.by_steps(
            contact,
            512,
            point[:6].exp(),
            case.force[:30] * point[6],
            tolerance=1e-13,
            mount=point[7],
            bearing=point[8],
            excitation=point[9],
        )
        return (motion.real * weight).sum() + (motion.imag * weight).sum()

    point = nominal.clone().requires_grad_(True)
    (gradient,) = torch.autograd.grad(loss(point), point)
    for i in range(10):
        shift = torch.zeros(10, dtype=torch.float64)
        shift[i] = 1e-5
        with torch.no_grad():
            slope = float(loss(nominal + shift) - loss(nominal - shift)) / 2e-5
        assert float(gradient[i]) == pytest.approx(slope, rel=1e-4, abs=1e-5 * float(gradient.abs().max()))


def test_gradients_with_respect_to_force_lines_are_those_of_finite_differences(t1: Case) -> None:
    short = t1.force[:4].clone()

    def motion(lines: Tensor) -> Tensor:
        return t1.by_steps(LIFTING, 128, force=torch.complex(lines, short.imag), tolerance=1e-14) * 1e9

    lines = short.real.clone().requires_grad_(True)
    assert torch.autograd.gradcheck(motion, (lines,), eps=1.0, atol=1e-3, rtol=1e-4, fast_mode=True)


def test_a_batch_is_its_members_bit_for_bit(t1: Case) -> None:
    values = t1.values * torch.tensor([[1.0], [2.0], [0.5]])
    gain = torch.tensor([1.0, 0.5, 0.1], dtype=torch.float64)
    together = t1.by_steps(LIFTING, 1024, values, excitation=gain)
    for i in range(3):
        assert torch.equal(together[i], t1.by_steps(LIFTING, 1024, values[i], excitation=gain[i]))
    assert together.shape == (3, N_LINES + 1, 13)


def test_lines_come_back_in_the_precision_of_the_values(t1: Case) -> None:
    single = t1.by_steps(LIFTING, 1024, t1.values.float())
    assert single.dtype == torch.complex64
    assert t1.off(single, t1.by_steps(LIFTING, 1024)) < 1e-4


# --- slippers one by one


def test_a_weight_is_1_in_the_mean_and_higher_under_pressure(pump: Pump) -> None:
    angle = np.linspace(0, 2 * math.pi, 720, endpoint=False)
    for unloaded in (0.0, 0.3, 1.0):
        weight = slipper_weight(pump, SlipperContact(unloaded=unloaded), angle)
        assert weight.mean() == pytest.approx(1)
        assert weight[180] == pytest.approx(unloaded * weight[540], abs=1e-9)
        assert np.abs(weight - weight.mean()).max() > 0 or unloaded == 1


def test_unloaded_slippers_that_carry_nothing_make_a_square_wave_of_14_percent_with_round_corners(pump: Pump) -> None:
    angle = np.linspace(0, 2 * math.pi, 2000)[:, None] + 2 * math.pi * np.arange(7) / 7
    total = slipper_weight(pump, SlipperContact(unloaded=0.0), angle).mean(axis=1) - 1
    assert 0.12 < total.max() < 1 / 7
    assert -1 / 7 < total.min() < -0.12
    lines = np.abs(np.fft.rfft(total[:-1]))
    assert lines[np.arange(len(lines)) % 7 != 0].max() < 1e-3 * lines[7]


@pytest.mark.parametrize("edge", ["half_sine", "raised_cosine"])
def test_a_recess_displaces_a_slipper_by_its_profile_and_lines(
    pump: Pump, at_15: OperatingCondition, edge: str
) -> None:
    defect = replace(RECESS, edge=edge, contact="literal", gain=0.5)
    grid = slippers_on_grid(pump, "T1", ALIKE, defect, at_15.speed, 4096)
    angle = 2 * math.pi * np.arange(4096) / 4096 + 2 * math.pi * 2 / 7
    height, slope = slipper_profile(pump, defect, angle)
    np.testing.assert_allclose(grid.displacement[:, 2], 3.5 * height)
    smooth = np.abs(np.diff(slope, append=0)) < 0.01 * np.abs(slope).max()
    smooth &= np.roll(smooth, 1) & np.roll(smooth, 2) & np.roll(smooth, -1)
    np.testing.assert_allclose(
        grid.velocity[smooth, 2], 3.5 * at_15.speed * slope[smooth], atol=1e-3 * np.abs(grid.velocity).max()
    )
    lines = np.fft.rfft(grid.displacement[:, 0])[:21] / 2048
    lines[0] /= 2
    np.testing.assert_allclose(slipper_lines(pump, at_15, defect, 20), lines, atol=1e-5 * abs(lines[0]))


def test_slipper_distances_add_up_to_the_interface_of_the_linear_model(case: Case) -> None:
    rows = distance_rows(case.pump, case.topology)
    grid = slippers_on_grid(case.pump, case.topology, ALIKE, None, 1.0, 16)
    for weights, directions in zip(grid.weights, grid.directions, strict=True):
        each = directions @ rows
        np.testing.assert_allclose(
            (each.T * weights) @ each, case.structure.interface_shapes[0].numpy(), atol=1e-12 * len(rows)
        )


# --- whether the linear twin may be believed


def test_the_papers_recess_takes_the_linear_twin_out_of_its_range_and_a_healthy_pump_does_not(
    pump: Pump, at_15: OperatingCondition
) -> None:
    forces = {}
    for name, fault in (("healthy", None), ("recess", RECESS)):
        case = Case(pump, at_15, fault=fault)
        forces[name] = slipper_forces(pump, "T1", ALIKE, at_15, fault, case.values, case.by_lines())
    healthy, recess = check_contact(forces["healthy"]), check_contact(forces["recess"])
    assert healthy.within_range
    assert healthy.pulling == 0
    assert healthy.sentence().endswith("within the linear model's range")
    assert not recess.within_range
    assert recess.lowest == pytest.approx(-53e3, rel=0.02)  # C_sw / 7 times 0.2 m/s
    assert recess.pulling > 0.9
    assert "lowest contact force -5" in recess.sentence()
    assert "SlipperContact(one_sided=True)" in recess.sentence()


def test_slipper_forces_are_what_the_films_exert_on_the_retainer(t1: Case) -> None:
    motion = t1.by_lines()
    forces = slipper_forces(t1.pump, "T1", ALIKE, t1.condition, RECESS, t1.values, motion)
    lines = np.fft.rfft(forces.sum(axis=0))[: N_LINES + 1] / 2048
    frequency = np.arange(N_LINES + 1) * t1.condition.speed
    film = t1.values[1].item() + 1j * frequency * t1.values[0].item()
    exerted = -film * (motion.numpy() @ t1.structure.slipper_vector.numpy())
    exerted += t1.films().force.numpy()[:, 12] / t1.structure.slipper_vector[12].item()
    np.testing.assert_allclose(lines[1:], exerted[1:], atol=1e-9 * np.abs(exerted).max())


def test_the_sentence_quotes_lowest_force_share_and_hold_down() -> None:
    said = ContactCheck(lowest=-31e3, pulling=0.34, hold_down=11.4e3).sentence()
    assert "during 34% of the revolution (lowest contact force -31 kN, mean hold-down 11.4 kN)" in said
