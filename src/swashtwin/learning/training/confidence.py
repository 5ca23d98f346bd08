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


def require_enough(n_recordings: int, error_rate: float) -> None:
    """Raise an `InputError` where so many validation recordings cannot say anything at this error rate."""
    if not 0 < error_rate < 1:
        raise InputError(f"error_rate ({error_rate:g}) must lie between 0 and 1; one recording in ten is 0.1.")
    least = math.ceil(1 / error_rate - 1 - 1e-9)
    if n_recordings < least:
        raise InputError(
            f"an error rate of {error_rate:g} needs {least} validation recordings at least, there are {n_recordings}; "
            "keep more back for validation, or allow a larger error rate."
        )


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
