"""Levels of a window that do not move with the moment at which it begins: short-time spectra, lines, envelopes.

Nothing here has weights, so that a network that rests on it computes it once for all epochs (`Network.represent`).
Levels are log10 of powers; a window is expected scaled (`Normalization`), which makes `FLOOR` negligible.
"""

import math

import torch
from torch import Tensor

from swashtwin.signals import band_shares

FLOOR = 1e-7
"""Added to each power before its logarithm, in the square of the scaled unit."""


def waveform_shape(x: Tensor) -> Tensor:
    """Of signals with mean 0: log10 deviation, skewness, log kurtosis, log crest factor, mean of |x| over deviation."""
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
    """Power of the lines 1... of the spectrum over the last axis; without a complex number, for ONNX has none."""
    real, imaginary = torch.view_as_real(torch.fft.rfft(x)[..., 1:]).unbind(dim=-1)
    return (real.square() + imaginary.square()) / x.shape[-1]


def taper_of(length: int, like: Tensor) -> Tensor:
    """Hann taper of that many samples."""
    angle = torch.arange(length, dtype=like.dtype, device=like.device) * (2 * math.pi / length)
    return 0.5 - 0.5 * torch.cos(angle)


def bands_of(n_lines: int, n_bands: int, like: Tensor) -> Tensor:
    """Share of each line (row) in each band (column)."""
    return torch.tensor(band_shares(n_lines, n_bands), dtype=like.dtype, device=like.device)
