"""BiTCN that reads a window as the ear does: as levels in bands, and not as samples."""

import math
from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import InputError
from swashtwin.learning import Branch, Network
from swashtwin.signals import band_shares

_FRAME, _HOP, _BANDS = 256, 64, 24
"""Samples of a frame and from one to the next; logarithmic bands of a frame."""
_LINES, _LINE_SHARE, _LINE_BANDS = 200, 200 / 1024, 32
_ENVELOPE_LINES, _ENVELOPE_SHARE, _ENVELOPE_FROM = 64, 64 / 1024, (0.0, 1000 / 12800)


class SpectralBiTCN(Network):
    """BiTCN over short-time spectra, beside the lines and envelopes of the whole window; ours, and
    the default.

    The two branches of the paper's `BiTCN` (DOI 10.1177/00202940261419020), dilated causal residual
    units with squeeze-and-excitation, here read levels of 24 bands in frames of 256 samples, 64
    samples apart: about 30 steps instead of 2048, whose receptive field is the whole window. Their
    sum's mean and greatest value over time stand beside a hidden layer over what has no moment: the
    window's lines up to a fifth of half the sample rate, its envelopes' (all of it, and above 1 kHz
    at 25.6 kHz), their bands and the shape of their distributions.

    Why: a fault of the pump changes ratios between lines by tenths, at a phase that no window
    shares with another. A convolution over samples has to find levels itself. `study ablation`
    takes it apart.

    Levels are scaled by what the training windows have of them, and in training noise of `noise` of
    their deviation is added, which is what a gain or a mounting that differs a little does to them.

    Weights, with C = `n_channels`, F = the last of `channels`, L the levels of a window, H =
    `hidden`:

    ================================== ==========================
    ``positive``, ``inverse``          as in `BiTCN`, 24 C inputs
    ``skip``                           (F, 24 C, 1)
    ``hidden.0``                       (H, L)
    ``head``                           (classes, 2 F + H)
    ================================== ==========================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    channels, dilations, causal, attention, bidirectional : of the branches, as in `BiTCN`.
    hidden : size of the hidden layer.
    dropout : share of the features dropped in training; a third of it within the branches.
    noise : deviation of the noise on the levels in training, over theirs.

    Raises
    ------
    InputError
        A setting cannot be.

    Examples
    --------
    >>> network = SpectralBiTCN(1, 5)
    >>> network(torch.zeros(2, 1, 2048)).shape
    torch.Size([2, 5])
    """

    name: ClassVar[str] = "spectral_bitcn"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        channels: Sequence[int] = (32, 32, 32, 32),
        dilations: Sequence[int] | None = None,
        causal: bool = True,
        attention: bool = True,
        bidirectional: bool = True,
        hidden: int = 128,
        dropout: float = 0.3,
        noise: float = 0.3,
    ) -> None:
        channels = tuple(channels)
        growth = 2 if causal else 1
        dilations = (
            tuple(growth**unit for unit in range(len(channels)))
            if dilations is None
            else tuple(dilations)
        )
        if len(channels) != len(dilations):
            raise InputError(
                f"{self.name} needs as many dilations ({len(dilations)}) as channels ({len(channels)})."
            )
        if noise < 0:
            raise InputError(f"{self.name}: noise ({noise:g}) must not be negative.")
        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            channels=channels,
            dilations=dilations,
            causal=causal,
            attention=attention,
            bidirectional=bidirectional,
            hidden=hidden,
            dropout=dropout,
            noise=noise,
        )
        self.dropout = nn.Dropout(dropout)
        n_inputs = n_channels * _BANDS
        unit = {
            "kernel_size": 3,
            "reduction": 4,
            "causal": causal,
            "attention": attention,
            "dropout": dropout / 3,
        }
        self.positive = Branch(n_inputs, channels, dilations, stride=1, **unit)
        self.inverse = (
            Branch(n_inputs, channels, dilations, stride=1, **unit) if bidirectional else None
        )
        self.skip = nn.Conv1d(n_inputs, channels[-1], 1)
        self.n_still = n_channels * _still(torch.zeros(1, 1, 64, device="cpu")).shape[1]
        self.hidden = nn.Sequential(
            nn.Linear(self.n_still, hidden), nn.BatchNorm1d(hidden), nn.ReLU()
        )
        self.register_buffer("mean", torch.zeros(self.n_still + n_inputs))
        self.register_buffer("deviation", torch.ones(self.n_still + n_inputs))
        self.head = nn.Linear(2 * channels[-1] + hidden, n_classes)

    def represent(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window level"]:
        """Levels that stand still, then those of the frames, step after step."""
        moving = short_time_levels(windows, _FRAME, _HOP, _BANDS)
        return torch.cat([_still(windows), moving.transpose(1, 2).flatten(1)], dim=1)

    def _split(self, represented: Tensor) -> tuple[Tensor, Tensor]:
        """(levels that stand still, levels of the frames with their steps last)."""
        still, moving = represented[:, : self.n_still], represented[:, self.n_still :]
        return still, moving.unflatten(1, (-1, self.n_channels * _BANDS)).transpose(1, 2)

    def pretrain(self, windows: Float[Tensor, "window level"], seed: int) -> None:
        """Learn the mean and deviation of each level."""
        still, moving = self._split(windows)
        self.get_buffer("mean").copy_(torch.cat([still.mean(dim=0), moving.mean(dim=(0, 2))]))
        deviation = torch.cat([still.std(dim=0), moving.std(dim=(0, 2))])
        self.get_buffer("deviation").copy_(deviation.nan_to_num(1.0).clamp_min(1e-3))

    def encode(self, windows: Float[Tensor, "window level"]) -> Float[Tensor, "window feature"]:
        """Features of both branches over the frames, and of the hidden layer over what stands
        still.
        """
        mean, deviation = self.get_buffer("mean"), self.get_buffer("deviation")
        still, moving = self._split(windows)
        shift, scale = mean[self.n_still :, None], deviation[self.n_still :, None]
        read = self._read(self._noised((moving - shift) / scale))
        shift, scale = mean[: self.n_still], deviation[: self.n_still]
        hidden = self.hidden(self._noised((still - shift) / scale))
        encoded: Tensor = self.dropout(
            torch.cat([read.mean(dim=-1), read.amax(dim=-1), hidden], dim=1)
        )
        return encoded

    def _read(self, moving: Tensor) -> Tensor:
        fused = self.positive(moving)
        if self.inverse is not None:
            fused = fused + self.inverse(moving.flip(-1)).flip(-1)
        return torch.relu(fused + self.skip(moving))

    def _noised(self, levels: Tensor) -> Tensor:
        return (
            levels + self.settings["noise"] * torch.randn_like(levels) if self.training else levels
        )


def _still(windows: Tensor) -> Tensor:
    """Levels that have no moment: of the window's lines and of its envelopes'."""
    envelopes = (
        envelope_levels(windows, _ENVELOPE_LINES, _ENVELOPE_SHARE, _LINE_BANDS, above)
        for above in _ENVELOPE_FROM
    )
    return torch.cat([line_levels(windows, _LINES, _LINE_SHARE, _LINE_BANDS), *envelopes], dim=1)


def short_time_levels(
    windows: Float[Tensor, "window channel time"], frame: int, hop: int, n_bands: int
) -> Float[Tensor, "window level step"]:
    """Levels of `n_bands` logarithmic bands, channel after channel, in frames of `frame` samples
    every `hop` samples.

    A window shorter than a frame is continued by zeros.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    x = functional.pad(x, (0, max(0, frame - x.shape[-1])))
    frames = x.unfold(-1, frame, hop) * taper_of(frame, x)
    levels = torch.log10(power_of(frames) @ bands_of(frame // 2, n_bands, x) + FLOOR)
    return levels.transpose(2, 3).flatten(1, 2)


def line_levels(
    windows: Float[Tensor, "window channel time"], n_lines: int, share: float, n_bands: int
) -> Float[Tensor, "window level"]:
    """Levels of the spectrum, channel after channel, with the shape of its waveform.

    Per channel: `n_lines` equal bands of the lowest `share` of the spectrum, `n_bands` logarithmic
    ones of all of it, and the logarithm of its deviation, skewness, log kurtosis, log crest factor
    and mean of |x| over the deviation.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    power = power_of(x * taper_of(x.shape[-1], x))
    return torch.cat([*_levels(power, n_lines, share, n_bands), waveform_shape(x)], dim=-1).flatten(
        1
    )


def envelope_levels(
    windows: Float[Tensor, "window channel time"],
    n_lines: int,
    share: float,
    n_bands: int,
    above: float,
) -> Float[Tensor, "window level"]:
    """`line_levels` of each channel's envelope, and the logarithm of the envelope's mean.

    The envelope is |x + i H(x)|, H being the Hilbert transform over the window, of what lies above
    the share `above` of half the sample rate.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    length = x.shape[-1]
    spectrum = torch.fft.rfft(x)
    spectrum = spectrum * (
        torch.arange(spectrum.shape[-1], device=x.device) > above * (length // 2)
    )
    turned = torch.complex(spectrum.imag, -spectrum.real)
    real, imaginary = torch.fft.irfft(spectrum, n=length), torch.fft.irfft(turned, n=length)
    envelope = (real.square() + imaginary.square() + 1e-12).sqrt()
    mean = envelope.mean(dim=-1, keepdim=True)
    return torch.cat(
        [line_levels(envelope, n_lines, share, n_bands), torch.log10(mean + FLOOR).flatten(1)],
        dim=-1,
    )


def _levels(power: Tensor, n_lines: int, share: float, n_bands: int) -> tuple[Tensor, Tensor]:
    lowest = power[..., : max(1, round(share * power.shape[-1]))]
    lines = functional.adaptive_avg_pool1d(lowest, n_lines)
    banded = power @ bands_of(power.shape[-1], n_bands, power)
    return torch.log10(lines + FLOOR), torch.log10(banded + FLOOR)


FLOOR = 1e-7
"""Added to each power before its logarithm, in the square of the scaled unit."""


def waveform_shape(x: Tensor) -> Tensor:
    """Of signals with mean 0: log10 deviation, skewness, log kurtosis, log crest factor, mean of
    |x| over deviation.
    """
    deviation = x.square().mean(dim=-1, keepdim=True).sqrt() + 1e-6
    z = x / deviation
    square, magnitude = z.square(), z.abs()  # products, for a power takes ten times as long
    return torch.cat(
        [
            torch.log10(deviation),
            (square * z).mean(dim=-1, keepdim=True),
            torch.log(square.square().mean(dim=-1, keepdim=True) + 1e-3),
            torch.log(magnitude.amax(dim=-1, keepdim=True) + 1e-3),
            magnitude.mean(dim=-1, keepdim=True),
        ],
        dim=-1,
    )


def power_of(x: Tensor) -> Tensor:
    """Power of the lines 1... of the spectrum over the last axis; without a complex number, for
    ONNX has none.
    """
    real, imaginary = torch.view_as_real(torch.fft.rfft(x)[..., 1:]).unbind(dim=-1)
    return (real.square() + imaginary.square()) / x.shape[-1]


def taper_of(length: int, like: Tensor) -> Tensor:
    """Hann taper of that many samples."""
    angle = torch.arange(length, dtype=like.dtype, device=like.device) * (2 * math.pi / length)
    return 0.5 - 0.5 * torch.cos(angle)


def bands_of(n_lines: int, n_bands: int, like: Tensor) -> Tensor:
    """Share of each line (row) in each band (column)."""
    return torch.tensor(band_shares(n_lines, n_bands), dtype=like.dtype, device=like.device)
