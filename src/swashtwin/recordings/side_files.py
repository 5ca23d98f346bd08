"""Files beside recordings: event logs, slow logs, results, formats that cannot be read."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from swashtwin.foundation import DataError, plural
from swashtwin.recordings.column_roles import (
    NoVibrationError,
    describe_excluded,
    vibration_columns,
)
from swashtwin.recordings.file_formats import open_raw, suffix_of, suffixes
from swashtwin.recordings.findings import join_names
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import acceleration_factor, has_dimension
from swashtwin.recordings.scaling import SENSED_UNIT

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

# Rows up to which a table of words, or with a column of times without a rate, may be of results.
_MAX_TABLE_ROWS = 100

# Rows of a recording for each row of a table beside it: a shorter one may be a short recording.
_MIN_ROW_RATIO = 10

# Lowest rate [Hz] of a vibration: a shaft of 300 rev/min is 5 Hz, and a sine needs two samples.
_MIN_VIBRATION_RATE_HZ = 10.0

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


@dataclass(frozen=True)
class Doubt:
    """Why a file beside recordings is probably not one."""

    reason: str
    """Words that follow the name of the file."""
    n_rows: int | None = None
    """Rows of a short table, which may be a recording beside others as short; else None."""

    def holds_beside(self, max_rows: int) -> bool:
        """Return whether the doubt remains beside recordings of up to `max_rows` rows."""
        return self.n_rows is None or self.n_rows * _MIN_ROW_RATIO <= max_rows


def describe_doubt(path: Path, raw: RawFile, options: ReadOptions) -> Doubt | None:
    """Return why a file is probably not a recording if there are others, or None.

    It holds other quantities than vibration, is too slow for one, or is a short table of results.

    Parameters
    ----------
    raw : content of the file at `path`.
    """
    if "recording_id" in raw.facts:
        return None  # a recording that was written here

    if _holds_no_vibration(raw, options):
        listed = describe_excluded(raw, options, raw.columns)["other_columns"]
        return Doubt(f"holds no vibration: {listed}")

    rates = [raw.rates.get(name, raw.sample_rate) for name in raw.columns]
    known_rates = [rate for rate in rates if rate is not None]
    if known_rates:
        rate = max(known_rates)
        is_slow = rate < _MIN_VIBRATION_RATE_HZ
        return Doubt(f"is a log at {rate:g} Hz, too slow for a vibration") if is_slow else None

    n_rows = len(next(iter(raw.columns.values())))
    is_short = n_rows < _MIN_NUMERIC_LINES
    if n_rows <= _MAX_TABLE_ROWS:
        is_short = is_short or _has_words_or_times(path, options)
    if not is_short:
        return None
    listed = join_names(list(raw.columns))
    return Doubt(f"holds {plural(n_rows, 'row')} of {listed} without a sample rate", n_rows)


def _has_words_or_times(path: Path, options: ReadOptions) -> bool:
    """Return whether a file has a column of words, or one of times that state no rate."""
    # A specified sample rate replaces the times, so that nothing is reported about them.
    raw = open_raw(path, replace(options, sample_rate=None))
    return not raw.attributes.keys().isdisjoint({"text_columns", "time_gaps"})


def _holds_no_vibration(raw: RawFile, options: ReadOptions) -> bool:
    """Return whether units and names say that all columns are of other quantities.

    A specified unit of another quantity than acceleration selects its columns itself.
    """
    unit = options.unit
    if unit not in (None, "1") and acceleration_factor(unit) is None:
        return False
    if any(acceleration_factor(unit) is not None for unit in raw.units.values() if unit != "1"):
        return False  # most files, without reading their values
    if "other_columns" not in describe_excluded(raw, options, raw.columns):
        return False  # states, such as the classes of each sample

    try:
        names = vibration_columns(raw, replace(options, unit="g", sensitivity=None), "a file")
    except NoVibrationError:
        return unit in (None, "1")  # another unit is refused with the columns to select
    except DataError:
        return False  # it cannot be decided, which is reported
    return not any(_may_be_of_vibration(raw.units.get(name)) for name in names)


def _may_be_of_vibration(unit: str | None) -> bool:
    if unit is None or unit == "1" or SENSED_UNIT.fullmatch(unit):
        return True
    is_motion = has_dimension(unit, "m/s") or has_dimension(unit, "m")
    return is_motion or acceleration_factor(unit) is not None


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
