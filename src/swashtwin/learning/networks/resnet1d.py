"""Residual network for time series."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning.networks.network import Network, whole_patches

_KERNELS = (8, 5, 3)


class ResidualBlock(nn.Module):
    """Three centered convolutions of 8, 5 and 3 taps with batch normalization, and a normalized skip around them."""

    def __init__(self, n_in: int, n_out: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for index, kernel_size in enumerate(_KERNELS):
            layers += [
                nn.ConstantPad1d(((kernel_size - 1) // 2, kernel_size // 2), 0.0),
                nn.Conv1d(n_out if index else n_in, n_out, kernel_size, bias=False),
                nn.BatchNorm1d(n_out),
                nn.ReLU(),
            ]
        self.layers = nn.Sequential(*layers[:-1])
        widen = nn.Identity() if n_in == n_out else nn.Conv1d(n_in, n_out, 1, bias=False)
        self.skip = nn.Sequential(widen, nn.BatchNorm1d(n_out))

    def forward(self, x: Float[Tensor, "window feature_in time"]) -> Float[Tensor, "window feature_out time"]:
        """Features of the same length."""
        return torch.relu(self.layers(x) + self.skip(x))


class ResNet1d(Network):
    """Residual network for time series, Wang, Yan and Oates 2017 (DOI 10.1109/IJCNN.2017.7966039).

    Three blocks of three convolutions and the mean over time, as theirs; the strided convolution before them is **our
    reading**, since at 2,048 samples a window their network costs minutes an epoch. Weights, with C = `n_channels`,
    F_i = ``channels[i]``, F_{-1} = F_0, p = `stride`:

    ===================================== =================
    ``entry``                             (F_0, C, p)
    ``blocks.i.layers.1``                 (F_i, F_{i-1}, 8)
    ``blocks.i.layers.5``                 (F_i, F_i, 5)
    ``blocks.i.layers.9``                 (F_i, F_i, 3)
    ``blocks.i.skip.0`` if F_i ≠ F_{i-1}  (F_i, F_{i-1}, 1)
    ``head``                              (classes, F_last)
    ===================================== =================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    channels : features of each block.
    stride : samples per step of the network.

    Examples
    --------
    >>> ResNet1d(1, 5).receptive_field
    320
    """

    name: ClassVar[str] = "resnet1d"

    def __init__(
        self, n_channels: int, n_classes: int, *, channels: Sequence[int] = (64, 128, 128), stride: int = 8
    ) -> None:
        channels = tuple(channels)
        super().__init__(n_channels=n_channels, n_classes=n_classes, channels=channels, stride=stride)
        self.entry = nn.Conv1d(n_channels, channels[0], stride, stride=stride)
        widths = zip((channels[0], *channels[:-1]), channels, strict=True)
        self.blocks = nn.Sequential(*(ResidualBlock(n_in, n_out) for n_in, n_out in widths))
        self.head = nn.Linear(channels[-1], n_classes)

    @property
    def receptive_field(self) -> int:
        """Samples on which one step rests before the mean over time: stride · (1 + 13 blocks)."""
        taps = sum(kernel_size - 1 for kernel_size in _KERNELS) * len(self.settings["channels"])
        return int(self.settings["stride"] * (1 + taps))

    def steps(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window feature step"]:
        """Features of each step."""
        features: Tensor = self.blocks(self.entry(whole_patches(windows, self.settings["stride"])))
        return features

    def encode(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window feature"]:
        """Mean of the features over the window."""
        return self.steps(windows).mean(dim=-1)
