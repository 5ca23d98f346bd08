"""A battery over the networks that ours are compared with, and what makes each of them itself."""

import numpy as np
import pytest
import torch

from swashtwin.learning import build_network
from swashtwin_bench.rivals.networks import RIVALS


def awake(module: torch.nn.Module) -> None:
    """Make every weight positive, so that no ReLU sleeps and every sample that is in reach is
    felt.
    """
    for weight in module.parameters():
        weight.data.abs_()


EVERY_NETWORK = pytest.mark.parametrize("name", [network.name for network in RIVALS])


@EVERY_NETWORK
@pytest.mark.parametrize(("n_channels", "n_classes", "length"), [(1, 5, 256), (3, 2, 101)])
def test_a_network_gives_one_score_per_class_and_its_features_give_the_scores(
    name, n_channels, n_classes, length
):
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
        drawn(
            torch.randn(8, 2, 128, generator=torch.Generator().manual_seed(seed))
        ).square().sum().backward()
        for weight, drawn_weight in zip(network.parameters(), drawn.parameters(), strict=True):
            weight.grad = (
                drawn_weight.grad if weight.grad is None else weight.grad + drawn_weight.grad
            )
    idle = [key for key, weight in network.named_parameters() if not weight.grad.any()]
    assert idle == []


@pytest.mark.parametrize(
    ("name", "settings", "samples"),
    [
        ("tcn", {"channels": (4, 4, 4), "kernel_size": 3, "stride": 4}, 116),
        ("tcn", {"channels": (4, 4), "kernel_size": 2, "stride": 1}, 7),
        ("wdcnn", {}, 1520),
    ],
)
def test_a_step_in_the_middle_rests_on_as_many_readings_as_the_receptive_field_says(
    name, settings, samples
):
    network = build_network(name, 1, 2, **settings).eval()
    awake(network)
    for stage in getattr(network, "stages", ()):
        stage[3] = torch.nn.AvgPool1d(
            2
        )  # as wide as the maximum, which only one sample at a time reaches
    windows = torch.rand(1, 1, 8 * 512, requires_grad=True)
    steps = network.steps(windows)
    steps[0, :, steps.shape[-1] // 2].sum().backward()
    seen = windows.grad[0, 0].nonzero().flatten()
    assert seen.max() - seen.min() + 1 == network.receptive_field == samples


def test_the_tcn_answers_from_its_last_step_and_no_step_sees_a_later_reading():
    network = build_network("tcn", 1, 2, stride=4).eval()
    windows = torch.rand(1, 1, 401, requires_grad=True)
    network.steps(windows)[0, :, 50].sum().backward()
    assert windows.grad[0, 0].nonzero().max() == 200  # three zeros stand before the window
    torch.testing.assert_close(network.features(windows), network.steps(windows)[:, :, -1])


@pytest.mark.parametrize("name", ["lstm", "bilstm", "bigru", "cnn_lstm"])
def test_a_recurrent_network_remembers_the_whole_window(name):
    windows = torch.randn(2, 1, 256, requires_grad=True)
    build_network(name, 1, 2).eval()(windows).square().sum().backward()
    assert windows.grad.ne(0).all()


def test_a_patch_is_read_in_order_with_all_its_channels():
    """One layer of a network that reads raw samples, computed by hand."""
    network = build_network("lstm", 2, 3, hidden=4, layers=1, patch=3).eval()
    windows = torch.randn(5, 2, 6)
    cell = torch.nn.LSTMCell(6, 4)
    cell.load_state_dict(
        {key.removesuffix("_l0"): value for key, value in network.recurrence.state_dict().items()}
    )
    state = cell(windows[:, :, :3].reshape(5, 6))
    state = cell(windows[:, :, 3:].reshape(5, 6), state)
    torch.testing.assert_close(network.features(windows), state[0])


def test_a_bidirectional_network_answers_with_the_last_state_of_each_direction():
    network = build_network("bigru", 1, 2, hidden=4).eval()
    windows = torch.randn(3, 1, 64)
    _, last = network.recurrence(windows.reshape(3, 4, 16))
    torch.testing.assert_close(network.features(windows), torch.cat([last[-2], last[-1]], dim=-1))


@pytest.mark.parametrize("name", ["autoencoder"])
def test_a_network_of_the_spectrum_does_not_care_when_a_window_begins(name):
    network = build_network(name, 1, 3, n_lines=32).eval()
    cycles, noise = torch.arange(512) / 512, 1e-3 * torch.randn(512)
    tones = [(40, 0.0), (40, 0.1), (40, 0.37), (120, 0.0)]
    windows = torch.stack(
        [torch.sin(2 * torch.pi * (line * cycles + phase)) + noise for line, phase in tones]
    )
    features = network.features(windows.unsqueeze(1))
    distance = (features[1:] - features[0]).abs().amax(dim=1)
    assert distance[:2].max() < 0.05 * distance[2]


def test_pretraining_teaches_encoders_that_can_be_undone_and_keeps_units_silent():
    settings = {"hidden": (24, 8), "n_lines": 64, "pretraining_epochs": 150}
    network, awake = (
        build_network("autoencoder", 1, 2, sparsity_weight=weight, **settings).fresh(0)
        for weight in (3.0, 0.0)
    )
    draw = np.random.default_rng(0)
    tone = np.sin(2 * np.pi * draw.integers(5, 60, size=(200, 1)) * np.arange(256) / 256)
    windows = torch.from_numpy(tone + 0.1 * draw.normal(size=tone.shape)).float().unsqueeze(1)
    x = network.fresh(0).spectrum(windows)
    encoder = network.encoders[0]
    loss = network._compute_loss(encoder, x.mean(dim=0), x).item()
    head = network.head.weight.clone()
    before = torch.get_rng_state()
    network.pretrain(windows, seed=3)
    assert network._compute_loss(encoder, x.mean(dim=0), x).item() < 0.8 * loss
    awake.pretrain(windows, seed=3)
    assert torch.sigmoid(encoder(x)).mean() < 0.85 * torch.sigmoid(awake.encoders[0](x)).mean()
    assert torch.equal(network.head.weight, head)
    assert torch.equal(torch.get_rng_state(), before)
    again = network.fresh(0)
    again.pretrain(windows, seed=3)
    assert all(
        torch.equal(value, again.state_dict()[key]) for key, value in network.state_dict().items()
    )


def test_a_graph_of_sensors_listens_by_its_adjacency_and_knows_which_sensor_is_which():
    network = build_network("sensor_graph", 3, 2).eval()
    torch.testing.assert_close(network.adjacency.sum(dim=1), torch.ones(3))
    windows = torch.randn(4, 3, 256)
    assert not torch.allclose(network(windows), network(windows.flip(1)), rtol=1e-3)
    with torch.no_grad():
        network.listening[:] = 40 * torch.eye(3, 8)
        network.speaking[:] = torch.eye(3, 8)  # every sensor listens to itself only
    changed = windows.clone()
    changed[:, 1] = 0
    moved = (
        (network.features(changed) - network.features(windows))
        .abs()
        .amax(dim=0)
        .unflatten(0, (3, -1))
        .amax(dim=1)
    )
    assert moved[1] > 1e-3
    assert moved[[0, 2]].max() < 1e-5


def test_levels_of_a_window_come_out_centered_and_of_unit_deviation():
    network = build_network("spectral_bitcn", 2, 3)
    levels = network.represent(
        torch.from_numpy(np.random.default_rng(0).normal(size=(40, 2, 1024))).float()
    )
    network.pretrain(levels, 0)
    still, moving = network._split(levels)
    mean, deviation, n = (
        network.get_buffer("mean"),
        network.get_buffer("deviation"),
        network.n_static,
    )
    for values, part in ((still, slice(n)), (moving.transpose(1, 2).flatten(0, 1), slice(n, None))):
        scaled = (values - mean[part]) / deviation[part]
        torch.testing.assert_close(
            scaled.mean(dim=0), torch.zeros(scaled.shape[1]), atol=1e-4, rtol=0
        )
        torch.testing.assert_close(
            scaled.std(dim=0), torch.ones(scaled.shape[1]), atol=1e-3, rtol=0
        )
