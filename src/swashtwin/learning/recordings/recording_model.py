"""What whole recordings say of their class: trees on levels, and on changes from the machine's own
healthy ones.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from jaxtyping import Float, Float64, Int

from swashtwin.foundation import derive_seed
from swashtwin.learning.networks.tree_network import Forest, forest_of
from swashtwin.learning.recordings.recording_features import RecordingBandLayout, RecordingTable
from swashtwin.learning.windows.window_set import WindowSet

_TREES = 150
_SOFT = 1e-3
"""Least probability by trees, whose leaves are certain."""


@dataclass(frozen=True, eq=False)
class Head:
    """Trees, and in models of earlier versions a discriminant on the same rows, which went too far
    on machines unlike those of the training.
    """

    mean: Float64[np.ndarray, " level"]
    deviation: Float64[np.ndarray, " level"]
    weight: Float64[np.ndarray, "linear_class level"]
    bias: Float64[np.ndarray, " linear_class"]
    trees: Mapping[str, np.ndarray]
    """`Forest.tensors`."""

    def __post_init__(self) -> None:
        count, band_powers = self.weight.shape
        if (
            self.mean.shape != (band_powers,)
            or self.deviation.shape != (band_powers,)
            or self.bias.shape != (count,)
        ):
            raise ValueError("a head on whole recordings does not fit itself")
        if count not in (0, self.n_classes) or self._forest.column.max(initial=-1) >= band_powers:
            raise ValueError("the trees on whole recordings do not fit the classes and levels")

    @property
    def n_classes(self) -> int:
        """Classes told apart."""
        return int(self._forest.probability.shape[1])

    @cached_property
    def _forest(self) -> Forest:
        return Forest.of_tensors(dict(self.trees))

    def log_probabilities(
        self, values: Float[np.ndarray, "recording level"]
    ) -> tuple[
        Float64[np.ndarray, "recording class"] | None, Float64[np.ndarray, "recording class"]
    ]:
        """(logarithms of the discriminant's probabilities or None, of those of the trees)."""
        of_trees = np.log(np.maximum(self._forest.predict_proba(values.astype(np.float32)), _SOFT))
        if not len(self.weight):
            return None, of_trees
        scores = ((values - self.mean) / self.deviation) @ self.weight.T + self.bias
        return scipy.special.log_softmax(scores, axis=1), of_trees


@dataclass(frozen=True, eq=False)
class Heads:
    """A head for recordings as they are, one for noisy ones, and trees that tell which a recording
    is.

    Trained on both at once, changes from a machine's own healthy recordings lost 6 points on clean
    recordings of new pumps (rig fleets 100 and 101 of version 2), trained on clean ones alone 40
    points under noise at 5 dB.
    """

    clean: Head
    noisy: Head
    """Trained on recordings as they are and with noise."""
    gate: Head
    """Of the classes clean and noisy; its trees decide."""

    def log_probabilities(
        self, values: Float[np.ndarray, "recording level"]
    ) -> list[Float64[np.ndarray, "recording class"] | None]:
        """[logarithms of the discriminants' probabilities or None, of those of the trees]."""
        noise = self.gate.log_probabilities(values)[1]
        pairs = zip(
            self.clean.log_probabilities(values), self.noisy.log_probabilities(values), strict=True
        )
        return [
            None
            if clean is None or noisy is None
            else np.logaddexp(noise[:, :1] + clean, noise[:, 1:] + noisy)
            for clean, noisy in pairs
        ]


def fit_heads(
    values: Float[np.ndarray, "copy recording level"],
    target: Int[np.ndarray, " recording"],
    n_classes: int,
    seed: int,
) -> Heads:
    """Heads found from the levels of recordings as they are, and of copies with noise."""
    n_copies, n_recordings = values.shape[:2]
    rows = values.reshape(n_copies * n_recordings, -1)
    is_copy = np.repeat(np.minimum(np.arange(n_copies), 1), n_recordings)
    return Heads(
        clean=_fit_head(values[0], target, n_classes, derive_seed(seed, "clean")),
        noisy=_fit_head(rows, np.tile(target, n_copies), n_classes, derive_seed(seed, "noisy")),
        gate=_fit_head(rows, is_copy, 2, derive_seed(seed, "gate")),
    )


def _fit_head(
    values: Float[np.ndarray, "row level"],
    target: Int[np.ndarray, " row"],
    n_classes: int,
    seed: int,
) -> Head:
    from sklearn import config_context
    from sklearn.tree import ExtraTreeClassifier
    from sklearn.utils.class_weight import compute_sample_weight

    rows, share = values.astype(np.float32), compute_sample_weight("balanced", target)
    states = np.random.RandomState(seed % 2**32).randint(2**31 - 1, size=_TREES).tolist()
    with config_context(
        skip_parameter_validation=True
    ):  # as `ExtraTreesClassifier` in three quarters of its time
        grown = [
            ExtraTreeClassifier(random_state=each).fit(rows, target, share, check_input=False)
            for each in states
        ]
    trees = forest_of(grown, grown[0].classes_, n_classes).tensors(np.float32)
    n_band_powers = rows.shape[1]
    return Head(
        np.zeros(n_band_powers),
        np.ones(n_band_powers),
        np.zeros((0, n_band_powers)),
        np.zeros(0),
        trees,
    )


HEAD_NAMES = (
    "band powers, discriminant",
    "band powers, trees",
    "changes, discriminant",
    "changes, trees",
)
"""What says the class of a whole recording, in the order of the temperatures."""


@dataclass(frozen=True, eq=False)
class RecordingModel:
    """Heads on whole recordings, each with the temperature that its answers to left-out machines
    ask for.

    The probability of a recording is the mean over the heads, each tempered: a head that was too
    sure of machines that it had not heard is flat and counts little. Heads on changes answer where
    the machine has healthy recordings.
    """

    layout: RecordingBandLayout
    usual_shaft: float
    """Shaft frequency [Hz] taken where a recording states none; 0 where levels know no orders."""
    on_band_powers: Heads
    on_changes: Heads | None
    """None where not every machine of the training had two healthy recordings."""
    healthy: RecordingTable
    """Healthy recordings of machines of the training, and of those met since."""
    temperatures: Float64[np.ndarray, " head"]
    """Of the answers of short windows, then of `HEAD_NAMES`."""

    def __post_init__(self) -> None:
        if self.temperatures.shape != (1 + len(HEAD_NAMES),) or not (self.temperatures > 0).all():
            raise ValueError("whole recordings need a positive temperature for each head")

    def require_sizes(self, n_channels: int, n_classes: int) -> None:
        """Raise a `ValueError` where heads or healthy recordings are of other channels, levels or
        classes.
        """
        shape = (n_channels, self.layout.n_band_powers)
        for heads in filter(None, (self.on_band_powers, self.on_changes)):
            counts = ((heads.clean, n_classes), (heads.noisy, n_classes), (heads.gate, 2))
            if any(
                (head.n_classes, len(head.mean)) != (count, math.prod(shape))
                for head, count in counts
            ):
                raise ValueError("heads on whole recordings do not fit the channels and classes")
        if self.healthy.band_powers.shape[1:] != shape:
            raise ValueError("healthy recordings do not fit the channels and levels")

    def knows(self, specimen: str) -> bool:
        """Whether a machine has healthy recordings enough to compare with."""
        return self.on_changes is not None and specimen in self.healthy.machines()

    def with_healthy(self, healthy: RecordingTable) -> "RecordingModel":
        """The model that knows further healthy recordings."""
        return replace(self, healthy=self.healthy.joined(healthy))

    def table(self, windows: WindowSet) -> RecordingTable:
        """Levels of the recordings that windows are of."""
        if self.layout.n_orders:
            speed = np.where(np.isnan(windows.speed), 2 * np.pi * self.usual_shaft, windows.speed)
            windows = replace(windows, speed=speed)
        return RecordingTable.measured(self.layout, windows)

    def combined(
        self, log_probability: Float[np.ndarray, "window class"], windows: WindowSet
    ) -> Float64[np.ndarray, "window class"]:
        """Probabilities of windows from the logarithms of their own and from what their whole
        recordings say.
        """
        answers = self.answers(self.table(windows))
        of_window = np.unique(windows.recording_id, return_inverse=True)[1]
        return joint([log_probability, *(None if part is None else part[of_window] for part in answers)],
                     self.temperatures)  # fmt: skip

    def answers(self, table: RecordingTable) -> list[Float64[np.ndarray, "recording class"] | None]:
        """Logarithms of probabilities by each head; NaN rows where a machine has no healthy
        recordings of its own.
        """
        band_powers = self.layout.shapes(table.band_powers)
        answers: list[np.ndarray | None] = [
            *self.on_band_powers.log_probabilities(band_powers.reshape(len(band_powers), -1))
        ]
        if self.on_changes is None:
            return [*answers, None, None]
        named = tuple(name if self.knows(name) else "" for name in table.specimen)
        flat = self.healthy.changes(self.layout, replace(table, specimen=named)).reshape(
            len(band_powers), -1
        )
        known = np.isfinite(flat).all(axis=1)
        on_changes = self.on_changes.log_probabilities(np.where(known[:, None], flat, 0))
        return [
            *answers,
            *(
                None if part is None else np.where(known[:, None], part, np.nan)
                for part in on_changes
            ),
        ]


def joint(
    logarithms: Sequence[Float[np.ndarray, "row class"] | None],
    temperatures: Float[np.ndarray, " head"],
) -> Float64[np.ndarray, "row class"]:
    """Mean over heads of their tempered probabilities; one that is None or left out, or whose row
    is NaN, has no say.

    Changes, where they are known, have half of the weight of all: on rig fleets 100 to 102 of both
    versions trees on changes were right in 0.93 of recordings of new pumps, and levels in 0.85.
    """
    rows, classes = next(part.shape for part in logarithms if part is not None)
    total, weight = np.zeros((rows, classes)), np.zeros((rows, 1))
    for index, (part, temperature) in enumerate(zip(logarithms, temperatures, strict=False)):
        if part is None:
            continue
        share = scipy.special.softmax(part / temperature, axis=1)
        has_say = np.isfinite(share).all(axis=1, keepdims=True) | (index == 0)
        counts = np.where(has_say, _WEIGHTS[index], 0.0)
        total = total + np.where(has_say, share, 0.0) * counts
        weight = weight + counts
    return np.asarray(total / weight)


_WEIGHTS = (1.0, 1.0, 1.0, 1.0, 2.0)
"""Weights of the heads: trees on changes count twice."""
