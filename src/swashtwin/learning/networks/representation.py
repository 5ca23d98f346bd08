"""Levels of a window that do not move with the moment at which it begins: short-time spectra, lines, envelopes.

Nothing here has weights, so that a network that rests on it computes it once for all epochs (`Network.represent`).
Levels are log10 of powers; a window is expected scaled (`Normalization`), which makes `FLOOR` negligible.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from swashtwin.signals import band_shares

FLOOR = 1e-7
"""Added to each power before its logarithm, in the square of the scaled unit."""


def short_time_levels(
    windows: Float[Tensor, "window channel time"], frame: int, hop: int, n_bands: int
) -> Float[Tensor, "window level step"]:
    """Levels of `n_bands` logarithmic bands, channel after channel, in frames of `frame` samples every `hop` samples.

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

    Per channel: `n_lines` equal bands of the lowest `share` of the spectrum, `n_bands` logarithmic ones of all of it,
    and the logarithm of its deviation, skewness, log kurtosis, log crest factor and mean of |x| over the deviation.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    power = power_of(x * taper_of(x.shape[-1], x))
    return torch.cat([*_levels(power, n_lines, share, n_bands), waveform_shape(x)], dim=-1).flatten(1)


def envelope_levels(
    windows: Float[Tensor, "window channel time"], n_lines: int, share: float, n_bands: int, above: float
) -> Float[Tensor, "window level"]:
    """`line_levels` of each channel's envelope, and the logarithm of the envelope's mean.

    The envelope is |x + i H(x)|, H being the Hilbert transform over the window, of what lies above the share `above` of
    half the sample rate.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    length = x.shape[-1]
    spectrum = torch.fft.rfft(x)
    spectrum = spectrum * (torch.arange(spectrum.shape[-1], device=x.device) > above * (length // 2))
    turned = torch.complex(spectrum.imag, -spectrum.real)
    real, imaginary = torch.fft.irfft(spectrum, n=length), torch.fft.irfft(turned, n=length)
    envelope = (real.square() + imaginary.square() + 1e-12).sqrt()
    mean = envelope.mean(dim=-1, keepdim=True)
    return torch.cat([line_levels(envelope, n_lines, share, n_bands), torch.log10(mean + FLOOR).flatten(1)], dim=-1)


def _levels(power: Tensor, n_lines: int, share: float, n_bands: int) -> tuple[Tensor, Tensor]:
    lowest = power[..., : max(1, round(share * power.shape[-1]))]
    lines = functional.adaptive_avg_pool1d(lowest, n_lines)
    banded = power @ bands_of(power.shape[-1], n_bands, power)
    return torch.log10(lines + FLOOR), torch.log10(banded + FLOOR)


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
