"""What every network here has in common: it knows its own arguments, and its features before the last layer."""

from typing import Any, ClassVar, TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from swashtwin.foundation import InputError, TorchStream


def batches(order: Int[Tensor, " window"], size: int) -> list[Int[Tensor, " chosen"]]:
    """Places of windows, `size` of them in each step.

    A last step of a single window joins the one before: normalization over a batch has no deviation of one window.

    Examples
    --------
    >>> [len(batch) for batch in batches(torch.arange(9), 4)], [len(batch) for batch in batches(torch.arange(10), 4)]
    ([4, 5], [4, 4, 2])
    """
    steps = list(order.split(size))
    return [*steps[:-2], torch.cat(steps[-2:])] if len(steps) > 1 and len(steps[-1]) == 1 else steps


N = TypeVar("N", bound="Network")


class Network(nn.Module):
    """Base of the networks: windows in, one score per class out (softmax makes them probabilities).

    A subclass sets `name`, hands every argument of its constructor to this one, and defines `encode` and `head`; and
    `represent`, if it rests on something of a window that has no weights.

    Raises
    ------
    InputError
        A whole number among the settings is below 1, or `dropout` is no share.
    """

    name: ClassVar[str]
    """Key in the registry; saved models name their network by it."""
    closed_form: ClassVar[bool] = False
    """Whether `solve` finds the weights at once, so that `fit` runs no epochs."""
    head: nn.Module
    """Last layer, features to one score per class."""

    def __init__(self, **settings: Any) -> None:
        super().__init__()
        for word, value in settings.items():
            counts = value if isinstance(value, tuple) else (value,)
            if not counts:
                raise InputError(f"{self.name}: {word} needs as many as one entry.")
            if isinstance(counts[0], int) and min(counts) < 1 and not isinstance(value, bool):
                raise InputError(f"{self.name}: {word} ({min(counts)}) must be at least 1.")
        if not 0 <= settings.get("dropout", 0) < 1:
            share = settings["dropout"]
            raise InputError(f"{self.name}: dropout ({share:g}) is a share, at least 0 and below 1; a tenth is 0.1.")
        self.settings = settings
        """Arguments that build this network again; numbers, words, and tuples of these."""

    @property
    def n_channels(self) -> int:
        """Channels of a window."""
        return int(self.settings["n_channels"])

    @property
    def uses_speed(self) -> bool:
        """Whether `represent_at` looks at the speed."""
        return False

    @property
    def n_classes(self) -> int:
        """Classes told apart."""
        return int(self.settings["n_classes"])

    def represent(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window ..."]:
        """What `encode` takes of each window; it has no weights, so `fit` computes it once for all epochs."""
        return windows

    def represent_at(
        self, windows: Float[Tensor, "window channel time"], turns: Float[Tensor, " window"]
    ) -> Float[Tensor, "window ..."]:
        """`represent` for windows with so many turns of the shaft per sample, NaN where nobody stated it; most
        networks do not look at it."""
        return self.represent(windows)

    def encode(self, windows: Float[Tensor, "window ..."]) -> Float[Tensor, "window feature"]:
        """What the last layer sees of windows as `represent` gives them."""
        raise NotImplementedError

    def features(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window feature"]:
        """What the last layer sees of each window."""
        return self.encode(self.represent(windows))

    def forward(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window class"]:
        """Score per class and window, before softmax."""
        scores: Tensor = self.head(self.features(windows))
        return scores

    def pretrain(self, windows: Float[Tensor, "window ..."], seed: int) -> None:
        """Bring the weights where the supervised epochs are to start, without any class; most networks do nothing.

        `fit` calls it once, with what `represent` gives of all its training windows.
        """

    def solve(self, windows: Float[Tensor, "window ..."], target: Int[Tensor, " window"], seed: int) -> None:
        """Find the weights from what `represent` gives of all training windows, and their classes."""
        raise NotImplementedError

    def fresh(self: N, seed: int) -> N:
        """A network of the same settings with weights drawn from `seed`; the process's random state stays as it is."""
        with TorchStream(seed):
            return type(self)(**self.settings)
