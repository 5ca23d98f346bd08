"""What makes BiTCN BiTCN, and settings of networks that cannot be."""

import numpy as np
import pytest
import torch

from swashtwin.foundation import InputError
from swashtwin.learning import BiTCN, build_network


def awake(module: torch.nn.Module) -> None:
    """Make every weight positive, so that no ReLU sleeps and every sample that is in reach is felt."""
    for weight in module.parameters():
        weight.data.abs_()


@pytest.mark.parametrize(("n_channels", "n_classes", "length"), [(1, 5, 256), (3, 2, 101)])
def test_a_network_gives_one_score_per_class_and_its_features_give_the_scores(n_channels, n_classes, length):
    network = BiTCN(n_channels, n_classes).eval()
    windows = torch.randn(4, n_channels, length)
    assert network(windows).shape == (4, n_classes)
    assert torch.isfinite(network(windows)).all()
    torch.testing.assert_close(network.head(network.features(windows)), network(windows))


def test_every_weight_has_a_part_in_the_scores():
    network = BiTCN(2, 3)
    for seed in range(3):  # a hidden layer of few ReLU may sleep under one seed
        drawn = network.fresh(seed)
        drawn(torch.randn(8, 2, 128, generator=torch.Generator().manual_seed(seed))).square().sum().backward()
        for weight, drawn_weight in zip(network.parameters(), drawn.parameters(), strict=True):
            weight.grad = drawn_weight.grad if weight.grad is None else weight.grad + drawn_weight.grad
    idle = [key for key, weight in network.named_parameters() if not weight.grad.any()]
    assert idle == []


def test_an_unknown_network_or_setting_is_refused_and_the_nearest_offered():
    with pytest.raises(InputError, match="Did you mean 'bitcn'"):
        build_network("BiTNC", 1, 5)
    with pytest.raises(InputError, match="kernels"):
        build_network("bitcn", 1, 5, kernels=3)
    with pytest.raises(InputError, match=r"no setting 'kernal_size'.*Did you mean kernel_size"):
        build_network("bitcn", 1, 5, kernal_size=3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"dilations": (1, 2)}, "as many dilations"),
        ({"causal": 3}, r"causal \(3\) must be true or false"),
        ({"dilations": (1, 0.5)}, r"dilations \(0.5\) must be a whole number"),
        ({"kernel_size": 0}, r"kernel_size \(0\)"),
        ({"stride": 0}, r"stride \(0\)"),
        ({"dropout": 1.0}, "share"),
        ({"channels": ()}, "as many"),
    ],
)
def test_bitcn_refuses_settings_that_cannot_be(settings, words):
    with pytest.raises(InputError, match=words):
        build_network("bitcn", 1, 5, **settings)


@pytest.mark.parametrize("stride", [1, 4])
def test_the_positive_units_see_no_later_reading_and_reach_as_far_back_as_the_receptive_field(stride):
    network = BiTCN(1, 2, channels=(4, 4, 4), kernel_size=3, stride=stride).eval()
    branch = network.positive
    for unit in branch.units:  # squeeze-and-excitation looks at the whole window; without it each unit is causal
        unit.attention = torch.nn.Identity()
    awake(branch)
    windows = torch.rand(1, 1, 256, requires_grad=True)
    steps = branch(windows)
    step = steps.shape[-1] - 1 - 40 // stride
    steps[0, :, step].sum().backward()
    seen = windows.grad[0, 0].nonzero().flatten()
    last = (step + 1) * stride - 1
    assert seen.max() == last
    assert seen.min() == last - network.receptive_field + 1


def test_swapping_the_branches_reads_the_reversed_window():
    network = BiTCN(2, 3).eval()
    windows = torch.randn(4, 2, 200)
    scores = network(windows)
    network.positive, network.inverse = network.inverse, network.positive
    torch.testing.assert_close(network(windows.flip(-1)), scores, rtol=1e-4, atol=1e-5)
    assert not torch.allclose(network(windows), scores, rtol=1e-3)


def test_a_stride_cuts_the_steps_and_keeps_every_reading():
    network = BiTCN(1, 2, stride=8).eval()
    windows = torch.randn(1, 1, 101, requires_grad=True)
    assert network.positive(torch.zeros(1, 1, 104)).shape[-1] == 13
    network(windows).sum().backward()
    assert windows.grad.ne(0).all()


def test_one_number_or_word_for_a_setting_of_several_is_a_tuple_of_one():
    assert build_network("bitcn", 1, 2, channels=8, dilations=2).settings["channels"] == (8,)
    assert build_network("levels", 1, 2, heads="hidden").settings["heads"] == ("hidden",)
    assert build_network("bitcn", 1, 2, channels=[np.int64(4)], dilations=1).settings["channels"] == (4,)
