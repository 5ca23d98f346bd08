"""The settings of a watch: machines, sources, alarms, channels, retention and the page."""

from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeAlias

from msgspec import Meta, Struct, field
from msgspec.structs import force_setattr

from swashtwin.foundation import PressureUnit
from swashtwin.pump import load_pump

Text = Annotated[str, Meta(min_length=1, pattern=r"\S")]
Port = Annotated[int, Meta(ge=1, le=65535)]

# Usual port of a mail server by encryption (RFC 8314).
_MAIL_PORTS = {"starttls": 587, "tls": 465, "none": 25}

_MQTT_PORT = 1883

# Ports of MQTT that IANA assigned.
_MQTT_TLS_PORT = 8883


class Secret:
    """A password or token, which is never shown.

    The file contains ``${NAME}``, and the environment the secret.

    Examples
    --------
    >>> Secret("hunter2"), str(Secret("hunter2")), bool(Secret(""))
    (Secret(***), 'Secret(***)', False)
    """

    def __init__(self, text: str) -> None:
        self._text = text

    def reveal(self) -> str:
        """Return the secret itself, to be sent to a server and to nothing else."""
        return self._text

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other.reveal() == self._text

    def __hash__(self) -> int:
        return hash(self._text)

    def __repr__(self) -> str:
        return "Secret(***)"

    def __bool__(self) -> bool:
        return bool(self._text)


class SecretUrl(Secret):
    """A URL, which is never shown because it may contain a secret.

    A password in it comes from the environment.
    """


class NameOrFile(str):
    """Name of something that swashtwin ships, or path of a file."""


class Quantity(float):
    """A number above zero, which has a unit in the file."""

    unit: ClassVar[str]


class Speed(Quantity):
    """Angular speed [rad/s]."""

    unit = "rad/s"


class Pressure(Quantity):
    """Pressure [Pa]."""

    unit = "Pa"


class Rate(Quantity):
    """Samples per second [Hz]."""

    unit = "Hz"


class Seconds(Quantity):
    """Time [s]."""

    unit = "s"


NO_SECRET = Secret("")
"""Default if no secret is needed."""


