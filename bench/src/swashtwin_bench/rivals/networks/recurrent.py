"""Recurrent networks, which read a window in patches and answer with what they remember at its
end.
"""

from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning import Network
from swashtwin_bench.rivals.networks.tcn import whole_patches


class Recurrent(Network):
    """Base of the recurrent networks; a subclass says which cell, and whether it reads both ways.

    A step takes `patch` samples of every channel at once. **Our reading**, for lack of any in the
    paper: 128 steps of 16 samples can be learned through, 2,048 steps of one sample hardly can, and
    would make the network a straw man. Weights, with C = `n_channels`, H = `hidden`, p = `patch`, g
    = 4 for LSTM and 3 for GRU, d = 2 where both ways are read, else 1; each direction has its own:

    ===================================== ==============
    ``recurrence.weight_ih_l0``           (g H, C p)
    ``recurrence.weight_hh_l0``           (g H, H)
    ``recurrence.weight_ih_l1`` and later (g H, d H)
    ``head``                              (classes, d H)
    ===================================== ==============

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    hidden : size of the state of each layer and direction.
    layers : recurrent layers above each other.
    patch : samples per step; 1 is the raw signal.
    dropout : share of the features dropped in training, between the layers and at the end.
    """

    cell: ClassVar[type[nn.LSTM] | type[nn.GRU]]
    bidirectional: ClassVar[bool]

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        hidden: int = 64,
        layers: int = 2,
        patch: int = 16,
        dropout: float = 0.1,
    ) -> None:
        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            hidden=hidden,
            layers=layers,
            patch=patch,
            dropout=dropout,
        )
        self.recurrence = self.cell(
            n_channels * patch,
            hidden,
            layers,
            batch_first=True,
            dropout=dropout if layers > 1 else 0.0,
            bidirectional=self.bidirectional,
        )
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Linear(hidden * (1 + self.bidirectional), n_classes)

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """State of the last layer after the last step of each direction."""
        patches = whole_patches(windows, self.settings["patch"]).unflatten(
            -1, (-1, self.settings["patch"])
        )
        output, _ = self.recurrence(patches.transpose(1, 2).flatten(2))
        hidden = self.settings["hidden"]
        ends = [
            output[:, -1, :hidden],
            output[:, 0, hidden:],
        ]  # the second is empty where one way is read
        dropped: Tensor = self.dropout(torch.cat(ends, dim=-1))
        return dropped


class LSTM(Recurrent):
    """Long short-term memory of Hochreiter and Schmidhuber 1997 (DOI 10.1162/neco.1997.9.8.1735),
    on patches.
    """

    name: ClassVar[str] = "lstm"
    cell = nn.LSTM
    bidirectional = False


class BiLSTM(Recurrent):
    """Bidirectional LSTM of Graves and Schmidhuber 2005 (DOI 10.1016/j.neunet.2005.06.042), on
    patches.
    """

    name: ClassVar[str] = "bilstm"
    cell = nn.LSTM
    bidirectional = True


class BiGRU(Recurrent):
    """Gated recurrent units of Cho et al. 2014 (DOI 10.3115/v1/D14-1179), read both ways, on
    patches.

    Sample both ways is of Schuster and Paliwal 1997 (DOI 10.1109/78.650093).
    """

    name: ClassVar[str] = "bigru"
    cell = nn.GRU
    bidirectional = True
