"""Facts that people write into file names, tables and headers, as keys of an index entry."""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Set
from dataclasses import fields
from pathlib import Path
from typing import Any

import regex

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    UnitError,
    parse_quantity,
    read_text,
)
from swashtwin.pump import is_healthy
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.files import stem_of
from swashtwin.recordings.formats.headings import (
    GROUPED,
    parse_header,
    shows_decimal_comma,
    split_unit,
)
from swashtwin.recordings.formats.raw_file import RawFile
from swashtwin.recordings.formats.sample_units import normalize_unit

PRESSURES = ("pressure", "suction_pressure", "case_pressure")
"""Keys whose bare numbers have no usual unit: MPa and bar are both in use."""
_BARE_UNITS = {"speed": "rpm", "sample_rate": "Hz", "resample": "Hz", "oil_temperature": "degC"}
_GROUPS = {"discharge_pressure": "pressure", "temperature": "oil_temperature"}
"""Other names of keys that a pattern or a table may use."""
_PRESSURE_UNIT = r"(?:MPa|kPa|hPa|mbar|bar|psi)"
_SPEED_UNIT = r"(?:rpm|r_min|U_min|1_min|min-1|Upm)"
_UNITS_OF = dict.fromkeys(PRESSURES, _PRESSURE_UNIT)
_UNITS_OF |= {
    "speed": rf"(?:{_SPEED_UNIT}|Hz)",
    "sample_rate": "k?Hz",
    "resample": "k?Hz",
    "oil_temperature": "degC|°C",
}
_NUMBER = r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"
_IN_NAMES = {
    "speed": rf"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _-]?({_SPEED_UNIT})(?![A-Za-z])",
    "pressure": rf"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _-]?({_PRESSURE_UNIT})(?![A-Za-z])",
}
_IN_HEADERS = {
    "speed": r"drehzahl|(?:shaft|rotational|motor|pump)[ _]?speed|^speed|rpm$|^rpm",
    "pressure": r"^(?:discharge|outlet|high|system)?[ _-]?pressure|(?:förder|hoch|betriebs|^)druck",
    "oil_temperature": r"oil[ _-]?temp|öltemp",
}
_OTHER_THING = re.compile(
    r"[\W_](?!pump|shaft|welle|motor|actual|ist\b|mean)[a-zäöüß]", re.IGNORECASE
)
"""A word after that of a quantity, such as sensor or channel, whose number is none of the
quantity.
"""
_ENTRY_KEYS = {field.name for field in fields(Entry)}
_LEAST_PRESSURE = 2e5
"""What a header calls a pressure is that of the air below this [Pa]."""
_PATIENCE = 1.0
"""Seconds that a pattern may search in one path."""


def parse_path_facts(name: str, pattern: str | None) -> tuple[dict[str, Any], Set[str]]:
    """(facts that a file's relative path states, keys of those that the pattern found).

    Speed and pressure with their units, and a machine, are read in any case.

    Parameters
    ----------
    pattern : regular expression whose named groups are facts, which count for more; without it the
        label is the folder's name or the words of the file name.
    """
    path = Path(name)
    texts, words = {}, stem_of(path)
    for key, expression in _IN_NAMES.items():
        if match := regex.search(expression, name, regex.IGNORECASE):
            texts[key] = f"{match[1]} {match[2]}"
            words = regex.sub(expression, " ", words, flags=regex.IGNORECASE)
    if machine := next((part for part in path.parent.parts if _MACHINE.fullmatch(part)), None):
        texts["specimen"] = machine
    elif (match := _MACHINE_IN_NAME.search(words)) and match[0] != words.strip("_-. "):
        texts["specimen"] = match[0]
        words = words.replace(match[0], " ")
    if pattern is not None:
        found, beside = _matched(name, pattern)
        return parse_fact_texts({**texts, **found}, beside), found.keys()
    parts = [word for word in re.split(r"[_\-\s.]+", words) if word and not re.search(r"\d", word)]
    parts = parts[1:] if len(parts) > 1 and parts[0] == machine else parts
    parent = path.parent.name
    is_class = bool(parent) and not re.search(r"\d", parent) and parent != machine
    return parse_fact_texts(
        {"label": parent if is_class else "_".join(parts), **texts}
    ), frozenset()


def _matched(name: str, pattern: str) -> tuple[dict[str, str], dict[str, str]]:
    """Text of each named group that was found, and the unit beside it."""
    try:
        match = regex.search(pattern, name, timeout=_PATIENCE)
    except regex.error as cause:
        raise InputError(
            f"label_pattern {pattern!r} is not a regular expression: {cause}."
        ) from cause
    except TimeoutError as cause:
        raise InputError(
            f"label_pattern {pattern!r} takes too long on {name!r}; a repetition within a repetition, such as (a+)+, "
            "does this."
        ) from cause
    if match is None:
        raise DataError(
            f"{name} does not match label_pattern {pattern!r}; correct it, or narrow include."
        )
    texts = {_GROUPS.get(group, group): text for group, text in match.groupdict().items() if text}
    beside: dict[str, str] = {}
    for group in match.groupdict():
        if units := _UNITS_OF.get(key := _GROUPS.get(group, group)):
            after = regex.match(
                rf"[ _-]?({units})(?![A-Za-z])", name[match.end(group) :], regex.IGNORECASE
            )
            before = regex.search(
                rf"(?<![A-Za-z])({units})[ _-]?$", name[: match.start(group)], regex.IGNORECASE
            )
            if unit := after or before:
                beside[key] = unit[1]
    return texts, beside


