"""The recording in a spool file, with the facts of its file, its delivery and the configuration."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from errno import EDQUOT, EMFILE, ENFILE, ENOSPC
from hashlib import sha256
from pathlib import Path

import numpy as np

from swashtwin.foundation import DataError, InputError, SwashTwinError, parse_quantity
from swashtwin.monitoring.config.settings import Machine
from swashtwin.monitoring.sources.delivery import (
    QUANTITIES,
    Delivery,
    RejectionError,
    entry_facts,
    read_time,
    safe_name,
)
from swashtwin.monitoring.sources.message_format import SAMPLES_SUFFIX, samples_recording
from swashtwin.monitoring.sources.spool import SpoolFile
from swashtwin.monitoring.sources.tags import Tags, TagsPendingError
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import ReadOptions, Recording, load_recording, stem_of

MAX_TIME_AHEAD = timedelta(minutes=5)
"""How far a recording's time may lie ahead of this computer's clock."""
RATE_TOLERANCE = 1e-3
"""Relative difference of two sample rates that count as equal: clocks of instruments differ."""
TEMPORARY_ERRORS = (ENOSPC, EDQUOT, EMFILE, ENFILE)
"""Errors of the computer, not of a file: the recording may be read later."""
STANDSTILL = {"speed": 10 * math.pi / 30, "discharge_pressure": 1e5}
"""Least speed [rad/s] and pressure [Pa] of a pump that works; a sensor at rest is not at zero."""
READ_OPTIONS = (
    "sample_rate",
    "unit",
    "sensitivity",
    "channels",
    "names",
    "time_column",
    "time_unit",
    "header_lines",
    "separator",
    "decimal",
)
"""Facts of a machine's files, by the names that they have in an index."""


@dataclass(frozen=True, eq=False)
class Contents:
    """A recording that can be judged."""

    recording: Recording
    """The recording with its samples in memory, and with its condition (or its attribute ``speed``)
    if any source specifies them.
    """
    time: datetime
    """When it was measured (UTC)."""
    digest: str
    """Hash of what was measured, whatever the file is called. Recordings without a signal are
    distinguished by their time.
    """
    notes: tuple[str, ...]
    """What a reader should know of its time and its operating point."""
    clock_problem: str | None = None
    """Why it is filed at its time of arrival, if a time was specified."""
    tags_problem: str | None = None
    """Why the values of the configuration are used instead of the machine's tags."""


def read_contents(file: SpoolFile, machine: Machine, tags: Tags | None) -> Contents:
    """Return the recording in a spool file.

    Raises
    ------
    RejectionError
        The file cannot be read, its channels, sample rate or unit are not those of the machine, or
        its operating point cannot be known.
    TagsPendingError
        Its operating point may be known later.
    OSError
        The disk is full, or too many files are open; the file may be read later.
    """
    delivery = file.delivery
    if delivery.problem is not None:
        raise RejectionError("broken", delivery.problem)

    try:
        recording = _load(file, machine)
        signal = recording.signal  # reads the samples
        time, clock_problem = _measurement_time(delivery)
        recording, tags_problem = _with_condition(recording, delivery, machine, tags, time)
    except (RejectionError, TagsPendingError):
        raise
    except OSError as cause:
        if cause.errno in TEMPORARY_ERRORS:
            raise
        raise RejectionError(
            "broken", f"{delivery.file} cannot be read: {cause.strerror or cause}"
        ) from cause
    except (SwashTwinError, MemoryError) as cause:
        text = str(cause) or "reading the file takes more memory than is available."
        # The path in the spool means nothing to a reader.
        raise RejectionError("broken", text.replace(str(file.path), delivery.file)) from cause

    digest = recording.fingerprint()
    has_no_signal = signal.size and np.all(signal == signal[:, :1])
    if has_no_signal:
        # All recordings of a dead sensor have the same samples, and are no duplicates.
        digest = sha256(f"{digest} {time.isoformat()}".encode()).hexdigest()
    notes = tuple(filter(None, (clock_problem, tags_problem)))
    return Contents(recording, time, digest, notes, clock_problem, tags_problem)


def _load(file: SpoolFile, machine: Machine) -> Recording:
    if file.path.name.endswith(SAMPLES_SUFFIX):
        recording = _load_message(file, machine)
    else:
        recording = _load_file(file, machine)

    rate = machine.sample_rate
    if rate is not None and abs(recording.sample_rate / rate - 1) > RATE_TOLERANCE:
        raise RejectionError(
            "broken",
            f"the sample rate is {recording.sample_rate:g} Hz, but that of {machine.name} is "
            f"{rate:g} Hz.",
        )
    return recording


def _load_message(file: SpoolFile, machine: Machine) -> Recording:
    recording = samples_recording(
        file.path,
        file.delivery.facts,
        _recording_id(file.delivery),
        ReadOptions(sensitivity=machine.sensitivity),
    )
    for channel in machine.channels:
        if channel not in recording.channels:
            raise RejectionError(
                "broken",
                f"there is no channel {channel!r}; the recording has "
                f"{', '.join(recording.channels)}.",
            )
    return recording.select_channels(machine.channels or recording.channels)


