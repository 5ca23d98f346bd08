"""Ports that open a little earlier or later than drawn."""

import pytest
import torch

from swashtwin.foundation import deg
from swashtwin.physics import PortTiming, Twin
from swashtwin.pump import OperatingCondition, Pump


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, bandwidth=2600)


@pytest.mark.parametrize("angles", [(-0.9, 0.4), (0.6, -1.3), (0.12, 0.12)])
def test_interpolated_lines_are_those_of_a_pump_with_these_ports(
    twin: Twin, angles: tuple[float, float]
) -> None:
    timing = PortTiming(*(deg(angle) for angle in angles))
    exact = Twin(timing.apply(twin.pump), twin.condition, bandwidth=2600).acceleration()
    interpolated = twin.acceleration(port_timing=torch.tensor(timing.values()).double())

    assert (interpolated - exact).abs().max() < 0.01 * exact.abs().max()


def test_a_twin_with_these_ports_is_that_pump(twin: Twin) -> None:
    timing = PortTiming(discharge_open=deg(0.7), suction_open=deg(-0.3))
    exact = Twin(timing.apply(twin.pump), twin.condition, bandwidth=2600).acceleration()
    kept = Twin(twin.pump, twin.condition, bandwidth=2600, port_timing=timing)

    assert torch.equal(kept.acceleration(), exact)
    # angles are absolute, whatever those of the twin
    angles = torch.tensor(timing.values(), dtype=torch.float64)
    assert torch.allclose(kept.acceleration(port_timing=angles), exact)


def test_lines_are_differentiable_with_respect_to_the_ports(twin: Twin) -> None:
    def lines(angles: torch.Tensor) -> torch.Tensor:
        return torch.view_as_real(twin.acceleration(port_timing=angles))

    angles = torch.tensor([[deg(0.3), deg(-0.6)]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lines, (angles,))
