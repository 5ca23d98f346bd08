"""Levels of whole windows: what changes them, what does not, and what the heads learn from them."""

import numpy as np
import pytest
import torch

from swashtwin.foundation import InputError
from swashtwin.learning import LevelNetwork, build_network
from swashtwin.learning.networks.window_levels import gain_response, window_levels

LENGTH = 1024


def signal(turns: float = 0.01, seed: int = 0) -> torch.Tensor:
    """Windows with lines at orders 1, 9 and 18 of a shaft, and noise."""
    draw = np.random.default_rng(seed)
    time = np.arange(LENGTH)
    lines = [np.sin(2 * np.pi * order * turns * time + draw.uniform(0, 6, (3, 2, 1))) for order in (1, 9, 18)]
    return torch.from_numpy((sum(lines) + 0.1 * draw.normal(size=(3, 2, LENGTH))).astype(np.float32))


@pytest.mark.parametrize("orders", [True, False])
def test_a_gain_moves_levels_by_their_gain_response(orders: bool) -> None:
    turns = torch.full((3,), 0.01) if orders else None
    moved = window_levels(10 * signal(), turns) - window_levels(signal(), turns)
    torch.testing.assert_close(moved, gain_response(orders).expand_as(moved), atol=0.02, rtol=0)


def test_levels_at_orders_stay_where_the_shaft_turns_faster() -> None:
    slow, fast = (window_levels(signal(turns), torch.full((3,), turns)) for turns in (0.012, 0.015))
    orders = slice(5, 25)
    assert (slow - fast)[..., orders].abs().median() < 0.15
    loudest = [levels[..., orders].mean(dim=(0, 1)).topk(3).indices.sort().values.tolist() for levels in (slow, fast)]
    assert loudest == [[0, 8, 17], [0, 8, 17]]


def test_shapes_do_not_change_with_the_gain_of_a_channel() -> None:
    network = LevelNetwork(2, 2, shape=True)
    louder = signal() * torch.tensor([10.0, 0.1])[:, None]
    torch.testing.assert_close(network.represent(louder), network.represent(signal()), atol=0.02, rtol=0)


def test_the_discriminant_is_scikit_learns_with_the_shrinkage_of_ledoit_and_wolf() -> None:
    from sklearn.covariance import ledoit_wolf
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    draw = np.random.default_rng(1)
    target = np.repeat([0, 1], 40)
    network = LevelNetwork(1, 2, heads=("discriminant",))
    levels = draw.normal(size=(80, len(network.mean))).astype(np.float32)
    levels[:, :5] += target[:, None]
    network.solve(torch.from_numpy(levels), torch.from_numpy(target), 0)
    scaled = network.encode(torch.from_numpy(levels)).double().numpy()
    centers = np.stack([scaled[target == index].mean(axis=0) for index in range(2)])
    shrinkage = ledoit_wolf(scaled - centers[target], assume_centered=True)[1]
    peer = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=shrinkage, priors=[0.5, 0.5]).fit(scaled, target)
    expected = network.log_probabilities(torch.from_numpy(levels))["discriminant"]
    assert np.abs(peer.predict_proba(scaled) - np.exp(expected)).max() < 0.05


def test_the_network_answers_the_mean_probability_of_its_heads() -> None:
    network = build_network("levels", 2, 3, hidden=8)
    levels = network.represent(signal())
    network.solve(levels, torch.tensor([0, 1, 2]), 0)
    by_head = network.log_probabilities(levels)
    mean = np.mean([np.exp(values) for values in by_head.values()], axis=0)
    np.testing.assert_allclose(torch.softmax(network(signal()), dim=-1).detach().numpy(), mean, atol=1e-5)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"axis": "angle"}, "axis 'angle' is none of"),
        ({"axis": "order"}, "needs turns"),
        ({"heads": ("trees",)}, "heads .trees. are some of"),
        ({"noise": -1.0}, "must not be negative"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(settings: dict[str, object], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        LevelNetwork(1, 2, **settings)
