"""The temporal convolutional network that BiTCN grew out of."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import weight_norm

from swashtwin.learning import Network


def whole_patches(
    windows: Float[Tensor, "window channel time"], patch: int
) -> Float[Tensor, "window channel longer"]:
    """`windows` with zeros before them, so many that their length is a multiple of `patch`."""
    return functional.pad(windows, (-windows.shape[-1] % patch, 0))


class TemporalBlock(nn.Module):
    """Two dilated causal convolutions with weight normalization, each with ReLU and dropout, and a
    skip around them.
    """

    def __init__(
        self, n_in: int, n_out: int, *, kernel_size: int, dilation: int, dropout: float
    ) -> None:
        super().__init__()
        self.padding = dilation * (kernel_size - 1)
        self.first = weight_norm(nn.Conv1d(n_in, n_out, kernel_size, dilation=dilation))
        self.second = weight_norm(nn.Conv1d(n_out, n_out, kernel_size, dilation=dilation))
        self.dropout = nn.Dropout(dropout)
        self.skip = nn.Identity() if n_in == n_out else nn.Conv1d(n_in, n_out, 1)

    def forward(
        self, x: Float[Tensor, "window feature_in time"]
    ) -> Float[Tensor, "window feature_out time"]:
        """Features of the same length."""
        once = self.dropout(torch.relu(self.first(functional.pad(x, (self.padding, 0)))))
        twice = self.dropout(torch.relu(self.second(functional.pad(once, (self.padding, 0)))))
        return torch.relu(twice + self.skip(x))


class TCN(Network):
    """Temporal convolutional network of Bai, Kolter and Koltun 2018 (DOI
    10.48550/arXiv.1803.01271).

    Blocks of growing dilation, read at the last step, which sees `receptive_field` samples back.
    Their blocks, weight normalization and the readout of the last step are kept; the strided
    convolution at the entry is **our reading**, since they had no signals of thousands of samples.
    Weights, with C = `n_channels`, F_i = ``channels[i]``, k = `kernel_size`, p = `stride`:

    ==================================== =================
    ``entry``                            (F_0, C, p)
    ``blocks.i.first``                   (F_i, F_{i-1}, k)
    ``blocks.i.second``                  (F_i, F_i, k)
    ``blocks.i.skip`` if F_i ≠ F_{i-1}   (F_i, F_{i-1}, 1)
    ``head``                             (classes, F_last)
    ==================================== =================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    kernel_size : taps of each convolution.
    channels : features of each block; the dilations are 1, 2, 4, 8, ...
    dropout : share of the features dropped in training.
    stride : samples per step of the network; 1 reads every sample by itself.

    Examples
    --------
    >>> TCN(1, 5).receptive_field
    4040
    """

    name: ClassVar[str] = "tcn"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        kernel_size: int = 5,
        channels: Sequence[int] = (32, 32, 32, 32, 32, 32),
        dropout: float = 0.1,
        stride: int = 8,
    ) -> None:
        channels = tuple(channels)
        super().__init__(
            n_channels=n_channels, n_classes=n_classes, kernel_size=kernel_size, channels=channels, dropout=dropout,
            stride=stride,
        )  # fmt: skip
        self.entry = nn.Conv1d(n_channels, channels[0], stride, stride=stride)
        widths = zip((channels[0], *channels[:-1]), channels, strict=True)
        self.blocks = nn.Sequential(
            *(
                TemporalBlock(
                    n_in, n_out, kernel_size=kernel_size, dilation=2**block, dropout=dropout
                )
                for block, (n_in, n_out) in enumerate(widths)
            )
        )
        self.head = nn.Linear(channels[-1], n_classes)

    @property
    def receptive_field(self) -> int:
        """Samples on which one step rests: stride · (1 + 2 (kernel_size - 1) (2^blocks - 1))."""
        taps = 2 * (self.settings["kernel_size"] - 1) * (2 ** len(self.settings["channels"]) - 1)
        return int(self.settings["stride"] * (1 + taps))

    def steps(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature step"]:
        """Features of each step, none of which saw a later sample."""
        features: Tensor = self.blocks(self.entry(whole_patches(windows, self.settings["stride"])))
        return features

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Features of the last step."""
        return self.steps(windows)[:, :, -1]
