"""A folder, on this disk or on a network share, in which other programs put recordings.

A file is taken when its size and its time of change have stayed the same for a while: a network
share does not report when a file is closed. The path, size, time of change and content of each
taken file are remembered, so that a restart takes nothing twice, and a file that grew or was
replaced later is taken again. A file that lacks the end of its format waits longer, since a program
may pause while it writes. Only the monotonic clock decides, since others are set back.
"""

import hashlib
import json
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

from swashtwin.foundation import atomic_write, safe_file_name
from swashtwin.monitoring.config.settings import FolderSource
from swashtwin.monitoring.sources.completeness import is_complete
from swashtwin.monitoring.sources.delivery import (
    GROWN_FACT,
    MAX_RECORDING_BYTES,
    Accept,
    Delivery,
)
from swashtwin.monitoring.status import SourceStatus

UNFINISHED_SUFFIXES = (".part", ".partial", ".tmp", ".temp", ".crdownload", ".filepart", ".swp")
"""Suffixes that programs give to files that they are still writing."""
REMOVAL_SUFFIX = ".swashtwin-taken"
"""Suffix of a file that is about to be removed."""
POLLS_PER_SETTLE_TIME = 4
"""Looks at the folder in the time for which a file must stay the same."""
PATIENCE = 20
"""Settle times for which a file must stay the same that lacks the end of its format."""
N_KEPT_GROWTHS = 10
"""First and last deliveries of a growing file that are remembered."""
MIN_POLL_INTERVAL_S = 0.02
MAX_POLL_INTERVAL_S = 2.0
"""Longest time between two looks, so that a long settle time does not delay the first look."""
MAX_DEPTH = 8
"""Depth of sub-folders that are searched, so that a share with a loop is not searched forever."""
MAX_FILE_TIME_S = datetime(9999, 12, 31, tzinfo=UTC).timestamp()
"""Latest time of a file that Python can represent; a broken file system may state any number."""
COMPACTION_SURPLUS = 1000
"""Lines of files that are gone which the list of taken files may hold beyond those still there."""
DIGEST_LENGTH = 16
"""Hexadecimal digits of a content's digest: 64 bits tell two versions of one file apart."""


class Stamp(NamedTuple):
    """What shows that a file has changed."""

    size: int
    """Size [bytes]."""
    changed: int
    """Time of its last change [ns since 1970], which a copying program may set."""
    touched: int
    """Time at which the file or its metadata changed [ns since 1970], which no program can set."""


