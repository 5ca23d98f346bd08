"""Operating points that another system wrote down: a CSV of times with speeds and pressures."""

import csv
import time as clock
from bisect import bisect_right
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path

from swashtwin.foundation import DataError, InputError, parse, read_text
from swashtwin.monitoring.sources.delivery import QUANTITIES, read_time

_OLDEST = timedelta(hours=1)
"""Age of a tag up to which it still holds."""
_SETTLED = 10.0
"""Time [s] since its last change after which a file's last line is whole, with a line break or without."""
_USUAL_UNITS = {"speed": "rpm", "pressure": "MPa", "temperature": "degC"}


class Tags:
    """Operating points of a machine by time; the file is read again when it changed.

    Its first line names the columns ``time`` and at least one of ``speed``, ``pressure`` and ``temperature``. A number
    without a unit is in rpm, MPa or degC.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp: tuple[int, int, bool] | None = None
        self._times: list[datetime] = []
        self._facts: list[dict[str, str]] = []

    def at(self, time: datetime) -> Mapping[str, str]:
        """Facts of the last line at or before `time`; none where that is older than an hour.

        Raises
        ------
        DataError
            The file is missing or a line of it cannot be read.
        """
        try:
            stat = self._path.stat()
        except OSError as cause:
            raise DataError(f"{self._path} (tags) cannot be read: {cause.strerror or cause}.") from cause
        is_still = clock.time() - stat.st_mtime > _SETTLED
        stamp = (stat.st_size, stat.st_mtime_ns, is_still)
        if self._stamp != stamp:
            rows = _read(self._path, is_still)
            self._times, self._facts, self._stamp = [row[0] for row in rows], [row[1] for row in rows], stamp
        index = bisect_right(self._times, time) - 1
        return self._facts[index] if index >= 0 and time - self._times[index] <= _OLDEST else {}


def _read(path: Path, is_still: bool) -> list[tuple[datetime, dict[str, str]]]:
    rows = []
    text = read_text(path)
    whole = text if is_still else text[: text.rfind("\n") + 1]  # a line without its end may be half written
    reader = csv.DictReader(whole.splitlines())
    names = [name.strip() for name in reader.fieldnames or ()]
    if "time" not in names or not _USUAL_UNITS.keys() & set(names):
        raise DataError(f"{path} (tags) must begin with a line such as time,speed,pressure.")
    reader.fieldnames = names
    for row in reader:
        try:
            rows.append((read_time((row["time"] or "").strip()), _facts(row)))
        except InputError as cause:
            raise DataError(f"{path} (tags), line {reader.line_num}: {cause}") from cause
    return sorted(rows, key=lambda row: row[0])


def _facts(row: Mapping[str, str | None]) -> dict[str, str]:
    facts = {}
    for name, unit in _USUAL_UNITS.items():
        text = (row.get(name) or "").strip()
        if text:
            with suppress(ValueError):  # it has a unit
                text = f"{float(text)!r} {unit}"
            parse(text, QUANTITIES[name][1], name=name)
            facts[name] = text
    return facts
