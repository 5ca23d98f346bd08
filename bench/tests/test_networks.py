"""A battery over the networks that ours are compared with, and what makes each of them itself."""

import numpy as np
import pytest
import torch

from swashtwin.learning import build_network
from swashtwin_bench.rivals.networks import RIVALS


def make_weights_positive(module: torch.nn.Module) -> None:
    """Let every ReLU pass, so that each sample in reach has a gradient."""
    for weight in module.parameters():
        weight.data.abs_()


EVERY_NETWORK = pytest.mark.parametrize("name", [network.name for network in RIVALS])


# ---- what every network does


@EVERY_NETWORK
@pytest.mark.parametrize(("n_channels", "n_classes", "length"), [(1, 5, 256), (3, 2, 101)])
def test_a_network_gives_one_score_per_class_and_its_features_give_the_scores(
    name, n_channels, n_classes, length
):
    network = build_network(name, n_channels, n_classes).eval()
    windows = torch.randn(4, n_channels, length)
    scores = network(windows)
    assert scores.shape == (4, n_classes)
    assert torch.isfinite(scores).all()
    torch.testing.assert_close(network.head(network.features(windows)), scores)


@EVERY_NETWORK
def test_a_network_is_built_again_from_its_settings(name):
    network = build_network(name, 2, 3)
    rebuilt = build_network(name, **network.settings)
    rebuilt.load_state_dict(network.state_dict())

    windows = torch.randn(2, 2, 128)
    torch.testing.assert_close(rebuilt.eval()(windows), network.eval()(windows), rtol=0, atol=0)


@EVERY_NETWORK
def test_the_same_seed_draws_the_same_weights(name):
    network = build_network(name, 1, 3)
    first, repeated, different = (network.fresh(seed).state_dict() for seed in (1, 1, 2))
    assert all(torch.equal(first[key], repeated[key]) for key in first)
    assert not all(torch.equal(first[key], different[key]) for key in first)


@EVERY_NETWORK
def test_drawing_weights_leaves_the_callers_random_numbers_alone(name):
    network = build_network(name, 1, 3)
    torch.manual_seed(5)
    expected = torch.rand(3)

    torch.manual_seed(5)
    network.fresh(1)
    torch.testing.assert_close(torch.rand(3), expected, rtol=0, atol=0)


@EVERY_NETWORK
def test_every_weight_has_a_part_in_the_scores(name):
    network = build_network(name, 2, 3)
    gradients = {key: torch.zeros_like(weight) for key, weight in network.named_parameters()}

    # a hidden layer of few ReLU may be inactive under one seed
    for seed in range(3):
        drawn_network = network.fresh(seed)
        windows = torch.randn(8, 2, 128, generator=torch.Generator().manual_seed(seed))
        drawn_network(windows).square().sum().backward()
        for key, weight in drawn_network.named_parameters():
            gradients[key] += weight.grad

    idle_weights = [key for key, gradient in gradients.items() if not gradient.any()]
    assert idle_weights == []


# ---- what a network looks at


