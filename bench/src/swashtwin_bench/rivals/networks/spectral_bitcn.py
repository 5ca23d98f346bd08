"""BiTCN on band powers of a window instead of its samples."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import InputError
from swashtwin.learning import Branch, Network
from swashtwin.signals import band_shares

# Short-time spectrum: samples of a frame, samples between frames, logarithmic bands.
_FRAME = 256
_HOP = 64
_FRAME_BANDS = 24

# Spectrum of the whole window: equal bands of its lowest share, and logarithmic bands of all of it.
_LINES = 200
_LINE_SHARE = 200 / 1024
_LINE_BANDS = 32

# Envelope spectra: equal bands, their share of the spectrum, and the lowest share of half the
# sample rate in the envelope: all of it, or what is above 1 kHz at 25.6 kHz.
_ENVELOPE_LINES = 64
_ENVELOPE_SHARE = 64 / 1024
_ENVELOPE_FROM = (0.0, 1000 / 12800)

# Minimum standard deviation of a band power: one that is constant in training is not amplified.
_MIN_DEVIATION = 1e-3

# Numerical floors of the deviation of a window, and of the logarithms of its shape.
_SIGNAL_FLOOR = 1e-6
_SHAPE_FLOOR = 1e-3


class SpectralBiTCN(Network):
    """BiTCN on short-time spectra, with a hidden layer on spectra of the whole window; ours.

    The two branches of the paper's `BiTCN` (DOI 10.1177/00202940261419020), dilated causal residual
    units with squeeze-and-excitation, read the powers of 24 bands in frames of 256 samples, 64
    samples apart: about 30 steps instead of 2048, and the receptive field is the whole window. The
    mean and the maximum of their sum over time are concatenated with a hidden layer on static
    features: the lines of the window's spectrum up to a fifth of half the sample rate, those of its
    envelopes (of all of it, and of what is above 1 kHz at 25.6 kHz), their band powers and the
    shape of their distributions.

    The reason: a fault of the pump changes ratios between lines by tenths, at a phase that differs
    from window to window. A convolution over samples would have to learn band powers first.

    Band powers are standardized by the training windows. In training, noise with `noise` times
    their deviation is added, which imitates a slightly different gain or mounting.

    Weights, with C = `n_channels`, F = the last of `channels`, L the static features of a window,
    H = `hidden`:

    ================================== ==========================
    ``positive``, ``inverse``          as in `BiTCN`, 24 C inputs
    ``skip``                           (F, 24 C, 1)
    ``hidden.0``                       (H, L)
    ``head``                           (classes, 2 F + H)
    ================================== ==========================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
    channels, dilations, causal, attention, bidirectional : of the branches, as in `BiTCN`.
    hidden : size of the hidden layer.
    dropout : share of the features that is dropped in training; a third of it in the branches.
    noise : ratio of the deviation of the noise in training to that of the band powers.

    Raises
    ------
    InputError
        A setting is invalid.

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
        if dilations is None:
            growth = 2 if causal else 1
            dilations = [growth**unit for unit in range(len(channels))]
        dilations = tuple(dilations)

        if len(channels) != len(dilations):
            raise InputError(
                f"{self.name} needs as many dilations ({len(dilations)}) as channels "
                f"({len(channels)})."
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
        n_inputs = n_channels * _FRAME_BANDS
        branch_settings: dict[str, Any] = {
            "stride": 1,
            "kernel_size": 3,
            "reduction": 4,
            "causal": causal,
            "attention": attention,
            "dropout": dropout / 3,
        }
        self.positive = Branch(n_inputs, channels, dilations, **branch_settings)
        self.inverse = None
        if bidirectional:
            self.inverse = Branch(n_inputs, channels, dilations, **branch_settings)
        self.skip = nn.Conv1d(n_inputs, channels[-1], 1)

        # Their number does not depend on the length of a window.
        probe = torch.zeros(1, 1, 64, device="cpu")
        self.n_static = n_channels * compute_static_features(probe).shape[1]
        self.hidden = nn.Sequential(
            nn.Linear(self.n_static, hidden), nn.BatchNorm1d(hidden), nn.ReLU()
        )
        self.register_buffer("mean", torch.zeros(self.n_static + n_inputs))
        self.register_buffer("deviation", torch.ones(self.n_static + n_inputs))
        self.head = nn.Linear(2 * channels[-1] + hidden, n_classes)

    def represent(
        self, windows: Float[Tensor, "window channel time"]
    ) -> Float[Tensor, "window feature"]:
        """Return the static features, then the band powers of the frames, step by step."""
        frames = short_time_powers(windows, _FRAME, _HOP, _FRAME_BANDS)
        return torch.cat(
            [compute_static_features(windows), frames.transpose(1, 2).flatten(1)], dim=1
        )

    def _split(self, represented: Tensor) -> tuple[Tensor, Tensor]:
        """Return the static features, and the band powers of the frames with their steps last."""
        static = represented[:, : self.n_static]
        frames = represented[:, self.n_static :]
        n_bands = self.n_channels * _FRAME_BANDS
        return static, frames.unflatten(1, (-1, n_bands)).transpose(1, 2)

    def pretrain(self, windows: Float[Tensor, "window feature"], seed: int) -> None:
        """Learn the mean and the deviation of each feature; the frames of a window share theirs."""
        static, frames = self._split(windows)
        mean = torch.cat([static.mean(dim=0), frames.mean(dim=(0, 2))])
        self.get_buffer("mean").copy_(mean)

        # The deviation of a single window is NaN.
        deviation = torch.cat([static.std(dim=0), frames.std(dim=(0, 2))])
        deviation = deviation.nan_to_num(1.0).clamp_min(_MIN_DEVIATION)
        self.get_buffer("deviation").copy_(deviation)

    def encode(self, windows: Float[Tensor, "window input"]) -> Float[Tensor, "window feature"]:
        """Return features of both branches over the frames, and of the hidden layer."""
        mean = self.get_buffer("mean")
        deviation = self.get_buffer("deviation")
        static, frames = self._split(windows)

        n = self.n_static
        frames = (frames - mean[n:, None]) / deviation[n:, None]
        frame_features = self._read_frames(self._add_noise(frames))
        static = (static - mean[:n]) / deviation[:n]
        static_features = self.hidden(self._add_noise(static))

        features = [frame_features.mean(dim=-1), frame_features.amax(dim=-1), static_features]
        encoded: Tensor = self.dropout(torch.cat(features, dim=1))
        return encoded

    def _read_frames(self, frames: Tensor) -> Tensor:
        fused = self.positive(frames)
        if self.inverse is not None:
            fused = fused + self.inverse(frames.flip(-1)).flip(-1)
        return torch.relu(fused + self.skip(frames))

    def _add_noise(self, values: Tensor) -> Tensor:
        if not self.training:
            return values
        return values + self.settings["noise"] * torch.randn_like(values)


def compute_static_features(
    windows: Float[Tensor, "window channel time"],
) -> Float[Tensor, "window feature"]:
    """Return the features without time: those of the window's lines and of its envelopes."""
    features = [line_features(windows, _LINES, _LINE_SHARE, _LINE_BANDS)]
    for min_share in _ENVELOPE_FROM:
        features.append(
            envelope_features(windows, _ENVELOPE_LINES, _ENVELOPE_SHARE, _LINE_BANDS, min_share)
        )

    return torch.cat(features, dim=1)


def short_time_powers(
    windows: Float[Tensor, "window channel time"], frame: int, hop: int, n_bands: int
) -> Float[Tensor, "window band step"]:
    """Return log10 powers of `n_bands` logarithmic bands in frames, channel after channel.

    Frames have `frame` samples and start every `hop` samples. A window shorter than a frame gets
    trailing zeros.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    x = functional.pad(x, (0, max(0, frame - x.shape[-1])))

    frames = x.unfold(-1, frame, hop) * hann_taper(frame, x)
    powers = line_powers(frames) @ band_matrix(frame // 2, n_bands, x)
    return torch.log10(powers + FLOOR).transpose(2, 3).flatten(1, 2)


def line_features(
    windows: Float[Tensor, "window channel time"], n_lines: int, share: float, n_bands: int
) -> Float[Tensor, "window feature"]:
    """Return log10 powers of the spectrum and the shape of the waveform, channel after channel.

    Per channel: `n_lines` equal bands of the lowest `share` of the spectrum, `n_bands` logarithmic
    bands of all of it, and `waveform_shape`.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    powers = line_powers(x * hann_taper(x.shape[-1], x))

    lowest = powers[..., : max(1, round(share * powers.shape[-1]))]
    lines = functional.adaptive_avg_pool1d(lowest, n_lines)
    bands = powers @ band_matrix(powers.shape[-1], n_bands, powers)

    features = [torch.log10(lines + FLOOR), torch.log10(bands + FLOOR), waveform_shape(x)]
    return torch.cat(features, dim=-1).flatten(1)


def envelope_features(
    windows: Float[Tensor, "window channel time"],
    n_lines: int,
    share: float,
    n_bands: int,
    min_share: float,
) -> Float[Tensor, "window feature"]:
    """Return `line_features` of the envelope of each channel, and log10 of the envelope's mean.

    The envelope is |x + i H(x)|, where H is the Hilbert transform over the window, of the part of x
    above the share `min_share` of half the sample rate.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    length = x.shape[-1]
    spectrum = torch.fft.rfft(x)
    lines = torch.arange(spectrum.shape[-1], device=x.device)
    spectrum = spectrum * (lines > min_share * (length // 2))

    rotated = torch.complex(spectrum.imag, -spectrum.real)
    real = torch.fft.irfft(spectrum, n=length)
    imaginary = torch.fft.irfft(rotated, n=length)
    # The gradient of a square root is infinite at zero.
    envelope = (real.square() + imaginary.square() + 1e-12).sqrt()

    mean = envelope.mean(dim=-1, keepdim=True)
    features = line_features(envelope, n_lines, share, n_bands)
    return torch.cat([features, torch.log10(mean + FLOOR).flatten(1)], dim=-1)


FLOOR = 1e-7
"""Added to each power before its logarithm, in the square of the scaled unit."""


def waveform_shape(
    x: Float[Tensor, "window channel time"],
) -> Float[Tensor, "window channel feature"]:
    """Return the shape of signals with mean 0.

    It is log10 of the deviation, skewness, ln of the kurtosis, ln of the crest factor, and the mean
    of |x| over the deviation.
    """
    deviation = x.square().mean(dim=-1, keepdim=True).sqrt() + _SIGNAL_FLOOR
    z = x / deviation
    square = z.square()  # products, because a power takes ten times as long
    magnitude = z.abs()

    return torch.cat(
        [
            torch.log10(deviation),
            (square * z).mean(dim=-1, keepdim=True),
            torch.log(square.square().mean(dim=-1, keepdim=True) + _SHAPE_FLOOR),
            torch.log(magnitude.amax(dim=-1, keepdim=True) + _SHAPE_FLOOR),
            magnitude.mean(dim=-1, keepdim=True),
        ],
        dim=-1,
    )


def line_powers(x: Tensor) -> Tensor:
    """Return the powers of the lines of the spectrum over the last axis, without that of the mean.

    It uses no complex arithmetic, which ONNX does not have.
    """
    real, imaginary = torch.view_as_real(torch.fft.rfft(x)[..., 1:]).unbind(dim=-1)
    return (real.square() + imaginary.square()) / x.shape[-1]


def hann_taper(length: int, like: Tensor) -> Tensor:
    """Return the periodic Hann taper, with type and device of `like`."""
    angle = torch.arange(length, dtype=like.dtype, device=like.device) * (2 * math.pi / length)
    return 0.5 - 0.5 * torch.cos(angle)


def band_matrix(n_lines: int, n_bands: int, like: Tensor) -> Tensor:
    """Return the share of each line (row) in each band (column), with type of `like`."""
    return torch.tensor(band_shares(n_lines, n_bands), dtype=like.dtype, device=like.device)
