"""Classes that the paths of a folder state, and the numbers in names that tell classes apart."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from swashtwin.recordings.findings import Finding, join_names

MACHINE_NOUNS = r"pumpe?|machine|maschine|anlage|aggregat|pr(?:üf|uef|uf)ling|specimen|dut"
"""Words for a machine, as a regular expression in small letters."""

_MACHINE_NUMBER = r"(?:[ _-]?\d{1,9}|(?:[ _-]|(?<=[a-z]))[A-Z]\d{0,3})"

# A machine, or a class such as B007 if the folders beside it are classes.
_CODE = r"[A-Z]\d{0,3}"

MACHINE_NAME = re.compile(
    rf"(?i:{MACHINE_NOUNS}|pr(?:üf|uef)stand|rig|unit|sn|serial|nr|no)"
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

# Units of sizes, which may stand apart from their number.
_SIZE_UNITS = frozenset({"um", "µm", "μm", "mm", "mil", "mils", "%"})

# Units of operating points, rates, times and orders, which no class has.
_OTHER_UNITS = frozenset(
    [
        *("hz", "khz", "mhz", "k", "s", "ms", "us", "min", "h", "c", "degc", "°c", "f"),
        *("n", "kn", "nm", "w", "kw", "v", "mv", "a", "ma", "rpm", "upm", "kg", "l", "db"),
        *("bar", "mbar", "mpa", "kpa", "hpa", "psi", "bit", "ch", "st", "nd", "rd", "th"),
    ]
)

# Words whose number counts measurements.
_MEASUREMENT_WORDS = (
    r"run|test|day|tag|messung|measurement|rec|recording|session|trial|set|part|versuch|lauf|exp|"
    r"file|data|week|month"
)
_MEASUREMENT = re.compile(rf"(?i:{_MEASUREMENT_WORDS})[ _-]?\d+")

_MAX_LISTED_CLASSES = 6


@dataclass(frozen=True)
class PathClasses:
    """What tells classes apart in the paths of all files of a folder."""

    folders: frozenset[str] = frozenset()
    """Relative paths of folders whose names with digits, or codes such as B, are classes."""
    levels: frozenset[str] = frozenset()
    """Numbers with a unit that are parts of the classes in file names."""

    @classmethod
    def find(cls, names: Sequence[str]) -> "PathClasses":
        """Return those of the relative paths of all files."""
        folders = {str(PurePosixPath(name).parent) for name in names} - {"."}
        siblings: dict[str, list[str]] = {}
        for folder in folders:
            siblings.setdefault(str(PurePosixPath(folder).parent), []).append(folder)

        class_folders: set[str] = set()
        for group in siblings.values():
            has_class = any(_is_plain_class(PurePosixPath(folder).name) for folder in group)
            for folder in group:
                folder_name = PurePosixPath(folder).name
                is_class = _find_levels(folder_name) or (has_class and _may_be_class(folder_name))
                if is_class and not _is_plain_class(folder_name):
                    class_folders.add(folder)

        counts = Counter(
            level for name in names for level in set(_find_levels(PurePosixPath(name).stem))
        )
        levels = {
            level
            for level, count in counts.items()
            # What all files have tells none apart, and what one has may be its number.
            if count < len(names) and (count > 1 or re.search(r"\d[.,]\d", level))
        }
        return cls(frozenset(class_folders), frozenset(levels))


def _is_plain_class(folder_name: str) -> bool:
    return not re.search(r"\d", folder_name) and not MACHINE_NAME.fullmatch(folder_name)


def _may_be_class(folder_name: str) -> bool:
    """Return whether a name with digits, or a code, may be a class beside those without."""
    if re.fullmatch(_CODE, folder_name):
        return True
    is_other = MACHINE_NAME.fullmatch(folder_name) or _MEASUREMENT.fullmatch(folder_name)
    has_other_unit = any(match[3].lower() in _OTHER_UNITS for match in _LEVEL.finditer(folder_name))
    return bool(re.search(r"[^\W\d_]{2}|[^\W\d_]\d", folder_name)) and not (
        is_other or has_other_unit
    )


def _find_levels(text: str) -> list[str]:
    levels = []
    for match in _LEVEL.finditer(text):
        unit = match[3].lower()
        is_size = unit in _SIZE_UNITS
        if is_size or (not match[2] and unit not in _OTHER_UNITS):
            levels.append(match[0])
    return levels


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
    name_parts = re.split(r"[_\-\s.]+", text)
    return [part for part in name_parts if part and not re.search(r"\d", part)]


def number_notes(entries: Iterable[Mapping[str, Any]], classes: PathClasses) -> list[Finding]:
    """Return a note that lists the classes which hold numbers of names."""
    labels: dict[str, None] = {}
    for entry in entries:
        label = str(entry.get("label", ""))
        folder = PurePosixPath(entry["file"]).parent.as_posix()
        has_level = not classes.levels.isdisjoint(_find_levels(label))
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


def machine_code_notes(entries: Iterable[Mapping[str, Any]]) -> list[Finding]:
    """Return a note about codes such as P12 in file names that may be those of machines."""
    files = [entry["file"] for entry in entries if "specimen" not in entry]
    codes = Counter(
        code
        for file in files
        for code in set(re.split(r"[_\-\s.]+", PurePosixPath(file).stem))
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
