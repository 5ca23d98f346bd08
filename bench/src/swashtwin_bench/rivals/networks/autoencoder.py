"""Classifier that starts from the encoders of a stacked sparse autoencoder."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.learning import Network, batches

_BATCH_SIZE = 64
_LEARNING_RATE = 1e-3

# Added to power and amplitude, so that the logarithm of silence is finite.
_POWER_FLOOR = 1e-20
_AMPLITUDE_FLOOR = 1e-8

# Mean activations stay this far from 0 and 1, so that the divergence is finite.
_ACTIVATION_MARGIN = 1e-6


class SpectrumLines(nn.Module):
    """Logarithmic amplitude in `n_lines` equal bands of the spectrum of each channel, standardized.

    It is ln of the mean amplitude in the band (mean removed, Hann taper, from half the first line
    to half the sample rate), then batch normalization without weights. A fully connected layer has
    no notion of time: it would have to learn a fault for each moment at which a window may begin,
    while amplitudes do not depend on it.
    """

    def __init__(self, n_channels: int, n_lines: int) -> None:
        super().__init__()
        self.n_lines = n_lines
        self.scaling = nn.BatchNorm1d(n_channels * n_lines, affine=False)

    def forward(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window line"]:
        """Return the standardized band amplitudes, channel after channel."""
        length = windows.shape[-1]
        taper = torch.hann_window(length, device=windows.device)
        centered = windows - windows.mean(dim=-1, keepdim=True)

        spectrum = torch.view_as_real(torch.fft.rfft(centered * taper, dim=-1)[..., 1:])
        power = spectrum.square().sum(dim=-1) + _POWER_FLOOR
        amplitude = 2 / taper.sum() * power.sqrt()
        bands = functional.adaptive_avg_pool1d(amplitude, self.n_lines)

        standardized: Tensor = self.scaling(torch.log(bands + _AMPLITUDE_FLOOR).flatten(1))
        return standardized


class StackedAutoencoder(Network):
    """Stacked sparse autoencoders, then a deep network that starts from their encoders.

    After Sohaib and Kim 2018 (DOI 10.1155/2018/2919637). Each layer first learns, without classes,
    to restore the output of the previous layer (greedy, layer by layer), with a penalty that keeps
    its units inactive most of the time; then all layers and a last one are trained together on the
    classes. With x the input, h = sigmoid(W x + b) of m windows and ρ̂_j the mean of unit j over
    them, a layer minimizes

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
    n_classes : number of classes.
    hidden : size of each layer.
    n_lines : bands of the spectrum of each channel.
    sparsity : ρ, the target of the mean activation of a unit.
    sparsity_weight : β, weight of the penalty.
    pretraining_epochs : passes over the training windows for each layer without classes.
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
            n_channels=n_channels,
            n_classes=n_classes,
            hidden=hidden,
            n_lines=n_lines,
            sparsity=sparsity,
            sparsity_weight=sparsity_weight,
            pretraining_epochs=pretraining_epochs,
        )
        self.spectrum = SpectrumLines(n_channels, n_lines)
        sizes = zip((n_channels * n_lines, *hidden[:-1]), hidden, strict=True)
        self.encoders = nn.ModuleList(nn.Linear(n_in, n_out) for n_in, n_out in sizes)
        self.head = nn.Linear(hidden[-1], n_classes)

    def encode(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the output of the last encoder."""
        x = self.spectrum(windows)
        for encoder in self.encoders:
            x = torch.sigmoid(encoder(x))
        return x

    def pretrain(self, windows: Float[Tensor, "window channel time"], seed: int) -> None:
        """Train each encoder in turn to restore its input from few active units."""
        order = torch.Generator().manual_seed(seed)

        # In training mode, so that batch normalization learns the statistics of the spectra.
        self.spectrum.train()
        with torch.no_grad():
            spectra = [
                self.spectrum(windows[batch])
                for batch in batches(torch.arange(len(windows)), 4 * _BATCH_SIZE)
            ]
        x = torch.cat(spectra)

        for encoder in self.encoders:
            assert isinstance(encoder, nn.Linear)
            self._train_encoder(encoder, x, order)
            with torch.no_grad():
                x = torch.sigmoid(encoder(x))

    def _train_encoder(
        self, encoder: nn.Linear, x: Float[Tensor, "window value"], order: torch.Generator
    ) -> None:
        offset = x.mean(dim=0).requires_grad_()
        optimizer = torch.optim.Adam([*encoder.parameters(), offset], lr=_LEARNING_RATE)
        for _ in range(self.settings["pretraining_epochs"]):
            shuffled = torch.randperm(len(x), generator=order).to(x.device)
            for batch in shuffled.split(_BATCH_SIZE):
                optimizer.zero_grad()
                self._compute_loss(encoder, offset, x[batch]).backward()
                optimizer.step()

    def _compute_loss(
        self, encoder: nn.Linear, offset: Float[Tensor, " value"], x: Float[Tensor, "window value"]
    ) -> Tensor:
        hidden = torch.sigmoid(encoder(x))
        restored = functional.linear(hidden, encoder.weight.T, offset)
        error = (restored - x).square().sum(dim=1).mean() / 2

        target = torch.tensor(self.settings["sparsity"])
        activation = hidden.mean(dim=0).clamp(_ACTIVATION_MARGIN, 1 - _ACTIVATION_MARGIN)
        divergence = target * torch.log(target / activation) + (1 - target) * torch.log(
            (1 - target) / (1 - activation)
        )
        return error + self.settings["sparsity_weight"] * divergence.sum()
