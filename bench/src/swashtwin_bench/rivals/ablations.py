"""BiTCN with one part taken away: the paper's ablation study."""

from typing import Any, ClassVar

from swashtwin.learning import BiTCN, register_network


class BiTCNOrdinary(BiTCN):
    """Ablation A of the paper (DOI 10.1177/00202940261419020): ordinary instead of dilated causal convolution.

    **Our reading** of ordinary: each convolution is centered and no dilation grows. The number of weights stays, the
    receptive field of a branch shrinks to that of six small convolutions, and what is left of the view over the whole
    window is squeeze-and-excitation.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    **settings : all others of `BiTCN`.

    Examples
    --------
    >>> BiTCNOrdinary(1, 5).receptive_field
    25
    """

    name: ClassVar[str] = "bitcn_ordinary"

    def __init__(self, n_channels: int, n_classes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, **{"causal": False, **settings})


class BiTCNNoAttention(BiTCN):
    """Ablation B of the paper (DOI 10.1177/00202940261419020): no squeeze-and-excitation.

    Without it no step knows of the whole window before the mean over time.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    **settings : all others of `BiTCN`.
    """

    name: ClassVar[str] = "bitcn_no_attention"

    def __init__(self, n_channels: int, n_classes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, **{"attention": False, **settings})


class BiTCNForward(BiTCN):
    """Ablation C of the paper (DOI 10.1177/00202940261419020): the positive branch only, half the weights.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    **settings : all others of `BiTCN`.
    """

    name: ClassVar[str] = "bitcn_forward"

    def __init__(self, n_channels: int, n_classes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, **{"bidirectional": False, **settings})


ABLATIONS: tuple[type[BiTCN], ...] = (BiTCNOrdinary, BiTCNNoAttention, BiTCNForward)
"""The paper's ablations A, B and C."""

for _ablation in ABLATIONS:
    register_network(_ablation.name, _ablation)
