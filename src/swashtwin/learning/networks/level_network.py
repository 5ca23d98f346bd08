"""Levels of the whole window, and a discriminant or a hidden layer on them."""

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Float64, Int
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import InputError, TorchStream
from swashtwin.learning.networks.network import Network, batches
from swashtwin.learning.networks.window_levels import WindowLevel, gain_response, level_catalogue, window_levels
from swashtwin.learning.training.class_space import shrunk_covariance

HEADS = ("discriminant", "hidden")
"""What decides on the levels; of both the average."""
AXES = ("order", "frequency")
"""Along what narrow lines are counted: orders of the shaft, or hertz."""

_LEAST_DEVIATION = 0.01
"""Least deviation that a level is divided by [log10 of power]; less is rounding."""
_RIDGE = 1e-6  # added to each variance, which a level that never changes has none of
_PASSES, _BATCH, _RATE = 10, 128, 2e-3


class LevelNetwork(Network):
    """Levels of a window's spectrum and envelopes, decided on by a discriminant, a hidden layer, or both; ours.

    A level is log10 of a power: of narrow lines at the shaft's orders (or of equal width in hertz), of logarithmic
    bands, of the same of the envelope of all of the signal and of what lies above 1 kHz and 4 kHz (at 25.6 kHz), and
    the shape of the distributions (`window_levels`). With `shape` each channel's own level is subtracted, so that no
    gain changes anything.

    The discriminant is linear: Gaussian classes of one covariance, shrunk by Ledoit and Wolf (2004, DOI
    10.1016/S0047-259X(03)00096-4), all classes alike likely. The hidden layer is trained by Adam. Their probabilities
    are averaged. Both are solved for by `solve`, so that no epochs are run.

    Weights, with L levels of a window, H = `hidden`:

    ======================= =================
    ``mean``, ``deviation`` (L,)
    ``head.discriminant``   (classes, L)
    ``head.hidden.0``       (H, L)
    ``head.hidden.4``       (classes, H)
    ======================= =================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    axis : one of `AXES`.
    shape : whether each channel's own level is subtracted.
    heads : some of `HEADS`.
    turns : turns of the shaft per sample where a window's speed is not stated; 0 where no speed is.
    hidden : size of the hidden layer.
    dropout : share of its features dropped in training.
    noise : deviation of the noise on the levels when the hidden layer is trained, over theirs.

    Raises
    ------
    InputError
        A setting cannot be, or orders are asked for without a speed.

    Examples
    --------
    >>> LevelNetwork(1, 5)(torch.zeros(2, 1, 2048)).shape
    torch.Size([2, 5])
    """

    name: ClassVar[str] = "levels"
    closed_form: ClassVar[bool] = True

    mean: Tensor
    deviation: Tensor
    response: Tensor
    head: "_Heads"

    def __init__(
        self,
        n_channels: int,
        n_classes: int,
        *,
        axis: str = "frequency",
        shape: bool = False,
        heads: Sequence[str] = HEADS,
        turns: float = 0.0,
        hidden: int = 128,
        dropout: float = 0.3,
        noise: float = 0.3,
    ) -> None:
        heads = tuple(heads)
        if axis not in AXES:
            raise InputError(f"{self.name}: axis {axis!r} is none of {', '.join(AXES)}.")
        if not heads or not set(heads) <= set(HEADS):
            raise InputError(f"{self.name}: heads ({', '.join(heads) or 'none'}) are some of {', '.join(HEADS)}.")
        if noise < 0 or turns < 0:
            raise InputError(f"{self.name}: noise ({noise:g}) and turns ({turns:g}) must not be negative.")
        if axis == "order" and not turns:
            raise InputError(f"{self.name}: axis 'order' needs turns, those of the shaft per sample; state the speed.")
        super().__init__(
            n_channels=n_channels,
            n_classes=n_classes,
            axis=axis,
            shape=shape,
            heads=heads,
            turns=turns,
            hidden=hidden,
            dropout=dropout,
            noise=noise,
        )
        response = gain_response(axis == "order")
        n_levels = n_channels * len(response)
        self.register_buffer("response", response, persistent=False)
        self.register_buffer("mean", torch.zeros(n_levels))
        self.register_buffer("deviation", torch.ones(n_levels))
        self.head = _Heads(n_levels, n_classes, heads, hidden, dropout)

    @property
    def uses_speed(self) -> bool:
        """Whether narrow lines are orders of the shaft."""
        return bool(self.settings["axis"] == "order")

    def catalogue(self, length: int) -> tuple[WindowLevel, ...]:
        """What each level of a channel is of, in windows of `length` samples; a feature is level after level, channel
        after channel."""
        return level_catalogue(length, self.uses_speed)

    def represent_at(
        self, windows: Float[Tensor, "window channel time"], turns: Float[Tensor, " window"]
    ) -> Float[Tensor, "window level"]:
        """Levels of windows with so many turns of the shaft per sample; NaN takes the training's."""
        if self.settings["axis"] == "frequency":
            return self.shaped(window_levels(windows, None))
        usual = torch.full_like(turns, self.settings["turns"])
        return self.shaped(window_levels(windows, torch.where(turns.isnan(), usual, turns)))

    def represent(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window level"]:
        """Levels at the speed of the training."""
        return self.represent_at(windows, torch.full_like(windows[:, 0, 0], torch.nan))

    def shaped(self, levels: Float[Tensor, "window channel level"]) -> Float[Tensor, "window value"]:
        """Levels of `window_levels`, channel after channel; with `shape` less what each channel's own level adds."""
        if self.settings["shape"]:
            levels = levels - self.response * levels[..., :1]
        return levels.flatten(1)

    def encode(self, windows: Float[Tensor, "window level"]) -> Float[Tensor, "window level"]:
        """Levels in deviations of the training's."""
        return (windows - self.mean) / self.deviation

    def solve(self, windows: Float[Tensor, "window level"], target: Int[Tensor, " window"], seed: int) -> None:
        """Find the weights from levels and classes."""
        with torch.no_grad():
            self.mean.copy_(windows.mean(dim=0))
            self.deviation.copy_(windows.std(dim=0).nan_to_num(1.0).clamp_min(_LEAST_DEVIATION))
            levels = self.encode(windows)
        if self.head.discriminant is not None:
            _solve_discriminant(self.head.discriminant, levels, target)
        if self.head.hidden is not None:
            self._train_hidden(self.head.hidden, levels, target, seed)
        self.eval()

    def log_probabilities(
        self, windows: Float[Tensor, "window level"]
    ) -> Mapping[str, Float64[np.ndarray, "window class"]]:
        """Logarithm of each class's probability by head."""
        with torch.no_grad():
            levels = self.encode(windows)
            return {
                name: functional.log_softmax(head(levels).double(), dim=-1).numpy() for name, head in self.head.heads()
            }

    def _train_hidden(self, hidden: nn.Module, levels: Tensor, target: Tensor, seed: int) -> None:
        counts = torch.bincount(target, minlength=self.n_classes)
        weight = len(target) / (self.n_classes * counts.clamp_min(1).float())
        steps = _PASSES * len(batches(target, _BATCH))
        optimizer = torch.optim.Adam(hidden.parameters(), lr=_RATE)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        hidden.train()
        random = TorchStream(seed)  # around what draws alone, for it slows every operation
        for _ in range(_PASSES):
            with random:
                order = torch.randperm(len(target), device=target.device)
            for batch in batches(order, _BATCH):
                with random:
                    noisy = levels[batch] + self.settings["noise"] * torch.randn_like(levels[batch])
                    scores = hidden(noisy)
                loss = functional.cross_entropy(scores, target[batch], weight=weight)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()


class _Heads(nn.Module):
    """Logarithm of the mean probability of the heads."""

    def __init__(self, n_levels: int, n_classes: int, heads: tuple[str, ...], hidden: int, dropout: float) -> None:
        super().__init__()
        self.discriminant = nn.Linear(n_levels, n_classes) if "discriminant" in heads else None
        self.hidden = None
        if "hidden" in heads:
            self.hidden = nn.Sequential(
                nn.Linear(n_levels, hidden),
                nn.BatchNorm1d(hidden),
                nn.ReLU(),
                nn.Dropout(dropout),
                nn.Linear(hidden, n_classes),
            )

    def heads(self) -> list[tuple[str, nn.Module]]:
        """Name and layers of each head."""
        return [(name, head) for name, head in self.named_children() if head is not None]

    def forward(self, levels: Float[Tensor, "window level"]) -> Float[Tensor, "window class"]:
        scores = torch.stack([functional.log_softmax(head(levels), dim=-1) for _, head in self.heads()])
        return torch.logsumexp(scores, dim=0) - math.log(len(scores))


def _solve_discriminant(layer: nn.Linear, levels: Tensor, target: Tensor) -> None:
    """Weights of the linear discriminant: W = S⁻¹ m_c, b = -m_cᵀ S⁻¹ m_c / 2, S the covariance within classes."""
    x, y = levels.double().cpu().numpy(), target.cpu().numpy()
    centers = np.stack([x[y == index].mean(axis=0) for index in range(layer.out_features)])
    covariance = shrunk_covariance(x - centers[y])
    weight = np.linalg.solve(covariance + _RIDGE * np.eye(len(covariance)), centers.T).T
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(weight))
        layer.bias.copy_(torch.from_numpy(-(weight * centers).sum(axis=1) / 2))
