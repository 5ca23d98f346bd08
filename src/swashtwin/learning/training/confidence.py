"""How reliable a classifier's answers are, from answers to recordings that had no part in training
what gave them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float64, Int, Int64

from swashtwin.foundation import InputError, plural


@dataclass(frozen=True, eq=False)
class Confidence:
    """A temperature, prediction sets and a threshold for what is unknown, learned from validation
    recordings.
    """

    temperature: float
    """T by which the log-probabilities of a single window are divided: p_c^(1/T) / Σ p^(1/T) (Guo
    and others 2017, arXiv:1706.04599). Above 1 the classifier was too sure of itself.
    """
    dependence: float
    """ρ, how much the windows of a recording repeat each other: n of them count as n / (1 + (n - 1)
    ρ) independent ones (Kish's design effect, 1965). 0: each window is new evidence; 1: all windows
    are no more than the first.
    """
    listening_windows: tuple[int, ...]
    """Windows that the rows of `nonconformity_score` pool, ascending from 1; the last row pools
    whole recordings.
    """
    nonconformity_score: Float64[np.ndarray, "listening recording"]
    """-log p of the true class of each validation recording, from the mean log-probability of its
    first windows, before the temperature [nat].
    """
    target: Int64[np.ndarray, " recording"]
    """Index of the true class of each validation recording."""
    ood_score: Float64[np.ndarray, " recording"]
    """Out-of-distribution score of each validation recording, ascending; see
    `TrainingReference.ood_score`.
    """
    error_rate: float
    """Share of the recordings whose prediction set may miss the true class, and of those that may
    be called unknown although their class was trained.
    """
    cross_fitted: bool = False
    """Whether the validation recordings are those of the training, each answered by models that
    were trained without it (`cross_fitted_confidence`), rather than recordings held out
    (`learn_confidence`).
    """

    def __post_init__(self) -> None:
        if not (math.isfinite(self.temperature) and self.temperature > 0):
            raise InputError(f"temperature ({self.temperature:g}) must be a positive number.")
        if not 0 <= self.dependence <= 1:
            raise InputError(f"dependence ({self.dependence:g}) must lie between 0 and 1.")
        require_validation_recordings(self.n_recordings, self.error_rate)
        counts = self.listening_windows
        if counts[:1] != (1,) or sorted(set(counts)) != list(counts):
            raise InputError(f"listening_windows ({counts}) must ascend from 1.")
        if self.nonconformity_score.shape != (len(counts), self.n_recordings) or (
            self.ood_score.shape != self.target.shape
        ):
            raise InputError("a confidence needs the scores of each validation recording.")
        if (np.diff(self.ood_score) < 0).any():
            raise InputError("ood_score must ascend.")

    @property
    def n_recordings(self) -> int:
        """Validation recordings it was learned from."""
        return int(self.target.size)

    @property
    def basis(self) -> str:
        """The validation recordings in words."""
        if self.cross_fitted:
            return f"{plural(self.n_recordings, 'training recording')} answered by models trained without them"
        return f"{plural(self.n_recordings, 'validation recording')} held out"

    def temperature_scaled(
        self,
        probability: Float[np.ndarray, "*recording class"],
        n_windows: int | Int[np.ndarray, "*recording"],
    ) -> Float64[np.ndarray, "*recording class"]:
        """Calibrated probabilities of recordings; rows sum to 1, and the likeliest class stays.

        log p_c becomes n_eff log p_c / T, with n_eff = n / (1 + (n - 1) ρ) and p from the mean
        log-probability of the n windows (`pooled_probabilities`).

        Examples
        --------
        >>> scores = np.linspace(0.0, 1.0, 9)
        >>> confidence = Confidence(2.0, 0.5, (1,), scores[None], np.zeros(9, dtype=np.int64), scores, 0.1)
        >>> confidence.temperature_scaled(np.array([0.96, 0.04]), 20).round(2)
        array([0.95, 0.05])
        """
        return temperature_scaled(
            probability, pooled_temperature(self.temperature, self.dependence, n_windows)
        )

    def plausibility(
        self,
        probability: Float[np.ndarray, "*recording class"],
        n_windows: int | Int[np.ndarray, "*recording"],
        error_rate: float | None = None,
    ) -> Float64[np.ndarray, "*recording class"]:
        """Conformal p-value of each class: the share of recordings whose score is at least as high,
        this one counted.

        (1 + #{i : s_i >= -log p_c}) / (m + 1) over the m validation recordings of the class's
        `class_groups`, each cut to the most `listening_windows` that the recording has. p_c is that
        of `pooled_probabilities` before the temperature, so that no p-value depends on what was
        fitted to the validation recordings. For the true class it is at most e in a share e of the
        recordings of each group (Mondrian sets: Vovk, Gammerman and Shafer 2005, ch. 4).
        """
        score = nonconformity_scores(probability)
        row = np.searchsorted(self.listening_windows, n_windows, side="right") - 1
        group = self.class_groups(score.shape[-1], error_rate)
        p_value = np.empty_like(score)
        for index in np.unique(group):
            among = self.nonconformity_score[row][..., group[self.target] == index]
            at_least = (among[..., None, :] >= score[..., group == index, None]).sum(axis=-1)
            p_value[..., group == index] = (1 + at_least) / (among.shape[-1] + 1)
        return p_value

    def class_groups(
        self, n_classes: int, error_rate: float | None = None
    ) -> Int64[np.ndarray, " class"]:
        """Group of each class: its index where it has validation recordings enough of its own, else
        -1.

        Scarce classes are judged together. Where they are too few even so, the next scarcest
        classes join them.
        """
        least = min_validation_recordings(self.error_rate if error_rate is None else error_rate)
        count = np.bincount(self.target, minlength=n_classes)
        order = np.argsort(count, kind="stable")
        n_together = int(np.count_nonzero(count < least))
        while n_together and n_together < n_classes and count[order[:n_together]].sum() < least:
            n_together += 1
        group = np.arange(n_classes)
        group[order[:n_together]] = -1
        return group

    def prediction_set(
        self,
        probability: Float[np.ndarray, "*recording class"],
        n_windows: int | Int[np.ndarray, "*recording"],
        error_rate: float | None = None,
    ) -> Bool[np.ndarray, "*recording class"]:
        """Which classes cannot be ruled out at the error rate: those more plausible than it, and
        always the likeliest.

        An `InputError` where there are too few validation recordings for the rate.
        """
        rate = self.error_rate if error_rate is None else error_rate
        require_validation_recordings(self.n_recordings, rate)
        probability = np.asarray(probability)
        is_likeliest = probability == probability.max(-1, keepdims=True)
        return np.asarray((self.plausibility(probability, n_windows, rate) > rate) | is_likeliest)

    def ood_p_value(
        self, ood_score: Float[np.ndarray, "*recording"]
    ) -> Float64[np.ndarray, "*recording"]:
        """Conformal p-value of resembling the training: the share of recordings whose score is at
        least as high.

        Where it is at most the error rate, the recording is called unknown.
        """
        at_least = self.n_recordings - np.searchsorted(
            self.ood_score, np.asarray(ood_score), side="left"
        )
        return np.asarray((1 + at_least) / (self.n_recordings + 1), dtype=np.float64)


def min_validation_recordings(error_rate: float) -> int:
    """Validation recordings that an error rate needs at least: 1 / error_rate - 1, rounded up.

    An `InputError` where it is not between 0 and 1.
    """
    if not (isinstance(error_rate, (int, float, np.number)) and 0 < error_rate < 1):
        raise InputError(
            f"error_rate ({error_rate!r}) must lie between 0 and 1; one recording in ten is 0.1."
        )
    return math.ceil(1 / error_rate - 1 - 1e-9)


def require_validation_recordings(
    n_recordings: int, error_rate: float, fewest: int | None = None
) -> None:
    """Raise an `InputError` where so many validation recordings cannot say anything at this error
    rate; it advises the rate that the `fewest` which may be left of them allow.
    """
    least = min_validation_recordings(error_rate)
    if n_recordings < least:
        raise InputError(
            f"an error rate of {error_rate:g} needs {least} validation recordings at least, there are {n_recordings}; "
            f"take more, or allow {allowed_error_rate(fewest or n_recordings, error_rate):g} or more."
        )


def validation_share(
    n_recordings: int, error_rate: float = 0.1, fraction: float = 0.2
) -> tuple[float, int]:
    """(share of the recordings to hold back for validation, about how many these are).

    That is `fraction`, or as much more as the error rate needs, half at most; see
    `allowed_error_rate` of so many. The recordings are those that are left after the test set was
    taken away.
    """
    needed = min_validation_recordings(error_rate)
    if round(n_recordings * fraction) >= needed:
        return fraction, round(n_recordings * fraction)
    folds = max(2, min(int(1 / fraction + 1e-9), n_recordings // needed))
    return round(1 / folds, 3), n_recordings // folds


def allowed_error_rate(n_validation: int, error_rate: float) -> float:
    """`error_rate`, or the least that so many validation recordings allow, rounded up to three
    digits.
    """
    if n_validation >= min_validation_recordings(error_rate):
        return error_rate
    return math.ceil(1000 / (n_validation + 1)) / 1000


def pooled_temperature(
    temperature: float, dependence: float, n_windows: int | Int[np.ndarray, "*recording"]
) -> Float64[np.ndarray, "*recording"]:
    """T / n_eff = T (ρ + (1 - ρ) / n): what divides the mean log-probability of n windows."""
    return np.asarray(
        temperature * (dependence + (1 - dependence) / np.asarray(n_windows)), dtype=np.float64
    )


def temperature_scaled(
    probability: Float[np.ndarray, "*recording class"],
    temperature: float | Float[np.ndarray, "..."],
) -> Float64[np.ndarray, "*recording class"]:
    """p_c^(1/T) / Σ p^(1/T) along the last axis."""
    logarithm = -nonconformity_scores(probability) / np.asarray(temperature)[..., None]
    return np.asarray(scipy.special.softmax(logarithm, axis=-1))


def nonconformity_scores(
    probability: Float[np.ndarray, "*recording class"],
) -> Float64[np.ndarray, "*recording class"]:
    """-log p [nat], p being 1e-300 at least."""
    return np.asarray(-np.log(np.maximum(probability, 1e-300)), dtype=np.float64)


_TEMPERATURES = (0.05, 100.0)
"""Bounds of the temperature."""
_STARTS = (1.0, 0.1)
"""Dependences that the search starts from; where no recording has two windows it stays at the
first.
"""


def pooled_probabilities(
    probability: Float[np.ndarray, "window class"], confidence: Confidence | None = None
) -> Float[np.ndarray, " class"]:
    """Probability of each class for a whole recording, from the mean log-probability of its
    windows.

    With a confidence, the mean is scaled to as many independent windows as they are worth and to
    its temperature; without, the recording counts as a single window. The likeliest class is the
    same. NaN for each class where a window has no finite answer.
    """
    pooled = scipy.special.softmax(np.log(np.maximum(probability, 1e-12)).mean(axis=0))
    return pooled if confidence is None else confidence.temperature_scaled(pooled, len(probability))


def window_counts(n_windows: int) -> tuple[int, ...]:
    """Powers of two below `n_windows`, and `n_windows`: what recordings are cut to."""
    return *(1 << power for power in range((n_windows - 1).bit_length())), n_windows


def fit_pooling(
    probability: Sequence[Float[np.ndarray, "window class"]],
    target: Int64[np.ndarray, " recording"],
) -> tuple[float, float]:
    """(temperature T, dependence ρ) of the least cross-entropy on recordings listened to for
    several times.

    Each recording is cut into consecutive blocks of 1, 2, 4, ... and all windows, and each of these
    times, then each recording, has the same weight. The targets are (n + 1)/(n + C) for the true
    class of n recordings and 1/(n + C) for each other. These are Laplace's shares: n recordings
    that are all told right are no proof of certainty (the multiclass form of Platt's targets,
    1999). Without them T would fall to nothing there.
    """
    n, n_classes = len(probability), probability[0].shape[1]
    goal = np.full((n, n_classes), 1 / (n + n_classes))
    goal[np.arange(n), target] = (n + 1) / (n + n_classes)
    blocks = [_blocks(np.log(np.maximum(part, 1e-12))) for part in probability]
    mean, count, weight = (np.concatenate(part) for part in zip(*blocks, strict=True))
    goals = np.repeat(goal, [len(block[1]) for block in blocks], axis=0)

    def loss(parameters: Float64[np.ndarray, " 2"]) -> tuple[float, Float64[np.ndarray, " 2"]]:
        logarithm, dependence = parameters
        inverse = 1 / pooled_temperature(float(np.exp(logarithm)), float(dependence), count)
        log_share = scipy.special.log_softmax(inverse[:, None] * mean, axis=1)
        slope = weight * ((np.exp(log_share) - goals) * mean).sum(axis=1) * -inverse
        relative = (1 - 1 / count) / (dependence + (1 - dependence) / count)
        return float(-(weight @ (goals * log_share).sum(axis=1)) / n), np.array(
            [slope.sum() / n, (slope * relative).sum() / n]
        )

    low, high = np.log(_TEMPERATURES)
    fits = [
        scipy.optimize.minimize(
            loss, (0.0, start), jac=True, method="L-BFGS-B", bounds=((low, high), (0.0, 1.0))
        )
        for start in _STARTS
    ]
    best = min(fits, key=lambda fit: float(fit.fun))
    return float(np.exp(best.x[0])), float(best.x[1])


def _blocks(
    logarithm: Float64[np.ndarray, "window class"],
) -> tuple[
    Float64[np.ndarray, "block class"], Int64[np.ndarray, " block"], Float64[np.ndarray, " block"]
]:
    """(mean log-probability, windows, weight) of each block of consecutive windows of one
    recording.
    """
    counts = window_counts(len(logarithm))
    starts = [np.arange(0, len(logarithm) - count + 1, count) for count in counts]
    means = [
        np.stack([logarithm[start : start + count].mean(axis=0) for start in first])
        for count, first in zip(counts, starts, strict=True)
    ]
    sizes = [len(first) for first in starts]
    weights = np.repeat([1 / (size * len(counts)) for size in sizes], sizes)
    return np.concatenate(means), np.repeat(counts, sizes).astype(np.int64), weights


def likeliest_class(
    probability: Float[np.ndarray, "*window class"],
) -> Int64[np.ndarray, "*window"]:
    """Index of the likeliest class; -1 where a probability is no finite number, so that there is no
    verdict.
    """
    return np.where(np.isfinite(probability).all(axis=-1), probability.argmax(axis=-1), -1)
