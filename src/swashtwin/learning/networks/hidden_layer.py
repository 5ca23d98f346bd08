"""A hidden layer between features and classes, trained in numpy: forward, backward, Adam.

All arrays may have leading axes, along which layers of several networks are trained together with
the same draws.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Float, Float32, Int

from swashtwin.foundation import random_stream

EPOCHS = 10
"""Passes over the training windows."""
BATCH_SIZE = 128
"""Windows of each step."""
LEARNING_RATE = 2e-3
"""Rate of the first step; it falls to 0 by a cosine."""
MOMENTUM = 0.1
"""Weight of a batch in the running moments of batch normalization, as in torch."""
MIN_VARIANCE = np.float32(1e-5)
"""Added to variances before division, as in torch."""
FIRST_DECAY = 0.9
"""Decay of Adam's mean of gradients (this and the next two constants: Kingma and Ba)."""
SECOND_DECAY = 0.999
"""Decay of Adam's mean of squared gradients."""
ADAM_EPSILON = np.float32(1e-8)
"""Added to the root of the mean of squared gradients."""

Weights = dict[str, np.ndarray]
"""``first`` (unit, feature), ``gain`` and ``shift`` (1, unit) of batch normalization, ``second``
(class, unit), ``bias`` (1, class); and gradients by the same names.
"""


@dataclass(frozen=True, eq=False)
class Activations:
    """Results of a forward pass that the backward pass and the running moments need."""

    x: Float[np.ndarray, "*network window feature"]
    """Features."""
    mean: Float[np.ndarray, "*network 1 unit"]
    """Mean of each unit over the batch."""
    variance: Float[np.ndarray, "*network 1 unit"]
    """Variance of each unit over the batch."""
    normalized: Float[np.ndarray, "*network window unit"]
    """Units with mean 0 and deviation 1."""
    passing: Float[np.ndarray, "*network window unit"]
    """Derivative of ReLU and dropout: 1 / (share kept) if a unit is active, else 0."""
    active: Float[np.ndarray, "*network window unit"]
    """Units after ReLU and dropout."""
    scores: Float[np.ndarray, "*network window class"]
    """Score of each class, before softmax."""


def forward(
    weights: Weights,
    x: Float[np.ndarray, "*network window feature"],
    is_kept: np.ndarray | bool = True,
    keep_share: np.float32 | float = 1.0,
) -> Activations:
    """Return the scores W₂ dropout(ReLU(BatchNorm(W₁ x))) + b, and what led to them.

    Parameters
    ----------
    is_kept : units that dropout keeps (window, unit).
    keep_share : share of the units that it keeps on average.
    """
    sums = x @ weights["first"].swapaxes(-1, -2)
    mean = sums.mean(axis=-2, keepdims=True)
    variance = sums.var(axis=-2, keepdims=True)
    normalized = (sums - mean) * (1 / np.sqrt(variance + MIN_VARIANCE))

    shifted = normalized * weights["gain"] + weights["shift"]
    passing = ((shifted > 0) & is_kept) / keep_share
    active = shifted * passing
    scores = active @ weights["second"].swapaxes(-1, -2) + weights["bias"]
    return Activations(x, mean, variance, normalized, passing, active, scores)


def loss_gradient(
    scores: Float[np.ndarray, "*network window class"],
    target: Int[np.ndarray, " window"],
    window_weight: Float[np.ndarray, " window"],
) -> Float[np.ndarray, "*network window class"]:
    """Return the gradient of the weighted mean cross-entropy with respect to the scores."""
    gradient = scipy.special.softmax(scores, axis=-1)
    gradient[..., np.arange(len(target)), target] -= 1
    gradient *= (window_weight / window_weight.sum())[:, None]
    return np.asarray(gradient)


def backward(
    weights: Weights,
    activations: Activations,
    score_gradient: Float[np.ndarray, "*network window class"],
) -> Weights:
    """Return the gradient of each weight from that of the scores."""
    n_windows = activations.x.shape[-2]
    shifted_gradient = (score_gradient @ weights["second"]) * activations.passing
    gain_gradient = (shifted_gradient * activations.normalized).sum(axis=-2, keepdims=True)
    shift_gradient = shifted_gradient.sum(axis=-2, keepdims=True)

    # Batch normalization: its mean and its variance depend on every window of the batch.
    centered = shifted_gradient - shift_gradient / n_windows
    centered = centered - activations.normalized * (gain_gradient / n_windows)
    sums_gradient = centered * (
        weights["gain"] * (1 / np.sqrt(activations.variance + MIN_VARIANCE))
    )

    return {
        "first": sums_gradient.swapaxes(-1, -2) @ activations.x,
        "gain": gain_gradient,
        "shift": shift_gradient,
        "second": score_gradient.swapaxes(-1, -2) @ activations.active,
        "bias": score_gradient.sum(axis=-2, keepdims=True),
    }


