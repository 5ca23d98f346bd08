"""What the history holds, as frozen records. All times are aware and in UTC."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

Names = tuple[tuple[str, str], ...]
"""Channel and name of each indicator."""


@dataclass(frozen=True, kw_only=True)
class Judgment:
    """One recording of a machine: its facts, and what the watch concluded."""

    content: str
    """SHA-256 of the bytes that were delivered; one machine has no content twice."""
    time: datetime
    """When it was measured."""
    received: datetime
    """When it was delivered."""
    source: str
    """Name of the source."""
    file: str
    """Name of the file as delivered."""
    channels: tuple[str, ...]
    """Name of each channel."""
    unit: str
    """Unit of every channel."""
    sample_rate: float
    """Samples per second and channel [Hz]."""
    duration: float
    """Length [s]."""
    state: str
    """``learning``, ``normal``, ``unusual``, ``alarm`` or ``sensor``."""
    point: str | None = None
    """Name of the operating point, where it is known."""
    speed: float | None = None
    """Angular speed of the shaft [rad/s]."""
    pressure: float | None = None
    """Discharge pressure [Pa]."""
    label: str | None = None
    """Class of the model's verdict."""
    probability: float | None = None
    """Its probability."""
    confidence: float | None = None
    """Confidence in it."""
    ood_p: float | None = None
    """p-value of the recording among those of the training."""
    model: str | None = None
    """Fingerprint of the model."""
    alarm_p: float | None = None
    """p-value against the machine's own healthy baseline."""
    capital: float | None = None
    """Evidence of the sequential test after this recording."""
    reasons: Mapping[str, Any] = field(default_factory=dict)
    """Further evidence, as JSON can hold it."""


@dataclass(frozen=True)
class StoredRecording:
    """A recording in the history."""

    id: int
    """Number in the history, by order of filing."""
    machine: str
    """Name of its machine."""
    judgment: Judgment
    """Its facts and what was concluded."""
    waveform: Path | None
    """File of its samples, or None where retention removed it."""


@dataclass(frozen=True)
class PointKey:
    """What tells an operating point of a machine from the others."""

    name: str
    """Unique within the machine."""
    speed: float | None
    """Angular speed of the shaft [rad/s]."""
    pressure: float | None
    """Discharge pressure [Pa]."""


@dataclass(frozen=True)
class Point(PointKey):
    """An operating point of a machine, with what the alarm learned there."""

    baseline: dict[str, Any] | None
    """What is large and changes rarely: the learned levels."""
    test: dict[str, Any] | None
    """What changes with each recording: the state of the test."""
    updated: datetime
    """When one of them changed."""


@dataclass(frozen=True)
class Alarm:
    """An alarm of a machine."""

    id: int
    """Number in the history."""
    machine: str
    """Name of its machine."""
    point: str | None
    """Operating point."""
    kind: str
    """``pump`` or ``sensor``."""
    state: str
    """``open``, ``acknowledged`` or ``closed``."""
    opened: datetime
    """Time of the recording that raised it."""
    evidence: dict[str, Any]
    """Why, as JSON can hold it."""
    recording: int | None
    """Recording that raised it."""
    cleared: datetime | None
    """Since when its cause is gone, or None."""
    who: str | None
    """Who acknowledged it."""
    acknowledged: datetime | None
    """When it was acknowledged."""
    note: str
    """What that person noted."""
    closed: datetime | None
    """When it was both acknowledged and cleared."""


@dataclass(frozen=True)
class Silence:
    """A time in which a machine sends no messages."""

    id: int
    """Number in the history."""
    machine: str
    """Name of its machine."""
    since: datetime
    """When it began."""
    until: datetime
    """When it ends, or ended."""
    who: str
    """Who asked for it."""
    note: str
    """Why."""


@dataclass(frozen=True)
class Event:
    """What happened to a machine, as a person said it."""

    id: int
    """Number in the history."""
    machine: str
    """Name of its machine."""
    time: datetime
    """When it happened."""
    kind: str
    """``maintenance``, ``note`` or another word."""
    who: str
    """Who said so."""
    note: str
    """What happened."""


@dataclass(frozen=True)
class Rejection:
    """A delivery that became no recording."""

    received: datetime
    """When it was delivered last."""
    source: str
    """Name of the source."""
    file: str
    """Name of the file as delivered."""
    machine: str | None
    """Machine as stated."""
    content: str | None
    """SHA-256 of the bytes that were delivered."""
    reason: str
    """One word: ``late``, ``double``, ``broken``, ``rate``, ``channels``, ``machine``, ..."""
    detail: str
    """One line for a person."""
    copy: str | None = None
    """Name of the file among the rejected ones, where it was kept."""
    times: int = 1
    """How often it was delivered."""


@dataclass(frozen=True)
class Message:
    """A message that waits to be sent, or was sent."""

    id: int
    """Number in the history."""
    machine: str
    """Name of its machine."""
    alarm: int | None
    """Alarm that it is about."""
    channel: str
    """Name of the channel."""
    body: dict[str, Any]
    """What to send."""
    created: datetime
    """When it was posted."""
    attempts: int
    """How often it was claimed."""
    error: str | None
    """Why the last attempt failed."""
    sent: datetime | None
    """When it was sent."""


@dataclass(frozen=True)
class Estimate:
    """A value of the twin with its interval."""

    name: str
    """Such as ``slipper_swash.stiffness``, or a severity."""
    value: float
    """Best value."""
    low: float | None = None
    """Lower end of the interval."""
    high: float | None = None
    """Upper end of the interval."""
    unit: str = "1"
    """Unit of all three."""


@dataclass(frozen=True)
class Recalibration:
    """Values of a machine's twin at one time."""

    id: int
    """Number in the history."""
    machine: str
    """Name of its machine."""
    time: datetime
    """When the recordings were measured."""
    estimates: tuple[Estimate, ...]
    """The values."""
    note: str
    """Why it was calibrated."""


@dataclass(frozen=True)
class MachineOverview:
    """One machine at a glance."""

    name: str
    """Name."""
    recordings: int
    """How many recordings it has."""
    last: StoredRecording | None
    """The newest by time of measurement."""
    alarms: tuple[Alarm, ...]
    """Alarms that are not closed."""
    silenced: datetime | None
    """Until when it is silent, or None."""
    maintained: datetime | None = None
    """When its newest maintenance was noted, or None."""


@dataclass(frozen=True)
class Trend:
    """One indicator of a machine over time, oldest first."""

    ids: Int[np.ndarray, " recording"]
    """Recordings."""
    times: Shaped[np.ndarray, " recording"]
    """When they were measured, as datetime64 in UTC."""
    values: Float[np.ndarray, " recording"]
    """The indicator; NaN where a recording has none."""


@dataclass(frozen=True)
class Counts:
    """Totals, for measuring programs."""

    recordings: dict[tuple[str, str], int]
    """By machine and state."""
    alarms: dict[tuple[str, str], int]
    """Not closed, by machine and kind."""
    rejections: dict[str, int]
    """Deliveries among the newest rejections, by reason."""
    waiting: int
    """Messages that wait."""
