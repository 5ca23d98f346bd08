"""Messages reach real servers; a server that refuses, stays silent or dawdles is an error in one
line, in time.
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
    """Port of a server that runs until the end of the block."""
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
        self.refuse, self.mails = refuse, list[bytes]()


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
    """A web server that answers every post with one status."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), HookHandler)
    server.posts, server.status = [], status  # type: ignore[attr-defined]
    return server


def mail_channel(port: int, **settings: Any) -> EmailChannel:
    """A channel of mail to a server at a port, in the clear."""
    facts = {
        "name": "mail",
        "host": "127.0.0.1",
        "sender": "a@b.c",
        "recipients": ("d@e.f",),
        "tls": "none",
    }
    return EmailChannel(port=port, **{**facts, **settings})


class DawdlingHandler(socketserver.StreamRequestHandler):
    """Sends one character of a header now and then, for ever."""

    def handle(self) -> None:
        try:
            while True:
                self.wfile.write(b"x")
                time.sleep(0.05)
        except OSError:
            pass


def test_a_log_gets_one_line_for_each_message_whatever_the_names_hold(tmp_path: Path) -> None:
    channel = LogChannel(name="log")
    send(MESSAGE, channel, folder=tmp_path)
    send(
        AlarmMessage("a\nb\x1b[2J", "any", "sensor", "cleared", "now", "2"),
        channel,
        folder=tmp_path,
    )
    lines = (tmp_path / "alarms.log").read_text(encoding="utf-8").splitlines()
    assert lines == [
        "2026-01-02T03:04:05+00:00 pump-1: pump alarm opened (860 rpm, 10 MPa). +9.1 dB at shaft order 9 (129 Hz), "
        "channel cover_z http://127.0.0.1:8642/alarms/17",
        "now a\\nb\\x1b[2J: sensor alarm cleared (any).",
    ]


def test_a_webhook_gets_the_message_as_json_with_the_token(tmp_path: Path) -> None:
    server = hook_server()
    with serving(server) as port:
        url = Secret(f"http://127.0.0.1:{port}/hook?a=b")
        send(MESSAGE, WebhookChannel(name="hook", url=url, token=Secret("t0ken")), folder=tmp_path)
    ((path, headers, body),) = server.posts  # type: ignore[attr-defined]
    assert path == "/hook?a=b"
    assert headers["Authorization"] == "Bearer t0ken"
    assert json.loads(body) == json.loads(json.dumps({**asdict(MESSAGE), "title": MESSAGE.title}))


@pytest.mark.parametrize("status", [302, 500])
def test_a_webhook_that_does_not_take_the_message_is_an_error_with_its_status(
    tmp_path: Path, status: int
) -> None:
    with serving(hook_server(status)) as port:
        url = Secret(f"http://u:geheim@127.0.0.1:{port}/")
        for token, reason in ((Secret(""), f"answered {status}"), (Secret("ge\nheim"), "hook")):
            with pytest.raises(ChannelError, match=reason) as error:
                send(MESSAGE, WebhookChannel(name="hook", url=url, token=token), folder=tmp_path)
            assert "heim" not in str(error.value)


def test_a_mail_reaches_the_server_with_subject_reasons_link_and_identity_and_no_forged_header(
    tmp_path: Path,
) -> None:
    server = MailServer()
    with serving(server) as port:
        send(MESSAGE, mail_channel(port, recipients=("d@e.f", "g@h.i")), folder=tmp_path)
        hostile = AlarmMessage("p\r\nBcc: x@y.z", "any", "pump", "opened", "now", "3")
        send(hostile, mail_channel(port), folder=tmp_path)
    mail, second_mail = (
        message_from_bytes(content, policy=policy.default) for content in server.mails
    )
    assert mail["Subject"] == "pump-1: pump alarm opened (860 rpm, 10 MPa)"
    assert mail["To"] == "d@e.f, g@h.i"
    assert mail["Message-ID"] == "<alarm-17-opened@swashtwin>"
    assert "+9.1 dB at shaft order 9" in mail.get_content()
    assert "http://127.0.0.1:8642/alarms/17" in mail.get_content()
    assert second_mail["Bcc"] is None


@pytest.mark.parametrize(
    ("refuse", "tls", "reason"),
    [
        ("MAIL", "none", "550 not here"),
        ("RCPT", "none", "refused every recipient"),
        ("", "starttls", "STARTTLS"),
    ],
)
def test_a_mail_that_is_refused_or_would_go_in_the_clear_is_an_error_with_the_reason(
    tmp_path: Path, refuse: str, tls: str, reason: str
) -> None:
    server = MailServer(refuse=refuse)
    with serving(server) as port, pytest.raises(ChannelError, match=reason):
        send(MESSAGE, mail_channel(port, tls=tls), folder=tmp_path)
    assert server.mails == []


def test_a_broker_gets_the_message_as_json(tmp_path: Path, broker: Broker) -> None:
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    got, ready, payloads = threading.Event(), threading.Event(), list[bytes]()
    listener = Client(CallbackAPIVersion.VERSION2)
    listener.on_subscribe = lambda *_: ready.set()
    listener.on_message = lambda _, __, message: (payloads.append(message.payload), got.set())
    listener.connect(broker.host, broker.port)
    listener.subscribe("plant/alarms", qos=1)
    listener.loop_start()
    assert ready.wait(10)
    channel = MqttChannel(name="mqtt", host=broker.host, port=broker.port, topic="plant/alarms")
    send(MESSAGE, channel, folder=tmp_path)
    assert got.wait(10)
    listener.disconnect()
    listener.loop_stop()
    assert json.loads(payloads[0])["identity"] == "alarm-17-opened"


def channels(port: int) -> list[Any]:
    """A channel of each kind that uses the network, at a port."""
    hook = WebhookChannel(name="hook", url=Secret(f"http://127.0.0.1:{port}/"))
    return [
        hook,
        mail_channel(port),
        MqttChannel(name="mqtt", host="127.0.0.1", port=port, topic="a"),
    ]


@pytest.mark.parametrize("number", range(3))
def test_a_server_that_is_not_there_or_stays_silent_is_an_error_in_time(
    tmp_path: Path, number: int
) -> None:
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
