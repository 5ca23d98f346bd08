"""Files read by a child process, because a damaged file can crash its library, or exhaust memory.

The process is started when it is first needed, kept for the next files, and ends with this one.
Each request names the file and how to read it, so that a process that was started anew can answer
it. Both sides are here: the functions of the second part run in the child process. It keeps the
files open that were requested last, but not on Windows, where an open file can be neither deleted
nor replaced.
"""

import errno
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import (
    MEMORY_VARIABLE,
    ChildDiedError,
    ChildProcess,
    ChildTimeoutError,
    DataError,
    FileStamp,
    SwashTwinError,
    file_stamp,
    memory_limit,
)
from swashtwin.recordings.columns import BLOCK_SAMPLES, Column, number_type
from swashtwin.recordings.formats.clock import split_at_breaks
from swashtwin.recordings.formats.column_store import StoredColumn
from swashtwin.recordings.formats.raw_file import (
    RawFile,
    ReadOptions,
    require_unchanged,
)
from swashtwin.recordings.formats.signatures import require_no_text

# Time limit for a request about an empty file; damaged files can loop without an end.
_READ_TIMEOUT_S = 30.0

# Slowest reading [byte/s] of a sound file, which adds to the time limit of large files.
_MIN_READ_SPEED = 2e6

_MAX_OPEN_FILES = 64

# Samples in memory, or in temporary files, of all open files [byte].
_MAX_OPEN_BYTES = 1 << 28

_KEEPS_FILES_OPEN = os.name != "nt"

# Modules whose files are texts.
_TEXT_MODULES = ("csv", "uff")

# Columns of a file of measurements; a damaged header can state billions.
_MAX_COLUMNS = 10_000


@dataclass(frozen=True)
class _Source:
    """A file, and the function that reads it."""

    module: str
    function: str
    path: str
    """Absolute path."""
    name: str
    """Path as the user wrote it, for messages."""
    options: ReadOptions
    stamp: FileStamp
    """Of `file_stamp`."""


@dataclass(frozen=True)
class _RemoteColumn:
    """Column whose samples the child process reads; it can be pickled without them."""

    source: _Source
    part: str
    """Recording within the file."""
    name: str | None
    """Column, or None for the speeds."""
    length: int
    dtype: np.dtype

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(self.length)
        samples: np.ndarray = _request(
            self.source, _read_samples, self.part, self.name, start, max(start, stop)
        )
        if len(samples) != max(0, stop - start) or samples.dtype != self.dtype:
            raise DataError(
                f"{self.source.name}: the file has fewer samples than it states; was it changed?"
            )
        return samples[::step]


reader = ChildProcess()
stop = reader.stop


def read_in_subprocess(
    module: str, path: Path, options: ReadOptions, function: str = "read"
) -> Mapping[str, RawFile]:
    """Return the recordings of a file by name; a single recording has the name ``""``.

    Parameters
    ----------
    module : module of this package that reads the file.
    function : its function, called with the path and the options.
    """
    source = _Source(module, function, str(path.resolve()), str(path), options, file_stamp(path))
    content: Mapping[str, RawFile] = _request(source, _read_content)
    return content


def _request(source: _Source, function: Any, *arguments: object) -> Any:
    """Return the result of one of the functions below, run by the child process.

    Raises
    ------
    DataError
        The file is damaged: its library raised, crashed, looped, or took too much memory.
    SwashTwinError
        Whatever the reader of the format raised on purpose.
    """
    environment_limit = os.environ.get(MEMORY_VARIABLE, "")
    timeout_s = _READ_TIMEOUT_S + source.stamp.size / _MIN_READ_SPEED

    def call() -> Any:
        return reader.call(
            _answer,
            environment_limit,
            source,
            function,
            *arguments,
            timeout_s=timeout_s,
            memory_bytes=memory_limit(),
        )

    try:
        try:
            return call()
        except ChildTimeoutError:
            raise
        except ChildDiedError:
            # An earlier file may have corrupted the process, so that this one is not to blame: it
            # is, if it also crashes a fresh process.
            return call()
    except ChildTimeoutError as cause:
        raise DataError(
            f"{source.name} is damaged: no end was found in {timeout_s:.0f} s."
        ) from cause
    except ChildDiedError as cause:
        raise DataError(
            f"{source.name} is damaged: the library that reads it crashed ({cause.reason})."
        ) from cause
    except MemoryError as cause:
        raise DataError(
            f"{source.name} of {source.stamp.size / 1e9:.3g} GB takes more than the limit of "
            f"{memory_limit() / 1e9:.3g} GB of memory to read; if the file is right, set "
            f"{MEMORY_VARIABLE} to more."
        ) from cause
    except SwashTwinError as cause:
        message = cause.message.replace(source.path, source.name)
        raise type(cause)(message, field=cause.field, remedy=cause.remedy) from None
    except _LibraryError as cause:
        if source.module not in _TEXT_MODULES:
            require_no_text(Path(source.name))
        suffix = "".join(Path(source.name).suffixes[-1:])
        raise DataError(
            f"{source.name} is damaged, cut off, or not a {suffix} file ({cause})."
        ) from None


