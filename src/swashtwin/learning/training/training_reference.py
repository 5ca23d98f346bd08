"""The training recordings by levels and plain facts of their vibration: what a new recording is
compared with.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import InputError
from swashtwin.learning.features import window_powers
from swashtwin.learning.training.class_space import ClassSpace, fit_class_space
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import log_band_powers

FACTS = ("level", "noise_floor", "line_share", "offset", "likeness")
"""Variance, level of the quietest tenth of the spectrum, and share of the power in the strongest
fiftieth; the square of the mean over the variance, and the share that another channel explains, as
-log(1 - r^2); in dB.
"""
N_BANDS = 16
"""Logarithmic bands by which swapped channels are told, in dB; they follow the `FACTS`."""
N_FACTS = len(FACTS) + N_BANDS
"""Columns of `signal_facts`."""
ERROR_RATE = 0.05
"""Share of the recordings like the training's of which a fact may be called outside."""

_QUIETEST, _STRONGEST = 0.1, 0.02
_LEAST_SPREAD, _LEAST_BAND_SPREAD = 1.0, 3.0
"""Least spread that a difference is judged by [dB]."""
_LEAST_EXCESS = 0.5
"""Difference below which a fact is not told: it would be rounded to 0 dB."""
_LEAST_POWER = 1e-30
_LEAST_OFFSET, _ALONE = 1e-2, (1e-4, 0.1)
"""Offset below which it counts as such, and the range of the share that no other channel explains:
up to a correlation of 0.95 channels are their own.
"""
_LEAST_RECORDINGS = 5
"""Training recordings from which a range can be told."""
_FAR = 10.0
"""Distance [dB] from fewer than these that is told."""


@dataclass(frozen=True)
class OutsideFact:
    """A fact of one channel outside the range of the training."""

    channel: int
    fact: str
    value: float
    """What the recording has [dB]."""
    low: float
    """Least of the training [dB]."""
    high: float
    """Greatest of the training [dB]."""
    deviation: float
    """How far outside, in standard deviations between the training recordings."""

    @property
    def excess(self) -> float:
        """How far above the range, or below where negative [dB]."""
        return self.value - self.high if self.value > self.high else self.value - self.low


def signal_facts(
    windows: WindowSet, powers: Sequence[Float64[np.ndarray, "window line"]] | None = None
) -> Float64[np.ndarray, "window channel fact"]:
    """`FACTS` and the levels of `N_BANDS` bands, of each channel of each window [dB re the unit
    squared].

    The noise floor is of the density (per Hz). Both spectra are with a Hann taper and the mean
    removed. `powers` are `window_powers`, where they are at hand.
    """
    samples = windows.signal.astype(np.float64)
    mean = samples.mean(axis=2)
    samples -= mean[:, :, None]
    products = samples @ samples.swapaxes(1, 2) / windows.length
    variance = np.maximum(np.diagonal(products, axis1=1, axis2=2), _LEAST_POWER)
    alike = (
        products**2 / (variance[:, :, None] * variance[:, None]) * (1 - np.eye(windows.n_channels))
    )
    share_alone = np.clip(1 - alike.max(axis=2), *_ALONE)
    facts = []
    for channel, power in enumerate(window_powers(windows) if powers is None else powers):
        n_lines = power.shape[1]
        quietest, first_strong = (
            int(_QUIETEST * n_lines),
            n_lines - max(1, round(_STRONGEST * n_lines)),
        )
        floor = np.partition(power, quietest, axis=1)[:, quietest] * (
            windows.length / windows.sample_rate
        )
        strongest = np.partition(power, first_strong, axis=1)[:, first_strong:].sum(
            axis=1
        )  # one by one in a third
        ratios = (
            variance[:, channel],
            floor,
            strongest / np.maximum(power.sum(axis=1), _LEAST_POWER),
            np.maximum(mean[:, channel] ** 2 / variance[:, channel], _LEAST_OFFSET),
            1 / share_alone[:, channel],
        )
        decibels = 10 * np.log10(np.maximum(np.stack(ratios, axis=1), _LEAST_POWER))
        facts.append(np.concatenate([decibels, 10 * log_band_powers(power, N_BANDS)], axis=1))
    return np.stack(facts, axis=1)


