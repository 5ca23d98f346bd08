"""Networks that classify windows, by name: the paper's BiTCN, and whatever joins it in the same battery of tests."""

from swashtwin.networks.bitcn import BiTCN
from swashtwin.networks.network import Network
from swashtwin.networks.registry import NETWORKS, build_network
from swashtwin.networks.spectral_bitcn import SpectralBiTCN

__all__ = ["NETWORKS", "BiTCN", "Network", "SpectralBiTCN", "build_network"]
