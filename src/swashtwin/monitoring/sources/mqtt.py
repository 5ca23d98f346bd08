"""Recordings from an MQTT broker: each message is acknowledged once it is on the disk, and not
before.

The session is persistent and the quality of service 1: the broker keeps what comes while the watch
is away, and sends again what it did not acknowledge. paho is used directly, since aiomqtt 2
acknowledges a message before it is handed over.

A message is a line of JSON, then samples or a whole file. The line states ``rate``, ``unit``,
``channels`` (a list of names), ``type`` and what else is known by the names of `FACTS`.
Little-endian samples of that type follow, all channels of the first instant, then of the second.
Where the line states ``file``, a name such as ``"a.wav"``, the bytes of such a file follow instead.
"""

import json
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swashtwin.foundation import (
    DataError,
    InputError,
    parse_quantity,
    plural,
    require_modules,
    safe_file_name,
)
from swashtwin.monitoring.config.settings import Broker, MqttSource
from swashtwin.monitoring.sources.delivery import (
    LARGEST,
    TYPES,
    Accept,
    Delivery,
    RejectionError,
    channel_names,
    check_facts,
    entry_facts,
)
from swashtwin.monitoring.status import SourceStatus
from swashtwin.recordings import RawFile, ReadOptions, Recording, resolve_scaling

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage


SAMPLES = ".f32"
"""Suffix of the samples of a message in the spool."""
_LONGEST_HEADER = 1 << 16


def read_message(
    payload: bytes, source: str, received: datetime, machine: str | None
) -> tuple[Delivery, bytes]:
    """(what the message says of its recording, the content behind its first line).

    A message that cannot be one is a delivery with its `problem`, and its payload as content; of
    one that is too large the beginning.

    Parameters
    ----------
    machine : machine that the topic or the configuration names, where the message does not.
    """
    if len(payload) > LARGEST:
        problem = f"a message has {len(payload)} bytes; at most {LARGEST} are taken: send shorter recordings."
        return Delivery(source, "message.bin", received, machine, {}, problem=problem), payload[
            :_LONGEST_HEADER
        ]
    try:
        header, content = _header(payload)
        stated = header.pop("machine", machine)
        if stated is not None and not (isinstance(stated, str) and stated):
            raise InputError('machine must be text, such as "pump-1".')
        name = header.pop("file", None)
        if name is not None and not isinstance(name, str):
            raise InputError('file must be text, such as "a.wav".')
        for key in ("channels", "sensitivity"):
            if isinstance(texts := header.get(key), list):
                header[key] = ",".join(map(str, texts))
        if type(count := header.get("count")) is int:
            header["count"] = str(count)
        facts = check_facts(header)
        if name is None and (
            missing := [key for key in ("rate", "unit", "channels", "type") if key not in facts]
        ):
            raise InputError(f"its first line states no {missing[0]}.")
    except (InputError, DataError) as cause:
        return Delivery(
            source, "message.bin", received, machine, {}, problem=f"a message is broken: {cause}"
        ), payload
    return Delivery(source, name or f"message{SAMPLES}", received, stated, facts), content


def _header(payload: bytes) -> tuple[dict[str, Any], bytes]:
    end = payload.find(b"\n", 0, _LONGEST_HEADER)
    if end < 0:
        raise InputError("it has no line of JSON before its samples.")
    try:
        header = json.loads(payload[:end].decode("utf-8"))
    except (ValueError, RecursionError):
        raise InputError("its first line is no JSON.") from None
    if not isinstance(header, dict):
        raise InputError("its first line is no JSON object.")
    return header, payload[end + 1 :]


def samples_recording(
    path: Path, facts: Mapping[str, str], name: str, options: ReadOptions
) -> Recording:
    """The recording of a message's samples, in the spool at `path`.

    Parameters
    ----------
    options : what the configuration says of the machine's recordings; the message comes first.

    Raises
    ------
    UnfitError
        The samples are no whole number of instants, or not as many as stated.
    DataError
        The unit and the sensitivity do not fit.
    """
    channels, kind, data = channel_names(facts["channels"]), facts["type"], path.read_bytes()
    size = np.dtype(TYPES[kind]).itemsize
    if not channels or not data or len(data) % (size * len(channels)):
        raise RejectionError(
            "broken",
            f"{len(data)} bytes are no whole number of {kind} samples of {plural(len(channels), 'channel')}.",
        )
    samples = np.frombuffer(data, TYPES[kind]).reshape(-1, len(channels)).T
    if "count" in facts and samples.shape[1] != int(facts["count"]):
        raise RejectionError(
            "broken",
            f"it has {samples.shape[1]} {kind} samples of each channel, not {facts['count']}.",
        )
    raw = RawFile(
        dict(zip(channels, samples, strict=True)), units=dict.fromkeys(channels, facts["unit"])
    )
    sensitivity = entry_facts(facts).get("sensitivity", options.sensitivity)
    factors, unit = resolve_scaling(
        raw, replace(options, sensitivity=sensitivity), channels, "the message"
    )
    scaled = samples * np.array(factors)[:, None]
    return Recording(
        scaled,
        parse_quantity(facts["rate"], "Hz", name="rate"),
        name,
        channels=tuple(channels),
        unit=unit,
    )