class Entries(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file."""

    @property
    def kind(self) -> str:
        """Value of ``kind`` in the file."""
        return str(self.__struct_config__.tag)


class Machine(Entries, frozen=True, kw_only=True):
    """A pump that is watched."""

    name: Text
    """Unique; also the name of its folder of waveforms."""
    site: Text | None = None
    """Place of the machine; the start page groups machines by it."""
    pump: NameOrFile | None = None
    """Name of a pump of the catalog, or path of a pump file."""
    pistons: Annotated[int, Meta(ge=5, le=15)] | None = None
    """Piston count of a swash-plate pump without a pump file."""
    model: Path | None = None
    """Saved `FaultClassifier`, `AnomalyDetector` or adapted `PriorClassifier`."""
    prior: NameOrFile = NameOrFile("25scy14-1b")
    """Shipped prior, or path of one of ``twin prior``; it names the suspect of an alarm."""
    library: Path | None = None
    """Measured faults of other machines, of ``model library``; the suspect is then also named by
    them, if they help.
    """
    calibration: Path | None = None
    """Calibration on healthy recordings of the pump; it measures the severity of the suspect."""
    severity_limits: dict[Text, Text] = {}
    """Severity at which the pump has to be stopped, by kind of fault: ``{piston = "200 um"}``; the
    remaining time until then is estimated.
    """
    channels: tuple[Text, ...] = ()
    """Channels that each recording must have, in this order; empty: those of the first
    recording.
    """
    speed: Speed | None = None
    """Angular speed of the shaft, if it is constant [rad/s]."""
    discharge_pressure: Pressure | None = None
    """Pressure at the outlet, if it is constant [Pa]."""
    tags: Path | None = None
    """CSV file with time, speed and pressure; another system may write it later."""
    tags_zone: Text | None = None
    """Time zone of times in `tags` that specify none: ``Europe/Berlin``, ``+01:00`` or ``UTC``."""
    sample_rate: Rate | None = None
    """Sample rate of files that specify none [Hz]."""
    unit: Text | None = None
    """Unit of files that specify none."""
    sensitivity: Text | tuple[Text, ...] | None = None
    """Sensitivity of the sensors, as in an index: ``"99.7 mV/g"``."""
    names: tuple[Text, ...] = ()
    """New names of `channels`, in the same order."""
    time_column: Text | int | None = None
    time_unit: Text | None = None
    header_lines: int | None = None
    separator: Text | None = None
    decimal: Text | None = None

    def __post_init__(self) -> None:
        if len(set(self.channels)) < len(self.channels):
            raise ValueError(f"channels = {list(self.channels)} contains a name twice")
        if self.pistons is not None and self.pump is not None:
            raise ValueError("pistons follows from pump; specify only one of the two")
        if self.calibration is not None and self.pistons is None and self.pump is None:
            raise ValueError(
                "calibration measures the severity of a suspect; specify pump or pistons too"
            )
        if self.severity_limits and self.calibration is None:
            raise ValueError("severity_limits needs a calibration, which measures severities")

    @property
    def piston_count(self) -> int | None:
        """Piston count, if it is known."""
        if self.pump is None:
            return self.pistons
        return load_pump(self.pump).rotating_group.piston_count


class Broker(Entries, frozen=True, kw_only=True):
    """An MQTT broker and how to log in."""

    host: Text
    port: Port | Literal[0] = 0
    """Port; by default 1883, with TLS 8883."""
    user: Text | None = None
    password: Secret = NO_SECRET
    tls: bool = False
    """Whether the connection is encrypted."""
    ca: Path | None = None
    """File of trusted certificates; by default those of the system."""

    def __post_init__(self) -> None:
        # msgspec allows no other change of a frozen object.
        if not self.port:
            force_setattr(self, "port", _MQTT_TLS_PORT if self.tls else _MQTT_PORT)


class FolderSource(Entries, frozen=True, kw_only=True, tag_field="kind", tag="folder"):
    """Files that another program writes into a folder."""

    name: Text = "folder"
    path: Path
    """Folder, which is searched with its sub-folders."""
    pattern: Text = "*"
    """Names of the files, such as ``*.wav``."""
    settle_time: Seconds = Seconds(1.0)
    """Time for which size and date of a file must stay the same before it is read [s]."""
    machine: Text | None = None
    """Machine of all files; by default the name of the first sub-folder."""
    remove: bool = False
    """Whether a file is deleted when it is in the folder of the watch."""


class MqttSource(Broker, frozen=True, kw_only=True, tag_field="kind", tag="mqtt"):
    """Recordings as messages of an MQTT broker."""

    name: Text = "mqtt"
    topic: Text
    """Topic, with ``+`` in place of the machine's name."""
    machine: Text | None = None
    """Machine of all messages; by default the part of the topic at the first ``+``."""
    group: Text | None = None
    """Name of a shared subscription: each message goes to one watch of this group."""
    client: Text | None = None
    """Name of the client for which the broker keeps messages; by default made from the folder."""


class HttpSource(Entries, frozen=True, kw_only=True, tag_field="kind", tag="http"):
    """Recordings that are sent to the page's ``POST /api/recordings``."""

    name: Text = "http"


MIN_LENGTH_S = 0.1
"""Shortest recording of a device, or part of one, that is kept: a shorter one holds no turn of a
pump.
"""


class LiveSource(Entries, frozen=True, kw_only=True, tag_field="kind", tag="live"):
    """Recordings that the watch itself makes of a measuring device."""

    name: Text = "live"
    device: Text
    """Connection string of openDAQ, such as ``"daqref://device0"``."""
    machine: Text
    """Machine that the device measures."""
    length: Seconds = Seconds(10.0)
    """Length of each recording [s]."""
    interval: Seconds | None = None
    """Time from the start of a recording to that of the next [s]; by default no gap."""
    channels: tuple[Text, ...] = ()
    """Names of the channels at the device; by default all but the tachometer."""
    tachometer: Text | None = None
    """Channel with the pulses of a tachometer, which measures the speed."""
    pulses_per_turn: Annotated[int, Meta(ge=1)] = 1
    """Pulses of the tachometer in a revolution."""
    sample_rate: Rate | None = None
    """Rate that the device must give [Hz]; by default the one that it is set to."""
    unit: Text | None = None
    """Unit of channels for which the device states none."""
    sensitivity: Text | tuple[Text, ...] | None = None
    """Sensitivity of the sensors, as in an index: ``"99.7 mV/g"``."""
    properties: dict[Text, Text | bool | int | float] = {}
    """Further properties, by their names in openDAQ: of the device, or ``"AI 1/Range"`` of a
    channel.
    """

    def __post_init__(self) -> None:
        if self.length < MIN_LENGTH_S:
            raise ValueError(
                f"length = {self.length:g} s is too short; it must be {MIN_LENGTH_S:g} s or more"
            )
        if len(set(self.channels)) < len(self.channels):
            raise ValueError(f"channels = {list(self.channels)} contains a name twice")
        if self.tachometer in self.channels:
            raise ValueError(
                f"tachometer = {self.tachometer!r} is one of the channels too; remove it from them"
            )
        if self.interval is not None and self.interval < self.length:
            raise ValueError(
                f"interval = {self.interval:g} s is shorter than length = {self.length:g} s"
            )


class AlarmSettings(Entries, frozen=True, kw_only=True):
    """What the alarm promises, and what it learns from."""

    false_alarm_rate: Annotated[float, Meta(gt=0, le=0.5)] = 0.01
    """Maximum chance that a healthy machine ever raises an alarm at one operating point."""
    baseline_recordings: Annotated[int, Meta(ge=10, le=1000)] = 20
    """Number of recordings from which a baseline is learned."""


class LogChannel(Entries, frozen=True, kw_only=True, tag_field="kind", tag="log"):
    """Messages as lines of a file."""

    name: Text = "log"
    path: Path | None = None
    """File; by default ``alarms.log`` in the watch's folder."""


class WebhookChannel(Entries, frozen=True, kw_only=True, tag_field="kind", tag="webhook"):
    """Messages as JSON, posted to a URL."""

    name: Text = "webhook"
    url: SecretUrl
    token: Secret = NO_SECRET
    """Sent as ``Authorization: Bearer``."""


class MqttChannel(Broker, frozen=True, kw_only=True, tag_field="kind", tag="mqtt"):
    """Messages as JSON, published to a topic."""

    name: Text = "mqtt"
    topic: Text


class EmailChannel(Entries, frozen=True, kw_only=True, tag_field="kind", tag="email"):
    """Messages by e-mail."""

    name: Text = "email"
    host: Text
    port: Port | Literal[0] = 0
    """Port; by default 587, 465 or 25, depending on `tls`."""
    sender: Text
    recipients: Annotated[tuple[Text, ...], Meta(min_length=1)]
    user: Text | None = None
    password: Secret = NO_SECRET
    tls: Literal["starttls", "tls", "none"] = "starttls"
    """How the connection is encrypted."""

    def __post_init__(self) -> None:
        if not self.port:
            force_setattr(self, "port", _MAIL_PORTS[self.tls])


class Retention(Entries, frozen=True, kw_only=True):
    """Which waveforms are kept; verdicts and indicators are always kept."""

    alarms: Annotated[int, Meta(ge=0)] | Literal["all"] = "all"
    """Waveforms of alarms: all, or the latest of each machine up to this number."""
    per_day: Annotated[int, Meta(ge=0)] = 1
    """Number of waveforms of each machine and day, the first ones of the day."""
    latest: Annotated[int, Meta(ge=0)] = 100
    """Number of the latest waveforms of each machine that are not kept for another reason."""


class PageSettings(Entries, frozen=True, kw_only=True):
    """Address of the page, and who may use it."""

    host: Text = "127.0.0.1"
    """Address to listen on; other computers can reach it only with `users`."""
    port: Port = 8642
    users: Path | None = None
    """File of hashed passwords and tokens, written by ``swashtwin watch user``."""
    hosts: tuple[Text, ...] = ()
    """Further names by which browsers reach the page, such as that of a proxy."""
    https: bool = False
    """Whether a proxy in front of the page serves it by HTTPS."""
    proxy: Text | None = None
    """IP address of that proxy, which sends the address of each client in ``X-Forwarded-For``."""

    def __post_init__(self) -> None:
        if not self.is_local and self.users is None:
            raise ValueError(
                f"host = {self.host!r} lets other computers read and acknowledge; add users = "
                '"users.json" and a user with swashtwin watch user, or use host = "127.0.0.1"'
            )

        if self.proxy is not None:
            try:
                ip_address(self.proxy)
            except ValueError:
                raise ValueError(
                    f'proxy = {self.proxy!r} must be an IP address, such as "127.0.0.1"'
                ) from None

    @property
    def is_local(self) -> bool:
        """Whether only this computer can reach the page."""
        # A name other than localhost may lead anywhere.
        try:
            return ip_address(self.host.strip("[]")).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def address(self) -> str:
        """URL of the page: that of the proxy that serves it, if one is configured.

        Examples
        --------
        >>> PageSettings().address, PageSettings(hosts=("watch.plant.example",), https=True).address
        ('http://127.0.0.1:8642', 'https://watch.plant.example')
        """
        if self.hosts and self.https:
            return f"https://{self.hosts[0]}"

        host = self.host
        if ":" in host:
            host = f"[{host}]"  # as an IPv6 address stands in a URL
        return f"http://{host}:{self.port}"


Source: TypeAlias = FolderSource | MqttSource | HttpSource | LiveSource
Channel: TypeAlias = LogChannel | WebhookChannel | MqttChannel | EmailChannel


class WatchConfig(Entries, frozen=True, kw_only=True):
    """All settings of a watch."""

    path: Path = field(name="(file)")
    """File of the configuration."""
    folder: Path
    """Folder of history, waveforms and waiting files."""
    history: SecretUrl | None = None
    """URL of the database; None for SQLite in `folder`."""
    machines: tuple[Machine, ...] = field(name="machine", default=())
    sources: tuple[Source, ...] = field(name="source", default=())
    alarms: AlarmSettings = AlarmSettings()
    channels: tuple[Channel, ...] = field(name="channel", default=())
    retention: Retention = Retention()
    page: PageSettings = PageSettings()
    pressure_unit: PressureUnit = "MPa"
    """Unit of absolute pressures on the page and in messages."""

    @property
    def history_url(self) -> str:
        """URL of the database; empty for SQLite in `folder`."""
        if self.history is None:
            return ""
        return self.history.reveal()

    @property
    def machine_names(self) -> str:
        """Names of the first machines, for messages."""
        return ", ".join(machine.name for machine in self.machines[:20])

    def machine(self, name: str) -> Machine | None:
        """Return the machine with that name, or None."""
        return next((machine for machine in self.machines if machine.name == name), None)
