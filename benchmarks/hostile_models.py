"""Saved models whose card or weights were changed and sealed again with a right checksum, and trainings in threads."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from hostile_files import MEMORY_KB, Report, peak_memory

from swashtwin.diagnosis import load_classifier, save_classifier
from swashtwin.foundation import SwashTwinError, read_artifact, write_artifact
from swashtwin.learning import (
    BiTCN,
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    cross_fitted_confidence,
    cut_windows,
    fit,
)
from swashtwin.recordings import Recording

Change = Callable[[dict[str, Any]], object]
VERSION = 4
"""Of the files of saved models."""

_PATHS: tuple[tuple[str, ...], ...] = (
    ("network",), ("network", "name"), ("network", "settings"), ("network", "settings", "n_channels"),
    ("network", "settings", "n_classes"), ("network", "settings", "channels"), ("classes",), ("layout",),
    ("layout", "sample_rate"), ("layout", "channels"), ("layout", "unit"), ("layout", "length"), ("normalization",),
    ("settings",), ("seed",), ("history",), ("manifest",), ("pressures",), ("speeds",), ("confidence", "temperature"),
    ("confidence", "dependence"), ("confidence", "listening_windows"), ("confidence", "error_rate"),
    ("confidence", "cross_fitted"),
)  # fmt: skip
_TYPES: dict[str, Any] = {
    "missing": None, "nothing": None, "truth": True, "text": "x" * 100_000, "list": [[[]]], "object": {"a": {"b": 1}},
    "negative": -3, "fraction": 0.5, "huge": 10**12,
}  # fmt: skip
_FITTING = {
    ("truth", ("seed",)), ("negative", ("seed",)), ("huge", ("seed",)), ("huge", ("layout", "sample_rate")),
    ("fraction", ("layout", "sample_rate")), ("text", ("layout", "unit")), ("huge", ("layout", "length")),
    ("fraction", ("confidence", "temperature")), ("huge", ("confidence", "temperature")),
    ("fraction", ("confidence", "dependence")), ("fraction", ("confidence", "error_rate")),
    ("truth", ("confidence", "cross_fitted")),
}  # fmt: skip
"""Values that a card may have."""


def hostile_cards(card: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, card) of each: another type, size or text in each place, and contradictions between places."""
    for path in _PATHS:
        for name, value in _TYPES.items():
            if (name, path) in _FITTING:
                continue
            changed = json.loads(json.dumps(card))
            inner = changed
            for key in path[:-1]:
                inner = inner[key]
            if name == "missing":
                del inner[path[-1]]
            else:
                inner[path[-1]] = value
            yield f"{'.'.join(path)} {name}", changed
    for name, change in CONTRADICTIONS.items():
        changed = json.loads(json.dumps(card))
        change(changed)
        yield name, changed


CONTRADICTIONS: dict[str, Change] = {
    "classes twice": lambda card: card.update(classes=[card["classes"][0]] * len(card["classes"])),
    "classes more": lambda card: card["classes"].append("more"),
    "classes none": lambda card: card.update(classes=[]),
    "channels more": lambda card: card["layout"]["channels"].append("more"),
    "channels none": lambda card: card["layout"].update(channels=[]),
    "length one": lambda card: card["layout"].update(length=1),
    "rate zero": lambda card: card["layout"].update(sample_rate=0),
    "network unknown": lambda card: card["network"].update(name="unknown"),
    "network another": lambda card: card["network"].update(name="lstm"),
    "settings foreign": lambda card: card["network"]["settings"].update(foreign=1),
    "settings 11 GB": lambda card: card["network"]["settings"].update(channels=[50_000, 50_000]),
    "settings 100,000 layers": lambda card: card["network"]["settings"].update(channels=[1] * 100_000),
    "settings wider": lambda card: card["network"]["settings"].update(channels=[16, 16]),
    "settings kernel": lambda card: card["network"]["settings"].update(kernel_size=9),
    "settings nested": lambda card: card["network"]["settings"].update(channels=[[8], [12]]),
    "settings text": lambda card: card["network"]["settings"].update(channels="many"),
    "settings NaN": lambda card: card["network"]["settings"].update(dropout=float("nan")),
    "settings infinity": lambda card: card["network"]["settings"].update(dropout=float("inf")),
    "dropout above one": lambda card: card["network"]["settings"].update(dropout=1.5),
    "epochs none": lambda card: card["settings"].update(epochs=0),
    "epochs text": lambda card: card["settings"].update(epochs="many"),
    "rate of learning negative": lambda card: card["settings"].update(learning_rate=-1.0),
    "training foreign": lambda card: card["settings"].update(foreign=1),
    "history foreign": lambda card: card["history"].append({"foreign": 1}),
    "history text": lambda card: card["history"][0].update(loss="low"),
    "normalization unknown": lambda card: card.update(normalization="sideways"),
    "manifest numbers": lambda card: card.update(manifest={"a": [1]}),
    "pressures text": lambda card: card.update(pressures=["high"]),
    "speeds NaN": lambda card: card.update(speeds=[float("nan")]),
    "reference too short": lambda card: card["training_reference"].update(recording_id=["a"], label=["b"]),
    "reference without machines": lambda card: card["training_reference"].update(specimen=[]),
    "reference with one scale": lambda card: card["training_reference"].update(distance_scales=[1.0]),
    "reference with a scale of nothing": lambda card: card["training_reference"].update(distance_scales=[0.0, 1.0]),
    "reference uneven": lambda card: card["training_reference"]["label"].append("more"),
    "confidence empty": lambda card: card.update(confidence={}),
    "confidence by more windows": lambda card: card["confidence"].update(listening_windows=[1, 2, 3, 4]),
    "confidence by windows descending": lambda card: card["confidence"].update(listening_windows=[2, 1]),
    "confidence at a smaller rate": lambda card: card["confidence"].update(error_rate=0.01),
    "dependence above one": lambda card: card["confidence"].update(dependence=1.5),
    "temperature zero": lambda card: card["confidence"].update(temperature=0.0),
    "fewer classes than the confidence": lambda card: card.update(classes=card["classes"][:1]),
    "foreign entry": lambda card: card.update(foreign=1),
}  # fmt: skip

