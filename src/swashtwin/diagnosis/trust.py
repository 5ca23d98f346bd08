"""How reliable the answer on one recording is, judged by validation recordings."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swashtwin.diagnosis.observation import Observation
from swashtwin.learning import Confidence, SureClassifier, pooled_probabilities


@dataclass(frozen=True)
class Trust:
    """The classes that cannot be ruled out, and whether the recording resembles those of the training."""

    error_rate: float
    """Share of recordings whose `prediction_set` may miss the true class, and of those wrongly called unknown."""
    prediction_set: tuple[str, ...]
    """Classes that cannot be ruled out at the error rate, likeliest first; never empty."""
    plausibility: Mapping[str, float]
    """Conformal p-value of each class."""
    scarce_classes: tuple[str, ...]
    """Classes whose p-value is taken among the validation recordings of all of them together, since some have too few
    for the error rate; that of each other class is taken among its recordings alone."""
    unknown: bool
    """Whether the recording does not resemble the training recordings; its class is then only the nearest one."""
    ood_p_value: float
    """Conformal p-value of resembling them; the recording is unknown where it is at most the error rate."""
    ood_score: float
    """Out-of-distribution score of the recording (`TrainingReference.ood_score`); above 1 for about one in ten of
    those like the training."""
    ood_threshold: float
    """Score beyond which a recording is called unknown."""
    reasons: tuple[str, ...]
    """What of the recording is outside the training's range, in words: the operating condition, then the most
    unusual of gain, noise floor, level and lines of each channel. None where all are within."""
    n_validation: int
    """Number of validation recordings."""
    cross_fitted: bool
    """Whether these are the recordings of the training, each answered by models trained without it, rather than
    recordings held out."""
    basis: str
    """The same in words."""

    def to_dict(self) -> dict[str, Any]:
        """The same as JSON can hold it."""
        return {
            **asdict(self),
            "prediction_set": list(self.prediction_set),
            "plausibility": dict(self.plausibility),
            "scarce_classes": list(self.scarce_classes),
            "reasons": list(self.reasons),
        }

    def sentence(self) -> str:
        """The same in words."""
        rate = f"{100 * self.error_rate:.3g} %"
        if self.unknown:
            return (
                f"Unknown: its vibration is further from every trained class (score {self.ood_score:.3g}) "
                f"than that of all but {rate} of {self.basis} (up to "
                f"{self.ood_threshold:.3g}). The class named is only the nearest one. {self._difference()}"
            )
        if len(self.prediction_set) == 1:
            return f"No other class is plausible at an error rate of {rate}, by {self.basis}."
        names = ", ".join(name.replace("_", " ") for name in self.prediction_set)
        return (
            f"At an error rate of {rate}, by {self.basis}, it could be any of {names}: do not act on one of them alone."
        )

    def _difference(self) -> str:
        if self.reasons:
            return f"What differs most: {self.reasons[0]}"
        return (
            "Operating condition, levels, noise floors and lines are within the training's range, so the pattern "
            "itself is new, as that of a fault never trained would be."
        )


def trust_in(
    classifier: SureClassifier,
    observation: Observation,
    reasons: tuple[str, ...],
    error_rate: float | None,
) -> Trust | None:
    """Trust in the answer on one recording, or None where the classifier has no confidence.

    Parameters
    ----------
    observation : what was observed of it.
    reasons : what of it is outside the training's range.
    error_rate : of the prediction set; the classifier's own by default.
    """
    confidence, reference = classifier.confidence, classifier.training_reference
    if confidence is None or reference is None:
        return None
    probability, features = pooled_probabilities(observation.probability), observation.features
    rate = confidence.error_rate if error_rate is None else error_rate
    in_set = confidence.prediction_set(probability, len(features), rate)
    plausible = confidence.plausibility(probability, len(features), rate)
    group = confidence.class_groups(len(classifier.classes), rate)
    ood_score = reference.ood_score(
        features.mean(axis=0), specimen=observation.specimen, condition=observation.condition
    )
    ood_p_value = float(confidence.ood_p_value(np.array(ood_score)))
    return Trust(
        error_rate=rate,
        prediction_set=tuple(classifier.classes[index] for index in np.argsort(-probability) if in_set[index]),
        plausibility=dict(zip(classifier.classes, plausible.tolist(), strict=True)),
        scarce_classes=tuple(name for name, index in zip(classifier.classes, group, strict=True) if index < 0),
        unknown=ood_p_value <= rate,
        ood_p_value=ood_p_value,
        ood_score=ood_score,
        ood_threshold=_ood_threshold(confidence, rate),
        reasons=reasons,
        n_validation=confidence.n_recordings,
        cross_fitted=confidence.cross_fitted,
        basis=confidence.basis,
    )


def _ood_threshold(confidence: Confidence, rate: float) -> float:
    """Greatest score whose p-value is above `rate`: the k-th highest of the validation recordings."""
    n = confidence.n_recordings
    return float(confidence.ood_score[n - max(1, math.floor(rate * (n + 1) + 1e-9))])
