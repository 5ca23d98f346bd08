"""Files read by another process, because a damaged one can crash its library, or make it take all
memory or time.

The process is started when first needed, kept for the next files, and ends with this one. A request
names the file and how to read it, so that a process that was started anew can answer the next one.
Both sides are here: `serve` is what the other process runs. The files that were asked for last stay
open there, but on Windows, where an open file can be neither deleted nor replaced.
"""

import atexit
import errno
import faulthandler
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import (
    MEMORY_VARIABLE,
    DataError,
    SwashTwinError,
    exit_with_parent,
    keep_freed_memory,
    memory_limit,
)
from swashtwin.recordings.formats.clock import split_at_breaks
from swashtwin.recordings.formats.columns import BLOCK_SAMPLES, Column, number_type
from swashtwin.recordings.formats.raw_file import (
    RawFile,
    ReadOptions,
    file_stamp,
    require_unchanged,
)

_PATIENCE = 30.0
"""Seconds that an answer about any file may take."""
_BYTES_PER_SECOND = 2e6
"""Speed below which reading counts as an endless loop."""
_FILES, _BYTES = 64, 1 << 28
"""Most files that stay open, and bytes of samples in memory of these."""
_STAY_OPEN = os.name != "nt"
_COLUMNS = 10_000
"""Most columns that a file of measurements has."""
_LIBRARIES = 1 << 29
"""Bytes that the libraries themselves may take."""
_COMMAND = "from swashtwin.recordings.formats.isolation import serve; serve()"


@dataclass(frozen=True)
class _Source:
    module: str
    function: str
    path: str
    name: str
    """Path as it was typed, for messages."""
    options: ReadOptions
    stamp: tuple[int, int, int]


@dataclass(frozen=True)
class _RemoteColumn:
    """Samples of one column, which the other process reads when they are sliced; it can be
    pickled.
    """

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
        start, stop, stride = span.indices(self.length)
        samples: np.ndarray = _reader.ask(
            self.source, (self.part, self.name, start, max(start, stop))
        )
        if len(samples) != max(0, stop - start) or samples.dtype != self.dtype:
            raise DataError(
                f"{self.source.name}: the file has fewer samples than it states; was it changed?"
            )
        return samples[::stride]


def read_in_subprocess(
    module: str, path: Path, options: ReadOptions, function: str = "read"
) -> Mapping[str, RawFile]:
    """What a function of a module of formats gives for a file: its recordings by name, a single one
    called ``""``.
    """
    source = _Source(module, function, str(path.resolve()), str(path), options, file_stamp(path))
    content: Mapping[str, RawFile] = _reader.ask(source, None)
    return content


class _DiedError(Exception):
    """The other process died before it answered; the argument is how."""


class _Reader:
    """The other process, started when needed, and anew after it has died."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def ask(self, source: _Source, wanted: tuple[str, str | None, int, int] | None) -> Any:
        """The recordings of a file, or the samples `wanted`: recording, column, start and stop."""
        with self._lock:
            for is_second in (
                False,
                True,
            ):  # what an earlier file broke in that process is not blamed on this one
                try:
                    answer = self._exchange(source, wanted)
                    break
                except _DiedError as cause:
                    if is_second or "no end" in str(cause):
                        raise DataError(f"{source.name} is damaged: {cause}.") from cause
        if isinstance(answer, MemoryError):
            raise DataError(
                f"{source.name} of {source.stamp[0] / 1e9:.3g} GB takes more than the limit of "
                f"{memory_limit() / 1e9:.3g} GB of memory to read; if the file is right, set {MEMORY_VARIABLE} to more."
            )
        if isinstance(answer, SwashTwinError):
            raise type(answer)(str(answer).replace(source.path, source.name))
        if isinstance(answer, Exception):
            suffix = "".join(Path(source.name).suffixes[-1:])
            raise DataError(f"{source.name} is damaged, cut off, or no {suffix} file ({answer}).")
        return answer

    def _exchange(self, source: _Source, wanted: tuple[str, str | None, int, int] | None) -> Any:
        process, began = self._running(), time.monotonic()
        seconds = _PATIENCE + source.stamp[0] / _BYTES_PER_SECOND
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump(
                (source, wanted, seconds, os.environ.get(MEMORY_VARIABLE, "")), process.stdin
            )
            process.stdin.flush()
            return pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as cause:
            late, code = time.monotonic() - began >= seconds, self.stop(0.2)
            reason = f"signal {-code}" if code < 0 else f"exit code {code}"
            crash = f"the library that reads it crashed ({reason})"
            raise _DiedError(f"no end was found in {seconds:.0f} s" if late else crash) from cause
        except BaseException:  # an interrupt between a request and its answer
            self.stop()
            raise

    def _running(self) -> "subprocess.Popen[bytes]":
        if self._process is None or self._process.poll() is not None:
            self.stop()
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-c",
                    _COMMAND,
                ],  # -P: nothing is imported from the current folder
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                    "OMP_NUM_THREADS": "1",
                    "OPENBLAS_NUM_THREADS": "1",
                },
            )
        return self._process

    def stop(self, patience: float = 0.0) -> int:
        """Exit code of the process, which is ended where it does not end by itself within
        `patience` [s].
        """
        if self._process is None:
            return 0
        process, self._process = self._process, None
        try:
            process.wait(patience)
        except subprocess.TimeoutExpired:
            process.kill()
        code = process.wait()
        _close(process)
        return code

    def forget(self) -> None:
        """Leave the process to the one that this was forked from."""
        if self._process is not None:
            self._process.returncode = 0  # it is no child of this process
            _close(self._process)
        self.__init__()  # type: ignore[misc]


def _close(process: "subprocess.Popen[bytes]") -> None:
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # it was full when the process died
            pipe and pipe.close()


_reader = _Reader()
stop = _reader.stop
atexit.register(stop)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reader.forget)


# ---- the other process


def serve() -> None:
    """Answer requests from the standard input until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that asks
    exit_with_parent(os.getppid())
    warnings.simplefilter("ignore")
    keep_freed_memory()
    with os.fdopen(os.dup(1), "wb") as answers, open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(2, 1)  # whatever a library prints goes nowhere
        while True:
            try:
                source, wanted, seconds, memory = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            os.environ[MEMORY_VARIABLE] = memory
            faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
            pickle.dump(_answer(source, wanted), answers, protocol=pickle.HIGHEST_PROTOCOL)
            answers.flush()
            faulthandler.cancel_dump_traceback_later()


