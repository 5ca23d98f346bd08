"""Files read by another process, because a damaged one can crash its library, or make it take all memory or time.

The process (`worker`) is started when first needed and kept for the next files. It ends with this one. Samples come
through its pipe as they are, in parts: a file in shared memory would stay behind where both processes are killed.
"""

import atexit
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import import_module
from io import BufferedReader
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    MissingExtraError,
    MissingFileError,
    UnitError,
    memory_limit,
)
from swashtwin.recordings.columns import BLOCK, file_stamp
from swashtwin.recordings.formats.raw import Options, RawFile

_PATIENCE = 30.0
"""Seconds that any file may take to read."""
_BYTES_PER_SECOND = 2e6
"""Speed below which reading counts as an endless loop."""
_ANSWERED_PER_SECOND = 2e5
"""The same of the samples in the answers: a chunk that is unpacked for each slice of it finds no end."""
_SHORTEST = 0.1
"""Seconds that an answer has in any case."""
_SOURCES = 256
"""Files whose time is kept."""
_TOGETHER = 1 << 24
"""Samples of all columns of a file that are read together."""
_PIPE = 1 << 20
"""Bytes that a pipe holds, where the system lets a program say so: fewer switches between the two processes."""
_MANY = 64
"""Columns from which on neighbors are read together: a table of thousands of short columns takes a few answers."""
_NEIGHBORS = 1 << 16
"""Samples of neighboring columns that are read with the one that is asked for."""
_KINDS = {
    kind.__name__: kind
    for kind in (ArtifactError, DataError, InputError, MissingExtraError, MissingFileError, UnitError)
}
"""Errors that the other process may report as they are."""


def read_in_subprocess(module: str, path: Path, options: Options, function: str = "read") -> Mapping[str, RawFile]:
    """What ``swashtwin.recordings.formats.MODULE.FUNCTION`` gives for a file, by name; a single one is called ``""``.

    The columns read when they are sliced, in the other process too. They can be pickled, and hold no file open.

    Raises
    ------
    DataError
        The file is damaged, or its library crashes on it, takes more memory than `memory_limit`, or finds no end.
    MissingExtraError
        The library is not installed.
    """
    stat = file_stamp(path)
    source = _Source(module, function, str(path.resolve()), str(path), options, stat)
    answer, _ = _process.ask(source, {})
    return {name: _raw_file(source, name, content) for name, content in answer["recordings"].items()}


@dataclass(frozen=True)
class _Source:
    """A file, and how it is read."""

    module: str
    function: str
    path: str
    name: str
    """Path as it was typed, for messages."""
    options: Options
    stamp: tuple[int, int, int]

    def request(self) -> dict[str, Any]:
        """What the other process needs to read it."""
        return {
            "module": self.module,
            "function": self.function,
            "path": self.path,
            "options": asdict(self.options),
            "stamp": self.stamp,
        }

    def seconds(self, answered: int = 0) -> float:
        """Longest time [s] that all answers since it was opened may take, `answered` bytes of samples among them."""
        return _PATIENCE + self.stamp[0] / _BYTES_PER_SECOND + answered / _ANSWERED_PER_SECOND


