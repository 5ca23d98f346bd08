"""Training a network once on twins drawn from the prior, by simulation-based inference.

A network that gives a density of the parameters, and is trained to make the true parameters of simulated data likely,
gives their posterior (Papamakarios & Murray 2016, arXiv:1605.06376; Cranmer, Brehmer & Louppe 2020, DOI
10.1073/pnas.1912789117). The density here is normal in each coordinate and cut at its bounds, so that a value of which
the data say nothing can become as flat as its prior.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.calibration.methods.amortized_inputs import (
    NOISE,
    Input,
    Shown,
    Simulated,
    compressed,
    corrupted,
    points_drawn,
    shown,
    simulated,
)
from swashtwin.calibration.methods.search import EXACT, Progress, one_thread
from swashtwin.calibration.objective.spectrum_objective import FLOOR, MODEL_ERROR, Objective
from swashtwin.foundation import InputError, derive_seed

WIDTH = 256
"""Of every dense layer."""
N_LINE_LAYERS = 3
"""Dense layers that read lines."""
WINDOW_LAYERS = (32, 64, 128, 256)
"""Channels of the convolutions that read a window: the paper's."""
KERNEL, STRIDE = 7, 4
"""Of these convolutions, as `IPINN` has them."""
HELD_OUT = 0.1
"""Share of the twins that is never trained on, but judges the training and says what is usual."""
USUAL_SHARE = 0.999
"""A measurement stranger than this share of the held-out twins is out of range."""
N_LEVELS = 5
"""Noise levels at which that is judged."""
PHYSICS_TWINS = 8
"""Twins of a batch whose found values are simulated for the physics loss."""
UNSURE = 3.0
"""The untrained network is so unsure that its densities are about as flat as the prior."""
_SCALES = (math.log(5e-4), math.log(4.0))
"""Logarithms of the least and greatest standard deviation, in half widths of the bounds."""


@dataclass(frozen=True)
class AmortizedTraining:
    """How an amortized network is trained."""

    read: Input = "lines"
    """What it reads: the measured lines, or as the paper's two revolutions of the waveform."""
    twins: int = 20_000
    """How many are simulated; a tenth is held out."""
    epochs: int = 60
    """How often each is shown, in other noise every time."""
    batch: int = 256
    """Twins a step."""
    learning_rate: float = 3e-3
    """Greatest step size of Adam; it rises to it and falls to zero (one cycle)."""
    physics: float = 0.0
    """Weight of the spectrum loss of the found values, simulated in the loss as in `IPINN`; 0 leaves it out."""

    def __post_init__(self) -> None:
        if self.twins < 100 or self.epochs < 1 or self.batch < 1:
            raise InputError(
                f"twins ({self.twins}) must be at least 100, epochs ({self.epochs}) and batch ({self.batch}) 1."
            )
        if not 0 < self.learning_rate < 1:
            raise InputError(f"learning_rate ({self.learning_rate:g}) must lie within 0...1, such as 3e-3.")
        if not (math.isfinite(self.physics) and self.physics >= 0):
            raise InputError(f"physics ({self.physics:g}) must be zero or a positive weight.")