class FolderWatch:
    """Takes the files of one folder."""

    def __init__(self, source: FolderSource, accept: Accept, folder: Path) -> None:
        """Watch `source`, and remember in `folder` what was taken."""
        self.status = SourceStatus(source.name, source.kind)
        self._source = source
        self._accept = accept
        self._taken = TakenFiles(folder / "taken" / f"{safe_file_name(source.name)}.txt")
        self._waiting: dict[str, tuple[Stamp, float]] = {}
        """Files that are not taken yet, and since when [s] each has stayed the same."""
        self._incomplete: dict[str, Stamp] = {}
        """Files that lacked the end of their format when they had this stamp."""
        self._is_settling = False
        """Whether a file may be ready at a later look."""
        self._problems: dict[str, str] = {}
        """Files that cannot be read or removed, as long as they exist."""
        self._skipped_folders: list[str] = []
        """Sub-folders that the last look skipped, and why."""
        self._may_restore = source.remove
        """Whether a file with the removal suffix was left by a kill; later it may be one that this
        source removes at the moment.
        """

    def run(self, stop: threading.Event) -> None:
        """Look into the folder until `stop` is set."""
        interval = min(MAX_POLL_INTERVAL_S, self._poll_interval())
        while not stop.is_set():
            start = time.monotonic()
            self.poll()
            # A slow share is searched at most half of the time.
            stop.wait(max(interval, time.monotonic() - start))

    def drain(self, stop: threading.Event) -> None:
        """Take every file that is there now; return when none is left that may still change."""
        while (self.poll() and self._waiting) or self._is_settling:
            if stop.wait(self._poll_interval()):
                return

    def _poll_interval(self) -> float:
        return max(MIN_POLL_INTERVAL_S, self._source.settle_time / POLLS_PER_SETTLE_TIME)

    def poll(self) -> int:
        """Look into the folder once, and return how many files were taken."""
        self._is_settling = False
        self._skipped_folders.clear()
        try:
            stamps = dict(self._walk(self._source.path, depth=0))
        except OSError as cause:
            self.status.fail(f"{self._source.path} cannot be read: {cause.strerror or cause}")
            return 0
        self._may_restore = False

        ready_files = self._find_ready_files(stamps)
        self._problems = {
            path: problem for path, problem in self._problems.items() if path in stamps
        }

        self._incomplete = {
            path: stamp for path, stamp in self._incomplete.items() if stamps.get(path) == stamp
        }

        count = 0
        problem = None
        try:
            # After an incomplete search, a file that was not seen may still be there.
            if not self._skipped_folders:
                self._taken.forget_missing(stamps.keys())
            for path in ready_files:
                count += self._take(Path(path), stamps[path])
        except OSError as cause:
            problem = cause.strerror or str(cause)

        self._report(count, problem)
        return count

    def _find_ready_files(self, stamps: Mapping[str, Stamp]) -> list[str]:
        """Return the files that have stayed the same for the settle time, oldest first.

        One that lacks the end of its format must stay the same for longer.
        """
        now = time.monotonic()
        previously_waiting = self._waiting
        self._waiting = {}
        for path, stamp in stamps.items():
            if self._taken.has(path, stamp):
                continue
            previous_stamp, since = previously_waiting.get(path, (None, now))
            if stamp != previous_stamp:
                since = now
            self._waiting[path] = (stamp, since)

        ready_files = []
        for path, (stamp, since) in self._waiting.items():
            settle_time = float(self._source.settle_time)
            if self._incomplete.get(path) == stamp:
                settle_time *= PATIENCE
            if now - since >= settle_time:
                ready_files.append(path)
        self._is_settling = len(ready_files) < len(self._waiting)
        return sorted(ready_files, key=lambda path: (stamps[path].changed, path))

    def _report(self, count: int, problem: str | None) -> None:
        self.status.received += count
        problems = [*self._problems.values(), *self._skipped_folders]
        if problem is not None:
            problems.insert(0, problem)

        if problems:
            self.status.fail(problems[0])
        else:
            self.status.succeed()

    def _take(self, path: Path, stamp: Stamp) -> bool:
        """Return whether the file was taken; one that changed in the meantime is not."""
        problem = None
        growths: list[str] = []
        try:
            if stamp.size > MAX_RECORDING_BYTES:
                problem = (
                    f"it has {stamp.size} bytes; at most {MAX_RECORDING_BYTES} are taken. "
                    "The file stays in its folder."
                )
                # The message stands for the content, which is not read into memory.
                content = f"{path}: {problem}\n".encode(errors="replace")
            else:
                with path.open("rb") as file:
                    content = file.read(stamp.size)

            if _stamp(path.stat()) != stamp:
                self._is_settling = True
                return False
            growths = self._taken.growths(str(path), content)
            if self._taken.is_same(str(path), stamp, content):
                # Only its metadata changed, for example by a backup.
                self._taken.add(str(path), stamp, content, growths)
                self._waiting.pop(str(path), None)
                return False
            was_known = self._incomplete.get(str(path)) == stamp
            if problem is None and not was_known and not is_complete(path.name, content):
                self._incomplete[str(path)] = stamp
                self._is_settling = True
                return False
        except OSError as cause:
            # The file was removed, or is locked by the program that writes it.
            self._problems[str(path)] = f"{path} cannot be read: {cause.strerror or cause}"
            return False

        delivery = self._delivery(path, stamp, problem, growths)
        self._accept(delivery, content)

        # From here on the file is safe in the spool.
        self._waiting.pop(str(path), None)
        self._problems.pop(str(path), None)
        is_removed = problem is None and self._source.remove and self._remove(path, content)
        if not is_removed:
            growths = [*growths, delivery.received.isoformat()]
            self._taken.add(str(path), stamp, content, growths)
        return True

    def _delivery(
        self, path: Path, stamp: Stamp, problem: str | None, growths: Sequence[str]
    ) -> Delivery:
        machine = self._source.machine
        parts = path.relative_to(self._source.path).parts
        if machine is None and len(parts) > 1:
            machine = parts[0]

        seconds = min(max(stamp.changed / 1e9, 0), MAX_FILE_TIME_S)
        time_changed = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
        facts = {"time": time_changed.isoformat()}
        if growths:
            facts[GROWN_FACT] = " ".join(growths)
        return Delivery(
            source=self._source.name,
            file=path.name,
            received=datetime.now(UTC),
            machine=machine,
            facts=facts,
            problem=problem,
        )

    def _remove(self, path: Path, content: bytes) -> bool:
        """Return whether the taken file was removed.

        A file that replaced it or grew in the meantime stays, to be taken.
        """
        renamed = path.with_name(f".{path.name}{REMOVAL_SUFFIX}")
        try:
            # The rename is atomic, so what is compared is what is removed.
            path.rename(renamed)
            if renamed.read_bytes() == content:
                renamed.unlink()
                return True
            _restore(renamed)
        except OSError as cause:
            self._problems[str(path)] = (
                f"{path} was taken, but cannot be removed: {cause.strerror or cause}"
            )
            _restore(renamed)
        return False

    def _walk(self, folder: Path, depth: int) -> Iterator[tuple[str, Stamp]]:
        """Yield path and stamp of each file that the source takes."""
        try:
            entries = list(os.scandir(folder))
        except OSError as cause:
            if depth == 0:
                raise
            self._skipped_folders.append(f"{folder} cannot be read: {cause.strerror or cause}")
            return

        for entry in entries:
            if self._is_interrupted_removal(entry.name):
                _restore(Path(entry.path))
            if entry.name.startswith((".", "~")) or entry.is_symlink():
                continue

            if entry.is_dir(follow_symlinks=False):
                if depth < MAX_DEPTH:
                    yield from self._walk(Path(entry.path), depth + 1)
                else:
                    self._skipped_folders.append(
                        f"{entry.path} lies deeper than {MAX_DEPTH} folders and is not searched"
                    )
            elif entry.is_file(follow_symlinks=False) and self._matches(entry.name):
                yield entry.path, _stamp(entry.stat(follow_symlinks=False))

    def _is_interrupted_removal(self, name: str) -> bool:
        return (
            self._may_restore
            and name.endswith(REMOVAL_SUFFIX)
            and self._matches(_original_name(name))
        )

    def _matches(self, name: str) -> bool:
        is_finished = not name.lower().endswith(UNFINISHED_SUFFIXES)
        return is_finished and fnmatch(name, self._source.pattern)


