"""Steady solvers against time marching, static deflection, finite differences and their own
limits.
"""

import math

import numpy as np
import pytest
import scipy.integrate
import torch
from torch import Tensor

from swashtwin.foundation import InputError, StabilityError
from swashtwin.physics import (
    RK4,
    HarmonicBalance,
    PeriodicTerm,
    SteadySolver,
    assemble,
    periodic_steady_state,
)
from swashtwin.physics.steady import rk4_limits, state_matrix
from swashtwin.pump import Pump

Matrices = tuple[Tensor, Tensor, Tensor]


@pytest.fixture(scope="module")
def matrices(pump: Pump) -> Matrices:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    return structure.mass, structure.damping(values), structure.stiffness(values)


@pytest.mark.parametrize(
    ("topology", "identified", "limit"), [("T1", 0, 1.00), ("T1", 1, 2.04), ("T2", 0, 4.985)]
)
def test_the_rk4_limit_is_the_one_of_the_physics_notes(
    pump: Pump, topology: str, identified: int, limit: float
) -> None:
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    if identified:
        values[0], values[4] = 0.778e6, 15.3e4
    structure = assemble(pump, topology)
    state = state_matrix(structure.mass, structure.damping(values), structure.stiffness(values))
    assert float(rk4_limits(state)) * 1e6 == pytest.approx(limit, rel=2e-3)


def test_a_step_above_the_limit_is_refused_and_the_limit_named(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    frequency, force = torch.ones(1, dtype=torch.float64), torch.ones(1, 13, dtype=torch.complex128)
    with pytest.raises(
        StabilityError, match=r"5 us must be .* below the stability limit of this pump, 1 us"
    ):
        RK4(step=5e-6).steady_state(mass, damping, stiffness, frequency, force)


def test_a_constant_force_gives_the_static_deflection(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    force = torch.zeros(1, 13, dtype=torch.complex128)
    force[0, 12] = -11378.0
    lines = HarmonicBalance().steady_state(
        mass, damping, stiffness, torch.zeros(1, dtype=torch.float64), force
    )
    torch.testing.assert_close(lines[0].real, torch.linalg.solve(stiffness, force[0].real))


def quick_to_settle(matrices: Matrices) -> Matrices:
    """Not stiff: the checks are of the coupling."""
    mass, damping, stiffness = matrices
    return mass, damping * 0.01 + 2000 * mass, stiffness


def turning(pump: Pump, order: int = 1) -> PeriodicTerm:
    """A mode of the valve plate film that turns with the shaft."""
    shape = assemble(pump).interface_shapes[1]
    return PeriodicTerm(order, 0.3 * 1.2e8 * shape * (1 + 0.5j), 3e3 * shape * (0.5 - 1j))


def some_force(n_lines: int) -> Tensor:
    force = torch.zeros(n_lines, 13, dtype=torch.complex128)
    force[0, 7], force[2, 7], force[1, 8] = 500.0, 80.0 + 30j, 2.0
    return force


@pytest.mark.parametrize("order", [1, 3])
def test_periodic_terms_are_solved_as_time_marching_solves_them(
    matrices: Matrices, pump: Pump, order: int
) -> None:
    """Against an adaptive Runge-Kutta run to periodicity."""
    mass, damping, stiffness = quick_to_settle(matrices)
    speed, n_lines, term = 2 * math.pi * 60, 12 * order, turning(pump, order)
    assert term.damping is not None
    force = some_force(n_lines)
    lines = periodic_steady_state(HarmonicBalance(), mass, damping, stiffness, speed, force, [term])

    m, c, k, q = mass.diagonal().numpy(), damping.numpy(), stiffness.numpy(), force.numpy()
    turning_c, turning_k = term.damping.numpy(), term.stiffness.numpy()

    def rate(time: float, x: np.ndarray) -> np.ndarray:
        turn = np.exp(1j * speed * time * np.arange(n_lines))
        elastic, viscous = k + (turning_k * turn[order]).real, c + (turning_c * turn[order]).real
        return np.concatenate([x[13:], ((turn @ q).real - elastic @ x[:13] - viscous @ x[13:]) / m])

    period = 2 * math.pi / speed
    solution = scipy.integrate.solve_ivp(
        rate,
        (0, 4 * period),
        np.zeros(26),
        "DOP853",
        rtol=1e-9,
        atol=1e-14,
        t_eval=[3.25 * period, 3.6 * period],
    )
    for column, time in zip(solution.y.T, solution.t, strict=True):
        turn = torch.exp(1j * torch.tensor(speed * time) * torch.arange(n_lines))
        expected = (turn[:, None] * lines).sum(0).real.numpy()
        np.testing.assert_allclose(column[:13], expected, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize(
    "solver", [HarmonicBalance(), RK4(step=1e-6)], ids=["harmonic_balance", "rk4"]
)
def test_periodic_solutions_have_exact_derivatives_of_both_orders(
    matrices: Matrices, pump: Pump, solver: SteadySolver
) -> None:
    mass, damping, stiffness = quick_to_settle(matrices)
    first, second, force = turning(pump), turning(pump, 3), some_force(4)

    def lines(c: Tensor, k: Tensor, turns: Tensor, q: Tensor) -> Tensor:
        terms = [
            PeriodicTerm(1, first.stiffness * turns[0] / 5, first.damping * turns[1] / 5),
            PeriodicTerm(3, second.stiffness * turns[2] / 5, None),
        ]
        lines = periodic_steady_state(
            solver, mass, damping * c, stiffness * k, 377.0, force * q, terms, tolerance=1e-12
        )
        return torch.view_as_real(lines) * 1e5

    kinds = (
        ((), torch.float64),
        ((), torch.float64),
        ((3,), torch.complex128),
        ((4, 13), torch.complex128),
    )
    arguments = tuple(torch.ones(shape, dtype=dtype, requires_grad=True) for shape, dtype in kinds)
    assert torch.autograd.gradcheck(lines, arguments, fast_mode=True)
    if isinstance(solver, HarmonicBalance):
        assert torch.autograd.gradgradcheck(lines, arguments, fast_mode=True, atol=1e-4)


def test_a_periodic_part_too_large_for_the_iteration_is_refused(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    force = torch.ones(3, 13, dtype=torch.complex128)
    term = PeriodicTerm(1, stiffness * 5 + 0j)
    with pytest.raises(InputError, match="reduce the severity"):
        periodic_steady_state(
            HarmonicBalance(), mass, damping, stiffness, 90.0, force, [term], max_iterations=20
        )
