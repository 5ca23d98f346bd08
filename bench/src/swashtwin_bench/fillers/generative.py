"""Generative fillers: models of the scores of windows (`SpectralForm`), by class and pressure."""

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
"""Function that draws the scores of new windows from their conditions."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Encoding of class and pressure for a network."""

    classes: int
    """Number of classes."""
    center: float
    """Mean of the logarithmic pressure of the training windows."""
    spread: float
    """Its standard deviation; 1 if the pressure is unknown or constant."""

    @classmethod
    def fit(cls, windows: WindowSet) -> "Conditions":
        """Fit the encoding on training windows."""
        pressures = windows.discharge_pressure
        log_pressures = np.log(pressures[np.isfinite(pressures)])
        if not log_pressures.size:
            return cls(len(windows.classes), center=0.0, spread=1.0)

        center = float(log_pressures.mean())
        spread = float(log_pressures.std()) or 1.0
        return cls(len(windows.classes), center, spread)

    def encode(
        self, target: Int64[np.ndarray, " window"], pressure: Float[np.ndarray, " window"]
    ) -> Float64[np.ndarray, "window fact"]:
        """Return a column for each class, and the scaled logarithmic pressure (0 if unknown)."""
        scaled = (np.log(pressure) - self.center) / self.spread
        pressure_column = np.nan_to_num(scaled)[:, None]
        return np.concatenate([np.eye(self.classes)[target], pressure_column], axis=1)


@dataclass(frozen=True, eq=False)
class Batches:
    """Windows of each training step: a cell counts by the square root of its size.

    Otherwise the many windows of full cells would leave no weight to the scarce one.
    """

    share: Float64[np.ndarray, " window"]
    """Probability of each window."""
    seed: int
    """Seed of the draws, the initial weights and the noise of the training."""

    @classmethod
    def fit(cls, windows: WindowSet, seed: int) -> "Batches":
        """Set up the batches of training windows."""
        cells = np.column_stack([windows.target, np.nan_to_num(windows.cell_pressure)])
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        share = 1 / np.sqrt(np.bincount(cell)[cell])
        return cls(share / share.sum(), seed)

    def draw(self, steps: int, size: int) -> Int64[np.ndarray, "step window"]:
        """Return the indices of the windows of each step."""
        rng = random_stream(self.seed, "batches")
        return rng.choice(len(self.share), size=(steps, size), p=self.share)


def dense(widths: tuple[int, ...], seed: int) -> nn.Sequential:
    """Return linear layers of `widths` with SiLU between them; `seed` is that of the weights."""
    layers: list[nn.Module] = []
    with TorchStream(seed):
        for n_in, n_out in pairwise(widths):
            layers += [nn.Linear(n_in, n_out), nn.SiLU()]

    # No activation after the last layer.
    return nn.Sequential(*layers[:-1])


