"""What all networks have in common, and the networks that numpy solves without epochs."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import InputError


class Configured:
    """A name, and the settings that build the network again."""

    name: ClassVar[str]
    """Key in the registry; saved models name their network by it."""
    has_gradients: ClassVar[bool] = False
    """Whether its answer can be traced to bands (`explain`)."""
    settings: dict[str, Any]
    """Arguments that build this network again: numbers, words, and tuples of these."""

    @property
    def n_channels(self) -> int:
        """Channels of a window."""
        return int(self.settings["n_channels"])

    @property
    def n_classes(self) -> int:
        """Number of classes."""
        return int(self.settings["n_classes"])

    @property
    def uses_speed(self) -> bool:
        """Whether `represent_at` uses the speed."""
        return False


def require_sizes(name: str, settings: dict[str, Any]) -> None:
    """Raise an `InputError` if an integer setting is below 1, or `dropout` is not a share.

    Parameters
    ----------
    name : name of the network.
    """
    for setting, value in settings.items():
        entries = value if isinstance(value, tuple) else (value,)
        if not entries:
            raise InputError(f"{name}: {setting} needs at least one entry.")
        is_size = isinstance(entries[0], int) and not isinstance(value, bool)
        if is_size and min(entries) < 1:
            raise InputError(f"{name}: {setting} ({min(entries)}) must be at least 1.")

    dropout = settings.get("dropout", 0)
    if not 0 <= dropout < 1:
        raise InputError(
            f"{name}: dropout ({dropout:g}) is a share, at least 0 and below 1; a tenth is 0.1."
        )


def require_shapes(
    expected: Mapping[str, tuple[int, ...]], weights: Mapping[str, np.ndarray]
) -> None:
    """Raise a `ValueError` that names a weight that is missing, unknown, or of another shape."""
    shapes = {name: weight.shape for name, weight in weights.items()}
    for name in {**expected, **shapes}:
        if expected.get(name) != shapes.get(name):
            raise ValueError(
                f"weight {name} has the shape {shapes.get(name)}, but its settings require "
                f"{expected.get(name)}"
            )


class SolvedNetwork(Configured):
    """Base of the networks that numpy computes: windows in, log-probabilities of classes out.

    A subclass sets `name`, passes every argument of its constructor to this one, and defines
    `represent_at`, `solve`, `scores`, `loaded`, and `encode` unless the last layer sees the
    representation itself.

    Raises
    ------
    InputError
        An integer setting is below 1, or `dropout` is not a share.
    """

    def __init__(self, **settings: Any) -> None:
        require_sizes(self.name, settings)
        self.settings = settings
        self.weights: dict[str, np.ndarray] = {}
        """Result of `solve`, by name; empty before it."""

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window value"]:
        """Return the representation of windows from which weights are found.

        Parameters
        ----------
        turns : turns of the shaft per sample; NaN if the speed is not known.
        """
        raise NotImplementedError

    def encode(
        self, values: Float32[np.ndarray, "window value"]
    ) -> Float32[np.ndarray, "window feature"]:
        """Return what the last layer sees of windows that `represent_at` returned."""
        return values

    def solve(
        self,
        values: Float32[np.ndarray, "window value"],
        target: Int[np.ndarray, " window"],
        seed: int,
    ) -> None:
        """Find the weights from the representation of all training windows, and their classes."""
        raise NotImplementedError

    def scores(
        self, values: Float32[np.ndarray, "window value"]
    ) -> Float64[np.ndarray, "window class"]:
        """Return the logarithm of each class's probability, from the representation of windows."""
        raise NotImplementedError

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "SolvedNetwork":
        """Return this network with saved weights; raise a `ValueError` if they do not fit."""
        raise NotImplementedError

    def probabilities(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window class"]:
        """Return the probability of each class; NaN if a value of the window is not finite."""
        values = self.represent_at(windows, turns)
        is_finite = np.isfinite(values).all(axis=1)[:, None]
        scores = self.scores(np.where(is_finite, values, np.float32(0)))
        return np.where(is_finite, scipy.special.softmax(scores, axis=1), np.nan)

    def embedding(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window feature"]:
        """Return what the last layer sees of each window."""
        return self.encode(self.represent_at(windows, turns)).astype(np.float64)
