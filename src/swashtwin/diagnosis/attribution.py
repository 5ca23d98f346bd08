"""How much each sample, and each frequency, of a window adds to a network's answer: integrated gradients.

Sundararajan, Taly and Yan 2017, arXiv:1703.01365. From silence (0 after the scaling) to the window x along a straight
line, the answer f changes by f(x) - f(0) = Σ_t x_t g_t with g the mean gradient of f on the way (completeness). The
same sum over frequencies, Σ_k (w_k / N) Re(X_k conj(G_k)), is the same integral in the basis of sines (Parseval), since
the way is the same; so one set of gradients tells moments and lines alike.
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Float64

from swashtwin.signals import transform

if TYPE_CHECKING:
    from torch import nn

STEPS = 32
"""Points of the midpoint rule along the way."""


def mean_gradients(
    network: "nn.Module",
    signal: Float32[np.ndarray, "window *entry"],
    label: int,
    rival: int,
    *,
    steps: int = STEPS,
) -> tuple[Float64[np.ndarray, "window *entry"], Float64[np.ndarray, " window"]]:
    """(mean gradient on the way, f(x) - f(0)) of each window, f being the score of `label` less that of `rival`.

    Parameters
    ----------
    network : in evaluation mode.
    signal : scaled windows, as the network takes them.
    label, rival : indices of the two classes.
    steps : points of the midpoint rule.
    """
    import torch

    inputs = torch.from_numpy(signal)
    gradient = torch.zeros_like(inputs, dtype=torch.float64)
    for step in range(steps):
        point = (inputs * ((step + 0.5) / steps)).requires_grad_(True)
        scores = network(point)
        (slope,) = torch.autograd.grad((scores[:, label] - scores[:, rival]).sum(), point)
        gradient += slope.double() / steps
    with torch.no_grad():
        ends = network(torch.cat([inputs, torch.zeros_like(inputs[:1])])).double()
    answer = ends[:, label] - ends[:, rival]
    return gradient.numpy(), (answer[:-1] - answer[-1]).numpy()


def line_shares(
    signal: Float[np.ndarray, "channel time"], gradient: Float[np.ndarray, "channel time"]
) -> Float64[np.ndarray, "channel line"]:
    """What each line of the spectrum (`signals.transform`) adds to the answer; their sum is Σ signal · gradient.

    Examples
    --------
    >>> x, g = np.random.default_rng(0).normal(size=(2, 1, 9))
    >>> bool(np.isclose(line_shares(x, g).sum(), (x * g).sum()))
    True
    """
    n = signal.shape[-1]
    both = transform(signal) * np.conj(transform(gradient))
    weight = np.full(both.shape[-1], 2.0)
    weight[0] = 1.0
    if n % 2 == 0:
        weight[-1] = 1.0
    return np.asarray(weight / n * both.real, dtype=np.float64)
