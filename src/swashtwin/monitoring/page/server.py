"""Serve an application by uvicorn in a thread.

Only public settings of uvicorn are used. They bound the size of a request's head, idle time after
an answer, and the number of connections; `Guard` bounds bodies. Clients that connect and send no
complete request are the business of a reverse proxy (``docs/how-to/watch-page.md``).
"""

import asyncio
import logging
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn
from fastapi import FastAPI
from h11 import LocalProtocolError

from swashtwin.foundation import InputError

MAX_CONNECTIONS = 300
"""Connections at the same time; a request beyond them is answered with 503. Our choice: a process
may usually have 1024 files open, and the watch opens others too.
"""
MAX_HEADER_BYTES = 32 * 1024
"""Longest head of a request."""
KEEP_ALIVE_S = 15
"""Time that a connection stays open after an answer."""
ANSWER_TIMEOUT_S = 120.0
"""Time after which a client that takes nothing of an answer is disconnected (Linux only)."""

# Time that running requests have when the server ends.
_END_TIMEOUT_S = 2

# Time that the server's thread has to end.
_JOIN_TIMEOUT_S = 10.0

_POLL_S = 0.01


@contextmanager
def serving_page(application: FastAPI, host: str, port: int) -> Iterator[None]:
    """Serve an application in a thread until the block ends.

    Addresses and headers are not logged.

    Raises
    ------
    InputError
        The port is in use, or the host is not an address of this computer.
    """
    listener = _listen(host, port)
    configuration = uvicorn.Config(
        application,
        http="h11",  # the limit on a request's head holds for this parser only
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="error",  # otherwise each request that is not HTTP would write a line
        access_log=False,
        server_header=False,
        proxy_headers=False,  # the page reads X-Forwarded-For itself, and from its proxy only
        limit_concurrency=MAX_CONNECTIONS + 1,  # uvicorn counts the connection that asks
        timeout_keep_alive=KEEP_ALIVE_S,
        timeout_graceful_shutdown=_END_TIMEOUT_S,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_fault_of_page)

    server = uvicorn.Server(configuration)
    thread = threading.Thread(target=server.run, args=([listener],), name="page", daemon=True)
    thread.start()
    try:
        while thread.is_alive() and not server.started:
            time.sleep(_POLL_S)
        if not server.started:
            raise InputError(f"The server at {host}:{port} ended at its start; see the log.")
        yield
    finally:
        server.should_exit = True
        thread.join(_JOIN_TIMEOUT_S)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET
    if ":" in host:
        family = socket.AF_INET6
    try:
        listener = socket.create_server((host, port), family=family)
    except OSError as cause:
        reason = str(cause.strerror).partition(" (")[0]
        raise InputError(
            f"Cannot serve at {host}:{port}: {reason}. Use another port or host."
        ) from cause

    # Otherwise an answer's body waits for the client's acknowledgment of its head, 40 ms on Linux.
    # asyncio sets the option for sockets of the protocol TCP only, and this one names no protocol.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    # Accepted connections inherit both options. The kernel then ends those whose peer advertises a
    # full window for so long; closing them ourselves would wait until the peer reads.
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        timeout_ms = int(1000 * ANSWER_TIMEOUT_S)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, timeout_ms)
    return listener


def _is_fault_of_page(record: logging.LogRecord) -> bool:
    """Return whether a log record is about a fault of the page.

    It is not if the end of the watch ended a request, or if a client sent an invalid body: a
    stranger could fill the log with tracebacks.
    """
    harmless = (asyncio.CancelledError, LocalProtocolError)
    if record.exc_info and isinstance(record.exc_info[1], harmless):
        return False
    return not str(record.msg).startswith("Cancel ")