class AmortizedNetwork(nn.Module):
    """From what is measured to the middle and the standard deviation of every coordinate.

    Both are in half widths of the bounds, the middle from -1 to 1: they belong to a normal density cut there.
    """

    center: Tensor
    spread: Tensor

    def __init__(self, read: Input, size: int, n_unknowns: int) -> None:
        """`size` counts readings (lines) or channels (window)."""
        super().__init__()
        self.read = read
        self.sizes = {"size": size, "n_unknowns": n_unknowns}
        if read == "lines":
            widths = (size + 1, *(WIDTH,) * N_LINE_LAYERS)
            dense = [layer for a, b in pairwise(widths) for layer in (nn.Linear(a, b), nn.SiLU())]
            self.features = nn.Sequential()
        else:
            channels = (size, *WINDOW_LAYERS)
            layers = [
                layer
                for a, b in pairwise(channels)
                for layer in (nn.Conv1d(a, b, KERNEL, STRIDE, KERNEL // 2), nn.ReLU())
            ]
            self.features = nn.Sequential(*layers, nn.AdaptiveAvgPool1d(1), nn.Flatten())
            dense = [nn.Linear(WINDOW_LAYERS[-1] + 1, WIDTH), nn.SiLU()]
        last = nn.Linear(WIDTH, 2 * n_unknowns)
        with torch.no_grad():
            last.bias[n_unknowns:] += UNSURE
        self.dense = nn.Sequential(*dense, last)
        entries = 1 + (size if read == "lines" else 0)
        self.register_buffer("center", torch.zeros(entries))
        self.register_buffer("spread", torch.ones(entries))

    def standardize(self, given: Shown) -> None:
        """Take the mean and the standard deviation of each number of `given` as the usual ones."""
        numbers = self._numbers(given)
        self.center.copy_(numbers.mean(dim=0))
        self.spread.copy_(numbers.std(dim=0) + 1e-6)

    def _numbers(self, given: Shown) -> Tensor:
        return torch.cat([given.signal, given.level], dim=1) if self.read == "lines" else given.level

    def forward(self, given: Shown) -> tuple[Float[Tensor, "twin unknown"], Float[Tensor, "twin unknown"]]:
        """Middles, and logarithms of the standard deviations."""
        numbers = (self._numbers(given) - self.center) / self.spread
        if self.read == "waveform":
            numbers = torch.cat([self.features(given.signal), numbers], dim=1)
        middle, deviation = self.dense(numbers).chunk(2, dim=1)
        low, high = _SCALES
        return torch.tanh(middle), low + (high - low) * torch.sigmoid(deviation)


@dataclass(frozen=True, eq=False)
class Usual:
    """What lines of twins from the prior look like; others are out of range."""

    center: Float[Tensor, " reading"]
    """Mean of the logarithms of the amplitudes."""
    whitening: Float[Tensor, "reading reading"]
    """Makes their differences from the mean uncorrelated, each of variance 1, where the noise is least."""
    levels: Float[Tensor, " level"]
    """Logarithms of noise [m/s^2] at which a limit is known."""
    limits: Float[Tensor, " level"]
    """Distance that hardly any twin from the prior exceeds at that noise."""

    def distance(self, amplitude: Float[Tensor, "twin reading"]) -> Float[Tensor, " twin"]:
        """Root of the mean square of the whitened differences (Mahalanobis): about 1 for a twin from the prior."""
        return ((compressed(amplitude) - self.center) @ self.whitening).square().mean(dim=-1).sqrt()

    def strangeness(self, amplitude: Float[Tensor, "twin reading"], level: float) -> Float[Tensor, " twin"]:
        """Distance over the limit at this noise."""
        return self.distance(amplitude) / float(np.interp(level, self.levels.numpy(), self.limits.numpy()))


@dataclass(frozen=True, eq=False)
class Trained:
    """What a training gives."""

    network: AmortizedNetwork
    """The network, in evaluation mode."""
    usual: Usual
    """What its input looks like where it knows its way."""
    losses: tuple[float, ...]
    """Mean negative log likelihood of each epoch, in half widths of the bounds."""
    held_out_loss: float
    """The same of the twins held out, after the last epoch."""


def log_density_loss(
    found: tuple[Float[Tensor, "twin unknown"], Float[Tensor, "twin unknown"]], true: Float[Tensor, "twin unknown"]
) -> Float[Tensor, " twin"]:
    """Negative logarithm of what `AmortizedNetwork` found, a normal density cut at -1 and 1, at `true`; all summed."""
    middle, log_deviation = found
    deviation = log_deviation.exp()
    ends = (1 - middle) / deviation, (-1 - middle) / deviation
    share = (torch.erf(ends[0] / math.sqrt(2)) - torch.erf(ends[1] / math.sqrt(2))) / 2
    each = ((true - middle) / deviation).square() / 2 + log_deviation + share.log() + math.log(2 * math.pi) / 2
    return each.sum(dim=-1)


def trained(
    objective: Objective, settings: AmortizedTraining, *, seed: int, progress: Progress | None = None
) -> Trained:
    """Network for measurements like the objective's. The same seed on the same machine gives the same bits."""
    points = points_drawn(objective.unknowns, settings.twins, seed)
    twins = simulated(objective, points, settings.read)
    true = torch.as_tensor(unit_of(objective, points), dtype=torch.float32)
    n_held = round(HELD_OUT * settings.twins)
    held, taught = torch.arange(settings.twins).split([n_held, settings.twins - n_held])
    with one_thread(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(derive_seed(seed, "amortized", "weights"))
        generator = torch.Generator().manual_seed(derive_seed(seed, "amortized", "showing"))
        given = shown(twins, taught[:5000], settings.read, generator)
        network = AmortizedNetwork(settings.read, given.signal.shape[1], true.shape[1])
        network.standardize(given)
        losses = _taught(network, objective, twins, true, taught, settings, generator, progress)
        network.eval()
        given = shown(twins, held, settings.read, generator)
        with torch.no_grad():
            held_loss = float(log_density_loss(network(given), true[held]).mean())
        usual = _usual(twins, taught, held, generator)
    return Trained(network, usual, losses, held_loss)


def _taught(
    network: AmortizedNetwork,
    objective: Objective,
    twins: Simulated,
    true: Tensor,
    taught: Tensor,
    settings: AmortizedTraining,
    generator: torch.Generator,
    progress: Progress | None,
) -> tuple[float, ...]:
    steps = math.ceil(len(taught) / settings.batch)
    optimizer = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, total_steps=steps * settings.epochs
    )
    losses = []
    for epoch in range(settings.epochs):
        total = 0.0
        for chosen in taught[torch.randperm(len(taught), generator=generator)].split(settings.batch):
            given = shown(twins, chosen, settings.read, generator)
            found = network(given)
            loss = log_density_loss(found, true[chosen]).mean()
            total += float(loss.detach()) * len(chosen)
            if settings.physics:
                few = chosen[:PHYSICS_TWINS]
                loss = loss + settings.physics * _physics_loss(objective, found[0][: len(few)], twins.amplitude[few])
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimizer.step()
            schedule.step()
        losses.append(total / len(taught))
        if not math.isfinite(losses[-1]):
            raise InputError(f"the loss is {losses[-1]} in epoch {epoch + 1}; lower learning_rate.")
        if progress is not None:
            progress(epoch + 1, settings.epochs, losses[-1])
    return tuple(losses)


def _physics_loss(objective: Objective, middle: Tensor, amplitude: Tensor) -> Tensor:
    """RMS of what the lines of the found values differ from the true ones, over the expected deviations."""
    lower, upper = torch.as_tensor(objective.unknowns.lower), torch.as_tensor(objective.unknowns.upper)
    points = (lower + upper) / 2 + (upper - lower) / 2 * middle.double()
    if not bool(torch.isfinite(points).all()):
        raise InputError("the network's values are no longer finite; lower learning_rate.")
    sigma = ((MODEL_ERROR * amplitude).square() + FLOOR**2).sqrt()
    difference = (objective.amplitude(points, solver=EXACT) - amplitude) / sigma
    return (difference.square().mean(dim=-1) + 1e-12).sqrt().mean().float()


def _usual(twins: Simulated, taught: Tensor, held: Tensor, generator: torch.Generator) -> Usual:
    logarithms = compressed(corrupted(twins.amplitude[taught], torch.tensor(NOISE[0]), generator)).double()
    center = logarithms.mean(dim=0)
    covariance = torch.cov((logarithms - center).T)
    whitening = torch.linalg.inv(torch.linalg.cholesky(covariance)).T
    levels = torch.linspace(math.log(NOISE[0]), math.log(NOISE[1]), N_LEVELS)
    usual = Usual(center.float(), whitening.float(), levels, torch.ones(N_LEVELS))
    distances = [usual.distance(corrupted(twins.amplitude[held], level.exp(), generator)) for level in levels]
    return replace(usual, limits=torch.stack([one.quantile(USUAL_SHARE) for one in distances]))


def unit_of(objective: Objective, points: Float[np.ndarray, "twin unknown"]) -> Float[np.ndarray, "twin unknown"]:
    """Points in half widths of the bounds, from -1 to 1."""
    lower, upper = objective.unknowns.lower, objective.unknowns.upper
    return (2 * points - lower - upper) / (upper - lower)
