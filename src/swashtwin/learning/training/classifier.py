"""A trained network, with everything that its use and its test need."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Shaped

from swashtwin.foundation import DataError, InputError, short_repr
from swashtwin.learning.features import reference_features
from swashtwin.learning.networks.registry import AnyNetwork
from swashtwin.learning.recordings.recording_model import RecordingModel
from swashtwin.learning.training.candidate_choice import CandidateChoice
from swashtwin.learning.training.confidence import Confidence
from swashtwin.learning.training.training_reference import N_STATISTICS, TrainingReference
from swashtwin.learning.training.training_settings import NORMALIZATIONS, Epoch, TrainingSettings
from swashtwin.learning.windows.cutting import cut_windows
from swashtwin.learning.windows.window_set import WindowLayout, WindowSet
from swashtwin.recordings import Manifest, Recording

WINDOWS_PER_BLOCK = 32
"""Windows that pass a network together in prediction: this many fit into the processor's cache."""


@dataclass(frozen=True, eq=False)
class Normalization:
    """Subtracts a mean from each channel and divides by a deviation.

    They are those of each window (``"window"``) or of the training windows (``"set"``, stored
    here); ``"none"`` changes nothing. A constant channel is not divided.
    """

    kind: str
    """``"window"``, ``"set"`` or ``"none"``."""
    mean: Float64[np.ndarray, " channel"]
    """Subtracted from each channel if `kind` is ``"set"``, in the windows' unit; else zeros."""
    deviation: Float64[np.ndarray, " channel"]
    """Each channel is divided by it if `kind` is ``"set"``, in the windows' unit; else ones."""

    def __post_init__(self) -> None:
        if self.kind not in NORMALIZATIONS:
            raise InputError(
                f"Invalid normalization {self.kind[:60]!r}: it must be one of "
                f"{', '.join(NORMALIZATIONS)}."
            )
        if not (self.deviation > 0).all():
            raise InputError("The deviation of a normalization must be positive.")

    @classmethod
    def fit(cls, kind: str, windows: WindowSet) -> "Normalization":
        """Return a normalization with the statistics of the training windows."""
        if kind != "set":
            return cls(kind, np.zeros(windows.n_channels), np.ones(windows.n_channels))
        mean = windows.signal.mean(axis=(0, 2), dtype=np.float64)
        deviation = windows.signal.std(axis=(0, 2), dtype=np.float64)
        return cls(kind, mean, _nonzero(deviation))

    def apply(self, windows: WindowSet) -> Float32[np.ndarray, "window channel time"]:
        """Return the samples of `windows`, scaled."""
        return np.concatenate([samples for samples, _ in self.blocks(windows)])

    def blocks(self, windows: WindowSet) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield scaled samples and the shaft's turns per sample, `WINDOWS_PER_BLOCK` at a time."""
        turns = windows.turns_per_sample
        for start in range(0, len(windows), WINDOWS_PER_BLOCK):
            block = slice(start, start + WINDOWS_PER_BLOCK)
            samples = windows.signal[block]
            if self.kind == "window":
                mean = samples.mean(axis=2, dtype=np.float64)
                deviation = samples.std(axis=2, dtype=np.float64)
            else:
                mean = self.mean
                deviation = self.deviation
            scaled = samples - mean[..., None]
            scaled /= _nonzero(deviation)[..., None]
            yield scaled.astype(np.float32), turns[block]


