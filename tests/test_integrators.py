"""Solvers against each other, against the matrix exponential, and against their own limits."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import torch
from torch import Tensor

from swashtwin.dynamics import assemble
from swashtwin.errors import InputError, StabilityError
from swashtwin.integrators import (
    RK4,
    HarmonicBalance,
    PeriodicTerm,
    first_order_hold_trajectory,
    periodic_steady_state,
    rk4_limit,
    rk4_trajectory,
    state_matrix,
)
from swashtwin.pump import Pump

Matrices = tuple[Tensor, Tensor, Tensor]


@pytest.fixture(scope="module")
def matrices(pump: Pump) -> Matrices:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    return structure.mass, structure.damping(values), structure.stiffness(values)


def sine_force(times: np.ndarray, seed: int = 0) -> Tensor:
    rng = np.random.default_rng(seed)
    amplitude, phase = rng.normal(size=13), rng.uniform(0, 2 * np.pi, 13)
    return torch.as_tensor(amplitude * np.sin(2 * np.pi * 100 * times[:, None] + phase))


@pytest.mark.parametrize(("topology", "identified", "limit"), [("T1", 0, 1.00), ("T1", 1, 2.04), ("T2", 0, 4.985)])
def test_the_rk4_limit_is_the_one_of_the_physics_notes(
    pump: Pump, topology: str, identified: int, limit: float
) -> None:
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    if identified:
        values[0], values[4] = 0.778e6, 15.3e4
    structure = assemble(pump, topology)
    state = state_matrix(structure.mass, structure.damping(values), structure.stiffness(values))
    assert rk4_limit(state) * 1e6 == pytest.approx(limit, rel=2e-3)


def test_a_step_above_the_limit_is_refused_and_the_limit_named(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    with pytest.raises(StabilityError, match=r"5 us lies above the stability limit 1 us"):
        rk4_trajectory(mass, damping, stiffness, torch.zeros(3, 13, dtype=torch.float64), 5e-6)
    frequency, force = torch.ones(1, dtype=torch.float64), torch.ones(1, 13, dtype=torch.complex128)
    with pytest.raises(StabilityError, match="stability limit"):
        RK4(step=5e-6).steady_state(mass, damping, stiffness, frequency, force)


def test_the_rk4_map_gives_the_numbers_of_the_textbook_loop(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    step, n = 0.8e-6, 400
    force = sine_force(np.arange(2 * n + 1) * step / 2)
    state = state_matrix(mass, damping, stiffness)
    push = torch.cat([torch.zeros_like(force), force / mass.diagonal()], dim=1)
    x, loop = torch.zeros(26, dtype=torch.float64), []
    for i in range(n):
        k1 = state @ x + push[2 * i]
        k2 = state @ (x + step / 2 * k1) + push[2 * i + 1]
        k3 = state @ (x + step / 2 * k2) + push[2 * i + 1]
        k4 = state @ (x + step * k3) + push[2 * i + 2]
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        loop.append(x)
    mapped = rk4_trajectory(mass, damping, stiffness, force, step)[1:]
    torch.testing.assert_close(mapped, torch.stack(loop), rtol=1e-10, atol=1e-22)


def test_rk4_is_of_fourth_order(matrices: Matrices) -> None:
    """Fitted slope 4 +- 0.2 against the matrix exponential, free motion of a softened system (no stiff mode)."""
    mass, damping, stiffness = matrices
    damping = damping * 1e-4
    state = state_matrix(mass, damping, stiffness)
    start = torch.as_tensor(np.random.default_rng(1).normal(size=26))
    start[13:] *= 1e4  # velocities of the size that such displacements bring
    duration, errors, steps = 2e-3, [], []
    exact = torch.as_tensor(scipy.linalg.expm(state.numpy() * duration)) @ start
    for n in (150, 250, 400, 650):
        force = torch.zeros(2 * n + 1, 13, dtype=torch.float64)
        end = rk4_trajectory(mass, damping, stiffness, force, duration / n, start)[-1]
        steps.append(duration / n)
        errors.append(float((end - exact).norm() / exact.norm()))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(4, abs=0.2)


def test_first_order_hold_is_exact_for_ramps_and_second_order_for_sines(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    fine = first_order_hold_trajectory(mass, damping, stiffness, sine_force(np.arange(4097) * 2.5e-6), 2.5e-6)
    errors = []
    for factor in (8, 16, 32):
        times = np.arange(4096 // factor + 1) * 2.5e-6 * factor
        coarse = first_order_hold_trajectory(mass, damping, stiffness, sine_force(times), 2.5e-6 * factor)
        errors.append(float((coarse - fine[::factor])[:, :13].abs().max()))
    assert np.log2(errors[1] / errors[0]) == pytest.approx(2, abs=0.2)
    assert np.log2(errors[2] / errors[1]) == pytest.approx(2, abs=0.2)
    ramp = torch.linspace(0, 1, 41, dtype=torch.float64)[:, None].expand(41, 13).contiguous()
    once = first_order_hold_trajectory(mass, damping, stiffness, ramp[[0, 40]], 1e-3)
    often = first_order_hold_trajectory(mass, damping, stiffness, ramp, 1e-3 / 40)
    torch.testing.assert_close(once[-1], often[-1], rtol=1e-8, atol=1e-20)


def test_a_constant_force_gives_the_static_deflection(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    force = torch.zeros(1, 13, dtype=torch.complex128)
    force[0, 12] = -11378.0
    lines = HarmonicBalance().steady_state(mass, damping, stiffness, torch.zeros(1, dtype=torch.float64), force)
    torch.testing.assert_close(lines[0].real, torch.linalg.solve(stiffness, force[0].real))


def test_harmonic_balance_has_exact_gradients(matrices: Matrices, pump: Pump) -> None:
    structure = assemble(pump)
    frequency = torch.tensor([630.0, 2500.0], dtype=torch.float64)
    force = torch.as_tensor(np.random.default_rng(2).normal(size=(2, 13)) + 0j)
    scale = torch.tensor(pump.interfaces.values(), dtype=torch.float64)

    def response(relative: Tensor) -> Tensor:
        values = relative * scale
        lines = HarmonicBalance().steady_state(
            structure.mass, structure.damping(values), structure.stiffness(values), frequency, force
        )
        return torch.view_as_real(lines @ structure.sensor_rows.T.to(lines.dtype)) * 1e8

    assert torch.autograd.gradcheck(response, (torch.ones(6, dtype=torch.float64, requires_grad=True),))


def test_a_periodic_stiffness_is_solved_as_time_marching_solves_it(matrices: Matrices, pump: Pump) -> None:
    """A mode of the valve plate film that turns with the shaft, against an adaptive Runge-Kutta run to periodicity."""
    mass, damping, stiffness = matrices
    damping = damping * 0.01 + 2000 * mass  # quick to settle, and not stiff: the check is of the coupling
    speed, n_lines = 2 * math.pi * 60, 12
    amplitude = 0.3 * 1.2e8 * assemble(pump).interface_shapes[1] * (1 + 0.5j)
    force = torch.zeros(n_lines, 13, dtype=torch.complex128)
    force[0, 7], force[2, 7], force[1, 8] = 500.0, 80.0 + 30j, 2.0
    term = PeriodicTerm(1, amplitude)
    lines = periodic_steady_state(HarmonicBalance(), mass, damping, stiffness, speed, force, [term])

    m, c, k, p = mass.diagonal().numpy(), damping.numpy(), stiffness.numpy(), amplitude.numpy()
    q = force.numpy()

    def rate(time: float, x: np.ndarray) -> np.ndarray:
        turn = np.exp(1j * speed * time * np.arange(n_lines))
        push = (turn @ q).real
        return np.concatenate([x[13:], (push - (k + (p * turn[1]).real) @ x[:13] - c @ x[13:]) / m])

    period = 2 * math.pi / speed
    solution = scipy.integrate.solve_ivp(
        rate, (0, 4 * period), np.zeros(26), "DOP853", rtol=1e-9, atol=1e-14, t_eval=[3.25 * period, 3.6 * period]
    )
    for column, time in zip(solution.y.T, solution.t, strict=True):
        turn = torch.exp(1j * torch.tensor(speed * time) * torch.arange(n_lines))
        expected = (turn[:, None] * lines).sum(0).real.numpy()
        np.testing.assert_allclose(column[:13], expected, atol=2e-5 * np.abs(expected).max())


def test_a_periodic_part_too_large_for_the_iteration_is_refused(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    force = torch.ones(3, 13, dtype=torch.complex128)
    term = PeriodicTerm(1, stiffness * 5 + 0j)
    with pytest.raises(InputError, match="reduce the severity"):
        periodic_steady_state(HarmonicBalance(), mass, damping, stiffness, 90.0, force, [term], most=20)


def test_an_even_number_of_half_steps_is_refused(matrices: Matrices) -> None:
    with pytest.raises(InputError, match="odd number"):
        rk4_trajectory(*matrices, torch.zeros(4, 13, dtype=torch.float64), 5e-7)
