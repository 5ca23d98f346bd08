"""Convolutions followed by a recurrent network."""

from typing import ClassVar

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.learning import Network


class CNNLSTM(Network):
    """Convolutions followed by LSTM, Pan, He, Tang and Meng 2018 (DOI 10.5545/sv-jme.2018.5249).

    Two convolutions with ReLU and maximum pooling by 2 turn samples into steps, and one LSTM reads
    the steps; its last state describes the window. This order is theirs; sizes, batch
    normalization and strides are **our reading**. Weights, with C =
    `n_channels`, F = `width`, H = `hidden`:

    ============================= ============
    ``convolutions.0``            (F, C, 64)
    ``convolutions.4``            (2 F, F, 5)
    ``recurrence.weight_ih_l0``   (4 H, 2 F)
    ``recurrence.weight_hh_l0``   (4 H, H)
    ``head``                      (classes, H)
    ============================= ============

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    width : features of the first convolution; the second has twice as many.
    hidden : size of the state of the LSTM.
    stride : samples from step to step of the first convolution, which has 64 taps.
    dropout : share of the features that is dropped in training.
    """

    name: ClassVar[str] = "cnn_lstm"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        width: int = 32,
        hidden: int = 64,
        stride: int = 8,
        dropout: float = 0.1,
    ) -> None:
        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            width=width,
            hidden=hidden,
            stride=stride,
            dropout=dropout,
        )
        self.convolutions = nn.Sequential(
            nn.Conv1d(n_channels, width, 64, stride=stride, padding=32),
            nn.BatchNorm1d(width),
            nn.ReLU(),
            nn.MaxPool1d(2),
            nn.Conv1d(width, 2 * width, 5, padding=2),
            nn.BatchNorm1d(2 * width),
            nn.ReLU(),
            nn.MaxPool1d(2),
        )
        self.recurrence = nn.LSTM(2 * width, hidden, batch_first=True)
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Linear(hidden, n_classes)

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the state of the LSTM after the last step."""
        # Two poolings by 2 need four steps: a shorter window gets leading zeros.
        n_missing = max(0, 4 * self.settings["stride"] - windows.shape[-1])
        steps = self.convolutions(functional.pad(windows, (n_missing, 0)))

        output, _ = self.recurrence(steps.transpose(1, 2))
        features: Tensor = self.dropout(output[:, -1])
        return features
