"""Serve an application by uvicorn in a thread."""

import asyncio
import logging
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import h11
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

from swashtwin.foundation import InputError

HEADER_SECONDS = 15.0
"""Time a client has to send the head of a request, and to take the rest of a small answer [s]."""
ANSWER_SECONDS = 120.0
"""Time a client has to take what is ready of an answer [s]."""
_END = 10.0
"""Time [s] that the server has to end."""
MOST_CONNECTIONS = 300
"""Connections at the same time. Beyond it the one that has been idle longest makes room for a new
one.
"""


class ImpatientProtocol(H11Protocol):
    """HTTP/1.1 that hangs up on who sends no request, and on who does not take the answer."""

    _patience: asyncio.TimerHandle | None = None
    _since = 0.0
    """When the clock was started last [s]."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start the clock with the connection, and hang up on the one that has been idle longest
        where it is full.
        """
        if len(self.connections) >= MOST_CONNECTIONS:
            idle = (
                other
                for other in self.connections
                if isinstance(other, ImpatientProtocol) and other.is_idle
            )
            if (longest := min(idle, key=lambda other: other._since, default=None)) is not None:
                longest.transport.abort()
                self.connections.discard(longest)  # at once: the next one must not choose it again
        super().connection_made(transport)  # type: ignore[arg-type]
        self._start(HEADER_SECONDS)

    @property
    def is_idle(self) -> bool:
        """Whether no request is being answered."""
        return self.cycle is None or bool(self.cycle.response_complete)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection at once."""
        if self._patience is not None:
            self._patience.cancel()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Start the clock for the next request."""
        if not self.flow.write_paused:
            self._start(HEADER_SECONDS)
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Start the clock of an answer that waits for the client."""
        super().pause_writing()
        self._start(ANSWER_SECONDS)

    def resume_writing(self) -> None:
        """Start the clock for what remains, and for the next request."""
        super().resume_writing()
        self._start(HEADER_SECONDS)

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no HTTP; the application's own answer to the same request is then
        dropped.
        """
        if self.cycle is not None:
            self.cycle.disconnected = True
        self._start(HEADER_SECONDS)
        try:
            super().send_400_response(msg)
        except h11.LocalProtocolError:
            self.transport.close()  # an answer has begun, or the request was HEAD

    def _start(self, seconds: float) -> None:
        if self._patience is not None:
            self._patience.cancel()
        self._since = self.loop.time()
        self._patience = self.loop.call_later(seconds, self._hang_up)

    def _hang_up(self) -> None:
        if self.flow.write_paused or self.is_idle or self.transport.is_closing():
            self.transport.abort()  # drops what the client did not take; close() would wait for it


@contextmanager
def serving_page(application: FastAPI, host: str, port: int) -> Iterator[None]:
    """Serve the page in a thread of its own until the block ends. No addresses and no headers are
    logged.

    Raises
    ------
    InputError
        The port is taken, or the host is not this computer.
    """
    try:
        listener = socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET
        )
    except OSError as cause:
        reason = str(cause.strerror).partition(" (")[0]
        raise InputError(
            f"no page at {host}:{port}: {reason}; take another port or host."
        ) from cause
    configuration = uvicorn.Config(
        application,
        http=ImpatientProtocol,
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="error",  # no line for each request that is no HTTP
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=MOST_CONNECTIONS + 1,
        timeout_keep_alive=15,
        timeout_graceful_shutdown=2,
        h11_max_incomplete_event_size=32 * 1024,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_no_cancellation)
    server = uvicorn.Server(configuration)
    thread = threading.Thread(target=server.run, args=([listener],), name="page", daemon=True)
    thread.start()
    try:
        while thread.is_alive() and not server.started:
            time.sleep(0.01)
        if not server.started:
            raise InputError(f"the page at {host}:{port} ended while it started; the log says why.")
        yield
    finally:
        server.should_exit = True
        thread.join(_END)


def _is_no_cancellation(record: logging.LogRecord) -> bool:
    """Whether a line is anything but that a request was ended because the watch ends."""
    cause = record.exc_info[1] if record.exc_info else None
    return not (isinstance(cause, asyncio.CancelledError) or str(record.msg).startswith("Cancel "))
