"""What every network here has in common: it knows its own arguments, and its features before the
last layer.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int
from torch import Tensor, nn

from swashtwin.foundation import InputError, TorchStream
from swashtwin.learning.networks.solved_network import Configured, require_sizes


def batches(order: Int[Tensor, " window"], size: int) -> list[Int[Tensor, " chosen"]]:
    """Places of windows, `size` of them in each step.

    A last step of a single window joins the one before: normalization over a batch has no deviation
    of one window.
    """
    steps = list(order.split(size))
    return [*steps[:-2], torch.cat(steps[-2:])] if len(steps) > 1 and len(steps[-1]) == 1 else steps


N = TypeVar("N", bound="Network")


class Network(Configured, nn.Module):
    """Base of the networks: windows in, one score per class out (softmax makes them probabilities).

    A subclass sets `name`, hands every argument of its constructor to this one, and defines
    `encode` and `head`; and `represent`, if it rests on something of a window that has no weights.

    Raises
    ------
    InputError
        A whole number among the settings is below 1, or `dropout` is no share.
    """

    has_gradients: ClassVar[bool] = True
    is_capturable: ClassVar[bool] = False
    """Whether a step of its training can be captured as a CUDA graph: it asks no tensor for its
    values, does the same whatever they are, and draws only with operations that take a
    generator.
    """
    head: nn.Module
    """Last layer, features to one score per class."""

    def __init__(self, **settings: Any) -> None:
        super().__init__()
        require_sizes(self.name, settings)
        self.settings = settings

    def represent(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window ..."]:
        """What `encode` takes of each window; it has no weights, so `fit` computes it once for all
        epochs.
        """
        return windows

    def represent_at(
        self, windows: Float[Tensor, "window channel time"], turns: Float[Tensor, " window"]
    ) -> Float[Tensor, "window ..."]:
        """`represent` for windows with so many turns of the shaft per sample, NaN where nobody
        stated it; most networks do not look at it.
        """
        return self.represent(windows)

    def encode(self, windows: Float[Tensor, "window ..."]) -> Float[Tensor, "window feature"]:
        """What the last layer sees of windows as `represent` gives them."""
        raise NotImplementedError

    def features(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """What the last layer sees of each window."""
        return self.encode(self.represent(windows))

    def forward(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window class"]:
        """Score per class and window, before softmax."""
        scores: Tensor = self.head(self.features(windows))
        return scores

    def pretrain(self, windows: Float[Tensor, "window ..."], seed: int) -> None:
        """Bring the weights where the supervised epochs are to start, without any class; most
        networks do nothing.

        `fit` calls it once, with what `represent` gives of all its training windows.
        """

    def fresh(self: N, seed: int) -> N:
        """A network of the same settings with weights drawn from `seed`; the process's random state
        stays as it is.
        """
        with TorchStream(seed):
            return type(self)(**self.settings)

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Weights by name."""
        return {name: value.cpu().numpy() for name, value in self.state_dict().items()}

    def loaded(self: N, weights: Mapping[str, np.ndarray]) -> N:
        """This network in evaluation mode, with the weights of a saved one."""
        self.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
        return self.eval()

    def probabilities(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window class"]:
        """Probability of each class; NaN where a feature or a score of the window is no finite
        number.
        """

        def answer(represented: Tensor) -> Tensor:
            features = self.encode(represented)
            probability = torch.softmax(self.head(features).double(), dim=-1)
            finite = [
                part.flatten(1).isfinite().all(dim=1)
                for part in (represented, features, probability)
            ]
            return probability.masked_fill(~torch.stack(finite).all(dim=0)[:, None], torch.nan)

        return self._through(windows, turns, answer)

    def embedding(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window feature"]:
        """What the last layer sees of each window."""
        return self._through(windows, turns, lambda represented: self.encode(represented).double())

    def _through(
        self, windows: np.ndarray, turns: np.ndarray, step: Callable[[Tensor], Tensor]
    ) -> np.ndarray:
        device = next(self.parameters()).device
        with torch.no_grad():
            batch, speed = (torch.from_numpy(part).to(device) for part in (windows, turns))
            return step(self.represent_at(batch, speed)).cpu().numpy()


class OwnModule(Network):
    """A person's own `torch.nn.Module`, which `register_network` made known; `embed` gives its
    scores.

    Raises
    ------
    InputError
        The function gives no module, or one without weights.
    """

    build: ClassVar[Callable[..., nn.Module]]
    """Builds the module from ``(n_channels, n_classes, length, **settings)``."""

    def __init__(self, n_channels: int, n_classes: int, *, length: int, **settings: Any) -> None:
        super().__init__(n_channels=n_channels, n_classes=n_classes, length=length, **settings)
        module = type(self).build(n_channels, n_classes, length, **settings)
        if not isinstance(module, nn.Module):
            raise InputError(
                f"network {self.name!r} was built as a {type(module).__name__}; it must be an nn.Module."
            )
        if not any(True for _ in module.parameters()):
            raise InputError(f"network {self.name!r} has no weight to train.")
        self.module = module
        self.head = nn.Identity()

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window class"]:
        """Score per class and window; an `InputError` where the module gives another shape."""
        scores: Tensor = self.module(windows)
        if scores.shape != (len(windows), self.n_classes):
            raise InputError(
                f"network {self.name!r} gives the shape {tuple(scores.shape)} for {len(windows)} windows; it must give "
                f"one score per class, {(len(windows), self.n_classes)}, before softmax."
            )
        return scores
