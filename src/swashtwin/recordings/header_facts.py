"""What a proposed index says, and who says it: the files, their names, a table, or whoever asked."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from swashtwin.recordings.formats.raw import RawFile

_GUESSED = ("label", "specimen", "speed", "discharge_pressure", "sample_rate", "unit", "channels")
_FLAG = "the flag"
_MOST = 6
"""Values that a sentence lists."""

Said = dict[str, tuple[str, str]]
"""Value and origin of each fact of one file."""


def facts_said(
    name: str,
    raw: RawFile,
    chosen: Iterable[str],
    fact: Mapping[str, Any],
    defaults: Mapping[str, Any],
    *,
    pattern: str | None,
    table: bool,
) -> Said:
    """Value and origin of each fact that the entry of a file will have."""
    by_name = "the table" if table else "the pattern" if pattern else "its name"
    said: Said = {key: (str(value), _FLAG) for key, value in defaults.items()}
    said |= {key: (str(value), by_name) for key, value in fact.items() if key not in ("attributes", "id", "sha256")}
    said |= {f"attribute {key}": (str(value), by_name) for key, value in fact.get("attributes", {}).items()}
    folder = Path(name).parent.name
    if "label" in fact and by_name == "its name" and folder and not re.search(r"\d", folder):
        said["label"] = (str(fact["label"]), "the folder's name")
    own, columns = raw.recording, list(chosen)
    rates = {raw.rates.get(column, raw.sample_rate) for column in columns} - {None}
    if len(rates) == 1:
        said["sample_rate"] = (f"{rates.pop():.10g} Hz", "the file")
    units = {raw.units[column] for column in columns if column in raw.units}
    if len(units) == 1 and "unit" not in defaults:
        said["unit"] = (units.pop(), "the file")
    if own is not None and own.label:
        said["label"] = (own.label, "the file")
    said.setdefault("channels", (", ".join(columns), "the file"))
    return said


def sentences(said: Iterable[Said], defaults: Mapping[str, Any]) -> tuple[str, ...]:
    """For each fact one sentence: its values with their number of files, who says so, and where a flag gave way."""
    counts: dict[str, Counter[tuple[str, str]]] = {}
    for facts in said:
        for key, pair in facts.items():
            counts.setdefault(key, Counter())[pair] += 1
    order = [key for key in _GUESSED if key in counts] + sorted(set(counts) - set(_GUESSED))
    return tuple(f"{key}: {_sentence(counts[key])}{_overruled(counts[key], defaults.get(key))}" for key in order)


def _overruled(counts: Counter[tuple[str, str]], flag: Any) -> str:
    """What becomes of a flag's value where files say another themselves."""
    gone = sum(count for (_, origin), count in counts.items() if origin != _FLAG)
    if flag is None or not gone:
        return ""
    return f"; the flag's {flag} gives way in {gone} of {counts.total()} files (edit the index where they are wrong)"


def _sentence(counts: Counter[tuple[str, str]]) -> str:
    parts = []
    for origin in dict.fromkeys(origin for _, origin in counts):
        own = [(value, count) for (value, source), count in counts.items() if source == origin]
        listed = ", ".join(f"{value} ({count})" for value, count in own[:_MOST])
        more = f" and {len(own) - _MOST} more" if len(own) > _MOST else ""
        parts.append(f"{listed}{more}, says {origin}")
    return "; ".join(parts)
