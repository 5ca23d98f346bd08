"""Messages about alarms, and their channels: a log, a webhook, an MQTT broker, e-mail.

Each attempt is bounded in time.
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

TIMEOUT_S = 10.0
"""Time limit for connecting, and for everything that follows, of one message."""


@dataclass(frozen=True)
class AlarmMessage:
    """One message; a receiver recognizes a repeated one by its `identity`."""

    machine: str
    """Name of the machine."""
    point: str
    """Name of the operating point."""
    kind: str
    """Alarm of the ``pump``, of a ``sensor`` or of the ``delivery`` of recordings."""
    event: str
    """What happened to the alarm: ``opened``, ``measured`` (the severity of its suspect),
    ``cleared`` or ``closed``.
    """
    time: str
    """Time of the event, ISO 8601 in UTC."""
    identity: str
    """Unique for each message, such as ``alarm-17-opened``."""
    reasons: Sequence[str] = ()
    """What changed or what is wrong, in sentences."""
    link: str | None = None
    """Address of the alarm on the page."""

    @property
    def title(self) -> str:
        """The message in a few words, on one line.

        Examples
        --------
        >>> time = "2026-01-02T03:04:05+00:00"
        >>> AlarmMessage("pump-1", "860 rpm, 10 MPa", "pump", "opened", time, "1").title
        'pump-1: pump alarm opened (860 rpm, 10 MPa)'
        """
        return escape_controls(f"{self.machine}: {self.kind} alarm {self.event} ({self.point})")

    def to_json(self) -> str:
        """Return the whole message with its title."""
        return json.dumps({**asdict(self), "title": self.title}, ensure_ascii=False)


class ChannelError(SwashTwinError):
    """A message could not be delivered; it may be sent again."""


class _RefusedError(Exception):
    """Why a server did not accept a message, in words without a secret."""


def send(
    message: AlarmMessage, channel: Channel, *, folder: Path, timeout: float = TIMEOUT_S
) -> None:
    """Send a message to a channel, and return when its server has accepted it.

    Parameters
    ----------
    folder : folder of the watch, for a log without a path.
    timeout : time limit for connecting, and for everything that follows [s].

    Raises
    ------
    ChannelError
        The message could not be delivered; the error is one line without a secret.
    """
    # Servers may do anything; whatever they do, the message stays in the outbox.
    try:
        match channel:
            case LogChannel():
                _append(message, channel.path or folder / "alarms.log")
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
            f"channel {channel.name!r} ({channel.kind}): {_describe_failure(cause, timeout)}."
        ) from cause


def _describe_failure(cause: Exception, timeout: float) -> str:
    """Return what went wrong, in one line without any part of what was sent."""
    if isinstance(cause, (_RefusedError, smtplib.SMTPNotSupportedError)):
        return escape_controls(str(cause)).rstrip(".")
    if isinstance(cause, smtplib.SMTPRecipientsRefused):
        return "the server refused every recipient"
    if isinstance(cause, smtplib.SMTPResponseException):
        answer = cause.smtp_error
        if isinstance(answer, bytes):
            answer = answer.decode(errors="replace")
        return escape_controls(f"the server answered {cause.smtp_code} {answer}".rstrip(". "))
    if TimeoutError in (type(cause), type(cause.__context__)):
        return f"no answer within {timeout:g} s"
    if isinstance(cause, ssl.SSLError):
        return f"TLS failed: {cause.reason or type(cause).__name__}"
    if isinstance(cause, OSError) and cause.strerror:
        return cause.strerror
    if isinstance(cause, (http.client.HTTPException, smtplib.SMTPException)):
        return (
            "the server does not use the protocol, or closed the connection "
            f"({type(cause).__name__})"
        )
    # The text of such an error may contain a token.
    return f"a setting is invalid ({type(cause).__name__})"


@contextlib.contextmanager
def _deadline(
    timeout: float, current_connection: Callable[[], socket.socket | None]
) -> Iterator[None]:
    """Close a connection after `timeout`.

    The timeout of a socket is not enough: a server that answers byte by byte restarts it each time.
    """
    is_late = threading.Event()

    def close() -> None:
        is_late.set()
        connection = current_connection()
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(timeout, close)
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


def _append(message: AlarmMessage, path: Path) -> None:
    parts = [message.time, f"{message.title}.", *message.reasons, message.link or ""]
    line = escape_controls(" ".join(parts).rstrip())
    with path.open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def _post(message: AlarmMessage, channel: WebhookChannel, timeout: float) -> None:
    url = urlsplit(channel.url.reveal())
    if url.scheme not in ("http", "https") or not url.hostname:
        raise _RefusedError("its URL must begin with http:// or https://")

    connection_type: type[http.client.HTTPConnection] = http.client.HTTPConnection
    if url.scheme == "https":
        connection_type = http.client.HTTPSConnection
    connection = connection_type(url.hostname, url.port, timeout=timeout)

    address = url.path or "/"
    if url.query:
        address += f"?{url.query}"
    headers = {
        "Content-Type": "application/json",
        "User-Agent": "swashtwin",
        **_login_header(url, channel),
    }
    with contextlib.closing(connection), _deadline(timeout, lambda: connection.sock):
        connection.request("POST", address, message.to_json().encode(), headers)
        status = connection.getresponse().status
    if not 200 <= status < 300:
        raise _RefusedError(f"the server answered {status}")


def _login_header(url: SplitResult, channel: WebhookChannel) -> dict[str, str]:
    if channel.token:
        return {"Authorization": f"Bearer {channel.token.reveal()}"}
    if url.username is None:
        return {}
    credentials = f"{unquote(url.username)}:{unquote(url.password or '')}"
    return {"Authorization": f"Basic {b64encode(credentials.encode()).decode()}"}


def _publish(message: AlarmMessage, channel: MqttChannel, timeout: float) -> None:
    # A client without a name gets no session: nothing is kept for it after it disconnects.
    client = broker_client(channel)
    client.connect_timeout = timeout
    has_answered = threading.Event()
    refusals = []

    def on_connect(_: Any, __: Any, ___: Any, reason: Any, ____: Any) -> None:
        if reason.is_failure:
            refusals.append(f"the broker refused the connection ({reason})")
        has_answered.set()

    client.on_connect = on_connect
    client.connect(channel.host, channel.port, keepalive=max(math.ceil(timeout), 1))
    client.loop_start()
    try:
        if not has_answered.wait(timeout):
            raise TimeoutError
        if refusals:
            raise _RefusedError(refusals[0])

        publication = client.publish(channel.topic, message.to_json(), qos=1)
        publication.wait_for_publish(timeout)
        if not publication.is_published():
            raise TimeoutError
    except RuntimeError as cause:
        raise _RefusedError("the broker closed the connection") from cause
    finally:
        client.disconnect()
        client.loop_stop()


def _mail(message: AlarmMessage, channel: EmailChannel, timeout: float) -> None:
    mail = _compose_mail(message, channel)

    tls = ssl.create_default_context()
    server: smtplib.SMTP
    if channel.tls == "tls":
        server = smtplib.SMTP_SSL(channel.host, channel.port, timeout=timeout, context=tls)
    else:
        server = smtplib.SMTP(channel.host, channel.port, timeout=timeout)

    with contextlib.closing(server), _deadline(timeout, lambda: server.sock):
        if channel.tls == "starttls":
            server.starttls(context=tls)
        if channel.user is not None:
            server.login(channel.user, channel.password.reveal())
        server.send_message(mail)


def _compose_mail(message: AlarmMessage, channel: EmailChannel) -> EmailMessage:
    mail = EmailMessage()
    mail["Subject"] = message.title
    mail["From"] = channel.sender
    mail["To"] = ", ".join(channel.recipients)
    # The same identifier for a repeated message, so that mail programs show it once.
    identifier = re.sub(r"[^\w.-]", "-", message.identity, flags=re.ASCII)
    mail["Message-ID"] = f"<{identifier}@swashtwin>"

    lines = [message.title, f"Time: {message.time}"]
    lines += [f"- {reason}" for reason in message.reasons]
    if message.link:
        lines.append(message.link)
    mail.set_content("\n".join(escape_controls(line) for line in lines) + "\n")
    return mail
