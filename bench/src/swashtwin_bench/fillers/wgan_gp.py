"""A conditional Wasserstein GAN of spectra."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.foundation import derive_seed
from swashtwin.learning import WindowSet
from swashtwin_bench.fillers.generation import Batches, Draw, dense, fill_with_model


@dataclass(frozen=True)
class WGANGP:
    """Conditional Wasserstein GAN with gradient penalty (Gulrajani et al. 2017, arXiv:1704.00028).

    Generator and critic are given class and pressure, and work on the scores of `SpectralForm`. Penalty, steps of the
    critic and Adam's settings are the paper's.
    """

    components: int = 32
    """Principal components of the logarithmic spectra whose scores are modeled."""
    latent: int = 32
    """Random values that a window is made of."""
    width: int = 256
    """Width of the hidden layers."""
    steps: int = 2000
    """Steps of the generator."""
    critic_steps: int = 5
    """Steps of the critic for each of the generator."""
    penalty: float = 10.0
    """Weight of the gradient penalty."""
    batch: int = 64
    """Windows of a step."""
    learning_rate: float = 2e-4
    """Adam's (betas 0 and 0.9), falling to zero along a cosine."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell (`Filler`)."""
        return fill_with_model(self, "wgan_gp", train, label=label, pressure=pressure, count=count, seed=seed)

    def learn(
        self, scores: Float[Tensor, "window component"], condition: Float[Tensor, "window fact"], batches: Batches
    ) -> Draw:
        """What draws scores under conditions, after it was fitted on these."""
        size, conditions = scores.shape[1], condition.shape[1]
        hidden = (self.width, self.width)
        generator = dense((self.latent + conditions, *hidden, size), derive_seed(batches.seed, "generator"))
        critic = dense((size + conditions, *hidden, 1), derive_seed(batches.seed, "critic"))
        making, judging = (
            torch.optim.Adam(network.parameters(), self.learning_rate, (0.0, 0.9)) for network in (generator, critic)
        )
        falling = [torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.steps) for optimizer in (making, judging)]
        random = torch.Generator().manual_seed(derive_seed(batches.seed, "noise"))

        def draw(condition: Tensor, random: torch.Generator) -> Tensor:
            z = torch.randn(len(condition), self.latent, generator=random)
            return generator(torch.cat([z, condition], dim=1))

        order = batches.draw(self.steps * (self.critic_steps + 1), self.batch)
        for step_batches in order.reshape(self.steps, self.critic_steps + 1, self.batch):
            for batch in step_batches[1:]:
                x, c = scores[batch], condition[batch]
                generated = draw(c, random).detach()
                judged = critic(torch.cat([torch.cat([generated, x]), torch.cat([c, c])], dim=1))
                loss = judged[: self.batch].mean() - judged[self.batch :].mean()
                judging.zero_grad()
                (loss + self.penalty * _penalty(critic, x, generated, c, random)).backward()
                judging.step()
            c = condition[step_batches[0]]
            making.zero_grad()
            (-critic(torch.cat([draw(c, random), c], dim=1)).mean()).backward()
            making.step()
            for schedule in falling:
                schedule.step()
        return draw


def _penalty(critic: nn.Module, real: Tensor, generated: Tensor, condition: Tensor, random: torch.Generator) -> Tensor:
    """Mean square by which the critic's slope leaves 1 between measured and made scores."""
    share = torch.rand(len(real), 1, generator=random)
    between = (share * real + (1 - share) * generated).requires_grad_()
    judged = critic(torch.cat([between, condition], dim=1)).sum()
    (slope,) = torch.autograd.grad(judged, between, create_graph=True)
    return (slope.norm(dim=1) - 1).square().mean()
