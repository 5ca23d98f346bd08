"""Receptances against dense solves, finite differences and each other, whatever path computes
them.
"""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics import RK4, HarmonicBalance, assemble
from swashtwin.physics.receptances import receptance
from swashtwin.pump import Pump

Matrices = tuple[Tensor, Tensor, Tensor]
SETS = 12


@pytest.fixture(scope="module")
def matrices(pump: Pump) -> Matrices:
    """M, and C and K for sets of values anywhere between a tenth and ten times the nominal ones."""
    structure = assemble(pump)
    spread = np.random.default_rng(0).uniform(-1, 1, (SETS, 6))
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64) * torch.as_tensor(
        10**spread
    )
    return structure.mass, structure.damping(values), structure.stiffness(values)


@pytest.fixture(scope="module")
def frequency() -> Tensor:
    """The mean, and lines up to 5 kHz [rad/s]."""
    return torch.arange(51, dtype=torch.float64) * 630


def some_lines(*shape: int, seed: int = 0) -> Tensor:
    rng = np.random.default_rng(seed)
    return torch.as_tensor(rng.normal(size=shape) + 1j * rng.normal(size=shape))


def dense(mass: Tensor, damping: Tensor, stiffness: Tensor, s: Tensor, force: Tensor) -> Tensor:
    """The definition, with every matrix written out."""
    at = s[..., None, None]
    dynamic = stiffness[..., None, :, :] + at * damping[..., None, :, :] + at**2 * mass
    return torch.linalg.solve(dynamic, force[..., None]).squeeze(-1)


def relative(actual: Tensor, expected: Tensor) -> float:
    """Largest difference in any line over the largest entry of that line."""
    return float(((actual - expected).abs().amax(-1) / expected.abs().amax(-1)).max())


def test_a_receptance_is_the_solution_of_the_dense_system(
    matrices: Matrices, frequency: Tensor
) -> None:
    force = some_lines(SETS, 51, 13)
    assert (
        relative(
            receptance(*matrices, 1j * frequency, force), dense(*matrices, 1j * frequency, force)
        )
        < 1e-11
    )


def coupled(matrices: Matrices) -> Matrices:
    mass, damping, stiffness = matrices
    tie = torch.zeros(13, dtype=torch.float64)
    tie[0], tie[11] = 1.0, -1.0
    return mass, damping, stiffness + 1e7 * torch.outer(tie, tie)


def asymmetric(matrices: Matrices) -> Matrices:
    """A cross-coupled bearing: stable, not symmetric."""
    mass, damping, stiffness = matrices
    cross = torch.zeros(13, 13, dtype=torch.float64)
    cross[5, 6], cross[6, 5] = 2e6, -2e6
    return mass, damping, stiffness + cross


def resonant(matrices: Matrices) -> Matrices:
    """No damping, and a shell that alone would swing at 630 rad/s: the first pivot of that line is
    nearly nothing.
    """
    mass, damping, stiffness = matrices
    loose = stiffness.clone()
    loose[:, 0, 0] = 630.0**2 * mass[0, 0] * (1 + 1e-9)
    return mass, damping * 0, loose


@pytest.mark.parametrize("change", [coupled, asymmetric, resonant])
def test_any_other_system_is_solved_as_well(
    matrices: Matrices, frequency: Tensor, change: Callable[[Matrices], Matrices]
) -> None:
    force, changed = some_lines(SETS, 51, 13), change(matrices)
    assert (
        relative(
            receptance(*changed, 1j * frequency, force), dense(*changed, 1j * frequency, force)
        )
        < 1e-10
    )


def test_a_resonance_without_damping_is_named(matrices: Matrices) -> None:
    mass, _, _ = matrices
    nothing, force = torch.zeros(13, 13, dtype=torch.float64), some_lines(1, 13)
    with pytest.raises(InputError, match="singular at a line"):
        receptance(mass, nothing, nothing, torch.zeros(1, dtype=torch.complex128), force)


def relative_receptance(matrices: Matrices, s: Tensor, force: Tensor) -> Callable[..., Tensor]:
    """Scaled to motions and arguments of size 1, for finite differences; C and K stay symmetric."""
    mass, damping, stiffness = matrices

    def response(c: Tensor, k: Tensor, f: Tensor, m: Tensor, turn: Tensor) -> Tensor:
        matrices = (mass * m, damping[0] * (c + c.mT), stiffness[0] * (k + k.mT))
        return receptance(*matrices, s * turn, force * f) * 1e8

    return response


def constant(*shape: int, dtype: torch.dtype = torch.float64) -> Tensor:
    return (torch.ones(shape, dtype=dtype) / (2 if shape == (13, 13) else 1)).requires_grad_()


def test_its_first_and_second_derivatives_are_those_of_finite_differences(
    matrices: Matrices,
) -> None:
    s = torch.tensor([630j, 2500j, 9000 + 4000j], dtype=torch.complex128)
    response = relative_receptance(matrices, s, some_lines(3, 13))
    arguments = (
        constant(13, 13),
        constant(13, 13),
        constant(13, dtype=s.dtype),
        constant(13),
        constant(3, dtype=s.dtype),
    )
    assert torch.autograd.gradcheck(response, arguments, fast_mode=True)
    assert torch.autograd.gradgradcheck(response, arguments, fast_mode=True, atol=1e-4)


def test_rk4_follows_the_equations_as_its_order_promises(
    matrices: Matrices, frequency: Tensor
) -> None:
    """Halving the step divides the distance to harmonic balance by 16; lines of 1 to 2 kHz, far
    from the limit.
    """
    mass, damping, stiffness = matrices[0], matrices[1][:1] * 1e-3, matrices[2][:1]
    lines, force = frequency[10:20], some_lines(1, 10, 13)
    exact = HarmonicBalance().steady_state(mass, damping, stiffness, lines, force)
    errors = [
        relative(RK4(step).steady_state(mass, damping, stiffness, lines, force), exact)
        for step in (1e-5, 5e-6, 2.5e-6)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4, abs=0.1)
