"""Losses, their derivatives, and what a measurement can determine."""

import numpy as np
import pytest
import torch
from torch import Tensor

from swashtwin.calibration import Nuisances, Objective, build_objective
from swashtwin.calibration.measurement import Measurement
from swashtwin.calibration.posterior import posterior_covariance
from swashtwin.calibration.unknowns import build_search_space
from swashtwin.foundation import InputError, mm
from swashtwin.physics import RK4, HarmonicBalance, SteadySolver, Twin
from swashtwin.pump import PARAMETERS, Interfaces, OperatingCondition, Pump, SwashPlateDefect

NONE, USUAL = Nuisances(), Nuisances.typical()
DEFECT = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))


def ideal_objective(twin: Twin, bounds: float = 10.0, nuisances: Nuisances = NONE) -> Objective:
    """Objective whose measurement is the twin's own lines, without scatter."""
    orders = 7 * np.arange(1, twin.n_lines // 7 + 1)
    lines = twin.acceleration().abs().numpy()[:, np.isin(twin.orders, orders)]
    measurement = Measurement(
        channels=twin.pump.channels,
        orders=orders,
        amplitude=lines,
        deviation=np.zeros_like(lines),
        recordings=(),
        excluded_recordings=(),
        band=(0.0, twin.bandwidth),
    )
    return build_objective(twin, measurement, bounds, nuisances)


def point_at(objective: Objective, values: Tensor) -> Tensor:
    """Point of the six `values`; the other coordinates are the twin's."""
    return torch.cat([values.log(), objective.start[6:]], dim=-1)


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, DEFECT, bandwidth=1000)


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    return ideal_objective(twin)


@pytest.mark.parametrize(
    "solver", [HarmonicBalance(), RK4(step=0.5e-6)], ids=["harmonic_balance", "rk4"]
)
def test_the_spectrum_losses_have_exact_gradients(
    twin: Twin, objective: Objective, solver: SteadySolver
) -> None:
    def losses(relative: Tensor) -> tuple[Tensor, Tensor]:
        values = relative * twin.values
        point = point_at(objective, values)
        return objective.spectrum_loss(point, solver=solver), objective.weighted_loss(
            point, solver=solver
        )

    point = torch.tensor([0.7, 1.4, 1.6, 0.7, 2.5, 0.8], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(losses, (point,), rtol=1e-4)


@pytest.mark.parametrize(
    "nuisances", [Nuisances.typical(), Nuisances.housing()], ids=["usual", "housing"]
)
def test_the_sensitivities_are_those_of_central_differences(
    twin: Twin, nuisances: Nuisances
) -> None:
    objective = ideal_objective(twin, nuisances=nuisances)
    generator = np.random.default_rng(0)
    point = objective.start + 0.2 * torch.as_tensor(
        objective.unknowns.deviation * generator.standard_normal(len(objective.start))
    )
    _, slope = objective.sensitivity(point)
    step = 1e-5
    for i in range(len(point)):
        shift = step * torch.eye(len(point), dtype=torch.float64)[i]
        difference = objective.observables(point + shift) - objective.observables(point - shift)
        torch.testing.assert_close(slope[:, i], difference / (2 * step), rtol=1e-6, atol=1e-7)


def test_the_losses_vanish_only_at_the_twin_itself(twin: Twin, objective: Objective) -> None:
    assert objective.spectrum_loss(objective.start).item() < 1e-9
    assert objective.spectrum_loss(point_at(objective, 1.1 * twin.values)).item() > 1e-3
    values = twin.values.requires_grad_()
    objective.spectrum_loss(point_at(objective, values)).backward()
    assert values.grad is not None
    assert torch.isfinite(values.grad).all()


def test_doubling_a_value_changes_the_spectrum_as_the_physics_notes_say(
    pump: Pump, at_15: OperatingCondition
) -> None:
    """docs/explanation/physics.md, section 6: relative change of the linear spectrum, 3 axes, 5
    kHz.
    """
    twin = Twin(pump, at_15, DEFECT, bandwidth=5000)
    objective = ideal_objective(twin)
    changes = []
    for i in range(6):
        values = twin.values
        values[i] *= 2
        changes.append(objective.spectrum_loss(point_at(objective, values)).item())
    assert changes == pytest.approx([0.024, 0.0002, 0.24, 0.12, 0.36, 0.17], rel=0.2)


@pytest.mark.parametrize(
    ("film", "nuisances", "expected"),
    [
        (1.86e6, NONE, [0.60, 26, 0.031, 0.16, 0.018, 0.14]),
        (1.86e6, USUAL, [0.99, 28, 0.038, 0.16, 0.047, 0.17]),
        (9e4, NONE, [0.039, 0.07, 0.029, 0.15, 0.020, 0.13]),
    ],
    ids=["paper", "paper_with_nuisances", "thick_film"],
)
def test_the_deviations_are_those_of_the_physics_notes(
    pump: Pump, at_15: OperatingCondition, film: float, nuisances: Nuisances, expected: list[float]
) -> None:
    """docs/explanation/physics.md, section 6, rows T1 P0 and thick film: no prior on the values, 3
    axes, 5 kHz.
    """
    values = np.array(pump.interfaces.values())
    values[0] = film
    twin = Twin(pump, at_15, DEFECT, Interfaces.from_values(values), bandwidth=5000)
    objective = ideal_objective(twin, bounds=1e100, nuisances=nuisances)
    covariance = posterior_covariance(objective, objective.unknowns.start)
    assert np.sqrt(np.diag(covariance))[:6] == pytest.approx(expected, rel=0.06)


def test_the_boundary_loss_is_zero_within_the_bounds_and_grows_beyond(twin: Twin) -> None:
    space = build_search_space(twin)
    assert space.boundary_loss(twin.values * 9.9).item() == 0
    beyond = twin.values
    beyond[2] *= 15
    assert space.boundary_loss(beyond).item() == pytest.approx(0.5 / 6)
    beyond[2] *= -1
    assert space.boundary_loss(beyond).item() > 1 / 6


def test_bounds_are_given_as_a_factor_or_by_name_or_letter(twin: Twin) -> None:
    nominal = twin.values.numpy()
    np.testing.assert_allclose(build_search_space(twin).upper, 10 * nominal)
    np.testing.assert_allclose(build_search_space(twin, 3.0).lower, nominal / 3)
    named = build_search_space(twin, {"C_sw": (5e5, 5e6), PARAMETERS[3]: (1e8, 2e8)})
    assert (named.lower[0], named.upper[0], named.lower[3], named.upper[3]) == (5e5, 5e6, 1e8, 2e8)
    assert named.upper[1] == pytest.approx(10 * nominal[1])


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (0.5, "a factor above 1"),
        ({"C_x": (1.0, 2.0)}, "is not an interface value"),
        ({"C_v": (1.0, 2.0)}, "contain the nominal value 60000"),
        ({"C_v": (-1.0, 1e6)}, "must be positive"),
    ],
)
def test_impossible_bounds_are_refused(twin: Twin, bounds: float | dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_search_space(twin, bounds)
