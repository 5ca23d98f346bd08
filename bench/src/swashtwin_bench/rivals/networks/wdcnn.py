"""Convolutional network with a wide first kernel."""

from typing import ClassVar

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.learning import Network

# Samples of a window of which the five poolings leave at least one step.
_MIN_LENGTH = 1024


class WDCNN(Network):
    """Deep convolutional network with wide first-layer kernels, Zhang et al. 2017.

    DOI 10.3390/s17020425. The sizes are theirs, for windows of 2,048 samples: five convolutions
    with batch normalization, ReLU and maximum pooling by 2, the first with 64 taps and a stride of
    16, then a fully connected layer of size `hidden`. **Our reading** for other lengths: the steps
    after the last pooling are averaged to the three steps that 2,048 samples leave, and windows of
    less than 1,024 samples get leading zeros. Weights, with C = `n_channels`:

    ================== ==============
    ``stages.0.0``     (16, C, 64)
    ``stages.1.0``     (32, 16, 3)
    ``stages.2.0``     (64, 32, 3)
    ``stages.3.0``     (64, 64, 3)
    ``stages.4.0``     (64, 64, 3)
    ``connected.0``    (hidden, 192)
    ``head``           (classes, hidden)
    ================== ==============

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    hidden : size of the fully connected layer.

    Examples
    --------
    >>> from torch import zeros
    >>> WDCNN(1, 5).steps(zeros(2, 1, 2048)).shape
    torch.Size([2, 64, 3])
    """

    name: ClassVar[str] = "wdcnn"
    receptive_field: ClassVar[int] = 1520
    """Samples on which a step after the last pooling depends."""

    def __init__(self, n_channels: int, n_classes: int, *, hidden: int = 100) -> None:
        super().__init__(n_channels=n_channels, n_classes=n_classes, hidden=hidden)
        self.stages = nn.Sequential(
            _stage(n_channels, 16, 64, stride=16, padding=24),
            _stage(16, 32, 3, padding=1),
            _stage(32, 64, 3, padding=1),
            _stage(64, 64, 3, padding=1),
            _stage(64, 64, 3),
        )
        self.connected = nn.Sequential(nn.Linear(64 * 3, hidden), nn.BatchNorm1d(hidden), nn.ReLU())
        self.head = nn.Linear(hidden, n_classes)

    def steps(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature step"]:
        """Return the features after the last pooling."""
        n_missing = max(0, _MIN_LENGTH - windows.shape[-1])
        features: Tensor = self.stages(functional.pad(windows, (n_missing, 0)))
        return features

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the output of the fully connected layer."""
        pooled = functional.adaptive_avg_pool1d(self.steps(windows), 3)
        features: Tensor = self.connected(pooled.flatten(1))
        return features


def _stage(
    n_in: int, n_out: int, kernel_size: int, *, stride: int = 1, padding: int = 0
) -> nn.Sequential:
    convolution = nn.Conv1d(n_in, n_out, kernel_size, stride=stride, padding=padding)
    return nn.Sequential(convolution, nn.BatchNorm1d(n_out), nn.ReLU(), nn.MaxPool1d(2))