def read_fact_table(
    folder: Path, table: Path, columns: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Facts of each file below `folder` that a table names, by the file's path relative to it.

    The files are relative to the table, to `folder` or to the current folder, or are known by a
    name that occurs once.
    """
    if not table.is_file():
        raise MissingFileError(f"{table} does not exist.")
    text = read_text(table)
    head = text.partition("\n")[0]
    rows = list(
        csv.DictReader(io.StringIO(text, newline=""), delimiter=max(",;\t", key=head.count))
    )
    header = [name for name in rows[0] if name] if rows else []
    columns = {_GROUPS.get(key, key): column for key, column in columns.items()}
    mapping = {"file": "file", "label": "label", **columns}
    for key, column in mapping.items():
        if column not in header:
            raise DataError(
                f"{table} has no column {column!r} for {key}; it has {', '.join(header)}."
            )
    beside = {key: unit for key, column in mapping.items() if (unit := split_unit(column)[1])}
    root = folder.resolve()
    by_name: dict[str, list[Path]] = {}
    for path in root.rglob("*"):
        by_name.setdefault(path.name, []).append(path)
    facts = {}
    for row in rows:
        file = (row[mapping["file"]] or "").strip()
        candidates = [(base / file).resolve() for base in (table.parent, folder, Path())]
        alike = by_name.get(Path(file).name, [])
        candidates += alike if len(alike) == 1 else []
        path = next((path for path in candidates if path.is_file()), candidates[0])
        if file and path.is_relative_to(root):
            cells = {
                key: (row[column] or "").strip() for key, column in mapping.items() if key != "file"
            }
            facts[path.relative_to(root).as_posix()] = parse_fact_texts(cells, beside)
    if not facts:
        raise DataError(
            f"{table} names no file below {folder}; its column {mapping['file']!r} holds paths relative to the table, "
            f"to {folder} or to the current folder, such as {rows[0][mapping['file']] if rows else ''!r}."
        )
    return facts


def parse_header_facts(raw: RawFile) -> dict[str, Any]:
    """Speed, pressure and oil temperature that header lines or single numbers state, where the file
    has no facts.
    """
    if raw.facts:
        return {}
    pairs: list[tuple[str, str]] = parse_header(raw.attributes.get("header", ""))
    pairs += [
        (name.rpartition(".")[2], text) for name, text in raw.attributes.items() if name != "header"
    ]
    texts: dict[str, str] = {}
    is_decimal = shows_decimal_comma(pairs)
    for name, text in sorted(
        pairs, key=lambda pair: "motor" in pair[0].lower()
    ):  # its speed is that of the pump, too
        heading, unit = split_unit(name)
        quantity = re.fullmatch(rf"({_NUMBER})\s*[;\t]?\s*(.*?)[;\s]*", str(text))
        if quantity and GROUPED.fullmatch(quantity[1]) and not is_decimal:
            continue  # 1,480 rpm
        for key, expression in _IN_HEADERS.items():
            match = re.search(expression, heading, re.IGNORECASE)
            if quantity is None or key in texts or match is None:
                continue
            if re.search(
                r"nominal|nenn|rated|set[ _-]?point|soll|max|limit", heading, re.IGNORECASE
            ):
                continue
            suffix = re.search(r"(rpm|hz|bar|mpa|kpa|psi)$", heading, re.IGNORECASE)
            is_bare = not (quantity[2] or unit or suffix or "rpm" in match[0].lower())
            if is_bare and _OTHER_THING.search(heading[match.end() :]):
                continue
            texts[key] = (
                f"{quantity[1]} {quantity[2] or unit or (suffix[1] if suffix else '')}".strip()
            )
    facts = parse_fact_texts(texts)
    return {
        key: text
        for key, text in facts.items()
        if (key in PRESSURES and re.fullmatch(_NUMBER, text))
        or (
            is_positive_quantity(text, key)
            and not (key == "pressure" and parse_quantity(text, "Pa") < _LEAST_PRESSURE)
        )
    }


def describe_contradictions(entry: Entry, header: Mapping[str, str]) -> str:
    """In what an entry differs by more than 3 % from the header of its file, in words; empty where
    in nothing.
    """
    stated = {key: getattr(entry, key) for key in header}
    return "; ".join(
        f"{key} = {stated[key]} is stated and counts, and the file says {text}"
        for key, text in header.items()
        if is_positive_quantity(stated[key], key)
        and not math.isclose(
            *(parse_quantity(each, QUANTITIES[key]) for each in (stated[key], text)), rel_tol=0.03
        )
    )


def is_positive_quantity(text: object, key: str) -> bool:
    """Whether a text is a quantity above zero that an entry may state under a key."""
    try:
        return parse_quantity(text, QUANTITIES[key]) > 0
    except UnitError:
        return False


def parse_fact_texts(
    texts: Mapping[str, str], beside: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Entry keys and attributes; a bare number takes the unit `beside` it, or the usual one of its
    key.

    A pressure has no usual unit, so its number stays bare.
    """
    facts: dict[str, Any] = {}
    attributes: dict[str, str] = {}
    for key, text in texts.items():
        if not text:
            continue
        if key == "channels":
            facts[key] = [part.strip() for part in text.split(";" if ";" in text else None)]
        elif key in QUANTITIES and (match := re.fullmatch(rf"({_NUMBER})\s*(.*)", text)):
            unit = match[2] or (beside or {}).get(key) or _BARE_UNITS.get(key, "")
            facts[key] = (
                f"{match[1].replace(',', '.')} {normalize_unit(unit.replace('_', '/'))}".strip()
            )
        elif key in _ENTRY_KEYS:
            facts[key] = text.strip("_-. ") if key == "label" else text
        else:
            attributes[key] = text
    return facts | ({"attributes": attributes} if attributes else {})


def pressures_without_unit(facts: Mapping[str, Any]) -> list[str]:
    """Keys of pressures without a unit."""
    return [key for key in PRESSURES if re.fullmatch(_NUMBER, str(facts.get(key, "")))]


_NUMBERED = r"(?:[ _-]?\d{1,9}|(?:[ _-]|(?<=[a-z]))[A-Z]\d{0,3})"
_MACHINE = re.compile(
    rf"(?i:pumpe?|machine|maschine|unit|sn|serial|nr|no)(?:{_NUMBERED}|[ _-][a-z])|[A-Z]\d{{0,3}}"
)
"""Names of folders, and words of classes, that stand for a machine."""
_MACHINE_IN_NAME = re.compile(
    rf"(?<![^\W_])(?i:pumpe?|machine|maschine|unit|sn|serial){_NUMBERED}(?![^\W_])"
)
"""The same in the name of a file, where a number alone may be that of the measurement."""


def move_machines_out_of_labels(entries: Iterable[dict[str, Any]]) -> list[str]:
    """Move the machine that begins each class, as ``A_normal`` and ``A_piston``, to the specimen;
    and say so.
    """
    labeled = [entry for entry in entries if "label" in entry and "specimen" not in entry]
    pairs = [str(entry["label"]).partition("_") for entry in labeled]
    are_machines = all(rest and _MACHINE.fullmatch(first) for first, _, rest in pairs)
    if len(pairs) < 2 or not are_machines or not any(is_healthy(rest) for _, _, rest in pairs):
        return []
    for entry, (first, _, rest) in zip(labeled, pairs, strict=True):
        entry |= {"specimen": first, "label": rest}
    firsts = ", ".join(sorted({first for first, _, _ in pairs}))
    return [
        f"the classes begin with {firsts}, taken for the machine (specimen); correct the index if it is not."
    ]


def find_single_label(entries: Iterable[Mapping[str, Any]]) -> str | None:
    """The class of all of several files, where it is one and not that of a healthy pump."""
    labels = [entry.get("label") for entry in entries]
    return (
        str(labels[0])
        if len(labels) > 1 and len({*labels}) == 1 and not is_healthy(labels[0])
        else None
    )


def label_hints(entries: Iterable[Mapping[str, Any]]) -> list[str]:
    """What looks odd about the labels: one for all files, and a first word that may be a
    machine.
    """
    labeled = [entry for entry in entries if "label" in entry]
    hints = []
    if only := find_single_label(labeled):
        hints.append(
            f"every file is of the class {only!r}: is that a class? --label-pattern says how paths state it."
        )
    pairs = sorted({str(entry["label"]).partition("_") for entry in labeled})
    firsts = sorted({first for first, _, _ in pairs})
    whole = len(pairs) > 1 and all(rest for _, _, rest in pairs)
    if whole and (len(firsts) == 1 or any(is_healthy(rest) for _, _, rest in pairs)):
        pattern = (
            rf"(?P<specimen>{'|'.join(map(re.escape, firsts))})[^a-zA-Z]+(?P<label>[a-zA-Z_]+)"
        )
        matches = [
            (re.search(pattern, entry["file"]), str(entry["label"]).partition("_")[2])
            for entry in labeled
        ]
        is_fit = all(match and match["label"].strip("_") == rest for match, rest in matches)
        way = f"--label-pattern '{pattern}' --force" if is_fit else "--label-pattern"
        words = ", ".join(firsts[:4])
        hints.append(
            f"all classes begin with {words}: if that is a machine, take it out of the class with {way}."
        )
    return hints
