"""What is told of an alarm, and where it goes: a log, a webhook, an MQTT broker, e-mail. Each is
bounded in time.
"""

import contextlib
import http.client
import json
import math
import re
import smtplib
import socket
import ssl
import threading
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from email.message import EmailMessage
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, unquote, urlsplit

from swashtwin.foundation import SwashTwinError, escape_controls
from swashtwin.monitoring.config.settings import (
    Channel,
    EmailChannel,
    LogChannel,
    MqttChannel,
    WebhookChannel,
)
from swashtwin.monitoring.sources.mqtt import broker_client

TIMEOUT = 10.0
"""Time for one message [s]."""


@dataclass(frozen=True)
class AlarmMessage:
    """One message; a receiver that gets it twice sees so by its `identity`."""

    machine: str
    """Name of the machine."""
    point: str
    """Name of the operating point."""
    kind: str
    """Alarm of the ``pump`` or of a ``sensor``."""
    event: str
    """What happened to the alarm: ``opened``, ``measured`` (the severity of its suspect),
    ``cleared``, ``closed``.
    """
    time: str
    """When, ISO 8601 in UTC."""
    identity: str
    """Unique for each message, such as ``alarm-17-opened``."""
    reasons: Sequence[str] = ()
    """What moved or what is wrong, in sentences."""
    link: str | None = None
    """Address of the alarm on the page."""

    @property
    def title(self) -> str:
        """The message in a few words, on one line.

        Examples
        --------
        >>> AlarmMessage("pump-1", "860 rpm, 10 MPa", "pump", "opened", "2026-01-02T03:04:05+00:00", "1").title
        'pump-1: pump alarm opened (860 rpm, 10 MPa)'
        """
        return escape_controls(f"{self.machine}: {self.kind} alarm {self.event} ({self.point})")

    def to_json(self) -> str:
        """All of it, with its title."""
        return json.dumps({**asdict(self), "title": self.title}, ensure_ascii=False)


class ChannelError(SwashTwinError):
    """A message could not be handed over; it may be sent again."""


class _RefusedError(Exception):
    """Why a server did not take a message, in words that hold no secret."""


def send(
    message: AlarmMessage, channel: Channel, *, folder: Path, timeout: float = TIMEOUT
) -> None:
    """Hand a message to a channel, and return when its server has it.

    Parameters
    ----------
    folder : of the watch, where a log without a path of its own lies.
    timeout : time for connecting, and for all that follows [s].

    Raises
    ------
    ChannelError
        It could not be handed over; the message is one line and holds no secret.
    """
    try:
        match channel:
            case LogChannel():
                line = " ".join(
                    [message.time, f"{message.title}.", *message.reasons, message.link or ""]
                ).rstrip()
                with (channel.path or folder / "alarms.log").open("a", encoding="utf-8") as file:
                    file.write(escape_controls(line) + "\n")
            case WebhookChannel():
                _post(message, channel, timeout)
            case MqttChannel():
                _publish(message, channel, timeout)
            case EmailChannel():
                _mail(message, channel, timeout)
    except (
        OSError,
        smtplib.SMTPException,
        http.client.HTTPException,
        ValueError,
        IndexError,
        _RefusedError,
    ) as cause:
        raise ChannelError(
            f"channel {channel.name!r} ({channel.kind}): {_reason(cause, timeout)}."
        ) from cause


def _reason(cause: Exception, timeout: float) -> str:
    """What went wrong, in one line without what was sent."""
    if isinstance(cause, (_RefusedError, smtplib.SMTPNotSupportedError)):
        return escape_controls(str(cause)).rstrip(".")
    if isinstance(cause, smtplib.SMTPRecipientsRefused):
        return "the server refused every recipient"
    if isinstance(cause, smtplib.SMTPResponseException):
        answer = (
            cause.smtp_error.decode(errors="replace")
            if isinstance(cause.smtp_error, bytes)
            else cause.smtp_error
        )
        return escape_controls(f"the server answers {cause.smtp_code} {answer}".rstrip(". "))
    if TimeoutError in (type(cause), type(cause.__context__)):
        return f"no answer within {timeout:g} s"
    if isinstance(cause, ssl.SSLError):
        return f"TLS fails: {cause.reason or type(cause).__name__}"
    if isinstance(cause, OSError) and cause.strerror:
        return cause.strerror
    if isinstance(cause, (http.client.HTTPException, smtplib.SMTPException)):
        return f"the server does not speak the protocol, or hung up ({type(cause).__name__})"
    return f"a setting cannot be used ({type(cause).__name__})"  # its text may hold a token