class Adam:
    """Adam (Kingma and Ba 2015, arXiv:1412.6980) for weights that it changes in place."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self.step = 0
        self._first = {name: np.zeros_like(value) for name, value in weights.items()}
        self._second = {name: np.zeros_like(value) for name, value in weights.items()}

    def update(self, gradients: Weights, rate: float) -> None:
        """Take one step of the given learning rate."""
        self.step += 1
        # The means begin at 0; the corrections remove that bias.
        first_correction = 1 - FIRST_DECAY**self.step
        second_correction = np.float32(1 - SECOND_DECAY**self.step)
        scale = np.float32(rate / first_correction)

        for name, gradient in gradients.items():
            first = self._first[name]
            second = self._second[name]
            first += (1 - FIRST_DECAY) * (gradient - first)
            second += (1 - SECOND_DECAY) * (gradient * gradient - second)
            change = np.sqrt(second / second_correction)
            change += ADAM_EPSILON
            np.divide(first, change, out=change)
            change *= scale
            self.weights[name] -= change


def fit_hidden_layer(
    features: Float32[np.ndarray, "*network window feature"],
    target: Int[np.ndarray, " window"],
    n_classes: int,
    size: int,
    *,
    dropout: float,
    noise: float,
    seed: int,
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Return the weights ``hidden`` and ``output`` of W₂ ReLU(W₁ x + b₁) + b₂, with their biases.

    They minimize the cross-entropy with classes weighted alike: Adam, ten passes, a rate that falls
    by a cosine. Batch normalization (Ioffe and Szegedy 2015, arXiv:1502.03167) stands before the
    ReLU, and is folded into the returned weights; dropout stands after it. In each step noise is
    added to the features. Networks along the leading axes share all draws.

    Parameters
    ----------
    features : of mean 0 and deviation 1.
    size : hidden units.
    dropout : share of the hidden units dropped.
    noise : standard deviation of the noise on the features.
    """
    rng = random_stream(seed, "hidden layer")
    weights = _initial_weights(rng, features.shape, n_classes, size)
    running_mean = np.zeros_like(weights["gain"])
    running_variance = np.ones_like(weights["gain"])
    n_windows = features.shape[-2]
    counts = np.maximum(np.bincount(target, minlength=n_classes), 1)
    class_weight = (n_windows / (n_classes * counts)).astype(np.float32)
    keep_share = np.float32(1 - dropout)

    optimizer = Adam(weights)
    batches = _batch_bounds(n_windows)
    n_steps = EPOCHS * len(batches)
    for _ in range(EPOCHS):
        order = rng.permutation(n_windows)
        for start, end in batches:
            rows = order[start:end]
            x = features[..., rows, :]
            if noise:
                x += np.float32(noise) * rng.standard_normal(x.shape[-2:], dtype=np.float32)
            is_kept: np.ndarray | bool = True
            if dropout:
                is_kept = rng.random((len(rows), size), dtype=np.float32) < keep_share

            activations = forward(weights, x, is_kept, keep_share)
            window_weight = class_weight[target[rows]]
            score_gradient = loss_gradient(activations.scores, target[rows], window_weight)
            rate = LEARNING_RATE * (1 + np.cos(np.pi * optimizer.step / n_steps)) / 2
            optimizer.update(backward(weights, activations, score_gradient), rate)
            _update_running_moments(running_mean, running_variance, activations)

    return _fold_normalization(weights, running_mean, running_variance)


def _update_running_moments(
    running_mean: np.ndarray, running_variance: np.ndarray, activations: Activations
) -> None:
    """Move the running moments of batch normalization towards those of a batch, in place."""
    n_windows = activations.x.shape[-2]
    # torch normalizes by the biased variance and runs the unbiased one.
    unbiased = activations.variance * (n_windows / max(n_windows - 1, 1))
    running_mean += MOMENTUM * (activations.mean - running_mean)
    running_variance += MOMENTUM * (unbiased - running_variance)


def _initial_weights(
    rng: np.random.Generator, shape: tuple[int, ...], n_classes: int, size: int
) -> Weights:
    """Return the first weights, the same for all networks along the leading axes."""
    n_features = shape[-1]
    repeats = (*shape[:-2], 1, 1)
    return {
        "first": np.tile(_draw_uniform(rng, (size, n_features), n_features), repeats),
        "gain": np.ones((*repeats[:-1], size), dtype=np.float32),
        "shift": np.zeros((*repeats[:-1], size), dtype=np.float32),
        "second": np.tile(_draw_uniform(rng, (n_classes, size), size), repeats),
        "bias": np.tile(_draw_uniform(rng, (1, n_classes), size), repeats),
    }


def _draw_uniform(
    rng: np.random.Generator, shape: tuple[int, ...], n_inputs: int
) -> Float32[np.ndarray, "..."]:
    """Return numbers uniform within one over the root of the number of inputs, as torch draws."""
    centered = 2 * rng.random(shape, dtype=np.float32) - 1
    return (centered / np.float32(np.sqrt(n_inputs))).astype(np.float32)


def _batch_bounds(n_windows: int) -> list[tuple[int, int]]:
    """Return the first window of each batch, and the one after its last."""
    starts = list(range(0, n_windows, BATCH_SIZE))
    if len(starts) > 1 and n_windows - starts[-1] == 1:
        # A last batch of one window joins the one before: one window has no deviation.
        del starts[-1]
    return list(zip(starts, [*starts[1:], n_windows], strict=True))


def _fold_normalization(
    weights: Weights, mean: np.ndarray, variance: np.ndarray
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Return the layers without batch normalization, which running moments make linear."""
    scale = weights["gain"] / np.sqrt(variance + MIN_VARIANCE)
    return {
        "hidden": weights["first"] * scale.swapaxes(-1, -2),
        "hidden.bias": (weights["shift"] - mean * scale)[..., 0, :],
        "output": weights["second"],
        "output.bias": weights["bias"][..., 0, :],
    }
