"""What all networks have in common, and those whose weights are found at once: no epochs, no
automatic derivatives.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import InputError


class Configured:
    """What networks of both kinds have in common: a name, and the settings that build one again."""

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
        """Classes told apart."""
        return int(self.settings["n_classes"])

    @property
    def uses_speed(self) -> bool:
        """Whether `represent_at` looks at the speed."""
        return False


def require_sizes(name: str, settings: dict[str, Any]) -> None:
    """Refuse a whole number below 1 among the settings of a network, and a `dropout` that is no
    share.
    """
    for word, value in settings.items():
        counts = value if isinstance(value, tuple) else (value,)
        if not counts:
            raise InputError(f"{name}: {word} needs as many as one entry.")
        if isinstance(counts[0], int) and min(counts) < 1 and not isinstance(value, bool):
            raise InputError(f"{name}: {word} ({min(counts)}) must be at least 1.")
    if not 0 <= settings.get("dropout", 0) < 1:
        share = settings["dropout"]
        raise InputError(
            f"{name}: dropout ({share:g}) is a share, at least 0 and below 1; a tenth is 0.1."
        )


def require_shapes(
    needed: Mapping[str, tuple[int, ...]], weights: Mapping[str, np.ndarray]
) -> None:
    """Raise a `ValueError` that names a weight that is missing, unknown, or of another shape than
    needed.
    """
    shapes = {name: weight.shape for name, weight in weights.items()}
    for name in {**needed, **shapes}:
        if needed.get(name) != shapes.get(name):
            raise ValueError(
                f"weight {name} has the shape {shapes.get(name)}, its settings ask for {needed.get(name)}"
            )


class SolvedNetwork(Configured):
    """Base of the networks that numpy computes: windows in, the logarithm of each class's
    probability out.

    A subclass sets `name`, hands every argument of its constructor to this one, and defines
    `represent_at`, `solve`, `scores`, `loaded`, and `encode` where the last layer does not see the
    representation itself.

    Raises
    ------
    InputError
        A whole number among the settings is below 1, or `dropout` is no share.
    """

    def __init__(self, **settings: Any) -> None:
        require_sizes(self.name, settings)
        self.settings = settings
        self.weights: dict[str, np.ndarray] = {}
        """What `solve` found, by name; none before."""

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window value"]:
        """What the weights are found from, of windows with so many turns of the shaft per sample;
        NaN where nobody stated it.
        """
        raise NotImplementedError

    def encode(
        self, values: Float32[np.ndarray, "window value"]
    ) -> Float32[np.ndarray, "window feature"]:
        """What the last layer sees of windows as `represent_at` gives them."""
        return values

    def solve(
        self,
        values: Float32[np.ndarray, "window value"],
        target: Int[np.ndarray, " window"],
        seed: int,
    ) -> None:
        """Find the weights from what `represent_at` gives of all training windows, and their
        classes.
        """
        raise NotImplementedError

    def scores(
        self, values: Float32[np.ndarray, "window value"]
    ) -> Float64[np.ndarray, "window class"]:
        """Logarithm of each class's probability, of windows as `represent_at` gives them."""
        raise NotImplementedError

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "SolvedNetwork":
        """This network with the weights of a saved one; a `ValueError` where they are not of these
        settings.
        """
        raise NotImplementedError

    def probabilities(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window class"]:
        """Probability of each class; NaN where a value or a score of the window is no finite
        number.
        """
        values = self.represent_at(windows, turns)
        finite = np.isfinite(values).all(axis=1)
        scores = self.scores(np.where(finite[:, None], values, np.float32(0)))
        return np.where(finite[:, None], scipy.special.softmax(scores, axis=1), np.nan)

    def embedding(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window feature"]:
        """What the last layer sees of each window."""
        return self.encode(self.represent_at(windows, turns)).astype(np.float64)
