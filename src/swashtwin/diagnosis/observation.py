"""What a verdict on one recording, and the trust in it, rest on."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning import DiagnosingClassifier, WindowSet, signal_facts


@dataclass(frozen=True, eq=False)
class Observation:
    """Answers to the windows of one recording, and its plain facts."""

    probability: Float[np.ndarray, "window class"]
    """Of each class, of each window."""
    features: Float[np.ndarray, "window feature"]
    """Levels of each window (`DiagnosingClassifier.answer`)."""
    facts: Float64[np.ndarray, "channel fact"]
    """Mean of `signal_facts` over the windows."""
    specimen: str
    """Machine; empty where not stated."""
    condition: Float64[np.ndarray, " quantity"]
    """Speed [rad/s] and discharge pressure [Pa]; NaN where not stated."""


def observe(classifier: DiagnosingClassifier, parts: Iterable[WindowSet]) -> Observation:
    """Observation of one recording, whose windows come in parts."""
    answers, facts = [], []
    for windows in parts:
        answers.append(classifier.answer(windows))
        facts.append(signal_facts(windows))
    probability, features = (np.concatenate(part) for part in zip(*answers, strict=True))
    return Observation(
        probability=probability,
        features=features,
        facts=np.concatenate(facts).mean(axis=0),
        specimen=str(windows.specimen[0]),
        condition=windows.condition(0),
    )
