"""What a watch is told: machines, sources of recordings, alarms, channels, retention and the page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, TypeAlias

from swashtwin.monitoring.config import entries as read
from swashtwin.monitoring.config.secret import NO_SECRET, Secret

_PORT = read.whole(1, 65535)
_MAIL_PORTS = {"starttls": 587, "tls": 465, "none": 25}


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A pump that is watched."""

    name: Annotated[str, read.text]
    """Unique; also the name of its folder of waveforms."""
    pump: Annotated[str | None, read.pump] = None
    """Name of a pump of the catalog, or path of a pump file."""
    model: Annotated[Path | None, read.file] = None
    """Saved `FaultClassifier` or `AnomalyDetector`."""
    twin: Annotated[Path | None, read.file] = None
    """Saved calibration."""
    channels: Annotated[tuple[str, ...], read.texts] = ()
    """Channels that each recording must have, in this order; empty: those of the first recording."""
    speed: Annotated[float | None, read.quantity("rad/s")] = None
    """Angular speed of the shaft where it is constant [rad/s]."""
    discharge_pressure: Annotated[float | None, read.quantity("Pa")] = None
    """Pressure at the outlet where it is constant [Pa]."""
    tags: Annotated[Path | None, read.path] = None
    """CSV with time, speed and pressure; another system may write it later."""
    sample_rate: Annotated[float | None, read.quantity("Hz")] = None
    """Rate of files that state none [Hz]."""
    unit: Annotated[str | None, read.text] = None
    """Unit of files that state none."""


@dataclass(frozen=True, kw_only=True)
class Broker:
    """An MQTT broker and how to log in."""

    host: Annotated[str, read.text]
    """Name or address."""
    port: Annotated[int, _PORT] = 0
    """By default 1883, with TLS 8883."""
    user: Annotated[str | None, read.text] = None
    """User name."""
    password: Annotated[Secret, read.password] = NO_SECRET
    """Password of that user."""
    tls: Annotated[bool, read.switch] = False
    """Whether the connection is encrypted."""
    ca: Annotated[Path | None, read.file] = None
    """Certificates that are trusted; by default the system's."""

    def __post_init__(self) -> None:
        if not self.port:
            object.__setattr__(self, "port", 8883 if self.tls else 1883)


@dataclass(frozen=True, kw_only=True)
class FolderSource:
    """Files that another program writes into a folder."""

    kind: ClassVar[str] = "folder"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""
    path: Annotated[Path, read.path]
    """Folder, searched with its sub-folders."""
    pattern: Annotated[str, read.text] = "*"
    """Names of the files, such as ``*.wav``."""
    settle: Annotated[float, read.quantity("s")] = 1.0
    """Time for which a file's size and date stay the same before it is read [s]."""
    machine: Annotated[str | None, read.text] = None
    """Machine of all files; by default the name of the first sub-folder."""
    remove: Annotated[bool, read.switch] = False
    """Whether a file is deleted once it is in the watch's own folder."""


@dataclass(frozen=True, kw_only=True)
class MqttSource(Broker):
    """Recordings as messages of an MQTT broker."""

    kind: ClassVar[str] = "mqtt"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""
    topic: Annotated[str, read.text]
    """Topic, with ``+`` where the machine's name stands."""
    machine: Annotated[str | None, read.text] = None
    """Machine of all messages; by default what stands at the first ``+``."""
    group: Annotated[str | None, read.text] = None
    """Shared subscription: each message goes to one watch of this group."""
    client: Annotated[str | None, read.text] = None
    """Client name at the broker, which keeps messages for it; by default made from the folder."""


@dataclass(frozen=True, kw_only=True)
class HttpSource:
    """Recordings that are sent to the page's ``POST /api/recordings``."""

    kind: ClassVar[str] = "http"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""


@dataclass(frozen=True, kw_only=True)
class AlarmSettings:
    """The alarm's promise."""

    false_alarm_rate: Annotated[float, read.fraction(0.5)] = 0.01
    """Chance that a healthy machine ever raises an alarm at one operating point."""
    learning: Annotated[int, read.whole(10, 1000)] = 20
    """Recordings from which a baseline is learned."""


@dataclass(frozen=True, kw_only=True)
class LogChannel:
    """Messages as lines of a file."""

    kind: ClassVar[str] = "log"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""
    path: Annotated[Path | None, read.path] = None
    """File; by default ``alarms.log`` in the watch's folder."""