def _answer(source: _Source, wanted: tuple[str, str | None, int, int] | None) -> Any:
    try:
        try:
            require_unchanged(Path(source.path), source.stamp)
            content = _content(source)
            if wanted is None:
                return {part: _remote(source, part, raw) for part, raw in content.items()}
            part, name, start, stop = wanted
            column = content[part].speeds if name is None else content[part].columns[name]
            assert column is not None
            return np.ascontiguousarray(column[start:stop])
        finally:
            if not _STAY_OPEN:
                _contents.clear()
            require_unchanged(
                Path(source.path), source.stamp
            )  # else what a library says of it misleads
    except Exception as cause:
        if isinstance(cause, MemoryError) or getattr(cause, "errno", None) == errno.ENOMEM:
            _contents.clear()
            return MemoryError()
        if isinstance(cause, SwashTwinError):
            message = (cause.message.splitlines() or [""])[0][:400]
            return type(cause)(message, field=cause.field, remedy=cause.remedy)
        message = (str(cause).splitlines() or [""])[0][:400]
        return RuntimeError(f"{type(cause).__name__}: {message[:160]}")


def _remote(source: _Source, part: str, raw: RawFile) -> RawFile:

    def remote(name: str | None, column: Column) -> _RemoteColumn:
        return _RemoteColumn(source, part, name, len(column), number_type(column))

    columns = {name: remote(name, column) for name, column in raw.columns.items()}
    return replace(
        raw, columns=columns, speeds=None if raw.speeds is None else remote(None, raw.speeds)
    )


_contents: dict[str, tuple[_Source, Mapping[str, RawFile], int]] = {}
"""What the files hold that were asked for last, and bytes of it in memory."""


def _content(source: _Source) -> Mapping[str, RawFile]:
    """What a file holds, read where it is not open."""
    known = _contents.pop(source.path, None)
    if known is None or known[0] != source:
        del known  # the old content first: the HDF5 library would give it again
        for path in [path for path in _contents if not os.path.exists(path)]:
            del _contents[path]  # of a watch, which deletes what it has judged
        known = _read(source)
    _contents[source.path] = known
    while len(_contents) > 1 and (
        len(_contents) > _FILES or sum(size for *_, size in _contents.values()) > _BYTES
    ):
        del _contents[next(iter(_contents))]  # the one that was not asked for the longest
    return known[1]


def _read(source: _Source) -> tuple[_Source, Mapping[str, RawFile], int]:
    _limit_memory()
    module = import_module(f"swashtwin.recordings.formats.{source.module}")
    result = getattr(module, source.function)(Path(source.path), source.options)
    content = {"": split_at_breaks(result)} if isinstance(result, RawFile) else result
    columns = [column for raw in content.values() for column in raw.columns.values()]
    if len(columns) > _COLUMNS and "" in content:
        raise DataError(
            f"{source.path} has more than {_COLUMNS} columns; it is damaged, or no measurement."
        )
    size = sum(
        column.nbytes if isinstance(column, np.ndarray) else BLOCK_SAMPLES for column in columns
    )
    return source, content, size


def _limit_memory() -> None:
    """Let this process take no more than the limit beyond what it has; where the system can do
    that.
    """
    if sys.platform != "linux":
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    limit = pages * resource.getpagesize() + memory_limit() + _LIBRARIES
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(
        resource.RLIMIT_DATA, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard)
    )
