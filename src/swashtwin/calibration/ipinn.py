"""The paper's method: a network that reads the measured signal and is trained through the model's
equations.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.calibration.search import EXACT_SOLVER, History, Progress, SearchResult
from swashtwin.calibration.spectrum_objective import MODEL_ERROR, Objective
from swashtwin.calibration.unknowns import CONSTANT_BOUND_STDS, CONSTANT_SLICE, VALUE_SLICE
from swashtwin.foundation import DataError, InputError, TorchStream, derive_seed, one_thread
from swashtwin.physics import SteadySolver

PAPER_RATES = (0.1, 0.01, 0.001, 0.0001)
"""Learning rates among which the paper chose."""


@dataclass(frozen=True)
class IPINN:
    """Inverse physics-informed neural network (DOI 10.1177/00202940261419020).

    The measured acceleration passes four convolutions and a dense layer that gives six base values
    theta. The interface values are P = theta * S with fixed magnitudes S; they pass through the
    model, and the network's weights are trained on

        loss = spectrum loss + boundary loss

    with Adam; the result is the epoch of minimum loss. The paper gives channels, learning rate,
    epochs, the form of P and both losses. Our reading of what it does not give: one window of
    `revolutions` of the first recording, all channels divided by their common RMS; kernels of
    `kernel` samples at a `stride`, ReLU, and the mean over time before the dense layer; S is the
    power of ten below each nominal value; the dense layer's bias makes the first pass give the
    nominal values exactly; spectra are compared at the piston-pass lines, relative to the RMS of
    the measured ones; beyond a bound the model is given the bound, so that it always simulates a
    possible pump, while the boundary loss pulls the value back. Constants that are searched with
    the six values count with their priors.

    One calibration trains one network for one measurement: the network is a way to search, not to
    be used again. Lines compared are the measurement's, whichever these are.
    """

    channels: tuple[int, ...] = (32, 64, 128, 256)
    """Channels of the convolutions."""
    learning_rate: float = 1e-4
    """Step size of Adam."""
    epochs: int = 500
    """Steps of Adam, one simulation each."""
    revolutions: float = 2.0
    """Length of the window that the network reads, in revolutions of the shaft."""
    kernel: int = 7
    """Samples that a convolution covers."""
    stride: int = 4
    """Samples between its positions."""
    solver: SteadySolver = EXACT_SOLVER
    """Solver of the equations of motion; the paper's is `RK4`, which gives the same lines a few
    times slower.
    """

    def __post_init__(self) -> None:
        if self.epochs < 1 or not self.channels:
            raise InputError(
                f"epochs ({self.epochs}) must be at least 1, and channels ({self.channels}) not "
                "empty."
            )
        if not 0 < self.learning_rate < 1:
            raise InputError(
                f"learning_rate ({self.learning_rate:g}) must lie within 0...1, such as 1e-4."
            )
        if self.revolutions < 1:
            raise InputError(f"revolutions ({self.revolutions:g}) must be at least 1.")

    def search(
        self, objective: Objective, *, seed: int, progress: Progress | None = None
    ) -> SearchResult:
        """Return the result of the epoch with the minimum loss; see `Calibrator`."""
        window = select_window(objective, self.revolutions)
        losses: list[list[float]] = []
        gradient_norms: list[float] = []
        points: list[np.ndarray] = []
        best_epoch = 0

        with one_thread():
            with TorchStream(derive_seed(seed, "ipinn", "weights")):
                network = ParameterNetwork(self, window, objective)
            optimizer = torch.optim.Adam(network.parameters(), lr=self.learning_rate)

            for epoch in range(self.epochs):
                point, epoch_losses = self._compute_losses(objective, *network(window))
                loss = epoch_losses.sum()
                if not torch.isfinite(loss):
                    raise InputError(
                        f"The loss is {loss.item()} in epoch {epoch + 1}: lower learning_rate.",
                        field="learning_rate",
                    )
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()

                losses.append(epoch_losses.tolist())
                gradient_norms.append(_gradient_norm(network))
                points.append(point.detach().numpy())
                if sum(losses[epoch]) < sum(losses[best_epoch]):
                    best_epoch = epoch
                if progress is not None:
                    progress(epoch + 1, self.epochs, loss.item())

        spectrum, boundary, prior = np.array(losses).T
        history = History(
            spectrum_loss=spectrum,
            boundary_loss=boundary,
            points=np.array(points),
            best_step=best_epoch,
            prior_loss=prior,
            gradient_norm=np.array(gradient_norms),
        )
        return SearchResult(points[best_epoch], history, simulations=len(losses))

    def _compute_losses(
        self, objective: Objective, values: Tensor, constants: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the point of the network's output, and the spectrum, boundary and prior loss
        there.
        """
        if not bool(torch.isfinite(values).all()):
            raise InputError(
                "The network's values are no longer finite: lower learning_rate.",
                field="learning_rate",
            )

        unknowns = objective.unknowns
        lower = torch.as_tensor(unknowns.space.lower)
        upper = torch.as_tensor(unknowns.space.upper)
        possible = torch.minimum(torch.maximum(values, lower), upper)
        point = torch.cat([possible.log(), constants])
        spectrum = objective.spectrum_loss(point, solver=self.solver)

        prior = torch.zeros_like(spectrum)
        if len(constants):
            center = torch.as_tensor(unknowns.center[CONSTANT_SLICE])
            deviation = torch.as_tensor(unknowns.deviation[CONSTANT_SLICE])
            distance = ((constants - center) / deviation).square().sum()
            penalty = distance / objective.measured.numel()
            # in units of the model error, the spectrum loss is about that of weighted lines
            prior = MODEL_ERROR * ((spectrum / MODEL_ERROR).square() + penalty).sqrt() - spectrum

        return point, torch.stack([spectrum, unknowns.space.boundary_loss(values), prior])


