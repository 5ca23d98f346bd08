"""What makes BiTCN BiTCN, also as it is trained on a CPU, and settings of networks that cannot
be.
"""

import copy

import numpy as np
import pytest
import torch
from torch.nn import functional

from swashtwin.foundation import InputError
from swashtwin.learning import BiTCN, build_network
from swashtwin.learning.networks import bitcn
from swashtwin.learning.networks.fused_branch import _Activation
from swashtwin.learning.networks.registry import checked_settings


@pytest.fixture(autouse=True)
def seed() -> None:
    """Weights that every run draws alike."""
    torch.manual_seed(0)


def awake(module: torch.nn.Module) -> None:
    """Make every weight positive, so that no ReLU sleeps and every sample that is in reach is
    felt.
    """
    for weight in module.parameters():
        weight.data.abs_()


def test_every_weight_has_a_part_in_the_scores():
    network = BiTCN(2, 3)
    for seed in range(3):  # a hidden layer of few ReLU may sleep under one seed
        drawn = network.fresh(seed)
        drawn(
            torch.randn(8, 2, 128, generator=torch.Generator().manual_seed(seed))
        ).square().sum().backward()

        for weight, drawn_weight in zip(network.parameters(), drawn.parameters(), strict=True):
            weight.grad = (
                drawn_weight.grad if weight.grad is None else weight.grad + drawn_weight.grad
            )

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
def test_the_positive_units_see_no_later_reading_and_reach_as_far_back_as_the_receptive_field(
    stride,
):
    network = BiTCN(1, 2, channels=(4, 4, 4), kernel_size=3, stride=stride).eval()
    branch = network.positive
    for unit in (
        branch.units
    ):  # squeeze-and-excitation looks at the whole window; without it each unit is causal
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


def test_a_default_of_another_kind_than_a_plain_number_takes_what_it_is_or_is_refused():
    def own(n_channels, n_classes, length, share=np.float64(0.5), table={}): ...  # noqa: B006, B008

    kind = type("Own", (), {"name": "own", "build": staticmethod(own)})
    assert checked_settings(kind, {"share": 1}) == {"share": 1.0}
    with pytest.raises(InputError, match=r"own: table \({'a': 1}\) must be a word"):
        checked_settings(kind, {"table": {"a": 1}})


def test_one_number_or_word_for_a_setting_of_several_is_a_tuple_of_one():
    assert build_network("bitcn", 1, 2, channels=8, dilations=2).settings["channels"] == (8,)
    assert build_network("band_powers", 1, 2, heads="hidden").settings["heads"] == ("hidden",)
    assert build_network("bitcn", 1, 2, channels=[np.int64(4)], dilations=1).settings[
        "channels"
    ] == (4,)


VARIANTS = pytest.mark.parametrize(
    "settings",
    [{}, {"causal": False}, {"attention": False}, {"bidirectional": False}, {"stride": 4}],
    ids=["full", "ordinary", "no attention", "forward", "patches"],
)


def windows() -> torch.Tensor:
    """Six windows of three channels."""
    return torch.randn(6, 3, 301, generator=torch.Generator().manual_seed(1))


def step(network: BiTCN, x: torch.Tensor) -> tuple[float, list[torch.Tensor], list[torch.Tensor]]:
    """(loss, gradients, running means) after one pass in training."""
    network = copy.deepcopy(network).train()
    loss = functional.cross_entropy(network(x), torch.arange(6) % 5)
    loss.backward()
    return loss.item(), [weight.grad for weight in network.parameters()], list(network.buffers())


def distance(actual: list[torch.Tensor], expected: list[torch.Tensor]) -> float:
    """Largest deviation over the largest entry, of the worst tensor; one whose entries are rounding
    counts as 1e-6.
    """
    pairs = zip(actual, expected, strict=True)
    return max(
        float((first - other).abs().max() / max(1e-6, float(other.abs().max())))
        for first, other in pairs
    )


