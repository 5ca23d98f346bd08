"""Operating points that another system recorded: a CSV file of times, speeds and pressures."""

import csv
import time as clock
from bisect import bisect_right
from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path

from swashtwin.foundation import DataError, InputError, parse_quantity, read_text
from swashtwin.monitoring.sources.delivery import QUANTITIES, read_time

MAX_AGE = timedelta(hours=1)
"""Age up to which a tag is used: later, the machine may run at another operating point."""
SETTLE_TIME_S = 10.0
"""Time since the last change of the file after which its last line is complete, with or without a
line break.
"""
DEFAULT_UNITS = {"speed": "rpm", "pressure": "MPa", "temperature": "degC"}
"""Columns of quantities, and the unit of a number without one."""


class Tags:
    """Operating points of a machine by time; the file is read again when it changes.

    Its first line names the columns: ``time`` and at least one of ``speed``, ``pressure`` and
    ``temperature``. A number without a unit is in rpm, MPa or degC.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp: tuple[int, int, bool] | None = None
        self._times: list[datetime] = []
        self._facts: list[dict[str, str]] = []

    def at(self, time: datetime) -> Mapping[str, str]:
        """Return the facts of the last line at or before `time`; empty if it is too old.

        Raises
        ------
        DataError
            The file is missing, or a line of it cannot be read.
        """
        self._reload_if_changed()

        index = bisect_right(self._times, time) - 1
        if index < 0 or time - self._times[index] > MAX_AGE:
            return {}
        return self._facts[index]

    def _reload_if_changed(self) -> None:
        try:
            stat = self._path.stat()
        except OSError as cause:
            raise DataError(
                f"{self._path} (tags) cannot be read: {cause.strerror or cause}."
            ) from cause

        is_settled = clock.time() - stat.st_mtime > SETTLE_TIME_S
        stamp = (stat.st_size, stat.st_mtime_ns, is_settled)
        if stamp == self._stamp:
            return
        rows = _read_tags(self._path, is_settled)
        self._times = [time for time, _ in rows]
        self._facts = [facts for _, facts in rows]
        self._stamp = stamp


def _read_tags(path: Path, is_settled: bool) -> list[tuple[datetime, dict[str, str]]]:
    """Return time and facts of each line, in order of time."""
    text = read_text(path)
    if not is_settled:
        # The last line may be half written, and half a number is a wrong number.
        text = text[: text.rfind("\n") + 1]

    reader = csv.DictReader(text.splitlines())
    columns = [column.strip() for column in reader.fieldnames or ()]
    if "time" not in columns or DEFAULT_UNITS.keys().isdisjoint(columns):
        raise DataError(f"{path} (tags) must begin with a line such as time,speed,pressure.")
    reader.fieldnames = columns

    rows = []
    for row in reader:
        try:
            time = read_time((row["time"] or "").strip())
            rows.append((time, _row_facts(row)))
        except InputError as cause:
            raise DataError(f"{path} (tags), line {reader.line_num}: {cause}") from cause
    return sorted(rows, key=lambda row: row[0])


def _row_facts(row: Mapping[str, str | None]) -> dict[str, str]:
    facts = {}
    for name, unit in DEFAULT_UNITS.items():
        text = (row.get(name) or "").strip()
        if not text:
            continue
        if _is_number(text):
            text = f"{float(text)!r} {unit}"
        _, si_unit = QUANTITIES[name]
        parse_quantity(text, si_unit, name=name)
        facts[name] = text
    return facts


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
