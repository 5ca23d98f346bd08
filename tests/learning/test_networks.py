"""The structure of BiTCN, its fused layers for training on a CPU, and invalid network settings."""

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
    """Make the initial weights the same in every run."""
    torch.manual_seed(0)


def make_weights_positive(module: torch.nn.Module) -> None:
    """Make every weight positive: no ReLU blocks, so every sample in reach has a gradient."""
    for weight in module.parameters():
        weight.data.abs_()


def test_every_weight_influences_the_scores():
    network = BiTCN(2, 3)
    idle = {key for key, _ in network.named_parameters()}

    # three seeds, for under a single one all ReLU of a small hidden layer may be inactive
    for seed in range(3):
        seeded_network = network.fresh(seed)
        windows = torch.randn(8, 2, 128, generator=torch.Generator().manual_seed(seed))
        seeded_network(windows).square().sum().backward()
        idle -= {key for key, weight in seeded_network.named_parameters() if weight.grad.any()}

    assert idle == set()


def test_an_unknown_network_or_setting_is_refused_and_the_nearest_offered():
    with pytest.raises(InputError, match="Did you mean 'bitcn'"):
        build_network("BiTNC", 1, 5)
    with pytest.raises(InputError, match="kernels"):
        build_network("bitcn", 1, 5, kernels=3)
    with pytest.raises(InputError, match=r"no setting 'kernal_size'.*Did you mean kernel_size"):
        build_network("bitcn", 1, 5, kernal_size=3)


