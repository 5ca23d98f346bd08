"""Facts that a proposed index states, listed for its user to check."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

from swashtwin.recordings.findings import join_names

Facts = dict[str, tuple[str, str]]
"""Value and origin of each fact of one file."""

# Facts that are listed before the others.
_FIRST_FACTS = ("label", "specimen", "speed", "pressure", "sample_rate", "unit", "channels")

# Values of a fact that are listed.
_MAX_LISTED_VALUES = 6


def describe_facts(files: Iterable[Facts]) -> tuple[str, ...]:
    """Return one line for each fact: its values with their number of files, by origin."""
    counts: dict[str, dict[str, Counter[str]]] = {}
    for facts in files:
        for key, (value, origin) in facts.items():
            counts.setdefault(key, {}).setdefault(origin, Counter())[value] += 1

    lines = []
    for key in sorted(counts, key=_fact_order):
        parts = []
        for origin, values in counts[key].items():
            texts = [f"{value} ({count})" for value, count in values.items()]
            parts.append(f"{join_names(texts, _MAX_LISTED_VALUES)}, from {origin}")
        lines.append(f"{key}: {'; '.join(parts)}")
    return tuple(lines)


def _fact_order(key: str) -> tuple[int, str]:
    if key in _FIRST_FACTS:
        return _FIRST_FACTS.index(key), key
    return len(_FIRST_FACTS), key


def value_text(value: Any) -> str:
    """Return the value of a fact as text, that of a list with commas."""
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
