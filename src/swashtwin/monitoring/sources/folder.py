"""A folder, on this disk or on a network share, in which others put files of recordings.

A file is taken once its size and its time of change have stood still for a while: shares tell
nobody when a file is closed. What was taken is remembered by path, size, time of change and
content, so that a restart takes nothing twice, and a file that grew or was replaced after all is
taken again. No clock but the monotonic one decides.
"""

import hashlib
import json
import os
import threading
import time
from collections.abc import Iterator, Set
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

from swashtwin.foundation import atomic_write, safe_file_name
from swashtwin.monitoring.config.settings import FolderSource
from swashtwin.monitoring.sources.delivery import LARGEST, Accept, Delivery
from swashtwin.monitoring.status import SourceStatus

_UNFINISHED = (".part", ".partial", ".tmp", ".temp", ".crdownload", ".filepart", ".swp")
"""Suffixes that programs give to files they are still writing."""
_ASIDE = ".swashtwin-taken"
"""Suffix of a file that is about to be removed."""
_POLLS = 4
"""Looks at the folder in the time for which a file must stand still."""
_LONGEST_PAUSE = 2.0
"""Longest time [s] between two looks."""
_LATEST = datetime(9999, 12, 31, tzinfo=UTC).timestamp()
"""Latest time [s] that is stated of a file; one before 1970 is stated as 1970."""
_DEEPEST = 8
"""Levels of sub-folders that are looked into."""


class Stamp(NamedTuple):
    """What shows that a file has changed: its bytes, its date [ns], and when it or what is known of
    it changed [ns], which no copying program sets.
    """

    size: int
    changed: int
    touched: int


class FolderWatch:
    """Takes the files of one folder."""

    def __init__(self, source: FolderSource, accept: Accept, folder: Path) -> None:
        """Watch `source`; what was taken is remembered in `folder`."""
        self.status = SourceStatus(source.name, source.kind)
        self._source = source
        self._accept = accept
        self._taken = TakenFiles(folder / "taken" / f"{safe_file_name(source.name)}.txt")
        self._waiting: dict[str, tuple[Stamp, float]] = {}
        """Files that are not taken yet, and since when [s] each has stood still."""
        self._is_settling = False
        """Whether a file may be ready at a later look."""
        self._problems: dict[str, str] = {}
        """Files that cannot be read or removed, while they are there."""
        self._left_out: list[str] = []
        """Sub-folders that the last look left out, and why."""
        self._may_put_back = source.remove
        """Whether files that lie aside are what a kill left, and not those that a source removes
        now.
        """

    def run(self, stop: threading.Event) -> None:
        """Look into the folder until `stop` is set."""
        pause = min(_LONGEST_PAUSE, max(0.02, self._source.settle_time / _POLLS))
        while not stop.is_set():
            began = time.monotonic()
            self.poll()
            stop.wait(
                max(pause, time.monotonic() - began)
            )  # a slow share is looked at half of the time

    def drain(self, stop: threading.Event) -> None:
        """Take every file that is there now, and return when none is left that may still change."""
        while (self.poll() and self._waiting) or self._is_settling:
            if stop.wait(max(0.02, self._source.settle_time / _POLLS)):
                return

    def poll(self) -> int:
        """Files that were taken at this look."""
        self._is_settling = False
        try:
            self._left_out.clear()
            stamps = dict(self._walk(self._source.path, 0))
            self._may_put_back = False
        except OSError as cause:
            self.status.fail(f"{self._source.path} cannot be read: {cause.strerror or cause}")
            return 0
        now = time.monotonic()
        still = {
            path: self._waiting.get(path, (None, now))
            for path in stamps
            if not self._taken.has(path, stamps[path])
        }
        self._waiting = {
            path: (stamps[path], since if stamp == stamps[path] else now)
            for path, (stamp, since) in still.items()
        }
        ready = [
            path
            for path, (_, since) in self._waiting.items()
            if now - since >= self._source.settle_time
        ]
        self._is_settling = len(ready) < len(self._waiting)
        self._problems = {
            path: problem for path, problem in self._problems.items() if path in stamps
        }
        count, problem = 0, None
        try:
            if not self._left_out:
                self._taken.keep(stamps.keys())
            for path in sorted(ready, key=lambda name: (stamps[name].changed, name)):
                count += self._take(Path(path), stamps[path])
        except OSError as cause:
            problem = cause.strerror or str(cause)
        self.status.received += count
        problem = problem or next(iter((*self._problems.values(), *self._left_out)), None)
        if problem is not None:
            self.status.fail(problem)
        else:
            self.status.succeed()
        return count

    def _take(self, path: Path, stamp: Stamp) -> bool:
        """Whether the file was taken; one that changed meanwhile is not. What is too large is taken
        as a problem.
        """
        problem = None
        try:
            if stamp.size > LARGEST:
                problem = f"it has {stamp.size} bytes; at most {LARGEST} are taken, so it stays in its folder."
                content = f"{path}: {problem}\n".encode(errors="replace")
            else:
                with path.open("rb") as file:
                    content = file.read(stamp.size)
            if _stamp(path.stat()) != stamp:
                self._is_settling = True
                return False
            if self._taken.is_same(str(path), stamp, content):  # touched by a backup, say
                self._taken.add(str(path), stamp, content)
                self._waiting.pop(str(path), None)
                return False
        except OSError as cause:  # removed again, or locked by the program that writes it
            self._problems[str(path)] = f"{path} cannot be read: {cause.strerror or cause}"
            return False
        time = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(
            seconds=min(max(stamp.changed / 1e9, 0), _LATEST)
        )
        facts = {"time": time.isoformat()}
        machine, parts = self._source.machine, path.relative_to(self._source.path).parts
        if machine is None and len(parts) > 1:
            machine = parts[0]
        delivery = Delivery(
            self._source.name, path.name, datetime.now(UTC), machine, facts, problem
        )
        self._accept(delivery, content)
        self._waiting.pop(str(path), None)
        self._problems.pop(str(path), None)
        if problem is not None or not self._source.remove or not self._is_removed(path, content):
            self._taken.add(str(path), stamp, content)
        return True

    def _is_removed(self, path: Path, content: bytes) -> bool:
        """Whether the file that was taken is gone; one that came in its place or grew meanwhile
        stays, to be taken.
        """
        aside = path.with_name(f".{path.name}{_ASIDE}")
        try:
            path.rename(aside)  # at once, so that what is looked at is what is removed
            if aside.read_bytes() == content:
                aside.unlink()
                return True
            _put_back(aside)
        except OSError as cause:
            self._problems[str(path)] = (
                f"{path} was taken, but cannot be removed: {cause.strerror or cause}"
            )
            _put_back(aside)
        return False

    def _walk(self, folder: Path, depth: int) -> Iterator[tuple[str, Stamp]]:
        try:
            entries = list(os.scandir(folder))
        except OSError as cause:
            if not depth:
                raise
            self._left_out.append(f"{folder} cannot be read: {cause.strerror or cause}")
            return
        for entry in entries:
            if (
                self._may_put_back
                and entry.name.endswith(_ASIDE)
                and self._matches(_name_before(entry.name))
            ):
                _put_back(Path(entry.path))
            if entry.name.startswith((".", "~")) or entry.is_symlink():
                continue
            if entry.is_dir(follow_symlinks=False):
                if depth < _DEEPEST:
                    yield from self._walk(Path(entry.path), depth + 1)
                else:
                    self._left_out.append(
                        f"{entry.path} lies deeper than {_DEEPEST} folders and is not looked into"
                    )
            elif entry.is_file(follow_symlinks=False) and self._matches(entry.name):
                yield entry.path, _stamp(entry.stat(follow_symlinks=False))

    def _matches(self, name: str) -> bool:
        return fnmatch(name, self._source.pattern) and not name.lower().endswith(_UNFINISHED)


