"""A discriminant and a hidden layer that classify the features of a whole window."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import scipy
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import DataError, InputError
from swashtwin.learning.covariance import shrunk_covariance
from swashtwin.learning.networks.hidden_layer import fit_hidden_layer
from swashtwin.learning.networks.solved_network import SolvedNetwork, require_shapes
from swashtwin.signals import BandPower

HEADS = ("discriminant", "hidden")
"""Classifiers of the features; the probabilities of both are averaged."""
AXES = ("order", "frequency")
"""Axis of the narrow lines: orders of the shaft, or hertz."""

MIN_DEVIATION = 0.01
"""Smallest deviation that a feature is divided by [log10 of power]; less is rounding."""
RIDGE = 1e-6
"""Added to each variance of the discriminant, since that of a constant feature is 0."""


class FeatureNetwork(SolvedNetwork):
    """Base of the networks on features without weights: a discriminant, a hidden layer or both.

    A subclass defines `measure`, `n_features` and `catalogue`, and `shaped` if a setting changes
    the measured features.

    The discriminant is linear: Gaussian classes of one covariance, shrunk by Ledoit and Wolf (2004,
    DOI 10.1016/S0047-259X(03)00096-4), all classes equally likely. The hidden layer is trained by
    Adam (`fit_hidden_layer`). Their probabilities are averaged.

    Weights, with L features of a window, H = `hidden`:

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
    n_classes : number of classes.
    axis : one of `AXES`.
    heads : some of `HEADS`.
    turns : turns of the shaft per sample for windows without a speed; 0 refuses such windows.
    hidden : size of the hidden layer.
    dropout : share of its units dropped in training.
    noise : deviation of the noise on the features when the hidden layer is trained, over theirs.
    settings : further settings of the subclass.

    Raises
    ------
    InputError
        A setting is invalid.
    """

    has_gradients: ClassVar[bool] = True

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        axis: str = "frequency",
        heads: Sequence[str] = HEADS,
        turns: float = 0.0,
        hidden: int = 128,
        dropout: float = 0.3,
        noise: float = 0.3,
        **settings: Any,
    ) -> None:
        heads = tuple(heads)

        if axis not in AXES:
            raise InputError(f"{self.name}: axis {axis!r} must be one of {', '.join(AXES)}.")
        if not heads or not set(heads) <= set(HEADS):
            raise InputError(
                f"{self.name}: heads ({', '.join(heads) or 'none'}) must be some of "
                f"{', '.join(HEADS)}."
            )
        if noise < 0 or turns < 0:
            raise InputError(
                f"{self.name}: noise ({noise:g}) and turns ({turns:g}) must not be negative."
            )

        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            axis=axis,
            heads=heads,
            turns=turns,
            hidden=hidden,
            dropout=dropout,
            noise=noise,
            **settings,
        )

    @property
    def uses_speed(self) -> bool:
        """Whether narrow lines are orders of the shaft."""
        return bool(self.settings["axis"] == "order")

    @property
    def n_features(self) -> int:
        """Number of features of a channel."""
        raise NotImplementedError

    def catalogue(self, length: int) -> tuple[BandPower, ...]:
        """Return what each feature of a channel is of, in windows of `length` samples.

        Features are ordered channel after channel.
        """
        raise NotImplementedError

    def measure(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"] | None,
    ) -> Float32[np.ndarray, "window channel feature"]:
        """Return the features of each channel, before `shaped`.

        Parameters
        ----------
        turns : turns of the shaft per sample; None if the network does not use the speed.
        """
        raise NotImplementedError

    def shaped(
        self, features: Float32[np.ndarray, "window channel feature"]
    ) -> Float32[np.ndarray, "window value"]:
        """Return measured features as the heads take them, channel after channel."""
        return features.reshape(len(features), -1)

    def measure_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window channel feature"]:
        """Return `measure` of windows at turns of the shaft per sample.

        NaN stands for the setting `turns`.
        """
        if not self.uses_speed:
            return self.measure(windows, None)

        default_turns = self.settings["turns"]
        is_unknown = np.isnan(turns)
        if not default_turns and is_unknown.any():
            raise DataError(
                "the model counts orders of the shaft: specify the speed, or train with turns "
                "(per sample)."
            )
        return self.measure(windows, np.where(is_unknown, default_turns, turns))

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window feature"]:
        """Return the features of windows at turns of the shaft per sample.

        NaN stands for the setting `turns`.
        """
        return self.shaped(self.measure_at(windows, turns))

    def encode(
        self, values: Float32[np.ndarray, "window feature"]
    ) -> Float[np.ndarray, "window feature"]:
        """Return features in deviations of the training's."""
        return (values - self.weights["mean"]) / self.weights["deviation"]

    def solve(
        self,
        values: Float32[np.ndarray, "window feature"],
        target: Int[np.ndarray, " window"],
        seed: int,
    ) -> None:
        """Find the weights from features and classes."""
        solve_together([self], [values], target, seed)

    def log_probabilities(
        self, values: Float32[np.ndarray, "window feature"]
    ) -> dict[str, Float64[np.ndarray, "window class"]]:
        """Return the logarithm of each class's probability, by head."""
        features = self.encode(values)
        logarithms = {}
        for head in self.settings["heads"]:
            scores = self._apply_layer(head, features)
            if head == "hidden":
                scores = self._apply_layer("output", np.maximum(scores, 0))
            logarithms[head] = scipy.special.log_softmax(scores.astype(np.float64), axis=1)
        return logarithms

    def scores(
        self, values: Float32[np.ndarray, "window feature"]
    ) -> Float64[np.ndarray, "window class"]:
        """Return the logarithm of the mean probability of the heads."""
        return mean_of_heads(list(self.log_probabilities(values).values()))

    def mean_gradient(
        self, features: Float32[np.ndarray, "window feature"], label: int, rival: int, steps: int
    ) -> tuple[Float64[np.ndarray, "window feature"], Float64[np.ndarray, " window"]]:
        """Return the mean gradient of a class's margin over its rival, and the margin's change.

        Both are taken along the straight line from 0 to the features (integrated gradients). The
        margin is the score of `label` less that of `rival`.

        Parameters
        ----------
        features : as `encode` returns them.
        steps : points of the midpoint rule.
        """
        heads = self.settings["heads"]
        sums = {head: (features @ self.weights[head].T).astype(np.float64) for head in heads}

        # All slopes are by the sums of the first layer, which are fewer than the features.
        slopes = {head: np.zeros_like(values) for head, values in sums.items()}
        for step in range(steps):
            position = (step + 0.5) / steps
            answers = {
                head: self._answer_along(head, values, position) for head, values in sums.items()
            }
            for selected, sign in ((label, 1.0), (rival, -1.0)):
                # The mean of probabilities: a head counts by its share of the class's probability.
                logarithms = [answer[0][:, selected] for answer in answers.values()]
                shares = scipy.special.log_softmax(np.stack(logarithms, axis=1), axis=1)
                for head, share in zip(heads, np.exp(shares).T, strict=True):
                    logarithm, is_active = answers[head]
                    change = -np.exp(logarithm)
                    change[:, selected] += 1
                    change *= sign * share[:, None] / steps
                    if is_active is not None:
                        change = (change @ self.weights["output"]) * is_active
                    slopes[head] += change
        gradient = sum(slope @ self.weights[head] for head, slope in slopes.items())

        end_scores = self._scores_along(sums, 1.0)
        start_scores = self._scores_along(sums, 0.0)
        end_margin = end_scores[:, label] - end_scores[:, rival]
        start_margin = start_scores[:, label] - start_scores[:, rival]
        return np.asarray(gradient), end_margin - start_margin

    def _scores_along(
        self, sums: dict[str, Float64[np.ndarray, "window unit"]], position: float
    ) -> Float64[np.ndarray, "window class"]:
        """Return the scores at a position of the line, from the heads' `sums`."""
        return mean_of_heads(
            [self._answer_along(head, values, position)[0] for head, values in sums.items()]
        )

    def _answer_along(
        self, head: str, sums: Float64[np.ndarray, "window unit"], position: float
    ) -> tuple[Float64[np.ndarray, "window class"], np.ndarray | None]:
        """Return a head's log-probabilities and its active hidden units, if it has any.

        The features are scaled by `position`, and with them the `sums` of the first layer.
        """
        shifted = position * sums + self.weights[f"{head}.bias"]
        if head == "discriminant":
            return scipy.special.log_softmax(shifted, axis=1), None

        is_active = shifted > 0
        scores = (shifted * is_active) @ self.weights["output"].T + self.weights["output.bias"]
        return scipy.special.log_softmax(scores, axis=1), is_active

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "FeatureNetwork":
        """Return this network with saved weights; raise a `ValueError` if their shapes misfit."""
        n_features = self.n_channels * self.n_features
        hidden = self.settings["hidden"]
        layers = {}
        if "discriminant" in self.settings["heads"]:
            layers["discriminant"] = (self.n_classes, n_features)
        if "hidden" in self.settings["heads"]:
            layers["hidden"] = (hidden, n_features)
            layers["output"] = (self.n_classes, hidden)

        shapes: dict[str, tuple[int, ...]] = {"mean": (n_features,), "deviation": (n_features,)}
        for name, shape in layers.items():
            shapes[name] = shape
            shapes[f"{name}.bias"] = shape[:1]
        require_shapes(shapes, weights)
        self.weights = dict(weights)
        return self

    def _apply_layer(
        self, layer: str, x: Float[np.ndarray, "window unit"]
    ) -> Float[np.ndarray, "window row"]:
        return x @ self.weights[layer].T + self.weights[f"{layer}.bias"]


