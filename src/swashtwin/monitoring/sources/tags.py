"""Operating points that another system recorded: a CSV file of times, speeds and pressures."""

from bisect import bisect_right
from collections.abc import Mapping
from datetime import datetime, timedelta, tzinfo
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.monitoring.sources.tag_lines import TagLine, TagsFileError, read_tag_lines

MAX_AGE = timedelta(hours=1)
"""Age up to which a tag is used: later, the machine may run at another operating point."""


class TagsPendingError(DataError):
    """No tag is known for a time, but one may be once the file has changed."""


class Tags:
    """Operating points of a machine by time; the file is read again when it changes.

    Its first line names the columns: ``time`` and at least one of ``speed``, ``pressure`` and
    ``temperature``. A number without a unit is in rpm, MPa or degC.
    """

    def __init__(self, path: Path, zone: tzinfo | None = None) -> None:
        """Read `path`, in which times without a zone are in `zone`."""
        self._path = path
        self._zone = zone
        self._stamp: tuple[int, ...] | None = ()
        self._lines: list[TagLine] = []
        self._times: list[datetime] = []
        self._problem: str | None = None

    def at(self, time: datetime) -> Mapping[str, str]:
        """Return the facts of the last line at or before `time`; empty if it is too old.

        Raises
        ------
        TagsPendingError
            The file is missing, or no line of it can be used.
        DataError
            The line that holds at `time` cannot be used.
        """
        self._reload_if_changed()
        if self._problem is not None:
            raise TagsPendingError(self._problem)

        index = bisect_right(self._times, time) - 1
        if index < 0 or time - self._times[index] > MAX_AGE:
            return {}
        line = self._lines[index]
        if line.problem is not None:
            raise DataError(line.problem)
        return line.facts

    def require_at(self, time: datetime) -> Mapping[str, str]:
        """Return the facts of the line that holds at `time`.

        Raises
        ------
        TagsPendingError
            The file is missing, no line of it can be used, or it ends before `time`.
        DataError
            The line that holds at `time` cannot be used, or there is none.
        """
        facts = self.at(time)
        if facts:
            return facts
        sentence = f"{self._path} (tags) has no line in the hour before {time:%Y-%m-%d %H:%M:%S}"
        if not self._times or self._times[-1] < time:
            end = (
                f"it ends at {self._times[-1]:%Y-%m-%d %H:%M:%S}" if self._times else "it is empty"
            )
            raise TagsPendingError(f"{sentence} UTC; {end}.")
        raise DataError(f"{sentence} UTC.")

    def has_changed(self) -> bool:
        """Return whether the file differs from the one that was read last."""
        return self._current_stamp() != self._stamp

    def _current_stamp(self) -> tuple[int, ...] | None:
        """Return what shows that the file has changed; None if there is none."""
        try:
            stat = self._path.stat()
        except OSError:
            return None
        # No program can set the time of the last change of the metadata.
        return (stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)

    def _reload_if_changed(self) -> None:
        stamp = self._current_stamp()
        if stamp is not None and stamp == self._stamp:
            return
        self._lines = []
        self._problem = None
        try:
            self._lines = read_tag_lines(self._path, self._zone)
        except TagsFileError as cause:
            self._problem = str(cause)
            if isinstance(cause.__cause__, OSError) and stamp is not None:
                stamp = ()  # it exists, and may be readable at the next attempt
        self._times = [line.time for line in self._lines]
        self._stamp = stamp
