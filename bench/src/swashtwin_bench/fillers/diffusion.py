"""A conditional diffusion model of spectra."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.foundation import derive_seed
from swashtwin.learning import WindowSet
from swashtwin_bench.fillers.generation import Batches, Draw, dense, fill_with_model


@dataclass(frozen=True)
class Diffusion:
    """Conditional denoising diffusion (Ho, Jain and Abbeel 2020, arXiv:2006.11239), given class and pressure.

    It works on the scores of `SpectralForm`, with the cosine schedule of Nichol and Dhariwal 2021 (arXiv:2102.09672).
    """

    components: int = 32
    """Principal components of the logarithmic spectra whose scores are modeled."""
    levels: int = 100
    """Levels of noise between a window and noise alone."""
    width: int = 256
    """Width of the hidden layers."""
    steps: int = 6000
    """Steps of Adam."""
    batch: int = 128
    """Windows of a step."""
    learning_rate: float = 1e-3
    """Adam's, falling to zero along a cosine."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell (`Filler`)."""
        return fill_with_model(self, "diffusion", train, label=label, pressure=pressure, count=count, seed=seed)

    def learn(
        self, scores: Float[Tensor, "window component"], condition: Float[Tensor, "window fact"], batches: Batches
    ) -> Draw:
        """What draws scores under conditions, after it was fitted on these."""
        size, conditions = scores.shape[1], condition.shape[1]
        network = dense(
            (size + conditions + 2 * _HARMONICS, *(self.width,) * 3, size), derive_seed(batches.seed, "denoiser")
        )
        kept_share = _kept_share(self.levels)
        least, most = scores.min(dim=0).values, scores.max(dim=0).values
        adam = torch.optim.Adam(network.parameters(), self.learning_rate)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, self.steps)
        random = torch.Generator().manual_seed(derive_seed(batches.seed, "noise"))
        for batch in batches.draw(self.steps, self.batch):
            x, c = scores[batch], condition[batch]
            level = torch.randint(self.levels, (len(x),), generator=random)
            noise = torch.randn(x.shape, generator=random)
            share = kept_share[level + 1, None]
            prediction = self._predict(network, share.sqrt() * x + (1 - share).sqrt() * noise, c, level)
            adam.zero_grad()
            (prediction - x).square().mean().backward()
            adam.step()
            falling.step()

        def draw(condition: Tensor, random: torch.Generator) -> Tensor:
            x = torch.randn(len(condition), size, generator=random)
            for level in reversed(range(self.levels)):
                now, before = kept_share[level + 1], kept_share[level]
                clean = self._predict(network, x, condition, torch.full((len(condition),), level)).clamp(least, most)
                step = 1 - now / before
                x = (before.sqrt() * step * clean + (now / before).sqrt() * (1 - before) * x) / (1 - now)
                if level:
                    x = x + (step * (1 - before) / (1 - now)).sqrt() * torch.randn(x.shape, generator=random)
            return x

        return draw

    def _predict(self, network: nn.Module, x: Tensor, condition: Tensor, level: Tensor) -> Tensor:
        """The scores that the network hears in `x`."""
        angle = math.pi * level[:, None] / self.levels * 2.0 ** torch.arange(_HARMONICS)
        return network(torch.cat([x, condition, angle.sin(), angle.cos()], dim=1))


_HARMONICS = 5
"""Sines and cosines that tell the network the level of noise."""


def _kept_share(levels: int) -> Tensor:
    """Share of the power that is still the window's after none, one, ... all levels of noise."""
    course = torch.cos((torch.linspace(0, 1, levels + 1) + 0.008) / 1.008 * math.pi / 2).square()
    return (course / course[0]).clamp(min=1e-4)