_VALUES: tuple[Any, ...] = (
    None, -1, 0, 10**9, 10**18, 1e308, "x", "", [], {}, [[]], True, "\x1b[2J", {"a": {"b": []}}, ["x"] * 1000,
)  # fmt: skip


def with_confidence(classifier: FittedClassifier) -> FittedClassifier:
    """The same classifier with a confidence by ten recordings of three windows."""
    probability, target = np.tile([[0.8, 0.2], [0.3, 0.7]], (15, 1)), np.arange(30) // 3 % 2
    confidence = cross_fitted_confidence(probability, np.arange(30) // 3, target, np.arange(10.0))
    return replace(classifier, confidence=confidence)


def _windows() -> WindowSet:
    draw = np.random.default_rng(0)
    recordings = [
        Recording(scale * draw.normal(size=(1, 160)), 1e3, f"{label}{number}", label=label)
        for label, scale in (("normal", 1.0), ("piston", 3.0))
        for number in range(2)
    ]
    return cut_windows(recordings, length=80)


def _trained(seed: int) -> FittedClassifier:
    network = BiTCN(1, 2, channels=(8, 12), kernel_size=3)
    classifier = fit(network, _windows(), settings=TrainingSettings(epochs=1, batch_size=4), seed=seed)
    return with_confidence(classifier)


def models(name: str, first: int, count: int, seed: int, folder: Path, report: Report) -> None:
    """Tell the outcome of each hostile model, first of `hostile_cards`, then of changes drawn at random.

    The former must be refused. The latter may also give finite probabilities.
    """
    path, windows = save_classifier(_trained(0), folder / "model.safetensors"), _windows()
    cards = list(hostile_cards(read_artifact(path, "classifier", VERSION, advice="")[0]))
    for number in range(first, first + count):
        card, tensors = read_artifact(path, "classifier", VERSION, advice="")
        if number < len(cards):
            change, card = cards[number]
        else:
            change = _change_at_random(card, tensors, np.random.default_rng([seed, number]))
        write_artifact(folder / "h.safetensors", "classifier", VERSION, card, tensors, may_be_nan=None)
        before = peak_memory()
        try:
            probabilities = load_classifier(folder / "h.safetensors").predict_proba(windows)
            kind, said = ("read", "") if np.isfinite(probabilities).all() else ("wrong_samples", "not finite")
            if number < len(cards):
                kind, said = "wrong_samples", "loaded"
        except SwashTwinError as error:
            kind, said = ("two_lines" if "\n" in str(error) else "refused"), str(error)
        except Exception as error:  # what is looked for
            kind, said = "exception", f"{type(error).__name__}: {error}"
        if peak_memory() - before > MEMORY_KB:
            kind, said = "exception", f"{peak_memory() - before} KiB taken"
        report(number, kind, f"{change}: {said}"[:300])


def _paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Way to each value within a card."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for key, inner in items:
        yield from _paths(inner, (*path, key))


def _change_at_random(card: dict[str, Any], tensors: dict[str, Any], rng: np.random.Generator) -> str:
    """What was changed of a card, or of the weights, in a way that no honest writer does."""
    draw = rng.random()
    if draw < 0.2:
        name = str(rng.choice(sorted(tensors)))
        value = tensors[name]
        kind = int(rng.integers(4))
        if kind == 0:
            del tensors[name]
        elif kind == 1:
            tensors[name] = torch.zeros(3, 1, 2)
        elif kind == 2:
            tensors[name] = torch.full_like(value.to(torch.float32), torch.nan)
        else:
            tensors[name] = value.to(torch.int8)
        return f"tensor {name} {kind}"
    ways = list(_paths(card))
    way = ways[int(rng.integers(len(ways)))]
    holder = card
    for key in way[:-1]:
        holder = holder[key]
    if draw < 0.35 and isinstance(holder, dict):
        del holder[way[-1]]
        return f"no {way}"
    value = _VALUES[int(rng.integers(len(_VALUES)))]
    holder[way[-1]] = value
    return f"{way} = {str(value)[:40]}"


def threads(name: str, first: int, count: int, seed: int, folder: Path, report: Report) -> None:
    """Tell whether each training in one of `count` threads gives the bits of the same training by itself."""
    windows = _windows()

    def probabilities(number: int) -> bytes:
        return _trained(number).predict_proba(windows).tobytes()

    numbers = range(first, first + count)
    alone = [probabilities(number) for number in numbers]
    with ThreadPoolExecutor(count) as pool:
        together = list(pool.map(probabilities, numbers))
    for number, single, other in zip(numbers, alone, together, strict=True):
        report(number, "same" if single == other else "wrong_samples", "")
