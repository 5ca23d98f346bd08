"""Receptances against dense solves and finite differences, whatever path computes them."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics import RK4, HarmonicBalance, assemble
from swashtwin.physics.dynamics import Dof
from swashtwin.physics.receptances import receptance
from swashtwin.pump import Pump

Matrices = tuple[Tensor, Tensor, Tensor]
N_SETS = 12


@pytest.fixture(scope="module")
def matrices(pump: Pump) -> Matrices:
    """M, and C and K for sets of values from a tenth to ten times the nominal ones."""
    structure = assemble(pump)
    exponents = np.random.default_rng(0).uniform(-1, 1, (N_SETS, 6))
    nominal_values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    values = nominal_values * torch.as_tensor(10**exponents)
    return structure.mass, structure.damping(values), structure.stiffness(values)


@pytest.fixture(scope="module")
def frequency() -> Tensor:
    """The mean, and lines up to 5 kHz [rad/s]."""
    return torch.arange(51, dtype=torch.float64) * 630


def random_forces(*shape: int) -> Tensor:
    rng = np.random.default_rng(0)
    return torch.as_tensor(rng.normal(size=shape) + 1j * rng.normal(size=shape))


def dense_solution(
    mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor
) -> Tensor:
    """The definition, with every matrix written out."""
    s = s[..., None, None]
    dynamic = stiffness[..., None, :, :] + s * damping[..., None, :, :] + s**2 * mass
    return torch.linalg.solve(dynamic, force[..., None]).squeeze(-1)


def relative_error(actual: Tensor, expected: Tensor) -> float:
    """Largest difference in any line over the largest entry of that line."""
    difference = (actual - expected).abs().amax(-1)
    return float((difference / expected.abs().amax(-1)).max())


def test_a_receptance_is_the_solution_of_the_dense_system(
    matrices: Matrices, frequency: Tensor
) -> None:
    force = random_forces(N_SETS, 51, 13)
    actual = receptance(*matrices, 1j * frequency, force)
    expected = dense_solution(*matrices, 1j * frequency, force)
    assert relative_error(actual, expected) < 1e-11


def coupled(matrices: Matrices) -> Matrices:
    """A spring between directions that nothing in a pump couples."""
    mass, damping, stiffness = matrices
    tie = torch.zeros(13, dtype=torch.float64)
    tie[Dof.SHELL_X] = 1.0
    tie[Dof.RETAINER_Y] = -1.0
    return mass, damping, stiffness + 1e7 * torch.outer(tie, tie)


def asymmetric(matrices: Matrices) -> Matrices:
    """A cross-coupled bearing: stable, not symmetric."""
    mass, damping, stiffness = matrices
    cross = torch.zeros(13, 13, dtype=torch.float64)
    cross[Dof.ROTOR_X, Dof.ROTOR_Y] = 2e6
    cross[Dof.ROTOR_Y, Dof.ROTOR_X] = -2e6
    return mass, damping, stiffness + cross


def resonant(matrices: Matrices) -> Matrices:
    """No damping, and a shell that alone resonates at the line of 630 rad/s.

    The first pivot of that line almost vanishes, so elimination without pivots fails.
    """
    mass, damping, stiffness = matrices
    resonant_stiffness = stiffness.clone()
    shell_mass = mass[Dof.SHELL_X, Dof.SHELL_X]
    resonant_stiffness[:, Dof.SHELL_X, Dof.SHELL_X] = 630.0**2 * shell_mass * (1 + 1e-9)
    return mass, damping * 0, resonant_stiffness


@pytest.mark.parametrize("change", [coupled, asymmetric, resonant])
def test_systems_that_are_not_those_of_a_pump_are_solved_as_well(
    matrices: Matrices, frequency: Tensor, change: Callable[[Matrices], Matrices]
) -> None:
    changed = change(matrices)
    force = random_forces(N_SETS, 51, 13)
    actual = receptance(*changed, 1j * frequency, force)
    expected = dense_solution(*changed, 1j * frequency, force)
    assert relative_error(actual, expected) < 1e-10


def test_a_resonance_without_damping_is_refused(matrices: Matrices) -> None:
    mass, _, _ = matrices
    zero = torch.zeros(13, 13, dtype=torch.float64)
    s = torch.zeros(1, dtype=torch.complex128)
    with pytest.raises(InputError, match="singular at a line"):
        receptance(mass, zero, zero, s, random_forces(1, 13))


def relative_receptance(matrices: Matrices, s: Tensor, force: Tensor) -> Callable[..., Tensor]:
    """Scaled to motions and arguments of size 1, for finite differences; C and K stay symmetric."""
    mass, damping, stiffness = matrices

    def response(c: Tensor, k: Tensor, f: Tensor, m: Tensor, turn: Tensor) -> Tensor:
        scaled = (mass * m, damping[0] * (c + c.mT), stiffness[0] * (k + k.mT))
        return receptance(*scaled, s * turn, force * f) * 1e8

    return response


def ones(*shape: int, dtype: torch.dtype = torch.float64) -> Tensor:
    return torch.ones(shape, dtype=dtype, requires_grad=True)


def halves(*shape: int) -> Tensor:
    """Factors that are 1 after their transpose is added."""
    return torch.full(shape, 0.5, dtype=torch.float64, requires_grad=True)


def test_its_first_and_second_derivatives_are_those_of_finite_differences(
    matrices: Matrices,
) -> None:
    # two lines, and a point off the imaginary axis, as the solver by time steps needs
    s = torch.tensor([630j, 2500j, 9000 + 4000j], dtype=torch.complex128)
    response = relative_receptance(matrices, s, random_forces(3, 13))
    arguments = (
        halves(13, 13),
        halves(13, 13),
        ones(13, dtype=s.dtype),
        ones(13),
        ones(3, dtype=s.dtype),
    )

    assert torch.autograd.gradcheck(response, arguments, fast_mode=True)
    assert torch.autograd.gradgradcheck(response, arguments, fast_mode=True, atol=1e-4)


def test_halving_the_step_of_rk4_divides_its_error_by_sixteen(
    matrices: Matrices, frequency: Tensor
) -> None:
    mass = matrices[0]
    # little damping, so that lines of 1 to 2 kHz are far from the limit of stability
    damping = matrices[1][:1] * 1e-3
    stiffness = matrices[2][:1]
    lines = frequency[10:20]
    force = random_forces(1, 10, 13)
    exact = HarmonicBalance().steady_state(mass, damping, stiffness, lines, force)

    def error(step: float) -> float:
        stepped = RK4(step).steady_state(mass, damping, stiffness, lines, force)
        return relative_error(stepped, exact)

    errors = [error(1e-5), error(5e-6), error(2.5e-6)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4, abs=0.1)
