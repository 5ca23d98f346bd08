"""Networks that ours are compared with; importing this module registers their names."""

from swashtwin.learning import Network, register_network
from swashtwin_bench.rivals.networks.autoencoder import StackedAutoencoder
from swashtwin_bench.rivals.networks.cnn_lstm import CNNLSTM
from swashtwin_bench.rivals.networks.recurrent import LSTM, BiGRU, BiLSTM
from swashtwin_bench.rivals.networks.sensor_graph import SensorGraph
from swashtwin_bench.rivals.networks.spectral_bitcn import SpectralBiTCN
from swashtwin_bench.rivals.networks.tcn import TCN
from swashtwin_bench.rivals.networks.wdcnn import WDCNN

RIVALS: tuple[type[Network], ...] = (
    SpectralBiTCN,
    TCN,
    LSTM,
    BiLSTM,
    BiGRU,
    WDCNN,
    CNNLSTM,
    StackedAutoencoder,
    SensorGraph,
)
"""Classes of the registered networks."""

for _network in RIVALS:
    register_network(_network.name, _network)