@pytest.mark.parametrize(
    ("settings", "message"),
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
def test_bitcn_refuses_invalid_settings(settings, message):
    with pytest.raises(InputError, match=message):
        build_network("bitcn", 1, 5, **settings)


@pytest.mark.parametrize("stride", [1, 4])
def test_the_positive_branch_is_causal_and_reaches_back_over_its_receptive_field(
    stride,
):
    network = BiTCN(1, 2, channels=(4, 4, 4), kernel_size=3, stride=stride).eval()
    branch = network.positive
    # squeeze-and-excitation reads the whole window; without it each unit is causal
    for unit in branch.units:
        unit.attention = torch.nn.Identity()

    make_weights_positive(branch)
    windows = torch.rand(1, 1, 256, requires_grad=True)
    steps = branch(windows)
    step = steps.shape[-1] - 1 - 40 // stride
    steps[0, :, step].sum().backward()
    samples_in_reach = windows.grad[0, 0].nonzero().flatten()
    newest = (step + 1) * stride - 1

    assert samples_in_reach.max() == newest
    assert samples_in_reach.min() == newest - network.receptive_field + 1


def test_swapping_the_branches_reads_the_reversed_window():
    network = BiTCN(2, 3).eval()
    windows = torch.randn(4, 2, 200)
    scores = network(windows)
    network.positive, network.inverse = network.inverse, network.positive

    torch.testing.assert_close(network(windows.flip(-1)), scores, rtol=1e-4, atol=1e-5)
    assert not torch.allclose(network(windows), scores, rtol=1e-3)


def test_a_stride_reduces_the_steps_but_uses_every_sample():
    network = BiTCN(1, 2, stride=8).eval()
    windows = torch.randn(1, 1, 101, requires_grad=True)

    assert network.positive(torch.zeros(1, 1, 104)).shape[-1] == 13

    network(windows).sum().backward()
    assert windows.grad.ne(0).all()


def test_a_default_that_is_not_a_plain_number_accepts_its_type_only():
    def build(n_channels, n_classes, length, share=np.float64(0.5), table={}): ...  # noqa: B006, B008

    kind = type("Own", (), {"name": "own", "build": staticmethod(build)})
    assert checked_settings(kind, {"share": 1}) == {"share": 1.0}
    with pytest.raises(InputError, match=r"own: table \({'a': 1}\) must be a word"):
        checked_settings(kind, {"table": {"a": 1}})


def test_a_single_value_for_a_setting_of_several_is_a_tuple_of_one():
    of_number = build_network("bitcn", 1, 2, channels=8, dilations=2)
    of_text = build_network("band_powers", 1, 2, heads="hidden")
    of_list = build_network("bitcn", 1, 2, channels=[np.int64(4)], dilations=1)

    assert of_number.settings["channels"] == (8,)
    assert of_text.settings["heads"] == ("hidden",)
    assert of_list.settings["channels"] == (4,)


VARIANTS = pytest.mark.parametrize(
    "settings",
    [
        {},
        {"causal": False},
        {"attention": False},
        {"bidirectional": False},
        {"stride": 4},
    ],
    ids=["full", "ordinary", "no attention", "forward", "patches"],
)


def windows() -> torch.Tensor:
    """Six windows of three channels."""
    return torch.randn(6, 3, 301, generator=torch.Generator().manual_seed(1))


def step(network: BiTCN, x: torch.Tensor) -> tuple[float, list[torch.Tensor], list[torch.Tensor]]:
    """Return the loss, the gradients and the running means after one training pass."""
    network = copy.deepcopy(network).train()
    loss = functional.cross_entropy(network(x), torch.arange(6) % 5)
    loss.backward()
    return (
        loss.item(),
        [weight.grad for weight in network.parameters()],
        list(network.buffers()),
    )


def distance(actual: list[torch.Tensor], expected: list[torch.Tensor]) -> float:
    """Return the largest deviation relative to the largest entry, of the worst tensor."""
    deviations = []
    for actual_tensor, expected_tensor in zip(actual, expected, strict=True):
        # entries below 1e-6 are rounding errors of a gradient that is zero
        scale = max(1e-6, float(expected_tensor.abs().max()))
        deviations.append(float((actual_tensor - expected_tensor).abs().max()) / scale)

    return max(deviations)


@VARIANTS
def test_fused_layers_are_as_exact_as_the_plain_ones(settings, monkeypatch):
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
    normalized = functional.batch_norm(features, None, None, *inputs[2:], training=True)
    expected = torch.relu(normalized).transpose(1, 2) * (active > 0) / 0.7
    score = (expected * weights).sum() + (expected.mean(dim=1) * of_mean).sum()
    gradients = torch.autograd.grad(score, [x, *inputs[2:]])

    fused_results = (active, mean, actual[0], *actual[2:])
    plain_results = (expected, expected.mean(dim=1), *gradients)

    for fused, plain in zip(fused_results, plain_results, strict=True):
        torch.testing.assert_close(fused, plain, rtol=1e-4, atol=1e-4)

    # normalization removes the convolution's bias, so that its gradient vanishes
    assert actual[1].abs().max() < 1e-2


def dropped(share: float) -> np.ndarray:
    """Return which entries dropout removes, of features that are all positive."""
    normalization = torch.nn.BatchNorm1d(64)
    torch.nn.init.constant_(normalization.bias, 100.0)
    x = torch.randn(8, 512, 64)
    active, _ = _Activation.apply(
        x,
        torch.zeros(64),
        normalization.weight,
        normalization.bias,
        normalization,
        share,
    )

    return (active == 0).numpy()


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
def test_dropout_removes_its_share_independently_of_position_and_call(share):
    torch.manual_seed(3)
    first = dropped(share)
    second = dropped(share)

    def bound(probability: float, n_draws: int) -> float:
        # five binomial standard deviations are exceeded once in two million draws
        return 5 * (probability * (1 - probability) / n_draws) ** 0.5

    assert first.mean() == pytest.approx(share, abs=bound(share, first.size))
    unit_shares = first.mean(axis=(0, 1))
    assert np.abs(unit_shares - share).max() <= bound(share, first[..., 0].size)

    # two calls, then neighbors along windows, steps and units
    for earlier, later in [
        (first, second),
        (first[:-1], first[1:]),
        (first[:, :-1], first[:, 1:]),
        (first[..., :-1], first[..., 1:]),
        (first[:, :-32], first[:, 32:]),
    ]:
        joint_share = (earlier & later).mean()
        assert joint_share == pytest.approx(share**2, abs=bound(share**2, earlier.size))


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
