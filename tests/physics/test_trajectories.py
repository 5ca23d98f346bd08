"""Marches through time against the textbook loop, the matrix exponential, an implicit solver, and each other."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import torch
from torch import Tensor

from swashtwin.foundation import InputError, StabilityError, mm
from swashtwin.physics import RK4, assemble
from swashtwin.physics.recess import slipper_profile, stages
from swashtwin.physics.solvers.recursion import linear_recursion
from swashtwin.physics.solvers.runge_kutta import rk4_limit, state_matrix
from swashtwin.physics.solvers.trajectories import (
    first_order_hold_trajectory,
    rk4_trajectory,
    rk4_trajectory_of_lines,
    rk4_trajectory_with_breaks,
)
from swashtwin.pump import Pump, SwashPlateDefect

Matrices = tuple[Tensor, Tensor, Tensor]


@pytest.fixture(scope="module")
def matrices(pump: Pump) -> Matrices:
    structure = assemble(pump)
    values = torch.tensor(pump.interfaces.values(), dtype=torch.float64)
    return structure.mass, structure.damping(values), structure.stiffness(values)


@pytest.fixture(scope="module")
def soft(matrices: Matrices) -> Matrices:
    """Without the films' damping, so that steps are as long as the highest mode allows, not the fastest decay."""
    mass, damping, stiffness = matrices
    return mass, damping * 1e-3, stiffness


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.as_tensor(np.random.default_rng(seed).normal(size=shape))


def random_start(seed: int = 1) -> Tensor:
    return random(26, seed=seed) * torch.tensor([1e-6] * 13 + [1e-3] * 13)


FREQUENCY = 90.0 * torch.tensor([0.0, 1.0, 7.0, 14.0, 49.0], dtype=torch.float64)
LINES = random(5, 13, seed=2) + 1j * random(5, 13, seed=3)


def written_out(times: Tensor) -> Tensor:
    """Forces of `LINES` over time."""
    return (torch.exp(1j * times[:, None] * FREQUENCY) @ LINES).real


