"""Confidence in a classifier's answers: temperature, prediction sets, unknown recordings, pooling.

It is calibrated on answers to recordings that the answering model was not trained on
(`evaluation.confidence_calibration`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float64, Int, Int64

from swashtwin.foundation import InputError, plural
from swashtwin.learning.training.virtual_problems import N_PROBLEMS, transport_p_values

DEFAULT_ERROR_RATE = 0.1
"""Error rate of prediction sets if none is specified, and the recordings allow it."""


@dataclass(frozen=True, eq=False)
class Confidence:
    """Temperature, prediction sets and threshold for unknown recordings.

    All three come from validation recordings.
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
    n_machines: int = 0
    """Machines that were held out in turn, if the confidence is cross-fitted on all of them; else
    0. Then all classes are compared together, because scores differ between machines more than
    between classes, and p-values are those of a new machine (`transport_p_values`).
    """

    def __post_init__(self) -> None:
        if not (math.isfinite(self.temperature) and self.temperature > 0):
            raise InputError(f"temperature ({self.temperature:g}) must be a positive number.")
        if not 0 <= self.dependence <= 1:
            raise InputError(f"dependence ({self.dependence:g}) must lie between 0 and 1.")
        require_validation_recordings(self.n_recordings, self.error_rate)

        if self.n_machines < 0:
            raise InputError(f"n_machines ({self.n_machines}) must not be negative.")
        counts = self.listening_windows
        if counts[:1] != (1,) or sorted(set(counts)) != list(counts):
            raise InputError(f"listening_windows ({counts}) must ascend from 1.")
        has_scores = self.nonconformity_score.shape == (len(counts), self.n_recordings)
        if not has_scores or self.ood_score.shape != self.target.shape:
            raise InputError("A confidence needs the scores of each validation recording.")
        if (np.diff(self.ood_score) < 0).any():
            raise InputError("ood_score must ascend.")

    @property
    def n_recordings(self) -> int:
        """Number of validation recordings it was learned from."""
        return int(self.target.size)

    @property
    def basis(self) -> str:
        """Description of the validation recordings."""
        if self.cross_fitted:
            recordings = plural(self.n_recordings, "training recording")
            if not self.n_machines:
                return f"{recordings}, each classified by models trained without it"

            basis = f"{recordings}, each classified by models trained without its machine"
            n_problems = N_PROBLEMS.get(self.n_machines)
            if n_problems is None:
                return basis
            pumps = plural(self.n_machines, "pump")
            return f"{basis}, adjusted by {n_problems} virtual problems of {pumps}"
        return f"{plural(self.n_recordings, 'validation recording')} held out"

    def temperature_scaled(
        self,
        probability: Float[np.ndarray, "*recording class"],
        n_windows: int | Int[np.ndarray, "*recording"],
    ) -> Float64[np.ndarray, "*recording class"]:
        """Return the calibrated probabilities of recordings.

        Rows sum to 1, and the likeliest class stays the same. log p_c becomes n_eff log p_c / T,
        with n_eff = n / (1 + (n - 1) ρ) and p from the mean log-probability of the n windows
        (`pooled_probabilities`).

        Examples
        --------
        >>> scores = np.linspace(0.0, 1.0, 9)
        >>> target = np.zeros(9, dtype=np.int64)
        >>> confidence = Confidence(2.0, 0.5, (1,), scores[None], target, scores, 0.1)
        >>> confidence.temperature_scaled(np.array([0.96, 0.04]), 20).round(2)
        array([0.95, 0.05])
        """
        temperature = pooled_temperature(self.temperature, self.dependence, n_windows)
        return temperature_scaled(probability, temperature)

    def plausibility(
        self,
        probability: Float[np.ndarray, "*recording class"],
        n_windows: int | Int[np.ndarray, "*recording"],
        error_rate: float | None = None,
    ) -> Float64[np.ndarray, "*recording class"]:
        """Return the conformal p-value of each class.

        That is the share of recordings whose score is at least as high, this one counted:
        (1 + #{i : s_i >= -log p_c}) / (m + 1) over the m validation recordings of the class's
        `class_groups`, each cut to the largest of `listening_windows` that the recording has. p_c
        is that of `pooled_probabilities` before the temperature, so that no p-value depends on what
        was fitted to the validation recordings. For the true class it is at most e in a share e of
        the recordings of each group (Mondrian sets: Vovk, Gammerman and Shafer 2005, ch. 4). If
        a few machines were held out, `transport_p_values` adjusts it to a new machine, and that
        share is one of virtual pumps.
        """
        score = nonconformity_scores(probability)
        row = np.searchsorted(self.listening_windows, n_windows, side="right") - 1
        validation_score = self.nonconformity_score[row]
        class_group = self.class_groups(score.shape[-1], error_rate)

        p_value = np.empty_like(score)
        for group in np.unique(class_group):
            group_score = validation_score[..., class_group[self.target] == group]
            class_score = score[..., class_group == group, None]
            n_higher = (group_score[..., None, :] >= class_score).sum(axis=-1)
            p_value[..., class_group == group] = (1 + n_higher) / (group_score.shape[-1] + 1)
        return transport_p_values(p_value, self.n_machines)

    def class_groups(
        self, n_classes: int, error_rate: float | None = None
    ) -> Int64[np.ndarray, " class"]:
        """Return the group of each class, within which its p-values are computed.

        It is the class's index if the class has enough validation recordings, else -1: scarce
        classes are judged together. If they are too few even so, the next scarcest classes join
        them. All are judged together if machines were held out.
        """
        if self.n_machines:
            return np.full(n_classes, -1)

        rate = self.error_rate if error_rate is None else error_rate
        needed = min_validation_recordings(rate)
        count = np.bincount(self.target, minlength=n_classes)
        by_count = np.argsort(count, kind="stable")
        n_scarce = int(np.count_nonzero(count < needed))
        while 0 < n_scarce < n_classes and count[by_count[:n_scarce]].sum() < needed:
            n_scarce += 1

        group = np.arange(n_classes)
        group[by_count[:n_scarce]] = -1
        return group

    def prediction_set(
        self,
        probability: Float[np.ndarray, "*recording class"],
        n_windows: int | Int[np.ndarray, "*recording"],
        error_rate: float | None = None,
    ) -> Bool[np.ndarray, "*recording class"]:
        """Return which classes cannot be excluded at the error rate.

        These are the classes whose p-value exceeds it, and always the likeliest one.

        Raises
        ------
        InputError
            Too few validation recordings for the rate.
        """
        rate = self.error_rate if error_rate is None else error_rate
        require_validation_recordings(self.n_recordings, rate)
        probability = np.asarray(probability)
        is_likeliest = probability == probability.max(-1, keepdims=True)
        return np.asarray((self.plausibility(probability, n_windows, rate) > rate) | is_likeliest)

    def ood_p_value(
        self, ood_score: Float[np.ndarray, "*recording"]
    ) -> Float64[np.ndarray, "*recording"]:
        """Return the conformal p-value of resembling the training.

        That is the share of recordings whose score is at least as high. If it is at most the error
        rate, the recording is called unknown.
        """
        n_lower = np.searchsorted(self.ood_score, np.asarray(ood_score), side="left")
        n_higher = self.n_recordings - n_lower
        return np.asarray((1 + n_higher) / (self.n_recordings + 1), dtype=np.float64)


