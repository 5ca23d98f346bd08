"""Facts that people write into file names, tables and headers, as keys of an index entry."""

import csv
import io
import math
import re
from collections.abc import Mapping, Set
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
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.file_formats import stem_of
from swashtwin.recordings.formats.column_names import meaning_of_unit, words_of
from swashtwin.recordings.formats.headings import (
    GROUPED,
    parse_header,
    shows_decimal_comma,
    split_unit,
)
from swashtwin.recordings.formats.raw_file import RawFile
from swashtwin.recordings.formats.sample_units import normalize_unit
from swashtwin.recordings.path_labels import (
    MACHINE_IN_FILE_NAME,
    MACHINE_NAME,
    MACHINE_NOUNS,
    PathClasses,
    label_of_path,
)

PRESSURES = ("pressure", "suction_pressure", "case_pressure")
"""Keys whose bare numbers have no default unit: MPa and bar are both in use."""

# Units of bare numbers.
_DEFAULT_UNITS = {"speed": "rpm", "sample_rate": "Hz", "resample": "Hz", "oil_temperature": "degC"}

# Further names of keys, for patterns and tables.
_KEY_SYNONYMS = {"discharge_pressure": "pressure", "temperature": "oil_temperature"}

_PRESSURE_UNIT = r"(?:MPa|kPa|hPa|mbar|bar|psi)"
_SPEED_UNIT = r"(?:rpm|r_min|U_min|1_min|min-1|Upm)"

# Units that may stand next to a number in a file name.
_UNIT_PATTERNS = {
    **dict.fromkeys(PRESSURES, _PRESSURE_UNIT),
    "speed": rf"(?:{_SPEED_UNIT}|Hz)",
    "sample_rate": "k?Hz",
    "resample": "k?Hz",
    "oil_temperature": "degC|°C",
}

_NUMBER = r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"

# Quantities that are recognized in file names.
_PATH_PATTERNS = {
    "speed": rf"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _-]?({_SPEED_UNIT})(?![A-Za-z])",
    "pressure": rf"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _-]?({_PRESSURE_UNIT})(?![A-Za-z])",
}

# Quantities that are recognized in headings, in English and German.
_HEADING_PATTERNS = {
    "speed": r"drehzahl|(?:shaft|rotational|motor|pump)[ _]?speed|^speed|rpm$|^rpm",
    "pressure": r"^(?:discharge|outlet|high|system)?[ _-]?pressure|(?:förder|hoch|betriebs|^)druck"
    r"|^p(?=(?:[ _-]?(?:bar|mpa|kpa|psi))?$)",
    "oil_temperature": r"oil[ _-]?temp|öltemp",
}

# Headings of values that were not measured.
_LIMIT_HEADING = re.compile(r"nominal|nenn|rated|set[ _-]?point|soll|max|limit", re.IGNORECASE)

# Words of headings that name a machine: Pumpe, Pumpennummer, Maschinen-Nr.
_MACHINE_WORD = re.compile(rf"(?:{MACHINE_NOUNS})n?(?:nummer|nr)?")
_SERIAL_WORDS = frozenset({"serial", "seriennummer", "seriennr", "sn"})
_MACHINE_QUALIFIERS = frozenset({"id", "nr", "no", "number", "nummer", "name", "serien", "s", "n"})

# The name of a machine without a word that says so: P14, 12345, A. Longer texts, such as
# Rexroth A10VSO, may be the maker and the type, which many machines share.
_MACHINE_CODE = re.compile(
    rf"(?:(?i:{MACHINE_NOUNS}|unit|nr|no)[ ._#-]*)?"
    r"(?:[A-Za-z]{1,3}[ _-]?\d{1,9}[A-Za-z]?|\d{1,12}|[A-Za-z])"
)

# Characters of the name of a machine; longer texts are descriptions.
_MAX_SPECIMEN_LENGTH = 40

# Words of headings that name a class.
_LABEL_WORDS = frozenset({"label", "class", "klasse"})

_HEADING_UNIT = re.compile(r"(rpm|hz|bar|mpa|kpa|psi)$", re.IGNORECASE)

# A word after that of a quantity, such as sensor or channel: its number is another one.
_FURTHER_NOUN = re.compile(
    r"[\W_](?!pump|shaft|welle|motor|actual|ist\b|mean)[a-zäöüß]", re.IGNORECASE
)

_ENTRY_KEYS = {field.name for field in fields(Entry)}

# A pressure of a header below this is that of the air.
_MIN_PRESSURE_PA = 2e5

# Time that a pattern may search in one path.
_PATTERN_TIMEOUT_S = 1.0

# Relative difference up to which an entry agrees with the header: values are rounded there.
_MAX_CONTRADICTION = 0.03


