"""Fully connected network."""

from collections.abc import Sequence
from typing import ClassVar

from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning.networks.network import Network
from swashtwin.learning.networks.spectrum import SpectrumLines


class MLP(Network):
    """Fully connected network (the field's ANN), layers and dropout after Wang, Yan and Oates 2017.

    Three layers of 500 with ReLU, as in their baseline (DOI 10.1109/IJCNN.2017.7966039), with one share of dropout for
    all layers. **Our reading**: it sees the levels of the spectrum (`SpectrumLines`) and not the samples, because on
    samples of unknown phase it would be a straw man. Weights, with C = `n_channels`, L = `n_lines`, H_i =
    ``hidden[i]``:

    ============ ===================
    ``layers.0`` (H_0, C L)
    ``layers.3`` (H_1, H_0), and on
    ``head``     (classes, H_last)
    ============ ===================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    hidden : size of each layer.
    n_lines : bands of the spectrum of each channel.
    dropout : share of the features dropped in training.
    """

    name: ClassVar[str] = "mlp"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        hidden: Sequence[int] = (500, 500, 500),
        n_lines: int = 256,
        dropout: float = 0.2,
    ) -> None:
        hidden = tuple(hidden)
        super().__init__(n_channels=n_channels, n_classes=n_classes, hidden=hidden, n_lines=n_lines, dropout=dropout)
        self.spectrum = SpectrumLines(n_channels, n_lines)
        layers: list[nn.Module] = []
        for n_in, n_out in zip((n_channels * n_lines, *hidden[:-1]), hidden, strict=True):
            layers += [nn.Linear(n_in, n_out), nn.ReLU(), nn.Dropout(dropout)]
        self.layers = nn.Sequential(*layers)
        self.head = nn.Linear(hidden[-1], n_classes)

    def encode(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window feature"]:
        """What the last hidden layer makes of the spectrum."""
        features: Tensor = self.layers(self.spectrum(windows))
        return features