class TakenFiles:
    """Paths that were taken, with their stamps and digests, in a file to which each is appended."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._files: dict[str, tuple[Stamp, str]] = {}
        self._growths: dict[str, list[str]] = {}
        """Times at which each file, or a beginning of it, was delivered."""
        self._n_lines = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            self._load()

    def _load(self) -> None:
        text = self._path.read_text(encoding="utf-8", errors="replace")
        for line in text.splitlines():
            self._n_lines += 1
            try:
                name, size, changed, touched, digest, *growths = json.loads(line)
            except (ValueError, TypeError):
                # A kill cut the line off: its file is taken again, and rejected as a duplicate.
                continue
            self._files[name] = (Stamp(size, changed, touched), digest)
            self._growths[name] = growths

    def has(self, path: str, stamp: Stamp) -> bool:
        """Return whether the file was taken with this stamp."""
        return path in self._files and self._files[path][0] == stamp

    def is_same(self, path: str, stamp: Stamp, content: bytes) -> bool:
        """Return whether the file was taken with this size, time and content.

        Its metadata may have changed since.
        """
        if path not in self._files:
            return False
        taken_stamp, digest = self._files[path]
        has_same_stamp = (taken_stamp.size, taken_stamp.changed) == (stamp.size, stamp.changed)
        return has_same_stamp and digest == _digest(content)

    def growths(self, path: str, content: bytes) -> list[str]:
        """Return when beginnings of the content were delivered as a file of this path."""
        if path not in self._files:
            return []
        stamp, digest = self._files[path]
        if stamp.size > len(content) or digest != _digest(content[: stamp.size]):
            return []  # another file
        return self._growths[path]

    def add(self, path: str, stamp: Stamp, content: bytes, growths: Sequence[str] = ()) -> None:
        """Remember a file.

        Parameters
        ----------
        growths : times at which it, or a beginning of it, was delivered.
        """
        kept_growths = list(growths)
        if len(kept_growths) > 2 * N_KEPT_GROWTHS:
            kept_growths = [*kept_growths[:N_KEPT_GROWTHS], *kept_growths[-N_KEPT_GROWTHS:]]
        self._growths[path] = kept_growths
        self._files[path] = (stamp, _digest(content))
        self._n_lines += 1
        with self._path.open("a", encoding="utf-8") as file:
            file.write(self._line(path))

    def forget_missing(self, paths: Set[str]) -> None:
        """Forget the files that are gone, when they are the majority of the list.

        If no file is there at all, the share is most likely unreachable, and nothing is forgotten.
        """
        n_present = len(self._files.keys() & paths)
        if not paths or self._n_lines < 2 * n_present + COMPACTION_SURPLUS:
            return

        self._files = {path: entry for path, entry in self._files.items() if path in paths}
        with atomic_write(self._path) as temporary:
            temporary.write_text("".join(map(self._line, self._files)), encoding="utf-8")
        self._n_lines = len(self._files)

    def _line(self, path: str) -> str:
        stamp, digest = self._files[path]
        return f"{json.dumps([path, *stamp, digest, *self._growths[path]])}\n"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGEST_LENGTH]


def _original_name(renamed_name: str) -> str:
    return renamed_name.removeprefix(".").removesuffix(REMOVAL_SUFFIX)


def _restore(renamed: Path) -> None:
    """Give a file its original name again, or a similar one if a new file has that name."""
    path = renamed.with_name(_original_name(renamed.name))
    similar_path = path.with_stem(f"{path.stem}-{time.time_ns()}")
    with suppress(OSError):
        try:
            os.link(renamed, path)  # a link replaces nothing, unlike a rename
        except FileExistsError:
            renamed.rename(similar_path)
        except OSError:  # a file system without links
            renamed.rename(similar_path if path.exists() else path)
        else:
            renamed.unlink()


def _stamp(stat: os.stat_result) -> Stamp:
    return Stamp(stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
