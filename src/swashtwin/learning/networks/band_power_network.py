"""Band powers of a whole window, which a discriminant and a hidden layer classify."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Float32

from swashtwin.learning.networks.feature_network import HEADS, FeatureNetwork
from swashtwin.learning.networks.window_features import gain_response, window_bands, window_features
from swashtwin.signals import BandPower


class BandPowerNetwork(FeatureNetwork):
    """Band powers of a window's spectrum and envelopes, and a discriminant, a hidden layer or both.

    A feature is log10 of a power: of narrow lines at the shaft's orders (or of equal width in
    hertz), of logarithmic bands, of the same of the envelope of all of the signal and of what lies
    above 1 kHz and 4 kHz (at 25.6 kHz), and the shape of the distributions (`window_features`).
    With `shape` each channel's overall level is subtracted, so that no gain changes anything. This
    network is our own; `FeatureNetwork` describes its heads, its weights and the other parameters.

    Parameters
    ----------
    shape : whether each channel's overall level is subtracted.

    Raises
    ------
    InputError
        A setting is invalid.

    Examples
    --------
    >>> network = BandPowerNetwork(1, 5)
    >>> network.represent_at(np.zeros((2, 1, 2048), dtype=np.float32), np.zeros(2)).shape
    (2, 535)
    """

    name: ClassVar[str] = "band_powers"

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
        super().__init__(
            n_channels,
            n_classes,
            axis=axis,
            heads=heads,
            turns=turns,
            hidden=hidden,
            dropout=dropout,
            noise=noise,
            shape=shape,
        )
        self.response = gain_response(self.uses_speed)

    @property
    def n_features(self) -> int:
        """Number of features of a channel."""
        return len(self.response)

    def catalogue(self, length: int) -> tuple[BandPower, ...]:
        """Return what each feature of a channel is of, in windows of `length` samples.

        Features are ordered channel after channel.
        """
        return window_bands(length, self.uses_speed)

    def measure(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"] | None,
    ) -> Float32[np.ndarray, "window channel feature"]:
        """Return the features of each channel, before `shaped`."""
        return window_features(windows, turns)

    def shaped(
        self, features: Float32[np.ndarray, "window channel feature"]
    ) -> Float32[np.ndarray, "window value"]:
        """Return the features of `window_features` channel after channel.

        With `shape` less what each channel's overall level adds.
        """
        if self.settings["shape"]:
            features = features - self.response * features[..., :1]
        return features.reshape(len(features), -1)
