"""The temporal convolutional network on which BiTCN is based."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import weight_norm

from swashtwin.learning import Network


def pad_to_patches(
    windows: Float[Tensor, "window channel time"], patch: int
) -> Float[Tensor, "window channel longer"]:
    """Return `windows` with leading zeros, so that their length is a multiple of `patch`."""
    return functional.pad(windows, (-windows.shape[-1] % patch, 0))


class TemporalBlock(nn.Module):
    """Two dilated causal convolutions with weight normalization, ReLU and dropout, and a skip."""

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
        """Return features of the same length."""
        features = self._convolve(self.first, x)
        features = self._convolve(self.second, features)
        return torch.relu(features + self.skip(x))

    def _convolve(self, convolution: nn.Module, x: Tensor) -> Tensor:
        padded = functional.pad(x, (self.padding, 0))  # leading zeros only: it is causal
        features: Tensor = self.dropout(torch.relu(convolution(padded)))
        return features


class TCN(Network):
    """Temporal convolutional network of Bai, Kolter and Koltun 2018.

    DOI 10.48550/arXiv.1803.01271. Blocks of growing dilation; the features are those of the last
    step, which depends on `receptive_field` samples. Blocks, weight normalization and the use of
    the last step are theirs; the strided convolution at the entry is **our reading**, since they
    had no signals of thousands of samples.

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
    n_classes : number of classes.
    kernel_size : taps of each convolution.
    channels : features of each block; the dilations are 1, 2, 4, 8, ...
    dropout : share of the features that is dropped in training.
    stride : samples per step of the network; 1 makes each sample a step.

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
            n_channels=n_channels,
            n_classes=n_classes,
            kernel_size=kernel_size,
            channels=channels,
            dropout=dropout,
            stride=stride,
        )
        self.entry = nn.Conv1d(n_channels, channels[0], stride, stride=stride)

        blocks = []
        n_inputs = channels[0]
        for index, n_outputs in enumerate(channels):
            block = TemporalBlock(
                n_inputs, n_outputs, kernel_size=kernel_size, dilation=2**index, dropout=dropout
            )
            blocks.append(block)
            n_inputs = n_outputs
        self.blocks = nn.Sequential(*blocks)
        self.head = nn.Linear(channels[-1], n_classes)

    @property
    def receptive_field(self) -> int:
        """Samples on which a step depends: stride · (1 + 2 (kernel_size - 1) (2^blocks - 1))."""
        taps = 2 * (self.settings["kernel_size"] - 1) * (2 ** len(self.settings["channels"]) - 1)
        return int(self.settings["stride"] * (1 + taps))

    def steps(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature step"]:
        """Return the features of each step, which do not depend on later samples."""
        features: Tensor = self.blocks(self.entry(pad_to_patches(windows, self.settings["stride"])))
        return features

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the features of the last step."""
        return self.steps(windows)[:, :, -1]
