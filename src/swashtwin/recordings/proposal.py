"""A first index for a folder of files, from their names, a table that came with them, and what they carry."""

import csv
import io
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

from swashtwin.foundation import DataError, InputError, MissingFileError, UnitError, is_unit, parse, read_text
from swashtwin.recordings.entry import Entry
from swashtwin.recordings.fact_origins import Facts, facts_of, sentences
from swashtwin.recordings.formats.raw import Options, RawFile
from swashtwin.recordings.formats.registry import open_raw, stem_of, suffix_of, suffixes
from swashtwin.recordings.loading import choose_columns, rate_in_file

_TABLE_UNITS = {"speed": "rpm", "discharge_pressure": "MPa", "suction_pressure": "MPa", "case_pressure": "MPa"}
_TABLE_UNITS |= {"sample_rate": "Hz", "resample": "Hz", "oil_temperature": "degC"}
_GROUPS = {"pressure": "discharge_pressure", "temperature": "oil_temperature"}
"""Short names that a pattern may use."""
_SPEED = re.compile(r"(\d+(?:\.\d+)?)\s*(?:rpm|r_min)", re.IGNORECASE)
_PRESSURE = re.compile(r"(\d+(?:\.\d+)?)\s*MPa", re.IGNORECASE)
_ENTRY_KEYS = {field.name for field in fields(Entry)}


@dataclass(frozen=True)
class IndexProposal:
    """An index to look over and correct."""

    index: Mapping[str, Any]
    """The index as `save_index` writes it."""
    skipped: tuple[str, ...]
    """Files that are left out, each with the reason."""
    facts: tuple[str, ...]
    """For each fact its values with their number of files and their origin: what to look over first."""


def propose_index(
    folder: str | Path,
    *,
    label_pattern: str | None = None,
    table: str | Path | None = None,
    columns: Mapping[str, str] | None = None,
    include: Sequence[str] = (),
    sample_rate: str | None = None,
    unit: str | None = None,
    channels: Sequence[str | int] | None = None,
    names: Sequence[str] | None = None,
    resample: str | None = None,
    speed: str | None = None,
    discharge_pressure: str | None = None,
    calibration_factor: str | None = None,
    index_folder: str | Path | None = None,
    ask: Callable[[str, str], str | None] | None = None,
) -> IndexProposal:
    """Index of every file below `folder` that can be read.

    Parameters
    ----------
    folder : where the files are; it is only read.
    label_pattern : regular expression that is searched in each relative path; its named groups ``label``, ``specimen``,
        ``speed`` [rpm], ``pressure`` [MPa], ``temperature`` [degC] and any other (an attribute) become facts. Without
        it the label is the parent folder's name, or the file name's words that hold no digit.
    table : CSV table with one row per file, as public data sets have; its files are relative to the table.
    columns : which column of the table holds which key of an entry, such as ``{"specimen": "bearing_id"}``; keys that
        no entry has become attributes. Bare numbers are rpm, Hz, MPa and degC. ``file`` and ``label`` need no naming.
    include : patterns of relative paths to keep, such as ``"normal_48k/*"``; all where empty.
    sample_rate, unit, channels, names, resample, speed, discharge_pressure, calibration_factor : facts for every file
        that does not say them itself.
    index_folder : where the index will lie, if not in `folder`.
    ask : called with ``sample_rate``, ``unit``, ``speed`` or ``label_pattern`` and a question, where that fact is
        missing; gives the answer, or None. By default a missing fact is an error.

    Raises
    ------
    DataError
        A fact is missing that neither the files nor the arguments say.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder.")
    options = {"unit": unit, "channels": list(channels) if channels else None, "names": list(names) if names else None}
    options |= {"sample_rate": sample_rate, "resample": resample, "calibration_factor": calibration_factor}
    options |= {"speed": speed, "discharge_pressure": discharge_pressure}
    defaults = {key: value for key, value in options.items() if value is not None}
    _require_quantities(defaults)
    while True:
        if table is None:
            facts = {name: _from_name(name, label_pattern) for name in _files(folder)}
        else:
            facts = _from_table(folder, Path(table), columns or {})
        if include:
            facts = {name: fact for name, fact in facts.items() if any(fnmatchcase(name, path) for path in include)}
            if not facts:
                raise DataError(f"{folder} holds no file whose path matches include = {', '.join(include)}.")
        survey = _survey(folder, facts, defaults, label_pattern, strict=table is not None)
        answers = _ask(survey.missing, ask)
        if not answers:
            break
        label_pattern = answers.pop("label_pattern", label_pattern)
        defaults |= answers
    _refuse_missing(folder, survey.missing)
    if not survey.entries:
        reason = survey.skipped[0] if survey.skipped else f"supported are {', '.join(suffixes())}."
        raise DataError(f"{folder} holds no file to index: {reason}")
    index = _index_of(survey.entries, defaults, folder, index_folder)
    return IndexProposal(index, tuple(survey.skipped), sentences(survey.facts, defaults))


def _files(folder: Path) -> list[str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    readable = suffixes()
    return [path.relative_to(folder).as_posix() for path in paths if suffix_of(path) in readable]


def _from_name(name: str, pattern: str | None) -> dict[str, Any]:
    """Facts that a file's relative path tells."""
    if pattern is not None:
        try:
            match = re.search(pattern, name)
        except re.error as cause:
            raise InputError(f"label_pattern {pattern!r} is not a regular expression: {cause}.") from cause
        if match is None:
            raise DataError(f"{name} does not match label_pattern {pattern!r}; correct it, or narrow include.")
        return _facts({_GROUPS.get(key, key): text for key, text in match.groupdict().items() if text})
    path = Path(name)
    words = [word for word in re.split(r"[_\-\s.]+", stem_of(path)) if word and not re.search(r"\d", word)]
    parent = path.parent.name
    facts = {"label": parent if parent and not re.search(r"\d", parent) else "_".join(words)}
    for key, unit_pattern in (("speed", _SPEED), ("discharge_pressure", _PRESSURE)):
        match = unit_pattern.search(name)
        if match:
            facts[key] = match[1]
    return _facts(facts)


