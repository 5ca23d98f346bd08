"""The recording in a spool file, with what the file, its message, the tags and the configuration
say of it.

Tags are operating points that another system wrote down: a CSV of times with speeds and pressures.
"""

import csv
import math
import time as clock
from bisect import bisect_right
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from errno import EDQUOT, EMFILE, ENFILE, ENOSPC
from hashlib import sha256
from pathlib import Path

import numpy as np

from swashtwin.foundation import DataError, InputError, SwashTwinError, parse_quantity, read_text
from swashtwin.monitoring.config.settings import Machine
from swashtwin.monitoring.sources.delivery import (
    QUANTITIES,
    Delivery,
    RejectionError,
    entry_facts,
    read_time,
    safe_name,
)
from swashtwin.monitoring.sources.mqtt import SAMPLES, samples_recording
from swashtwin.monitoring.sources.spool import SpoolFile
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import ReadOptions, Recording, load_recording, stem_of

_AHEAD = timedelta(minutes=5)
"""How far a recording's time may lie ahead of our clock."""
_RATE_TOLERANCE = 1e-3
_PASSING = (ENOSPC, EDQUOT, EMFILE, ENFILE)
"""Errors of the computer and not of a file."""
_OLDEST = timedelta(hours=1)
"""Age of a tag up to which it still holds."""
_SETTLED = 10.0
"""Time [s] since its last change after which a file's last line is whole, with a line break or
without.
"""
_USUAL_UNITS = {"speed": "rpm", "pressure": "MPa", "temperature": "degC"}


class Tags:
    """Operating points of a machine by time; the file is read again when it changed.

    Its first line names the columns ``time`` and at least one of ``speed``, ``pressure`` and
    ``temperature``. A number without a unit is in rpm, MPa or degC.
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
            raise DataError(
                f"{self._path} (tags) cannot be read: {cause.strerror or cause}."
            ) from cause
        is_still = clock.time() - stat.st_mtime > _SETTLED
        stamp = (stat.st_size, stat.st_mtime_ns, is_still)
        if self._stamp != stamp:
            rows = _read_tags(self._path, is_still)
            self._times, self._facts, self._stamp = (
                [row[0] for row in rows],
                [row[1] for row in rows],
                stamp,
            )
        index = bisect_right(self._times, time) - 1
        return self._facts[index] if index >= 0 and time - self._times[index] <= _OLDEST else {}


def _read_tags(path: Path, is_still: bool) -> list[tuple[datetime, dict[str, str]]]:
    rows = []
    text = read_text(path)
    whole = (
        text if is_still else text[: text.rfind("\n") + 1]
    )  # a line without its end may be half written
    reader = csv.DictReader(whole.splitlines())
    names = [name.strip() for name in reader.fieldnames or ()]
    if "time" not in names or not _USUAL_UNITS.keys() & set(names):
        raise DataError(f"{path} (tags) must begin with a line such as time,speed,pressure.")
    reader.fieldnames = names
    for row in reader:
        try:
            rows.append((read_time((row["time"] or "").strip()), _tagged(row)))
        except InputError as cause:
            raise DataError(f"{path} (tags), line {reader.line_num}: {cause}") from cause
    return sorted(rows, key=lambda row: row[0])


def _tagged(row: Mapping[str, str | None]) -> dict[str, str]:
    facts = {}
    for name, unit in _USUAL_UNITS.items():
        text = (row.get(name) or "").strip()
        if text:
            with suppress(ValueError):  # it has a unit
                text = f"{float(text)!r} {unit}"
            parse_quantity(text, QUANTITIES[name][1], name=name)
            facts[name] = text
    return facts


@dataclass(frozen=True, eq=False)
class Contents:
    """A recording that can be judged."""

    recording: Recording
    """Its samples in memory; its condition, or its attribute ``speed``, as far as anything states
    them.
    """
    time: datetime
    """When it was recorded (UTC)."""
    digest: str
    """Hash of what was recorded, whatever the file is called. A recording without any signal counts
    as another one at another time.
    """
    notes: tuple[str, ...]
    """What a reader should know of its time and its tags."""


def read_contents(file: SpoolFile, machine: Machine, tags: Tags | None) -> Contents:
    """The recording in a spool file.

    Raises
    ------
    UnfitError
        It cannot be read, or has other channels, another rate or another unit than the machine's.
    OSError
        The disk is full, or too many files are open: it may be read later.
    """
    delivery = file.delivery
    if delivery.problem is not None:
        raise RejectionError("broken", delivery.problem)
    try:
        recording = _load(file, machine)
        signal = recording.signal  # which reads the samples
        time, notes = _time(delivery)
        recording, tag_notes = _with_condition(recording, delivery, machine, tags, time)
    except RejectionError:
        raise
    except OSError as cause:
        if cause.errno in _PASSING:
            raise
        raise RejectionError(
            "broken", f"{delivery.file} cannot be read: {cause.strerror or cause}"
        ) from cause
    except (SwashTwinError, MemoryError) as cause:
        text = str(cause) or "it takes more memory than there is."
        raise RejectionError("broken", text.replace(str(file.path), delivery.file)) from cause
    digest = recording.fingerprint()
    if signal.size and np.all(signal == signal[:, :1]):
        digest = sha256(f"{digest} {time.isoformat()}".encode()).hexdigest()
    return Contents(recording, time, digest, (*notes, *tag_notes))


def _load(file: SpoolFile, machine: Machine) -> Recording:
    delivery, stated = file.delivery, entry_facts(file.delivery.facts)
    name = stem_of(Path(safe_name(delivery.file))) or "recording"
    if file.path.name.endswith(SAMPLES):
        recording = samples_recording(
            file.path, delivery.facts, name, ReadOptions(sensitivity=machine.sensitivity)
        )
        if missing := [
            channel for channel in machine.channels if channel not in recording.channels
        ]:
            others = ", ".join(recording.channels)
            raise RejectionError("broken", f"it has no channel {missing[0]!r}; it has {others}.")
        recording = recording.select_channels(machine.channels or recording.channels)
    else:
        if "type" in delivery.facts:
            raise RejectionError(
                "broken", "a type is of samples behind a line of JSON; a file says that of its own."
            )
        usual = {
            key: value
            for key in _READING
            if (value := getattr(machine, key)) not in (None, ()) and key not in stated
        }
        if "speed" not in stated:  # a pressure alone is joined with a speed afterwards
            stated.pop("discharge_pressure", None)
        recording = load_recording(file.path, id=name, **stated, **usual)
        if (count := delivery.facts.get("count")) and recording.n_samples != int(count):
            raise RejectionError(
                "broken", f"it has {recording.n_samples} samples of each channel, not {count}."
            )
    rate = machine.sample_rate
    if rate is not None and abs(recording.sample_rate / rate - 1) > _RATE_TOLERANCE:
        raise RejectionError(
            "broken",
            f"its rate is {recording.sample_rate:g} Hz, that of {machine.name} {rate:g} Hz.",
        )
    return recording


_READING = (
    "sample_rate", "unit", "sensitivity", "channels", "names", "time_column", "time_unit", "header_lines", "separator",
    "decimal",
)  # fmt: skip
"""Facts of a machine's files, by the names that they have in an index."""


