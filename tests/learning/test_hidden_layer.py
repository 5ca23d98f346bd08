"""The hidden layer: its gradients are those of finite differences, and Adam is that of torch."""

import numpy as np
import pytest
import torch

from swashtwin.learning.networks.hidden_layer import (
    Adam,
    Weights,
    backward,
    fit_hidden_layer,
    forward,
    loss_gradient,
)

SIZES = {
    "first": (5, 4),
    "gain": (1, 5),
    "shift": (1, 5),
    "second": (3, 5),
    "bias": (1, 3),
}
"""Shape of each weight of a layer of 5 units between 4 features and 3 classes."""
N_WINDOWS = 7


def draw_weights(rng: np.random.Generator, networks: tuple[int, ...] = ()) -> Weights:
    return {name: rng.normal(size=(*networks, *shape)) for name, shape in SIZES.items()}


def cross_entropy(
    weights: Weights,
    x: np.ndarray,
    is_kept: np.ndarray,
    target: np.ndarray,
    window_weight: np.ndarray,
) -> float:
    scores = torch.from_numpy(forward(weights, x, is_kept, 0.5).scores)
    losses = torch.nn.functional.cross_entropy(scores, torch.from_numpy(target), reduction="none")
    return float((losses.numpy() * window_weight).sum() / window_weight.sum())


@pytest.mark.parametrize("name", SIZES)
def test_the_gradient_of_each_weight_is_that_of_finite_differences(name: str) -> None:
    rng = np.random.default_rng(3)
    weights = draw_weights(rng)
    x = rng.normal(size=(N_WINDOWS, 4))
    is_kept = rng.random((N_WINDOWS, 5)) < 0.5
    target = rng.integers(0, 3, N_WINDOWS)
    window_weight = rng.uniform(0.5, 2, N_WINDOWS)

    activations = forward(weights, x, is_kept, 0.5)
    score_gradient = loss_gradient(activations.scores, target, window_weight)
    gradient = backward(weights, activations, score_gradient)[name]

    step = 1e-5
    expected = np.empty_like(gradient)
    for entry in np.ndindex(gradient.shape):
        losses = []
        for sign in (1, -1):
            shifted = {key: value.copy() for key, value in weights.items()}
            shifted[name][entry] += sign * step
            losses.append(cross_entropy(shifted, x, is_kept, target, window_weight))

        expected[entry] = (losses[0] - losses[1]) / (2 * step)

    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-8)


def test_a_unit_has_mean_0_and_deviation_1_before_gain_and_shift() -> None:
    rng = np.random.default_rng(0)
    normalized = forward(draw_weights(rng), rng.normal(size=(N_WINDOWS, 4))).normalized

    np.testing.assert_allclose(normalized.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(normalized.std(axis=0), 1, rtol=1e-4)


def test_a_dropped_unit_adds_nothing_and_the_others_are_scaled_up() -> None:
    rng = np.random.default_rng(0)
    weights = draw_weights(rng)
    x = rng.normal(size=(N_WINDOWS, 4))
    is_kept = np.arange(5) != 2
    whole = forward(weights, x).active
    dropped = forward(weights, x, is_kept, 0.8).active

    np.testing.assert_allclose(dropped, whole * is_kept / 0.8)


def test_networks_along_a_leading_axis_do_not_influence_each_other() -> None:
    rng = np.random.default_rng(1)
    weights = draw_weights(rng, networks=(2,))
    x = rng.normal(size=(2, N_WINDOWS, 4))
    together = forward(weights, x).scores

    for index in range(2):
        single = forward({name: value[index] for name, value in weights.items()}, x[index]).scores
        np.testing.assert_allclose(together[index], single)


def test_adam_takes_the_steps_of_torch() -> None:
    rng = np.random.default_rng(2)
    start = rng.normal(size=(4, 3)).astype(np.float32)
    weights = {"first": start.copy()}
    parameter = torch.nn.Parameter(torch.from_numpy(start.copy()))
    expected = torch.optim.Adam([parameter])
    optimizer = Adam(weights)

    for rate in (1e-2, 5e-3, 1e-3):
        gradient = rng.normal(size=start.shape).astype(np.float32)
        parameter.grad = torch.from_numpy(gradient.copy())
        expected.param_groups[0]["lr"] = rate
        expected.step()
        optimizer.update({"first": gradient}, rate)

    np.testing.assert_allclose(weights["first"], parameter.detach().numpy(), rtol=1e-5)


def test_the_hidden_layer_learns_an_exclusive_or_of_two_features() -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(size=(8000, 6)).astype(np.float32)
    target = ((features[:, 0] > 0) != (features[:, 1] > 0)).astype(int)
    weights = [
        fit_hidden_layer(features, target, 2, 32, dropout=0.1, noise=0.1, seed=seed)
        for seed in (1, 1, 2)
    ]
    hidden = np.maximum(features @ weights[0]["hidden"].T + weights[0]["hidden.bias"], 0)
    scores = hidden @ weights[0]["output"].T + weights[0]["output.bias"]

    assert (scores.argmax(axis=1) == target).mean() > 0.9
    np.testing.assert_array_equal(weights[0]["hidden"], weights[1]["hidden"])
    assert not np.array_equal(weights[0]["hidden"], weights[2]["hidden"])
