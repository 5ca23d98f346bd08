"""Files beside recordings: event logs, descriptions of the device, formats that cannot be read."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from swashtwin.foundation import plural
from swashtwin.recordings.file_formats import suffix_of, suffixes
from swashtwin.recordings.findings import join_names

# Suffixes of tables as text.
_TEXT_SUFFIXES = frozenset({".csv", ".tsv", ".txt", ".dat"})

# Bytes up to which a file is searched for words: a log of events is short.
_MAX_BYTES = 1 << 16

# Size over that of the largest file up to which a file may belong to another one.
_MAX_RELATIVE_SIZE = 0.1

# Share of cells below the heading that begin with a letter, from which a table holds words.
_MIN_WORD_SHARE = 1 / 3

# Lines of numbers alone from which a file is a recording, however long its header is.
_MIN_NUMERIC_LINES = 20

# Bytes of a text file in which names of other files are searched.
_MAX_HEAD_BYTES = 1 << 16

# Suffixes of documents, pictures, programs and files of swashtwin, which hold no measured samples.
_NO_SAMPLES = frozenset(
    {
        *(".toml", ".safetensors"),
        *(".md", ".rst", ".html", ".pdf", ".doc", ".docx", ".ppt", ".pptx", ".url", ".lnk"),
        *(".png", ".jpg", ".jpeg", ".svg", ".gif"),
        *(".py", ".ipynb", ".m", ".ini"),
    }
)

# Files that Windows and macOS write into folders.
_SYSTEM_FILES = frozenset({"thumbs.db", "icon\r"})

_WORD = re.compile(r"(?!(?:nan|inf|null|none)\b)[^\W\d_]{2}", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?[\d.,:]+(?:[eE][+-]?\d+)?")


def find_side_files(folder: Path, names: Sequence[str]) -> list[str]:
    """Return those of the files that hold words and few numbers, and are small beside the others.

    Parameters
    ----------
    names : paths relative to `folder` of all files that could be recordings.
    """
    sizes = {name: (folder / name).stat().st_size for name in names}
    max_size = min(_MAX_RELATIVE_SIZE * max(sizes.values(), default=0), _MAX_BYTES)
    return [
        name
        for name, size in sizes.items()
        if size <= max_size
        and Path(name).suffix.lower() in _TEXT_SUFFIXES
        and _holds_words((folder / name).read_text(encoding="utf-8", errors="replace"))
    ]


def _holds_words(text: str) -> bool:
    """Return whether the cells of a table below its heading are words rather than numbers."""
    delimiter = max(",;\t", key=text.count)
    n_cells = 0
    n_words = 0
    n_numeric_lines = 0
    for line in text.splitlines()[1:]:
        cells = [cell.strip(" \"'") for cell in line.split(delimiter)]
        cells = [cell for cell in cells if cell]
        n_cells += len(cells)
        n_words += sum(bool(_WORD.match(cell)) for cell in cells)
        n_numeric_lines += bool(cells) and all(map(_NUMBER.fullmatch, cells))
    return (
        n_numeric_lines < _MIN_NUMERIC_LINES
        and n_words > 0
        and (n_words >= _MIN_WORD_SHARE * n_cells)
    )


def find_unreadable_files(folder: Path) -> list[str]:
    """Return the relative paths of the files whose format cannot be read, without documents.

    Hidden files, and those of the operating system, are left out.
    """
    skipped_suffixes = {*suffixes(), *_NO_SAMPLES}
    names = []
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        is_hidden = any(part.startswith(".") for part in relative.parts)
        is_of_system = path.name.lower() in _SYSTEM_FILES
        if is_hidden or is_of_system or suffix_of(path) in skipped_suffixes:
            continue
        if path.is_file():
            names.append(relative.as_posix())
    return names


def describe_other_files(folder: Path) -> str:
    """Return the suffixes of the files of a folder, to continue a sentence with."""
    counts = Counter(
        path.suffix.lower()
        for path in folder.rglob("*.*")
        if path.is_file() and not path.name.startswith(".")
    )
    listed = [plural(count, f"{suffix} file") for suffix, count in counts.most_common()]
    return f", but {join_names(listed)}" if listed else ""


def find_named_file(path: Path, names: Sequence[str]) -> str | None:
    """Return a file of the folder that another one names in its first lines."""
    with path.open("rb") as file:
        head = file.read(_MAX_HEAD_BYTES).decode(errors="replace")

    for name in names:
        file_name = Path(name).name
        if file_name != path.name and file_name in head:
            return name
    return None
