"""Recordings from an MQTT broker: each message is acknowledged once it is on the disk, and not
before.

The session is persistent and the quality of service 1: the broker keeps what arrives while the
watch does not run, and sends again what was not acknowledged. paho is used directly because
aiomqtt 2 acknowledges a message before it is handed over.
"""

import threading
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import require_modules, safe_file_name
from swashtwin.monitoring.config.settings import Broker, MqttSource
from swashtwin.monitoring.sources.delivery import MAX_RECORDING_BYTES, Accept
from swashtwin.monitoring.sources.message_format import read_message
from swashtwin.monitoring.status import SourceStatus

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

FIRST_PAUSE_S = 0.5
"""Time before the second attempt to connect; each further pause is twice the previous one."""
MAX_PAUSE_S = 10.0
"""Longest pause between two attempts."""
KEEPALIVE_S = 30
"""Time after which the broker is asked whether it is still there."""
SESSION_EXPIRY_S = 0xFFFFFFFF
"""Time for which the broker keeps the session; this number stands for "never expires" in MQTT 5."""
MAX_PACKET_BYTES = 4 * MAX_RECORDING_BYTES - 1
"""Bytes of a message that the broker may send; MQTT allows no more.

A message above `MAX_RECORDING_BYTES` is received and rejected, since a broker drops a message that
it may not send without reporting it.
"""
MAX_IN_FLIGHT = 4
"""Messages that the broker sends before one is acknowledged; with their size it bounds memory."""


class MqttWatch:
    """Takes the messages of one subscription."""

    def __init__(self, source: MqttSource, accept: Accept, client: str) -> None:
        """Watch `source`; `client` names the session if the configuration does not.

        Raises
        ------
        MissingExtraError
            paho-mqtt is not installed.
        """
        self.status = SourceStatus(source.name, source.kind)
        self._source = source
        self._accept = accept
        session_name = source.client or f"{client}-{safe_file_name(source.name)}"
        self._client = broker_client(source, session_name, manual_ack=True)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_message = self._on_message

    def run(self, stop: threading.Event) -> None:
        """Stay connected until `stop` is set."""
        threading.Thread(target=self._disconnect_at, args=(stop,), daemon=True).start()

        pause = FIRST_PAUSE_S
        while not stop.is_set():
            start = time.monotonic()
            try:
                self._connect()
                self._client.loop_forever(retry_first_connection=False)
            except (OSError, ValueError) as cause:
                self._fail(str(cause))
            else:
                # A failure that a callback reported says more than the end of the connection.
                if not stop.is_set() and self.status.problem is None:
                    self._fail("the connection was lost")

            pause = min(2 * pause, MAX_PAUSE_S)
            if time.monotonic() - start > MAX_PAUSE_S:  # the connection has worked
                pause = FIRST_PAUSE_S
            stop.wait(pause)

    def _disconnect_at(self, stop: threading.Event) -> None:
        stop.wait()
        self._client.disconnect()

    def _connect(self) -> None:
        from paho.mqtt.packettypes import PacketTypes
        from paho.mqtt.properties import Properties

        properties = Properties(PacketTypes.CONNECT)
        properties.SessionExpiryInterval = SESSION_EXPIRY_S
        properties.MaximumPacketSize = MAX_PACKET_BYTES
        properties.ReceiveMaximum = MAX_IN_FLIGHT
        self._client.connect(
            self._source.host,
            self._source.port,
            KEEPALIVE_S,
            clean_start=False,
            properties=properties,
        )

    def _fail(self, reason: str) -> None:
        self.status.fail(f"broker {self._source.host}:{self._source.port}: {reason}")

    def _on_connect(self, client: "Client", _: Any, __: Any, reason: Any, ___: Any) -> None:
        from paho.mqtt.subscribeoptions import SubscribeOptions

        if reason.is_failure:
            self._fail(f"refused the connection ({reason})")
            return

        topic = self._source.topic
        if self._source.group is not None:
            topic = f"$share/{self._source.group}/{topic}"
        # A retained message comes with the first subscription only, not with each connection.
        options = SubscribeOptions(qos=1, retainHandling=SubscribeOptions.RETAIN_SEND_IF_NEW_SUB)
        client.subscribe(topic, options=options)

    def _on_subscribe(
        self, client: "Client", _: Any, __: Any, reasons: list[Any], ___: Any
    ) -> None:
        if any(reason.is_failure for reason in reasons):
            self._fail(f"refused the subscription to {self._source.topic} ({reasons[0]})")
            client.disconnect()
        else:
            self.status.succeed()

    def _on_message(self, client: "Client", _: Any, message: "MQTTMessage") -> None:
        machine = self._source.machine or _machine_of_topic(self._source.topic, message.topic)
        delivery, content = read_message(
            bytes(message.payload), self._source.name, datetime.now(UTC), machine
        )
        try:
            self._accept(delivery, content)
        except OSError as cause:
            # Without an acknowledgment the broker sends the message again on the next connection.
            self.status.fail(cause.strerror or str(cause))
            client.disconnect()
            return

        client.ack(message.mid, message.qos)
        self.status.succeed(1)


def broker_client(broker: Broker, name: str = "", *, manual_ack: bool = False) -> "Client":
    """Return a client that can log in to a broker; it is not connected yet.

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
        ca_file = None  # those of the system
        if broker.ca is not None:
            ca_file = str(broker.ca)
        client.tls_set(ca_file)
    return client


def _machine_of_topic(subscription: str, topic: str) -> str | None:
    """Return the part of a topic that stands for the first ``+`` of the subscription.

    Examples
    --------
    >>> _machine_of_topic("plant/+/vibration", "plant/pump-1/vibration")
    'pump-1'
    """
    subscription_parts = subscription.split("/")
    if "+" not in subscription_parts:
        return None
    return topic.split("/")[subscription_parts.index("+")]
