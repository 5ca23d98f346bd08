"""Messages reach real servers; a server that refuses, stays silent or dawdles is an error.

The error is one line and comes in time.
"""

import json
import socket
import socketserver
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from email import message_from_bytes, policy
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from mqtt_broker import Broker, free_port

from swashtwin.monitoring.alarms.channels import AlarmMessage, ChannelError, send
from swashtwin.monitoring.config.settings import (
    EmailChannel,
    LogChannel,
    MqttChannel,
    Secret,
    WebhookChannel,
)

MESSAGE = AlarmMessage(
    "pump-1",
    "860 rpm, 10 MPa",
    "pump",
    "opened",
    "2026-01-02T03:04:05+00:00",
    "alarm-17-opened",
    ("+9.1 dB at shaft order 9 (129 Hz), channel cover_z",),
    "http://127.0.0.1:8642/alarms/17",
)


@contextmanager
def serving(server: socketserver.BaseServer) -> Iterator[int]:
    """Yield the port of a server that runs until the end of the block."""
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()
        thread.join(5)


class MailServer(socketserver.ThreadingTCPServer):
    """Takes mail by SMTP, as much as a test needs of it."""

    daemon_threads = True

    def __init__(self, *, refuse: str = "") -> None:
        super().__init__(("127.0.0.1", 0), MailHandler)
        self.refuse = refuse
        self.mails: list[bytes] = []


class MailHandler(socketserver.StreamRequestHandler):
    """One connection."""

    server: MailServer

    def handle(self) -> None:
        self.wfile.write(b"220 stub\r\n")
        while line := self.rfile.readline():
            command = line[:4].decode().upper()
            if command == self.server.refuse:
                self.wfile.write(b"550 not here\r\n")
            elif command == "DATA":
                self.wfile.write(b"354 go on\r\n")
                lines = iter(self.rfile.readline, b".\r\n")
                self.server.mails.append(b"".join(lines))
                self.wfile.write(b"250 taken\r\n")
            else:
                self.wfile.write(b"221 bye\r\n" if command == "QUIT" else b"250 ok\r\n")


class HookHandler(BaseHTTPRequestHandler):
    """Keeps what is posted."""

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.posts.append((self.path, dict(self.headers), body))  # type: ignore[attr-defined]
        self.send_response(self.server.status)  # type: ignore[attr-defined]
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Nothing."""


def hook_server(status: int = 204) -> ThreadingHTTPServer:
    """Return a web server that answers every post with one status."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), HookHandler)
    server.posts = []  # type: ignore[attr-defined]
    server.status = status  # type: ignore[attr-defined]
    return server


def mail_channel(port: int, **settings: Any) -> EmailChannel:
    """Return a channel of unencrypted mail to a server at a port."""
    facts = {
        "name": "mail",
        "host": "127.0.0.1",
        "sender": "a@b.c",
        "recipients": ("d@e.f",),
        "tls": "none",
    }
    return EmailChannel(port=port, **{**facts, **settings})


class DawdlingHandler(socketserver.StreamRequestHandler):
    """Sends one character of a header every 50 ms, without end."""

    def handle(self) -> None:
        try:
            while True:
                self.wfile.write(b"x")
                time.sleep(0.05)
        except OSError:
            pass


def test_a_log_gets_one_line_for_each_message_even_if_a_name_has_control_characters(
    tmp_path: Path,
) -> None:
    channel = LogChannel(name="log")
    hostile = AlarmMessage("a\nb\x1b[2J", "any", "sensor", "cleared", "now", "2")

    send(MESSAGE, channel, folder=tmp_path)
    send(hostile, channel, folder=tmp_path)

    lines = (tmp_path / "alarms.log").read_text(encoding="utf-8").splitlines()
    assert lines == [
        "2026-01-02T03:04:05+00:00 pump-1: pump alarm opened (860 rpm, 10 MPa). "
        "+9.1 dB at shaft order 9 (129 Hz), channel cover_z http://127.0.0.1:8642/alarms/17",
        "now a\\nb\\x1b[2J: sensor alarm cleared (any).",
    ]


def test_a_webhook_gets_the_message_as_json_with_the_token(tmp_path: Path) -> None:
    server = hook_server()
    with serving(server) as port:
        url = Secret(f"http://127.0.0.1:{port}/hook?a=b")
        channel = WebhookChannel(name="hook", url=url, token=Secret("t0ken"))
        send(MESSAGE, channel, folder=tmp_path)

    ((path, headers, body),) = server.posts  # type: ignore[attr-defined]
    assert path == "/hook?a=b"
    assert headers["Authorization"] == "Bearer t0ken"
    assert json.loads(body) == json.loads(json.dumps({**asdict(MESSAGE), "title": MESSAGE.title}))


