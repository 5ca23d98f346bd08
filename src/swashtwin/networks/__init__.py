"""Networks that classify windows, by name: the paper's BiTCN, and whatever joins it in the same battery of tests."""

from swashtwin.networks.bitcn import BiTCN
from swashtwin.networks.network import Network
from swashtwin.networks.registry import NETWORKS, build_network

__all__ = ["NETWORKS", "BiTCN", "Network", "build_network"]