def _raw_file(source: _Source, part: str, content: dict[str, Any]) -> RawFile:
    listed = content["columns"]
    step = max(1024, min(BLOCK, _TOGETHER // max(1, len(listed))))
    shapes = [(length, np.dtype(dtype)) for _, length, dtype in listed]
    neighbors = _Neighbors(source, part, shapes)
    columns = {name: _Column(neighbors, number, step) for number, (name, _, _) in enumerate(listed)}
    speeds = None
    if content["speeds"] is not None:
        length, dtype = content["speeds"]
        speeds = _Column(_Neighbors(source, part, [(length, np.dtype(dtype))]), None, step)
    facts = {name: content[name] for name in ("sample_rate", "units", "attributes", "facts", "full_scale", "rates")}
    return RawFile(columns, speeds=speeds, **facts)


class _Neighbors:
    """Columns of one recording, some of which the other process reads together."""

    def __init__(self, source: _Source, part: str, shapes: list[tuple[int, np.dtype]]) -> None:
        self._source = source
        self._part = part
        self.shapes = shapes
        self._ahead: dict[tuple[int, int, int], np.ndarray] = {}
        """Samples that were read with an earlier column, by column, start and stop."""

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return _Neighbors, (self._source, self._part, self.shapes)

    def read(self, number: int | None, start: int, samples: np.ndarray) -> None:
        """Fill `samples` with those of a column from `start` on; None is the column of speeds."""
        stop = start + len(samples)
        if number is None or len(self.shapes) < _MANY or len(samples) > _NEIGHBORS // 2:
            self._ask(number, 1, start, samples)
            return
        key = (number, start, stop)
        if (ahead := self._ahead.pop(key, None)) is None:
            following = self.shapes[number : number + _NEIGHBORS // max(1, len(samples))]
            count = len(list(takewhile(lambda shape: shape == following[0], following)))
            together = np.empty((count, len(samples)), samples.dtype)
            self._ask(number, count, start, together)
            ahead = together[0]
            self._ahead = {(number + row, start, stop): together[row] for row in range(1, count)}
        samples[:] = ahead

    def _ask(self, number: int | None, count: int, start: int, samples: np.ndarray) -> None:
        stop = start + samples.shape[-1]
        request = {"part": self._part, "column": number, "count": count, "start": start, "stop": stop}
        _process.ask(self._source, request, samples)


class _Column:
    """Samples of one column, which the other process reads when they are sliced."""

    def __init__(self, neighbors: _Neighbors, number: int | None, step: int) -> None:
        self._neighbors = neighbors
        self._number = number
        self._length, self.dtype = neighbors.shapes[number or 0]
        self._step = step

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, stride = span.indices(self._length)
        samples = np.empty(max(0, stop - start), self.dtype)
        for at in range(0, len(samples), self._step):
            self._neighbors.read(self._number, start + at, samples[at : at + self._step])
        return samples[::stride]


class _Process:
    """The other process, started when needed, and anew after it has died."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._popen: subprocess.Popen[bytes] | None = None
        self._first: str | None = None
        """The first file that the process was asked for."""
        self._several = False
        """Whether it was asked for others too."""
        self._excess = False
        """Whether the process was ended because of its memory."""
        self._spent: dict[str, tuple[float, int]] = {}
        """Time [s] that the answers of each file took, and bytes of samples in them."""

    def ask(
        self, source: _Source, request: dict[str, Any], samples: np.ndarray | None = None
    ) -> tuple[dict[str, Any], np.ndarray | None]:
        """The answer to a request; `samples` are filled by it."""
        size = 0 if samples is None else samples.nbytes
        with self._lock:
            spent, answered = (0.0, 0) if samples is None else self._spent.get(source.path, (0.0, 0))
            seconds, began = max(source.seconds(answered + size) - spent, _SHORTEST), time.monotonic()
            question = {"source": source.request(), "seconds": seconds, "memory": repr(memory_limit() / 1e9), **request}
            line = json.dumps(question).encode() + b"\n"
            others = self._several or self._first not in (None, source.path)
            try:
                answer = self._exchange(source, line, seconds, samples)
            except _DiedError as cause:
                if not (others and cause.retry):
                    raise DataError(self._obituary(source, cause)) from cause
                try:  # what an earlier file broke in that process must not be blamed on this one
                    answer = self._exchange(source, line, seconds, samples)
                except _DiedError as again:
                    raise DataError(self._obituary(source, again)) from again
            self._spent.pop(source.path, None)
            self._spent[source.path] = (spent + time.monotonic() - began, answered + size)
            while len(self._spent) > _SOURCES:
                self._spent.pop(next(iter(self._spent)))
        if "error" not in answer:
            return answer, samples
        message = answer["error"].replace(source.path, source.name)
        if answer["kind"] == "MemoryError":
            raise DataError(self._over_limit(source))
        if answer["kind"] in _KINDS:
            raise _KINDS[answer["kind"]](message)
        suffix = "".join(Path(source.name).suffixes[-1:])
        raise DataError(f"{source.name} is damaged, cut off, or no {suffix} file ({message[:160]}).")

    def _exchange(self, source: _Source, line: bytes, seconds: float, samples: np.ndarray | None) -> dict[str, Any]:
        process, began = self._running(), time.monotonic()
        self._several = self._several or self._first not in (None, source.path)
        self._first = self._first or source.path
        assert process.stdin is not None
        assert isinstance(process.stdout, BufferedReader)
        try:
            process.stdin.write(line)
            process.stdin.flush()
            answer: dict[str, Any] = json.loads(process.stdout.readline())
            if "error" not in answer and samples is not None:
                if (answer["count"], answer["dtype"]) != (samples.size, samples.dtype.str):
                    raise DataError(f"{source.name}: the file has fewer samples than it states; was it changed?")
                if process.stdout.readinto(samples.data.cast("B")) != samples.nbytes:
                    raise EOFError
        except (OSError, ValueError, EOFError) as cause:
            if isinstance(cause, DataError):
                self._end()
                raise
            late, excess = time.monotonic() - began >= seconds, self._excess
            code = self._end()
            raise _DiedError(code, late=late, excess=excess) from cause
        except BaseException:  # an interrupt between a request and its answer
            self._end()
            raise
        return answer

    def _obituary(self, source: _Source, death: "_DiedError") -> str:
        if death.excess:
            return self._over_limit(source)
        if death.late:
            return f"{source.name} is damaged: no end was found in {source.seconds():.0f} s."
        reason = f"signal {-death.code}" if death.code < 0 else f"exit code {death.code}"
        return f"{source.name} is damaged: the library that reads it crashed ({reason})."

    @staticmethod
    def _over_limit(source: _Source) -> str:
        return (
            f"{source.name} of {source.stamp[0] / 1e9:.3g} GB takes more than the limit of "
            f"{memory_limit() / 1e9:.3g} GB of memory to read; if the file is right, set SWASHTWIN_MEMORY_GB to more."
        )

    def _running(self) -> "subprocess.Popen[bytes]":
        if self._popen is None or self._popen.poll() is not None:
            self._end()
            self._excess = False
            self._popen = subprocess.Popen(
                # -P: nothing is imported from the current folder
                [sys.executable, "-P", "-m", "swashtwin.recordings.formats.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                pipesize=_PIPE,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                    "OMP_NUM_THREADS": "1",
                    "OPENBLAS_NUM_THREADS": "1",
                },
            )
            if sys.platform != "linux":
                threading.Thread(target=self._watch_memory, args=(self._popen,), daemon=True).start()
        return self._popen

    def _watch_memory(self, process: "subprocess.Popen[bytes]") -> None:
        """End a process that takes more than the limit, where the system does not do that."""
        psutil, limit = import_module("psutil"), memory_limit()
        try:
            watched = psutil.Process(process.pid)
            base = watched.memory_info().rss
            while process.poll() is None:
                if watched.memory_info().rss > base + limit:
                    self._excess = True
                    process.kill()
                time.sleep(0.1)
        except psutil.NoSuchProcess:
            return

    def _end(self) -> int:
        """Exit code of the process, which is ended where there is one."""
        if self._popen is None:
            return 0
        process, self._popen = self._popen, None
        self._first, self._several = None, False
        try:
            process.wait(0.2 if process.poll() is None else 0)  # it may be dying: its own exit code tells more
        except subprocess.TimeoutExpired:
            process.kill()
        code = process.wait()
        _close(process)
        return code

    def stop(self) -> None:
        """End the process, where there is one."""
        with self._lock:
            if self._popen is not None:
                self._popen.kill()
            self._end()

    def forget(self) -> None:
        """Leave the process to the one that this was forked from."""
        self._lock = threading.Lock()
        if self._popen is not None:
            self._popen.returncode = 0  # it is no child of this process
            _close(self._popen)
        self._popen = None
        self._first, self._several = None, False


class _DiedError(Exception):
    """The other process died before it answered."""

    def __init__(self, code: int, *, late: bool, excess: bool) -> None:
        super().__init__(code)
        self.code = code
        self.late = late
        self.excess = excess
        self.retry = not late and not excess


def _close(process: "subprocess.Popen[bytes]") -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            try:
                pipe.close()
            except OSError:
                continue  # it was full when the process died


_process = _Process()
atexit.register(_process.stop)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_process.forget)


def stop() -> None:
    """End the process that reads files, where there is one."""
    _process.stop()
