"""From the rigid shell to the recorded signal: sensors' gains and the housing's own bending.

A real housing bends from 1 to 2 kHz on, which rigid bodies cannot. Each mode m adds to channel c what a
light oscillator on the shell would: H_c(f) = g_c [1 + sum_m r_cm f^2 / (f_m^2 - f^2 + 2 i zeta_m f_m f)].
A sensor also reads a share x_cd of what another channel d would: H_c multiplies a_c + sum_d x_cd a_d.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError


@dataclass(frozen=True)
class SensorPath:
    """Gains of the channels and modes of the housing between the shell and them."""

    gain: tuple[float, ...]
    """Factor g_c of each channel."""
    frequency: tuple[float, ...] = ()
    """Natural frequency f_m of each mode [Hz]."""
    damping_ratio: tuple[float, ...] = ()
    """Damping ratio zeta_m of each mode."""
    residue: tuple[tuple[float, ...], ...] = ()
    """Share r_cm of each mode (inner) in each channel (outer)."""
    cross_talk: tuple[tuple[float, ...], ...] = ()
    """Share x_cd of each channel (inner) in each channel (outer), zero of a channel in itself; empty is none."""

    def __post_init__(self) -> None:
        modes = len(self.frequency)
        shares = [len(row) for row in self.residue]
        if len(self.damping_ratio) != modes or (modes and shares != [modes] * len(self.gain)):
            raise InputError(
                f"a path of {modes} modes and {len(self.gain)} channels needs as many damping ratios and a residue for "
                "each channel and mode."
            )
        if self.cross_talk and [len(row) for row in self.cross_talk] != [len(self.gain)] * len(self.gain):
            raise InputError(f"cross_talk of a path of {len(self.gain)} channels needs a share for each pair of them.")
        if any(value <= 0 for value in (*self.gain, *self.frequency, *self.damping_ratio)):
            raise InputError("gains, natural frequencies and damping ratios of a sensor path must be positive.")

    @property
    def mixing(self) -> Float[Tensor, "channel channel"]:
        """What each channel (row) reads of what rigid, ideal sensors would (columns)."""
        unit = torch.eye(len(self.gain), dtype=torch.float64)
        return unit + torch.tensor(self.cross_talk, dtype=torch.float64) if self.cross_talk else unit

    def response(self, frequency: Float[Tensor, "*#batch line"]) -> Complex[Tensor, "*#batch channel line"]:
        """H_c at `frequency` [Hz]."""
        gain, modes, damping = (
            torch.tensor(row, dtype=torch.float64, device=frequency.device)
            for row in (self.gain, self.frequency, self.damping_ratio)
        )
        residue = torch.tensor(self.residue or [[]] * len(self.gain), dtype=torch.float64, device=frequency.device)
        return path_response(frequency, gain, modes, damping, residue)


def path_response(
    frequency: Float[Tensor, "*#batch line"],
    gain: Float[Tensor, "*#batch channel"],
    modes: Float[Tensor, "*#batch mode"],
    damping_ratio: Float[Tensor, "*#batch mode"],
    residue: Float[Tensor, "*#batch channel mode"],
) -> Complex[Tensor, "*#batch channel line"]:
    """H_c at `frequency` [Hz], differentiable with respect to everything; see `SensorPath`."""
    f, mode = frequency[..., None, :], modes[..., :, None]
    light = f**2 / torch.complex(mode**2 - f**2, 2 * damping_ratio[..., :, None] * mode * f)
    bending = residue.to(light.dtype) @ light
    return gain[..., None] * (1 + bending)