def outside_facts(
    training: Float64[np.ndarray, "recording channel fact"],
    machines: Sequence[str],
    facts: Float64[np.ndarray, "channel fact"],
) -> tuple[OutsideFact, ...]:
    """Facts of a recording outside the training's range by more than usual between its recordings,
    most unusual first.

    A recording's deviation is how far the furthest of its facts is outside the range of others, in
    standard deviations between the training recordings (1 dB at least). A fact is told where its
    deviation exceeds that of all but `ERROR_RATE` of the training recordings, each against the
    others; against those of other `machines` ("" where not stated), where there are several. So at
    most about this share of recordings that are like the training's get any such remark; with fewer
    than 19 training recordings, n of them, about one in n + 1. The same conformal rule as that of
    being unknown. Fewer than five give no such rate: what is 10 dB outside their range is told.
    """
    values, recorded = training[:, :, : len(FACTS)], facts[:, : len(FACTS)]
    spread = np.maximum(values.std(axis=0), _LEAST_SPREAD)
    limit, least = 0.0, _FAR
    if len(training) >= _LEAST_RECORDINGS:
        group = np.unique(machines, return_inverse=True)[1]
        if group.max() == 0:
            group = np.arange(len(values))
        below, above = (
            _extremes_without_own(values, group) - values,
            values + _extremes_without_own(-values, group),
        )
        deviation = np.sort((np.maximum(above, below) / spread).max(axis=(1, 2)))
        limit, least = (
            deviation[len(deviation) - max(1, int(ERROR_RATE * (len(deviation) + 1)))],
            _LEAST_EXCESS,
        )
    low, high = values.min(axis=0), values.max(axis=0)
    excess = np.maximum(recorded - high, low - recorded)
    beyond = excess / spread
    outside = [
        OutsideFact(
            int(c), FACTS[f], *(float(part[c, f]) for part in (recorded, low, high, beyond))
        )
        for c, f in np.argwhere((beyond > max(float(limit), 0.0)) & (excess >= least))
    ]
    return tuple(sorted(outside, key=lambda fact: -fact.deviation))