class Generative(ABC):
    """Filler whose windows have scores drawn from a model.

    Phases and noise are those of measured windows of the class.
    """

    name: ClassVar[str]
    components: int
    """Number of principal components whose scores are modeled."""

    @abstractmethod
    def learn(
        self,
        scores: Float[Tensor, "window component"],
        condition: Float[Tensor, "window fact"],
        batches: Batches,
    ) -> Draw:
        """Fit the model, and return a function that draws scores."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """Return `count` windows of the cell (`Filler`), each from another shaft angle."""
        require_count(count)
        find_sources(train, label, pressure)  # validates class and pressure
        measured = train.subset(~train.synthetic & (train.target >= 0))

        # The spectral form, and the model of its scores, of all measured windows.
        length = max(extension_length(measured, i) for i in range(len(measured)))
        extensions = periodic_extensions(measured, np.arange(len(measured)), length)
        conditions = Conditions.fit(measured)
        condition = conditions.encode(measured.target, measured.discharge_pressure)
        model_seed = derive_seed(seed, self.name)
        form = SpectralForm.fit(extensions, condition, self.components, model_seed)
        scores = _to_tensor(form.scores(extensions, condition))
        draw = self.learn(scores, _to_tensor(condition), Batches.fit(measured, model_seed))

        # Scores of the cell.
        new_condition = conditions.encode(
            np.full(count, train.classes.index(label)), np.full(count, float(pressure))
        )
        generator = torch.Generator().manual_seed(
            derive_seed(seed, self.name, "draw", label, pressure)
        )
        with torch.no_grad():
            new_scores = draw(_to_tensor(new_condition), generator).numpy().astype(float)

        # Phases and noise of measured windows.
        indices = draw_indices(np.flatnonzero(measured.label == label), label, count, seed)
        new_extensions = form.rebuild(
            new_scores,
            new_condition,
            periodic_extensions(measured, indices, form.length),
            conditions.encode(measured.target[indices], measured.discharge_pressure[indices]),
        )
        angles = random_stream(seed, self.name, "angle", label, pressure)
        return fill_cell(
            cut_extensions(new_extensions, measured, indices, angles),
            indices,
            train=measured,
            name=self.name,
            label=label,
            pressure=pressure,
            seed=seed,
        )


def _to_tensor(values: np.ndarray) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32)


@dataclass(frozen=True)
class CVAE(Generative):
    """Conditional variational autoencoder (Sohn, Lee and Yan 2015, NeurIPS 28).

    It models the scores of `SpectralForm` given class and pressure. The likelihood is Gaussian with
    a learned deviation of each score (Rybkin, Daniilidis and Levine 2021, arXiv:2006.13202). New
    windows are drawn from the likelihood: its mean alone would be too smooth.
    """

    name: ClassVar[str] = "cvae"
    components: int = 32
    latent: int = 16
    """Number of latent values."""
    width: int = 256
    """Width of the hidden layers."""
    steps: int = 4000
    """Number of training steps."""
    batch: int = 128
    """Number of windows in a step."""
    learning_rate: float = 1e-3
    """Initial learning rate of Adam; it decays to zero along a cosine."""

    def learn(
        self,
        scores: Float[Tensor, "window component"],
        condition: Float[Tensor, "window fact"],
        batches: Batches,
    ) -> Draw:
        n_scores = scores.shape[1]
        n_facts = condition.shape[1]
        hidden = (self.width, self.width)
        encoder = dense(
            (n_scores + n_facts, *hidden, 2 * self.latent), derive_seed(batches.seed, "encoder")
        )
        decoder = dense(
            (self.latent + n_facts, *hidden, n_scores), derive_seed(batches.seed, "decoder")
        )
        log_deviation = torch.zeros(n_scores, requires_grad=True)

        weights = [*encoder.parameters(), *decoder.parameters(), log_deviation]
        optimizer = torch.optim.Adam(weights, self.learning_rate)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.steps)
        noise_generator = torch.Generator().manual_seed(derive_seed(batches.seed, "noise"))

        for batch in batches.draw(self.steps, self.batch):
            x = scores[batch]
            facts = condition[batch]

            mean, log_variance = encoder(torch.cat([x, facts], dim=1)).chunk(2, dim=1)
            noise = torch.randn(mean.shape, generator=noise_generator)
            z = mean + torch.exp(log_variance / 2) * noise

            # Negative evidence lower bound, without constants.
            residual = (x - decoder(torch.cat([z, facts], dim=1))) / torch.exp(log_deviation)
            reconstruction = (residual.square() / 2 + log_deviation).sum(dim=1)
            divergence = (mean.square() + log_variance.exp() - 1 - log_variance).sum(dim=1) / 2

            optimizer.zero_grad()
            (reconstruction + divergence).mean().backward()
            optimizer.step()
            schedule.step()

        def draw(condition: Tensor, generator: torch.Generator) -> Tensor:
            z = torch.randn(len(condition), self.latent, generator=generator)
            noise = torch.randn(len(condition), n_scores, generator=generator)
            return decoder(torch.cat([z, condition], dim=1)) + torch.exp(log_deviation) * noise

        return draw


@dataclass(frozen=True)
class WGANGP(Generative):
    """Conditional Wasserstein GAN with gradient penalty (Gulrajani et al. 2017, arXiv:1704.00028).

    Generator and critic work on the scores of `SpectralForm`, given class and pressure.
    Penalty, number of critic steps and settings of Adam are those of that paper.
    """

    name: ClassVar[str] = "wgan_gp"
    components: int = 32
    latent: int = 32
    """Number of random values from which a window is generated."""
    width: int = 256
    """Width of the hidden layers."""
    steps: int = 2000
    """Number of steps of the generator."""
    critic_steps: int = 5
    """Number of steps of the critic for each step of the generator."""
    penalty: float = 10.0
    """Weight of the gradient penalty."""
    batch: int = 64
    """Number of windows in a step."""
    learning_rate: float = 2e-4
    """Initial learning rate of Adam (betas 0 and 0.9); it decays to zero along a cosine."""

    def learn(
        self,
        scores: Float[Tensor, "window component"],
        condition: Float[Tensor, "window fact"],
        batches: Batches,
    ) -> Draw:
        n_scores = scores.shape[1]
        n_facts = condition.shape[1]
        hidden = (self.width, self.width)
        generator = dense(
            (self.latent + n_facts, *hidden, n_scores), derive_seed(batches.seed, "generator")
        )
        critic = dense((n_scores + n_facts, *hidden, 1), derive_seed(batches.seed, "critic"))

        betas = (0.0, 0.9)
        generator_optimizer = torch.optim.Adam(generator.parameters(), self.learning_rate, betas)
        critic_optimizer = torch.optim.Adam(critic.parameters(), self.learning_rate, betas)
        schedules = [
            torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.steps)
            for optimizer in (generator_optimizer, critic_optimizer)
        ]
        noise_generator = torch.Generator().manual_seed(derive_seed(batches.seed, "noise"))

        def draw(condition: Tensor, noise_generator: torch.Generator) -> Tensor:
            z = torch.randn(len(condition), self.latent, generator=noise_generator)
            return generator(torch.cat([z, condition], dim=1))

        order = batches.draw(self.steps * (self.critic_steps + 1), self.batch)
        for step_batches in order.reshape(self.steps, self.critic_steps + 1, self.batch):
            for batch in step_batches[1:]:
                x = scores[batch]
                facts = condition[batch]
                generated = draw(facts, noise_generator).detach()

                # One pass of the critic over both halves is faster than two.
                both = torch.cat([torch.cat([generated, x]), torch.cat([facts, facts])], dim=1)
                ratings = critic(both)
                loss = ratings[: self.batch].mean() - ratings[self.batch :].mean()
                penalty = _gradient_penalty(critic, x, generated, facts, noise_generator)

                critic_optimizer.zero_grad()
                (loss + self.penalty * penalty).backward()
                critic_optimizer.step()

            facts = condition[step_batches[0]]
            generator_optimizer.zero_grad()
            ratings = critic(torch.cat([draw(facts, noise_generator), facts], dim=1))
            (-ratings.mean()).backward()
            generator_optimizer.step()

            for schedule in schedules:
                schedule.step()

        return draw


def _gradient_penalty(
    critic: nn.Module,
    real: Tensor,
    generated: Tensor,
    condition: Tensor,
    noise_generator: torch.Generator,
) -> Tensor:
    """Return the mean squared deviation of the critic's slope from 1 between real and generated."""
    share = torch.rand(len(real), 1, generator=noise_generator)
    between = (share * real + (1 - share) * generated).requires_grad_()

    ratings = critic(torch.cat([between, condition], dim=1)).sum()
    (slope,) = torch.autograd.grad(ratings, between, create_graph=True)
    return (slope.norm(dim=1) - 1).square().mean()
