"""Graph network whose nodes are sensors."""

import math
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning import Network


class SensorGraph(Network):
    """Graph convolution over sensors with a learned adjacency, after Wu et al. 2019.

    DOI 10.24963/ijcai.2019/264. Each channel is a node. One encoder, the same for all nodes,
    computes features of the signal of each node; then each layer mixes the features of a node with
    those of the nodes that it has learned to depend on, H ← H + ReLU(A H W), with

        A = softmax over columns of E_1 E_2ᵀ / √d,

    where E_1 and E_2 (channels, d) are learned, because the relations of sensors are unknown. The
    graph convolution is that of Kipf and Welling (DOI 10.48550/arXiv.1609.02907). **Our reading**:
    the encoder, the skip, no ReLU within the softmax, and that nodes are concatenated at the end
    instead of averaged, since the sensor that measures a fault shows its position. With one channel
    A is 1 and the network is its encoder.

    Weights, with C = `n_channels`, F = `width`, d = `embedding`:

    ================= ================
    ``encoder.0``     (F, 1, 64)
    ``encoder.4``     (F, F, 5)
    ``encoder.8``     (F, F, 5)
    ``listening``     (C, d)
    ``speaking``      (C, d)
    ``mixing.i``      (F, F)
    ``head``          (classes, C F)
    ================= ================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    width : features of each node.
    layers : number of graph convolutions.
    embedding : length d of the learned vectors from which the adjacency is computed.
    stride : samples from step to step of the encoder's first convolution, which has 64 taps.
    dropout : share of the features that is dropped in training.
    """

    name: ClassVar[str] = "sensor_graph"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        width: int = 32,
        layers: int = 2,
        embedding: int = 8,
        stride: int = 8,
        dropout: float = 0.1,
    ) -> None:
        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            width=width,
            layers=layers,
            embedding=embedding,
            stride=stride,
            dropout=dropout,
        )
        self.encoder = nn.Sequential(
            nn.Conv1d(1, width, 64, stride=stride, padding=32),
            nn.BatchNorm1d(width),
            nn.ReLU(),
            nn.MaxPool1d(2, ceil_mode=True),
            nn.Conv1d(width, width, 5, padding=2),
            nn.BatchNorm1d(width),
            nn.ReLU(),
            nn.MaxPool1d(2, ceil_mode=True),
            nn.Conv1d(width, width, 5, padding=2),
            nn.BatchNorm1d(width),
            nn.ReLU(),
        )
        self.listening = nn.Parameter(torch.randn(n_channels, embedding))
        self.speaking = nn.Parameter(torch.randn(n_channels, embedding))
        self.mixing = nn.ModuleList(nn.Linear(width, width) for _ in range(layers))
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Linear(n_channels * width, n_classes)

    @property
    def adjacency(self) -> Float[Tensor, "listener speaker"]:
        """Weight of each channel in the features of each channel; rows sum to 1."""
        similarity = self.listening @ self.speaking.T / math.sqrt(self.settings["embedding"])
        return torch.softmax(similarity, dim=-1)

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the features of all nodes after the last mixing, concatenated."""
        # The encoder sees every channel as a window of one channel.
        encoded = self.encoder(windows.flatten(0, 1).unsqueeze(1)).mean(dim=-1)
        nodes = encoded.unflatten(0, (-1, self.n_channels))

        for mix in self.mixing:
            nodes = nodes + torch.relu(mix(self.adjacency @ nodes))

        features: Tensor = self.dropout(nodes.flatten(1))
        return features