class TakenFiles:
    """Paths that were taken, with their stamps and digests, in a file to which each is appended."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._files: dict[str, tuple[Stamp, str]] = {}
        self._lines = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                self._lines += 1
                try:
                    name, size, changed, touched, digest = json.loads(line)
                except (ValueError, TypeError):
                    continue  # a kill cut it off: its file is taken again, and filed as double
                self._files[name] = Stamp(size, changed, touched), digest

    def has(self, path: str, stamp: Stamp) -> bool:
        """Whether the file was taken as it is now."""
        return path in self._files and self._files[path][0] == stamp

    def is_same(self, path: str, stamp: Stamp, content: bytes) -> bool:
        """Whether the file was taken with this size, date and content, whatever has touched it
        since.
        """
        before, digest = self._files.get(path, (None, ""))
        return before is not None and before[:2] == stamp[:2] and digest == _digest(content)

    def add(self, path: str, stamp: Stamp, content: bytes) -> None:
        """Remember a file."""
        self._files[path] = stamp, _digest(content)
        self._lines += 1
        with self._path.open("a", encoding="utf-8") as file:
            file.write(self._line(path))

    def keep(self, paths: Set[str]) -> None:
        """Forget files that are gone, once they are most of what is remembered; none where all are:
        a share is away.
        """
        if not paths or self._lines < 2 * len(self._files.keys() & paths) + 1000:
            return
        self._files = {path: known for path, known in self._files.items() if path in paths}
        with atomic_write(self._path) as temporary:
            temporary.write_text("".join(map(self._line, self._files)), encoding="utf-8")
        self._lines = len(self._files)

    def _line(self, path: str) -> str:
        stamp, digest = self._files[path]
        return f"{json.dumps([path, *stamp, digest])}\n"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _name_before(name: str) -> str:
    return name.removeprefix(".").removesuffix(_ASIDE)


def _put_back(aside: Path) -> None:
    """Give a file that was set aside its name again, or a name beside it where another has come."""
    path = aside.with_name(_name_before(aside.name))
    beside = path.with_stem(f"{path.stem}-{time.time_ns()}")
    with suppress(OSError):
        try:
            os.link(aside, path)  # which replaces nothing, as a change of its name would
        except FileExistsError:
            aside.rename(beside)
        except OSError:  # a disk without links
            aside.rename(beside if path.exists() else path)
        else:
            aside.unlink()


def _stamp(stat: os.stat_result) -> Stamp:
    return Stamp(stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
