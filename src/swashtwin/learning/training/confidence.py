"""How reliable a classifier's answers are, from recordings that it was not trained on.

Everything counts recordings, since the windows of one are not independent. Where a new recording comes from the same
pumps, sensors and conditions as the validation recordings (is exchangeable with them), the rates hold whatever the
classifier is worth (Vovk, Gammerman and Shafer 2005, DOI 10.1007/b106715); where it does not, nothing holds them.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from swashtwin.foundation import InputError


@dataclass(frozen=True, eq=False)
class Confidence:
    """A temperature, prediction sets and a threshold for what is unknown, learned from validation recordings."""

    temperature: float
    """T by which log-probabilities of a recording are divided: p_c^(1/T) / Σ p^(1/T) (Guo and others 2017,
    arXiv:1706.04599). Above 1 the classifier was too sure of itself."""
    nonconformity_score: Float64[np.ndarray, " recording"]
    """-log p of the true class of each validation recording before the temperature scaling, ascending [nat]."""
    ood_score: Float64[np.ndarray, " recording"]
    """Out-of-distribution score of each validation recording, ascending; see `TrainingReference.ood_score`."""
    error_rate: float
    """Share of the recordings whose prediction set may miss the true class, and of those that may be called unknown
    although their class was trained."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.temperature) and self.temperature > 0):
            raise InputError(f"temperature ({self.temperature:g}) must be a positive number.")
        require_enough(self.n_recordings, self.error_rate)

    @property
    def n_recordings(self) -> int:
        """Validation recordings it was learned from."""
        return int(self.nonconformity_score.size)

    def temperature_scaled(
        self, probability: Float[np.ndarray, "*recording class"]
    ) -> Float64[np.ndarray, "*recording class"]:
        """Probabilities of recordings at the temperature; rows sum to 1, and the likeliest class stays.

        Examples
        --------
        >>> scores = np.linspace(0.0, 1.0, 9)
        >>> Confidence(2.0, scores, scores, 0.1).temperature_scaled(np.array([0.96, 0.04])).round(2)
        array([0.83, 0.17])
        """
        return temperature_scaled(probability, self.temperature)

    def plausibility(
        self, probability: Float[np.ndarray, "*recording class"]
    ) -> Float64[np.ndarray, "*recording class"]:
        """Conformal p-value of each class: the share of recordings whose score is at least as high, this one counted.

        (1 + #{i : s_i >= -log p_c}) / (n + 1), with p_c before the temperature. For the true class it is at most e in
        a share e of the recordings.
        """
        return _share(self.nonconformity_score, nonconformity_scores(probability))

    def prediction_set(
        self, probability: Float[np.ndarray, "*recording class"], error_rate: float | None = None
    ) -> Bool[np.ndarray, "*recording class"]:
        """Which classes cannot be ruled out at the error rate: those more plausible than it, and always the likeliest.

        Raises
        ------
        InputError
            Too few validation recordings for this error rate.
        """
        rate = self.error_rate if error_rate is None else error_rate
        require_enough(self.n_recordings, rate)
        probability = np.asarray(probability)
        return np.asarray((self.plausibility(probability) > rate) | (probability == probability.max(-1, keepdims=True)))

    def ood_p_value(self, ood_score: Float[np.ndarray, "*recording"]) -> Float64[np.ndarray, "*recording"]:
        """Conformal p-value of resembling the training: the share of recordings whose score is at least as high.

        Where it is at most the error rate, the recording is called unknown.
        """
        return _share(self.ood_score, np.asarray(ood_score))


def least_validation(error_rate: float) -> int:
    """Validation recordings that an error rate needs at least: 1 / error_rate - 1, rounded up.

    Raises
    ------
    InputError
        The error rate is not between 0 and 1.

    Examples
    --------
    >>> least_validation(0.1)
    9
    """
    if not 0 < error_rate < 1:
        raise InputError(f"error_rate ({error_rate:g}) must lie between 0 and 1; one recording in ten is 0.1.")
    return math.ceil(1 / error_rate - 1 - 1e-9)


def require_enough(n_recordings: int, error_rate: float) -> None:
    """Raise an `InputError` where so many validation recordings cannot say anything at this error rate."""
    least = least_validation(error_rate)
    if n_recordings < least:
        raise InputError(
            f"an error rate of {error_rate:g} needs {least} validation recordings at least, there are {n_recordings}; "
            "keep more back for validation, or allow a larger error rate."
        )


@dataclass(frozen=True)
class ValidationPlan:
    """How many of the recordings that are left after the test can calibrate a confidence."""

    n_recordings: int
    """Recordings to train on and to validate with, together."""
    needed: int
    """Validation recordings that the error rate asked for needs."""
    fraction: float
    """Share to hold back for validation."""
    n_validation: int
    """About how many recordings that is."""
    error_rate: float
    """Error rate that they allow: the one asked for, or a larger one."""

    @property
    def is_enough(self) -> bool:
        """Whether they suffice for the error rate asked for."""
        return self.n_validation >= self.needed


def plan_validation(n_recordings: int, error_rate: float = 0.1, fraction: float = 0.2) -> ValidationPlan:
    """The share to hold back for validation: `fraction`, or as much more as the error rate needs, half at most.

    Where half is too few, the error rate is the least that they allow: 1 / (n + 1).

    Parameters
    ----------
    n_recordings : recordings that are left after the test set was taken away.
    error_rate : error rate asked for.
    fraction : share asked for.

    Examples
    --------
    >>> plan = plan_validation(24)
    >>> plan.needed, plan.fraction, plan.n_validation, plan.error_rate
    (9, 0.5, 12, 0.1)
    >>> plan_validation(12).error_rate
    0.143
    """
    needed = least_validation(error_rate)
    folds = max(2, min(int(1 / fraction + 1e-9), n_recordings // needed))
    if round(n_recordings * fraction) >= needed:
        share, count = fraction, round(n_recordings * fraction)
    else:
        share, count = round(1 / folds, 3), n_recordings // folds
    return ValidationPlan(n_recordings, needed, share, count, allowed_error_rate(count, error_rate))


def allowed_error_rate(n_validation: int, error_rate: float) -> float:
    """`error_rate`, or the least that so many validation recordings allow, rounded up to three digits."""
    if n_validation >= least_validation(error_rate):
        return error_rate
    return math.ceil(1000 / (n_validation + 1)) / 1000


def temperature_scaled(
    probability: Float[np.ndarray, "*recording class"], temperature: float
) -> Float64[np.ndarray, "*recording class"]:
    """p_c^(1/T) / Σ p^(1/T) along the last axis."""
    logarithm = -nonconformity_scores(probability) / temperature
    share = np.exp(logarithm - logarithm.max(axis=-1, keepdims=True))
    return np.asarray(share / share.sum(axis=-1, keepdims=True))


def nonconformity_scores(probability: Float[np.ndarray, "*recording class"]) -> Float64[np.ndarray, "*recording class"]:
    """-log p [nat], p being 1e-300 at least."""
    return np.asarray(-np.log(np.maximum(probability, 1e-300)), dtype=np.float64)


def _share(ascending: Float64[np.ndarray, " recording"], value: Float[np.ndarray, "..."]) -> np.ndarray:
    at_least = ascending.size - np.searchsorted(ascending, value, side="left")
    return np.asarray((1 + at_least) / (ascending.size + 1), dtype=np.float64)
