"""The server of the page over real connections, where clients are slow, broken or too many."""

import contextlib
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from mqtt_broker import free_port
from starlette.responses import Response
from starlette.routing import Route

from swashtwin.monitoring.page import server
from swashtwin.monitoring.page.watch_page import build_watch_page

pytestmark = pytest.mark.nightly


HEALTH_REQUEST = b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n"
CLOSED_REQUEST = HEALTH_REQUEST + b"Connection: close\r\n\r\n"


@pytest.fixture
def port(plant, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Port of a page with low limits of time and number, and with a large answer."""
    monkeypatch.setattr(server, "KEEP_ALIVE_S", 1)
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 50)
    monkeypatch.setattr(server, "ANSWER_TIMEOUT_S", 1.0)

    application = build_watch_page(plant.config, plant.history, upload=lambda *_: "id")
    large_answer = Route("/static/large", lambda _: Response(bytes(5_000_000)))
    application.router.routes.insert(0, large_answer)

    number = free_port()
    with server.serving_page(application, "127.0.0.1", number):
        yield number


@contextmanager
def connected(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port)) as connection:
        yield connection


def read_answer(connection: socket.socket) -> bytes:
    """Return all bytes until the server closes the connection."""
    content = b""
    connection.settimeout(20)
    while piece := connection.recv(65536):
        content += piece
    return content


def answer_to(port: int, content: bytes) -> bytes:
    """Return what the server answers to these bytes on a new connection."""
    with connected(port) as connection:
        connection.sendall(content)
        return read_answer(connection)


def status_of(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def test_the_body_of_an_answer_does_not_wait_until_the_client_acknowledges_its_head(
    plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = free_port()
    listeners = []
    create_server = socket.create_server

    def record(*arguments, **options) -> socket.socket:
        listener = create_server(*arguments, **options)
        # The server takes the listener over; a duplicate has the same options.
        listeners.append(listener.dup())
        return listener

    monkeypatch.setattr(server.socket, "create_server", record)
    application = build_watch_page(plant.config, plant.history, upload=lambda *_: "id")
    # Connections inherit the option of the socket that accepts them.
    with server.serving_page(application, "127.0.0.1", number), listeners[0] as listener:
        assert listener.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_connection_is_closed_if_no_further_request_follows_an_answer(port: int) -> None:
    start = time.monotonic()
    answer = answer_to(port, HEALTH_REQUEST + b"\r\n")

    assert status_of(answer) == 200
    assert answer.count(b"HTTP/1.1") == 1
    # One second if nothing else runs, 15 without the lower limit.
    assert time.monotonic() - start < 10


def test_a_head_that_is_too_long_is_refused(port: int) -> None:
    # The head never ends: a server that waits for its end would hold all of it in memory.
    endless_line = b"X-Long: " + b"x" * server.MAX_HEADER_BYTES

    assert status_of(answer_to(port, HEALTH_REQUEST + endless_line)) == 400


def test_a_client_that_does_not_take_its_answer_is_disconnected(port: int) -> None:
    with socket.socket() as client:
        # A small buffer, so that the answer does not fit into those of the system.
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect(("127.0.0.1", port))
        client.sendall(b"GET /static/large HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        head = client.recv(1024)
        length = int(head.split(b"content-length: ")[1].split(b"\r\n")[0])

        time.sleep(3)
        try:
            content = read_answer(client)
        except ConnectionResetError:  # the kernel ended the connection
            content = b""

    # The system holds some of the answer, so the client gets a part of it.
    assert len(content) < length - 10**6


def test_a_request_beyond_the_limit_of_connections_is_refused_until_others_end(port: int) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(server.MAX_CONNECTIONS):
            stack.enter_context(connected(port))
        assert status_of(answer_to(port, CLOSED_REQUEST)) == 503

    # The server learns of an end a little later.
    time.sleep(0.5)
    assert status_of(answer_to(port, CLOSED_REQUEST)) == 200


def test_an_upload_that_breaks_off_is_no_error_and_leaves_no_file(
    port: int, plant, caplog: pytest.LogCaptureFixture
) -> None:
    head = (
        "POST /api/recordings HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5000\r\n"
        "Content-Type: multipart/form-data; boundary=a\r\n\r\n"
    )
    part = '--a\r\nContent-Disposition: form-data; name="file"; filename="a.wav"\r\n\r\nRIFF'
    with connected(port) as connection:
        connection.sendall((head + part).encode())
        # The file must have begun when the connection ends.
        time.sleep(0.2)

    assert status_of(answer_to(port, CLOSED_REQUEST)) == 200

    time.sleep(0.2)
    # Networks of plants break off daily; a log full of tracebacks hides the one that matters.
    assert "Traceback" not in caplog.text
    assert list((plant.config.folder / "uploads").glob("*")) == []


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"\0\1\2\r\n\r\n", id="binary"),
        # A proxy may believe one of the two names and the page the other.
        pytest.param(b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", id="two hosts"),
        pytest.param(b"GET / HTTP/1.1\r\n a: b\r\n\r\n", id="header begins with a space"),
    ],
)
def test_what_is_not_http_is_refused_and_the_next_request_answered(
    port: int, content: bytes
) -> None:
    assert status_of(answer_to(port, content)) == 400
    assert status_of(answer_to(port, CLOSED_REQUEST)) == 200


def test_answers_do_not_name_the_server(port: int) -> None:
    # Its name and version tell an attacker which faults to try.
    assert b"server:" not in answer_to(port, CLOSED_REQUEST).lower()


def test_an_invalid_body_writes_no_traceback_into_the_log(
    port: int, caplog: pytest.LogCaptureFixture
) -> None:
    # The length of the first piece is not hexadecimal.
    request = (
        b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n"
        b"Content-Type: application/x-www-form-urlencoded\r\n\r\nzz\r\n"
    )

    assert status_of(answer_to(port, request)) == 400
    assert "Traceback" not in caplog.text
