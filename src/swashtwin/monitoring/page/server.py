"""The server, and what is refused before any page is asked: foreign hosts and origins, strangers,
large and slow bodies, clients that send or take nothing. And the headers by which a browser refuses
the rest.
"""

import asyncio
import logging
import re
import socket
import threading
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from urllib.parse import quote, urlsplit

import h11
import uvicorn
from fastapi import FastAPI
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.monitoring.page.access import Access

MOST_FORM_BYTES = 64 * 1024
"""Largest body [byte] of anything but an upload."""
MOST_UPLOAD_BYTES = 64 * 1024 * 1024
"""Largest recording [byte] that is taken by HTTP."""
BODY_SECONDS = 120.0
"""Longest time [s] that a whole body may take."""
UPLOAD_PATH = "/api/recordings"

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
)
_HEADERS = {
    "content-security-policy": _POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}
_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d{1,5})?")


class _BodyError(Exception):
    """A body is longer, or took longer, than it may; with the status of the answer and its text."""


class Guard:
    """Middleware around the whole page.

    Parameters
    ----------
    hosts : names by which the page may be called; any other ``Host`` is refused, so that a foreign
        site that points its own name to this computer (DNS rebinding) reads nothing. ``*`` takes
        any.
    access : who may use the page; `Visitor` is handed on as ``request.state.visitor``.
    uploads : addresses whose bodies may be as large as a recording.
    """

    def __init__(
        self,
        app: ASGIApp,
        hosts: Sequence[str],
        access: Access,
        uploads: Container[str] = (UPLOAD_PATH,),
    ) -> None:
        self.app = app
        self.access = access
        self.uploads = uploads
        self.hosts = frozenset(host.lower().strip("[]") for host in hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        path: str = scope["path"]
        has_answer = False

        async def send_with_headers(message: Message) -> None:
            nonlocal has_answer
            if message["type"] == "http.response.start":
                has_answer = True
                sent = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    sent[name] = value
                sent["cache-control"] = (
                    "public, max-age=3600" if path.startswith("/static/") else "no-store"
                )
            await send(message)

        limit = MOST_UPLOAD_BYTES if path in self.uploads else MOST_FORM_BYTES
        answer = self._refusal(scope, headers, limit)
        if answer is None:
            try:
                await self.app(scope, _bounded(receive, limit), send_with_headers)
            except _BodyError as error:
                answer = _refused(*error.args)
        if answer is not None and not has_answer:
            await answer(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope, headers: Headers, limit: int) -> Response | None:
        host = headers.get("host", "")
        match = _HOST.fullmatch(host)
        if match is None or not ("*" in self.hosts or match[1].lower().strip("[]") in self.hosts):
            return _refused(421, "The page is not called by this name; list it under [page] hosts.")
        if scope["method"] not in ("GET", "HEAD", "OPTIONS"):
            origin = headers.get("origin")
            is_foreign = origin is not None and urlsplit(origin).netloc.lower() != host.lower()
            if is_foreign or headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
                return _refused(403, "The request comes from another site.")
        length = headers.get("content-length", "0")
        if not (length.isascii() and length.isdecimal()):
            return _refused(400, "The content length is no number.")
        if len(length) > 12 or int(length) > limit:
            return _refused(413, f"The body is larger than {limit} bytes.")
        return self._stranger(scope)

    def _stranger(self, scope: Scope) -> Response | None:
        """What a stranger is told; None for everybody else, and for what everybody may see."""
        try:
            visitor = self.access.visitor(HTTPConnection(scope))
        except (SwashTwinError, OSError):
            return _refused(503, "The file of users cannot be read.")
        scope.setdefault("state", {})["visitor"] = visitor
        path: str = scope["path"]
        if visitor is not None or path in ("/login", "/health") or path.startswith("/static/"):
            return None
        if scope["method"] == "GET" and not path.startswith(("/api/", "/metrics")):
            query = scope["query_string"].decode("latin-1")
            return RedirectResponse(
                f"/login?next={quote(path + '?' * bool(query) + query, safe='')}", 303
            )
        return _refused(
            401,
            "Log in, or send a token: Authorization: Bearer TOKEN.",
            {"www-authenticate": "Bearer"},
        )


def _refused(code: int, text: str, headers: Mapping[str, str] | None = None) -> Response:
    return PlainTextResponse(text, code, headers={"connection": "close", **(headers or {})})


def _bounded(receive: Receive, limit: int) -> Receive:
    """`receive` that ends with an error where the body is too large or takes too long."""
    total = 0
    is_whole = False
    end: float | None = None

    async def receive_bounded() -> Message:
        nonlocal total, is_whole, end
        if is_whole:
            return await receive()  # waits for the end of the connection
        loop = asyncio.get_running_loop()
        end = loop.time() + BODY_SECONDS if end is None else end
        try:
            message = await asyncio.wait_for(receive(), end - loop.time())
        except TimeoutError:
            raise _BodyError(408, f"The body took longer than {BODY_SECONDS:g} s.") from None
        total += len(message.get("body", b""))
        is_whole = message["type"] != "http.request" or not message.get("more_body", False)
        if total > limit:
            raise _BodyError(413, f"The body is larger than {limit} bytes.")
        return message

    return receive_bounded


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
