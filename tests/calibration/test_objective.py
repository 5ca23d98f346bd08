"""Losses, their derivatives, and the values that a measurement can determine."""

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

NO_NUISANCES = Nuisances()
DEFECT = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))


def ideal_objective(
    twin: Twin, bounds: float = 10.0, nuisances: Nuisances = NO_NUISANCES
) -> Objective:
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
    def losses(factors: Tensor) -> tuple[Tensor, Tensor]:
        point = point_at(objective, factors * twin.values)
        spectrum_loss = objective.spectrum_loss(point, solver=solver)
        weighted_loss = objective.weighted_loss(point, solver=solver)
        return spectrum_loss, weighted_loss

    # away from the twin itself, whose losses vanish with a kink
    factors = torch.tensor([0.7, 1.4, 1.6, 0.7, 2.5, 0.8], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(losses, (factors,), rtol=1e-4)


@pytest.mark.parametrize(
    "nuisances", [Nuisances.typical(), Nuisances.housing()], ids=["typical", "housing"]
)
def test_the_sensitivities_are_those_of_central_differences(
    twin: Twin, nuisances: Nuisances
) -> None:
    objective = ideal_objective(twin, nuisances=nuisances)
    n_unknowns = len(objective.start)
    generator = np.random.default_rng(0)
    offset = 0.2 * objective.unknowns.deviation * generator.standard_normal(n_unknowns)
    point = objective.start + torch.as_tensor(offset)

    _, slope = objective.sensitivity(point)

    step = 1e-5
    for i, direction in enumerate(torch.eye(n_unknowns, dtype=torch.float64)):
        above = objective.observables(point + step * direction)
        below = objective.observables(point - step * direction)
        torch.testing.assert_close(slope[:, i], (above - below) / (2 * step), rtol=1e-6, atol=1e-7)


def test_the_spectrum_loss_vanishes_only_at_the_twin_itself(
    twin: Twin, objective: Objective
) -> None:
    assert objective.spectrum_loss(objective.start).item() < 1e-9
    assert objective.spectrum_loss(point_at(objective, 1.1 * twin.values)).item() > 1e-3


def test_the_gradient_at_the_minimum_is_finite(twin: Twin, objective: Objective) -> None:
    # the root of a sum of squares has none there
    values = twin.values.requires_grad_()
    objective.spectrum_loss(point_at(objective, values)).backward()
    assert values.grad is not None
    assert torch.isfinite(values.grad).all()


# docs/explanation/physics.md, section 6: relative change of the linear spectrum, 3 axes, 5 kHz
@pytest.mark.parametrize(
    ("index", "change"),
    [(0, 0.024), (1, 0.0002), (2, 0.24), (3, 0.12), (4, 0.36), (5, 0.17)],
    ids=["C_sw", "K_sw", "C_v", "K_v", "C_Hz", "K_Hz"],
)
def test_doubling_a_value_changes_the_spectrum_as_in_the_physics_notes(
    pump: Pump, at_15: OperatingCondition, index: int, change: float
) -> None:
    twin = Twin(pump, at_15, DEFECT, bandwidth=5000)
    objective = ideal_objective(twin)
    values = twin.values
    values[index] *= 2
    loss = objective.spectrum_loss(point_at(objective, values)).item()
    # the notes give one or two digits
    assert loss == pytest.approx(change, rel=0.2)


# docs/explanation/physics.md, section 6, rows T1 P0 and thick film: no prior on the values, 3 axes,
# 5 kHz
@pytest.mark.parametrize(
    ("c_sw", "nuisances", "expected"),
    [
        (1.86e6, NO_NUISANCES, [0.60, 26, 0.031, 0.16, 0.018, 0.14]),
        (1.86e6, Nuisances.typical(), [0.99, 28, 0.038, 0.16, 0.047, 0.17]),
        (9e4, NO_NUISANCES, [0.039, 0.07, 0.029, 0.15, 0.020, 0.13]),
    ],
    ids=["paper", "paper_with_nuisances", "thick_film"],
)
def test_the_deviations_are_those_of_the_physics_notes(
    pump: Pump, at_15: OperatingCondition, c_sw: float, nuisances: Nuisances, expected: list[float]
) -> None:
    values = np.array(pump.interfaces.values())
    values[0] = c_sw
    twin = Twin(pump, at_15, DEFECT, Interfaces.from_values(values), bandwidth=5000)
    # bounds so wide that they are no prior
    objective = ideal_objective(twin, bounds=1e100, nuisances=nuisances)

    covariance = posterior_covariance(objective, objective.unknowns.start)

    assert np.sqrt(np.diag(covariance))[:6] == pytest.approx(expected, rel=0.06)


def test_the_boundary_loss_is_zero_within_the_bounds(twin: Twin) -> None:
    space = build_search_space(twin)
    assert space.boundary_loss(twin.values * 9.9).item() == 0


def test_the_boundary_loss_grows_with_the_distance_from_the_bounds(twin: Twin) -> None:
    space = build_search_space(twin)
    values = twin.values
    # half of the upper bound above it, averaged over the six values
    values[2] *= 15
    assert space.boundary_loss(values).item() == pytest.approx(0.5 / 6)

    values[2] *= -1
    assert space.boundary_loss(values).item() > 1 / 6


def test_bounds_may_be_a_factor_and_are_ten_by_default(twin: Twin) -> None:
    nominal = twin.values.numpy()
    np.testing.assert_allclose(build_search_space(twin).upper, 10 * nominal)
    np.testing.assert_allclose(build_search_space(twin, 3.0).lower, nominal / 3)


def test_bounds_of_single_values_are_given_by_symbol_or_name(twin: Twin) -> None:
    space = build_search_space(twin, {"C_sw": (5e5, 5e6), PARAMETERS[3]: (1e8, 2e8)})
    assert (space.lower[0], space.upper[0]) == (5e5, 5e6)
    assert (space.lower[3], space.upper[3]) == (1e8, 2e8)
    assert space.upper[1] == pytest.approx(10 * twin.values.numpy()[1])


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (0.5, "a factor above 1"),
        ({"C_x": (1.0, 2.0)}, "is not an interface value"),
        ({"C_v": (1.0, 2.0)}, "contain the nominal value 60000"),
        ({"C_v": (-1.0, 1e6)}, "must be positive"),
    ],
    ids=["factor below 1", "unknown symbol", "nominal value outside", "negative"],
)
def test_impossible_bounds_are_refused(twin: Twin, bounds: float | dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_search_space(twin, bounds)
