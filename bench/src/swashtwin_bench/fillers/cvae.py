"""A conditional variational autoencoder of spectra."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.foundation import derive_seed
from swashtwin.learning import WindowSet
from swashtwin_bench.fillers.generation import Batches, Draw, dense, fill_with_model


@dataclass(frozen=True)
class CVAE:
    """Conditional variational autoencoder (Sohn, Lee and Yan 2015, NeurIPS 28), given class and pressure.

    It models the scores of `SpectralForm`. Its likelihood is Gaussian with a learned deviation of each score (Rybkin,
    Daniilidis and Levine 2021, arXiv:2006.13202), which is drawn with the window: the mean alone would be too smooth.
    """

    components: int = 32
    """Principal components of the logarithmic spectra whose scores are modeled."""
    latent: int = 16
    """Latent values of a window."""
    width: int = 256
    """Width of the hidden layers."""
    steps: int = 4000
    """Steps of Adam."""
    batch: int = 128
    """Windows of a step."""
    learning_rate: float = 1e-3
    """Adam's, falling to zero along a cosine."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell (`Filler`)."""
        return fill_with_model(self, "cvae", train, label=label, pressure=pressure, count=count, seed=seed)

    def learn(
        self, scores: Float[Tensor, "window component"], condition: Float[Tensor, "window fact"], batches: Batches
    ) -> Draw:
        """What draws scores under conditions, after it was fitted on these."""
        size, conditions = scores.shape[1], condition.shape[1]
        hidden = (self.width, self.width)
        encoder = dense((size + conditions, *hidden, 2 * self.latent), derive_seed(batches.seed, "encoder"))
        decoder = dense((self.latent + conditions, *hidden, size), derive_seed(batches.seed, "decoder"))
        log_deviation = torch.zeros(size, requires_grad=True)
        weights = [*encoder.parameters(), *decoder.parameters(), log_deviation]
        adam = torch.optim.Adam(weights, self.learning_rate)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, self.steps)
        random = torch.Generator().manual_seed(derive_seed(batches.seed, "noise"))
        for batch in batches.draw(self.steps, self.batch):
            x, c = scores[batch], condition[batch]
            mean, log_variance = encoder(torch.cat([x, c], dim=1)).chunk(2, dim=1)
            z = mean + torch.exp(log_variance / 2) * torch.randn(mean.shape, generator=random)
            miss = (x - decoder(torch.cat([z, c], dim=1))) / torch.exp(log_deviation)
            fit = (miss.square() / 2 + log_deviation).sum(dim=1)
            divergence = (mean.square() + log_variance.exp() - 1 - log_variance).sum(dim=1) / 2
            adam.zero_grad()
            (fit + divergence).mean().backward()
            adam.step()
            falling.step()

        def draw(condition: Tensor, random: torch.Generator) -> Tensor:
            z = torch.randn(len(condition), self.latent, generator=random)
            noise = torch.randn(len(condition), size, generator=random)
            return decoder(torch.cat([z, condition], dim=1)) + torch.exp(log_deviation) * noise

        return draw