def parse_path_facts(
    name: str, pattern: str | None, classes: PathClasses
) -> tuple[dict[str, Any], Set[str]]:
    """Return (facts that a file's relative path states, keys of those that the pattern found).

    Speed and pressure with their units, and a machine, are recognized without a pattern too.

    Parameters
    ----------
    pattern : regular expression whose named groups are facts, which override the others; without
        it the label is the folder's name or the words of the file name.
    classes : what tells classes apart in the paths of all files.
    """
    path = Path(name)
    texts: dict[str, str] = {}
    stem = stem_of(path)
    for key, expression in _PATH_PATTERNS.items():
        if match := regex.search(expression, name, regex.IGNORECASE):
            texts[key] = f"{match[1]} {match[2]}"
            stem = regex.sub(expression, " ", stem, flags=regex.IGNORECASE)

    machine_folder = None
    for folder in reversed(path.parents):
        is_class = folder.as_posix() in classes.folders
        if not is_class and MACHINE_NAME.fullmatch(folder.name):
            machine_folder = folder.name
            break
    if machine_folder:
        texts["specimen"] = machine_folder
    else:
        machine = MACHINE_IN_FILE_NAME.search(stem)
        if machine and machine[0] != stem.strip("_-. "):
            texts["specimen"] = machine[0]
            stem = stem.replace(machine[0], " ")

    if pattern is not None:
        matched, units = _match_pattern(name, pattern)
        return parse_fact_texts({**texts, **matched}, units), matched.keys()

    label = label_of_path(path, stem, machine_folder, classes)
    return parse_fact_texts({"label": label, **texts}), frozenset()


