"""Levels of a whole window: narrow lines, logarithmic bands and the shape of the waveform, of signal and envelopes.

Nothing here has weights. Each level is log10 of a power or of an amplitude, or a number that no gain changes; by how
much a gain changes it is its gain response, so that a gain can be applied to, or removed from, the levels themselves.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from swashtwin.learning.networks.representation import FLOOR, bands_of, power_of, taper_of, waveform_shape

N_ORDERS, N_ENVELOPE_ORDERS = 72, 40
"""Orders of the shaft whose lines stand one by one, of the signal and of an envelope."""
_LINES, _LINE_SHARE, _ENVELOPE_LINES, _ENVELOPE_SHARE = 200, 200 / 1024, 64, 64 / 1024
_BANDS, _ENVELOPE_BANDS = 48, 24
_ENVELOPE_FROM = (0.0, 1000 / 12800, 4000 / 12800)
"""Shares of half the sample rate above which envelopes are taken: of all, above 1 kHz and 4 kHz at 25.6 kHz."""
_LEAST_DEVIATION, _NARROWEST = 1e-6, 1e-3  # of a channel, in the scaled unit; of an order within the spectrum [lines]
_N_SHAPE = 5  # log10 deviation, and four numbers that no gain changes


@dataclass(frozen=True)
class WindowLevel:
    """What a level of a channel is of."""

    quantity: str
    """``"power"`` of a band, ``"deviation"`` of the whole, or ``"shape"`` of the waveform."""
    is_envelope: bool = False
    """Whether it is of an envelope rather than of the signal."""
    low: float = 0.0
    """Lower edge of the band: in periods per sample, or in orders of the shaft."""
    high: float = 0.5
    """Upper edge, likewise."""
    is_order: bool = False
    """Whether the edges are in orders."""

    def edges(self, turns: float) -> tuple[float, float]:
        """Its edges in periods per sample, where the shaft turns so far per sample; at most 0.5."""
        factor = turns if self.is_order else 1.0
        return min(self.low * factor, 0.5), min(self.high * factor, 0.5)


def level_catalogue(length: int, orders: bool) -> tuple[WindowLevel, ...]:
    """What each level of a channel is of, in the order of `window_levels`, for windows of `length` samples.

    Examples
    --------
    >>> level_catalogue(2048, True)[5].edges(turns=0.01)
    (0.005, 0.015)
    """

    def of(is_envelope: bool, n_lines: int, share: float, n_bands: int) -> list[WindowLevel]:
        n = length // 2
        lowest = max(1, round(share * n))
        if orders:
            lines = [(order - 0.5, order + 0.5) for order in range(1, n_lines + 1)]
        else:
            lines = [
                ((i * lowest // n_lines + 0.5) / length, (-(-(i + 1) * lowest // n_lines) + 0.5) / length)
                for i in range(n_lines)
            ]
        bands = pairwise((np.geomspace(0.5, n + 0.5, n_bands + 1) / length).tolist())  # the edges of `band_shares`
        return [
            WindowLevel("deviation", is_envelope),
            *[WindowLevel("shape", is_envelope)] * (_N_SHAPE - 1),
            *(WindowLevel("power", is_envelope, *edges, is_order=orders) for edges in lines),
            *(WindowLevel("power", is_envelope, *edges) for edges in bands),
        ]

    counts = (N_ORDERS, N_ENVELOPE_ORDERS) if orders else (_LINES, _ENVELOPE_LINES)
    envelope = [*of(True, counts[1], _ENVELOPE_SHARE, _ENVELOPE_BANDS), WindowLevel("deviation", True)]
    return (*of(False, counts[0], _LINE_SHARE, _BANDS), *envelope * len(_ENVELOPE_FROM))


def window_levels(
    windows: Float[Tensor, "window channel time"], turns: Float[Tensor, " window"] | None
) -> Float[Tensor, "window channel level"]:
    """Levels of each channel, the logarithm of its deviation first.

    Parameters
    ----------
    turns : turns of the shaft per sample in each window, by which narrow lines are orders; None takes lines of equal
        width over the lowest fifth of the spectrum.
    """
    x = windows - windows.mean(dim=-1, keepdim=True)
    deviation = x.square().mean(dim=-1, keepdim=True).sqrt().clamp_min(_LEAST_DEVIATION)
    x, length = x / deviation, x.shape[-1]
    parts = [_levels(x, turns, N_ORDERS if turns is not None else _LINES, _LINE_SHARE, _BANDS)]
    spectrum = torch.fft.rfft(x)
    lines = torch.arange(spectrum.shape[-1], device=x.device)
    for above in _ENVELOPE_FROM:
        real, imaginary = _analytic(spectrum * (lines > above * (length // 2)), length)
        envelope = (real.square() + imaginary.square() + 1e-12).sqrt()
        mean = envelope.mean(dim=-1, keepdim=True)
        count = N_ENVELOPE_ORDERS if turns is not None else _ENVELOPE_LINES
        parts += [_levels(envelope - mean, turns, count, _ENVELOPE_SHARE, _ENVELOPE_BANDS), torch.log10(mean + FLOOR)]
    response = gain_response(turns is not None).to(x.device)
    return torch.cat(parts, dim=-1) + response * torch.log10(deviation)


def gain_response(orders: bool) -> Float[Tensor, " level"]:
    """How many decades each level of a channel rises when the channel is ten times as loud.

    Examples
    --------
    >>> gain_response(True)[:6].tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 2.0]
    """
    counts = (N_ORDERS, N_ENVELOPE_ORDERS) if orders else (_LINES, _ENVELOPE_LINES)
    shape = [1.0] + [0.0] * (_N_SHAPE - 1)
    envelope = [*shape, *[2.0] * (counts[1] + _ENVELOPE_BANDS), 1.0]
    return torch.tensor([*shape, *[2.0] * (counts[0] + _BANDS), *envelope * len(_ENVELOPE_FROM)])


def _analytic(spectrum: Tensor, length: int) -> tuple[Tensor, Tensor]:
    """Real and imaginary part of the analytic signal; without a complex result, for ONNX has none."""
    turned = torch.complex(spectrum.imag, -spectrum.real)
    return torch.fft.irfft(spectrum, n=length), torch.fft.irfft(turned, n=length)


def _levels(x: Tensor, turns: Tensor | None, n_lines: int, share: float, n_bands: int) -> Tensor:
    """Shape of the waveform, levels of narrow lines, levels of logarithmic bands; the mean of `x` is 0."""
    power = power_of(x * taper_of(x.shape[-1], x))
    if turns is None:
        lowest = power[..., : max(1, round(share * power.shape[-1]))]
        lines = functional.adaptive_avg_pool1d(lowest, n_lines)
    else:
        lines = _order_powers(power, turns * x.shape[-1], n_lines)
    banded = power @ bands_of(power.shape[-1], n_bands, power)
    return torch.cat([waveform_shape(x), torch.log10(lines + FLOOR), torch.log10(banded + FLOOR)], dim=-1)


def _order_powers(power: Tensor, lines_per_order: Tensor, n_orders: int) -> Tensor:
    """Mean power of the lines within half an order of each order; that of the last line beyond the spectrum.

    `power` holds lines 1, 2, ... of the window; the edges between orders fall within lines, whose power is shared out.
    """
    order = torch.arange(n_orders + 1, dtype=power.dtype, device=power.device) + 0.5
    edges = (order * lines_per_order[:, None].to(power.dtype) - 0.5).clamp(0, power.shape[-1])
    total = functional.pad(power.double().cumsum(dim=-1), (1, 0))
    below = edges.floor().long().clamp(max=power.shape[-1] - 1)
    index = below[:, None].expand(-1, power.shape[1], -1)
    left, right = total.gather(-1, index), total.gather(-1, index + 1)
    at_edges = left + (edges - below)[:, None] * (right - left)
    width = (edges[:, 1:] - edges[:, :-1]).clamp_min(1e-6)
    mean = (at_edges.diff(dim=-1) / width[:, None]).clamp_min(0.0).to(power.dtype)
    return torch.where(width[:, None] < _NARROWEST, power[..., -1:], mean)