def _from_table(folder: Path, table: Path, columns: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Facts of each file below `folder` that a table names."""
    if not table.is_file():
        raise MissingFileError(f"{table} does not exist.")
    mapping = {"file": "file", "label": "label", **columns}
    rows = list(csv.DictReader(io.StringIO(read_text(table), newline="")))
    header = list(rows[0]) if rows else []
    for key, column in mapping.items():
        if column not in header:
            raise DataError(f"{table} has no column {column!r} for {key}; it has {', '.join(header)}.")
    facts = {}
    for row in rows:
        path = (table.parent / (row[mapping["file"]] or "")).resolve()
        if path.is_relative_to(folder.resolve()):
            cells = {key: (row[column] or "").strip() for key, column in mapping.items() if key != "file"}
            facts[path.relative_to(folder.resolve()).as_posix()] = _facts(cells)
    return facts


def _facts(texts: Mapping[str, str]) -> dict[str, Any]:
    """Entry keys and attributes, bare numbers with the table's units."""
    facts: dict[str, Any] = {}
    attributes: dict[str, str] = {}
    for key, text in texts.items():
        if not text:
            continue
        if key == "channels":
            facts[key] = [part.strip() for part in text.split(";" if ";" in text else None)]
        elif key in _TABLE_UNITS and re.fullmatch(r"[+-]?[\d.]+(e[+-]?\d+)?", text, re.IGNORECASE):
            facts[key] = f"{text} {_TABLE_UNITS[key]}"
        elif key in _ENTRY_KEYS:
            facts[key] = text
        else:
            attributes[key] = text
    return facts | ({"attributes": attributes} if attributes else {})


class _Survey(NamedTuple):
    """Result of reading every file."""

    entries: list[dict[str, Any]]
    skipped: list[str]
    missing: dict[str, list[str]]
    facts: list[Facts]


def _survey(
    folder: Path, facts: Mapping[str, dict[str, Any]], defaults: Mapping[str, Any], pattern: str | None, *, strict: bool
) -> _Survey:
    """Entries of the files that can be read, why others cannot, and which facts are missing in which files."""
    survey = _Survey([], [], {}, [])
    for name, fact in facts.items():
        path = folder / name
        try:
            raw = open_raw(path, Options())
        except MissingFileError:
            raise
        except DataError as cause:
            if strict:
                raise
            survey.skipped.append(str(cause))
            continue
        labeled = raw.facts.get("label") is not None
        values = {key: value for key, value in fact.items() if key != "label" or not labeled}
        entry = Entry.from_mapping({"file": name, **defaults, **values}, str(path))
        columns = choose_columns(raw, entry, str(path))
        for key in _missing_facts(raw, list(columns), entry, str(path)):
            survey.missing.setdefault(key, []).append(name)
        survey.facts.append(facts_of(name, raw, columns, values, defaults, pattern=pattern, table=strict))
        survey.entries.append({"file": name, **values})
    return survey


_QUESTIONS = {
    "sample_rate": ('--sample-rate "25.6 kHz"', "How many samples per second and channel do they have, with the unit"),
    "unit": ('--unit "g" (or "1")', 'In which unit are their samples: g, m/s^2, or "1" where it is not known'),
    "speed": ('--speed "860 rpm"', "A pressure without a speed is no operating condition: how fast did the shaft turn"),
    "label": ("--label-pattern", "Which regular expression finds the class in their paths, as (?P<label>...)"),
}


def _require_quantities(defaults: Mapping[str, object]) -> None:
    """Refuse a fact that no reader of the index would understand, before anything is written."""
    for name, unit in (("sample_rate", "Hz"), ("resample", "Hz"), ("speed", "rad/s"), ("discharge_pressure", "Pa")):
        if name in defaults:
            parse(defaults[name], unit, name=name)
    text = defaults.get("unit")
    if isinstance(text, str) and not is_unit(text):
        raise UnitError(f'unit = {text!r} is no unit; samples are in "m/s^2", "g", "bar", "1" (a plain number), ....')


def _ask(missing: Mapping[str, list[str]], ask: Callable[[str, str], str | None] | None) -> dict[str, str]:
    """Answers to the questions about missing facts."""
    if ask is None:
        return {}
    answers = {}
    for key, files in missing.items():
        fact = "label_pattern" if key == "label" else key
        answer = ask(fact, f"{len(files)} files (as {files[0]}) do not say their {key}. {_QUESTIONS[key][1]}?")
        if answer:
            answers[fact] = answer
    return answers


def _refuse_missing(folder: Path, missing: Mapping[str, list[str]]) -> None:
    if missing:
        listed = "; ".join(
            f"{key} of {len(files)} files (as {files[0]}): {_QUESTIONS[key][0]}" for key, files in missing.items()
        )
        raise DataError(f"{folder}: neither the files nor the options state {listed}.")


def _missing_facts(raw: RawFile, columns: list[str], entry: Entry, where: str) -> list[str]:
    has_units = all(name in raw.units for name in columns)
    missing = {
        "sample_rate": entry.sample_rate is None and rate_in_file(raw, columns, where) is None,
        "unit": not has_units and entry.unit is None and entry.calibration_factor is None,
        "label": not entry.label and not raw.facts.get("label"),
        "speed": entry.discharge_pressure is not None and entry.speed is None,
    }
    return [key for key, is_missing in missing.items() if is_missing]


def _index_of(
    entries: list[dict[str, Any]], defaults: dict[str, Any], folder: Path, index_folder: str | Path | None
) -> dict[str, Any]:
    """The index: unique ids, the occurring classes, common facts as defaults."""
    stems = [stem_of(Path(entry["file"])) for entry in entries]
    for entry, stem in zip(entries, stems, strict=True):
        if stems.count(stem) > 1 and "id" not in entry:
            entry["id"] = entry["file"].replace("/", "_")
    index: dict[str, Any] = {"format": 1}
    if index_folder is not None and Path(index_folder).resolve() != folder.resolve():
        index["root"] = Path(os.path.relpath(folder.resolve(), Path(index_folder).resolve())).as_posix()
    labels = list(dict.fromkeys(entry["label"] for entry in entries if "label" in entry))
    if labels and len([entry for entry in entries if "label" in entry]) == len(entries):
        index["classes"] = labels
    shared = {key for key in entries[0] if key not in ("file", "id", "label", "attributes", "sha256")}
    for key in sorted(shared):
        if len(entries) > 1 and all(entry.get(key) == entries[0][key] for entry in entries):
            defaults = {**defaults, key: entries[0][key]}
            for entry in entries[1:]:
                del entry[key]
            del entries[0][key]
    if defaults:
        index["defaults"] = defaults
    index["recording"] = entries
    return index
