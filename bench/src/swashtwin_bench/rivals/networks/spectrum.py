"""What a fully connected network can make something of: the spectrum of a window, in lines of equal width."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional


class SpectrumLines(nn.Module):
    """Level of each of `n_lines` equal bands of each channel's spectrum, scaled by what training windows had there.

    ln of the mean amplitude within the band, mean removed, Hann taper, from half the first line to half the rate; then
    batch normalization without weights. A fully connected layer has no notion of time: it would have to learn a fault
    anew for every moment at which a window may begin, while the amplitudes do not move.
    """

    def __init__(self, n_channels: int, n_lines: int) -> None:
        super().__init__()
        self.n_lines = n_lines
        self.scaling = nn.BatchNorm1d(n_channels * n_lines, affine=False)

    def forward(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window line"]:
        """Levels, channel after channel."""
        length = windows.shape[-1]
        taper = torch.hann_window(length, device=windows.device)
        centered = windows - windows.mean(dim=-1, keepdim=True)
        spectrum = torch.view_as_real(torch.fft.rfft(centered * taper, dim=-1)[..., 1:])
        amplitude = 2 / taper.sum() * (spectrum.square().sum(dim=-1) + 1e-20).sqrt()
        levels = torch.log(functional.adaptive_avg_pool1d(amplitude, self.n_lines) + 1e-8)
        scaled: Tensor = self.scaling(levels.flatten(1))
        return scaled