@VARIANTS
def test_fused_loss_gradients_and_running_means_are_as_exact_as_those_of_the_plain_layers(
    settings, monkeypatch
):
    network = BiTCN(3, 5, dropout=0.0, **settings)
    fused = step(network, windows())
    monkeypatch.setattr(bitcn, "can_fuse", lambda x: False)
    plain = step(network, windows())
    exact = step(copy.deepcopy(network).double(), windows().double())

    assert fused[0] == pytest.approx(exact[0], rel=1e-6)
    assert distance(fused[1], exact[1]) < max(1e-4, 3 * distance(plain[1], exact[1]))
    assert distance(fused[2], exact[2]) < 1e-5


def test_dropout_has_the_gradients_of_the_layers_with_the_same_mask():
    torch.manual_seed(0)
    x = torch.randn(4, 50, 8)
    weights = torch.randn(4, 50, 8)
    of_mean = torch.randn(4, 8)
    normalization = torch.nn.BatchNorm1d(8)
    with torch.no_grad():
        normalization.weight.uniform_(0.5, 2)
        normalization.bias.uniform_(0, 1)
    inputs = [
        x.requires_grad_(),
        torch.zeros(8, requires_grad=True),
        normalization.weight,
        normalization.bias,
    ]
    active, mean = _Activation.apply(*inputs, normalization, 0.3)
    actual = torch.autograd.grad((active * weights).sum() + (mean * of_mean).sum(), inputs)

    features = x.transpose(1, 2)
    normalized = torch.relu(
        functional.batch_norm(features, None, None, *inputs[2:], training=True)
    ).transpose(1, 2)
    expected = normalized * (active > 0) / 0.7
    score = (expected * weights).sum() + (expected.mean(dim=1) * of_mean).sum()
    gradients = torch.autograd.grad(score, [x, *inputs[2:]])
    pairs = zip(
        (active, mean, actual[0], *actual[2:]),
        (expected, expected.mean(dim=1), *gradients),
        strict=True,
    )

    for first, other in pairs:
        torch.testing.assert_close(first, other, rtol=1e-4, atol=1e-4)

    assert actual[1].abs().max() < 1e-2  # normalization takes the convolution's bias away


def dropped(share: float) -> np.ndarray:
    """Which entries dropout takes, of features that ReLU passes."""
    normalization = torch.nn.BatchNorm1d(64)
    torch.nn.init.constant_(normalization.bias, 100.0)
    x = torch.randn(8, 512, 64)
    active, _ = _Activation.apply(
        x, torch.zeros(64), normalization.weight, normalization.bias, normalization, share
    )

    return (active == 0).numpy()


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
def test_dropout_takes_the_share_that_it_is_told_independently_of_place_and_call(share):
    torch.manual_seed(3)
    first = dropped(share)
    second = dropped(share)
    spread = (share * (1 - share) / first.size) ** 0.5

    assert first.mean() == pytest.approx(share, abs=5 * spread)
    assert (
        np.abs(first.mean(axis=(0, 1)) - share).max()
        <= 5 * (share * (1 - share) / first[..., 0].size) ** 0.5
    )

    for left, right in [
        (first, second),
        (first[:-1], first[1:]),
        (first[:, :-1], first[:, 1:]),
        (first[..., :-1], first[..., 1:]),
        (first[:, :-32], first[:, 32:]),
    ]:
        both = (left & right).mean()
        assert both == pytest.approx(
            share**2, abs=5 * (share**2 * (1 - share**2) / left.size) ** 0.5
        )


def test_the_same_random_state_drops_the_same():
    torch.manual_seed(7)
    first = dropped(0.1)
    torch.manual_seed(7)

    assert (dropped(0.1) == first).all()


def test_windows_of_64_and_16_bits_take_the_plain_layers():
    assert bitcn.can_fuse(windows())
    assert not bitcn.can_fuse(windows().double())

    with torch.autocast("cpu", torch.bfloat16):
        assert not bitcn.can_fuse(windows())