def _time(delivery: Delivery) -> tuple[datetime, tuple[str, ...]]:
    stated = delivery.facts.get("time")
    if stated is None:
        return delivery.received, ()
    try:
        time = read_time(stated)
    except (
        InputError
    ) as cause:  # the date of a file; what a message or an upload states was checked
        return delivery.received, (f"{cause} The time of its arrival counts.",)
    if time - delivery.received > _AHEAD:
        note = f"It says it was recorded at {time:%Y-%m-%d %H:%M:%S}, which lies ahead: the time of its arrival counts."
        return delivery.received, (note,)
    return min(time, delivery.received), ()


def _with_condition(
    recording: Recording, delivery: Delivery, machine: Machine, tags: Tags | None, time: datetime
) -> tuple[Recording, tuple[str, ...]]:
    """The recording at its operating point: of the file, else of the message, the tags, or the
    configuration.
    """
    if recording.condition is not None:
        return recording, ()
    stated = {"speed": machine.speed, "discharge_pressure": machine.discharge_pressure}
    values: dict[str, float] = {name: value for name, value in stated.items() if value is not None}
    notes: tuple[str, ...] = ()
    texts = {
        name: text for name, text in delivery.facts.items() if name in QUANTITIES and name != "rate"
    }
    if tags is not None:
        try:
            texts = {**tags.at(time), **texts}
        except DataError as cause:
            notes = (str(cause),)
    for name, text in texts.items():
        key, unit = QUANTITIES[name]
        values[key] = parse_quantity(text, unit, name=name)
    if "speed" in recording.attributes:
        values["speed"] = parse_quantity(recording.attributes["speed"], "rad/s", name="speed")
    try:
        if {"speed", "discharge_pressure"} <= values.keys():
            return recording.replace(condition=OperatingCondition(**values)), notes
    except InputError as cause:
        raise RejectionError("broken", str(cause)) from cause
    if "speed" in values:
        speed = f"{values['speed'] * 30 / math.pi!r} rpm"
        return recording.replace(attributes={**recording.attributes, "speed": speed}), notes
    return recording, notes