def _nonzero(deviation: Float64[np.ndarray, "*axes"]) -> Float64[np.ndarray, "*axes"]:
    return np.where(deviation > 0, deviation, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainedState:
    """A trained classifier with its network in any form, in memory or in a file.

    Raises
    ------
    ValueError
        Two fields contradict each other, as in a damaged file.
    """

    network: Any
    """Network; its ``settings`` hold ``n_channels`` and ``n_classes``."""
    classes: tuple[str, ...]
    """Class names, in the order of the probabilities."""
    layout: WindowLayout
    """Sample rate, channels, unit and length that windows must have."""
    normalization: Normalization
    """Scaling before the network, fitted on the training windows."""
    settings: TrainingSettings
    seed: int
    history: tuple[Epoch, ...]
    manifest: Manifest
    """All recordings with a part in it (training, validation, calibration), by id with the hashes
    of their content; none may be tested on.
    """
    pressures: tuple[float, ...]
    """Discharge pressures it was trained at [Pa], ascending; empty if unknown."""
    speeds: tuple[float, ...]
    """Shaft speeds it was trained at [rad/s], ascending; empty if unknown."""
    training_reference: TrainingReference | None
    """Features of the measured recordings it was trained on; None if there were none."""
    choice: CandidateChoice | None
    """Choice among candidates (`fit_best_candidate`); None if the network was specified."""
    fault_of: Mapping[str, str]
    """Fault of the model (`swashtwin.pump`) for which a class of another name stands."""
    confidence: Confidence | None
    """Confidence (`learn_confidence`, `cross_fitted_confidence`); None if not calibrated."""
    recordings: RecordingModel | None
    """Heads on whole recordings (`fit_best_candidate`); None if the network was specified, or
    recordings were too short.
    """
    baseline_confidence: Confidence | None
    """Confidence of answers to machines whose healthy recordings the model knows; None if
    `confidence` is valid for them too.
    """

    def __post_init__(self) -> None:
        n_channels = len(self.layout.channels)
        n_classes = len(self.classes)

        if not n_classes or len(set(self.classes)) < n_classes:
            raise ValueError("it has no classes, or a class twice")
        if self.layout.length < 2 or not self.layout.sample_rate > 0 or not n_channels:
            raise ValueError(
                "its windows are shorter than 2 samples, or have no positive sample rate, or no "
                "channel"
            )

        network_sizes = [self.network.settings.get(key) for key in ("n_channels", "n_classes")]
        # True equals 1, so a Boolean would pass the comparison.
        has_bool = any(isinstance(size, bool) for size in network_sizes)
        if network_sizes != [n_channels, n_classes] or has_bool:
            raise ValueError(
                f"its network is not for {n_channels} channel(s) and {n_classes} classes"
            )

        shapes = {self.normalization.mean.shape, self.normalization.deviation.shape}
        if shapes != {(n_channels,)}:
            raise ValueError(
                f"its normalization does not have one value for each of {n_channels} channel(s)"
            )

        reference = self.training_reference
        if reference is not None and reference.statistics.shape[1:] != (n_channels, N_STATISTICS):
            raise ValueError("its training reference has other channels or statistics")

        for confidence in (self.confidence, self.baseline_confidence):
            if confidence is not None:
                target = confidence.target
                if not ((target >= 0) & (target < n_classes)).all():
                    raise ValueError("confidence.target holds indices that are not of a class")

        if self.recordings is not None:
            self.recordings.require_sizes(n_channels, n_classes)


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedClassifier(TrainedState):
    """A trained classifier of windows, as `fit` returns it."""

    network: AnyNetwork
    """Trained network; one of torch is in evaluation mode."""

    __repr__ = short_repr

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """Return the probability of each class for each window; rows sum to 1.

        They are NaN if the square of a scaled sample, a feature or a score of the window is not
        finite; then there is no verdict.

        Raises
        ------
        InputError
            The windows differ from those of the training in rate, channels, unit or length.
        """
        probability = self._map_blocks(windows, self._probabilities)
        if self.recordings is None:
            return probability
        with np.errstate(over="ignore", invalid="ignore"):
            log_probability = np.log(np.maximum(probability, 1e-12))
            return self.recordings.combined(log_probability, windows)

    def cut_windows(self, recordings: Iterable[Recording]) -> WindowSet:
        """Return windows of recordings as the classifier requires them."""
        return cut_windows(
            recordings,
            length=self.layout.length,
            classes=self.classes,
            allow_partial_revolution=True,
        )

    def confidence_of(self, specimen: str) -> Confidence | None:
        """Return the confidence of answers to a machine."""
        if self.baseline_confidence is None or self.recordings is None:
            return self.confidence
        if self.recordings.knows(specimen):
            return self.baseline_confidence
        return self.confidence

    def _probabilities(self, samples: np.ndarray, turns: np.ndarray) -> np.ndarray:
        probability = self.network.probabilities(samples, turns)
        with np.errstate(over="ignore"):
            peak = np.maximum(samples.max(axis=(1, 2)), -samples.min(axis=(1, 2)))
            probability[~np.isfinite(np.square(peak))] = np.nan
        return probability

    def predict(self, windows: WindowSet) -> Shaped[np.ndarray, " window"]:
        """Return the name of the likeliest class of each window.

        Raises
        ------
        DataError
            A window has no verdict.
        """
        probability = self.predict_proba(windows)
        require_verdicts(probability, windows.recording_id)
        return np.array(self.classes, dtype=np.str_)[probability.argmax(axis=1)]

    def embed(self, windows: WindowSet) -> Float[np.ndarray, "window feature"]:
        """Return the input of the last layer for each window, as t-SNE shows it."""
        return self._map_blocks(windows, self.network.embedding)

    def answer(
        self, windows: WindowSet
    ) -> tuple[Float[np.ndarray, "window class"], Float[np.ndarray, "window feature"]]:
        """Return `predict_proba` and `reference_features` of each window.

        The verdict rests on the former, its out-of-distribution score on the latter. These features
        are of the unscaled samples. They separate a new class better than the features of a
        `BandPowerNetwork`, and far better than a last layer, in which a class that was not trained
        fell among the trained ones (docs/explanation/diagnosis.md).
        """
        return self.predict_proba(windows), reference_features(windows)

    def _map_blocks(
        self, windows: WindowSet, function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> Float[np.ndarray, "window value"]:
        """Return a function of the scaled windows, computed block by block."""
        difference = self.layout.difference(windows.layout)
        if difference:
            raise InputError(f"The classifier was trained on other windows: {difference}.")
        windows.require_any("to answer for")
        blocks = self.normalization.blocks(windows)
        return np.concatenate([function(samples, turns) for samples, turns in blocks])


def require_verdicts(
    probability: Float[np.ndarray, "answer class"], names: Shaped[np.ndarray, " answer"]
) -> None:
    """Raise a `DataError` that names the first answer with a probability that is not finite."""
    is_finite = np.isfinite(probability).all(axis=1)
    if not is_finite.all():
        n_missing = np.count_nonzero(~is_finite)
        raise DataError(
            f"{names[~is_finite][0]}: no verdict on {n_missing} of {len(is_finite)}, because the "
            "classifier's numbers are not finite. Is a sample far too large, or a weight of the "
            "model damaged?"
        )
