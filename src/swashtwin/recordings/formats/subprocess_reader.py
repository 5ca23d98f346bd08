"""Reading in another process, for libraries that a damaged file can crash or send into an endless loop.

The process is started when first needed and kept for the next file; it dies with this one. Run as a module it is that
process: a line of JSON in, a line of JSON and the columns' bytes out, for each file.
"""

import atexit
import json
import os
import subprocess
import sys
import threading
import warnings
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from swashtwin.foundation import ArtifactError, DataError, MissingExtraError
from swashtwin.recordings.formats.raw import Options, RawFile
from swashtwin.recordings.samples import BLOCK

_PATIENCE = 30.0
"""Seconds that any file may take to read."""
_BYTES_PER_SECOND = 2e6
"""Speed below which reading counts as an endless loop."""
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""Bytes that every HDF5 file begins with, or holds at 512 or a doubling of it."""
_lock = threading.Lock()
_sound: set[tuple[object, ...]] = set()
"""Files that were read in the other process without harm."""
_process: "subprocess.Popen[bytes] | None" = None


def read_in_subprocess(module: str, path: Path, options: Options, *, keep: bool = True) -> RawFile:
    """What ``swashtwin.recordings.formats.MODULE.read_here`` gives for a file, read in another process.

    Parameters
    ----------
    keep : whether the columns come back; every sample is read in either case.

    Raises
    ------
    DataError
        The file is damaged: the library refuses it, crashes on it, or reads it for longer than any whole file takes.
    MissingExtraError
        The library is not installed.
    """
    stat = path.stat()
    file = (module, path.resolve(), stat.st_ino, stat.st_size, stat.st_mtime_ns)
    if not keep and file in _sound:
        return RawFile({})
    request = {"module": module, "path": str(path.resolve()), "options": asdict(options), "keep": keep}
    limit = _PATIENCE + stat.st_size / _BYTES_PER_SECOND
    with _lock:
        process = _running()
        timer = threading.Timer(limit, process.kill)
        timer.start()
        try:
            answer, columns = _ask(process, request)
        except (OSError, ValueError, EOFError) as cause:
            process.kill()
            process.wait()
            late = "no end was found" if not timer.is_alive() else "the library that reads it crashed"
            raise DataError(f"{path} is damaged: {late}.") from cause
        finally:
            timer.cancel()
    if "error" in answer:
        kinds = {kind.__name__: kind for kind in (MissingExtraError, DataError, ArtifactError)}
        message = answer["error"].replace(request["path"], str(path))
        raise kinds.get(answer["kind"], OSError)(message)  # `open_raw` reports an OSError as damage
    _sound.add(file)
    return RawFile(columns, answer["sample_rate"], answer["units"], answer["attributes"], rates=answer["rates"])


def require_sound(path: Path, module: str, options: Options) -> None:
    """Refuse an HDF5 file on which the library crashes or finds no end, read in another process first.

    A file of the older layouts, which MATLAB and many others write, has no checksums of its structure, and a damaged
    one can do either; a file of the newer layouts tells its own damage and is let through unread.
    """
    with path.open("rb") as file:
        head = file.read(8192)
    at = next((at for at in (0, 512, 1024, 2048, 4096) if head[at : at + 8] == HDF5_SIGNATURE), None)
    if at is not None and head[at + 8 : at + 9] < b"\x02":
        read_in_subprocess(module, path, options, keep=False)


def _ask(process: "subprocess.Popen[bytes]", request: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(request).encode() + b"\n")
    process.stdin.flush()
    answer: dict[str, Any] = json.loads(process.stdout.readline())
    columns = {}
    for name, count in answer.get("columns", {}).items():
        data = process.stdout.read(8 * count)
        if len(data) != 8 * count:
            raise EOFError
        columns[name] = np.frombuffer(data, dtype=np.float64)
    return answer, columns


def _running() -> "subprocess.Popen[bytes]":
    """The process, started anew where it is not alive."""
    global _process
    if _process is None or _process.poll() is not None:
        stop()
        _process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-m",
                "swashtwin.recordings.formats.subprocess_reader",
            ],  # -P: nothing is imported from the current folder
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        )
        atexit.register(stop)
    return _process


def stop() -> None:
    """Nothing; the other process is ended where there is one."""
    global _process
    if _process is None:
        return
    process, _process = _process, None
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            try:
                pipe.close()
            except OSError:
                continue  # it was full when the process died


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    warnings.simplefilter("ignore")
    for line in requests:
        request = json.loads(line)
        columns: dict[str, np.ndarray] = {}
        try:
            module = import_module(f"swashtwin.recordings.formats.{request['module']}")
            raw: RawFile = module.read_here(Path(request["path"]), Options(**request["options"]))
            for column in raw.columns.values():
                for start in range(0, len(column), BLOCK):
                    column[start : start + BLOCK]
            if request["keep"]:
                columns = {name: np.ascontiguousarray(column[:], np.float64) for name, column in raw.columns.items()}
            answer = {
                "sample_rate": raw.sample_rate,
                "rates": dict(raw.rates),
                "units": dict(raw.units),
                "attributes": dict(raw.attributes),
                "columns": {name: len(column) for name, column in columns.items()},
            }
            text = json.dumps(answer)
        except Exception as cause:  # what a damaged file makes a library raise has no bounds
            message = (
                str(cause) if isinstance(cause, (DataError, MissingExtraError)) else f"{type(cause).__name__}: {cause}"
            )
            text = json.dumps({"error": (message.splitlines() or [""])[0][:400], "kind": type(cause).__name__})
            columns = {}
        answers.write(text.encode() + b"\n")
        for column in columns.values():
            answers.write(column.tobytes())
        answers.flush()


if __name__ == "__main__":
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as pipe:
        os.dup2(2, 1)  # whatever a library prints goes nowhere
        _serve(sys.stdin.buffer, pipe)
