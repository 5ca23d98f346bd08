"""Many twins in one call: each as by itself to the last bit, whatever is computed beside it, and
within the memory.
"""

import itertools
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

FAULTS: tuple[Fault | None, ...] = (
    None,
    SwashPlateDefect(depth=mm(0.06), length=mm(30), width=mm(24)),
    SwashPlateDefect(depth=mm(0.3), length=mm(30), width=mm(24), contact="literal", angle=4.5),
    SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="physical"),
    SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="lift_off"),
    SwashPlateDefect(depth=mm(0.2), length=mm(10), width=mm(24), off_axis=False, gain=0.5),
    BoreDefect(um(300)),
    ValvePlateWear(um(8)),
    LooseSlipper(mm(0.2)),
    PistonWear(um(40)),
    TiltedBlockFace(0.2),
)


@pytest.fixture(scope="module")
def twins(pump: Pump) -> list[Twin]:
    """Two pumps, two topologies, three speeds, and every way in which a fault acts."""
    group = replace(pump.rotating_group, piston_count=9, piston_diameter=mm(15))
    nine = replace(pump, rotating_group=group)
    rng = np.random.default_rng(0)
    twins = []
    for i, fault in enumerate((*FAULTS, *FAULTS[:6])):
        speed, pressure = rpm(float(rng.choice([860, 870, 1500]))), MPa(rng.uniform(5, 15))
        values = np.array(pump.interfaces.values()) * np.exp(rng.normal(0, 0.3, 6))
        twins.append(
            Twin(
                nine if i % 4 == 3 else pump,
                OperatingCondition(speed=speed, discharge_pressure=pressure),
                fault,
                Interfaces.from_values(values),
                topology="T2" if i % 5 == 1 else "T1",
                bandwidth=1500.0 + 100 * (i % 3),
                scales=Scales(mount=1 + i / 20, bearing=0.9, excitation=1 + i / 10, sensor=1.1),
            )
        )
    return twins


def own_lines(batch: OrderLines, index: int, twin: Twin) -> Tensor:
    return batch.lines[index][..., np.isin(batch.orders, twin.orders)]


def test_each_twin_of_a_batch_has_the_bits_it_has_by_itself(twins: list[Twin]) -> None:
    with torch.no_grad():
        batch = accelerations(twins)
        for i, twin in enumerate(twins):
            assert torch.equal(own_lines(batch, i, twin), twin.acceleration()), twin.fault


def test_values_and_scales_of_each_twin_may_be_a_batch_themselves(twins: list[Twin]) -> None:
    some = [twins[0], twins[1], twins[5]]
    spread = torch.linspace(0.5, 2.0, 12, dtype=torch.float64).reshape(2, 1, 6)
    values = torch.stack([twin.values for twin in some])[:, None, None] * spread
    factors = [1.2, 0.8, 1.5, 2.0, 0.9, 1.1, 1.2, 0.8, 1.3, 0.7, 1.1]
    scales = torch.tensor(factors, dtype=torch.float64).expand(3, 2, 1, -1)
    batch = accelerations(some, values, scales=scales)
    assert batch.lines.shape == (3, 2, 1, 3, batch.orders.size)
    for i, j in itertools.product(range(3), range(2)):
        alone = some[i].acceleration(values[i, j, 0], scales=scales[i, j, 0])
        assert torch.equal(own_lines(batch, i, some[i])[j, 0], alone)


def gradients(twins: list[Twin], together: bool) -> tuple[Tensor, ...]:
    values = torch.stack([twin.values for twin in twins]).requires_grad_()
    scales = torch.tensor(
        [twin.scales.values() for twin in twins], dtype=torch.float64
    ).requires_grad_()
    if together:
        energy = accelerations(twins, values, scales=scales).lines.abs().square().sum()
    else:
        parts = [
            twin.acceleration(v, scales=s) for twin, v, s in zip(twins, values, scales, strict=True)
        ]
        energy = torch.stack([part.abs().square().sum() for part in parts]).sum()
    return torch.autograd.grad(energy, (values, scales))


def test_gradients_of_a_batch_are_those_of_its_twins(twins: list[Twin]) -> None:
    for batch, alone in zip(gradients(twins, True), gradients(twins, False), strict=True):
        torch.testing.assert_close(batch, alone, rtol=1e-9, atol=0.0)


class Counting(HarmonicBalance):
    """Remembers how many lines each call solved."""

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
    many = [
        replace(twin, scales=Scales(excitation=k))
        for twin in twins
        if twin.fault is not FAULTS[-1]
        for k in (1, 2)
    ]
    whole = twin.acceleration(values), accelerations(many).lines, *gradients(many, True)
    monkeypatch.setattr(response, "WORKSPACE", 300 * response._LINE_BYTES)
    solver = Counting()
    object.__setattr__(solver, "solved", [])
    chunked = (
        twin.acceleration(values, solver=solver),
        accelerations(many, solver=solver).lines,
        *gradients(many, True),
    )
    assert max(solver.solved) <= 300
    assert len(solver.solved) > 8
    for before, after in zip(whole[:2], chunked[:2], strict=True):
        assert torch.equal(before, after)
    for before, after in zip(whole[2:], chunked[2:], strict=True):
        torch.testing.assert_close(before, after, rtol=1e-12, atol=0.0)
