"""The server under the page, over real connections."""

import contextlib
import socket
import time
from collections.abc import Iterator

import pytest
from mqtt_broker import free_port
from starlette.responses import Response
from starlette.routing import Route

from swashtwin.monitoring.page import server
from swashtwin.monitoring.page.watch_page import build_watch_page

pytestmark = pytest.mark.nightly


@pytest.fixture
def port(plant, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Port of a page with short time limits."""
    monkeypatch.setattr(server, "KEEP_ALIVE_S", 1)
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 50)
    monkeypatch.setattr(server, "ANSWER_TIMEOUT_S", 1.0)
    number = free_port()
    application = build_watch_page(plant.config, plant.history, upload=lambda *_: "id")
    application.router.routes.insert(
        0, Route("/static/large", lambda _: Response(bytes(5_000_000)))
    )
    with server.serving_page(application, "127.0.0.1", number):
        yield number


def _answer(connection: socket.socket) -> bytes:
    content = b""
    connection.settimeout(20)
    while piece := connection.recv(65536):
        content += piece
    return content


def test_a_connection_is_closed_if_no_further_request_follows_an_answer(port: int) -> None:
    start = time.monotonic()
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        answer = _answer(connection)
    assert (b" 200 " in answer[:20], answer.count(b"HTTP/1.1")) == (True, 1)
    assert time.monotonic() - start < 10  # one second if nothing else runs


def test_a_head_that_is_too_long_is_refused(port: int) -> None:
    with socket.create_connection(("127.0.0.1", port)) as connection:
        line = b"X-Long: " + b"x" * server.MAX_HEADER_BYTES
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n" + line)
        assert b" 400 " in _answer(connection)[:20]


def test_who_does_not_take_an_answer_is_hung_up_on(port: int) -> None:
    with socket.socket() as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.connect(("127.0.0.1", port))
        lazy.sendall(b"GET /static/large HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        start = lazy.recv(1024)
        length = int(start.split(b"content-length: ")[1].split(b"\r\n")[0])
        time.sleep(3)
        try:
            content = _answer(lazy)
        except ConnectionResetError:  # the kernel ended the connection
            content = b""
        assert len(content) < length - 10**6  # the system holds some of it


def test_a_request_beyond_the_limit_of_connections_is_refused_until_others_end(port: int) -> None:
    request = b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
    with contextlib.ExitStack() as stack:
        for _ in range(server.MAX_CONNECTIONS):
            stack.enter_context(socket.create_connection(("127.0.0.1", port)))
        with socket.create_connection(("127.0.0.1", port)) as late:
            late.sendall(request)
            assert b" 503 " in _answer(late)[:20]
    time.sleep(0.5)
    with socket.create_connection(("127.0.0.1", port)) as later:
        later.sendall(request)
        assert b" 200 " in _answer(later)[:20]


def test_an_upload_that_breaks_off_is_no_error_of_ours(
    port: int, plant, caplog: pytest.LogCaptureFixture
) -> None:
    head = "POST /api/recordings HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5000\r\n"
    head += "Content-Type: multipart/form-data; boundary=a\r\n\r\n"
    part = '--a\r\nContent-Disposition: form-data; name="file"; filename="a.wav"\r\n\r\nRIFF'
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall((head + part).encode())
        time.sleep(0.2)
    with socket.create_connection(("127.0.0.1", port)) as other:
        other.sendall(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert b" 200 " in _answer(other)[:20]
    time.sleep(0.2)
    assert "Traceback" not in caplog.text
    assert list((plant.config.folder / "uploads").glob("*")) == []


def test_what_is_no_http_is_refused_and_the_next_request_answered(port: int) -> None:
    for content in (
        b"\0\1\2\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"GET / HTTP/1.1\r\n a: b\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(content)
            assert b" 400 " in _answer(connection)[:20]
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        answer = _answer(connection)
        assert b" 200 " in answer[:20]
        assert b"server:" not in answer.lower()


def test_an_invalid_body_writes_no_traceback_into_the_log(
    port: int, caplog: pytest.LogCaptureFixture
) -> None:
    request = (
        b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n"
        b"Content-Type: application/x-www-form-urlencoded\r\n\r\nzz\r\n"
    )
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(request)
        assert b" 400 " in _answer(connection)[:20]

    assert "Traceback" not in caplog.text
