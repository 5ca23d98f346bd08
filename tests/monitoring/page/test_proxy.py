"""The page behind the reverse proxy of deploy/Caddyfile."""

import os
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mqtt_broker import free_port
from msgspec.structs import replace

from swashtwin.monitoring.page.server import serving_page
from swashtwin.monitoring.page.watch_page import build_watch_page

CADDYFILE = Path(__file__).parents[3] / "deploy" / "Caddyfile"
REQUEST = b"GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(shutil.which("caddy") is None, reason="caddy is not installed"),
]


@pytest.fixture
def proxy_port(plant, tmp_path: Path) -> Iterator[int]:
    """Port at which the proxy serves the page by HTTPS."""
    page_port = free_port()
    port = free_port()

    # The page is called by the name under which the proxy serves it.
    page = replace(plant.config.page, hosts=("localhost",))
    application = build_watch_page(replace(plant.config, page=page), plant.history)
    environment = os.environ | {
        "PAGE_NAME": f"https://localhost:{port}",
        "PAGE_UPSTREAM": f"127.0.0.1:{page_port}",
        "XDG_DATA_HOME": str(tmp_path),
        "XDG_CONFIG_HOME": str(tmp_path),
    }

    # The redirect from HTTP would need port 80, which belongs to root.
    text = CADDYFILE.read_text().replace("admin off", "admin off\n\tauto_https disable_redirects")
    file = tmp_path / "Caddyfile"
    file.write_text(text)
    command = ["caddy", "run", "--adapter", "caddyfile", "--config", str(file)]

    with (
        serving_page(application, "127.0.0.1", page_port),
        subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as process,
    ):
        yield port
        process.terminate()


@contextmanager
def connected(port: int) -> Iterator[ssl.SSLSocket]:
    """A connection to the proxy, once it has started."""
    # The proxy signs a certificate for localhost itself.
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE

    deadline = time.monotonic() + 30
    while True:
        try:
            plain = socket.create_connection(("127.0.0.1", port), timeout=30)
            with context.wrap_socket(plain, server_hostname="localhost") as connection:
                yield connection
            return
        except (ConnectionRefusedError, ssl.SSLError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


def test_the_proxy_passes_requests_on(proxy_port: int) -> None:
    with connected(proxy_port) as connection:
        connection.sendall(REQUEST)
        assert connection.recv(1000).startswith(b"HTTP/1.1 200 ")


def test_the_proxy_disconnects_a_client_that_sends_half_of_a_request(proxy_port: int) -> None:
    with connected(proxy_port) as connection:
        start = time.monotonic()
        connection.sendall(REQUEST[:30])
        connection.settimeout(60)
        while connection.recv(1000):
            pass

        # 15 s by the Caddyfile
        assert 5 < time.monotonic() - start < 30