_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 10.0
"""Seconds before another attempt to connect; each is twice the one before."""
_KEEPALIVE = 30
_FOREVER = 0xFFFFFFFF
"""Seconds for which the broker keeps the session: no end."""
_LARGEST_PACKET = 4 * LARGEST - 1
"""Bytes of a message that the broker may send, the most that MQTT allows: what is above `LARGEST`
is filed as broken, since a broker that may not send a message says so to nobody.
"""
_IN_FLIGHT = 4
"""Messages that the broker sends before one is acknowledged; with their size the bound of
memory.
"""


class MqttWatch:
    """Takes the messages of one subscription."""

    def __init__(self, source: MqttSource, accept: Accept, client: str) -> None:
        """Watch `source`; `client` names the session where the configuration does not.

        Raises
        ------
        MissingExtraError
            paho-mqtt is not installed.
        """
        self.status = SourceStatus(source.name, source.kind)
        self._source = source
        self._accept = accept
        self._session = source.client or f"{client}-{safe_file_name(source.name)}"
        self._client = broker_client(source, self._session, manual_ack=True)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_message = self._on_message

    def run(self, stop: threading.Event) -> None:
        """Stay connected until `stop` is set."""
        from paho.mqtt.packettypes import PacketTypes
        from paho.mqtt.properties import Properties

        properties = Properties(PacketTypes.CONNECT)
        properties.SessionExpiryInterval = _FOREVER
        properties.MaximumPacketSize = _LARGEST_PACKET
        properties.ReceiveMaximum = _IN_FLIGHT
        client = self._client
        threading.Thread(target=lambda: stop.wait() and client.disconnect(), daemon=True).start()
        pause = _FIRST_PAUSE
        while not stop.is_set():
            began = time.monotonic()
            try:
                client.connect(
                    self._source.host,
                    self._source.port,
                    _KEEPALIVE,
                    clean_start=False,
                    properties=properties,
                )
                client.loop_forever(retry_first_connection=False)
            except (OSError, ValueError) as cause:
                self._fail(str(cause))
            else:
                if not stop.is_set() and self.status.problem is None:
                    self._fail("the connection was lost")
            pause = (
                _FIRST_PAUSE
                if time.monotonic() - began > _LONGEST_PAUSE
                else min(2 * pause, _LONGEST_PAUSE)
            )
            stop.wait(pause)

    def _fail(self, reason: str) -> None:
        self.status.fail(f"broker {self._source.host}:{self._source.port}: {reason}")

    def _on_connect(self, client: "Client", _: Any, __: Any, reason: Any, ___: Any) -> None:
        from paho.mqtt.subscribeoptions import SubscribeOptions

        if reason.is_failure:
            self._fail(f"refused the connection ({reason})")
            return
        topic = (
            self._source.topic
            if self._source.group is None
            else f"$share/{self._source.group}/{self._source.topic}"
        )
        # A retained message comes with the first subscription only, not with each connection.
        client.subscribe(
            topic,
            options=SubscribeOptions(qos=1, retainHandling=SubscribeOptions.RETAIN_SEND_IF_NEW_SUB),
        )

    def _on_subscribe(
        self, client: "Client", _: Any, __: Any, reasons: list[Any], ___: Any
    ) -> None:
        if any(reason.is_failure for reason in reasons):
            self._fail(f"refused the subscription of {self._source.topic} ({reasons[0]})")
            client.disconnect()
        else:
            self.status.succeed()

    def _on_message(self, client: "Client", _: Any, message: "MQTTMessage") -> None:
        machine = self._source.machine or _machine_of(self._source.topic, message.topic)
        delivery, content = read_message(
            bytes(message.payload), self._source.name, datetime.now(UTC), machine
        )
        try:
            self._accept(delivery, content)
        except (
            OSError
        ) as cause:  # not acknowledged: the broker sends it again on the next connection
            self.status.fail(cause.strerror or str(cause))
            client.disconnect()
            return
        client.ack(message.mid, message.qos)
        self.status.succeed(1)


def broker_client(broker: Broker, name: str = "", *, manual_ack: bool = False) -> "Client":
    """A client that may log in to a broker, not connected yet.

    Raises
    ------
    MissingExtraError
        paho-mqtt is not installed.
    """
    require_modules("paho", extra="mqtt", need="MQTT")
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

    client = Client(
        CallbackAPIVersion.VERSION2,
        name,
        protocol=MQTTProtocolVersion.MQTTv5,
        reconnect_on_failure=False,
        manual_ack=manual_ack,
    )
    if broker.user is not None:
        client.username_pw_set(broker.user, broker.password.reveal() or None)
    if broker.tls:
        client.tls_set(None if broker.ca is None else str(broker.ca))
    return client


def _machine_of(subscription: str, topic: str) -> str | None:
    """Level of a topic that the first ``+`` of the subscription stands for.

    Examples
    --------
    >>> _machine_of("plant/+/vibration", "plant/pump-1/vibration")
    'pump-1'
    """
    levels = subscription.split("/")
    return topic.split("/")[levels.index("+")] if "+" in levels else None