@contextlib.contextmanager
def _deadline(timeout: float, current: Callable[[], socket.socket | None]) -> Iterator[None]:
    """Cut a connection after `timeout`, however slowly its server goes on answering."""
    is_late = threading.Event()

    def cut() -> None:
        is_late.set()
        if (connection := current()) is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(timeout, cut)
    timer.daemon = True
    timer.start()
    try:
        yield
    except (OSError, http.client.HTTPException, smtplib.SMTPException) as cause:
        if is_late.is_set():
            raise TimeoutError from cause
        raise
    finally:
        timer.cancel()


def _post(message: AlarmMessage, channel: WebhookChannel, timeout: float) -> None:
    url = urlsplit(channel.url.reveal())
    if url.scheme not in ("http", "https") or not url.hostname:
        raise _RefusedError("its URL is no http:// or https:// address")
    kind = http.client.HTTPSConnection if url.scheme == "https" else http.client.HTTPConnection
    connection = kind(url.hostname, url.port, timeout=timeout)
    headers = {
        "Content-Type": "application/json",
        "User-Agent": "swashtwin",
        **_login(url, channel),
    }
    with contextlib.closing(connection), _deadline(timeout, lambda: connection.sock):
        connection.request(
            "POST",
            (url.path or "/") + (f"?{url.query}" if url.query else ""),
            message.to_json().encode(),
            headers,
        )
        status = connection.getresponse().status
    if not 200 <= status < 300:
        raise _RefusedError(f"the server answers {status}")


def _login(url: SplitResult, channel: WebhookChannel) -> dict[str, str]:
    if channel.token:
        return {"Authorization": f"Bearer {channel.token.reveal()}"}
    if url.username is None:
        return {}
    pair = f"{unquote(url.username)}:{unquote(url.password or '')}"
    return {"Authorization": f"Basic {b64encode(pair.encode()).decode()}"}


def _publish(message: AlarmMessage, channel: MqttChannel, timeout: float) -> None:
    client = broker_client(channel)
    client.connect_timeout = timeout
    answered, refusals = threading.Event(), []

    def on_connect(_: Any, __: Any, ___: Any, reason: Any, ____: Any) -> None:
        if reason.is_failure:
            refusals.append(f"the broker refuses the connection ({reason})")
        answered.set()

    client.on_connect = on_connect
    client.connect(channel.host, channel.port, keepalive=max(math.ceil(timeout), 1))
    client.loop_start()
    try:
        if not answered.wait(timeout):
            raise TimeoutError
        if refusals:
            raise _RefusedError(refusals[0])
        handed_over = client.publish(channel.topic, message.to_json(), qos=1)
        handed_over.wait_for_publish(timeout)
        if not handed_over.is_published():
            raise TimeoutError
    except RuntimeError as cause:
        raise _RefusedError("the broker closed the connection") from cause
    finally:
        client.disconnect()
        client.loop_stop()


def _mail(message: AlarmMessage, channel: EmailChannel, timeout: float) -> None:
    mail = EmailMessage()
    mail["Subject"] = message.title
    mail["From"] = channel.sender
    mail["To"] = ", ".join(channel.recipients)
    reference = re.sub(r"[^\w.-]", "-", message.identity, flags=re.ASCII)
    mail["Message-ID"] = f"<{reference}@swashtwin>"
    lines = [
        message.title,
        f"Time: {message.time}",
        *(f"- {reason}" for reason in message.reasons),
        message.link or "",
    ]
    mail.set_content("\n".join(escape_controls(line) for line in lines if line) + "\n")
    trusted = ssl.create_default_context()
    server = (
        smtplib.SMTP_SSL(channel.host, channel.port, timeout=timeout, context=trusted)
        if channel.tls == "tls"
        else smtplib.SMTP(channel.host, channel.port, timeout=timeout)
    )
    with contextlib.closing(server), _deadline(timeout, lambda: server.sock):
        if channel.tls == "starttls":
            server.starttls(context=trusted)
        if channel.user is not None:
            server.login(channel.user, channel.password.reveal())
        server.send_message(mail)
