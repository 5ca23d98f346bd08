"""Arrays and tables whose shape is not that of one recording: windows, or three axes."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from math import prod
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import Column
from swashtwin.recordings.formats.raw_file import ReadOptions

# Numbered columns from which on they may be the samples of windows, one window in each row.
_MIN_WINDOW_COLUMNS = 16

# Rows for each such column from which on they are samples of a recording: a quarter of a second of
# 64 microphones has more.
_MAX_ROWS_PER_COLUMN = 64


def describe_shape(name: str, shape: tuple[int, ...]) -> str:
    """Return name and lengths of an array as text.

    Examples
    --------
    >>> describe_shape("data", (6, 2, 512))
    'data (6 x 2 x 512)'
    """
    return f"{name} ({' x '.join(str(length) for length in shape)})"


def require_small_arrays(
    path: Path,
    shapes: Mapping[str, tuple[int, ...]],
    columns: Mapping[str, Column],
    options: ReadOptions,
) -> None:
    """Refuse a file whose largest array has three axes, unless the options select channels.

    Parameters
    ----------
    shapes : shapes of the arrays of more than two axes, which yield no columns.
    """
    if not shapes or options.channels is not None:
        return
    name, shape = max(shapes.items(), key=lambda item: prod(item[1]))
    if prod(shape) <= sum(len(column) for column in columns.values()):
        return
    raise DataError(
        f"{path}: the array {describe_shape(name, shape)} has {len(shape)} axes, such as windows, "
        "channels and samples, and a recording has two.",
        field="channels",
        remedy="Save each recording as a matrix of samples by channels, or select vectors with "
        "{channels}.",
    )


def require_recording_shape(
    path: Path, columns: Mapping[str, Column], options: ReadOptions
) -> None:
    """Refuse a table of many numbered columns and few rows, unless the options select channels.

    Each row may be a window, and each column a sample of it.
    """
    if len(columns) < _MIN_WINDOW_COLUMNS or options.channels is not None:
        return

    counts = Counter((re.sub(r"\d+", "", name), len(column)) for name, column in columns.items())
    for (family, n_rows), n_columns in counts.items():
        if n_columns >= _MIN_WINDOW_COLUMNS and n_rows < _MAX_ROWS_PER_COLUMN * n_columns:
            names = [name for name in columns if re.sub(r"\d+", "", name) == family]
            raise DataError(
                f"{path} has {n_columns} numbered columns of {n_rows} samples: does each row hold "
                "a window, or a spectrum?",
                field="channels",
                remedy="If so, save the samples of each recording as one column; if each column is "
                f"a channel, select them with {{channels}}{_example_of(names, columns)}.",
            )


def _example_of(names: Sequence[str], columns: Iterable[str]) -> str:
    """Return the pattern that selects these columns and no other as an example for a message."""
    word = re.split(r"\W|\d", names[0])[0]  # names differ in their numbers only
    for pattern in ("*", f"{word}*"):
        if [column for column in columns if fnmatchcase(column, pattern)] == list(names):
            return f", such as {pattern!r}"
    return " by their names"
