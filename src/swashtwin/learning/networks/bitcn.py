"""The paper's bidirectional temporal convolutional network."""

from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import InputError
from swashtwin.learning.networks.network import Network


class SqueezeExcitation(nn.Module):
    """Channel weights in (0, 1), from the mean of each channel over the window, that multiply the
    features.

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
        """`x` with each channel weighted."""
        return x * self.weights(x.mean(dim=-1)).unsqueeze(-1)

    def weights(self, mean: Float[Tensor, "window feature"]) -> Float[Tensor, "window feature"]:
        """Weight of each channel, from its mean."""
        return torch.sigmoid(self.excite(torch.relu(self.squeeze(mean))))


class ResidualUnit(nn.Module):
    """Dilated causal convolution, batch normalization, ReLU, dropout, squeeze-and-excitation, and a
    skip around them.

    Convolution weight (C_out, C_in, kernel_size); the skip is the identity, or a 1×1 convolution
    (C_out, C_in, 1) where the number of features changes. The padding, dilation · (kernel_size - 1)
    zeros, stands before the window only, or on both sides where the unit is not `causal`. Without
    `attention` no squeeze-and-excitation.
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
        """Features of the same length."""
        convolved = self.convolution(functional.pad(x, self.padding))
        weighted = self.attention(self.dropout(self.normalization(convolved).relu_()))
        return (weighted + self.skip(x)).relu_()


class Branch(nn.Module):
    """1×1 convolution, residual units of growing dilation, 1×1 convolution; reads its input from
    first to last.

    `unit` holds what all the residual units share.
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
        widths = zip((channels[0], *channels[:-1]), channels, dilations, strict=True)
        self.units = nn.Sequential(
            *(
                ResidualUnit(n_in, n_out, dilation=dilation, **unit)
                for n_in, n_out, dilation in widths
            )
        )
        self.exit = nn.Conv1d(channels[-1], channels[-1], 1)

    def forward(
        self, x: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature step"]:
        """Features per step; one step is `stride` samples."""
        features: Tensor = self.exit(self.units(self.entry(x)))
        return features


class BiTCN(Network):
    """Bidirectional temporal convolutional network of the paper (DOI 10.1177/00202940261419020).

    A positive branch reads the window in time order, an inverse branch of the same form reads it
    reversed. Both, turned to the same time order, and a 1×1 convolution of the input are added (the
    residual connection that fuses them); ReLU and the mean over time give the features, a fully
    connected layer the scores.

    The paper names the parts and trains 200 epochs, batch 30, learning rate 1e-3. It is silent on
    every size; all defaults here are **our reading**, and so are these: one convolution per
    residual unit, ReLU after the skip's sum, fusion by a sum and not by concatenation, the mean
    over time before the fully connected layer, and PyTorch's initial weights. Causality is each
    convolution's own: squeeze-and-excitation looks at the whole window.

    Weights, with C = `n_channels`, F_i = ``channels[i]``, k = `kernel_size`, p = `stride`, r =
    `reduction`:

    ======================================= =====================
    ``positive.entry``, ``inverse.entry``   (F_0, C, p)
    ``….units.i.convolution``               (F_i, F_{i-1}, k)
    ``….units.i.attention.squeeze``         (F_i / r, F_i)
    ``….units.i.attention.excite``          (F_i, F_i / r)
    ``….units.i.skip`` where F_i ≠ F_{i-1}  (F_i, F_{i-1}, 1)
    ``….exit``                              (F_last, F_last, 1)
    ``skip``                                (F_last, C, p)
    ``head``                                (classes, F_last)
    ======================================= =====================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    kernel_size : taps of each dilated convolution.
    channels : features of each residual unit; their number is the depth.
    dilations : dilation of each residual unit, as many as `channels`; by default 1, 2, 4, 8, ...,
        or all 1 where not `causal`.
    dropout : share of the features dropped in training.
    reduction : ratio by which squeeze-and-excitation narrows its hidden layer.
    stride : samples per step. 1 is the paper's 1×1 convolution at a branch's entry; above 1, the
        entry takes patches of `stride` samples without overlap, and training costs about that many
        times less.
    causal : whether no step of a branch sees later samples; otherwise each convolution is centered.
    attention : whether each residual unit ends in squeeze-and-excitation.
    bidirectional : whether there is an inverse branch.

    Examples
    --------
    >>> import torch
    >>> network = BiTCN(1, 5)
    >>> network(torch.zeros(2, 1, 1024)).shape
    torch.Size([2, 5])
    >>> network.receptive_field
    253
    """

    name: ClassVar[str] = "bitcn"
    is_capturable: ClassVar[bool] = True

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        kernel_size: int = 5,
        channels: Sequence[int] = (32, 32, 32, 64, 64, 64),
        dilations: Sequence[int] | None = None,
        dropout: float = 0.1,
        reduction: int = 4,
        stride: int = 1,
        causal: bool = True,
        attention: bool = True,
        bidirectional: bool = True,
    ) -> None:
        channels = tuple(channels)
        growth = 2 if causal else 1
        dilations = (
            tuple(growth**unit for unit in range(len(channels)))
            if dilations is None
            else tuple(dilations)
        )
        if not channels or len(channels) != len(dilations):
            raise InputError(
                f"BiTCN needs as many dilations ({len(dilations)}) as channels ({len(channels)}), and one."
            )
        unit = {
            "kernel_size": kernel_size, "dropout": dropout, "reduction": reduction, "causal": causal,
            "attention": attention,
        }  # fmt: skip
        super().__init__(
            n_channels=n_channels, n_classes=n_classes, channels=channels, dilations=dilations, stride=stride,
            bidirectional=bidirectional, **unit,
        )  # fmt: skip
        self.positive = Branch(n_channels, channels, dilations, stride=stride, **unit)
        self.inverse = (
            Branch(n_channels, channels, dilations, stride=stride, **unit)
            if bidirectional
            else None
        )
        self.skip = nn.Conv1d(n_channels, channels[-1], stride, stride=stride)
        self.head = nn.Linear(channels[-1], n_classes)

    @property
    def receptive_field(self) -> int:
        """Samples on which one step of one branch rests, before squeeze-and-excitation looks at the
        whole window.

        stride · (1 + (kernel_size - 1) · Σ dilations)
        """
        taps = (self.settings["kernel_size"] - 1) * sum(self.settings["dilations"])
        return int(self.settings["stride"] * (1 + taps))

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Fused features of both branches, averaged over the window."""
        short = -windows.shape[-1] % self.settings["stride"]
        x = functional.pad(
            windows, (short, 0)
        )  # before the branches part, so that both cut the same patches
        if self.training and can_fuse(x):
            from swashtwin.learning.networks.fused_branch import (
                fused_encoding,
            )  # numba, which no diagnosis needs

            return fused_encoding(self.positive, self.inverse, self.skip, x)
        fused = self.positive(x)
        if self.inverse is not None:
            fused = fused + self.inverse(x.flip(-1)).flip(-1)
        return (fused + self.skip(x)).relu_().mean(dim=-1)


def can_fuse(windows: Float[Tensor, "window channel time"]) -> bool:
    """Whether `fused_encoding` takes such windows: in 32 bits, on the CPU."""
    return (
        windows.device.type == "cpu"
        and windows.dtype == torch.float32
        and not torch.is_autocast_enabled("cpu")
    )
