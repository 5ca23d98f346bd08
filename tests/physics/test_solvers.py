"""Steady solvers against time marching, static deflection, finite differences and their limits."""

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
from swashtwin.physics.dynamics import N_DOF, Dof
from swashtwin.physics.steady import rk4_limits, state_matrix
from swashtwin.pump import InterfaceValue, Pump

Matrices = tuple[Tensor, Tensor, Tensor]


IDENTIFIED_DAMPING = {
    InterfaceValue.SLIPPER_SWASH_DAMPING: 0.778e6,
    InterfaceValue.PISTON_BORE_DAMPING: 15.3e4,
}


@pytest.fixture(scope="module")
def matrices(pump: Pump) -> Matrices:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    return structure.mass, structure.damping(values), structure.stiffness(values)


# physics.md 2.6: 1.00 us before the paper's identification of C_sw and C_Hz, 2.04 us after it
@pytest.mark.parametrize(
    ("topology", "identified", "limit_us"),
    [("T1", {}, 1.00), ("T1", IDENTIFIED_DAMPING, 2.04), ("T2", {}, 4.985)],
    ids=["T1", "T1 identified", "T2"],
)
def test_the_rk4_limit_is_the_one_of_the_physics_notes(
    pump: Pump, topology: str, identified: dict[int, float], limit_us: float
) -> None:
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    for index, value in identified.items():
        values[index] = value

    structure = assemble(pump, topology)
    state = state_matrix(structure.mass, structure.damping(values), structure.stiffness(values))

    assert float(rk4_limits(state)) * 1e6 == pytest.approx(limit_us, rel=2e-3)


def test_a_step_above_the_limit_is_refused_with_the_limit(matrices: Matrices) -> None:
    frequency = torch.ones(1, dtype=torch.float64)
    force = torch.ones(1, N_DOF, dtype=torch.complex128)
    message = r"5 us must be .* below the stability limit of this pump, 1 us"
    with pytest.raises(StabilityError, match=message):
        RK4(step=5e-6).steady_state(*matrices, frequency, force)


def test_a_constant_force_gives_the_static_deflection(matrices: Matrices) -> None:
    _, _, stiffness = matrices
    frequency = torch.zeros(1, dtype=torch.float64)
    force = torch.zeros(1, N_DOF, dtype=torch.complex128)
    force[0, Dof.RETAINER_Z] = -11378.0  # the mean force of the pistons

    lines = HarmonicBalance().steady_state(*matrices, frequency, force)

    deflection = torch.linalg.solve(stiffness, force[0].real)
    torch.testing.assert_close(lines[0].real, deflection)


def settling_quickly(matrices: Matrices) -> Matrices:
    """Not stiff, as the subject is the coupling of the lines."""
    mass, damping, stiffness = matrices
    return mass, damping * 0.01 + 2000 * mass, stiffness


def rotating_term(pump: Pump, order: int = 1) -> PeriodicTerm:
    """A mode of the valve plate film that turns with the shaft."""
    shape = assemble(pump).interface_shapes[1]
    return PeriodicTerm(order, 0.3 * 1.2e8 * shape * (1 + 0.5j), 3e3 * shape * (0.5 - 1j))


def rotor_force(n_lines: int) -> Tensor:
    force = torch.zeros(n_lines, N_DOF, dtype=torch.complex128)
    force[0, Dof.ROTOR_Z] = 500.0
    force[1, Dof.ROTOR_TILT_X] = 2.0
    force[2, Dof.ROTOR_Z] = 80.0 + 30j
    return force


def marched_positions(
    matrices: Matrices, term: PeriodicTerm, force: Tensor, speed: float, times: list[float]
) -> np.ndarray:
    """Positions (13, time) of an adaptive Runge-Kutta run from rest."""
    m = matrices[0].diagonal().numpy()
    c = matrices[1].numpy()
    k = matrices[2].numpy()
    q = force.numpy()
    orders = np.arange(len(q))
    assert term.damping is not None
    rotating_c = term.damping.numpy()
    rotating_k = term.stiffness.numpy()

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        position, velocity = np.split(state, 2)
        turn = np.exp(1j * speed * time * orders)
        elastic = (k + (rotating_k * turn[term.order]).real) @ position
        viscous = (c + (rotating_c * turn[term.order]).real) @ velocity
        acceleration = ((turn @ q).real - elastic - viscous) / m
        return np.concatenate([velocity, acceleration])

    at_rest = np.zeros(2 * N_DOF)
    solution = scipy.integrate.solve_ivp(
        rate, (0, times[-1]), at_rest, "DOP853", rtol=1e-9, atol=1e-14, t_eval=times
    )
    return solution.y[:N_DOF]


@pytest.mark.parametrize("order", [1, 3])
def test_periodic_terms_are_solved_as_time_marching_solves_them(
    matrices: Matrices, pump: Pump, order: int
) -> None:
    quick_matrices = settling_quickly(matrices)
    term = rotating_term(pump, order)
    force = rotor_force(12 * order)
    speed = 2 * math.pi * 60
    period = 2 * math.pi / speed
    # after three periods the transient has decayed
    times = [3.25 * period, 3.6 * period]

    lines = periodic_steady_state(HarmonicBalance(), *quick_matrices, speed, force, [term])
    positions = marched_positions(quick_matrices, term, force, speed, times)

    for position, time in zip(positions.T, times, strict=True):
        turn = torch.exp(1j * torch.tensor(speed * time) * torch.arange(len(lines)))
        expected = (turn[:, None] * lines).sum(0).real.numpy()
        np.testing.assert_allclose(position, expected, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize(
    "solver", [HarmonicBalance(), RK4(step=1e-6)], ids=["harmonic_balance", "rk4"]
)
def test_periodic_solutions_have_exact_derivatives_of_both_orders(
    matrices: Matrices, pump: Pump, solver: SteadySolver
) -> None:
    mass, damping, stiffness = settling_quickly(matrices)
    first = rotating_term(pump)
    third = rotating_term(pump, order=3)
    force = rotor_force(4)

    def scaled_lines(c: Tensor, k: Tensor, turns: Tensor, q: Tensor) -> Tensor:
        # a fifth of the coupling, so that the iteration converges in few rounds
        terms = [
            PeriodicTerm(1, first.stiffness * turns[0] / 5, first.damping * turns[1] / 5),
            PeriodicTerm(3, third.stiffness * turns[2] / 5, None),
        ]
        lines = periodic_steady_state(
            solver, mass, damping * c, stiffness * k, 377.0, force * q, terms, tolerance=1e-12
        )
        return torch.view_as_real(lines) * 1e5

    arguments = (
        torch.ones((), dtype=torch.float64, requires_grad=True),
        torch.ones((), dtype=torch.float64, requires_grad=True),
        torch.ones(3, dtype=torch.complex128, requires_grad=True),
        torch.ones(4, N_DOF, dtype=torch.complex128, requires_grad=True),
    )
    assert torch.autograd.gradcheck(scaled_lines, arguments, fast_mode=True)
    assert torch.autograd.gradgradcheck(scaled_lines, arguments, fast_mode=True, atol=1e-4)


def test_a_periodic_part_too_large_for_the_iteration_is_refused(matrices: Matrices) -> None:
    mass, damping, stiffness = matrices
    force = torch.ones(3, N_DOF, dtype=torch.complex128)
    term = PeriodicTerm(1, stiffness * 5 + 0j)
    with pytest.raises(InputError, match="reduce the severity"):
        periodic_steady_state(
            HarmonicBalance(), mass, damping, stiffness, 90.0, force, [term], max_iterations=20
        )