def solve_together(
    networks: Sequence[FeatureNetwork],
    values: Sequence[Float32[np.ndarray, "window feature"]],
    target: Int[np.ndarray, " window"],
    seed: int,
) -> None:
    """Find the weights of networks of the same size and heads, each from its features.

    Their hidden layers share all draws.
    """
    settings = networks[0].settings
    encoded = []
    for network, features in zip(networks, values, strict=True):
        deviation = np.ones(features.shape[1])
        if len(features) > 1:
            deviation = features.std(axis=0, ddof=1, dtype=np.float64)
        network.weights = {
            "mean": features.mean(axis=0, dtype=np.float64).astype(np.float32),
            "deviation": np.maximum(deviation, MIN_DEVIATION).astype(np.float32),
        }
        encoded.append(network.encode(features))
        if "discriminant" in settings["heads"]:
            network.weights |= fit_discriminant(encoded[-1], target, network.n_classes)

    if "hidden" in settings["heads"]:
        layers = fit_hidden_layer(
            np.stack(encoded),
            target,
            networks[0].n_classes,
            settings["hidden"],
            dropout=settings["dropout"],
            noise=settings["noise"],
            seed=seed,
        )
        for index, network in enumerate(networks):
            network.weights |= {name: weight[index] for name, weight in layers.items()}