def _gradient_norm(network: nn.Module) -> float:
    """Return the norm of the gradient with respect to all weights."""
    norms = [weights.grad.norm() for weights in network.parameters() if weights.grad is not None]
    return float(torch.stack(norms).norm())


class ParameterNetwork(nn.Module):
    """The paper's network, from a measured window to six interface values and all constants that
    are searched.
    """

    scale: Tensor
    center: Tensor
    deviation: Tensor

    def __init__(
        self, settings: IPINN, window: Float[Tensor, "channel time"], objective: Objective
    ) -> None:
        super().__init__()
        unknowns = objective.unknowns
        nominal = unknowns.space.nominal

        sizes = (len(window), *settings.channels)
        layers: list[nn.Module] = []
        for n_inputs, n_outputs in pairwise(sizes):
            padding = settings.kernel // 2
            layers += [
                nn.Conv1d(n_inputs, n_outputs, settings.kernel, settings.stride, padding),
                nn.ReLU(),
            ]
        self.features = nn.Sequential(*layers, nn.AdaptiveAvgPool1d(1), nn.Flatten(-2))
        self.dense = nn.Linear(sizes[-1], len(unknowns))

        magnitude = 10 ** np.floor(np.log10(nominal))
        self.register_buffer("scale", torch.as_tensor(magnitude))
        self.register_buffer("center", torch.as_tensor(unknowns.start[CONSTANT_SLICE]))
        self.register_buffer("deviation", torch.as_tensor(unknowns.deviation[CONSTANT_SLICE]))

        # the first pass gives the nominal values exactly
        start = np.zeros(len(unknowns))
        start[VALUE_SLICE] = nominal / magnitude
        with torch.no_grad():
            self.dense.bias.zero_()
            self.dense.bias.copy_(torch.as_tensor(start) - self.dense(self.features(window)))

    def forward(
        self, window: Float[Tensor, "channel time"]
    ) -> tuple[Float[Tensor, " 6"], Float[Tensor, " constant"]]:
        """Return interface values, and the constants within four deviations of their priors'
        means; float64.
        """
        # the network computes in float32, the equations of motion in float64
        output = self.dense(self.features(window)).double()
        reach = CONSTANT_BOUND_STDS
        offset = reach * torch.tanh(output[CONSTANT_SLICE] / reach)
        return self.scale * output[VALUE_SLICE], self.center + self.deviation * offset


def select_window(objective: Objective, revolutions: float) -> Float[Tensor, "channel time"]:
    """Return the start of the first recording; all channels over their common RMS, float32.

    Raises
    ------
    DataError
        The recording is shorter.
    """
    comparison = objective.comparisons[0]
    recording = comparison.measurement.recordings[0]
    length = round(revolutions * comparison.twin.condition.period * recording.sample_rate)
    if length > recording.signal.shape[1]:
        raise DataError(
            f"{recording.recording_id} ({recording.duration:.4g} s) is shorter than the "
            f"{revolutions:g} revolutions ({length / recording.sample_rate:.4g} s) that the "
            "network reads."
        )
    signal = recording.signal[:, :length]
    window = signal - signal.mean(axis=1, keepdims=True)
    return torch.as_tensor(window / np.sqrt(np.mean(window**2)), dtype=torch.float32)
