"""Base of the networks that torch trains, and a wrapper of a user's own module."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int
from torch import Tensor, nn

from swashtwin.foundation import InputError, TorchStream
from swashtwin.learning.networks.solved_network import Configured, require_sizes


def batches(order: Int[Tensor, " window"], size: int) -> list[Int[Tensor, " _window"]]:
    """Return the windows of each step, `size` of them.

    A last step of a single window joins the one before: normalization over a batch needs two.
    """
    steps = list(order.split(size))
    if len(steps) > 1 and len(steps[-1]) == 1:
        return [*steps[:-2], torch.cat(steps[-2:])]
    return steps


N = TypeVar("N", bound="Network")


class Network(Configured, nn.Module):
    """Base of the networks: windows in, one score per class out; softmax gives probabilities.

    A subclass sets `name`, passes every argument of its constructor to this one, and defines
    `encode` and `head`; and `represent`, if it uses something of a window that has no weights.

    Raises
    ------
    InputError
        An integer setting is below 1, or `dropout` is not a share.
    """

    has_gradients: ClassVar[bool] = True
    is_capturable: ClassVar[bool] = False
    """Whether a training step can be captured as a CUDA graph: it reads no values of tensors on
    the host, does the same whatever they are, and draws with operations that take a generator only.
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
        """Return what `encode` takes of each window.

        It has no weights, so `fit` computes it once for all epochs.
        """
        return windows

    def represent_at(
        self, windows: Float[Tensor, "window channel time"], turns: Float[Tensor, " window"]
    ) -> Float[Tensor, "window ..."]:
        """Return `represent` of windows at turns of the shaft per sample, NaN if not known.

        Most networks do not use it.
        """
        return self.represent(windows)

    def encode(self, windows: Float[Tensor, "window ..."]) -> Float[Tensor, "window feature"]:
        """Return what the last layer sees of windows that `represent` returned."""
        raise NotImplementedError

    def features(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return what the last layer sees of each window."""
        return self.encode(self.represent(windows))

    def forward(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window class"]:
        """Return the score per class and window, before softmax."""
        scores: Tensor = self.head(self.features(windows))
        return scores

    def pretrain(self, windows: Float[Tensor, "window ..."], seed: int) -> None:
        """Set the weights from which supervised epochs start, without classes.

        Most networks do nothing. `fit` calls it once, with what `represent` returns of all its
        training windows.
        """

    def fresh(self: N, seed: int) -> N:
        """Return a network of the same settings with weights drawn from `seed`.

        The process's random state does not change.
        """
        with TorchStream(seed):
            return type(self)(**self.settings)

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Weights by name."""
        return {name: value.cpu().numpy() for name, value in self.state_dict().items()}

    def loaded(self: N, weights: Mapping[str, np.ndarray]) -> N:
        """Return this network in evaluation mode, with saved weights."""
        self.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
        return self.eval()

    def probabilities(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window class"]:
        """Return the probability of each class; NaN if a feature or a score is not finite."""

        def answer(represented: Tensor) -> Tensor:
            features = self.encode(represented)
            probability = torch.softmax(self.head(features).double(), dim=-1)
            is_finite = torch.stack(
                [
                    values.flatten(1).isfinite().all(dim=1)
                    for values in (represented, features, probability)
                ]
            ).all(dim=0)
            return probability.masked_fill(~is_finite[:, None], torch.nan)

        return self._apply_to(windows, turns, answer)

    def embedding(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float64[np.ndarray, "window feature"]:
        """Return what the last layer sees of each window."""
        return self._apply_to(windows, turns, lambda represented: self.encode(represented).double())

    def _apply_to(
        self, windows: np.ndarray, turns: np.ndarray, function: Callable[[Tensor], Tensor]
    ) -> np.ndarray:
        """Apply a function to the representation of windows, on the device of the weights."""
        device = next(self.parameters()).device
        with torch.no_grad():
            represented = self.represent_at(
                torch.from_numpy(windows).to(device), torch.from_numpy(turns).to(device)
            )
            return function(represented).cpu().numpy()


class OwnModule(Network):
    """A user's `torch.nn.Module` that `register_network` registered; `embed` returns its scores.

    Raises
    ------
    InputError
        The function returns no module, or one without weights.
    """

    build: ClassVar[Callable[..., nn.Module]]
    """Builds the module from ``(n_channels, n_classes, length, **settings)``."""

    def __init__(self, n_channels: int, n_classes: int, *, length: int, **settings: Any) -> None:
        super().__init__(n_channels=n_channels, n_classes=n_classes, length=length, **settings)
        module = type(self).build(n_channels, n_classes, length, **settings)
        if not isinstance(module, nn.Module):
            raise InputError(
                f"network {self.name!r} was built as a {type(module).__name__}; it must be an "
                "nn.Module."
            )
        if not any(True for _ in module.parameters()):
            raise InputError(f"network {self.name!r} has no weight to train.")
        self.module = module
        self.head = nn.Identity()

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window class"]:
        """Return the score per class and window.

        Raises
        ------
        InputError
            The module returns another shape.
        """
        scores: Tensor = self.module(windows)
        expected = (len(windows), self.n_classes)
        if scores.shape != expected:
            raise InputError(
                f"network {self.name!r} gives the shape {tuple(scores.shape)} for {len(windows)} "
                f"windows; it must give one score per class, {expected}, before softmax."
            )
        return scores
