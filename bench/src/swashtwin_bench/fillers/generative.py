"""Generative fillers: models of windows' scores (`SpectralForm`), given class and pressure."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor, nn

from swashtwin.foundation import TorchStream, derive_seed, random_stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import require_count
from swashtwin_bench.fillers.duplicates import draw_indices
from swashtwin_bench.fillers.filler import fill_cell, find_sources
from swashtwin_bench.fillers.spectra import (
    SpectralForm,
    cut_extensions,
    extension_length,
    periodic_extensions,
)

Draw = Callable[[Tensor, torch.Generator], Tensor]
"""Scores of new windows, from the condition of each."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Class and pressure as a network takes them."""

    classes: int
    """Number of classes."""
    center: float
    """Mean of the logarithm of the training windows' pressure."""
    spread: float
    """Its standard deviation; 1 where there is none."""

    @classmethod
    def fit(cls, windows: WindowSet) -> "Conditions":
        """Those of training windows."""
        log_pressures = np.log(windows.discharge_pressure[np.isfinite(windows.discharge_pressure)])
        spread = float(log_pressures.std()) if log_pressures.size else 0.0
        return cls(
            len(windows.classes),
            float(log_pressures.mean()) if log_pressures.size else 0.0,
            spread or 1.0,
        )

    def encode(
        self, target: Int64[np.ndarray, " window"], pressure: Float[np.ndarray, " window"]
    ) -> Float64[np.ndarray, "window fact"]:
        """One column for each class, and the logarithm of the pressure, scaled; 0 where it is not
        known.
        """
        scaled = (np.log(pressure) - self.center) / self.spread
        return np.concatenate(
            [np.eye(self.classes)[target], np.nan_to_num(scaled)[:, None]], axis=1
        )


@dataclass(frozen=True, eq=False)
class Batches:
    """Which windows a step learns from, drawn so that a cell counts as the square root of its
    size.
    """

    share: Float64[np.ndarray, " window"]
    """Probability of each window."""
    seed: int
    """Addresses the draws, the weights and the noise of the learning."""

    @classmethod
    def fit(cls, windows: WindowSet, seed: int) -> "Batches":
        """Those of training windows."""
        cells = np.column_stack([windows.target, np.nan_to_num(windows.cell_pressure)])
        cell = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
        share = 1 / np.sqrt(np.bincount(cell)[cell])
        return cls(share / share.sum(), seed)

    def draw(self, steps: int, size: int) -> Int64[np.ndarray, "step window"]:
        """Indices of the windows of each step."""
        rng = random_stream(self.seed, "batches")
        return rng.choice(len(self.share), size=(steps, size), p=self.share)


def dense(widths: tuple[int, ...], seed: int) -> nn.Sequential:
    """Linear layers of `widths` with SiLU between them, their weights drawn from `seed`."""
    with TorchStream(seed):
        layers: list[nn.Module] = []
        for entering, leaving in pairwise(widths):
            layers += [nn.Linear(entering, leaving), nn.SiLU()]
    return nn.Sequential(*layers[:-1])


