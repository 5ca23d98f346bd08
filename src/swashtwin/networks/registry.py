"""Networks by name."""

import difflib
from typing import Any

from swashtwin.errors import InputError
from swashtwin.networks.ablations import BiTCNForward, BiTCNNoAttention, BiTCNOrdinary
from swashtwin.networks.autoencoder import StackedAutoencoder
from swashtwin.networks.bitcn import BiTCN
from swashtwin.networks.cnn_lstm import CNNLSTM
from swashtwin.networks.mlp import MLP
from swashtwin.networks.network import Network
from swashtwin.networks.recurrent import LSTM, BiGRU, BiLSTM
from swashtwin.networks.resnet1d import ResNet1d
from swashtwin.networks.sensor_graph import SensorGraph
from swashtwin.networks.settings import checked_settings
from swashtwin.networks.spectral_bitcn import SpectralBiTCN
from swashtwin.networks.tcn import TCN
from swashtwin.networks.wdcnn import WDCNN

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
