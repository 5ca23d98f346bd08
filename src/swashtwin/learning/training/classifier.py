"""A trained network together with everything needed to use it honestly."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Float32, Float64, Shaped

from swashtwin.foundation import DataError, InputError
from swashtwin.learning.choice.candidates import Choice
from swashtwin.learning.features import reference_features
from swashtwin.learning.networks.registry import AnyNetwork
from swashtwin.learning.recordings.recording_model import RecordingModel
from swashtwin.learning.training.confidence import Confidence
from swashtwin.learning.training.settings import NORMALIZATIONS, Epoch, TrainingSettings
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.cutting import cut_windows
from swashtwin.learning.windows.window_set import WindowLayout, WindowSet
from swashtwin.recordings import Manifest, Recording

TOGETHER = 32
"""Windows that pass a network together where nothing is learned: they stay in the processor's
cache.
"""


@dataclass(frozen=True, eq=False)
class Normalization:
    """Subtracts a mean from each channel and divides by a deviation, taken over what `kind` says.

    ``"window"``: over each window by itself. ``"set"``: over the training windows, kept here.
    ``"none"``: not at all. A channel that does not move is not divided.
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
                f"normalization {self.kind[:60]!r} is none of {', '.join(NORMALIZATIONS)}."
            )
        if not (self.deviation > 0).all():
            raise InputError("the deviation of a normalization must be positive.")

    @classmethod
    def fit(cls, kind: str, windows: WindowSet) -> "Normalization":
        """Normalization with the statistics of the training windows."""
        if kind == "set":
            signal = windows.signal
            mean = signal.mean(axis=(0, 2), dtype=np.float64)
            return cls(kind, mean, _not_zero(signal.std(axis=(0, 2), dtype=np.float64)))
        return cls(kind, np.zeros(windows.n_channels), np.ones(windows.n_channels))

    def apply(self, windows: WindowSet) -> Float32[np.ndarray, "window channel time"]:
        """The samples of `windows`, scaled."""
        return np.concatenate([samples for samples, _ in self.blocks(windows)])

    def blocks(self, windows: WindowSet) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """(samples, scaled; turns of the shaft per sample) of `TOGETHER` windows at a time."""
        turns = windows.turns_per_sample
        for at in range(0, len(windows), TOGETHER):
            part, mean, deviation = windows.signal[at : at + TOGETHER], self.mean, self.deviation
            if self.kind == "window":
                mean, deviation = (
                    part.mean(axis=2, dtype=np.float64),
                    part.std(axis=2, dtype=np.float64),
                )
            scaled = part - mean[..., None]
            scaled /= _not_zero(deviation)[..., None]
            yield scaled.astype(np.float32), turns[at : at + TOGETHER]


def _not_zero(deviation: Float64[np.ndarray, "*axes"]) -> Float64[np.ndarray, "*axes"]:
    return np.where(deviation > 0, deviation, 1.0)


