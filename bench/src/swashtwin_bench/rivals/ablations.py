"""BiTCN with one part taken away: the paper's ablation study (DOI 10.1177/00202940261419020)."""

from typing import Any, ClassVar

from swashtwin.learning import BiTCN, register_network


class _Ablation(BiTCN):
    """BiTCN without one part; all settings are those of `BiTCN`."""

    without: ClassVar[str]

    def __init__(self, n_channels: int, n_classes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, **{self.without: False, **settings})


class BiTCNOrdinary(_Ablation):
    """Ablation A: ordinary instead of dilated causal convolution.

    **Our reading** of ordinary: each convolution is centered and no dilation grows. The number of weights stays, the
    receptive field of a branch shrinks to that of six small convolutions, and what is left of the view over the whole
    window is squeeze-and-excitation.

    Examples
    --------
    >>> BiTCNOrdinary(1, 5).receptive_field
    25
    """

    name: ClassVar[str] = "bitcn_ordinary"
    without = "causal"


class BiTCNNoAttention(_Ablation):
    """Ablation B: no squeeze-and-excitation, so that no step knows of the whole window before the mean over time."""

    name: ClassVar[str] = "bitcn_no_attention"
    without = "attention"


class BiTCNForward(_Ablation):
    """Ablation C: the positive branch only, half the weights."""

    name: ClassVar[str] = "bitcn_forward"
    without = "bidirectional"


ABLATIONS: tuple[type[BiTCN], ...] = (BiTCNOrdinary, BiTCNNoAttention, BiTCNForward)
"""The paper's ablations A, B and C."""

for _ablation in ABLATIONS:
    register_network(_ablation.name, _ablation)
