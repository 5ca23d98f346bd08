"""A first index for a folder of files, from their names, a table that came with them, and what they carry."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

from swashtwin.foundation import DataError, MissingFileError, parse, plain_text
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.formats.raw import RawFile, require_sample_unit
from swashtwin.recordings.formats.registry import open_raw, stem_of, suffix_of, suffixes
from swashtwin.recordings.index import path_from
from swashtwin.recordings.loading import choose_columns, rate_in_file, stated_rate
from swashtwin.recordings.scaling import scale, vibration_columns
from swashtwin.recordings.stated_facts import (
    bare_pressures,
    facts_of_header,
    facts_of_name,
    facts_of_table,
    label_hints,
    machines_in_labels,
    only_label,
)

Facts = dict[str, tuple[str, str]]
"""Value and origin of each fact of one file."""


@dataclass(frozen=True)
class IndexProposal:
    """An index to look over and correct."""

    index: Mapping[str, Any]
    """The index as `save_index` writes it."""
    skipped: tuple[str, ...]
    """Files that are left out, each with the reason."""
    facts: tuple[str, ...]
    """For each fact its values with their number of files and their origin: what to look over first."""
    notes: tuple[str, ...] = ()
    """What looks odd about the facts."""


def propose_index(
    folder: str | Path,
    *,
    label_pattern: str | None = None,
    table: str | Path | None = None,
    columns: Mapping[str, str] | None = None,
    include: Sequence[str] = (),
    pressure_unit: str | None = None,
    index_folder: str | Path | None = None,
    ask: Callable[[str, str], str | None] | None = None,
    **facts: Any,
) -> IndexProposal:
    """Index of every file below `folder` that can be read.

    Parameters
    ----------
    folder : where the files are; it is only read.
    label_pattern : regular expression that is searched in each relative path; its named groups ``label``, ``specimen``,
        ``speed``, ``pressure``, ``temperature`` and any other (an attribute) become facts. A number takes the unit that
        stands beside it in the name. Without a pattern the label is the parent folder's name, or the file name's words
        that hold no digit.
    table : CSV table with one row per file, as public data sets have; its files are relative to the table, to `folder`
        or to the current folder.
    columns : which column of the table holds which key of an entry, such as ``{"specimen": "bearing_id"}``; keys that
        no entry has become attributes. ``file`` and ``label`` need no naming. A number takes the unit in the heading.
    include : patterns of relative paths to keep, such as ``"normal_48k/*"``; all where empty.
    pressure_unit : unit of pressures in names, tables and headers that have none; bare speeds are in rpm, rates in Hz,
        temperatures in degC.
    index_folder : where the index will lie, if not in `folder`.
    ask : called with ``sample_rate``, ``unit``, ``pressure_unit`` or ``label_pattern`` and a question, where
        that fact is missing; gives the answer, or None. By default a missing fact is an error.
    facts : keys of an entry for every file that does not say them itself, such as ``unit="g"``.

    Raises
    ------
    DataError
        A fact is missing that neither the files nor the arguments say.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder.")
    defaults = {key: list(value) if isinstance(value, tuple) else value for key, value in facts.items()}
    defaults = {key: value for key, value in defaults.items() if value is not None}
    _require_defaults(defaults)
    if pressure_unit is not None:
        parse(f"1 {pressure_unit}", "Pa", name="pressure_unit")
    stated = None if table is None else facts_of_table(folder, Path(table), columns or {})
    files = [
        name
        for name in (_files(folder) if stated is None else stated)
        if not include or any(fnmatchcase(name, path) for path in include)
    ]
    if include and not files:
        raise DataError(f"{folder} holds no file whose path matches include = {', '.join(include)}.")
    is_asked = False
    while True:
        survey = _survey(folder, files, stated, defaults, label_pattern, pressure_unit)
        questions = {
            key: f"{len(names)} files (as {names[0]}) do not say their {key}" for key, names in survey.missing.items()
        }
        if not is_asked and label_pattern is None and stated is None and (only := only_label(survey.entries)):
            questions["label"], is_asked = f"All files are of the class {only!r}, as their names say", True
        answers = _ask(questions, ask)
        if not answers:
            break
        label_pattern = answers.pop("label_pattern", label_pattern)
        pressure_unit = answers.pop("pressure_unit", pressure_unit)
        defaults |= answers
    if survey.missing:
        listed = "; ".join(
            f"{key} of {len(names)} files (as {names[0]}): {_QUESTIONS[key][0]}"
            for key, names in survey.missing.items()
        )
        raise DataError(f"{folder}: neither the files nor the options state {listed}.")
    if not survey.entries:
        reason = survey.skipped[0] if survey.skipped else f"supported are {', '.join(suffixes())}."
        raise DataError(f"{folder} holds no file to index: {reason}")
    machines = [] if label_pattern or stated is not None else machines_in_labels(survey.entries)
    for facts_of_file, entry in zip(survey.facts, survey.entries, strict=True) if machines else ():
        facts_of_file |= {key: (entry[key], "its name") for key in ("label", "specimen") if key in entry}
    index = _index_of(survey.entries, defaults, folder, index_folder)
    hints = [*machines, *label_hints(entry["label"] for entry in survey.entries if "label" in entry)]
    return IndexProposal(
        index, tuple(survey.skipped), _sentences(survey.facts), tuple(dict.fromkeys([*survey.notes, *hints]))
    )


