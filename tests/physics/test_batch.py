"""Many twins in one call: each has the bits that it has alone, within a bounded memory."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from swashtwin.foundation import MPa, mm, rpm, um
from swashtwin.physics import HarmonicBalance, OrderLines, Scales, Twin, accelerations
from swashtwin.physics.twin import response
from swashtwin.pump import (
    BoreDefect,
    Fault,
    Interfaces,
    LooseSlipper,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)

RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
TILTED_FACE = TiltedBlockFace(0.2)
FAULTS: tuple[Fault | None, ...] = (
    None,
    replace(RECESS, depth=mm(0.06)),
    replace(RECESS, depth=mm(0.3), contact="literal", angle=4.5),
    replace(RECESS, contact="physical"),
    replace(RECESS, contact="lift_off"),
    replace(RECESS, depth=mm(0.2), length=mm(10), off_axis=False, gain=0.5),
    BoreDefect(um(300)),
    ValvePlateWear(um(8)),
    LooseSlipper(mm(0.2)),
    PistonWear(um(40)),
    TILTED_FACE,
)


@pytest.fixture(scope="module")
def twins(pump: Pump) -> list[Twin]:
    """Two pumps, two topologies, three speeds, and every way in which a fault acts."""
    nine_pistons = replace(pump.rotating_group, piston_count=9, piston_diameter=mm(15))
    nine_piston_pump = replace(pump, rotating_group=nine_pistons)
    nominal_values = np.array(pump.interfaces.values())
    rng = np.random.default_rng(0)

    # pump, topology and bandwidth change with periods of 4, 5 and 3 twins, which share no factor,
    # so that they vary independently of each other
    twins = []
    for i, fault in enumerate((*FAULTS, *FAULTS[:6])):
        speed = rpm(float(rng.choice([860, 870, 1500])))
        pressure = MPa(rng.uniform(5, 15))
        values = nominal_values * np.exp(rng.normal(0, 0.3, 6))
        twin = Twin(
            nine_piston_pump if i % 4 == 3 else pump,
            OperatingCondition(speed=speed, discharge_pressure=pressure),
            fault,
            Interfaces.from_values(values),
            topology="T2" if i % 5 == 1 else "T1",
            bandwidth=1500.0 + 100 * (i % 3),
            scales=Scales(mount=1 + i / 20, bearing=0.9, excitation=1 + i / 10, sensor=1.1),
        )
        twins.append(twin)

    return twins


def lines_of_twin(batch: OrderLines, index: int, twin: Twin) -> Tensor:
    """Lines of one twin of a batch at the orders that it has alone."""
    return batch.lines[index][..., np.isin(batch.orders, twin.orders)]


def test_a_twin_has_the_same_bits_in_a_batch_as_alone(twins: list[Twin]) -> None:
    with torch.no_grad():
        batch = accelerations(twins)
        for i, twin in enumerate(twins):
            assert torch.equal(lines_of_twin(batch, i, twin), twin.acceleration()), twin.fault


def test_each_twin_of_a_batch_may_have_a_batch_of_values_and_scales(twins: list[Twin]) -> None:
    selected_twins = [twins[0], twins[1], twins[5]]
    nominal_values = torch.stack([twin.values for twin in selected_twins])
    value_factors = torch.linspace(0.5, 2.0, 12, dtype=torch.float64).reshape(2, 1, 6)
    values = nominal_values[:, None, None] * value_factors
    scale_factors = [1.2, 0.8, 1.5, 2.0, 0.9, 1.1, 1.2, 0.8, 1.3, 0.7, 1.1]
    scales = torch.tensor(scale_factors, dtype=torch.float64).expand(3, 2, 1, -1)

    batch = accelerations(selected_twins, values, scales=scales)

    assert batch.lines.shape == (3, 2, 1, 3, batch.orders.size)
    for i, twin in enumerate(selected_twins):
        for j in range(2):
            alone = twin.acceleration(values[i, j, 0], scales=scales[i, j, 0])
            assert torch.equal(lines_of_twin(batch, i, twin)[j, 0], alone)


Gradients = tuple[Tensor, ...]


def differentiable_arguments(twins: list[Twin]) -> tuple[Tensor, Tensor]:
    values = torch.stack([twin.values for twin in twins])
    scales = torch.tensor([twin.scales.values() for twin in twins], dtype=torch.float64)
    return values.requires_grad_(), scales.requires_grad_()


def gradients_of_batch(twins: list[Twin]) -> Gradients:
    """Gradients of the energy of all twins, computed in one call."""
    values, scales = differentiable_arguments(twins)
    energy = accelerations(twins, values, scales=scales).lines.abs().square().sum()
    return torch.autograd.grad(energy, (values, scales))


def gradients_of_single_twins(twins: list[Twin]) -> Gradients:
    """Gradients of the energy of all twins, computed one by one."""
    values, scales = differentiable_arguments(twins)
    energies = [
        twin.acceleration(value, scales=scale).abs().square().sum()
        for twin, value, scale in zip(twins, values, scales, strict=True)
    ]
    return torch.autograd.grad(torch.stack(energies).sum(), (values, scales))


def assert_gradients_close(actual: Gradients, expected: Gradients, rtol: float) -> None:
    for actual_gradient, expected_gradient in zip(actual, expected, strict=True):
        torch.testing.assert_close(actual_gradient, expected_gradient, rtol=rtol, atol=0.0)


def test_gradients_of_a_batch_are_those_of_its_twins(twins: list[Twin]) -> None:
    # not bit for bit: how gradients are summed over the lines depends on the batch
    assert_gradients_close(gradients_of_batch(twins), gradients_of_single_twins(twins), rtol=1e-9)


class CountingSolver(HarmonicBalance):
    """Records how many lines each call solved."""

    solved: list[int]

    def steady_state(self, *arguments: Tensor) -> Tensor:
        motion = super().steady_state(*arguments)
        self.solved.append(motion.shape[:-1].numel())
        return motion


def test_a_batch_too_large_for_the_memory_is_computed_in_chunks(
    twins: list[Twin], monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = twins[1]
    values = twin.values * torch.linspace(0.5, 2.0, 40, dtype=torch.float64)[:, None]
    # a tilted face couples the lines of its twin: calls of the solver are iterations, not chunks
    linear_twins = [twin for twin in twins if twin.fault is not TILTED_FACE]
    large_batch = [
        replace(twin, scales=Scales(excitation=excitation))
        for twin in linear_twins
        for excitation in (1, 2)
    ]

    whole_values = twin.acceleration(values)
    whole_batch = accelerations(large_batch).lines
    whole_gradients = gradients_of_batch(large_batch)

    monkeypatch.setattr(response, "WORKSPACE", 300 * response._LINE_BYTES)
    solver = CountingSolver()
    object.__setattr__(solver, "solved", [])  # the solver is a frozen dataclass
    chunked_values = twin.acceleration(values, solver=solver)
    chunked_batch = accelerations(large_batch, solver=solver).lines
    chunked_gradients = gradients_of_batch(large_batch)

    assert max(solver.solved) <= 300
    assert len(solver.solved) > 8
    assert torch.equal(whole_values, chunked_values)
    assert torch.equal(whole_batch, chunked_batch)
    assert_gradients_close(whole_gradients, chunked_gradients, rtol=1e-12)
