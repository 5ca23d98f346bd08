"""Levels of the whole window, and a discriminant or a hidden layer on them."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import scipy
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import DataError, InputError, random_stream
from swashtwin.learning.networks.solved_network import SolvedNetwork, require_shapes
from swashtwin.learning.networks.window_features import gain_response, window_bands, window_features
from swashtwin.learning.training.class_space import shrunk_covariance
from swashtwin.signals import BandPower

HEADS = ("discriminant", "hidden")
"""What decides on the levels; of both the average."""
AXES = ("order", "frequency")
"""Along what narrow lines are counted: orders of the shaft, or hertz."""

_LEAST_DEVIATION = 0.01
"""Least deviation that a level is divided by [log10 of power]; less is rounding."""
_RIDGE = 1e-6  # added to each variance, which a level that never changes has none of


class BandPowerNetwork(SolvedNetwork):
    """Levels of a window's spectrum and envelopes, decided on by a discriminant, a hidden layer, or
    both; ours.

    A level is log10 of a power: of narrow lines at the shaft's orders (or of equal width in hertz),
    of logarithmic bands, of the same of the envelope of all of the signal and of what lies above 1
    kHz and 4 kHz (at 25.6 kHz), and the shape of the distributions (`window_features`). With `shape`
    each channel's own level is subtracted, so that no gain changes anything.

    The discriminant is linear: Gaussian classes of one covariance, shrunk by Ledoit and Wolf (2004,
    DOI 10.1016/S0047-259X(03)00096-4), all classes alike likely. The hidden layer is trained by
    Adam (`fit_hidden`). Their probabilities are averaged.

    Weights, with L levels of a window, H = `hidden`:

    ============================ =================
    ``mean``, ``deviation``      (L,)
    ``discriminant``             (classes, L)
    ``hidden``                   (H, L)
    ``output``                   (classes, H)
    ``discriminant.bias``, ...   one for each row
    ============================ =================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    axis : one of `AXES`.
    shape : whether each channel's own level is subtracted.
    heads : some of `HEADS`.
    turns : turns of the shaft per sample where a window's speed is not stated; 0 refuses such
        windows.
    hidden : size of the hidden layer.
    dropout : share of its features dropped in training.
    noise : deviation of the noise on the levels when the hidden layer is trained, over theirs.

    Raises
    ------
    InputError
        A setting cannot be.

    Examples
    --------
    >>> BandPowerNetwork(1, 5).represent_at(np.zeros((2, 1, 2048), dtype=np.float32), np.zeros(2)).shape
    (2, 535)
    """

    name: ClassVar[str] = "band_powers"
    has_gradients: ClassVar[bool] = True

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        axis: str = "frequency",
        shape: bool = False,
        heads: Sequence[str] = HEADS,
        turns: float = 0.0,
        hidden: int = 128,
        dropout: float = 0.3,
        noise: float = 0.3,
    ) -> None:
        heads = tuple(heads)
        if axis not in AXES:
            raise InputError(f"{self.name}: axis {axis!r} is none of {', '.join(AXES)}.")
        if not heads or not set(heads) <= set(HEADS):
            raise InputError(
                f"{self.name}: heads ({', '.join(heads) or 'none'}) are some of {', '.join(HEADS)}."
            )
        if noise < 0 or turns < 0:
            raise InputError(
                f"{self.name}: noise ({noise:g}) and turns ({turns:g}) must not be negative."
            )
        super().__init__(
            n_channels=n_channels, n_classes=n_classes, axis=axis, shape=shape, heads=heads, turns=turns, hidden=hidden,
            dropout=dropout, noise=noise,
        )  # fmt: skip
        self.response = gain_response(self.uses_speed)

    @property
    def uses_speed(self) -> bool:
        """Whether narrow lines are orders of the shaft."""
        return bool(self.settings["axis"] == "order")

    def catalogue(self, length: int) -> tuple[BandPower, ...]:
        """What each level of a channel is of, in windows of `length` samples; a feature is level
        after level, channel after channel.
        """
        return window_bands(length, self.uses_speed)

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window level"]:
        """Levels of windows with so many turns of the shaft per sample; NaN takes the
        training's.
        """
        usual = self.settings["turns"]
        if self.uses_speed and not usual and np.isnan(turns).any():
            raise DataError(
                "the model counts orders of the shaft: state the speed, or train with turns (per sample)."
            )
        return self.shaped(
            window_features(
                windows, np.where(np.isnan(turns), usual, turns) if self.uses_speed else None
            )
        )

    def shaped(
        self, features: Float32[np.ndarray, "window channel level"]
    ) -> Float32[np.ndarray, "window value"]:
        """Levels of `window_features`, channel after channel; with `shape` less what each channel's
        own level adds.
        """
        if self.settings["shape"]:
            features = features - self.response * features[..., :1]
        return features.reshape(len(features), -1)

    def encode(
        self, values: Float32[np.ndarray, "window level"]
    ) -> Float[np.ndarray, "window level"]:
        """Levels in deviations of the training's."""
        return (values - self.weights["mean"]) / self.weights["deviation"]

    def solve(
        self,
        values: Float32[np.ndarray, "window level"],
        target: Int[np.ndarray, " window"],
        seed: int,
    ) -> None:
        """Find the weights from levels and classes."""
        solve_together([self], [values], target, seed)

    def log_probabilities(
        self, values: Float32[np.ndarray, "window level"]
    ) -> dict[str, Float64[np.ndarray, "window class"]]:
        """Logarithm of each class's probability by head."""
        features = self.encode(values)
        logarithms = {}
        for head in self.settings["heads"]:
            if head == "hidden":
                layer_input, layer = np.maximum(self._affine("hidden", features), 0), "output"
            else:
                layer_input, layer = features, head
            logarithms[head] = scipy.special.log_softmax(
                self._affine(layer, layer_input).astype(np.float64), axis=1
            )
        return logarithms

    def scores(
        self, values: Float32[np.ndarray, "window level"]
    ) -> Float64[np.ndarray, "window class"]:
        """Logarithm of the mean probability of the heads."""
        return mean_of_heads(list(self.log_probabilities(values).values()))

    def mean_gradient(
        self, features: Float32[np.ndarray, "window level"], label: int, rival: int, steps: int
    ) -> tuple[Float64[np.ndarray, "window level"], Float64[np.ndarray, " window"]]:
        """(mean gradient on the straight way from 0, change on it) of a class's score less that of
        its rival.

        `features` are as `encode` gives them, `steps` the points of the midpoint rule.
        """
        names = self.settings["heads"]
        inner = {head: (features @ self.weights[head].T).astype(np.float64) for head in names}
        slope = {head: np.zeros_like(part) for head, part in inner.items()}
        for step in range(steps):
            ways = {
                head: self._along(head, part, (step + 0.5) / steps) for head, part in inner.items()
            }
            for chosen, sign in ((label, 1.0), (rival, -1.0)):
                shares = scipy.special.log_softmax(
                    np.stack([way[0][:, chosen] for way in ways.values()], axis=1), axis=1
                )
                for head, share in zip(names, np.exp(shares).T, strict=True):
                    logarithm, active = ways[head]
                    change = -np.exp(logarithm)
                    change[:, chosen] += 1
                    change *= sign * share[:, None] / steps
                    slope[head] += (
                        change if active is None else (change @ self.weights["output"]) * active
                    )
        gradient = sum(part @ self.weights[head] for head, part in slope.items())
        margins = []
        for position in (1.0, 0.0):
            mean = mean_of_heads(
                [self._along(head, part, position)[0] for head, part in inner.items()]
            )
            margins.append(mean[:, label] - mean[:, rival])
        return np.asarray(gradient), margins[0] - margins[1]

    def _along(
        self, head: str, inner: Float64[np.ndarray, "window unit"], position: float
    ) -> tuple[Float64[np.ndarray, "window class"], np.ndarray | None]:
        """(log-probabilities of a head at a share of the way from 0, which hidden units are
        active).
        """
        sums = position * inner + self.weights[f"{head}.bias"]
        if head == "discriminant":
            return scipy.special.log_softmax(sums, axis=1), None
        active = sums > 0
        scores = (sums * active) @ self.weights["output"].T + self.weights["output.bias"]
        return scipy.special.log_softmax(scores, axis=1), active

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "BandPowerNetwork":
        """This network with the weights of a saved one; a `ValueError` where they are of another
        shape.
        """
        n_features, hidden = self.n_channels * len(self.response), self.settings["hidden"]
        needed: dict[str, tuple[int, ...]] = {"mean": (n_features,), "deviation": (n_features,)}
        layers = {"discriminant": (self.n_classes, n_features), "hidden": (hidden, n_features)}
        layers = {head: layers[head] for head in self.settings["heads"]}
        if "hidden" in layers:
            layers["output"] = (self.n_classes, hidden)
        for name, shape in layers.items():
            needed |= {name: shape, f"{name}.bias": shape[:1]}
        require_shapes(needed, weights)
        self.weights = dict(weights)
        return self

    def _affine(
        self, layer: str, x: Float[np.ndarray, "window unit"]
    ) -> Float[np.ndarray, "window row"]:
        return x @ self.weights[layer].T + self.weights[f"{layer}.bias"]


