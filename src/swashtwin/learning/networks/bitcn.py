"""The paper's bidirectional temporal convolutional network."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import InputError
from swashtwin.learning.networks.network import Network
from swashtwin.learning.networks.residual_branch import Branch


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
    ``….units.i.skip`` if F_i ≠ F_{i-1}     (F_i, F_{i-1}, 1)
    ``….exit``                              (F_last, F_last, 1)
    ``skip``                                (F_last, C, p)
    ``head``                                (classes, F_last)
    ======================================= =====================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    kernel_size : taps of each dilated convolution.
    channels : features of each residual unit; their number is the depth.
    dilations : dilation of each residual unit, as many as `channels`; by default 1, 2, 4, 8, ...,
        or all 1 if not `causal`.
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
        if dilations is None:
            growth = 2 if causal else 1
            dilations = [growth**unit for unit in range(len(channels))]
        dilations = tuple(dilations)
        if not channels or len(channels) != len(dilations):
            raise InputError(
                f"BiTCN needs as many dilations ({len(dilations)}) as channels ({len(channels)}), "
                "and at least one."
            )
        unit = {
            "kernel_size": kernel_size,
            "dropout": dropout,
            "reduction": reduction,
            "causal": causal,
            "attention": attention,
        }
        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            channels=channels,
            dilations=dilations,
            stride=stride,
            bidirectional=bidirectional,
            **unit,
        )

        # The order in which layers are made is that in which a seed draws their weights.
        self.positive = Branch(n_channels, channels, dilations, stride=stride, **unit)
        self.inverse = None
        if bidirectional:
            self.inverse = Branch(n_channels, channels, dilations, stride=stride, **unit)
        self.skip = nn.Conv1d(n_channels, channels[-1], stride, stride=stride)
        self.head = nn.Linear(channels[-1], n_classes)

    @property
    def receptive_field(self) -> int:
        """Samples on which one step of one branch rests.

        stride · (1 + (kernel_size - 1) · Σ dilations). Squeeze-and-excitation looks at the whole
        window besides.
        """
        taps = (self.settings["kernel_size"] - 1) * sum(self.settings["dilations"])
        return int(self.settings["stride"] * (1 + taps))

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the fused features of both branches, averaged over the window."""
        # Padded before the branches part, so that both cut the same patches.
        n_missing = -windows.shape[-1] % self.settings["stride"]
        x = functional.pad(windows, (n_missing, 0))
        if self.training and can_fuse(x):
            # Imported here, because numba takes long to import and no diagnosis needs it.
            from swashtwin.learning.networks.fused_branch import fused_encoding

            return fused_encoding(self.positive, self.inverse, self.skip, x)

        fused = self.positive(x)
        if self.inverse is not None:
            fused = fused + self.inverse(x.flip(-1)).flip(-1)
        return (fused + self.skip(x)).relu_().mean(dim=-1)


def can_fuse(windows: Float[Tensor, "window channel time"]) -> bool:
    """Return whether `fused_encoding` takes such windows: in 32 bits, on the CPU."""
    return (
        windows.device.type == "cpu"
        and windows.dtype == torch.float32
        and not torch.is_autocast_enabled("cpu")
    )