def _load_file(file: SpoolFile, machine: Machine) -> Recording:
    delivery = file.delivery
    if "type" in delivery.facts:
        raise RejectionError(
            "broken",
            "type is a fact of samples behind a line of JSON; a file specifies its own type.",
        )

    delivered_facts = entry_facts(delivery.facts)
    if "speed" not in delivered_facts:
        # A pressure alone is joined with a speed of another source in `_with_condition`.
        delivered_facts.pop("discharge_pressure", None)

    # The delivery knows its file better than the configuration of the machine.
    configured_facts = {}
    for name in READ_OPTIONS:
        value = getattr(machine, name)
        if name not in delivered_facts and value not in (None, ()):
            configured_facts[name] = value

    recording = load_recording(
        file.path, id=_recording_id(delivery), **delivered_facts, **configured_facts
    )
    count = delivery.facts.get("count")
    if count is not None and recording.n_samples != int(count):
        raise RejectionError(
            "broken",
            f"the file has {recording.n_samples} samples per channel, "
            f"but the delivery specifies {count}.",
        )
    return recording


def _recording_id(delivery: Delivery) -> str:
    return stem_of(Path(safe_name(delivery.file))) or "recording"


def _measurement_time(delivery: Delivery) -> tuple[datetime, str | None]:
    """Return when a recording was measured, and why that is not the specified time."""
    text = delivery.facts.get("time")
    if text is None:
        return delivery.received, None

    try:
        time = read_time(text)
    except InputError as cause:
        # Only the time of a file can be invalid here: that of a message or an upload was checked.
        return delivery.received, f"{cause} Its time of arrival is used."

    if time - delivery.received > MAX_TIME_AHEAD:
        problem = (
            f"The specified time {time:%Y-%m-%d %H:%M:%S} lies in the future; "
            "the time of arrival is used."
        )
        return delivery.received, problem
    return min(time, delivery.received), None


def _with_condition(
    recording: Recording, delivery: Delivery, machine: Machine, tags: Tags | None, time: datetime
) -> tuple[Recording, str | None]:
    """Return the recording with its operating point, and why the tags do not specify it.

    In this order, the first source that specifies a quantity counts: file, delivery, tags,
    configuration.
    """
    if recording.condition is not None:
        return recording, None

    values = specified_values(delivery.facts)
    if "speed" in recording.attributes:
        values["speed"] = parse_quantity(recording.attributes["speed"], "rad/s", name="speed")
    problem = None
    if tags is not None and not _is_operating_point(values):
        tag_values, problem = _tag_values(tags, machine, values, time)
        values = {**tag_values, **values}
    values = {**_configured_values(machine), **values}
    if "speed" not in values:
        return recording, problem

    if "discharge_pressure" in values:
        try:
            return recording.replace(condition=OperatingCondition(**values)), problem
        except InputError as cause:
            raise RejectionError("broken", str(cause)) from cause

    speed = f"{values['speed'] * 30 / math.pi!r} rpm"
    return recording.replace(attributes={**recording.attributes, "speed": speed}), problem


def _configured_values(machine: Machine) -> dict[str, float]:
    values: dict[str, float] = {}
    if machine.speed is not None:
        values["speed"] = machine.speed
    if machine.discharge_pressure is not None:
        values["discharge_pressure"] = machine.discharge_pressure
    return values


def specified_values(facts: Mapping[str, str]) -> dict[str, float]:
    """Return the quantities of `OperatingCondition` [SI] among facts."""
    values = {}
    for name, text in facts.items():
        if name in QUANTITIES and name != "rate":
            key, unit = QUANTITIES[name]
            values[key] = parse_quantity(text, unit, name=name)
    return values


def _tag_values(
    tags: Tags, machine: Machine, values: Mapping[str, float], time: datetime
) -> tuple[dict[str, float], str | None]:
    """Return the quantities that the tags specify, or why there are none.

    Without tags, and without a complete operating point of other sources, the recording would be
    learned at an operating point that mixes all others.
    """
    try:
        tag_values = specified_values(tags.require_at(time))
    except DataError as cause:
        if _is_operating_point({**_configured_values(machine), **values}):
            return {}, f"{cause} The values of the configuration are used."
        if isinstance(cause, TagsPendingError):
            raise
        raise RejectionError("tags", str(cause)) from cause

    for key, limit in STANDSTILL.items():
        if key in tag_values and tag_values[key] < limit:
            raise RejectionError("rest", f"its tag has a {key.replace('_', ' ')} of about zero.")
    return tag_values, None


def _is_operating_point(values: Mapping[str, float]) -> bool:
    return "speed" in values and "discharge_pressure" in values
