"""Stacked sparse autoencoder whose encoders begin a classifier."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.learning import Network, batches

_BATCH = 64
_LEARNING_RATE = 1e-3


class SpectrumLines(nn.Module):
    """Level of each of `n_lines` equal bands of each channel's spectrum, scaled by what training
    windows had there.

    ln of the mean amplitude within the band, mean removed, Hann taper, from half the first line to
    half the rate; then batch normalization without weights. A fully connected layer has no notion
    of time: it would have to learn a fault anew for every moment at which a window may begin, while
    the amplitudes do not move.
    """

    def __init__(self, n_channels: int, n_lines: int) -> None:
        super().__init__()
        self.n_lines = n_lines
        self.scaling = nn.BatchNorm1d(n_channels * n_lines, affine=False)

    def forward(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window line"]:
        """Levels, channel after channel."""
        length = windows.shape[-1]
        taper = torch.hann_window(length, device=windows.device)
        centered = windows - windows.mean(dim=-1, keepdim=True)
        spectrum = torch.view_as_real(torch.fft.rfft(centered * taper, dim=-1)[..., 1:])
        amplitude = 2 / taper.sum() * (spectrum.square().sum(dim=-1) + 1e-20).sqrt()
        levels = torch.log(functional.adaptive_avg_pool1d(amplitude, self.n_lines) + 1e-8)
        scaled: Tensor = self.scaling(levels.flatten(1))
        return scaled


class StackedAutoencoder(Network):
    """Stacked sparse autoencoders, then a deep network that starts from their encoders (DOI
    10.1155/2018/2919637).

    As Sohaib and Kim 2018: each layer first learns, without any class, to give back what the layer
    before it says (greedy, layer after layer), with a penalty that keeps its units silent most of
    the time; then all layers and a last one are trained together on the classes. With x the input,
    h = sigmoid(W x + b) of m windows and ρ̂_j the mean of unit j over them, a layer lowers

        (1 / 2m) Σ ‖Wᵀ h + c - x‖² + β Σ_j KL(ρ ‖ ρ̂_j),  KL(ρ ‖ ρ̂) = ρ ln(ρ / ρ̂) + (1 - ρ) ln((1
        - ρ) / (1 - ρ̂)).

    **Our reading**: the input is the spectrum (`SpectrumLines`; theirs is the envelope's), the
    decoder is the encoder's transpose, and sizes, ρ, β and Adam with 1e-3 are ours. The decoders
    are not kept. Weights, with C = `n_channels`, L = `n_lines`, H_i = ``hidden[i]``:

    ============== =================
    ``encoders.0`` (H_0, C L)
    ``encoders.i`` (H_i, H_{i-1})
    ``head``       (classes, H_last)
    ============== =================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    hidden : size of each layer.
    n_lines : bands of the spectrum of each channel.
    sparsity : ρ, the share of the time that a unit should be awake.
    sparsity_weight : β, weight of the penalty.
    pretraining_epochs : passes over the training windows for each layer, before any class is seen.
    """

    name: ClassVar[str] = "autoencoder"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        hidden: Sequence[int] = (256, 128, 64),
        n_lines: int = 256,
        sparsity: float = 0.1,
        sparsity_weight: float = 3.0,
        pretraining_epochs: int = 20,
    ) -> None:
        hidden = tuple(hidden)
        super().__init__(
            n_channels=n_channels, n_classes=n_classes, hidden=hidden, n_lines=n_lines, sparsity=sparsity,
            sparsity_weight=sparsity_weight, pretraining_epochs=pretraining_epochs,
        )  # fmt: skip
        self.spectrum = SpectrumLines(n_channels, n_lines)
        sizes = zip((n_channels * n_lines, *hidden[:-1]), hidden, strict=True)
        self.encoders = nn.ModuleList(nn.Linear(n_in, n_out) for n_in, n_out in sizes)
        self.head = nn.Linear(hidden[-1], n_classes)

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """What the last encoder says."""
        x = self.spectrum(windows)
        for encoder in self.encoders:
            x = torch.sigmoid(encoder(x))
        return x

    def pretrain(self, windows: Float[Tensor, "window channel time"], seed: int) -> None:
        """Train each encoder in turn so that a decoder can restore its input from few active
        units.
        """
        order = torch.Generator().manual_seed(seed)
        self.spectrum.train()
        with torch.no_grad():
            x = torch.cat(
                [
                    self.spectrum(windows[batch])
                    for batch in batches(torch.arange(len(windows)), _BATCH * 4)
                ]
            )
        for encoder in self.encoders:
            assert isinstance(encoder, nn.Linear)
            self._learn_to_undo(encoder, x, order)
            with torch.no_grad():
                x = torch.sigmoid(encoder(x))

    def _learn_to_undo(
        self, encoder: nn.Linear, x: Float[Tensor, "window value"], order: torch.Generator
    ) -> None:
        offset = x.mean(dim=0).requires_grad_()
        optimizer = torch.optim.Adam([*encoder.parameters(), offset], lr=_LEARNING_RATE)
        for _ in range(self.settings["pretraining_epochs"]):
            for batch in torch.randperm(len(x), generator=order).to(x.device).split(_BATCH):
                optimizer.zero_grad()
                self._loss(encoder, offset, x[batch]).backward()
                optimizer.step()

    def _loss(
        self, encoder: nn.Linear, offset: Float[Tensor, " value"], x: Float[Tensor, "window value"]
    ) -> Tensor:
        hidden = torch.sigmoid(encoder(x))
        given_back = functional.linear(hidden, encoder.weight.T, offset)
        awake, wanted = (
            hidden.mean(dim=0).clamp(1e-6, 1 - 1e-6),
            torch.tensor(self.settings["sparsity"]),
        )
        divergence = wanted * torch.log(wanted / awake) + (1 - wanted) * torch.log(
            (1 - wanted) / (1 - awake)
        )
        error = (given_back - x).square().sum(dim=1).mean() / 2
        return error + self.settings["sparsity_weight"] * divergence.sum()
