"""How far the answer on one recording can be trusted, by what the classifier learnt from validation recordings."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.learning import Confidence, SureClassifier


@dataclass(frozen=True)
class Trust:
    """The classes that cannot be ruled out, and whether the recording is like any that was trained on."""

    error_rate: float
    """Share of recordings whose `prediction_set` may miss the true class, and of those wrongly called unknown."""
    prediction_set: tuple[str, ...]
    """Classes that cannot be ruled out at the error rate, likeliest first; never empty."""
    plausibility: Mapping[str, float]
    """Conformal p-value of each class."""
    unknown: bool
    """Whether the recording is unlike those that were trained on; its class is then a guess among wrong answers."""
    familiarity: float
    """Conformal p-value of being like them; unknown where it is at most the error rate."""
    strangeness: float
    """How unlike the known classes it is (`KnownRecordings.strangeness`); only its order means anything."""
    usual_strangeness: float
    """Strangeness beyond which a recording is called unknown."""
    n_validation: int
    """Validation recordings that all this rests on."""

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        return {**asdict(self), "prediction_set": list(self.prediction_set), "plausibility": dict(self.plausibility)}

    def sentence(self) -> str:
        """The same in words."""
        rate = f"{100 * self.error_rate:.3g} %"
        if self.unknown:
            return (
                f"Unknown: its vibration is stranger to every known class (relative distance {self.strangeness:.3g}) "
                f"than that of all but {rate} of {self.n_validation} validation recordings (up to "
                f"{self.usual_strangeness:.3g}). The class named is the nearest of wrong answers unless the pump, the "
                "sensors or the condition are what differs."
            )
        if len(self.prediction_set) == 1:
            return f"No other class is plausible at an error rate of {rate}."
        names = ", ".join(name.replace("_", " ") for name in self.prediction_set)
        return f"At an error rate of {rate} it could be any of {names}: do not act on one of them alone."


def trust_in(
    classifier: SureClassifier,
    probability: Float[np.ndarray, " class"],
    features: Float[np.ndarray, "window feature"],
    error_rate: float | None,
) -> Trust | None:
    """Trust in the answer on one recording, or None where the classifier was not taught any.

    Parameters
    ----------
    probability : of each class, pooled over the windows, before the temperature.
    features : of each window.
    error_rate : another one than the classifier was taught.
    """
    confidence, known = classifier.confidence, classifier.known
    if confidence is None or known is None:
        return None
    rate = confidence.error_rate if error_rate is None else error_rate
    chosen, plausible = confidence.prediction_set(probability, rate), confidence.plausibility(probability)
    strangeness = known.strangeness(features.mean(axis=0))
    familiarity = float(confidence.familiarity(np.array(strangeness)))
    return Trust(
        error_rate=rate,
        prediction_set=tuple(classifier.classes[index] for index in np.argsort(-probability) if chosen[index]),
        plausibility=dict(zip(classifier.classes, plausible.tolist(), strict=True)),
        unknown=familiarity <= rate,
        familiarity=familiarity,
        strangeness=strangeness,
        usual_strangeness=_usual(confidence, rate),
        n_validation=confidence.n_recordings,
    )


def _usual(confidence: Confidence, rate: float) -> float:
    """Greatest strangeness whose familiarity is above `rate`: that of the k-th strangest validation recording."""
    n = confidence.n_recordings
    return float(confidence.strangeness[n - max(1, math.floor(rate * (n + 1) + 1e-9))])
