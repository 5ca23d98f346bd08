"""Tables of the history, alike in SQLite and PostgreSQL."""

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Column,
    DateTime,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    TypeDecorator,
    UniqueConstraint,
)

METADATA = MetaData()
Number = BigInteger().with_variant(Integer(), "sqlite")
Document = JSON(none_as_null=True)


class Moment(TypeDecorator[datetime]):
    """An aware time, kept in UTC."""

    impl = DateTime(timezone=True)
    cache_ok = True

    @property
    def python_type(self) -> type[datetime]:
        """Type of a value."""
        return datetime

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """`value` in UTC; SQLite keeps no zone."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"time {value} has no zone; the history keeps times in UTC.")
        value = value.astimezone(UTC)
        return value.replace(tzinfo=None) if dialect.name == "sqlite" else value

    def process_result_value(self, value: Any, dialect: Dialect) -> datetime | None:
        """`value` in UTC."""
        if value is None:
            return None
        result: datetime = value
        return result.replace(tzinfo=UTC) if result.tzinfo is None else result.astimezone(UTC)


def _id() -> Column[Any]:
    return Column("id", Number, primary_key=True)


def _machine(**options: Any) -> Column[Any]:
    return Column("machine_id", Number, ForeignKey("machines.id"), nullable=False, **options)


version = Table("swashtwin_history", METADATA, Column("version", Integer, nullable=False))
"""One row: the version of the tables."""

machines = Table(
    "machines",
    METADATA,
    _id(),
    Column("name", String, nullable=False, unique=True),
    Column("sequence", Number, nullable=False),  # grows with each transaction; its change locks the machine
    Column("last", Number),  # the newest recording by time of measurement
)
"""Machines; the one with an empty name counts rejections of machines that nobody knows."""

recordings = Table(
    "recordings",
    METADATA,
    _id(),
    _machine(),
    Column("content", String, nullable=False),
    Column("time", Moment, nullable=False),
    Column("received", Moment, nullable=False),
    Column("source", String, nullable=False),
    Column("file", String, nullable=False),
    Column("channels", Document, nullable=False),
    Column("unit", String, nullable=False),
    Column("sample_rate", Float(53), nullable=False),
    Column("duration", Float(53), nullable=False),
    Column("state", String, nullable=False),
    Column("point", String),
    Column("speed", Float(53)),
    Column("pressure", Float(53)),
    Column("label", String),
    Column("probability", Float(53)),
    Column("confidence", Float(53)),
    Column("ood_p", Float(53)),
    Column("model", String),
    Column("alarm_p", Float(53)),
    Column("capital", Float(53)),
    Column("reasons", Document, nullable=False),
    Column("waveform", String),  # path below the folder of waveforms, or null where none is kept
    Column("retention", String),  # why it is kept: alarm, day, last
    UniqueConstraint("machine_id", "content"),
)
Index("recordings_by_time", recordings.c.machine_id, recordings.c.time)
Index(
    "recordings_by_retention",
    recordings.c.machine_id,
    recordings.c.retention,
    recordings.c.time,
    sqlite_where=recordings.c.waveform.is_not(None),
    postgresql_where=recordings.c.waveform.is_not(None),
)

tallies = Table(
    "tallies",
    METADATA,
    _machine(primary_key=True),
    Column("state", String, primary_key=True),
    Column("recordings", Number, nullable=False),
)
"""Recordings by machine and state, so that nobody counts millions of rows."""

layouts = Table(
    "layouts",
    METADATA,
    _id(),
    _machine(),
    Column("digest", String, nullable=False),
    Column("names", Document, nullable=False),  # list of [channel, name]
    UniqueConstraint("machine_id", "digest"),
)
"""Names of indicators, once for all recordings that have the same."""

indicators = Table(
    "indicators",
    METADATA,
    Column("recording_id", Number, ForeignKey("recordings.id"), primary_key=True),
    Column("layout_id", Number, ForeignKey("layouts.id"), nullable=False),
    Column("values", LargeBinary, nullable=False),  # float32, little-endian, in the order of the layout
)
"""Indicators of a recording, packed: a tenth of the space of a row each."""

points = Table(
    "points",
    METADATA,
    _machine(primary_key=True),
    Column("name", String, primary_key=True),
    Column("speed", Float(53)),
    Column("pressure", Float(53)),
    Column("test", Document),
    Column("updated", Moment, nullable=False),
)
"""Operating points with the small state of their test."""

baselines = Table(
    "baselines",
    METADATA,
    _machine(primary_key=True),
    Column("point", String, primary_key=True),
    Column("baseline", Document, nullable=False),
)
"""Learned levels of operating points, apart because they are large and change rarely."""

alarms = Table(
    "alarms",
    METADATA,
    _id(),
    _machine(),
    Column("point", String),
    Column("kind", String, nullable=False),
    Column("state", String, nullable=False),
    Column("opened", Moment, nullable=False),
    Column("evidence", Document, nullable=False),
    Column("recording", Number),
    Column("cleared", Moment),
    Column("who", String),
    Column("acknowledged", Moment),
    Column("note", String, nullable=False, default=""),
    Column("closed", Moment),
)
Index(
    "alarms_not_closed",
    alarms.c.machine_id,
    sqlite_where=alarms.c.closed.is_(None),
    postgresql_where=alarms.c.closed.is_(None),
)

silences = Table(
    "silences",
    METADATA,
    _id(),
    _machine(index=True),
    Column("since", Moment, nullable=False),
    Column("until", Moment, nullable=False),
    Column("who", String, nullable=False),
    Column("note", String, nullable=False),
)

events = Table(
    "events",
    METADATA,
    _id(),
    _machine(index=True),
    Column("time", Moment, nullable=False),
    Column("kind", String, nullable=False),
    Column("who", String, nullable=False),
    Column("note", String, nullable=False),
)

recalibrations = Table(
    "recalibrations",
    METADATA,
    _id(),
    _machine(index=True),
    Column("time", Moment, nullable=False),
    Column("estimates", Document, nullable=False),
    Column("note", String, nullable=False),
)

rejections = Table(
    "rejections",
    METADATA,
    _id(),
    Column("received", Moment, nullable=False),
    Column("source", String, nullable=False),
    Column("file", String, nullable=False),
    Column("machine", String, nullable=False),  # as stated; empty where none was
    Column("content", String, nullable=False),
    Column("reason", String, nullable=False),
    Column("detail", String, nullable=False),
    Column("copy", String),
    Column("times", Number, nullable=False),
    UniqueConstraint("content", "machine", "reason"),
)

outbox = Table(
    "outbox",
    METADATA,
    _id(),
    _machine(),
    Column("alarm", Number),
    Column("channel", String, nullable=False),
    Column("body", Document, nullable=False),
    Column("created", Moment, nullable=False),
    Column("due", Moment, nullable=False),
    Column("attempts", Integer, nullable=False, default=0),
    Column("error", String),
    Column("sent", Moment),
)
Index("outbox_waiting", outbox.c.id, sqlite_where=outbox.c.sent.is_(None), postgresql_where=outbox.c.sent.is_(None))
