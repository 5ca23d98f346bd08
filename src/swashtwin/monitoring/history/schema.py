"""Tables of the history, the same in SQLite and PostgreSQL.

A row is a dataclass. All times have a zone and are in UTC.
"""

import math
import sys
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    DateTime,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    TypeDecorator,
    UniqueConstraint,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, MappedAsDataclass, mapped_column


class Moment(TypeDecorator[datetime]):
    """A time with a zone, stored in UTC."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return `value` in UTC, for SQLite without a zone."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"time {value} has no zone; use an aware time, such as one in UTC.")

        value = value.astimezone(UTC)
        if dialect.name == "sqlite":
            value = value.replace(tzinfo=None)
        return value

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return `value` in UTC."""
        if value is None:
            return None
        if value.tzinfo is None:
            return value.replace(tzinfo=UTC)
        return value.astimezone(UTC)


class Real(TypeDecorator[float]):
    """A number that both databases can hold: NaN becomes null, infinity the largest number."""

    impl = Float(53)
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Return `value`, finite or None."""
        if value is None or math.isnan(value):
            return None
        return max(-sys.float_info.max, min(float(value), sys.float_info.max))


# SQLite numbers rows by itself only in a column of the type INTEGER.
_Number = BigInteger().with_variant(Integer(), "sqlite")
# None is stored as NULL, not as the JSON text null, so that queries can ask for it.
_Document = JSON(none_as_null=True)


class Row(MappedAsDataclass, DeclarativeBase, kw_only=True):
    """Base of all rows."""

    type_annotation_map = {  # noqa: RUF012
        int: _Number,
        float: Real,
        datetime: Moment,
        dict[str, Any]: _Document,
        list[str]: _Document,
        list[list[str]]: _Document,
    }


def _id() -> Any:
    return mapped_column(primary_key=True, init=False)


def _machine(**options: Any) -> Any:
    return mapped_column(ForeignKey("machines.name"), init=False, **options)


class Version(Row, kw_only=True):
    """The version of the tables: one row."""

    __tablename__ = "swashtwin_history"
    version: Mapped[int] = mapped_column(primary_key=True)


class Machine(Row, kw_only=True):
    """A machine; the one with an empty name counts rejections of unknown machines."""

    __tablename__ = "machines"
    name: Mapped[str] = mapped_column(primary_key=True)
    sequence: Mapped[int]
    """Grows with each transaction; the change of this number locks the machine."""
    last: Mapped[int | None] = mapped_column(default=None)
    """Number of the newest recording by time of measurement."""


class Judgment(Row, kw_only=True):
    """One recording of a machine: its facts, and what the watch concluded from it."""

    __tablename__ = "recordings"
    id: Mapped[int] = _id()
    machine: Mapped[str] = _machine()
    content: Mapped[str]
    """Hash of the content (`Contents.digest`); a machine has no content twice."""
    time: Mapped[datetime]
    received: Mapped[datetime]
    source: Mapped[str]
    file: Mapped[str]
    channels: Mapped[list[str]]
    unit: Mapped[str]
    sample_rate: Mapped[float]
    """Samples per second and channel [Hz]."""
    duration: Mapped[float]
    """Length [s]."""
    state: Mapped[str]
    """``learning``, ``normal``, ``unusual``, ``alarm`` or ``sensor``."""
    point: Mapped[str | None] = mapped_column(default=None)
    """Name of the operating point, if it is known."""
    speed: Mapped[float | None] = mapped_column(default=None)
    """Angular speed of the shaft [rad/s]."""
    pressure: Mapped[float | None] = mapped_column(default=None)
    """Discharge pressure [Pa]."""
    label: Mapped[str | None] = mapped_column(default=None)
    """Class of the model's verdict: the likeliest; of a detector ``normal`` or ``abnormal``."""
    probability: Mapped[float | None] = mapped_column(default=None)
    """Probability of the class; of a detector the p-value."""
    confidence: Mapped[float | None] = mapped_column(default=None)
    """Share of the windows with the same verdict."""
    ood_p: Mapped[float | None] = mapped_column(default=None)
    """p-value of the recording among those of the training."""
    model: Mapped[str | None] = mapped_column(default=None)
    """Fingerprint of the model."""
    alarm_p: Mapped[float | None] = mapped_column(default=None)
    """p-value against the healthy baseline of the machine."""
    capital: Mapped[float | None] = mapped_column(default=None)
    """Evidence of the sequential test after this recording."""
    reasons: Mapped[dict[str, Any]] = mapped_column(default_factory=dict)
    """Further evidence, and the ``suspect`` if the recording deviates far, as JSON can hold it."""
    waveform: Mapped[str | None] = mapped_column(default=None)
    """Path of its samples below the folder of waveforms; None if they were not kept."""
    retention: Mapped[str | None] = mapped_column(default=None)
    """Why they are kept: ``alarm``, ``day``, ``last``."""

    __table_args__ = (
        UniqueConstraint("machine", "content"),
        Index("recordings_by_time", "machine", "time"),
    )


