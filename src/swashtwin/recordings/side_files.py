"""Text files that recorders write beside a recording: event logs, descriptions of the device."""

import re
from collections.abc import Sequence
from pathlib import Path

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
