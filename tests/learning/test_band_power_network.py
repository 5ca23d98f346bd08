"""Band powers of windows: what changes them, what does not, and what the heads learn from them."""

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import BandPowerNetwork
from swashtwin.learning.networks.feature_network import HEADS
from swashtwin.learning.networks.window_features import gain_response, window_features

LENGTH = 1024


def signal(turns: float = 0.01, seed: int = 0) -> np.ndarray:
    """Windows with lines at orders 1, 9 and 18 of a shaft, and noise."""
    draw = np.random.default_rng(seed)
    shaft_angle = 2 * np.pi * turns * np.arange(LENGTH)
    lines = np.zeros((3, 2, LENGTH))
    for order in (1, 9, 18):
        phase = draw.uniform(0, 6, (3, 2, 1))
        lines += np.sin(order * shaft_angle + phase)
    noise = 0.1 * draw.normal(size=lines.shape)

    return (lines + noise).astype(np.float32)


UNKNOWN_SPEED = np.full(3, np.nan)


@pytest.mark.parametrize("orders", [True, False])
def test_a_gain_shifts_band_powers_by_their_gain_response(orders: bool) -> None:
    turns = np.full(3, 0.01) if orders else None
    quiet = window_features(signal(), turns)
    loud = window_features(10 * signal(), turns)
    change = loud - quiet
    expected = np.broadcast_to(gain_response(orders), change.shape)

    np.testing.assert_allclose(change, expected, atol=0.02)


def test_band_powers_at_orders_do_not_change_with_the_speed() -> None:
    slow = window_features(signal(0.012), np.full(3, 0.012))
    fast = window_features(signal(0.015), np.full(3, 0.015))
    orders = slice(5, 25)

    assert np.median(np.abs(slow - fast)[..., orders]) < 0.15
    for features in (slow, fast):
        order_powers = features[..., orders].mean(axis=(0, 1))
        loudest = np.sort(order_powers.argsort()[-3:])
        assert loudest.tolist() == [0, 8, 17]  # orders 1, 9 and 18


def test_orders_need_a_speed_for_every_window() -> None:
    network = BandPowerNetwork(2, 2, axis="order")
    assert np.isfinite(network.represent_at(signal(), np.full(3, 0.01))).all()
    with pytest.raises(DataError, match="specify the speed, or train with turns"):
        network.represent_at(signal(), np.array([0.01, np.nan, 0.01]))


def test_shapes_do_not_change_with_the_gain_of_a_channel() -> None:
    network = BandPowerNetwork(2, 2, shape=True)
    gains = np.array([10.0, 0.1], dtype=np.float32)
    plain_shape = network.represent_at(signal(), UNKNOWN_SPEED)
    scaled_shape = network.represent_at(signal() * gains[:, None], UNKNOWN_SPEED)

    np.testing.assert_allclose(scaled_shape, plain_shape, atol=0.02)


def test_the_discriminant_is_that_of_scikit_learn_with_ledoit_wolf_shrinkage() -> None:
    from sklearn.covariance import ledoit_wolf
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    draw = np.random.default_rng(1)
    target = np.repeat([0, 1], 40)
    network = BandPowerNetwork(1, 2, heads=("discriminant",))
    features = draw.normal(size=(80, len(network.response))).astype(np.float32)
    features[:, :5] += target[:, None]
    network.solve(features, target, 0)

    scaled = network.encode(features).astype(float)
    first_center = scaled[target == 0].mean(axis=0)
    second_center = scaled[target == 1].mean(axis=0)
    centers = np.stack([first_center, second_center])
    _, shrinkage = ledoit_wolf(scaled - centers[target], assume_centered=True)
    peer = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=shrinkage, priors=[0.5, 0.5])
    peer.fit(scaled, target)

    probabilities = np.exp(network.log_probabilities(features)["discriminant"])
    difference = peer.predict_proba(scaled) - probabilities
    assert np.abs(difference).max() < 0.05


def solved(heads: tuple[str, ...] = HEADS) -> tuple[BandPowerNetwork, np.ndarray]:
    """Return a network of small windows, and their band powers."""
    network = BandPowerNetwork(2, 3, hidden=8, heads=heads)
    features = network.represent_at(signal(), UNKNOWN_SPEED)
    network.solve(features, np.array([0, 1, 2]), 0)
    return network, features


def test_the_network_returns_the_mean_probability_of_its_heads() -> None:
    network, features = solved()
    log_probabilities = network.log_probabilities(features)
    mean = np.exp(list(log_probabilities.values())).mean(axis=0)
    probabilities = network.probabilities(signal(), UNKNOWN_SPEED)

    np.testing.assert_allclose(probabilities, mean, atol=1e-6)


@pytest.mark.parametrize("heads", [HEADS, HEADS[:1], HEADS[1:]])
def test_the_mean_gradient_times_the_band_powers_is_the_change_of_the_margin(
    heads: tuple[str, ...],
) -> None:
    network = BandPowerNetwork(1, 3, hidden=8, heads=heads)
    draw = np.random.default_rng(0)
    features = draw.normal(size=(60, len(network.response))).astype(np.float32)
    network.solve(features, np.arange(60) % 3, 0)

    encoded = network.encode(features)
    gradient, change = network.mean_gradient(encoded, 0, 2, 500)

    mean = network.weights["mean"][None]
    rise = network.scores(features) - network.scores(mean)
    margin_rise = rise[:, 0] - rise[:, 2]
    np.testing.assert_allclose(change, margin_rise, rtol=1e-3, atol=1e-3)

    linear_change = (gradient * encoded).sum(axis=1)
    np.testing.assert_allclose(linear_change, change, rtol=0.02, atol=0.01)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"axis": "angle"}, "axis 'angle' must be one of"),
        ({"heads": ("trees",)}, "heads .trees. must be some of"),
        ({"noise": -1.0}, "must not be negative"),
    ],
)
def test_an_invalid_setting_is_refused(settings: dict[str, object], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        BandPowerNetwork(1, 2, **settings)
