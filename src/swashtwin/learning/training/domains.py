"""Training for operating conditions that are not in the training set.

A network that meets one speed and one pressure more often than others, or finds its classes by what a condition does to
the signal, fails where the condition is new. Three remedies, all off by default: drawing the windows so that every
condition counts the same, mixing pairs of windows, and drawing the features of the conditions together.
"""

from itertools import combinations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from swashtwin.learning.training.settings import TrainingSettings
from swashtwin.learning.windows.grouping import window_groups
from swashtwin.learning.windows.window_set import WindowSet

BANDWIDTHS = (0.5, 1.0, 2.0)
"""Widths of the kernels of `mmd`, over the median distance of the features."""


def conditions_of(windows: WindowSet, settings: TrainingSettings) -> Int[np.ndarray, " window"]:
    """Number of each window's speed and pressure, all alike where the settings do not ask for conditions.

    Raises
    ------
    DataError
        Some or all windows state no condition.
    """
    if settings.balance != "condition" and settings.alignment == "none":
        return np.zeros(len(windows), dtype=np.int64)
    return np.unique(window_groups(windows, "condition"), return_inverse=True)[1].astype(np.int64)


def epoch_order(
    target: Int[np.ndarray, " window"], condition: Int[np.ndarray, " window"], balance: str, rng: np.random.Generator
) -> Int[np.ndarray, " step"]:
    """Windows of one epoch in order: each once, or as many, drawn so that every class (and condition) counts the same.

    Parameters
    ----------
    balance : one of `settings.BALANCES`.
    """
    if balance == "none":
        return rng.permutation(len(target))
    factors = [target] if balance == "class" else [target, condition]
    cell = np.unique(np.column_stack(factors), axis=0, return_inverse=True)[1].reshape(-1)
    share = 1 / np.bincount(cell)[cell]
    return rng.choice(len(target), size=len(target), p=share / share.sum())


def mixing(count: int, strength: float, rng: np.random.Generator) -> tuple[Int[np.ndarray, " window"], float]:
    """Partner of each window of a batch, and the share that each keeps (mixup, Zhang et al. 2018, arXiv:1710.09412).

    Parameters
    ----------
    strength : both parameters of the beta distribution of the share.
    """
    return rng.permutation(count), float(rng.beta(strength, strength))


def misalignment(
    features: Float[Tensor, "window feature"], condition: Int[Tensor, " window"], kind: str
) -> Float[Tensor, ""]:
    """How differently the features lie under the conditions of a batch, in the mean over pairs of conditions.

    ``coral``: squared distance of their covariances over 4 d^2 (Sun and Saenko 2016, arXiv:1607.01719); ``mmd``: the
    squared maximum mean discrepancy under three Gaussian kernels (Gretton et al. 2012, JMLR 13:723), whose
    widths count as fixed. Conditions of fewer than three windows are left out; zero where there are no two.
    """
    groups = [features[condition == number] for number in torch.unique(condition)]
    pairs = list(combinations([group for group in groups if len(group) > 2], 2))
    if not pairs:
        return features.new_zeros(())
    distance = _coral if kind == "coral" else _mmd
    return torch.stack([distance(a, b) for a, b in pairs]).mean()


def _coral(a: Tensor, b: Tensor) -> Tensor:
    return (torch.cov(a.T) - torch.cov(b.T)).square().sum() / (4 * a.shape[1] ** 2)


def _mmd(a: Tensor, b: Tensor) -> Tensor:
    both = torch.cat([a, b])
    square = (both[:, None] - both[None]).square().sum(dim=-1)
    scale = square.detach().median().clamp(min=1e-12)
    kernel = torch.stack([torch.exp(-square / (2 * width**2 * scale)) for width in BANDWIDTHS]).mean(dim=0)
    n = len(a)
    return kernel[:n, :n].mean() + kernel[n:, n:].mean() - 2 * kernel[:n, n:].mean()