# Only rows with a waveform: retention asks for no others, and they are few in a long history.
_HAS_WAVEFORM = Judgment.__table__.c.waveform.is_not(None)
Index(
    "recordings_by_retention", Judgment.machine, Judgment.retention, Judgment.time,
    sqlite_where=_HAS_WAVEFORM, postgresql_where=_HAS_WAVEFORM,
)  # fmt: skip


class Tally(Row, kw_only=True):
    """Number of recordings by machine and state: counting millions of rows would take seconds."""

    __tablename__ = "tallies"
    machine: Mapped[str] = mapped_column(ForeignKey("machines.name"), primary_key=True)
    state: Mapped[str] = mapped_column(primary_key=True)
    recordings: Mapped[int] = mapped_column(default=0)


class Layout(Row, kw_only=True):
    """Names of indicators, stored once for all recordings with the same names."""

    __tablename__ = "layouts"
    id: Mapped[int] = _id()
    machine: Mapped[str] = _machine()
    digest: Mapped[str]
    names: Mapped[list[list[str]]]
    """Channel and name of each indicator."""

    __table_args__ = (UniqueConstraint("machine", "digest"),)


class Indicators(Row, kw_only=True):
    """Indicators of a recording, packed: they take a tenth of the space of one row each."""

    __tablename__ = "indicators"
    recording: Mapped[int] = mapped_column(ForeignKey("recordings.id"), primary_key=True)
    layout: Mapped[int] = mapped_column(ForeignKey("layouts.id"))
    values: Mapped[bytes]
    """float32, little-endian, in the order of the layout."""