def _match_pattern(name: str, pattern: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the text of each named group that matched, and the unit next to it."""
    try:
        match = regex.search(pattern, name, timeout=_PATTERN_TIMEOUT_S)
    except regex.error as cause:
        raise InputError(
            f"label_pattern {pattern!r} is not a regular expression: {cause}.",
            field="label_pattern",
        ) from cause
    except TimeoutError as cause:
        raise InputError(
            f"label_pattern {pattern!r} takes too long on {name!r}; a repetition within a "
            "repetition, such as (a+)+, does this.",
            field="label_pattern",
        ) from cause
    if match is None:
        raise DataError(
            f"{name} does not match label_pattern {pattern!r}; correct it, or narrow include.",
            field="label_pattern",
        )

    texts: dict[str, str] = {}
    units: dict[str, str] = {}
    for group, text in match.groupdict().items():
        key = _KEY_SYNONYMS.get(group, group)
        if text:
            texts[key] = text
        if unit := _unit_around(name, match.span(group), _UNIT_PATTERNS.get(key)):
            units[key] = unit
    return texts, units


def _unit_around(name: str, span: tuple[int, int], unit_pattern: str | None) -> str | None:
    """Return the unit right after a span of a name, or right before it."""
    if unit_pattern is None:
        return None

    start, end = span
    following = regex.match(rf"[ _-]?({unit_pattern})(?![A-Za-z])", name[end:], regex.IGNORECASE)
    preceding = regex.search(
        rf"(?<![A-Za-z])({unit_pattern})[ _-]?$", name[:start], regex.IGNORECASE
    )
    match = following or preceding
    return str(match[1]) if match else None


def read_fact_table(
    folder: Path, table: Path, columns: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Return the facts of each file below `folder` that a table names, by its relative path.

    The table's paths are relative to the table, to `folder` or to the current folder, or are a
    file name that occurs once.

    Parameters
    ----------
    columns : column of the table for each key of an entry.
    """
    if not table.is_file():
        raise MissingFileError(f"{table} does not exist.")
    rows, header = _read_rows(table)

    mapping = {"file": "file", "label": "label"}
    for key, column in columns.items():
        mapping[_KEY_SYNONYMS.get(key, key)] = column
    for key, column in mapping.items():
        if column not in header:
            raise DataError(
                f"{table} has no column {column!r} for {key}; it has {', '.join(header)}."
            )
    file_column = mapping.pop("file")

    units = {key: unit for key, column in mapping.items() if (unit := split_unit(column)[1])}
    root = folder.resolve()
    paths_by_name: dict[str, list[Path]] = {}
    for path in root.rglob("*"):
        paths_by_name.setdefault(path.name, []).append(path)

    facts = {}
    for row in rows:
        file = (row[file_column] or "").strip()
        path = _resolve_row_path(file, (table.parent, folder, Path()), paths_by_name)
        if file and path.is_relative_to(root):
            texts = {key: (row[column] or "").strip() for key, column in mapping.items()}
            facts[path.relative_to(root).as_posix()] = parse_fact_texts(texts, units)

    if not facts:
        example = rows[0][file_column] if rows else ""
        raise DataError(
            f"{table} names no file below {folder}; its column {file_column!r} must hold paths "
            f"relative to the table, to {folder} or to the current folder, not such as "
            f"{example!r}."
        )
    return facts


def _read_rows(table: Path) -> tuple[list[dict[str, str]], list[str]]:
    """Return the rows of a CSV table and the names of its columns."""
    text = read_text(table)
    first_line = text.partition("\n")[0]
    delimiter = max(",;\t", key=first_line.count)
    rows = list(csv.DictReader(io.StringIO(text, newline=""), delimiter=delimiter))
    header = [name for name in rows[0] if name] if rows else []
    return rows, header


def _resolve_row_path(
    file: str, folders: tuple[Path, ...], paths_by_name: Mapping[str, list[Path]]
) -> Path:
    """Return the file that a row names, or its path in the first folder if there is none."""
    candidates = [(folder / file).resolve() for folder in folders]
    same_name = paths_by_name.get(Path(file).name, [])
    if len(same_name) == 1:
        candidates += same_name
    return next((path for path in candidates if path.is_file()), candidates[0])


def parse_header_facts(raw: RawFile) -> dict[str, Any]:
    """Return speed, pressure and oil temperature from header lines or single numbers of a file.

    A file with facts of its own format has none in its header.
    """
    if raw.facts:
        return {}

    pairs = _header_pairs(raw)
    is_decimal_comma = shows_decimal_comma(pairs)
    # The motor's speed counts last: a pump's own line is more certain.
    pairs.sort(key=lambda pair: "motor" in pair[0].lower())

    texts: dict[str, str] = {}
    for name, text in pairs:
        quantity = re.fullmatch(rf"({_NUMBER})\s*[;\t]?\s*(.*?)[;\s]*", str(text))
        if quantity is None:
            continue
        if GROUPED.fullmatch(quantity[1]) and not is_decimal_comma:
            continue  # 1,480 rpm may be 1480 or 1.48
        for key in _HEADING_PATTERNS:
            if key in texts:
                continue
            parsed = _parse_heading(key, name, quantity[1], quantity[2])
            if parsed is not None:
                texts[key] = parsed

    facts = parse_fact_texts(texts)
    return {key: text for key, text in facts.items() if _is_plausible(key, text)}


def _header_pairs(raw: RawFile) -> list[tuple[str, str]]:
    """Return name and value of the header lines and attributes of a file."""
    pairs: list[tuple[str, str]] = parse_header(raw.attributes.get("header", ""))
    for name, text in raw.attributes.items():
        if name != "header":
            pairs.append((name.rpartition(".")[2], text))
    return pairs


def parse_header_machine(raw: RawFile) -> tuple[str | None, list[str]]:
    """Return (machine that the header of a file names, lines that may name one).

    A serial number without the word pump or machine may be that of the logger, and a text may be
    the maker and the type: neither is a machine.
    """
    if raw.facts:
        return None, []

    machine = None
    unused_lines: list[str] = []
    for name, text in _header_pairs(raw):
        value = str(text).strip(" ;,\t")
        is_short = 0 < len(value) <= _MAX_SPECIMEN_LENGTH and "\n" not in value
        heading_words = set(words_of(name))
        machine_words = {word for word in heading_words if _MACHINE_WORD.fullmatch(word)}
        known_words = machine_words | _SERIAL_WORDS | _MACHINE_QUALIFIERS
        may_be_machine = machine_words or not heading_words.isdisjoint(_SERIAL_WORDS)
        if not is_short or not may_be_machine or not heading_words <= known_words:
            continue

        has_number_word = any(
            word in _SERIAL_WORDS | _MACHINE_QUALIFIERS - {"name"}
            or word.endswith(("nr", "nummer"))
            for word in heading_words
        )
        if machine is None and machine_words and _names_machine(value, has_number_word):
            machine = re.sub(r"^(\d+)\.0$", r"\1", value)
        else:
            unused_lines.append(f"{name.strip()} = {value}")
    return machine, unused_lines


def describe_header_label(raw: RawFile, label: str) -> str:
    """Return that the header of a file states another class than `label`, or an empty text."""
    if raw.facts:
        return ""

    for name, text in _header_pairs(raw):
        value = str(text).strip(" ;,\t\"'")
        heading_words = set(words_of(name))
        value_words = set(words_of(value))
        names_class = bool(heading_words) and heading_words <= _LABEL_WORDS
        # A number may be the code of the class, and a long text describes it.
        is_code = re.fullmatch(_NUMBER, value) is not None
        if not names_class or is_code or len(value) > _MAX_SPECIMEN_LENGTH:
            continue

        # The class may hold more words, such as the machine or the size of the fault.
        if not value_words <= set(words_of(label)):
            return f"the class {label} counts, the header states {name.strip()} = {value}"
    return ""


def _names_machine(value: str, has_number_word: bool) -> bool:
    """Return whether a text is the name of one machine, and not a quantity or a description.

    Parameters
    ----------
    has_number_word : whether the heading states a number, so that any word is one.
    """
    quantity = re.fullmatch(rf"{_NUMBER}\s*(\D+)", value)
    if quantity and meaning_of_unit(quantity[1]) is not None:
        return False
    if has_number_word and not re.search(r"\s", value):
        return True
    return bool(re.fullmatch(r"\d+\.0", value) or _MACHINE_CODE.fullmatch(value))


def _parse_heading(key: str, name: str, number: str, unit: str) -> str | None:
    """Return number and unit if a heading names a quantity, or None."""
    heading, heading_unit = split_unit(name)
    match = re.search(_HEADING_PATTERNS[key], heading, re.IGNORECASE)
    if match is None or _LIMIT_HEADING.search(heading):
        return None

    suffix = _HEADING_UNIT.search(heading)
    has_unit = bool(unit or heading_unit or suffix or "rpm" in match[0].lower())
    is_symbol = len(match[0]) == 1  # "p" alone may be anything
    if not has_unit and (is_symbol or _FURTHER_NOUN.search(heading[match.end() :])):
        return None
    return f"{number} {unit or heading_unit or (suffix[1] if suffix else '')}".strip()


def _is_plausible(key: str, text: str) -> bool:
    if key in PRESSURES and re.fullmatch(_NUMBER, text):
        return True  # its unit is still unknown
    if not is_positive_quantity(text, key):
        return False
    return key != "pressure" or parse_quantity(text, "Pa") >= _MIN_PRESSURE_PA


def describe_contradictions(
    entry: Entry, header: Mapping[str, str], origin: str = "the file"
) -> str:
    """Return in what an entry differs by more than 3 % from the header of its file.

    The text is empty if nothing differs.

    Parameters
    ----------
    header : quantities by their keys; those without a unit are not compared.
    origin : what states them, for the text.
    """
    sentences = []
    for key, text in header.items():
        specified = getattr(entry, key)
        if not (is_positive_quantity(specified, key) and is_positive_quantity(text, key)):
            continue
        unit = QUANTITIES[key]
        value = parse_quantity(specified, unit)
        header_value = parse_quantity(text, unit)
        if not math.isclose(value, header_value, rel_tol=_MAX_CONTRADICTION):
            sentences.append(f"{key} = {specified} is specified and counts, {origin} states {text}")
    return "; ".join(sentences)


def are_equal_quantities(first: object, second: object, key: str) -> bool:
    """Return whether two texts are the same quantity, such as 15 MPa and 150 bar."""
    unit = QUANTITIES[key]
    try:
        return math.isclose(parse_quantity(first, unit), parse_quantity(second, unit))
    except UnitError:
        return False


def is_positive_quantity(text: object, key: str) -> bool:
    """Return whether a text is a quantity above zero that an entry may hold under a key."""
    try:
        return parse_quantity(text, QUANTITIES[key]) > 0
    except UnitError:
        return False


def parse_fact_texts(
    texts: Mapping[str, str], units: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return texts as keys and attributes of an entry.

    A bare number gets the unit of `units`, or the default one of its key. A pressure has no default
    unit, so its number stays bare.
    """
    units = {**_DEFAULT_UNITS, **(units or {})}
    facts: dict[str, Any] = {}
    attributes: dict[str, str] = {}
    for key, text in texts.items():
        if not text:
            continue
        quantity = re.fullmatch(rf"({_NUMBER})\s*(.*)", text) if key in QUANTITIES else None
        if quantity:
            unit = quantity[2] or units.get(key, "")
            number = quantity[1].replace(",", ".")
            facts[key] = f"{number} {normalize_unit(unit.replace('_', '/'))}".strip()
        elif key == "channels":
            separator = ";" if ";" in text else None
            facts[key] = [part.strip() for part in text.split(separator)]
        elif key == "label":
            facts[key] = text.strip("_-. ")
        elif key in _ENTRY_KEYS:
            facts[key] = text
        else:
            attributes[key] = text

    if attributes:
        facts["attributes"] = attributes
    return facts


def pressures_without_unit(facts: Mapping[str, Any]) -> list[str]:
    """Return the keys of pressures without a unit."""
    return [key for key in PRESSURES if re.fullmatch(_NUMBER, str(facts.get(key, "")))]