@dataclass(frozen=True, kw_only=True)
class WebhookChannel:
    """Messages as JSON, posted to a URL."""

    kind: ClassVar[str] = "webhook"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""
    url: Annotated[Secret, read.secret_url]
    """Where to post."""
    token: Annotated[Secret, read.password] = NO_SECRET
    """Sent as ``Authorization: Bearer``."""


@dataclass(frozen=True, kw_only=True)
class MqttChannel(Broker):
    """Messages as JSON, published to a topic."""

    kind: ClassVar[str] = "mqtt"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""
    topic: Annotated[str, read.text]
    """Topic to publish to."""


@dataclass(frozen=True, kw_only=True)
class EmailChannel:
    """Messages by e-mail."""

    kind: ClassVar[str] = "email"
    name: Annotated[str, read.text]
    """Unique; by default the kind."""
    host: Annotated[str, read.text]
    """Mail server."""
    port: Annotated[int, _PORT] = 0
    """By default 587, 465 or 25, by `tls`."""
    sender: Annotated[str, read.text]
    """Address of the sender."""
    recipients: Annotated[tuple[str, ...], read.texts]
    """Addresses of the recipients."""
    user: Annotated[str | None, read.text] = None
    """User name."""
    password: Annotated[Secret, read.password] = NO_SECRET
    """Password of that user."""
    tls: Annotated[str, read.choice(*_MAIL_PORTS)] = "starttls"
    """``starttls``, ``tls``, or ``none``."""

    def __post_init__(self) -> None:
        if not self.port:
            object.__setattr__(self, "port", _MAIL_PORTS[self.tls])


@dataclass(frozen=True, kw_only=True)
class Retention:
    """Which waveforms stay; verdicts and indicators stay always."""

    alarms: Annotated[int | None, read.whole_or_all(0, 1_000_000)] = None
    """Those of alarms, at most this many of the latest by machine; None is all."""
    per_day: Annotated[int, read.whole(0, 1000)] = 1
    """The first so many of each machine and day."""
    last: Annotated[int, read.whole(0, 100_000)] = 100
    """The last so many of each machine that stay for no other reason."""


@dataclass(frozen=True, kw_only=True)
class PageSettings:
    """Where the page is served, and to whom."""

    host: Annotated[str, read.text] = "127.0.0.1"
    """Address to listen at; beyond this computer only with `users` or `tokens`."""
    port: Annotated[int, _PORT] = 8642
    """Port."""
    users: Annotated[Path | None, read.path] = None
    """File of users with hashed passwords, as ``swashtwin watch user`` writes it."""
    tokens: Annotated[Path | None, read.path] = None
    """File of hashed tokens for programs, as ``swashtwin watch user`` writes it."""
    hosts: Annotated[tuple[str, ...], read.texts] = ()
    """Further names under which browsers reach the page, such as that of a proxy."""
    secure: Annotated[bool, read.switch] = False
    """Whether a proxy before the page serves it by HTTPS."""
    proxy: Annotated[str | None, read.address] = None
    """Address of that proxy, which states the address of each client in ``X-Forwarded-For``."""


Source: TypeAlias = FolderSource | MqttSource | HttpSource
Channel: TypeAlias = LogChannel | WebhookChannel | MqttChannel | EmailChannel


@dataclass(frozen=True, kw_only=True)
class WatchConfig:
    """Everything a watch is told."""

    path: Path
    """File that it comes from."""
    folder: Annotated[Path, read.path]
    """Folder of history, waveforms and files that wait."""
    history: Annotated[Secret, read.secret_url] = NO_SECRET
    """URL of the database; empty: SQLite in `folder`."""
    language: Annotated[str, read.choice("en", "de")] = "en"
    """Language of page and messages."""
    machines: tuple[Machine, ...]
    """Machines that are watched."""
    sources: tuple[Source, ...]
    """Where recordings come from."""
    alarms: AlarmSettings = AlarmSettings()
    """The alarm's promise."""
    channels: tuple[Channel, ...] = ()
    """Where messages go, besides the page."""
    retention: Retention = Retention()
    """Which waveforms stay."""
    page: PageSettings = PageSettings()
    """Where the page is served, and to whom."""

    def machine(self, name: str) -> Machine | None:
        """Machine of that name, or None."""
        return next((machine for machine in self.machines if machine.name == name), None)