@pytest.mark.parametrize(
    ("name", "settings", "samples"),
    [
        ("tcn", {"channels": (4, 4, 4), "kernel_size": 3, "stride": 4}, 116),
        ("tcn", {"channels": (4, 4), "kernel_size": 2, "stride": 1}, 7),
        ("wdcnn", {}, 1520),
    ],
)
def test_a_step_in_the_middle_depends_on_exactly_the_receptive_field(name, settings, samples):
    network = build_network(name, 1, 2, **settings).eval()
    make_weights_positive(network)
    # an average is as wide as the maximum, through which only one sample at a time has a gradient
    for stage in getattr(network, "stages", ()):
        stage[3] = torch.nn.AvgPool1d(2)

    windows = torch.rand(1, 1, 8 * 512, requires_grad=True)
    steps = network.steps(windows)
    steps[0, :, steps.shape[-1] // 2].sum().backward()

    in_reach = windows.grad[0, 0].nonzero().flatten()
    assert in_reach.max() - in_reach.min() + 1 == network.receptive_field == samples


def test_no_step_of_the_tcn_sees_a_later_reading():
    network = build_network("tcn", 1, 2, stride=4).eval()
    windows = torch.rand(1, 1, 401, requires_grad=True)
    network.steps(windows)[0, :, 50].sum().backward()

    # 401 samples make 101 steps of 4; the three missing samples are zeros before the window
    assert windows.grad[0, 0].nonzero().max() == 200


def test_the_tcn_answers_from_its_last_step():
    network = build_network("tcn", 1, 2, stride=4).eval()
    windows = torch.rand(1, 1, 401)
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
    weights = network.recurrence.state_dict()
    cell.load_state_dict({key.removesuffix("_l0"): value for key, value in weights.items()})

    first_patch = windows[:, :, :3].reshape(5, 6)
    second_patch = windows[:, :, 3:].reshape(5, 6)
    hidden, _ = cell(second_patch, cell(first_patch))
    torch.testing.assert_close(network.features(windows), hidden)


def test_a_bidirectional_network_answers_with_the_last_state_of_each_direction():
    network = build_network("bigru", 1, 2, hidden=4).eval()
    windows = torch.randn(3, 1, 64)

    _, states = network.recurrence(windows.reshape(3, 4, 16))
    final_states = torch.cat([states[-2], states[-1]], dim=-1)
    torch.testing.assert_close(network.features(windows), final_states)


@pytest.mark.parametrize("name", ["autoencoder"])
def test_a_network_of_the_spectrum_does_not_care_when_a_window_begins(name):
    network = build_network(name, 1, 3, n_lines=32).eval()
    cycles = torch.arange(512) / 512
    noise = 1e-3 * torch.randn(512)

    def tone(line: int, phase: float) -> torch.Tensor:
        return torch.sin(2 * torch.pi * (line * cycles + phase)) + noise

    # two shifts of one tone, and a tone of another line to compare them with
    windows = torch.stack([tone(40, 0.0), tone(40, 0.1), tone(40, 0.37), tone(120, 0.0)])
    features = network.features(windows.unsqueeze(1))
    distance = (features[1:] - features[0]).abs().amax(dim=1)
    assert distance[:2].max() < 0.05 * distance[2]


# ---- the autoencoder


@pytest.fixture
def tone_windows():
    """Tones of 55 lines in noise."""
    rng = np.random.default_rng(0)
    lines = rng.integers(5, 60, size=(200, 1))
    tone = np.sin(2 * np.pi * lines * np.arange(256) / 256)
    return torch.from_numpy(tone + 0.1 * rng.normal(size=tone.shape)).float().unsqueeze(1)


def autoencoder(sparsity_weight=3.0):
    network = build_network(
        "autoencoder",
        1,
        2,
        sparsity_weight=sparsity_weight,
        hidden=(24, 8),
        n_lines=64,
        pretraining_epochs=150,
    )
    return network.fresh(0)


def test_pretraining_teaches_encoders_that_can_be_inverted(tone_windows):
    network = autoencoder()
    x = network.fresh(0).spectrum(tone_windows)
    encoder = network.encoders[0]
    loss = network._compute_loss(encoder, x.mean(dim=0), x).item()

    network.pretrain(tone_windows, seed=3)
    assert network._compute_loss(encoder, x.mean(dim=0), x).item() < 0.8 * loss


def test_the_weight_of_sparsity_keeps_units_silent(tone_windows):
    network = autoencoder()
    dense = autoencoder(sparsity_weight=0.0)
    x = network.spectrum(tone_windows)
    network.pretrain(tone_windows, seed=3)
    dense.pretrain(tone_windows, seed=3)

    activation = torch.sigmoid(network.encoders[0](x)).mean()
    assert activation < 0.85 * torch.sigmoid(dense.encoders[0](x)).mean()


def test_pretraining_changes_neither_the_head_nor_the_random_numbers(tone_windows):
    network = autoencoder()
    head = network.head.weight.clone()
    random_state = torch.get_rng_state()

    network.pretrain(tone_windows, seed=3)
    assert torch.equal(network.head.weight, head)
    assert torch.equal(torch.get_rng_state(), random_state)


def test_pretraining_is_repeatable(tone_windows):
    network = autoencoder()
    repeated = network.fresh(0)
    network.pretrain(tone_windows, seed=3)
    repeated.pretrain(tone_windows, seed=3)

    weights = repeated.state_dict()
    assert all(torch.equal(value, weights[key]) for key, value in network.state_dict().items())


# ---- the graph of sensors, and levels of the spectrum


def test_a_graph_of_sensors_knows_which_sensor_is_which():
    network = build_network("sensor_graph", 3, 2).eval()
    torch.testing.assert_close(network.adjacency.sum(dim=1), torch.ones(3))

    windows = torch.randn(4, 3, 256)
    assert not torch.allclose(network(windows), network(windows.flip(1)), rtol=1e-3)


def test_a_graph_of_sensors_listens_by_its_adjacency():
    network = build_network("sensor_graph", 3, 2).eval()
    # every sensor listens to itself only
    with torch.no_grad():
        network.listening[:] = 40 * torch.eye(3, 8)
        network.speaking[:] = torch.eye(3, 8)

    windows = torch.randn(4, 3, 256)
    changed = windows.clone()
    changed[:, 1] = 0
    difference = (network.features(changed) - network.features(windows)).abs().amax(dim=0)

    by_sensor = difference.unflatten(0, (3, -1)).amax(dim=1)
    assert by_sensor[1] > 1e-3
    assert by_sensor[[0, 2]].max() < 1e-5


def test_levels_of_a_window_come_out_centered_and_of_unit_deviation():
    network = build_network("spectral_bitcn", 2, 3)
    noise = np.random.default_rng(0).normal(size=(40, 2, 1024))
    levels = network.represent(torch.from_numpy(noise).float())
    network.pretrain(levels, 0)

    static, moving = network._split(levels)
    n_static = network.n_static
    # each step of a window counts as a value of its level
    moving = moving.transpose(1, 2).flatten(0, 1)

    for values, columns in ((static, slice(n_static)), (moving, slice(n_static, None))):
        mean = network.get_buffer("mean")[columns]
        deviation = network.get_buffer("deviation")[columns]
        scaled = (values - mean) / deviation

        zeros = torch.zeros(scaled.shape[1])
        torch.testing.assert_close(scaled.mean(dim=0), zeros, atol=1e-4, rtol=0)
        torch.testing.assert_close(scaled.std(dim=0), zeros + 1, atol=1e-3, rtol=0)
