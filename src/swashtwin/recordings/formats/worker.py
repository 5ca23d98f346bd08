"""The process that reads files for another: a library that crashes, or finds no end, ends this process only.

Run as a module it answers requests, each a line of JSON, by a line of JSON and, for samples, their bytes. A request
names the file and how to read it, so that a process that was started anew can answer the next one. The files that were
asked for last stay open, but on Windows, where an open file can be neither deleted nor replaced.
"""

import errno
import faulthandler
import json
import os
import signal
import sys
import warnings
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from swashtwin.foundation import MEMORY_VARIABLE, DataError, SwashTwinError, end_with, keep_freed_memory, memory_limit
from swashtwin.recordings.columns import Column, number_type, require_unchanged
from swashtwin.recordings.formats.raw import Options, RawFile

_STAY_OPEN = os.name != "nt"
"""Whether files stay open between two requests."""
_FILES = 64
"""Most files that stay open."""
_BYTES = 1 << 28
"""Most bytes of samples in memory of files that stay open."""
_SPOOLED = 1 << 24
"""Most bytes of a file in memory whose columns read when they are sliced."""
_COLUMNS = 10_000
"""Most columns that a file of measurements has."""
_LIBRARIES = 1 << 29
"""Bytes that the libraries themselves may take."""
_MESSAGE = 400
"""Longest message, in characters."""

Content = Mapping[str, RawFile]
"""Recordings of one file by their name within it; a file of one recording calls it ``""``."""


class _Files:
    """The files that were asked for last."""

    def __init__(self) -> None:
        self._contents: dict[str, tuple[Content, int]] = {}

    def content(self, source: dict[str, Any]) -> Content:
        """What a file holds, read where it is not open."""
        key = json.dumps(source, sort_keys=True)
        if key in self._contents:
            self._contents[key] = self._contents.pop(key)
            return self._contents[key][0]
        _limit_memory()
        module = import_module(f"swashtwin.recordings.formats.{source['module']}")
        result = getattr(module, source["function"])(Path(source["path"]), Options(**source["options"]))
        content: Content = {"": result} if isinstance(result, RawFile) else result
        columns = [column for raw in content.values() for column in raw.columns.values()]
        if max((len(raw.columns) for raw in content.values()), default=0) > _COLUMNS:
            raise DataError(f"{source['path']} has more than {_COLUMNS} columns; it is damaged, or no measurement.")
        size = sum(8 * len(column) for column in columns)
        if not all(isinstance(column, np.ndarray) for column in columns):
            size = min(size, _SPOOLED)
        self._contents[key] = content, size
        while len(self._contents) > 1 and (
            len(self._contents) > _FILES or sum(count for _, count in self._contents.values()) > _BYTES
        ):
            del self._contents[next(iter(self._contents))]  # the one that was not asked for the longest
        return content

    def close(self) -> None:
        """Close every open file; what is in memory as a whole stays there."""
        for key, (content, _) in list(self._contents.items()):
            if not all(isinstance(column, np.ndarray) for raw in content.values() for column in raw.columns.values()):
                del self._contents[key]

    def clear(self) -> None:
        """Close and forget every file."""
        self._contents.clear()


def _columns(raw: RawFile, number: int | None, count: int) -> list[Column]:
    if number is None:
        assert raw.speeds is not None
        return [raw.speeds]
    return list(raw.columns.values())[number : number + count]


def _answer(files: _Files, request: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray | None]:
    """The answer to a request, and the samples that follow it."""
    source = request["source"]
    path, stamp = Path(source["path"]), tuple(source["stamp"])
    try:
        require_unchanged(path, stamp)
        if "part" not in request:
            return {"recordings": {name: _facts(raw) for name, raw in files.content(source).items()}}, None
        columns = _columns(files.content(source)[request["part"]], request["column"], request["count"])
        samples = np.concatenate([column[request["start"] : request["stop"]] for column in columns])
        require_unchanged(path, stamp)
    except Exception:
        require_unchanged(path, stamp)  # what a library says of a file that was changed under it misleads
        raise
    return {"count": samples.size, "dtype": samples.dtype.str}, samples


def _facts(raw: RawFile) -> dict[str, Any]:
    """All of a recording but its samples, as JSON can hold it."""
    return {
        "columns": [[name, *_shape(column)] for name, column in raw.columns.items()],
        "sample_rate": raw.sample_rate,
        "units": dict(raw.units),
        "attributes": dict(raw.attributes),
        "facts": dict(raw.facts),
        "speeds": None if raw.speeds is None else _shape(raw.speeds),
        "full_scale": raw.full_scale,
        "rates": dict(raw.rates),
    }


def _shape(column: Column) -> list[Any]:
    return [len(column), number_type(column).str]


def _limit_memory() -> None:
    """Let this process take no more than the limit beyond what it has; where the system can do that."""
    if sys.platform != "linux":
        return  # the other process watches this one
    try:
        import resource
    except ImportError:
        return

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    limit = pages * resource.getpagesize() + memory_limit() + _LIBRARIES
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


def _failure(cause: Exception) -> dict[str, str]:
    """An error as JSON; what a damaged file makes a library raise has no bounds."""
    kind, message = type(cause).__name__, str(cause)
    if isinstance(cause, MemoryError) or getattr(cause, "errno", None) == errno.ENOMEM:
        kind, message = "MemoryError", ""
    elif not isinstance(cause, SwashTwinError):
        message = f"{kind}: {message}"
    return {"error": (message.splitlines() or [""])[0][:_MESSAGE], "kind": kind}


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    warnings.simplefilter("ignore")
    keep_freed_memory()
    files = _Files()
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        for line in requests:
            request = json.loads(line)
            os.environ[MEMORY_VARIABLE] = request["memory"]
            faulthandler.dump_traceback_later(request["seconds"], exit=True, file=nowhere)
            samples: np.ndarray | None = None
            try:
                answer, samples = _answer(files, request)
                text = json.dumps(answer)
            except Exception as cause:
                text, samples = json.dumps(_failure(cause)), None
                if isinstance(cause, MemoryError):
                    files.clear()
            if not _STAY_OPEN:
                files.close()
            answers.write(text.encode() + b"\n")
            if samples is not None and samples.size:
                answers.write(samples.data.cast("B"))
            answers.flush()
            faulthandler.cancel_dump_traceback_later()


def main() -> None:
    """Answer requests until the pipe that brings them is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that asks
    end_with(os.getppid())
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as pipe:
        os.dup2(2, 1)  # whatever a library prints goes nowhere
        _serve(sys.stdin.buffer, pipe)


if __name__ == "__main__":
    main()
