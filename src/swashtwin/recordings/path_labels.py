"""Classes that the paths of a folder state, and the numbers in names that tell classes apart."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from swashtwin.pump import is_healthy
from swashtwin.recordings.findings import Finding, join_names
from swashtwin.recordings.formats.column_names import Quantity, meaning_of_unit

MACHINE_NOUNS = r"pumpe?|machine|maschine|anlage|aggregat|pr(?:üf|uef|uf)ling|specimen|dut"
"""Words for a machine, as a regular expression in small letters."""

_MACHINE_NUMBER = r"(?:[ _-]?\d{1,9}|(?:[ _-]|(?<=[a-z]))[A-Z]\d{0,3})"

# A machine, or a class such as B007 if the folders beside it are classes.
_CODE = r"[A-Z]\d{0,3}"

MACHINE_NAME = re.compile(
    rf"(?i:{MACHINE_NOUNS}|pr(?:üf|uef)stand|rig|motor|unit|sn|serial|nr|no)"
    rf"(?:{_MACHINE_NUMBER}|[ _-][a-z])|{_CODE}"
)
"""Names of folders, and words of classes, that stand for a machine."""

MACHINE_IN_FILE_NAME = re.compile(
    rf"(?<![^\W_])(?i:{MACHINE_NOUNS}|unit|sn|serial){_MACHINE_NUMBER}(?![^\W_])"
)
"""The same in the name of a file, where a number alone may be that of the measurement."""

# A code in the name of a file, which may be a machine (P12) or something else.
_CODE_IN_FILE_NAME = r"[A-Z]\d{1,3}"

# A number and its unit, such as the depth of a fault: 10um, 45 um, 0.5X.
_LEVEL = re.compile(r"(?<![^\W_])(?<!\d[.,])(\d+(?:[.,]\d+)?)([ _]?)([A-Za-zµμ%]{1,4})(?![^\W_]|%)")

# Units of sizes that stand right behind their number, and are other quantities in a column:
# inches, and multiples such as 0.5X.
_ADJACENT_SIZE_UNITS = frozenset({"in", "inch", "x"})

# Endings of numbers that are not units, and cubic centimeters in German.
_NO_SIZE_UNITS = frozenset({"st", "nd", "rd", "th", "ccm"})

# Codes of faults: letter of the part, and a size in thousandths of an inch, such as B007.
_FAULT_CODE = re.compile(r"[A-Z]0\d\d")

# Words that turn the name of a healthy pump into that of a fault: not_ok.
_NEGATIONS = frozenset({"not", "no", "non", "n", "nicht", "kein"})

_MONTHS = (
    r"jan(?:uar|uary)?|feb(?:ruar|ruary)?|mar(?:ch)?|mrz|märz|apr(?:il)?|mai|may|jun[ei]?|jul[yi]?"
    r"|aug(?:ust)?|sept?(?:ember)?|o[ck]t(?:ober)?|nov(?:ember)?|de[cz](?:ember)?"
)
_MONTH = re.compile(rf"(?<![^\W\d_])(?i:{_MONTHS})(?![^\W\d_])")

# Dates such as 2024-01-05, and times such as 10h30.
_DATE_OR_TIME = re.compile(r"(?<!\d)(?:(?:19|20)\d\d[-_.]?[01]\d[-_.]?[0-3]\d|\d{1,2}h\d\d)(?!\d)")

# Words whose number counts measurements.
_MEASUREMENT_WORDS = (
    r"run|test|day|tag|messung|measurement|rec|recording|session|trial|set|part|versuch|lauf|exp|"
    r"file|data|datei|daten|batch|charge|seri(?:e|es)|messreihe|week|month|woche|monat|kw"
)
_MEASUREMENT = re.compile(rf"(?:\d{{4}}[ _-]?)?(?i:{_MEASUREMENT_WORDS})[ _-]?\d+")

_MAX_LISTED_CLASSES = 6

# Names repeat their units, and an unknown one takes long to look up.
_meaning_of_unit = lru_cache(maxsize=1024)(meaning_of_unit)


@dataclass(frozen=True)
class PathClasses:
    """What tells classes apart in the paths of all files of a folder."""

    folders: frozenset[str] = frozenset()
    """Relative paths of folders whose names with digits, or codes such as B, are classes."""
    levels: frozenset[str] = frozenset()
    """Numbers with a unit that are parts of the classes in file names."""
    unused_levels: frozenset[str] = frozenset()
    """Numbers in file names that differ and may be parts of classes, but are not used."""
    unclear_machines: tuple[str, ...] = ()
    """Names of folders beside classes, such as A, that are taken for machines."""

    @classmethod
    def find(cls, names: Sequence[str]) -> "PathClasses":
        """Return those of the relative paths of all files."""
        paths = [PurePosixPath(name) for name in names]
        folders, unclear_machines = _find_class_folders(paths)

        # A healthy pump has no size of a fault.
        sizes = Counter(
            size
            for path in paths
            if not _is_of_healthy_pump(path)
            for size in set(_find_sizes(path.stem, ignored_units=()))
        )
        healthy_units = _find_units_of_healthy(paths)
        levels = {
            size
            for size, count in sizes.items()
            # What all files have tells none apart, and what one has may be its number.
            if count < len(names) and (count > 1 or re.search(r"\d[.,]\d", size))
        }
        used_levels = {size for size in levels if _find_sizes(size, ignored_units=healthy_units)}

        unknown = Counter(
            number
            for path in paths
            if not _is_labeled_by_folder(path, folders)
            for number in set(_find_numbers_of_unknown_unit(path.stem))
        )
        unused_levels = {number for number, count in unknown.items() if 1 < count < len(names)}
        unused_levels |= levels - used_levels
        return cls(
            folders, frozenset(used_levels), frozenset(unused_levels), tuple(unclear_machines)
        )


def _find_class_folders(paths: Sequence[PurePosixPath]) -> tuple[frozenset[str], list[str]]:
    """Return (folders whose names with digits, or codes, are classes, codes that may be)."""
    siblings: dict[PurePosixPath, set[PurePosixPath]] = {}
    with_healthy_file: set[PurePosixPath] = set()
    for path in paths:
        folder = path.parent
        if folder.name:
            siblings.setdefault(folder.parent, set()).add(folder)
        if _names_healthy(path.stem):
            with_healthy_file.update(path.parents)

    healthy_units = _find_units_of_healthy(paths)
    class_folders: set[str] = set()
    unclear_machines: dict[str, None] = {}
    for group in siblings.values():
        has_class = any(_is_plain_class(folder.name) for folder in group)
        sized = [folder for folder in group if _find_sizes(folder.name, healthy_units)]
        words_with_size = {word for folder in sized for word in _words_without_digits(folder.name)}

        # Motor1 is no class if Motor2 holds a healthy pump; Stufe1 is one beside Stufe0.
        healthy_series = {
            _series_of(folder.name)
            for folder in group & with_healthy_file
            if not re.search(r"(?<!\d)0+(?!\d)", folder.name)
        }

        for folder in sorted(group):
            # B is a class beside 0.5X_B.
            may_be_class = _may_be_class(folder.name) or folder.name in words_with_size
            is_class = folder in sized or (has_class and may_be_class)

            # The folder of a fault, or of its size, holds no healthy pump.
            is_in_series = folder not in sized and _series_of(folder.name) in healthy_series
            holds_healthy = folder in with_healthy_file or is_in_series
            if holds_healthy or _names_healthy(folder.name) or _is_plain_class(folder.name):
                continue

            if is_class:
                class_folders.add(str(folder))
            elif has_class and re.fullmatch(_CODE, folder.name):
                unclear_machines[folder.name] = None
    return frozenset(class_folders), list(unclear_machines)


def _series_of(folder_name: str) -> str:
    """Return the name of a folder without its numbers, or without its letter if it is a code."""
    return re.sub(r"\d+", "#", "#" if re.fullmatch(r"[A-Z]", folder_name) else folder_name)


def _find_units_of_healthy(paths: Iterable[PurePosixPath]) -> set[str]:
    """Return the units of sizes in paths of healthy pumps, which are not those of their faults."""
    units: set[str] = set()
    for path in paths:
        if not _is_of_healthy_pump(path):
            continue
        for part in (path.parent.name, path.stem):
            for match in _LEVEL.finditer(part):
                # A healthy pump may be called one with a fault of 0 um.
                if float(match[1].replace(",", ".")) > 0:
                    units.add(match[3].lower())
    return units


def _is_of_healthy_pump(path: PurePosixPath) -> bool:
    return _names_healthy(path.parent.name) or _names_healthy(path.stem)


def _names_healthy(text: str) -> bool:
    """Return whether a word of a name is that of a healthy pump."""
    name_words = [word.lower() for word in _words_without_digits(text)]
    return any(map(is_healthy, name_words)) and _NEGATIONS.isdisjoint(name_words)


def _is_plain_class(folder_name: str) -> bool:
    return not re.search(r"\d", folder_name) and not MACHINE_NAME.fullmatch(folder_name)


def _may_be_class(folder_name: str) -> bool:
    """Return whether a name with digits, or a code, may be a class beside those without."""
    if re.fullmatch(_CODE, folder_name):
        return _FAULT_CODE.fullmatch(folder_name) is not None
    if MACHINE_NAME.fullmatch(folder_name) or _MEASUREMENT.fullmatch(folder_name):
        return False
    if _MONTH.search(folder_name) or _DATE_OR_TIME.search(folder_name):
        return False

    for match in _LEVEL.finditer(folder_name):
        if not _is_size(match) and not _has_unknown_unit(match):
            return False  # an operating point, a duration or a count
    has_word = re.search(r"[^\W\d_]{2}", folder_name) is not None
    return has_word or any(map(_FAULT_CODE.fullmatch, _split_name(folder_name)))


def _find_sizes(text: str, ignored_units: Collection[str]) -> list[str]:
    """Return the numbers of a text that may be sizes of a fault, with their units."""
    return [
        match[0]
        for match in _LEVEL.finditer(text)
        if _is_size(match) and match[3].lower() not in ignored_units
    ]


def _find_numbers_of_unknown_unit(text: str) -> list[str]:
    return [match[0] for match in _LEVEL.finditer(text) if _has_unknown_unit(match)]


def _is_size(level: re.Match[str]) -> bool:
    """Return whether a number has the unit of a length, a share or a multiple."""
    unit = level[3].lower()
    if unit == "%" or (unit in _ADJACENT_SIZE_UNITS and not level[2]):
        return True

    # One letter is never the unit of a size: 1m may be the first of several.
    meaning = _meaning_of_unit(unit)
    return len(unit) > 1 and meaning is not None and meaning.quantity is Quantity.motion


def _has_unknown_unit(level: re.Match[str]) -> bool:
    """Return whether the letters behind a number may be anything, such as a size."""
    unit = level[3].lower()
    is_unit = unit in _NO_SIZE_UNITS or _meaning_of_unit(unit) is not None
    return len(unit) > 1 and not level[2] and not is_unit and not _MONTH.fullmatch(unit)


def _is_labeled_by_folder(path: PurePosixPath, class_folders: Collection[str]) -> bool:
    folder = path.parent
    is_plain = folder.name != "" and _is_plain_class(folder.name)
    return is_plain or str(folder) in class_folders


def label_of_path(path: Path, stem: str, machine_folder: str | None, classes: PathClasses) -> str:
    """Return the parent folder's name, or the words of the file name that tell classes apart.

    Words with a digit do not, unless they are levels.

    Parameters
    ----------
    stem : name of the file without its suffix, its quantities and its machine.
    """
    parent = path.parent.name
    is_class = path.parent.as_posix() in classes.folders or not re.search(r"\d", parent)
    if parent and is_class and parent != machine_folder:
        return parent

    label_words = []
    position = 0
    for match in _LEVEL.finditer(stem):
        if match[0] in classes.levels:
            label_words += _words_without_digits(stem[position : match.start()])
            label_words.append(match[0])
            position = match.end()
    label_words += _words_without_digits(stem[position:])
    if len(label_words) > 1 and label_words[0] == machine_folder:
        label_words = label_words[1:]
    return "_".join(label_words)


def _words_without_digits(text: str) -> list[str]:
    return [part for part in _split_name(text) if part and not re.search(r"\d", part)]


def _split_name(text: str) -> list[str]:
    return re.split(r"[_\-\s.]+", text)


def number_notes(entries: Iterable[Mapping[str, Any]], classes: PathClasses) -> list[Finding]:
    """Return a note that lists the classes which hold numbers of names."""
    labels: dict[str, None] = {}
    for entry in entries:
        label = str(entry.get("label", ""))
        folder = PurePosixPath(entry["file"]).parent.as_posix()
        has_level = not classes.levels.isdisjoint(_find_sizes(label, ignored_units=()))
        if folder in classes.folders or has_level:
            labels[label] = None
    if not labels:
        return []

    message = (
        f"the classes {join_names(list(labels), _MAX_LISTED_CLASSES)} hold numbers or codes, which "
        "may be faults and their sizes, or else machines, operating points or measurements of one "
        "class."
    )
    remedy = "If they are not part of the class, specify it with {label_pattern}."
    return [Finding("numbered_classes", "note", None, message, remedy)]


def unclear_machine_notes(classes: PathClasses) -> list[Finding]:
    """Return a note about folders beside classes that were taken for machines."""
    if not classes.unclear_machines:
        return []

    message = (
        f"the folders {join_names(classes.unclear_machines, _MAX_LISTED_CLASSES)} stand beside "
        "classes and were read as machines (specimen)."
    )
    remedy = "If they are classes, specify them as (?P<label>...) in {label_pattern}."
    return [Finding("unclear_machines", "note", None, message, remedy)]


def unused_number_notes(classes: PathClasses) -> list[Finding]:
    """Return a note about numbers in file names that may be parts of classes."""
    if not classes.unused_levels:
        return []

    listed = join_names(sorted(classes.unused_levels), _MAX_LISTED_CLASSES)
    message = f"found in names, not used: {listed}."
    remedy = "If they are part of the class, specify it with {label_pattern}."
    return [Finding("unused_numbers", "note", None, message, remedy)]


def machine_code_notes(entries: Iterable[Mapping[str, Any]]) -> list[Finding]:
    """Return a note about codes such as P12 in file names that may be those of machines."""
    files = [entry["file"] for entry in entries if "specimen" not in entry]
    codes = Counter(
        code
        for file in files
        for code in set(_split_name(PurePosixPath(file).stem))
        if re.fullmatch(_CODE_IN_FILE_NAME, code)
    )
    # A code of a single file is its number; one of all files tells no machines apart.
    shared = sorted(code for code, count in codes.items() if 1 < count < len(files))
    letters = {code[0] for code in shared}
    if len(shared) < 2 or len(letters) != 1:
        return []

    message = f"found in names, not used: {join_names(shared, _MAX_LISTED_CLASSES)}."
    remedy = "If they are machines, specify them as (?P<specimen>...) in {label_pattern}."
    return [Finding("machine_codes", "note", None, message, remedy)]