def textbook(matrices: Matrices, force: Tensor, step: float, start: Tensor) -> np.ndarray:
    """The recursion k1...k4 as in any textbook, at the force's half steps."""
    state = state_matrix(*matrices).numpy()
    push = np.concatenate([np.zeros(force.shape), force.numpy() / matrices[0].diagonal().numpy()], axis=1)
    x, loop = start.numpy(), [start.numpy()]
    for i in range(len(force) // 2):
        k1 = state @ x + push[2 * i]
        k2 = state @ (x + step / 2 * k1) + push[2 * i + 1]
        k3 = state @ (x + step / 2 * k2) + push[2 * i + 1]
        k4 = state @ (x + step * k3) + push[2 * i + 2]
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        loop.append(x)
    return np.array(loop)


def relative(actual: Tensor, expected: Tensor | np.ndarray) -> float:
    """Largest difference in any coordinate, over the largest value that this coordinate takes."""
    other = torch.as_tensor(expected)
    return float(((actual - other).abs().amax(-2) / other.abs().amax(-2)).max())


def test_a_recursion_is_the_loop_that_defines_it() -> None:
    phi, driven, start = 0.18 * random(5, 5), random(40, 5, seed=1), random(5, seed=2)
    x = start
    for row, state in zip(driven, linear_recursion(phi, driven, start)[1:], strict=True):
        x = phi @ x + row
        torch.testing.assert_close(state, x, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("n_steps", [1, 2, 99, 100, 101])
def test_single_precision_marches_in_blocks_to_the_same_states(n_steps: int) -> None:
    phi, driven, start = 0.18 * random(2, 5, 5), random(3, 1, n_steps, 5, seed=1), random(5, seed=2)
    exact = linear_recursion(phi, driven, start)
    actual = linear_recursion(phi.float(), driven.float(), start.float())
    assert (actual.dtype, actual.shape) == (torch.float32, (3, 2, n_steps + 1, 5))
    assert float((actual - exact).abs().max()) < 2e-6 * float(exact.abs().max())


def test_a_batch_of_recursions_gives_the_bits_of_its_members() -> None:
    phi, driven, start = 0.18 * random(2, 5, 5), random(3, 1, 50, 5, seed=1), random(5, seed=2)
    together = linear_recursion(phi, driven, start)
    assert torch.equal(together[2, 1], linear_recursion(phi[1], driven[2, 0], start))


@pytest.mark.parametrize("single", [False, True], ids=["compiled", "blocks"])
def test_a_recursion_has_exact_derivatives_of_both_orders(single: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if single:  # the way of other devices and precisions, in double so that differences resolve it
        import swashtwin.physics.solvers.recursion as module

        monkeypatch.setattr(module, "COMPILED", torch.float16)
    arguments = tuple(
        part.requires_grad_() for part in (0.3 * random(2, 3, 3), random(2, 7, 3, seed=1), random(2, 3, seed=2))
    )
    assert torch.autograd.gradcheck(linear_recursion, arguments)
    assert torch.autograd.gradgradcheck(linear_recursion, arguments)


def test_rk4_gives_the_numbers_of_the_textbook_loop_transient_included(matrices: Matrices) -> None:
    step, n, start = 0.8e-6, 20_000, random_start()
    force = written_out(torch.arange(2 * n + 1, dtype=torch.float64) * step / 2)
    loop = textbook(matrices, force, step, start)
    assert relative(rk4_trajectory(*matrices, force, step, start), loop) < 1e-10
    assert relative(rk4_trajectory_of_lines(*matrices, FREQUENCY, LINES, step, n, start), loop) < 1e-10


def test_rk4_comes_to_what_an_implicit_solver_finds(matrices: Matrices) -> None:
    """Radau at rtol 1e-10, a stiff solver of fifth order that shares nothing with ours."""
    mass, duration, n, start = matrices[0].diagonal().numpy(), 1e-3, 1250, random_start()
    state, frequency, lines = state_matrix(*matrices).numpy(), FREQUENCY.numpy(), LINES.numpy()

    def rate(time: float, x: np.ndarray) -> np.ndarray:
        push = (np.exp(1j * frequency * time) @ lines).real / mass
        return state @ x + np.concatenate([np.zeros(13), push])

    solution = scipy.integrate.solve_ivp(
        rate, (0, duration), start.numpy(), "Radau", rtol=1e-10, atol=1e-18, jac=state, t_eval=[duration]
    )
    ours = rk4_trajectory_of_lines(*matrices, FREQUENCY, LINES, duration / n, n, start)[-1]
    np.testing.assert_allclose(ours.numpy(), solution.y[:, -1], rtol=1e-7, atol=1e-9 * np.abs(solution.y[:13]).max())


def test_a_march_under_lines_settles_on_the_steady_state_of_rk4(matrices: Matrices) -> None:
    """From any start: what is left of the start's error is Phi^n times it, and here that has died away."""
    mass, damping, stiffness = matrices[0], matrices[1] * 0.01 + 1000 * matrices[0], matrices[2]
    step, n = 2e-5, 3000
    states = rk4_trajectory_of_lines(mass, damping, stiffness, FREQUENCY, LINES, step, n, random_start())
    steady = RK4(step).steady_state(mass, damping, stiffness, FREQUENCY, LINES)
    times = step * torch.arange(n - 500, n + 1, dtype=torch.float64)
    expected = (torch.exp(1j * times[:, None] * FREQUENCY) @ steady).real
    assert relative(states[n - 500 :, :13], expected) < 1e-9


def test_rk4_is_of_fourth_order(soft: Matrices) -> None:
    """Fitted slope 4 +- 0.2 against the matrix exponential, in free motion."""
    start = random(26, seed=1)
    start[13:] *= 1e4  # velocities of the size that such displacements bring
    duration, errors, steps = 2e-3, [], []
    exact = torch.as_tensor(scipy.linalg.expm(state_matrix(*soft).numpy() * duration)) @ start
    for n in (150, 250, 400, 650):
        force = torch.zeros(2 * n + 1, 13, dtype=torch.float64)
        end = rk4_trajectory(*soft, force, duration / n, start)[-1]
        steps.append(duration / n)
        errors.append(float((end - exact).norm() / exact.norm()))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(4, abs=0.2)


def entry_force(pump: Pump) -> tuple[Callable[[Tensor], Tensor], list[float], float]:
    """K H + C dH/dt of one slipper in a half-sine recess at 860 rev/min; its jumps and bends; a time after it."""
    defect = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    speed, stage = 90.06, stages(pump, defect)
    begin = stage.total / 2 + 0.02
    direction = assemble(pump).slipper_vector

    def force(times: Tensor) -> Tensor:
        height, slope = slipper_profile(pump, defect, defect.angle - begin + speed * times.numpy())
        return torch.as_tensor(1e8 * height + 1.86e6 * speed * slope)[:, None] * direction

    bends = (-stage.total / 2, stage.rise - stage.total / 2, stage.total / 2 - stage.rise, stage.total / 2)
    return force, [(begin + bend) / speed for bend in bends], (2 * begin) / speed


def test_aligned_steps_keep_rk4s_fourth_order_across_the_jumps_of_a_half_sine_recess(
    pump: Pump, soft: Matrices
) -> None:
    """Fitted slopes: 4 where steps end at the jumps, 1 where they run across."""
    force, breaks, duration = entry_force(pump)
    reference = rk4_trajectory_with_breaks(*soft, force, 5e-7, duration, breaks).states[-1]
    steps = np.geomspace(16e-6, 3e-6, 8)
    slopes: dict[bool, float] = {}
    errors: dict[bool, np.ndarray] = {}
    for aligned in (True, False):
        ends = [
            rk4_trajectory_with_breaks(*soft, force, step, duration, breaks if aligned else []).states[-1]
            for step in steps
        ]
        errors[aligned] = np.array([float((end - reference).norm() / reference.norm()) for end in ends])
        slopes[aligned] = np.polyfit(np.log(steps), np.log(errors[aligned]), 1)[0]
    assert slopes[True] == pytest.approx(4, abs=0.3)
    assert slopes[False] == pytest.approx(1, abs=0.7)  # where in a step the jumps fall is chance
    assert errors[False][-1] > 100 * errors[True][-1]


def test_pieces_meet_at_the_breaks_and_no_step_exceeds_the_one_asked_for(pump: Pump, soft: Matrices) -> None:
    force, breaks, duration = entry_force(pump)
    run = rk4_trajectory_with_breaks(*soft, force, 30e-6, duration, [*breaks, breaks[0], -1.0, 2 * duration])
    assert run.states.shape == (len(run.time), 26)
    assert float(run.time[0]) == 0.0
    assert float(run.time[-1]) == pytest.approx(duration, rel=1e-12)
    steps = run.time.diff()
    assert 0 < float(steps.min()) <= float(steps.max()) <= 30e-6 * (1 + 1e-6)
    for each in breaks:
        assert float((run.time - each).abs().min()) < 1e-15


def test_without_jumps_pieces_make_no_difference(soft: Matrices) -> None:
    step, n = 20e-6, 200
    force = written_out(torch.arange(2 * n + 1, dtype=torch.float64) * step / 2)
    whole = rk4_trajectory(*soft, force, step, random_start())
    cut = rk4_trajectory_with_breaks(*soft, written_out, step, n * step, [50 * step, 120 * step], random_start())
    assert relative(cut.states, whole) < 1e-8


def test_first_order_hold_is_exact_for_ramps_and_second_order_for_sines(matrices: Matrices) -> None:
    grid = torch.arange(4097, dtype=torch.float64) * 2.5e-6
    fine = first_order_hold_trajectory(*matrices, written_out(grid), 2.5e-6)
    errors = []
    for factor in (8, 16, 32):
        coarse = first_order_hold_trajectory(*matrices, written_out(grid[::factor]), 2.5e-6 * factor)
        errors.append(float((coarse - fine[::factor])[:, :13].abs().max()))
    assert np.log2(errors[1] / errors[0]) == pytest.approx(2, abs=0.2)
    assert np.log2(errors[2] / errors[1]) == pytest.approx(2, abs=0.2)
    ramp = torch.linspace(0, 1, 41, dtype=torch.float64)[:, None].expand(41, 13).contiguous()
    once = first_order_hold_trajectory(*matrices, ramp[[0, 40]], 1e-3)
    often = first_order_hold_trajectory(*matrices, ramp, 1e-3 / 40)
    torch.testing.assert_close(once[-1], often[-1], rtol=1e-8, atol=1e-20)


def test_first_order_hold_is_the_matrix_exponential_where_nothing_pushes(matrices: Matrices) -> None:
    start, step = random_start(), 1 / 51200
    states = first_order_hold_trajectory(*matrices, torch.zeros(101, 13, dtype=torch.float64), step, start)
    scale = torch.tensor([1.0] * 13 + [1e-4] * 13, dtype=torch.float64)  # displacements of the size of velocities
    state = (scale[:, None] * state_matrix(*matrices) / scale).numpy()
    exact = scipy.linalg.expm(state * step * 100) @ (scale * start).numpy()
    np.testing.assert_allclose((scale * states[-1]).numpy(), exact, rtol=0, atol=1e-9 * np.abs(exact).max())


def test_a_run_may_be_marched_in_pieces(matrices: Matrices) -> None:
    force, step = written_out(torch.arange(101, dtype=torch.float64) * 2e-5), 2e-5
    whole = first_order_hold_trajectory(*matrices, force, step, random_start())
    first = first_order_hold_trajectory(*matrices, force[:41], step, random_start())
    second = first_order_hold_trajectory(*matrices, force[40:], step, first[-1])
    assert torch.equal(torch.cat([first, second[1:]]), whole)


def batched(matrices: Matrices) -> Matrices:
    mass, damping, stiffness = matrices
    factors = torch.tensor([0.5, 1.0, 0.8], dtype=torch.float64)[:, None, None]
    return mass, factors * damping, stiffness / factors


def march(name: str, matrices: Matrices, force: Tensor, start: Tensor | None) -> Tensor:
    """Thirty steps, by name."""
    step = 0.4e-6
    if name == "lines":
        return rk4_trajectory_of_lines(*matrices, FREQUENCY, force[..., :5, :] + 0j, step, 30, start)
    return {"rk4": rk4_trajectory, "hold": first_order_hold_trajectory}[name](*matrices, force, step, start)


@pytest.mark.parametrize("name", ["rk4", "lines", "hold"])
def test_a_batch_of_marches_gives_the_bits_of_its_members(matrices: Matrices, name: str) -> None:
    several, forces, starts = batched(matrices), random(2, 1, 61, 13), torch.stack([random_start(i) for i in range(3)])
    together = march(name, several, forces, starts)
    for i in range(2):
        for j in range(3):
            alone = march(name, (several[0], several[1][j], several[2][j]), forces[i, 0], starts[j])
            assert torch.equal(together[i, j], alone)


@pytest.mark.parametrize("name", ["rk4", "lines", "hold"])
def test_marches_have_exact_gradients(matrices: Matrices, name: str) -> None:
    mass, damping, stiffness = matrices
    size = march(name, matrices, random(61, 13), random_start()).abs().amax(dim=0)

    def states(c: Tensor, k: Tensor, q: Tensor, x: Tensor) -> Tensor:
        moved = march(name, (mass, damping * c, stiffness * k), random(61, 13) * q, random_start() * x)
        return moved[[1, 2, 17, -1]] / size

    arguments = tuple(torch.ones(shape, dtype=torch.float64, requires_grad=True) for shape in ((), (), 13, 26))
    assert torch.autograd.gradcheck(states, arguments, rtol=1e-4)


def test_a_march_with_breaks_has_exact_gradients(pump: Pump, soft: Matrices) -> None:
    mass, damping, stiffness = soft
    force, breaks, duration = entry_force(pump)

    def end(c: Tensor, k: Tensor, q: Tensor) -> Tensor:
        changed = mass, damping * c, stiffness * k
        run = rk4_trajectory_with_breaks(*changed, lambda times: force(times) * q, 6e-5, duration, breaks)
        return run.states[-1] / 1e-4

    arguments = tuple(torch.ones((), dtype=torch.float64, requires_grad=True) for _ in range(3))
    assert torch.autograd.gradcheck(end, arguments, rtol=1e-4)


def test_what_a_gradient_keeps_of_twenty_thousand_steps_is_states(matrices: Matrices) -> None:
    """One array of states (4.2 MB), and what leads to it: nothing of the size of the forces over time."""
    mass, damping, stiffness = (part.clone().requires_grad_() for part in matrices)
    sizes: dict[int, int] = {}

    def note(tensor: Tensor) -> Tensor:
        sizes[tensor.untyped_storage().data_ptr()] = tensor.untyped_storage().nbytes()
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(note, lambda tensor: tensor):
        states = rk4_trajectory_of_lines(mass, damping, stiffness, FREQUENCY, LINES, 0.8e-6, 20_000)
    assert sum(sizes.values()) < 1.5 * states.untyped_storage().nbytes()


def test_marches_in_single_precision_are_off_by_no_more_than_is_said(matrices: Matrices) -> None:
    single = [part.float() for part in matrices]
    lines = FREQUENCY.float(), LINES.to(torch.complex64)
    actual = rk4_trajectory_of_lines(*single, *lines, 0.8e-6, 20_000, random_start().float())
    exact = rk4_trajectory_of_lines(*matrices, FREQUENCY, LINES, 0.8e-6, 20_000, random_start())
    assert actual.dtype == torch.float32
    assert 1e-6 < relative(actual.double(), exact) < 1e-3
    force = written_out(torch.arange(2001, dtype=torch.float64) * 2e-5)
    states = first_order_hold_trajectory(*single, force.float(), 2e-5)
    assert states.dtype == torch.float32
    assert relative(states.double(), first_order_hold_trajectory(*matrices, force, 2e-5)) < 1e-3


def test_marches_stay_on_the_device_of_their_inputs(matrices: Matrices) -> None:
    mass, damping, stiffness = (part.to("meta") for part in batched(matrices))
    states = first_order_hold_trajectory(mass, damping, stiffness, random(9, 13).to("meta"), 1e-5)
    assert (states.device.type, states.shape) == ("meta", (3, 9, 26))


def test_wrong_marches_are_refused(matrices: Matrices) -> None:
    rest = torch.zeros(3, 13, dtype=torch.float64)
    with pytest.raises(InputError, match="odd number"):
        rk4_trajectory(*matrices, rest[:2], 5e-7)
    with pytest.raises(InputError, match=r"n_steps \(0\)"):
        rk4_trajectory_of_lines(*matrices, FREQUENCY, LINES, 5e-7, 0)
    with pytest.raises(StabilityError, match=r"5 us lies above the stability limit 1 us"):
        rk4_trajectory(*matrices, rest, 5e-6)
    with pytest.raises(StabilityError, match="stability limit"):
        rk4_trajectory_of_lines(*matrices, FREQUENCY, LINES, 5e-6, 4)
    with pytest.raises(StabilityError, match="stability limit"):
        rk4_trajectory_with_breaks(*matrices, written_out, 5e-6, 1e-4, [])
    mass, damping, stiffness = matrices
    for growing in ((mass, -damping, stiffness), (mass, damping, -stiffness)):
        with pytest.raises(StabilityError, match="own motion grows"):
            rk4_limit(state_matrix(*growing))
        with pytest.raises(StabilityError, match="own motion grows"):
            RK4().steady_state(*growing, FREQUENCY, LINES)
    assert math.isclose(rk4_limit(state_matrix(*matrices)), 1e-6, rel_tol=2e-3)
