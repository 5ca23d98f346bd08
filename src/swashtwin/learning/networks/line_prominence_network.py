"""Prominences of lines in a window, which a discriminant and a hidden layer classify."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Float32

from swashtwin.learning.networks.feature_network import HEADS, FeatureNetwork
from swashtwin.learning.networks.line_prominences import (
    line_prominences,
    n_features,
    prominent_bands,
)
from swashtwin.signals import BandPower


class LineProminenceNetwork(FeatureNetwork):
    """Prominences of lines over the floor around them, and a discriminant, a hidden layer or both.

    Its features (`line_prominences`) are made for rolling bearings and motors: lines of the signal
    and of squared envelopes in orders of the shaft (or at equal distances in hertz), combs of lines
    with their side bands, and the shape of the spectrum. No gain changes them. This network is our
    own; `FeatureNetwork` describes its heads, its weights and its parameters.

    Examples
    --------
    >>> network = LineProminenceNetwork(1, 5)
    >>> network.represent_at(np.zeros((2, 1, 2048), dtype=np.float32), np.zeros(2)).shape
    (2, 280)
    """

    name: ClassVar[str] = "line_prominences"

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
    ) -> None:
        super().__init__(
            n_channels,
            n_classes,
            axis=axis,
            heads=heads,
            turns=turns,
            hidden=hidden,
            dropout=dropout,
            noise=noise,
        )

    @property
    def n_features(self) -> int:
        """Number of features of a channel."""
        return n_features(self.uses_speed)

    def catalogue(self, length: int) -> tuple[BandPower, ...]:
        """Return what each feature of a channel is of, in windows of `length` samples.

        Features are ordered channel after channel.
        """
        return prominent_bands(length, self.uses_speed)

    def measure(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"] | None,
    ) -> Float32[np.ndarray, "window channel feature"]:
        """Return the features of each channel."""
        return line_prominences(windows, turns)