def solve_together(
    networks: Sequence[BandPowerNetwork],
    values: Sequence[Float32[np.ndarray, "window level"]],
    target: Int[np.ndarray, " window"],
    seed: int,
) -> None:
    """Find the weights of networks that differ in `shape` only, each from its levels; noise is
    drawn once for all.
    """
    heads, features = networks[0].settings["heads"], []
    for network, part in zip(networks, values, strict=True):
        deviation = (
            part.std(axis=0, ddof=1, dtype=np.float64) if len(part) > 1 else np.ones(part.shape[1])
        )
        network.weights = {
            "mean": part.mean(axis=0, dtype=np.float64).astype(np.float32),
            "deviation": np.maximum(deviation, _LEAST_DEVIATION).astype(np.float32),
        }
        features.append(network.encode(part))
        if "discriminant" in heads:
            network.weights |= discriminant(features[-1], target, network.n_classes)
    if "hidden" in heads:
        size, dropout, noise = (
            networks[0].settings[name] for name in ("hidden", "dropout", "noise")
        )
        layers = fit_hidden(
            np.stack(features),
            target,
            network.n_classes,
            size,
            dropout=dropout,
            noise=noise,
            seed=seed,
        )
        for index, network in enumerate(networks):
            network.weights |= {name: part[index] for name, part in layers.items()}


