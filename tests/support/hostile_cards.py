"""Cards of saved models with a wrong type, size or text in each place, and contradictions between
places.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from swashtwin.learning import FittedClassifier, cross_fitted_confidence

Change = Callable[[dict[str, Any]], object]
VERSION = 12
"""Of the files of saved models."""

_PATHS: tuple[tuple[str, ...], ...] = (
    ("network",),
    ("network", "name"),
    ("network", "settings"),
    ("network", "settings", "n_channels"),
    ("network", "settings", "n_classes"),
    ("network", "settings", "channels"),
    ("classes",),
    ("layout",),
    ("layout", "sample_rate"),
    ("layout", "channels"),
    ("layout", "unit"),
    ("layout", "length"),
    ("normalization",),
    ("settings",),
    ("seed",),
    ("history",),
    ("manifest",),
    ("pressures",),
    ("speeds",),
    ("confidence", "temperature"),
    ("confidence", "dependence"),
    ("confidence", "listening_windows"),
    ("confidence", "error_rate"),
    ("confidence", "cross_fitted"),
    ("confidence", "n_machines"),
)
_TYPES: dict[str, Any] = {
    "missing": None,
    "nothing": None,
    "truth": True,
    "text": "x" * 100_000,
    "list": [[[]]],
    "object": {"a": {"b": 1}},
    "negative": -3,
    "fraction": 0.5,
    "huge": 10**12,
}
_FITTING = {
    ("truth", ("seed",)),
    ("negative", ("seed",)),
    ("huge", ("seed",)),
    ("huge", ("layout", "sample_rate")),
    ("fraction", ("layout", "sample_rate")),
    ("text", ("layout", "unit")),
    ("huge", ("layout", "length")),
    ("fraction", ("confidence", "temperature")),
    ("huge", ("confidence", "temperature")),
    ("fraction", ("confidence", "dependence")),
    ("fraction", ("confidence", "error_rate")),
    ("truth", ("confidence", "cross_fitted")),
    ("huge", ("confidence", "n_machines")),
}
"""Values that a card may have."""


def hostile_cards(card: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, card) of each: another type, size or text in each place, and contradictions between
    places.
    """
    for path in _PATHS:
        for name, value in _TYPES.items():
            if (name, path) in _FITTING:
                continue
            changed = json.loads(json.dumps(card))
            inner = reduce(getitem, path[:-1], changed)
            inner[path[-1]] = value
            if name == "missing":
                del inner[path[-1]]
            yield f"{'.'.join(path)} {name}", changed

    for name, change in CONTRADICTIONS.items():
        changed = json.loads(json.dumps(card))
        change(changed)
        yield name, changed


CONTRADICTIONS: dict[str, Change] = {
    "classes twice": lambda card: card.update(classes=[card["classes"][0]] * len(card["classes"])),
    "classes none": lambda card: card.update(classes=[]),
    "channels more": lambda card: card["layout"]["channels"].append("more"),
    "channels none": lambda card: card["layout"].update(channels=[]),
    "length one": lambda card: card["layout"].update(length=1),
    "rate zero": lambda card: card["layout"].update(sample_rate=0),
    "network unknown": lambda card: card["network"].update(name="unknown"),
    "network another": lambda card: card["network"].update(name="lstm"),
    "settings foreign": lambda card: card["network"]["settings"].update(foreign=1),
    "settings 11 GB": lambda card: card["network"]["settings"].update(channels=[50_000, 50_000]),
    "settings 100,000 layers": lambda card: card["network"]["settings"].update(
        channels=[1] * 100_000
    ),
    "settings wider": lambda card: card["network"]["settings"].update(channels=[16, 16]),
    "settings kernel": lambda card: card["network"]["settings"].update(kernel_size=9),
    "settings NaN": lambda card: card["network"]["settings"].update(dropout=float("nan")),
    "dropout above one": lambda card: card["network"]["settings"].update(dropout=1.5),
    "epochs none": lambda card: card["settings"].update(epochs=0),
    "rate of learning negative": lambda card: card["settings"].update(learning_rate=-1.0),
    "history foreign": lambda card: card["history"].append({"foreign": 1}),
    "normalization unknown": lambda card: card["normalization"].update(kind="sideways"),
    "speeds NaN": lambda card: card.update(speeds=[float("nan")]),
    "reference too short": lambda card: card["training_reference"].update(
        recording_id=["a"], label=["b"]
    ),
    "reference without machines": lambda card: card["training_reference"].update(specimen=[]),
    "reference with one scale": lambda card: card["training_reference"].update(
        distance_scales=[1.0]
    ),
    "reference with a scale of nothing": lambda card: card["training_reference"].update(
        distance_scales=[0.0, 1.0]
    ),
    "confidence empty": lambda card: card.update(confidence={}),
    "confidence by more windows": lambda card: card["confidence"].update(
        listening_windows=[1, 2, 3, 4]
    ),
    "confidence by windows descending": lambda card: card["confidence"].update(
        listening_windows=[2, 1]
    ),
    "confidence at a smaller rate": lambda card: card["confidence"].update(error_rate=0.01),
    "dependence above one": lambda card: card["confidence"].update(dependence=1.5),
    "temperature zero": lambda card: card["confidence"].update(temperature=0.0),
    "fewer classes than the confidence": lambda card: card.update(classes=card["classes"][:1]),
}


def with_confidence(classifier: FittedClassifier) -> FittedClassifier:
    """The same classifier with a confidence by ten recordings of three windows."""
    probability = np.tile([[0.8, 0.2], [0.3, 0.7]], (15, 1))
    target = np.arange(30) // 3 % 2
    confidence = cross_fitted_confidence(probability, np.arange(30) // 3, target, np.arange(10.0))
    return replace(classifier, confidence=confidence)
