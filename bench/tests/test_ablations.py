"""The paper's ablations of BiTCN are networks like any other, each without one part."""

import pytest
import torch

from swashtwin.foundation import InputError
from swashtwin.learning import BiTCN, build_network
from swashtwin_bench.rivals.ablations import ABLATIONS


@pytest.mark.parametrize("name", [ablation.name for ablation in ABLATIONS])
def test_an_ablation_is_built_by_name_and_again_from_its_settings(name):
    network = build_network(name, 2, 3, channels=(4, 8)).eval()
    assert isinstance(network, BiTCN)
    twin = build_network(name, **network.settings).eval()
    twin.load_state_dict(network.state_dict())
    windows = torch.randn(4, 2, 64)
    assert network(windows).shape == (4, 3)
    torch.testing.assert_close(twin(windows), network(windows), rtol=0, atol=0)
    with pytest.raises(InputError, match=r"no setting 'kernal_size'.*Did you mean kernel_size"):
        build_network(name, 1, 5, kernal_size=3)


def test_each_ablation_takes_away_its_part_and_no_other():
    settings = {"channels": (8, 8, 16), "kernel_size": 3}
    names = ("bitcn", "bitcn_ordinary", "bitcn_no_attention", "bitcn_forward")
    full, ordinary, no_attention, forward = (build_network(name, 2, 3, **settings) for name in names)
    shapes = {key: value.shape for key, value in full.state_dict().items()}
    assert {key: value.shape for key, value in ordinary.state_dict().items()} == shapes
    assert (full.receptive_field, ordinary.receptive_field) == (15, 7)
    assert set(no_attention.state_dict()) == {key for key in shapes if "attention" not in key}
    assert set(forward.state_dict()) == {key for key in shapes if not key.startswith("inverse")}


def test_an_ordinary_unit_is_centered_and_sees_as_far_ahead_as_back():
    branch = build_network("bitcn_ordinary", 1, 2, channels=(4, 4, 4), kernel_size=3, attention=False).eval().positive
    for weight in branch.parameters():  # no ReLU sleeps
        weight.data.abs_()
    windows = torch.rand(1, 1, 64, requires_grad=True)
    branch(windows)[0, :, 30].sum().backward()
    seen = windows.grad[0, 0].nonzero().flatten()
    assert (seen.min(), seen.max()) == (27, 33)