class OperatingPointRow(Row, kw_only=True):
    """An operating point of a machine, with the small state of its test."""

    __tablename__ = "points"
    machine: Mapped[str] = mapped_column(ForeignKey("machines.name"), primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    """Unique within the machine."""
    speed: Mapped[float | None] = mapped_column(default=None)
    """Angular speed of the shaft [rad/s]."""
    pressure: Mapped[float | None] = mapped_column(default=None)
    """Discharge pressure [Pa]."""
    test: Mapped[dict[str, Any] | None] = mapped_column(default=None)
    """What changes with each recording: the state of the test."""


class Baseline(Row, kw_only=True):
    """Baseline of an operating point, apart from it because it is large and rarely changes."""

    __tablename__ = "baselines"
    machine: Mapped[str] = mapped_column(ForeignKey("machines.name"), primary_key=True)
    point: Mapped[str] = mapped_column(primary_key=True)
    baseline: Mapped[dict[str, Any]]


class Alarm(Row, kw_only=True):
    """An alarm of a machine."""

    __tablename__ = "alarms"
    id: Mapped[int] = _id()
    machine: Mapped[str] = _machine()
    point: Mapped[str | None]
    kind: Mapped[str]
    """``pump``, ``sensor`` or ``delivery``."""
    state: Mapped[str] = mapped_column(default="open")
    """``open``, ``acknowledged`` or ``closed``."""
    opened: Mapped[datetime]
    """Time of the recording that raised it."""
    evidence: Mapped[dict[str, Any]]
    """Why it was raised, the reasons of the ``newest`` deviating recording, the ``suspect``, its
    ``severity``, and what was ``found``; each with the time of its recording.
    """
    recording: Mapped[int | None]
    cleared: Mapped[datetime | None] = mapped_column(default=None)
    """Since when its cause has been gone, or None."""
    who: Mapped[str | None] = mapped_column(default=None)
    acknowledged: Mapped[datetime | None] = mapped_column(default=None)
    note: Mapped[str] = mapped_column(default="")
    closed: Mapped[datetime | None] = mapped_column(default=None)
    """When it was both acknowledged and cleared."""


# Every recording asks for the alarms that are not closed; there are few of them.
_NOT_CLOSED = Alarm.__table__.c.closed.is_(None)
Index("alarms_not_closed", Alarm.machine, sqlite_where=_NOT_CLOSED, postgresql_where=_NOT_CLOSED)


class Silence(Row, kw_only=True):
    """A period in which no messages about a machine are sent."""

    __tablename__ = "silences"
    id: Mapped[int] = _id()
    machine: Mapped[str] = _machine(index=True)
    since: Mapped[datetime]
    """When it began."""
    until: Mapped[datetime]
    """When it ends, or ended."""
    who: Mapped[str]
    note: Mapped[str]


class Event(Row, kw_only=True):
    """What happened to a machine, as a person reported it."""

    __tablename__ = "events"
    id: Mapped[int] = _id()
    machine: Mapped[str] = _machine(index=True)
    time: Mapped[datetime]
    kind: Mapped[str]
    """``maintenance``, ``note`` or another kind."""
    who: Mapped[str]
    note: Mapped[str]


class DeliveryRow(Row, kw_only=True):
    """What is remembered of a machine's deliveries, judged or not."""

    __tablename__ = "deliveries"
    machine: Mapped[str] = mapped_column(ForeignKey("machines.name"), primary_key=True)
    state: Mapped[dict[str, Any]]
    """`DeliveryState` as a table."""


class Rejection(Row, kw_only=True):
    """A delivery that was rejected."""

    __tablename__ = "rejections"
    id: Mapped[int] = _id()
    received: Mapped[datetime]
    """When it was last delivered."""
    source: Mapped[str]
    file: Mapped[str]
    machine: Mapped[str]
    """Machine as specified; empty if none was specified."""
    content: Mapped[str]
    """SHA-256 of the bytes that were delivered."""
    reason: Mapped[str]
    """One word: ``late``, ``double``, ``broken``, ``unfit``, ``machine``, ..."""
    detail: Mapped[str]
    """The reason for a person, in one line."""
    copy: Mapped[str | None] = mapped_column(default=None)
    """Name of the file in the folder ``rejected``, if it was kept."""
    times: Mapped[int] = mapped_column(default=1)
    """Number of its deliveries."""

    __table_args__ = (UniqueConstraint("content", "machine", "reason"),)


class Message(Row, kw_only=True):
    """A message that waits to be sent, or was sent."""

    __tablename__ = "outbox"
    id: Mapped[int] = _id()
    machine: Mapped[str] = _machine()
    alarm: Mapped[int | None]
    channel: Mapped[str]
    body: Mapped[dict[str, Any]]
    created: Mapped[datetime]
    due: Mapped[datetime]
    """Earliest time at which it is sent."""
    attempts: Mapped[int] = mapped_column(default=0)
    """Number of attempts to send it."""
    error: Mapped[str | None] = mapped_column(default=None)
    sent: Mapped[datetime | None] = mapped_column(default=None)


# Senders look twice a second for messages that wait, which are few.
_NOT_SENT = Message.__table__.c.sent.is_(None)
Index("outbox_waiting", Message.id, sqlite_where=_NOT_SENT, postgresql_where=_NOT_SENT)