def mean_of_heads(
    logarithms: Sequence[Float64[np.ndarray, "window class"]],
) -> Float64[np.ndarray, "window class"]:
    """Logarithm of the mean of probabilities whose logarithms these are."""
    return np.asarray(np.logaddexp.reduce(np.stack(logarithms), axis=0) - np.log(len(logarithms)))


def discriminant(
    features: Float32[np.ndarray, "window level"],
    target: Int[np.ndarray, " window"],
    n_classes: int,
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Weights of the linear discriminant: W = S⁻¹ m_c, b = -m_cᵀ S⁻¹ m_c / 2, S the covariance
    within classes.
    """
    x = features.astype(np.float64)
    centers = np.stack([x[target == index].mean(axis=0) for index in range(n_classes)])
    covariance = shrunk_covariance(x - centers[target])
    covariance[np.diag_indices(len(covariance))] += _RIDGE
    factor = scipy.linalg.cho_factor(covariance, overwrite_a=True, check_finite=False)
    weight = scipy.linalg.cho_solve(factor, centers.T, check_finite=False).T
    bias = -(weight * centers).sum(axis=1) / 2
    return {"discriminant": weight.astype(np.float32), "discriminant.bias": bias.astype(np.float32)}


_PASSES, _BATCH, _RATE = 10, 128, 2e-3
_DECAYS, _LEAST = (0.9, 0.999), 1e-8
"""Of Adam's means of slopes and of their squares, and what is added to the root of the latter."""
_MOMENTUM, _LEAST_VARIANCE = 0.1, 1e-5
"""Of the running moments of batch normalization."""


def fit_hidden(
    features: Float32[np.ndarray, "*alike window level"],
    target: Int[np.ndarray, " window"],
    n_classes: int,
    size: int,
    *,
    dropout: float,
    noise: float,
    seed: int,
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Weights ``hidden`` and ``output`` of W₂ ReLU(W₁ x + b₁) + b₂, with their biases; x of mean 0
    and deviation 1.

    Trained by Adam (Kingma and Ba 2015, arXiv:1412.6980), its derivatives written out, for the
    cross-entropy, classes weighted alike, in ten passes with a rate that falls by a cosine. Before
    the ReLU stands batch normalization (Ioffe and Szegedy 2015, arXiv:1502.03167), which the
    weights given hold already, and after it dropout of a share of the `size` units; in each step
    noise of deviation `noise` is added to the levels; all kinds of these share the draws.
    """
    rng = random_stream(seed, "hidden layer")
    n, n_features = features.shape[-2:]
    alike = (*features.shape[:-2], 1, 1)
    weights = {
        "first": np.tile(_uniform(rng, (size, n_features), n_features), alike),
        "gain": np.ones((*alike[:-1], size), dtype=np.float32),
        "shift": np.zeros((*alike[:-1], size), dtype=np.float32),
        "second": np.tile(_uniform(rng, (n_classes, size), size), alike),
        "bias": np.tile(_uniform(rng, (1, n_classes), size), alike),
    }
    moments = {
        name: (np.zeros_like(value), np.zeros_like(value)) for name, value in weights.items()
    }
    class_weight = (
        n / (n_classes * np.maximum(np.bincount(target, minlength=n_classes), 1))
    ).astype(np.float32)
    mean, variance = np.zeros_like(weights["gain"]), np.ones_like(weights["gain"])
    starts = list(range(0, n, _BATCH))
    if len(starts) > 1 and n - starts[-1] == 1:
        del starts[
            -1
        ]  # a last step of one window joins the one before: one window has no deviation
    steps, step, keep = _PASSES * len(starts), 0, np.float32(1 - dropout)
    for _ in range(_PASSES):
        order = rng.permutation(n)
        for start, last in zip(starts, [*starts[1:], n], strict=True):
            rows = order[start:last]
            x = features[..., rows, :]
            if noise:
                x += np.float32(noise) * rng.standard_normal(x.shape[-2:], dtype=np.float32)
            sums = x @ weights["first"].swapaxes(-1, -2)
            center, spread = sums.mean(axis=-2, keepdims=True), sums.var(axis=-2, keepdims=True)
            unbiased = spread * (len(rows) / max(len(rows) - 1, 1))
            mean += _MOMENTUM * (center - mean)
            variance += _MOMENTUM * (unbiased - variance)
            inverse = 1 / np.sqrt(spread + np.float32(_LEAST_VARIANCE))
            scaled = (sums - center) * inverse
            mask = rng.random(sums.shape[-2:], dtype=np.float32) < keep if dropout else True
            before = scaled * weights["gain"] + weights["shift"]
            passing = ((before > 0) & mask) / keep
            active = before * passing
            scores = active @ weights["second"].swapaxes(-1, -2) + weights["bias"]
            slope = scipy.special.softmax(scores, axis=-1)
            slope[..., np.arange(len(rows)), target[rows]] -= 1
            share = class_weight[target[rows]]
            slope *= (share / share.sum())[:, None]
            back = (slope @ weights["second"]) * passing
            gradient = {
                "gain": (back * scaled).sum(axis=-2, keepdims=True), "shift": back.sum(axis=-2, keepdims=True),
                "second": slope.swapaxes(-1, -2) @ active, "bias": slope.sum(axis=-2, keepdims=True),
            }  # fmt: skip
            back = (
                back - gradient["shift"] / len(rows) - scaled * (gradient["gain"] / len(rows))
            ) * (weights["gain"] * inverse)
            gradient["first"] = back.swapaxes(-1, -2) @ x
            rate, step = _RATE * (1 + np.cos(np.pi * step / steps)) / 2, step + 1
            first_bias, second_bias = (1 - decay**step for decay in _DECAYS)
            for name, slope in gradient.items():
                first, second = moments[name]
                first += (1 - _DECAYS[0]) * (slope - first)
                second += (1 - _DECAYS[1]) * (slope * slope - second)
                change = np.sqrt(second / np.float32(second_bias))
                change += np.float32(_LEAST)
                np.divide(first, change, out=change)
                change *= np.float32(rate / first_bias)
                weights[name] -= change
    scale = weights["gain"] / np.sqrt(variance + np.float32(_LEAST_VARIANCE))
    return {
        "hidden": weights["first"] * scale.swapaxes(-1, -2),
        "hidden.bias": (weights["shift"] - mean * scale)[..., 0, :],
        "output": weights["second"],
        "output.bias": weights["bias"][..., 0, :],
    }


def _uniform(
    rng: np.random.Generator, shape: tuple[int, ...], n_inputs: int
) -> Float32[np.ndarray, "..."]:
    """First weights, uniform within one over the root of the number of inputs."""
    return ((2 * rng.random(shape, dtype=np.float32) - 1) / np.float32(np.sqrt(n_inputs))).astype(
        np.float32
    )