class Generative(ABC):
    """Filler whose windows have scores that a model draws, and phases and noise of measured windows
    of the class.
    """

    name: ClassVar[str]
    components: int
    """Principal components of the logarithmic spectra whose scores are modeled."""

    @abstractmethod
    def learn(
        self,
        scores: Float[Tensor, "window component"],
        condition: Float[Tensor, "window fact"],
        batches: Batches,
    ) -> Draw:
        """What draws scores under conditions, after it was fitted on these."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """`count` windows of the cell (`Filler`), each beginning at another angle of the shaft."""
        require_count(count)
        find_sources(train, label, pressure)
        measured = train.subset(~train.synthetic & (train.target >= 0))
        lengths = [extension_length(measured, i) for i in range(len(measured))]
        extensions = periodic_extensions(measured, np.arange(len(measured)), max(lengths))
        conditions = Conditions.fit(measured)
        condition = conditions.encode(measured.target, measured.discharge_pressure)
        model_seed = derive_seed(seed, self.name)
        form = SpectralForm.fit(extensions, condition, self.components, model_seed)
        points = _tensor(form.scores(extensions, condition))
        draw = self.learn(points, _tensor(condition), Batches.fit(measured, model_seed))
        indices = draw_indices(np.flatnonzero(measured.label == label), label, count, seed)
        conditions_wanted = conditions.encode(
            np.full(count, train.classes.index(label)), np.full(count, float(pressure))
        )
        random = torch.Generator().manual_seed(
            derive_seed(seed, self.name, "draw", label, pressure)
        )
        with torch.no_grad():
            scores = draw(_tensor(conditions_wanted), random).numpy().astype(float)
        conditions_measured = conditions.encode(
            measured.target[indices], measured.discharge_pressure[indices]
        )
        extensions = form.rebuild(
            scores,
            conditions_wanted,
            periodic_extensions(measured, indices, form.length),
            conditions_measured,
        )
        signal = cut_extensions(
            extensions, measured, indices, random_stream(seed, self.name, "angle", label, pressure)
        )
        return fill_cell(
            signal,
            indices,
            train=measured,
            name=self.name,
            label=label,
            pressure=pressure,
            seed=seed,
        )


def _tensor(values: np.ndarray) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32)


@dataclass(frozen=True)
class CVAE(Generative):
    """Conditional variational autoencoder (Sohn, Lee and Yan 2015, NeurIPS 28), given class and
    pressure.

    It models the scores of `SpectralForm`. Its likelihood is Gaussian with a learned deviation of
    each score (Rybkin, Daniilidis and Levine 2021, arXiv:2006.13202), which is drawn with the
    window: the mean alone would be too smooth.
    """

    name: ClassVar[str] = "cvae"
    components: int = 32
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

    def learn(
        self,
        scores: Float[Tensor, "window component"],
        condition: Float[Tensor, "window fact"],
        batches: Batches,
    ) -> Draw:
        size, conditions = scores.shape[1], condition.shape[1]
        hidden = (self.width, self.width)
        encoder = dense(
            (size + conditions, *hidden, 2 * self.latent), derive_seed(batches.seed, "encoder")
        )
        decoder = dense(
            (self.latent + conditions, *hidden, size), derive_seed(batches.seed, "decoder")
        )
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


@dataclass(frozen=True)
class WGANGP(Generative):
    """Conditional Wasserstein GAN with gradient penalty (Gulrajani et al. 2017, arXiv:1704.00028).

    Generator and critic are given class and pressure, and work on the scores of `SpectralForm`.
    Penalty, steps of the critic and Adam's settings are the paper's.
    """

    name: ClassVar[str] = "wgan_gp"
    components: int = 32
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

    def learn(
        self,
        scores: Float[Tensor, "window component"],
        condition: Float[Tensor, "window fact"],
        batches: Batches,
    ) -> Draw:
        size, conditions = scores.shape[1], condition.shape[1]
        hidden = (self.width, self.width)
        generator = dense(
            (self.latent + conditions, *hidden, size), derive_seed(batches.seed, "generator")
        )
        critic = dense((size + conditions, *hidden, 1), derive_seed(batches.seed, "critic"))
        making, judging = (
            torch.optim.Adam(network.parameters(), self.learning_rate, (0.0, 0.9))
            for network in (generator, critic)
        )
        falling = [
            torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.steps)
            for optimizer in (making, judging)
        ]
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


def _penalty(
    critic: nn.Module, real: Tensor, generated: Tensor, condition: Tensor, random: torch.Generator
) -> Tensor:
    """Mean square by which the critic's slope leaves 1 between measured and made scores."""
    share = torch.rand(len(real), 1, generator=random)
    between = (share * real + (1 - share) * generated).requires_grad_()
    judged = critic(torch.cat([between, condition], dim=1)).sum()
    (slope,) = torch.autograd.grad(judged, between, create_graph=True)
    return (slope.norm(dim=1) - 1).square().mean()