def _files(folder: Path) -> list[str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    readable = suffixes()
    return [path.relative_to(folder).as_posix() for path in paths if suffix_of(path) in readable]


class _Survey(NamedTuple):
    """Result of reading every file."""

    entries: list[dict[str, Any]]
    skipped: list[str]
    missing: dict[str, list[str]]
    facts: list[Facts]
    notes: list[str]


def _survey(
    folder: Path,
    names: Sequence[str],
    stated: Mapping[str, dict[str, Any]] | None,
    defaults: Mapping[str, Any],
    pattern: str | None,
    pressure_unit: str | None,
) -> _Survey:
    """Entries of the files that can be read, why others cannot, and which facts are missing in which files.

    Parameters
    ----------
    stated : facts of each file from a table; None where they are in the names.
    """
    survey = _Survey([], [], {}, [], [])
    for name in names:
        path = folder / name
        try:
            raw = open_raw(path, Entry.from_mapping({"file": name, **defaults}, str(path)).options)
        except MissingFileError:
            raise
        except DataError as cause:
            if stated is not None and path.stat().st_size:
                raise
            survey.skipped.append(str(cause))
            continue
        if stated is None and "text_columns" in raw.attributes and (other := _named_within(path, names)):
            survey.skipped.append(f"{path} names {other}: a table of facts, for --table.")
            continue
        fact = facts_of_name(name, pattern) if stated is None else stated[name]
        values, in_file = _facts_of(name, raw, fact, stated is not None, survey.notes)
        bare = bare_pressures(values)
        if bare and pressure_unit is None:
            survey.missing.setdefault("pressure_unit", []).append(name)
        values |= {key: f"{values[key]} {pressure_unit}" for key in bare if pressure_unit is not None}
        for entry in _entries_within(raw, {"file": name, **values}, defaults, str(path)):
            whole = Entry.from_mapping({**defaults, **entry}, str(path))
            columns = choose_columns(raw, whole, str(path))
            missing = _missing_facts(raw, list(columns), whole, defaults.keys(), str(path))
            for key in missing:
                survey.missing.setdefault(key, []).append(name)
            origins = _origins(
                name, raw, columns, values, defaults, pattern=pattern, table=stated is not None, in_file=in_file
            )
            survey.facts.append(origins)
            survey.entries.append(entry)
            survey.notes.extend(_remarks(raw, columns, whole))
    return survey


def _facts_of(
    name: str, raw: RawFile, fact: Mapping[str, Any], in_table: bool, notes: list[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Facts of a file, and those among them that it states itself: they count more than a name, less than a table."""
    values = {key: value for key, value in fact.items() if key != "label" or not raw.facts.get("label")}
    values |= {key: plain_text(values[key]) for key in ("label", "specimen") if key in values}
    header = {} if raw.facts else facts_of_header(raw)
    counts = "table's" if in_table else "header's"
    both = [key for key in header if key in values and header[key] != values[key]]
    notes.extend(
        f"{name} states {key} = {values[key]}, its header {header[key]}; the {counts} counts." for key in both[:1]
    )
    in_file = {key: value for key, value in header.items() if not (in_table and key in values)}
    return values | in_file, in_file


def _remarks(raw: RawFile, columns: Iterable[str], entry: Entry) -> list[str]:
    """What to know of a file that is proposed."""
    remarks = []
    if entry.channels is None and (others := [name for name in raw.columns if name not in columns]):
        remarks.append(f"columns that are no vibration are left out: {', '.join(others)}.")
    if entry.pressure is not None and entry.speed is None and "condition" not in raw.facts:
        remarks.append(
            'files state a pressure and no speed; add --speed "860 rpm" where it is known: calibration and shaft '
            "orders need it."
        )
    return remarks


def _entries_within(
    raw: RawFile, entry: dict[str, Any], defaults: Mapping[str, Any], where: str
) -> list[dict[str, Any]]:
    """Entries of a file: one for each start of its channels, where they start apart and are not named."""
    chosen = Entry.from_mapping({**defaults, **entry}, where)
    starts: dict[str, list[str]] = {}
    if chosen.channels is None:
        for name in vibration_columns(raw, chosen):
            starts.setdefault(raw.starts.get(name, ""), []).append(name)
    if len(starts) < 2:
        return [entry]
    stem = stem_of(Path(entry["file"]))
    return [{**entry, "id": f"{stem}_{n}", "channels": names} for n, names in enumerate(starts.values(), 1)]


def _named_within(path: Path, names: Sequence[str]) -> str | None:
    """A file of the folder that another one names in its first lines."""
    with path.open("rb") as file:
        head = file.read(1 << 16).decode(errors="replace")
    return next((name for name in names if Path(name).name in head and Path(name).name != path.name), None)


_QUESTIONS = {
    "sample_rate": ('--sample-rate "25.6 kHz"', "How many samples per second and channel do they have, with the unit"),
    "unit": ('--unit "g" (or "1")', 'In which unit are their samples: g, m/s^2, or "1" where it is not known'),
    "pressure_unit": ("--pressure-unit bar", "Their pressures have no unit: is it MPa, bar, kPa or psi"),
    "label": ("--label-pattern", "Which regular expression finds the class in their paths, as (?P<label>...)"),
}


def _require_defaults(defaults: Mapping[str, Any]) -> None:
    """Refuse a fact that no reader of the index would understand, before anything is written."""
    Entry.from_mapping({"file": "every file", **defaults}, "the facts of every file")
    for name, unit in QUANTITIES.items():
        if name in defaults:
            parse(defaults[name], unit, name=name)
    if "unit" in defaults:
        require_sample_unit(defaults["unit"])


def _ask(questions: Mapping[str, str], ask: Callable[[str, str], str | None] | None) -> dict[str, str]:
    """Answers to the questions about facts."""
    answers: dict[str, str] = {}
    if ask is None:
        return answers
    for key, reason in questions.items():
        fact = "label_pattern" if key == "label" else key
        if answer := ask(fact, f"{reason}. {_QUESTIONS[key][1]}?"):
            answers[fact] = answer
    return answers


def _missing_facts(raw: RawFile, columns: list[str], entry: Entry, given: Set[str], where: str) -> list[str]:
    """Facts that nobody states; one of those `given` for all files that the file contradicts is refused."""
    has_units = all(name in raw.units for name in columns) or bool(raw.sensitivities)
    missing = []
    if entry.sample_rate is None and rate_in_file(raw, columns, where) is None:
        missing.append("sample_rate")
    elif "sample_rate" in given:
        stated_rate(raw, columns, entry, where)
    if not has_units and entry.unit is None and entry.sensitivity is None:
        missing.append("unit")
    elif given & {"sensitivity", "unit"}:
        scale(raw, entry, columns, where)
    return missing if entry.label or raw.facts.get("label") else [*missing, "label"]


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
        index["root"] = path_from(Path(index_folder).resolve(), folder.resolve())
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


_FACTS_FIRST = ("label", "specimen", "speed", "pressure", "sample_rate", "unit", "channels")
"""Facts that are listed before the others."""
_MOST = 6
"""Values that a sentence lists."""


def _origins(
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
    facts: Facts = {key: (_words(value), "the option") for key, value in defaults.items()}
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


def _sentences(files: Iterable[Facts]) -> tuple[str, ...]:
    """One sentence for each fact: its values with their number of files, by origin."""
    counts: dict[str, dict[str, Counter[str]]] = {}
    for facts in files:
        for key, (value, origin) in facts.items():
            counts.setdefault(key, {}).setdefault(origin, Counter())[value] += 1
    sentences = []
    for key in [key for key in _FACTS_FIRST if key in counts] + sorted(set(counts) - set(_FACTS_FIRST)):
        parts = []
        for origin, values in counts[key].items():
            listed = ", ".join(f"{value} ({count})" for value, count in list(values.items())[:_MOST])
            more = f" and {len(values) - _MOST} more" if len(values) > _MOST else ""
            parts.append(f"{listed}{more}, says {origin}")
        sentences.append(f"{key}: {'; '.join(parts)}")
    return tuple(sentences)


def _words(value: Any) -> str:
    """A value as people write it: a list with commas."""
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
