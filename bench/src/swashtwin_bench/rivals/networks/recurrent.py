"""Recurrent networks, which read a window in patches and classify by their last state."""

from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning import Network
from swashtwin_bench.rivals.networks.tcn import pad_to_patches


class Recurrent(Network):
    """Base of the recurrent networks; a subclass specifies the cell and the directions.

    A step takes `patch` samples of every channel at once. This is **our reading**, since the paper
    does not specify it: gradients pass through 128 steps of 16 samples, but hardly through 2,048
    steps of one sample, which would make the network a straw man. Weights, with C = `n_channels`,
    H = `hidden`, p = `patch`, g = 4 for LSTM and 3 for GRU, d = 2 if it is bidirectional, else 1;
    each direction has its weights:

    ===================================== ==============
    ``recurrence.weight_ih_l0``           (g H, C p)
    ``recurrence.weight_hh_l0``           (g H, H)
    ``recurrence.weight_ih_l1`` and later (g H, d H)
    ``head``                              (classes, d H)
    ===================================== ==============

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    hidden : size of the state of each layer and direction.
    layers : number of stacked recurrent layers.
    patch : samples per step; 1 is the raw signal.
    dropout : share of the features that is dropped in training, between layers and at the end.
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
        """Return the state of the last layer after the last step of each direction."""
        patch = self.settings["patch"]
        patches = pad_to_patches(windows, patch).unflatten(-1, (-1, patch))
        output, _ = self.recurrence(patches.transpose(1, 2).flatten(2))

        # The backward direction ends at the first step; its part is empty in a network without it.
        hidden = self.settings["hidden"]
        forward_state = output[:, -1, :hidden]
        backward_state = output[:, 0, hidden:]
        features: Tensor = self.dropout(torch.cat([forward_state, backward_state], dim=-1))
        return features


class LSTM(Recurrent):
    """Long short-term memory on patches, Hochreiter and Schmidhuber 1997.

    DOI 10.1162/neco.1997.9.8.1735.
    """

    name: ClassVar[str] = "lstm"
    cell = nn.LSTM
    bidirectional = False


class BiLSTM(Recurrent):
    """Bidirectional LSTM on patches, Graves and Schmidhuber 2005.

    DOI 10.1016/j.neunet.2005.06.042.
    """

    name: ClassVar[str] = "bilstm"
    cell = nn.LSTM
    bidirectional = True


class BiGRU(Recurrent):
    """Bidirectional gated recurrent units on patches, Cho et al. 2014 (DOI 10.3115/v1/D14-1179).

    Reading in both directions is due to Schuster and Paliwal 1997 (DOI 10.1109/78.650093).
    """

    name: ClassVar[str] = "bigru"
    cell = nn.GRU
    bidirectional = True