# ---- in the child process


class _LibraryError(Exception):
    """A library failed to read a file; the argument is its error as one line."""


def _answer(environment_limit: str, source: _Source, function: Any, *arguments: Any) -> Any:
    """Return ``function(source, *arguments)``, with errors that the other side can show."""
    os.environ[MEMORY_VARIABLE] = environment_limit
    path = Path(source.path)
    try:
        try:
            require_unchanged(path, source.stamp)
            return function(source, *arguments)
        finally:
            if not _KEEPS_FILES_OPEN:
                _open_files.clear()
            # A file that was changed while it was read: what its library reports would mislead.
            require_unchanged(path, source.stamp)
    except Exception as cause:
        if isinstance(cause, MemoryError) or getattr(cause, "errno", None) == errno.ENOMEM:
            _open_files.clear()
            raise MemoryError from cause
        if isinstance(cause, SwashTwinError):
            message = _first_line(cause.message, 400)
            raise type(cause)(message, field=cause.field, remedy=cause.remedy) from cause
        raise _LibraryError(f"{type(cause).__name__}: {_first_line(str(cause), 160)}") from cause


def _first_line(message: str, max_length: int) -> str:
    lines = message.splitlines() or [""]
    return lines[0][:max_length]


def _read_content(source: _Source) -> dict[str, RawFile]:
    """Return the recordings of a file with columns that stay in this process."""
    content = _open_file(source)
    return {part: _with_remote_columns(source, part, raw) for part, raw in content.items()}


def _with_remote_columns(source: _Source, part: str, raw: RawFile) -> RawFile:
    def remote_column(name: str | None, column: Column) -> _RemoteColumn:
        return _RemoteColumn(source, part, name, len(column), number_type(column))

    columns = {name: remote_column(name, column) for name, column in raw.columns.items()}
    speeds = None if raw.speeds is None else remote_column(None, raw.speeds)
    return replace(raw, columns=columns, speeds=speeds)


def _read_samples(
    source: _Source, part: str, name: str | None, start: int, stop: int
) -> np.ndarray:
    """Return the samples of a column, or of the speeds if `name` is None."""
    raw = _open_file(source)[part]
    column = raw.speeds if name is None else raw.columns[name]
    assert column is not None
    return np.ascontiguousarray(column[start:stop])


@dataclass(frozen=True)
class _OpenFile:
    source: _Source
    content: Mapping[str, RawFile]
    size: int
    """Samples in memory [byte]."""


# Files by their paths, the one that was requested last at the end.
_open_files: dict[str, _OpenFile] = {}


def _open_file(source: _Source) -> Mapping[str, RawFile]:
    """Return the recordings of a file, which is read if it is not open."""
    file = _open_files.pop(source.path, None)
    if file is None or file.source != source:
        # Closed before the file is opened again, or the HDF5 library returns its old content.
        del file

        # A watch deletes the recordings that it has judged: open, they would keep their disk space.
        for path in [path for path in _open_files if not os.path.exists(path)]:
            del _open_files[path]

        file = _read_file(source)

    _open_files[source.path] = file
    while len(_open_files) > 1 and (
        len(_open_files) > _MAX_OPEN_FILES
        or sum(open_file.size for open_file in _open_files.values()) > _MAX_OPEN_BYTES
    ):
        del _open_files[next(iter(_open_files))]
    return file.content


def _read_file(source: _Source) -> _OpenFile:
    module = import_module(f"swashtwin.recordings.formats.{source.module}")
    result = getattr(module, source.function)(Path(source.path), source.options)
    content = {"": split_at_breaks(result)} if isinstance(result, RawFile) else result

    columns = [column for raw in content.values() for column in raw.columns.values()]
    if len(columns) > _MAX_COLUMNS and "" in content:  # a store may hold as many in all
        raise DataError(
            f"{source.path} has more than {_MAX_COLUMNS} columns; it is damaged, "
            "or not a measurement."
        )

    size = 0
    for column in columns:
        size += column.nbytes if isinstance(column, np.ndarray | StoredColumn) else BLOCK_SAMPLES
    return _OpenFile(source, content, size)
