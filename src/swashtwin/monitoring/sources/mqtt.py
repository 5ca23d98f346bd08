"""Recordings from an MQTT broker: each message is acknowledged once it is on the disk, and not before.

The session is persistent and the quality of service 1: the broker keeps what comes while the watch is away, and sends
again what it did not acknowledge. paho is used directly, since aiomqtt 2 acknowledges a message before it is handed
over.
"""

import threading
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import MissingExtraError, file_name
from swashtwin.monitoring.config.settings import Broker, MqttSource
from swashtwin.monitoring.sources.delivery import LARGEST, Accept, Standing
from swashtwin.monitoring.sources.message import read_message

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 10.0
"""Seconds before another attempt to connect; each is twice the one before."""
_KEEPALIVE = 30
_FOREVER = 0xFFFFFFFF
"""Seconds for which the broker keeps the session: no end."""
_LARGEST_PACKET = 4 * LARGEST - 1
"""Bytes of a message that the broker may send, the most that MQTT allows: what is above `LARGEST` is filed as broken,
since a broker that may not send a message says so to nobody."""
_IN_FLIGHT = 4
"""Messages that the broker sends before one is acknowledged; with their size the bound of memory."""


class MqttWatch:
    """Takes the messages of one subscription."""

    def __init__(self, source: MqttSource, accept: Accept, client: str) -> None:
        """Watch `source`; `client` names the session where the configuration does not.

        Raises
        ------
        MissingExtraError
            paho-mqtt is not installed.
        """
        self.standing = Standing(source.name, source.kind)
        self._source = source
        self._accept = accept
        self._session = source.client or f"{client}-{file_name(source.name)}"
        self._client = broker_client(source, self._session, manual_ack=True)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_message = self._on_message

    def run(self, stop: threading.Event) -> None:
        """Stay connected until `stop` is set."""
        client = self._client
        threading.Thread(target=self._disconnect, args=(client, stop), daemon=True).start()
        pause = _FIRST_PAUSE
        while not stop.is_set():
            began = time.monotonic()
            try:
                host, port, properties = self._source.host, self._source.port, _session_properties()
                client.connect(host, port, _KEEPALIVE, clean_start=False, properties=properties)
                client.loop_forever(retry_first_connection=False)
            except (OSError, ValueError) as cause:
                self._fail(str(cause))
            else:
                if not stop.is_set() and self.standing.problem is None:
                    self._fail("the connection was lost")
            pause = _FIRST_PAUSE if time.monotonic() - began > _LONGEST_PAUSE else min(2 * pause, _LONGEST_PAUSE)
            stop.wait(pause)

    @staticmethod
    def _disconnect(client: "Client", stop: threading.Event) -> None:
        stop.wait()
        client.disconnect()

    def _fail(self, reason: str) -> None:
        self.standing.fail(f"broker {self._source.host}:{self._source.port}: {reason}")

    def _on_connect(self, client: "Client", _: Any, __: Any, reason: Any, ___: Any) -> None:
        from paho.mqtt.subscribeoptions import SubscribeOptions

        if reason.is_failure:
            self._fail(f"refused the connection ({reason})")
            return
        topic = (
            self._source.topic if self._source.group is None else f"$share/{self._source.group}/{self._source.topic}"
        )
        # A retained message comes with the first subscription only, not with each connection.
        client.subscribe(topic, options=SubscribeOptions(qos=1, retainHandling=SubscribeOptions.RETAIN_SEND_IF_NEW_SUB))

    def _on_subscribe(self, client: "Client", _: Any, __: Any, reasons: list[Any], ___: Any) -> None:
        if any(reason.is_failure for reason in reasons):
            self._fail(f"refused the subscription of {self._source.topic} ({reasons[0]})")
            client.disconnect()
        else:
            self.standing.succeed()

    def _on_message(self, client: "Client", _: Any, message: "MQTTMessage") -> None:
        machine = self._source.machine or _machine_of(self._source.topic, message.topic)
        delivery, content = read_message(bytes(message.payload), self._source.name, datetime.now(UTC), machine)
        try:
            self._accept(delivery, content)
        except OSError as cause:  # not acknowledged: the broker sends it again on the next connection
            self.standing.fail(cause.strerror or str(cause))
            client.disconnect()
            return
        client.ack(message.mid, message.qos)
        self.standing.succeed(1)


def broker_client(broker: Broker, name: str = "", *, manual_ack: bool = False) -> "Client":
    """A client that may log in to a broker, not connected yet.

    Raises
    ------
    MissingExtraError
        paho-mqtt is not installed.
    """
    try:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
    except ImportError as cause:
        raise MissingExtraError(
            "mqtt needs paho-mqtt, which is not installed: pip install 'swashtwin[mqtt]'."
        ) from cause
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


def _session_properties() -> Any:
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    properties = Properties(PacketTypes.CONNECT)
    properties.SessionExpiryInterval = _FOREVER
    properties.MaximumPacketSize = _LARGEST_PACKET
    properties.ReceiveMaximum = _IN_FLIGHT
    return properties


def _machine_of(subscription: str, topic: str) -> str | None:
    """Level of a topic that the first ``+`` of the subscription stands for.

    Examples
    --------
    >>> _machine_of("plant/+/vibration", "plant/pump-1/vibration")
    'pump-1'
    """
    levels = subscription.split("/")
    return topic.split("/")[levels.index("+")] if "+" in levels else None
