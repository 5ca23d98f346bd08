"""Cards of saved models with a right checksum and wrong contents: each must be refused in one line."""

import json
from collections.abc import Callable, Iterator
from typing import Any

Change = Callable[[dict[str, Any]], object]

_PATHS: tuple[tuple[str, ...], ...] = (
    ("network",), ("network", "name"), ("network", "settings"), ("network", "settings", "n_channels"),
    ("network", "settings", "n_classes"), ("network", "settings", "channels"), ("classes",), ("layout",),
    ("layout", "sample_rate"), ("layout", "channels"), ("layout", "unit"), ("layout", "length"), ("normalization",),
    ("settings",), ("seed",), ("history",), ("manifest",), ("pressures",), ("speeds",),
)  # fmt: skip
_VALUES: dict[str, Any] = {
    "missing": None, "nothing": None, "truth": True, "text": "x" * 100_000, "list": [[[]]], "object": {"a": {"b": 1}},
    "negative": -3, "fraction": 0.5, "huge": 10**12,
}  # fmt: skip
_FITTING = {
    ("truth", ("seed",)), ("negative", ("seed",)), ("huge", ("seed",)), ("huge", ("layout", "sample_rate")),
    ("fraction", ("layout", "sample_rate")), ("text", ("layout", "unit")), ("huge", ("layout", "length")),
}  # fmt: skip
"""Values that a card may have."""


def hostile_cards(card: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, card) of each: another type, size or text in each place, and contradictions between places."""
    for path in _PATHS:
        for name, value in _VALUES.items():
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
    for name, change in _CONTRADICTIONS.items():
        changed = json.loads(json.dumps(card))
        change(changed)
        yield name, changed


_CONTRADICTIONS: dict[str, Change] = {
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
    "settings million layers": lambda card: card["network"]["settings"].update(channels=[1] * 1_000_000),
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
    "reference uneven": lambda card: card["training_reference"]["label"].append("more"),
    "confidence without scores": lambda card: card.update(confidence={"temperature": 1.0, "error_rate": 0.1}),
    "confidence empty": lambda card: card.update(confidence={}),
    "foreign entry": lambda card: card.update(foreign=1),
}  # fmt: skip