def _extremes_without_own(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Least value of each fact among the recordings of other groups, of each recording."""
    least = np.stack([values[group == number].min(axis=0) for number in range(group.max() + 1)])
    two = np.sort(least, axis=0)[:2]
    return np.where(least[group] == two[0], two[1], two[0])


def swapped_channels(
    training: Float64[np.ndarray, "recording channel fact"],
    facts: Float64[np.ndarray, "channel fact"],
) -> tuple[int, int] | None:
    """Two channels of a recording that resemble each other's in the training and not their own, or
    None.

    Channels are compared by the levels of their bands, in standard deviations between the training
    recordings (3 dB at least). Two are called swapped where exchanging them halves the root mean
    square of the differences of both, and neither of them was as far from its own in any training
    recording.
    """
    profiles, profile = training[:, :, len(FACTS) :], facts[:, len(FACTS) :]
    if len(training) < 2 or len(profile) < 2:
        return None
    mean, spread = profiles.mean(axis=0), np.maximum(profiles.std(axis=0), _LEAST_BAND_SPREAD)

    def distances(rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt(np.mean(((rows - mean) / spread) ** 2, axis=-1)))

    furthest = distances(profiles).max(axis=0)
    distance = distances(profile[:, None])
    straight = np.diag(distance)
    ratio = (distance + distance.T) / np.maximum(straight[:, None] + straight, 1e-12)
    ratio[np.diag_indices(len(ratio))] = np.inf
    ratio[straight <= furthest] = ratio[:, straight <= furthest] = np.inf
    first, second = np.unravel_index(ratio.argmin(), ratio.shape)
    return (int(first), int(second)) if ratio[first, second] < 0.5 else None


MOST_RECORDINGS = 500
"""Most recordings in a reference; of more, this many are taken, evenly spaced in the order of their
ids.
"""

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
    specimen: tuple[str, ...]
    """Machine of each; empty where not stated."""
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each; NaN where not stated."""
    features: Float32[np.ndarray, "reference feature"]
    """Mean of each feature (`FittedClassifier.answer`) over the windows of the recording."""
    facts: Float64[np.ndarray, "reference channel fact"]
    """Mean of `signal_facts` over some windows."""
    distance_scales: tuple[float, float] = (1.0, 1.0)
    """Distances from the rest that nine in ten of the training recordings do not exceed where they
    are left out: alone, and together with all of their machine.
    """

    def __post_init__(self) -> None:
        count = len(self.recording_id)
        arrays = (self.features, self.facts, self.condition)
        if not count or any(len(part) != count for part in (self.label, self.specimen, *arrays)):
            raise InputError(
                "a training reference needs a recording, and of each a label, a machine and a row."
            )
        if self.condition.shape != (count, 2) or not all(
            0 < scale < math.inf for scale in self.distance_scales
        ):
            raise InputError(
                "a training reference needs a speed and a pressure of each, and two positive scales."
            )

    def distances(
        self, features: Float[np.ndarray, " feature"]
    ) -> Float64[np.ndarray, " reference"]:
        """Distance of each training recording from one with these mean features, 0 where they are
        the same.

        Root mean square over the features, each in units of its standard deviation between the
        training recordings; a feature that does not differ between them counts in its own unit.
        """
        deviation = self.features.std(axis=0)
        offset = (self.features - features.astype(np.float32)) / np.where(
            deviation > 0, deviation, 1.0
        )
        return np.asarray(np.sqrt(np.mean(offset**2, axis=1)), dtype=np.float64)

    def ood_score(
        self,
        features: Float[np.ndarray, " feature"],
        *,
        specimen: str = "",
        condition: Float[np.ndarray, " quantity"] | None = None,
    ) -> float:
        """Out-of-distribution score of these mean features: about 1 where one in ten of those like
        the training is.

        A likelihood ratio between the nearest trained class and a new one (`ClassSpace`; in the
        manner of Ren and others 2021, arXiv:2106.09022), over what nine in ten of the training
        recordings have that are left out: alone where the machine is one of the training's, else
        together with all of their machine. It may be negative. The condition is speed [rad/s] and
        discharge pressure [Pa]; NaN where not stated.
        """
        at = np.full(2, np.nan) if condition is None else condition
        is_trained = bool(specimen) and specimen in self.specimen
        return self._space.score(features, at) / self.distance_scales[0 if is_trained else 1]

    def cross_fitted_scores(self) -> Float64[np.ndarray, " reference"]:
        """`ood_score` of each training recording by references without it; NaN where they have none
        of its class.
        """
        return self.left_out_distances(_folds(len(self.label))) / self.distance_scales[0]

    @cached_property
    def _space(self) -> ClassSpace:
        return self._space_of(np.ones(len(self.label), dtype=bool))

    def _space_of(self, used: np.ndarray) -> ClassSpace:
        label, specimen = np.array(self.label), np.array(self.specimen)
        return fit_class_space(
            self.features[used], label[used], specimen[used], self.condition[used]
        )

    def left_out_distances(self, group: np.ndarray) -> Float64[np.ndarray, " reference"]:
        """Distance of each recording by a space without its group; NaN where the space has not its
        class.
        """
        label, distance = np.array(self.label), np.full(len(self.label), np.nan)
        for number in np.unique(group):
            used = group != number
            scored = np.flatnonzero(~used & np.isin(label, label[used]))
            if scored.size:
                space = self._space_of(used)
                distance[scored] = [
                    space.score(self.features[index], self.condition[index]) for index in scored
                ]
        return distance


def build_reference(
    windows: WindowSet, features: Float[np.ndarray, "window feature"]
) -> TrainingReference | None:
    """Reference of the measured recordings among training windows, or None where all are synthetic
    or not finite.

    The features are of each window, numbers of the same kind, such as logarithms of powers.
    """
    names = np.unique(windows.recording_id[~windows.synthetic])
    if not names.size:
        return None
    names = _spaced(names, MOST_RECORDINGS)
    masks = [(windows.recording_id == name) & ~windows.synthetic for name in names]
    parts = [windows.subset(_spaced(np.flatnonzero(mask), _MOST_WINDOWS)) for mask in masks]
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


def _spaced(rows: np.ndarray, most: int) -> np.ndarray:
    """As many of them at most, evenly spaced."""
    return rows[
        np.unique(np.linspace(0, rows.size - 1, min(most, rows.size)).round().astype(np.int64))
    ]


def scaled_reference(reference: TrainingReference) -> TrainingReference:
    """The same reference with its `distance_scales`.

    Each machine that is left out has its own, and their median is taken: one machine that is unlike
    the few others of the training would else set the scale for all to come. Where no scale can be
    told, the other one is taken, or 1.
    """
    alone = [reference.left_out_distances(_folds(len(reference.label)))]
    machines, group = np.unique(reference.specimen, return_inverse=True)
    together = alone
    if len(machines) > 1:
        distance = reference.left_out_distances(group)
        together = [distance[group == number] for number in range(len(machines))]
    scales = [
        scale for parts in (alone, together) if (scale := _median_of_furthest(parts)) > 0
    ] or [1.0]
    return replace(reference, distance_scales=(scales[0], scales[-1]))


def _median_of_furthest(parts: list[np.ndarray]) -> float:
    """Median over the parts of the distance that nine in ten do not exceed; 0 where none is
    scored.
    """
    scored = [part[~np.isnan(part)] for part in parts]
    furthest = [float(np.quantile(part, 1 - _FURTHEST)) for part in scored if part.size]
    return float(np.median(furthest)) if furthest else 0.0


def _folds(count: int) -> Int[np.ndarray, " reference"]:
    """Fold of each recording, in turn."""
    return np.arange(count) % _N_FOLDS
