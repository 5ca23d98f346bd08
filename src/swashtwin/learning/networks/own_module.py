"""A person's own `torch.nn.Module` as a network."""

from collections.abc import Callable
from typing import Any, ClassVar

from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.foundation import InputError
from swashtwin.learning.networks.network import Network


class OwnModule(Network):
    """A module that `register_network` made known; `embed` gives its scores, since its features are not known.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    length : samples per window and channel.
    **settings : further arguments of the function that builds the module.

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
            raise InputError(f"network {self.name!r} was built as a {type(module).__name__}; it must be an nn.Module.")
        if not any(True for _ in module.parameters()):
            raise InputError(f"network {self.name!r} has no weight to train.")
        self.module = module
        self.head = nn.Identity()

    def encode(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window class"]:
        """Score per class and window.

        Raises
        ------
        InputError
            The module gives another shape.
        """
        scores: Tensor = self.module(windows)
        if scores.shape != (len(windows), self.n_classes):
            raise InputError(
                f"network {self.name!r} gives the shape {tuple(scores.shape)} for {len(windows)} windows; it must give "
                f"one score per class, {(len(windows), self.n_classes)}, before softmax."
            )
        return scores
