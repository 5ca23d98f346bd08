"""The training recordings by levels and plain facts of their vibration: what a new recording is compared with."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import InputError
from swashtwin.learning.training.class_space import ClassSpace, fit_class_space
from swashtwin.learning.training.signal_facts import signal_facts
from swashtwin.learning.windows.window_set import WindowSet

MOST_RECORDINGS = 500
"""Most recordings in a reference; of more, this many are taken, evenly spaced in the order of their ids."""

_FURTHEST = 0.1
"""Share of the training recordings, left out, whose distance is above 1."""
_N_FOLDS = 10
_MOST_WINDOWS = 20
"""Windows of a recording that its facts are taken from, evenly spaced."""


@dataclass(frozen=True, eq=False)
class TrainingReference:
    """Mean features and facts of each measured recording of the training; it holds no samples."""

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    label: tuple[str, ...]
    """Class of each."""
    specimen: tuple[str, ...]
    """Machine of each; empty where not stated."""
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each; NaN where not stated."""
    features: Float32[np.ndarray, "reference feature"]
    """Mean of each feature (`FittedClassifier.answer`) over the windows of the recording."""
    facts: Float64[np.ndarray, "reference channel fact"]
    """Mean of `signal_facts` over some windows."""
    distance_scales: tuple[float, float] = (1.0, 1.0)
    """Distances from the rest that nine in ten of the training recordings do not exceed where they are left out: alone,
    and together with all of their machine."""

    def __post_init__(self) -> None:
        count = len(self.recording_id)
        arrays = (self.features, self.facts, self.condition)
        if not count or any(len(part) != count for part in (self.label, self.specimen, *arrays)):
            raise InputError("a training reference needs a recording, and of each a label, a machine and a row.")
        if self.condition.shape != (count, 2) or not all(0 < scale < math.inf for scale in self.distance_scales):
            raise InputError("a training reference needs a speed and a pressure of each, and two positive scales.")

    def distances(self, features: Float[np.ndarray, " feature"]) -> Float64[np.ndarray, " reference"]:
        """Distance of each training recording from one with these mean features, 0 where they are the same.

        Root mean square over the features, each in units of its standard deviation between the training recordings; a
        feature that does not differ between them counts in its own unit.
        """
        deviation = self.features.std(axis=0)
        offset = (self.features - features.astype(np.float32)) / np.where(deviation > 0, deviation, 1.0)
        return np.asarray(np.sqrt(np.mean(offset**2, axis=1)), dtype=np.float64)

    def ood_score(
        self,
        features: Float[np.ndarray, " feature"],
        *,
        specimen: str = "",
        condition: Float[np.ndarray, " quantity"] | None = None,
    ) -> float:
        """Out-of-distribution score of these mean features: about 1 where one in ten of those like the training is.

        A likelihood ratio between the nearest trained class and a new one (`ClassSpace`; in the manner of Ren and
        others 2021, arXiv:2106.09022), over what nine in ten of the training recordings have that are left out: alone
        where the machine is one of the training's, else together with all of their machine. It may be negative.

        Parameters
        ----------
        features : means over the windows.
        specimen : machine; empty where not stated.
        condition : speed [rad/s] and discharge pressure [Pa]; NaN where not stated.
        """
        at = np.full(2, np.nan) if condition is None else condition
        is_trained = bool(specimen) and specimen in self.specimen
        return self._space.score(features, at) / self.distance_scales[0 if is_trained else 1]

    def cross_fitted_scores(self) -> Float64[np.ndarray, " reference"]:
        """`ood_score` of each training recording by references without it; NaN where they have none of its class."""
        return self.left_out_distances(_folds(len(self.label))) / self.distance_scales[0]

    @cached_property
    def _space(self) -> ClassSpace:
        return self._space_of(np.ones(len(self.label), dtype=bool))

    def _space_of(self, used: np.ndarray) -> ClassSpace:
        label, specimen = np.array(self.label), np.array(self.specimen)
        return fit_class_space(self.features[used], label[used], specimen[used], self.condition[used])

    def left_out_distances(self, group: np.ndarray) -> Float64[np.ndarray, " reference"]:
        """Distance of each recording by a space without its group; NaN where the space has not its class."""
        label, distance = np.array(self.label), np.full(len(self.label), np.nan)
        for number in np.unique(group):
            used = group != number
            scored = np.flatnonzero(~used & np.isin(label, label[used]))
            if scored.size:
                space = self._space_of(used)
                distance[scored] = [space.score(self.features[index], self.condition[index]) for index in scored]
        return distance


def build_reference(windows: WindowSet, features: Float[np.ndarray, "window feature"]) -> TrainingReference | None:
    """Reference of the measured recordings among training windows, or None where all are synthetic or not finite.

    Parameters
    ----------
    features : of each window, numbers of the same kind, such as logarithms of powers.
    """
    names = np.unique(windows.recording_id[~windows.synthetic])
    if not names.size:
        return None
    names = names[np.unique(np.linspace(0, names.size - 1, min(MOST_RECORDINGS, names.size)).round().astype(np.int64))]
    masks = [(windows.recording_id == name) & ~windows.synthetic for name in names]
    parts = [windows.subset(_spaced(np.flatnonzero(mask))) for mask in masks]
    means = np.stack([features[mask].mean(axis=0) for mask in masks]).astype(np.float32)
    facts = np.stack([signal_facts(part).mean(axis=0) for part in parts])
    usable = np.isfinite(means).all(axis=1) & np.isfinite(facts).all(axis=(1, 2))
    if not usable.any():
        return None
    names, means, facts = names[usable], means[usable], facts[usable]
    parts = [part for part, is_usable in zip(parts, usable, strict=True) if is_usable]
    reference = TrainingReference(
        recording_id=tuple(names.tolist()),
        label=tuple(str(part.label[0]) for part in parts),
        specimen=tuple(str(part.specimen[0]) for part in parts),
        condition=np.stack([part.condition(0) for part in parts]),
        features=means,
        facts=facts,
    )
    return scaled_reference(reference)


def _spaced(rows: Int[np.ndarray, " window"]) -> Int[np.ndarray, " chosen"]:
    """As many of them as facts are taken from, evenly spaced."""
    return rows[np.unique(np.linspace(0, rows.size - 1, min(_MOST_WINDOWS, rows.size)).round().astype(np.int64))]


def scaled_reference(reference: TrainingReference) -> TrainingReference:
    """The same reference with its `distance_scales`.

    Each machine that is left out has its own, and their median is taken: one machine that is unlike the few others of
    the training would else set the scale for all to come. Where no scale can be told, the other one is taken, or 1.
    """
    alone = [reference.left_out_distances(_folds(len(reference.label)))]
    machines, group = np.unique(reference.specimen, return_inverse=True)
    together = alone
    if len(machines) > 1:
        distance = reference.left_out_distances(group)
        together = [distance[group == number] for number in range(len(machines))]
    scales = [scale for parts in (alone, together) if (scale := _median_of_furthest(parts)) > 0] or [1.0]
    return replace(reference, distance_scales=(scales[0], scales[-1]))


def _median_of_furthest(parts: list[np.ndarray]) -> float:
    """Median over the parts of the distance that nine in ten do not exceed; 0 where none is scored."""
    scored = [part[~np.isnan(part)] for part in parts]
    furthest = [float(np.quantile(part, 1 - _FURTHEST)) for part in scored if part.size]
    return float(np.median(furthest)) if furthest else 0.0


def _folds(count: int) -> Int[np.ndarray, " reference"]:
    """Fold of each recording, in turn."""
    return np.arange(count) % _N_FOLDS