def mean_of_heads(
    logarithms: Sequence[Float64[np.ndarray, "window class"]],
) -> Float64[np.ndarray, "window class"]:
    """Return the logarithm of the mean of probabilities from their logarithms."""
    sums = np.logaddexp.reduce(np.stack(logarithms), axis=0)
    return np.asarray(sums - np.log(len(logarithms)))


def fit_discriminant(
    features: Float32[np.ndarray, "window feature"],
    target: Int[np.ndarray, " window"],
    n_classes: int,
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Return the weights of the linear discriminant.

    W = S⁻¹ m_c and b = -m_cᵀ S⁻¹ m_c / 2, with the mean m_c of each class and the covariance S
    within classes.
    """
    x = features.astype(np.float64)
    centers = np.stack([x[target == index].mean(axis=0) for index in range(n_classes)])
    covariance = shrunk_covariance(x - centers[target])
    covariance[np.diag_indices(len(covariance))] += RIDGE

    factor = scipy.linalg.cho_factor(covariance, overwrite_a=True, check_finite=False)
    weight = scipy.linalg.cho_solve(factor, centers.T, check_finite=False).T
    bias = -(weight * centers).sum(axis=1) / 2
    return {"discriminant": weight.astype(np.float32), "discriminant.bias": bias.astype(np.float32)}
