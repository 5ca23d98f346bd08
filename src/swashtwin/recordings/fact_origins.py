"""Facts of a proposed index and where each comes from: the files, their names, a table, or an option."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from swashtwin.recordings.formats.raw import RawFile

_FIRST = ("label", "specimen", "speed", "discharge_pressure", "sample_rate", "unit", "channels")
"""Facts that are listed before the others."""
_FLAG = "the option"
_MOST = 6
"""Values that a sentence lists."""

Facts = dict[str, tuple[str, str]]
"""Value and origin of each fact of one file."""


def facts_of(
    name: str,
    raw: RawFile,
    columns: Iterable[str],
    entry: Mapping[str, Any],
    defaults: Mapping[str, Any],
    *,
    pattern: str | None,
    table: bool,
    in_file: Iterable[str],
) -> Facts:
    """Value and origin of each fact that the entry of a file will have."""
    origin = "the table" if table else "the pattern" if pattern else "its name"
    facts: Facts = {key: (_words(value), _FLAG) for key, value in defaults.items()}
    facts |= {key: (_words(value), origin) for key, value in entry.items() if key not in ("attributes", "id", "sha256")}
    facts |= {f"attribute {key}": (str(value), origin) for key, value in entry.get("attributes", {}).items()}
    facts |= {key: (facts[key][0], "the file") for key in in_file}
    folder = Path(name).parent.name
    if "label" in entry and origin == "its name" and folder and not re.search(r"\d", folder):
        facts["label"] = (str(entry["label"]), "the folder's name")
    columns = list(columns)
    rates = {raw.rates.get(column, raw.sample_rate) for column in columns} - {None}
    if len(rates) == 1:
        facts["sample_rate"] = (f"{rates.pop():.10g} Hz", "the file")
    units = {raw.units[column] for column in columns if column in raw.units}
    if len(units) == 1 and "unit" not in defaults:
        facts["unit"] = (units.pop(), "the file")
    if raw.facts.get("label"):
        facts["label"] = (raw.facts["label"], "the file")
    facts.setdefault("channels", (", ".join(columns), "the file"))
    return facts


def sentences(files: Iterable[Facts], defaults: Mapping[str, Any]) -> tuple[str, ...]:
    """One sentence for each fact: its values with their number of files, the origins, and where a flag is overruled."""
    counts: dict[str, Counter[tuple[str, str]]] = {}
    for facts in files:
        for key, pair in facts.items():
            counts.setdefault(key, Counter())[pair] += 1
    order = [key for key in _FIRST if key in counts] + sorted(set(counts) - set(_FIRST))
    return tuple(f"{key}: {_sentence(counts[key])}{_overruled(counts[key], defaults.get(key))}" for key in order)


def _words(value: Any) -> str:
    """A value as people write it: a list with commas."""
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _overruled(counts: Counter[tuple[str, str]], flag: Any) -> str:
    """In how many files a flag's value is overruled by the file."""
    overruled = sum(count for (_, origin), count in counts.items() if origin != _FLAG)
    if flag is None or not overruled:
        return ""
    gives_way = f"gives way in {overruled} of {counts.total()} files"
    return f"; the option's {_words(flag)} {gives_way} (edit the index where they are wrong)"


def _sentence(counts: Counter[tuple[str, str]]) -> str:
    parts = []
    for origin in dict.fromkeys(origin for _, origin in counts):
        values = [(value, count) for (value, source), count in counts.items() if source == origin]
        listed = ", ".join(f"{value} ({count})" for value, count in values[:_MOST])
        more = f" and {len(values) - _MOST} more" if len(values) > _MOST else ""
        parts.append(f"{listed}{more}, says {origin}")
    return "; ".join(parts)
