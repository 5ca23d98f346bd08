"""The paper's method: a network that reads the measured signal and is trained through the model's equations."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.calibration.objective import Objective
from swashtwin.calibration.search import EXACT, History, Progress, Search, one_thread
from swashtwin.calibration.unknowns import REACH
from swashtwin.errors import DataError, InputError
from swashtwin.integrators import SteadySolver
from swashtwin.seeding import derive_seed


@dataclass(frozen=True)
class IPINN:
    """Inverse physics-informed neural network (DOI 10.1177/00202940261419020).

    The measured acceleration passes four convolutions and a dense layer that gives six base values theta. The interface
    values are P = theta * S with fixed magnitudes S; they pass through the model, and the network's weights are
    trained on

        loss = spectrum loss + boundary loss

    with Adam; the epoch of least loss is kept. The paper gives channels, learning rate, epochs, the form of P and both
    losses. Our reading, where it is silent: one window of `revolutions` of the first recording, all channels divided by
    their common RMS; kernels of `kernel` readings at a `stride`, ReLU, and the mean over time before the dense layer; S
    is the power of ten below each nominal value; the dense layer's bias makes the first pass give the nominal values
    exactly; spectra are compared at the piston-pass lines, relative to the RMS of the measured ones; beyond a bound the
    model is given the bound, so that it always simulates a possible pump, while the boundary loss pulls the value back.

    One calibration trains one network for one measurement: the network is a way to search, not to be used again.
    """

    channels: tuple[int, ...] = (32, 64, 128, 256)
    """Channels of the convolutions."""
    learning_rate: float = 1e-4
    """Step size of Adam."""
    epochs: int = 500
    """Steps of Adam, one simulation each."""
    spectrum: Literal["linear", "weighted"] = "linear"
    """Spectrum loss: the RMSE of amplitudes (the paper's), or each line over its expected deviation (ours)."""
    values: Literal["base_values", "logarithms"] = "base_values"
    """What the network gives: theta in P = theta * S (the paper's), or ln(P / nominal) (ours)."""
    revolutions: float = 2.0
    """Length of the window that the network reads, in revolutions of the shaft."""
    kernel: int = 7
    """Readings that a convolution covers."""
    stride: int = 4
    """Readings that it moves on."""
    solver: SteadySolver = EXACT
    """What solves the equations; the paper's is `RK4`, which gives the same lines a few times slower."""

    def __post_init__(self) -> None:
        if self.epochs < 1 or not self.channels:
            raise InputError(f"epochs ({self.epochs}) must be at least 1, and channels ({self.channels}) not empty.")
        if not 0 < self.learning_rate < 1:
            raise InputError(f"learning_rate ({self.learning_rate:g}) must lie within 0...1, such as 1e-4.")
        if self.revolutions < 1:
            raise InputError(f"revolutions ({self.revolutions:g}) must be at least 1.")

    @classmethod
    def improved(cls, **changes: object) -> "IPINN":
        """The same network, giving logarithms of the values over the nominal ones.

        A step then changes every value by as large a share, so that values several times off the nominal ones are found
        as well: in 20 of 20 recoveries of known values, against 17 of 20 with base values
        (``benchmarks/calibration.py --recovery``).
        """
        return cls(**{"values": "logarithms", **changes})  # type: ignore[arg-type]

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Values of the epoch with the least loss; see `Calibrator`."""
        window = measured_window(objective, self.revolutions)
        compare = objective.spectrum_loss if self.spectrum == "linear" else objective.weighted_loss
        lower, upper = torch.as_tensor(objective.space.lower), torch.as_tensor(objective.space.upper)
        spectrum_losses, boundary_losses = np.empty(self.epochs), np.empty(self.epochs)
        path = np.empty((self.epochs, len(objective.unknowns)))
        with one_thread(), torch.random.fork_rng(devices=[]):
            torch.manual_seed(derive_seed(seed, "ipinn", "weights"))
            network = ParameterNetwork(self, window, objective)
            optimizer = torch.optim.Adam(network.parameters(), lr=self.learning_rate)
            for epoch in range(self.epochs):
                values, rest = network(window)
                possible = torch.minimum(torch.maximum(values, lower), upper)
                point = torch.cat([possible.log(), rest])
                spectrum_loss = compare(point, solver=self.solver)
                boundary_loss = objective.space.boundary_loss(values)
                loss = spectrum_loss + boundary_loss
                if not torch.isfinite(loss):
                    raise InputError(f"the loss is {loss.item()} in epoch {epoch + 1}; lower learning_rate.")
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                spectrum_losses[epoch], boundary_losses[epoch] = spectrum_loss.item(), boundary_loss.item()
                path[epoch] = point.detach().numpy()
                if progress is not None:
                    progress(epoch + 1, self.epochs, loss.item())
        best = int(np.argmin(spectrum_losses + boundary_losses))
        history = History(spectrum_losses, boundary_losses, path, best)
        return Search(point=path[best], history=history, simulations=self.epochs)


class ParameterNetwork(nn.Module):
    """The paper's network, from a measured window to six interface values and whatever else is searched."""

    scale: Tensor
    center: Tensor
    deviation: Tensor

    def __init__(self, settings: IPINN, window: Float[Tensor, "channel time"], objective: Objective) -> None:
        super().__init__()
        self.logarithms = settings.values == "logarithms"
        unknowns, nominal = objective.unknowns, objective.space.nominal
        sizes = (window.shape[0], *settings.channels)
        layers: list[nn.Module] = []
        for before, after in pairwise(sizes):
            layers += [nn.Conv1d(before, after, settings.kernel, settings.stride, settings.kernel // 2), nn.ReLU()]
        self.features = nn.Sequential(*layers, nn.AdaptiveAvgPool1d(1), nn.Flatten(0))
        self.dense = nn.Linear(sizes[-1], len(unknowns))
        magnitude = nominal if self.logarithms else 10 ** np.floor(np.log10(nominal))
        self.register_buffer("scale", torch.as_tensor(magnitude))
        self.register_buffer("center", torch.as_tensor(unknowns.start[6:]))
        self.register_buffer("deviation", torch.as_tensor(unknowns.deviation[6:]))
        start = np.zeros(len(unknowns))
        start[:6] = 0 if self.logarithms else nominal / magnitude
        with torch.no_grad():
            self.dense.bias.zero_()
            self.dense.bias.copy_(torch.as_tensor(start) - self.dense(self.features(window)))

    def forward(self, window: Float[Tensor, "channel time"]) -> tuple[Float[Tensor, " 6"], Float[Tensor, " rest"]]:
        """Interface values, and the other coordinates within four deviations of their priors' means; float64."""
        given = self.dense(self.features(window)).double()
        values = self.scale * (given[:6].exp() if self.logarithms else given[:6])
        return values, self.center + self.deviation * REACH * torch.tanh(given[6:] / REACH)


def measured_window(objective: Objective, revolutions: float) -> Float[Tensor, "channel time"]:
    """Start of the first recording, all channels over their common RMS, float32.

    Raises
    ------
    DataError
        The recording is shorter.
    """
    recording = objective.comparisons[0].measurement.recordings[0]
    length = round(revolutions * objective.twin.condition.period * recording.sample_rate)
    if length > recording.signal.shape[1]:
        raise DataError(
            f"{recording.recording_id} ({recording.duration:.4g} s) is shorter than the {revolutions:g} revolutions "
            f"({length / recording.sample_rate:.4g} s) that the network reads."
        )
    window = recording.signal[:, :length] - recording.signal[:, :length].mean(axis=1, keepdims=True)
    return torch.as_tensor(window / np.sqrt(np.mean(window**2)), dtype=torch.float32)
