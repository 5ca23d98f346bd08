"""Networks by name."""

import difflib
from typing import Any

from swashtwin.foundation import InputError
from swashtwin.learning.networks.ablations import BiTCNForward, BiTCNNoAttention, BiTCNOrdinary
from swashtwin.learning.networks.autoencoder import StackedAutoencoder
from swashtwin.learning.networks.bitcn import BiTCN
from swashtwin.learning.networks.cnn_lstm import CNNLSTM
from swashtwin.learning.networks.mlp import MLP
from swashtwin.learning.networks.network import Network
from swashtwin.learning.networks.recurrent import LSTM, BiGRU, BiLSTM
from swashtwin.learning.networks.resnet1d import ResNet1d
from swashtwin.learning.networks.sensor_graph import SensorGraph
from swashtwin.learning.networks.settings import checked_settings
from swashtwin.learning.networks.spectral_bitcn import SpectralBiTCN
from swashtwin.learning.networks.tcn import TCN
from swashtwin.learning.networks.wdcnn import WDCNN

_CLASSES: tuple[type[Network], ...] = (
    SpectralBiTCN, BiTCN, BiTCNOrdinary, BiTCNNoAttention, BiTCNForward,
    TCN, LSTM, BiLSTM, BiGRU, WDCNN, CNNLSTM, ResNet1d, MLP, StackedAutoencoder, SensorGraph,
)  # fmt: skip
NETWORKS: dict[str, type[Network]] = {network.name: network for network in _CLASSES}
"""Class of each network; a saved model is built again by its name here."""


def build_network(name: str, n_channels: int, n_classes: int, **settings: Any) -> Network:
    """The network of that name with untrained weights.

    Raises
    ------
    InputError
        No network or none of its settings is called so (the nearest is offered), or a setting cannot be.
    """
    if name not in NETWORKS:
        near = difflib.get_close_matches(name.lower(), NETWORKS, n=1, cutoff=0.3)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise InputError(f"unknown network {name!r}; there are {', '.join(sorted(NETWORKS))}.{hint}")
    kind = NETWORKS[name]
    return kind(n_channels=n_channels, n_classes=n_classes, **checked_settings(kind, settings))