@pytest.mark.parametrize("status", [302, 500])
def test_a_webhook_that_refuses_the_message_is_an_error_with_its_status_but_no_secret(
    tmp_path: Path, status: int
) -> None:
    with serving(hook_server(status)) as port:
        url = Secret(f"http://u:geheim@127.0.0.1:{port}/")
        for token, reason in ((Secret(""), f"answered {status}"), (Secret("ge\nheim"), "hook")):
            with pytest.raises(ChannelError, match=reason) as error:
                send(MESSAGE, WebhookChannel(name="hook", url=url, token=token), folder=tmp_path)
            assert "heim" not in str(error.value)


def test_a_mail_has_its_subject_reasons_link_and_identity_and_no_forged_header(
    tmp_path: Path,
) -> None:

    server = MailServer()
    with serving(server) as port:
        send(MESSAGE, mail_channel(port, recipients=("d@e.f", "g@h.i")), folder=tmp_path)
        hostile = AlarmMessage("p\r\nBcc: x@y.z", "any", "pump", "opened", "now", "3")
        send(hostile, mail_channel(port), folder=tmp_path)

    mail, hostile_mail = (
        message_from_bytes(content, policy=policy.default) for content in server.mails
    )
    assert mail["Subject"] == "pump-1: pump alarm opened (860 rpm, 10 MPa)"
    assert mail["To"] == "d@e.f, g@h.i"
    assert mail["Message-ID"] == "<alarm-17-opened@swashtwin>"
    assert "+9.1 dB at shaft order 9" in mail.get_content()
    assert "http://127.0.0.1:8642/alarms/17" in mail.get_content()

    assert hostile_mail["Bcc"] is None


@pytest.mark.parametrize(
    ("refuse", "tls", "reason"),
    [
        ("MAIL", "none", "550 not here"),
        ("RCPT", "none", "refused every recipient"),
        ("", "starttls", "STARTTLS"),
    ],
)
def test_a_mail_that_is_refused_or_would_not_be_encrypted_is_an_error_with_the_reason(
    tmp_path: Path, refuse: str, tls: str, reason: str
) -> None:
    server = MailServer(refuse=refuse)
    with serving(server) as port, pytest.raises(ChannelError, match=reason):
        send(MESSAGE, mail_channel(port, tls=tls), folder=tmp_path)

    assert server.mails == []


def test_a_broker_gets_the_message_as_json(tmp_path: Path, broker: Broker) -> None:
    from paho.mqtt.client import Client, MQTTMessage
    from paho.mqtt.enums import CallbackAPIVersion

    has_subscribed = threading.Event()
    has_received = threading.Event()
    payloads: list[bytes] = []

    def keep(_client: Client, _userdata: object, message: MQTTMessage) -> None:
        payloads.append(message.payload)
        has_received.set()

    listener = Client(CallbackAPIVersion.VERSION2)
    listener.on_subscribe = lambda *_: has_subscribed.set()
    listener.on_message = keep
    listener.connect(broker.host, broker.port)
    listener.subscribe("plant/alarms", qos=1)
    listener.loop_start()
    assert has_subscribed.wait(10)

    channel = MqttChannel(name="mqtt", host=broker.host, port=broker.port, topic="plant/alarms")
    send(MESSAGE, channel, folder=tmp_path)
    assert has_received.wait(10)

    listener.disconnect()
    listener.loop_stop()
    assert json.loads(payloads[0])["identity"] == "alarm-17-opened"


def channels(port: int) -> list[Any]:
    """Return a channel of each kind that uses the network, all to one port."""
    hook = WebhookChannel(name="hook", url=Secret(f"http://127.0.0.1:{port}/"))
    return [
        hook,
        mail_channel(port),
        MqttChannel(name="mqtt", host="127.0.0.1", port=port, topic="a"),
    ]


@pytest.mark.parametrize("number", range(3))
def test_a_missing_or_silent_server_is_an_error_in_time(tmp_path: Path, number: int) -> None:
    with pytest.raises(ChannelError, match="Connection refused"):
        send(MESSAGE, channels(free_port())[number], folder=tmp_path)

    with socket.create_server(("127.0.0.1", 0)) as silent:
        channel = channels(silent.getsockname()[1])[number]
        started = time.monotonic()
        with pytest.raises(ChannelError, match=r"no answer within 0\.5 s"):
            send(MESSAGE, channel, folder=tmp_path, timeout=0.5)
    assert time.monotonic() - started < 5


def test_a_webhook_that_answers_a_character_at_a_time_is_cut_off_in_time(tmp_path: Path) -> None:
    server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), DawdlingHandler)
    server.daemon_threads = True

    with serving(server) as port:
        started = time.monotonic()
        with pytest.raises(ChannelError, match="hook"):
            send(MESSAGE, channels(port)[0], folder=tmp_path, timeout=0.5)
    assert time.monotonic() - started < 5
