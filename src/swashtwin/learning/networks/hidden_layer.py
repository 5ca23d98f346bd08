"""One hidden layer on levels, trained by Adam, its derivatives written out."""

import numpy as np
from jaxtyping import Float32, Int

from swashtwin.foundation import stream

_PASSES, _BATCH, _RATE = 10, 128, 2e-3
_DECAYS, _LEAST = (0.9, 0.999), 1e-8
"""Of Adam's means of slopes and of their squares, and what is added to the root of the latter."""
_MOMENTUM, _LEAST_VARIANCE = 0.1, 1e-5
"""Of the running moments of batch normalization."""


def fit_hidden(
    levels: Float32[np.ndarray, "window level"],
    target: Int[np.ndarray, " window"],
    n_classes: int,
    size: int,
    *,
    dropout: float,
    noise: float,
    seed: int,
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Weights ``hidden`` and ``output`` of W₂ ReLU(W₁ x + b₁) + b₂, with their biases.

    Trained by Adam (Kingma and Ba 2015, arXiv:1412.6980) for the cross-entropy, classes weighted alike, in ten passes
    with a rate that falls by a cosine. Before the ReLU stands batch normalization (Ioffe and Szegedy 2015,
    arXiv:1502.03167), which the weights given hold already, and after it dropout.

    Parameters
    ----------
    levels : of mean 0 and deviation 1.
    target : class of each, from 0.
    size : hidden units.
    dropout : share of them dropped in each step.
    noise : deviation of the noise added to the levels in each step.
    seed : seed of first weights, order, noise and dropout.
    """
    rng = stream(seed, "hidden layer")
    n, n_levels = levels.shape
    weights = {
        "first": _uniform(rng, (size, n_levels), n_levels),
        "gain": np.ones(size, dtype=np.float32),
        "shift": np.zeros(size, dtype=np.float32),
        "second": _uniform(rng, (n_classes, size), size),
        "bias": _uniform(rng, (n_classes,), size),
    }
    adam = _Adam(weights)
    class_weight = (n / (n_classes * np.maximum(np.bincount(target, minlength=n_classes), 1))).astype(np.float32)
    mean, variance = np.zeros(size, dtype=np.float32), np.ones(size, dtype=np.float32)
    starts = list(range(0, n, _BATCH))
    if len(starts) > 1 and n - starts[-1] == 1:
        del starts[-1]  # a last step of one window joins the one before: one window has no deviation
    steps, step, keep = _PASSES * len(starts), 0, np.float32(1 - dropout)
    for _ in range(_PASSES):
        order = rng.permutation(n)
        for first, last in zip(starts, [*starts[1:], n], strict=True):
            rows = order[first:last]
            x = levels[rows]
            if noise:
                x = x + np.float32(noise) * rng.standard_normal(x.shape, dtype=np.float32)
            sums = x @ weights["first"].T
            center, spread = sums.mean(axis=0), sums.var(axis=0)
            unbiased = spread * (len(rows) / max(len(rows) - 1, 1))
            mean += _MOMENTUM * (center - mean)
            variance += _MOMENTUM * (unbiased - variance)
            inverse = 1 / np.sqrt(spread + np.float32(_LEAST_VARIANCE))
            scaled = (sums - center) * inverse
            kept = rng.random(sums.shape, dtype=np.float32) < keep if dropout else True
            before = scaled * weights["gain"] + weights["shift"]
            passing = ((before > 0) & kept) / keep
            active = before * passing
            scores = active @ weights["second"].T + weights["bias"]
            scores -= scores.max(axis=1, keepdims=True)
            slope = np.exp(scores)
            slope /= slope.sum(axis=1, keepdims=True)
            slope[np.arange(len(rows)), target[rows]] -= 1
            share = class_weight[target[rows]]
            slope *= (share / share.sum())[:, None]
            back = (slope @ weights["second"]) * passing
            gradient = {
                "gain": (back * scaled).sum(axis=0), "shift": back.sum(axis=0),
                "second": slope.T @ active, "bias": slope.sum(axis=0),
            }  # fmt: skip
            back = (back - gradient["shift"] / len(rows) - scaled * (gradient["gain"] / len(rows))) * (
                weights["gain"] * inverse
            )
            gradient["first"] = back.T @ x
            adam.step(gradient, _RATE * (1 + np.cos(np.pi * step / steps)) / 2)
            step += 1
    scale = weights["gain"] / np.sqrt(variance + np.float32(_LEAST_VARIANCE))
    return {
        "hidden": weights["first"] * scale[:, None],
        "hidden.bias": weights["shift"] - mean * scale,
        "output": weights["second"],
        "output.bias": weights["bias"],
    }


def _uniform(rng: np.random.Generator, shape: tuple[int, ...], n_inputs: int) -> Float32[np.ndarray, "..."]:
    """First weights, uniform within one over the root of the number of inputs."""
    return ((2 * rng.random(shape, dtype=np.float32) - 1) / np.float32(np.sqrt(n_inputs))).astype(np.float32)


class _Adam:
    """Adam's moments of weights, which `step` changes in place."""

    def __init__(self, weights: dict[str, np.ndarray]) -> None:
        self._weights = weights
        self._moments = {name: (np.zeros_like(value), np.zeros_like(value)) for name, value in weights.items()}
        self._count = 0

    def step(self, gradient: dict[str, np.ndarray], rate: float) -> None:
        """Go on by one step against the gradient."""
        self._count += 1
        first_bias, second_bias = (1 - decay**self._count for decay in _DECAYS)
        for name, slope in gradient.items():
            mean, square = self._moments[name]
            mean += (1 - _DECAYS[0]) * (slope - mean)
            square += (1 - _DECAYS[1]) * (slope * slope - square)
            change = np.sqrt(square / np.float32(second_bias))
            change += np.float32(_LEAST)
            np.divide(mean, change, out=change)
            change *= np.float32(rate / first_bias)
            self._weights[name] -= change
