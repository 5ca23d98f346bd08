"""A battery over every network of torch in the registry, and what makes BiTCN BiTCN."""

import numpy as np
import pytest
import torch

from swashtwin.foundation import InputError
from swashtwin.learning import BiTCN, build_network


def awake(module: torch.nn.Module) -> None:
    """Make every weight positive, so that no ReLU sleeps and every sample that is in reach is felt."""
    for weight in module.parameters():
        weight.data.abs_()


EVERY_NETWORK = pytest.mark.parametrize("name", ["bitcn"])


@EVERY_NETWORK
@pytest.mark.parametrize(("n_channels", "n_classes", "length"), [(1, 5, 256), (3, 2, 101)])
def test_a_network_gives_one_score_per_class_and_its_features_give_the_scores(name, n_channels, n_classes, length):
    network = build_network(name, n_channels, n_classes).eval()
    windows = torch.randn(4, n_channels, length)
    assert network(windows).shape == (4, n_classes)
    assert torch.isfinite(network(windows)).all()
    torch.testing.assert_close(network.head(network.features(windows)), network(windows))


@EVERY_NETWORK
def test_a_network_is_built_again_from_its_settings(name):
    network = build_network(name, 2, 3)
    twin = build_network(name, **network.settings)
    twin.load_state_dict(network.state_dict())
    windows = torch.randn(2, 2, 128)
    torch.testing.assert_close(twin.eval()(windows), network.eval()(windows), rtol=0, atol=0)


@EVERY_NETWORK
def test_the_same_seed_draws_the_same_weights_and_leaves_the_callers_random_numbers(name):
    network = build_network(name, 1, 3)
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    first, second, third = (network.fresh(seed).state_dict() for seed in (1, 1, 2))
    torch.testing.assert_close(torch.rand(3), expected, rtol=0, atol=0)
    assert all(torch.equal(first[key], second[key]) for key in first)
    assert not all(torch.equal(first[key], third[key]) for key in first)


@EVERY_NETWORK
def test_every_weight_has_a_part_in_the_scores(name):
    network = build_network(name, 2, 3)
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
        ({"kernel_size": 0}, r"kernel_size \(0\)"),
        ({"stride": 0}, r"stride \(0\)"),
        ({"dropout": 1.0}, "share"),
        ({"channels": ()}, "as many"),
    ],
)
def test_bitcn_refuses_settings_that_cannot_be(settings, words):
    with pytest.raises(InputError, match=words):
        BiTCN(1, 5, **settings)


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


def test_the_documented_weight_shapes_hold():
    weights = {key: tuple(value.shape) for key, value in BiTCN(3, 5, stride=4).state_dict().items()}
    assert weights["positive.entry.weight"] == weights["inverse.entry.weight"] == (32, 3, 4)
    assert weights["inverse.units.3.convolution.weight"] == (64, 32, 5)
    assert weights["positive.units.3.attention.squeeze.weight"] == (16, 64)
    assert weights["positive.units.3.attention.excite.weight"] == (64, 16)
    assert weights["positive.units.3.skip.weight"] == (64, 32, 1)
    assert "positive.units.4.skip.weight" not in weights
    assert weights["positive.exit.weight"] == (64, 64, 1)
    assert weights["skip.weight"] == (64, 3, 4)
    assert weights["head.weight"] == (5, 64)


@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        ("bitcn", {"causal": 3}, r"causal \(3\) must be true or false"),
        ("bitcn", {"dilations": (1, 0.5)}, r"dilations \(0.5\) must be a whole number"),
    ],
)
def test_a_value_of_another_kind_than_the_default_is_refused_before_anything_is_built(name, settings, words):
    with pytest.raises(InputError, match=words):
        build_network(name, 1, 2, **settings)


def test_one_number_or_word_for_a_setting_of_several_is_a_tuple_of_one():
    assert build_network("bitcn", 1, 2, channels=8, dilations=2).settings["channels"] == (8,)
    assert build_network("levels", 1, 2, heads="hidden").settings["heads"] == ("hidden",)
    assert build_network("bitcn", 1, 2, channels=[np.int64(4)], dilations=1).settings["channels"] == (4,)
