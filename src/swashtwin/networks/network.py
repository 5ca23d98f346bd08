"""What every network here has in common: it knows its own arguments, and its features before the last layer."""

from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn


class Network(nn.Module):
    """Base of the networks: windows in, one score per class out (softmax makes them probabilities).

    A subclass sets `name`, hands every argument of its constructor to this one, and defines `features` and `head`.
    """

    name: ClassVar[str]
    """Key in the registry; saved models name their network by it."""
    head: nn.Module
    """Last layer, features to one score per class."""

    def __init__(self, **settings: Any) -> None:
        super().__init__()
        self.settings = settings
        """Arguments that build this network again; numbers, words, and tuples of these."""

    @property
    def n_channels(self) -> int:
        """Channels of a window."""
        return int(self.settings["n_channels"])

    @property
    def n_classes(self) -> int:
        """Classes told apart."""
        return int(self.settings["n_classes"])

    def features(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window feature"]:
        """What the last layer sees of each window."""
        raise NotImplementedError

    def forward(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window class"]:
        """Score per class and window, before softmax."""
        scores: Tensor = self.head(self.features(windows))
        return scores

    def fresh(self, seed: int) -> "Network":
        """A network of the same settings with weights drawn from `seed`; the caller's random state stays as it is."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return type(self)(**self.settings)
