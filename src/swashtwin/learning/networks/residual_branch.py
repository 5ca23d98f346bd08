"""Layers of a temporal convolutional network: one branch of `BiTCN`."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional


class SqueezeExcitation(nn.Module):
    """Multiply features by channel weights in (0, 1), from each channel's mean over the window.

    s = sigmoid(W₂ ReLU(W₁ mean_t(x) + b₁) + b₂), y = s ⊙ x, with W₁ (C/r, C) and W₂ (C, C/r).
    """

    def __init__(self, n_features: int, reduction: int) -> None:
        super().__init__()
        squeezed = max(1, n_features // reduction)
        self.squeeze = nn.Linear(n_features, squeezed)
        self.excite = nn.Linear(squeezed, n_features)

    def forward(
        self, x: Float[Tensor, "window feature time"]
    ) -> Float[Tensor, "window feature time"]:
        """Return `x` with each channel weighted."""
        return x * self.weights(x.mean(dim=-1)).unsqueeze(-1)

    def weights(self, mean: Float[Tensor, "window feature"]) -> Float[Tensor, "window feature"]:
        """Return the weight of each channel, from its mean."""
        return torch.sigmoid(self.excite(torch.relu(self.squeeze(mean))))


class ResidualUnit(nn.Module):
    """Dilated convolution, batch normalization, ReLU, dropout and attention, with a skip around.

    Convolution weight (C_out, C_in, kernel_size); the skip is the identity, or a 1×1 convolution
    (C_out, C_in, 1) if the number of features changes. The padding, dilation · (kernel_size - 1)
    zeros, stands before the window only, or on both sides if the unit is not `causal`. Without
    `attention` there is no squeeze-and-excitation.
    """

    def __init__(
        self,
        n_in: int,
        n_out: int,
        *,
        kernel_size: int,
        dilation: int,
        dropout: float,
        reduction: int,
        causal: bool = True,
        attention: bool = True,
    ) -> None:
        super().__init__()
        padding = dilation * (kernel_size - 1)
        self.padding = (padding, 0) if causal else (padding - padding // 2, padding // 2)
        self.convolution = nn.Conv1d(n_in, n_out, kernel_size, dilation=dilation)
        self.normalization = nn.BatchNorm1d(n_out)
        self.dropout = nn.Dropout(dropout)
        self.attention = SqueezeExcitation(n_out, reduction) if attention else nn.Identity()
        self.skip = nn.Identity() if n_in == n_out else nn.Conv1d(n_in, n_out, 1)

    def forward(
        self, x: Float[Tensor, "window feature_in time"]
    ) -> Float[Tensor, "window feature_out time"]:
        """Return features of the same length."""
        convolved = self.convolution(functional.pad(x, self.padding))
        weighted = self.attention(self.dropout(self.normalization(convolved).relu_()))
        return (weighted + self.skip(x)).relu_()


class Branch(nn.Module):
    """1×1 convolution, residual units of growing dilation, 1×1 convolution.

    It reads its input from first to last.

    Parameters
    ----------
    n_channels : channels of a window.
    channels : features of each residual unit.
    dilations : dilation of each residual unit.
    stride : samples per step.
    unit : further arguments that all residual units share.
    """

    def __init__(
        self,
        n_channels: int,
        channels: tuple[int, ...],
        dilations: tuple[int, ...],
        *,
        stride: int,
        **unit: Any,
    ) -> None:
        super().__init__()
        self.entry = nn.Conv1d(n_channels, channels[0], stride, stride=stride)
        units = []
        inputs = (channels[0], *channels[:-1])
        for n_in, n_out, dilation in zip(inputs, channels, dilations, strict=True):
            units.append(ResidualUnit(n_in, n_out, dilation=dilation, **unit))
        self.units = nn.Sequential(*units)
        self.exit = nn.Conv1d(channels[-1], channels[-1], 1)

    def forward(
        self, x: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature step"]:
        """Return features per step; one step is `stride` samples."""
        features: Tensor = self.exit(self.units(self.entry(x)))
        return features