# Guards whole numbers such as 1 / 0.1 against rounding up.
_ROUNDING = 1e-9


def min_validation_recordings(error_rate: float) -> int:
    """Return the number of validation recordings that an error rate needs.

    It is 1 / error_rate - 1, rounded up: with fewer, no p-value can be that small.

    Raises
    ------
    InputError
        The rate is not between 0 and 1.
    """
    if not (isinstance(error_rate, (int, float, np.number)) and 0 < error_rate < 1):
        raise InputError(
            f"error_rate ({error_rate!r}) must lie between 0 and 1; one recording in ten is 0.1."
        )
    return math.ceil(1 / error_rate - 1 - _ROUNDING)


def require_validation_recordings(n_recordings: int, error_rate: float) -> None:
    """Require enough validation recordings for an error rate.

    Raises
    ------
    InputError
        They are too few.
    """
    needed = min_validation_recordings(error_rate)
    if n_recordings < needed:
        allowed = allowed_error_rate(n_recordings, error_rate)
        raise InputError(
            f"An error rate of {error_rate:g} needs {needed} validation recordings, and there are "
            f"{n_recordings}. Use more recordings, or an error rate of {allowed:g} or more.",
            field="error_rate",
        )


def validation_share(
    n_recordings: int, error_rate: float = DEFAULT_ERROR_RATE, fraction: float = 0.2
) -> tuple[float, int]:
    """Return the share of the recordings to hold out for validation, and about how many these are.

    The share is `fraction`, or as much more as the error rate needs, at most half; see
    `allowed_error_rate` for what these allow.

    Parameters
    ----------
    n_recordings : recordings that are left after the test set was taken away.
    """
    needed = min_validation_recordings(error_rate)
    if round(n_recordings * fraction) >= needed:
        return fraction, round(n_recordings * fraction)

    # Two folds at least: half of the recordings is the most that is held out.
    max_folds = int(1 / fraction + _ROUNDING)
    n_folds = max(2, min(max_folds, n_recordings // needed))
    return round(1 / n_folds, 3), n_recordings // n_folds


def allowed_error_rate(n_validation: int, error_rate: float) -> float:
    """Return `error_rate`, or the lowest one that some validation recordings allow.

    The latter is rounded up to three digits.
    """
    if n_validation >= min_validation_recordings(error_rate):
        return error_rate
    return math.ceil(1000 / (n_validation + 1)) / 1000


def pooled_temperature(
    temperature: float, dependence: float, n_windows: int | Int[np.ndarray, "*recording"]
) -> Float64[np.ndarray, "*recording"]:
    """Return T / n_eff = T (ρ + (1 - ρ) / n), the temperature of a mean over n windows."""
    return np.asarray(
        temperature * (dependence + (1 - dependence) / np.asarray(n_windows)), dtype=np.float64
    )


def temperature_scaled(
    probability: Float[np.ndarray, "*recording class"],
    temperature: float | Float[np.ndarray, "..."],
) -> Float64[np.ndarray, "*recording class"]:
    """Return p_c^(1/T) / Σ p^(1/T) along the last axis."""
    logarithm = -nonconformity_scores(probability) / np.asarray(temperature)[..., None]
    return np.asarray(scipy.special.softmax(logarithm, axis=-1))


def nonconformity_scores(
    probability: Float[np.ndarray, "*recording class"],
) -> Float64[np.ndarray, "*recording class"]:
    """Return -log p [nat], with p at least 1e-300."""
    return np.asarray(-np.log(np.maximum(probability, 1e-300)), dtype=np.float64)


# Bounds of the temperature: answers that are no better than chance would drive it to infinity.
_TEMPERATURES = (0.05, 100.0)

# Dependences that the search starts from; it stays at the first if no recording has two windows.
_STARTS = (1.0, 0.1)


def pooled_probabilities(
    probability: Float[np.ndarray, "window class"], confidence: Confidence | None = None
) -> Float[np.ndarray, " class"]:
    """Return the probability of each class for a whole recording.

    It is that of the mean log-probability of the windows. With a confidence, the mean is scaled to
    the number of independent windows that they are worth and to its temperature; without, the
    recording counts as a single window. The likeliest class is the same. All are NaN if a window
    has no finite answer.
    """
    pooled = scipy.special.softmax(np.log(np.maximum(probability, 1e-12)).mean(axis=0))
    if confidence is None:
        return pooled
    return confidence.temperature_scaled(pooled, len(probability))


def window_counts(n_windows: int) -> tuple[int, ...]:
    """Return the powers of two below `n_windows`, and `n_windows`: lengths of cut recordings."""
    powers = [1 << power for power in range((n_windows - 1).bit_length())]
    return (*powers, n_windows)


def fit_pooling(
    probability: Sequence[Float[np.ndarray, "window class"]],
    target: Int64[np.ndarray, " recording"],
) -> tuple[float, float]:
    """Return the temperature T and the dependence ρ of the lowest cross-entropy.

    Each recording is cut into consecutive blocks of 1, 2, 4, ... and all windows. Each of these
    lengths, and then each recording, has the same weight. The targets are (n + 1)/(n + C) for the
    true class of n recordings and 1/(n + C) for each other. These are Laplace's shares: n
    recordings that are all classified right are no proof of certainty (the multiclass form of
    Platt's targets, 1999). Without them T would fall to nothing there.
    """
    n_recordings = len(probability)
    n_classes = probability[0].shape[1]
    recording_goals = np.full((n_recordings, n_classes), 1 / (n_recordings + n_classes))
    true_share = (n_recordings + 1) / (n_recordings + n_classes)
    recording_goals[np.arange(n_recordings), target] = true_share

    blocks = [_blocks(np.log(np.maximum(part, 1e-12))) for part in probability]
    mean, count, weight = (np.concatenate(part) for part in zip(*blocks, strict=True))
    n_blocks = [len(block_counts) for _, block_counts, _ in blocks]
    goals = np.repeat(recording_goals, n_blocks, axis=0)

    def loss(parameters: Float64[np.ndarray, " 2"]) -> tuple[float, Float64[np.ndarray, " 2"]]:
        """Return the cross-entropy and its gradient, by log T and ρ."""
        log_temperature, dependence = parameters
        temperature = float(np.exp(log_temperature))
        inverse = 1 / pooled_temperature(temperature, float(dependence), count)
        log_share = scipy.special.log_softmax(inverse[:, None] * mean, axis=1)
        cross_entropy = -(weight @ (goals * log_share).sum(axis=1)) / n_recordings

        slope = weight * ((np.exp(log_share) - goals) * mean).sum(axis=1) * -inverse
        relative = (1 - 1 / count) / (dependence + (1 - dependence) / count)
        gradient = np.array([slope.sum(), (slope * relative).sum()]) / n_recordings
        return float(cross_entropy), gradient

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
    log_probability: Float64[np.ndarray, "window class"],
) -> tuple[
    Float64[np.ndarray, "block class"], Int64[np.ndarray, " block"], Float64[np.ndarray, " block"]
]:
    """Return the blocks of consecutive windows of one recording.

    For each block: its mean log-probability, its number of windows, and its weight.
    """
    n_windows = len(log_probability)
    lengths = window_counts(n_windows)
    means = []
    counts = []
    weights = []
    for length in lengths:
        starts = range(0, n_windows - length + 1, length)
        for start in starts:
            means.append(log_probability[start : start + length].mean(axis=0))
            counts.append(length)
            weights.append(1 / (len(starts) * len(lengths)))
    return np.stack(means), np.array(counts, dtype=np.int64), np.array(weights)


def likeliest_class(
    probability: Float[np.ndarray, "*window class"],
) -> Int64[np.ndarray, "*window"]:
    """Return the index of the likeliest class.

    It is -1 if a probability is not finite, so that there is no verdict.
    """
    is_finite = np.isfinite(probability).all(axis=-1)
    return np.where(is_finite, probability.argmax(axis=-1), -1)