@dataclass(frozen=True, eq=False)
class FittedClassifier:
    """What `fit` gives: windows in, class probabilities out."""

    network: AnyNetwork
    """Trained weights; of torch in evaluation mode."""
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
    """Every recording that had a part in it (training, validation, calibration), by id with the
    hashes of its content; none may be tested on.
    """
    pressures: tuple[float, ...]
    """Discharge pressures it was trained at [Pa], ascending; empty where they were not known."""
    speeds: tuple[float, ...]
    """Shaft speeds it was trained at [rad/s], ascending; empty where they were not known."""
    training_reference: TrainingReference | None = None
    """The measured recordings it was trained on, by the levels of their vibration; None where there
    was none.
    """
    choice: Choice | None = None
    """What was tried and chosen (`fit_best_candidate`); None where the network was named."""
    fault_of: Mapping[str, str] = field(default_factory=dict)
    """Fault of the model (`swashtwin.pump`) that a class of another name stands for."""
    confidence: Confidence | None = None
    """Calibrated confidence (`learn_confidence`, `cross_fitted_confidence`); None where it was not
    calibrated.
    """
    recordings: RecordingModel | None = None
    """Heads on whole recordings (`fit_best_candidate`); None where the network was named, or recordings
    were too short.
    """
    baseline_confidence: Confidence | None = None
    """Confidence of answers to machines whose healthy recordings the model knows; None where
    `confidence` is theirs.
    """

    @property
    def sample_rate(self) -> float:
        """Samples per second and channel [Hz]."""
        return self.layout.sample_rate

    @property
    def channels(self) -> tuple[str, ...]:
        """Name of each channel, in order."""
        return self.layout.channels

    @property
    def length(self) -> int:
        """Samples per window and channel."""
        return self.layout.length

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """Probability of each class for each window; rows sum to 1.

        NaN where the square of a scaled sample, a feature or a score of the window is no finite
        number: it has no verdict.

        Raises
        ------
        InputError
            The windows differ from those of the training in rate, channels, unit or length.
        """
        probability = self._through(windows, self._probabilities)
        if self.recordings is None:
            return probability
        with np.errstate(over="ignore", invalid="ignore"):
            return self.recordings.combined(np.log(np.maximum(probability, 1e-12)), windows)

    def cut_windows(self, recordings: Iterable[Recording]) -> WindowSet:
        """Windows of recordings as the classifier takes them."""
        return cut_windows(
            recordings, length=self.length, classes=self.classes, allow_partial_revolution=True
        )

    def confidence_of(self, specimen: str) -> Confidence | None:
        """The confidence of answers to a machine."""
        is_known = self.recordings is not None and self.recordings.knows(specimen)
        return (
            self.baseline_confidence
            if is_known and self.baseline_confidence is not None
            else self.confidence
        )

    def with_healthy(self, windows: WindowSet) -> "FittedClassifier":
        """The classifier that knows further healthy recordings, by their windows, and compares with
        them.
        """
        assert self.recordings is not None
        return replace(
            self, recordings=self.recordings.with_healthy(self.recordings.table(windows))
        )

    def _probabilities(self, samples: np.ndarray, turns: np.ndarray) -> np.ndarray:
        probability = self.network.probabilities(samples, turns)
        with np.errstate(over="ignore"):
            peak = np.maximum(samples.max(axis=(1, 2)), -samples.min(axis=(1, 2)))
            probability[~np.isfinite(np.square(peak))] = np.nan
        return probability

    def predict(self, windows: WindowSet) -> Shaped[np.ndarray, " window"]:
        """Name of the likeliest class of each window; a `DataError` where a window has no
        verdict.
        """
        probability = self.predict_proba(windows)
        require_verdicts(probability, windows.recording_id)
        return np.array(self.classes, dtype=np.str_)[probability.argmax(axis=1)]

    def embed(self, windows: WindowSet) -> Float[np.ndarray, "window feature"]:
        """What the last layer sees of each window, such as t-SNE is drawn from."""
        return self._through(windows, self.network.embedding)

    def answer(
        self, windows: WindowSet
    ) -> tuple[Float[np.ndarray, "window class"], Float[np.ndarray, "window feature"]]:
        """(`predict_proba`, `reference_features`) of each window: what a verdict and what its trust
        rest on.

        The levels are of the samples as they are: they tell a new class better than those that a
        `BandPowerNetwork` decides by, and far better than the last layer, where a class that it never
        saw fell among the known ones (docs/explanation/diagnosis.md).
        """
        return self.predict_proba(windows), reference_features(windows)

    def _through(
        self, windows: WindowSet, step: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> Float[np.ndarray, "window value"]:
        if difference := self.layout.difference(windows.layout):
            raise InputError(f"the classifier was trained on other windows: {difference}.")
        windows.require_any("to answer for")
        return np.concatenate([step(*block) for block in self.normalization.blocks(windows)])


def require_verdicts(
    probability: Float[np.ndarray, "answer class"], names: Shaped[np.ndarray, " answer"]
) -> None:
    """Raise a `DataError` that names the first answer with a probability that is no finite number,
    if there is one.
    """
    finite = np.isfinite(probability).all(axis=1)
    if not finite.all():
        raise DataError(
            f"{names[~finite][0]}: no verdict on {np.count_nonzero(~finite)} of {len(finite)}, since the classifier's "
            "numbers are not finite; is a sample far too large, or a weight of the model damaged?"
        )
