"""The paper's method: a network that reads the measured signal and is trained through the model's equations."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.calibration.methods.checkpoint import Checkpoint
from swashtwin.calibration.methods.search import EXACT, Decay, History, Progress, Search, with_priors
from swashtwin.calibration.objective.spectrum_objective import MODEL_ERROR, Objective
from swashtwin.calibration.objective.unknowns import CONSTANTS, REACH, VALUES
from swashtwin.foundation import DataError, InputError, TorchStream, derive_seed, one_thread
from swashtwin.physics import SteadySolver
from swashtwin.recordings import Recording

Spectrum = Literal["linear", "weighted", "logarithmic"]
"""How `IPINN` measures the distance of two spectra."""


@dataclass(frozen=True)
class IPINN:
    """Inverse physics-informed neural network (DOI 10.1177/00202940261419020).

    The measured acceleration passes four convolutions and a dense layer that gives six base values theta. The interface
    values are P = theta * S with fixed magnitudes S; they pass through the model, and the network's weights are
    trained on

        loss = spectrum loss + boundary loss

    with Adam; the result is the epoch of least loss. The paper gives channels, learning rate, epochs, the form of P and
    both losses. Our reading, where it is silent: one window of `revolutions` of the first recording, all channels
    divided by their common RMS; kernels of `kernel` samples at a `stride`, ReLU, and the mean over time before the
    dense layer; S is the power of ten below each nominal value; the dense layer's bias makes the first pass give the
    nominal values exactly; spectra are compared at the piston-pass lines, relative to the RMS of the measured ones;
    beyond a bound the model is given the bound, so that it always simulates a possible pump, while the boundary loss
    pulls the value back.

    One calibration trains one network for one measurement: the network is a way to search, not to be used again. Lines
    compared are the measurement's, whichever these are.
    """

    channels: tuple[int, ...] = (32, 64, 128, 256)
    """Channels of the convolutions."""
    learning_rate: float = 1e-4
    """Step size of Adam."""
    decay: Decay = "constant"
    """How it goes."""
    epochs: int = 500
    """Steps of Adam, one simulation each."""
    patience: int | None = None
    """Stop after so many epochs without a smaller loss; never by default."""
    spectrum: Spectrum = "linear"
    """Spectrum loss: the RMSE of amplitudes (the paper's), each line over its expected deviation, or the same of the
    logarithms (ours); see `spectrum_loss_of`."""
    boundary: bool = True
    """Whether the boundary loss counts."""
    priors: Literal["constants", "all"] = "constants"
    """Whose priors count: those of constants searched beside the six values, or the six values' too."""
    values: Literal["base_values", "plain", "logarithms"] = "base_values"
    """What the network gives: theta in P = theta * S (the paper's), P itself, or ln(P / nominal) (ours)."""
    recordings: Literal["first", "all"] = "first"
    """Recordings that the network reads; its output is averaged over all."""
    revolutions: float = 2.0
    """Length of the window that the network reads, in revolutions of the shaft."""
    kernel: int = 7
    """Samples that a convolution covers."""
    stride: int = 4
    """Samples between its positions."""
    solver: SteadySolver = EXACT
    """What solves the equations; the paper's is `RK4`, which gives the same lines a few times slower."""

    is_resumable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.epochs < 1 or not self.channels:
            raise InputError(f"epochs ({self.epochs}) must be at least 1, and channels ({self.channels}) not empty.")
        if not 0 < self.learning_rate < 1:
            raise InputError(f"learning_rate ({self.learning_rate:g}) must lie within 0...1, such as 1e-4.")
        if self.revolutions < 1:
            raise InputError(f"revolutions ({self.revolutions:g}) must be at least 1.")
        if self.patience is not None and self.patience < 1:
            raise InputError(f"patience ({self.patience}) must be at least 1, or None for all epochs.")

    @classmethod
    def improved(cls, **changes: object) -> "IPINN":
        """The same network with what ``benchmarks/optimizers.py`` shows to be better.

        It gives logarithms of the values over the nominal ones, so that a step changes every value by as large a share;
        each line counts by its expected deviation, the priors of all that is searched count, and the step size begins
        at 1e-3 and falls to zero. So it minimizes what `GaussNewton` does, and ends at the same values.
        """
        ours = {"values": "logarithms", "spectrum": "weighted", "priors": "all", "learning_rate": 1e-3}
        return cls(**{**ours, "decay": "cosine", **changes})  # type: ignore[arg-type]

    def search(
        self,
        objective: Objective,
        *,
        seed: int,
        progress: Progress | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Search:
        """Values of the epoch with the least loss; see `Calibrator` and, for `checkpoint`, `ResumableCalibrator`."""
        window = self.window_of(objective)
        rows: list[tuple[float, float, float, float]] = []
        path: list[np.ndarray] = []
        with one_thread():
            with TorchStream(derive_seed(seed, "ipinn", "weights")):
                network = ParameterNetwork(self, window, objective)
            optimizer = torch.optim.Adam(network.parameters(), lr=self.learning_rate)
            schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.epochs)
            if checkpoint is not None:
                rows, path = _continued(checkpoint, network, optimizer, schedule)
            best = _best(rows)
            for epoch in range(len(rows), self.epochs):
                if self.patience is not None and epoch - 1 - best >= self.patience:
                    break
                point, losses = self._losses(objective, *network(window))
                loss = losses.sum()
                if not torch.isfinite(loss):
                    raise InputError(f"the loss is {loss.item()} in epoch {epoch + 1}; lower learning_rate.")
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                if self.decay == "cosine":
                    schedule.step()
                rows.append((*losses.tolist(), gradient_norm(network)))
                path.append(point.detach().numpy())
                best = epoch if sum(rows[epoch][:3]) < sum(rows[best][:3]) else best
                if checkpoint is not None and checkpoint.is_due(len(rows)):
                    records = {"losses": np.array(rows), "points": np.array(path)}
                    checkpoint.save(network.state_dict(), optimizer, schedule, records)
                if progress is not None:
                    progress(epoch + 1, self.epochs, loss.item())
        spectrum, boundary, prior, gradient = np.array(rows).T
        history = History(spectrum, boundary, np.array(path), best, prior, gradient)
        return Search(point=path[best], history=history, simulations=len(rows))

    def window_of(self, objective: Objective) -> Float[Tensor, "*recording channel time"]:
        """Input of the network."""
        return measured_window(objective, self.revolutions, self.recordings)

    def _losses(self, objective: Objective, values: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
        """Point of what the network gave, and the spectrum, boundary and prior loss there."""
        if not bool(torch.isfinite(values).all()):
            raise InputError("the network's values are no longer finite; lower learning_rate.")
        lower, upper = torch.as_tensor(objective.space.lower), torch.as_tensor(objective.space.upper)
        possible = torch.minimum(torch.maximum(values, lower), upper)
        point = torch.cat([possible.log(), rest])
        spectrum = spectrum_loss_of(objective, self.spectrum, point, self.solver)
        prior = torch.zeros_like(spectrum)
        boundary = objective.space.boundary_loss(values) if self.boundary else torch.zeros_like(spectrum)
        first = 0 if self.priors == "all" else 6
        if len(point) > first:
            unit = MODEL_ERROR if self.spectrum == "linear" else 1.0
            prior = with_priors(objective, point, spectrum / unit, first) * unit - spectrum
        return point, torch.stack([spectrum, boundary, prior])


def _continued(
    checkpoint: Checkpoint,
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
) -> tuple[list[tuple[float, float, float, float]], list[np.ndarray]]:
    """Losses and points so far, after the network was set to the checkpoint's weights; none where there is no file."""
    weights, records = checkpoint.load(optimizer, schedule)
    if not records:
        return [], []
    network.load_state_dict(weights)
    return [(row[0], row[1], row[2], row[3]) for row in records["losses"].tolist()], list(records["points"])


def _best(rows: list[tuple[float, float, float, float]]) -> int:
    """The first epoch of least loss."""
    return min(range(len(rows)), key=lambda epoch: sum(rows[epoch][:3]), default=0)


def spectrum_loss_of(
    objective: Objective, spectrum: Spectrum, point: Float[Tensor, "*batch unknown"], solver: SteadySolver
) -> Float[Tensor, "*batch"]:
    """Distance of the simulated from the measured amplitudes.

    ``linear``: `Objective.spectrum_loss`; ``weighted``: `Objective.weighted_loss`; ``logarithmic``: root mean square of
    ln(simulated / measured) over sigma / measured, the deviation of a logarithm, so that a line near the noise does not
    rule. Near the measured amplitudes the last two are the same; far below them the logarithm pulls harder, far above
    less.
    """
    if spectrum == "linear":
        return objective.spectrum_loss(point, solver=solver)
    if spectrum == "weighted":
        return objective.weighted_loss(point, solver=solver)
    objective.require_amplitudes("a logarithmic spectrum")
    measured, least = objective.measured, 1e-6 * objective.sigma
    ratio = (objective.amplitude(point, solver=solver) + least) / (measured + least)
    return ((ratio.log() * measured / objective.sigma).square().mean(dim=-1) + 1e-24).sqrt()


class ParameterNetwork(nn.Module):
    """The paper's network, from a measured window to six interface values and whatever else is searched."""

    scale: Tensor
    center: Tensor
    deviation: Tensor

    def __init__(self, settings: IPINN, window: Float[Tensor, "*recording channel time"], objective: Objective) -> None:
        super().__init__()
        self.logarithms = settings.values == "logarithms"
        unknowns, nominal = objective.unknowns, objective.space.nominal
        sizes = (window.shape[-2], *settings.channels)
        layers: list[nn.Module] = []
        for before, after in pairwise(sizes):
            layers += [nn.Conv1d(before, after, settings.kernel, settings.stride, settings.kernel // 2), nn.ReLU()]
        self.features = nn.Sequential(*layers, nn.AdaptiveAvgPool1d(1), nn.Flatten(-2))
        self.dense = nn.Linear(sizes[-1], len(unknowns))
        magnitude = {
            "base_values": 10 ** np.floor(np.log10(nominal)),
            "plain": np.ones_like(nominal),
            "logarithms": nominal,
        }[settings.values]
        self.register_buffer("scale", torch.as_tensor(magnitude))
        self.register_buffer("center", torch.as_tensor(unknowns.start[CONSTANTS]))
        self.register_buffer("deviation", torch.as_tensor(unknowns.deviation[CONSTANTS]))
        start = np.zeros(len(unknowns))
        start[VALUES] = 0 if self.logarithms else nominal / magnitude
        with torch.no_grad():
            self.dense.bias.zero_()
            self.dense.bias.copy_(torch.as_tensor(start) - self._output(window))

    def _output(self, window: Tensor) -> Tensor:
        """Output of the dense layer, averaged over the recordings."""
        output: Tensor = self.dense(self.features(window))
        return output.mean(dim=0) if output.ndim > 1 else output

    def forward(
        self, window: Float[Tensor, "*recording channel time"]
    ) -> tuple[Float[Tensor, " 6"], Float[Tensor, " rest"]]:
        """Interface values, and the other coordinates within four deviations of their priors' means; float64."""
        output = self._output(window).double()
        values = self.scale * (output[VALUES].exp() if self.logarithms else output[VALUES])
        return values, self.center + self.deviation * REACH * torch.tanh(output[CONSTANTS] / REACH)


def measured_window(
    objective: Objective, revolutions: float, recordings: Literal["first", "all"] = "first"
) -> Float[Tensor, "*recording channel time"]:
    """Start of the first recording, or of all (at the shortest's length); all channels over their common RMS, float32.

    Raises
    ------
    DataError
        A recording is shorter.
    """
    windows = []
    for comparison in objective.comparisons:
        for recording in comparison.measurement.recordings:
            windows.append(_window(recording, revolutions, comparison.twin.condition.period))
            if recordings == "first":
                return windows[0]
    shortest = min(window.shape[-1] for window in windows)
    return torch.stack([window[:, :shortest] for window in windows])


def _window(recording: Recording, revolutions: float, period: float) -> Tensor:
    length = round(revolutions * period * recording.sample_rate)
    if length > recording.signal.shape[1]:
        raise DataError(
            f"{recording.recording_id} ({recording.duration:.4g} s) is shorter than the {revolutions:g} revolutions "
            f"({length / recording.sample_rate:.4g} s) that the network reads."
        )
    window = recording.signal[:, :length] - recording.signal[:, :length].mean(axis=1, keepdims=True)
    return torch.as_tensor(window / np.sqrt(np.mean(window**2)), dtype=torch.float32)


def gradient_norm(network: nn.Module) -> float:
    """Norm of the loss's gradient with respect to all weights."""
    return float(
        torch.stack([weights.grad.norm() for weights in network.parameters() if weights.grad is not None]).norm()
    )
