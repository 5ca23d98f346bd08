"""Refuse requests before any page sees them.

The guard refuses foreign hosts and origins, strangers, and bodies that are too large or too slow.
It also sets the headers by which a browser refuses the rest.
"""

import asyncio
import re
from collections.abc import Container, Mapping, Sequence
from urllib.parse import quote, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.page.sessions import Access

MAX_FORM_BYTES = 64 * 1024
"""Largest body of anything but an upload."""
MAX_UPLOAD_BYTES = 64 * 1024 * 1024
"""Largest recording that is accepted by HTTP."""
BODY_TIMEOUT_S = 120.0
"""Time in which a whole body must arrive."""
UPLOAD_PATH = "/api/recordings"
"""Address that accepts recordings."""
LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
"""Names by which a browser on this computer calls the page."""

# Digits of a content length that is converted at all; `int` of a long text is slow.
_MAX_LENGTH_DIGITS = 12

_PUBLIC_PATHS = ("/login", "/health")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;"
    " connect-src 'self'; font-src 'self'; form-action 'self'; frame-ancestors 'none';"
    " base-uri 'none'"
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
    """A body is too large or too slow."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.text = text


class Guard:
    """Middleware around all addresses.

    Parameters
    ----------
    access : decides who may use the page; the `Visitor` becomes ``request.state.visitor``.
    hosts : names by which the page may be called. Any other ``Host`` is refused, so that a foreign
        site that points its own name to this computer (DNS rebinding) reads nothing. ``*`` allows
        any name.
    uploads : addresses whose bodies may be as large as a recording.
    """

    def __init__(
        self,
        app: ASGIApp,
        access: Access,
        hosts: Sequence[str] = LOCAL_NAMES,
        uploads: Container[str] = (UPLOAD_PATH,),
    ) -> None:
        self.app = app
        self.access = access
        self.uploads = uploads
        self.hosts = frozenset(host.lower().strip("[]") for host in hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return

        # Web sockets are neither http nor lifespan; nothing here uses them.
        path: str = scope["path"]
        has_started = False

        async def send_with_headers(message: Message) -> None:
            nonlocal has_started
            if message["type"] == "http.response.start":
                has_started = True
                _add_headers(message, path)
            await send(message)

        max_bytes = MAX_FORM_BYTES
        if path in self.uploads:
            max_bytes = MAX_UPLOAD_BYTES
        refusal = self._refusal(scope, max_bytes)
        if refusal is None:
            try:
                await self.app(scope, _limit_body(receive, max_bytes), send_with_headers)
            except _BodyError as error:
                refusal = _refuse(error.code, error.text)

        # An answer that has begun cannot be replaced by a refusal.
        if refusal is not None and not has_started:
            await refusal(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope, max_bytes: int) -> Response | None:
        """Return the answer to a request that is refused; `None` if it may pass."""
        # From cheap to expensive: only the last check reads the file of users.
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._is_allowed_host(host):
            return _refuse(421, f"Host not allowed: {host[:100]}. Add it to [page] hosts.")

        is_reading = scope["method"] in ("GET", "HEAD", "OPTIONS")
        if not is_reading and _is_from_another_site(headers, host):
            return _refuse(403, "The request comes from another site.")

        length = headers.get("content-length", "0")
        if not (length.isascii() and length.isdecimal()):
            return _refuse(400, "The content length is not a number.")
        if len(length) > _MAX_LENGTH_DIGITS or int(length) > max_bytes:
            return _refuse(413, f"The body is larger than {max_bytes} bytes.")

        return self._refuse_stranger(scope)

    def _is_allowed_host(self, host: str) -> bool:
        match = _HOST.fullmatch(host)
        if match is None:
            return False
        return "*" in self.hosts or match[1].lower().strip("[]") in self.hosts

    def _refuse_stranger(self, scope: Scope) -> Response | None:
        """Return the answer to a stranger; `None` if the visitor is known or the path is public."""
        try:
            visitor = self.access.visitor(HTTPConnection(scope))
        except (SwashTwinError, OSError):
            return _refuse(503, "The file of users cannot be read.")

        # Public pages need to know the visitor, too: the login page shows who is logged in.
        scope.setdefault("state", {})["visitor"] = visitor
        path: str = scope["path"]
        if visitor is not None or path in _PUBLIC_PATHS or path.startswith("/static/"):
            return None

        is_page = scope["method"] == "GET" and not path.startswith(("/api/", "/metrics"))
        if is_page:
            target = path
            if scope["query_string"]:
                target += f"?{scope['query_string'].decode('latin-1')}"
            return RedirectResponse(f"/login?next={quote(target, safe='')}", 303)

        return _refuse(
            401,
            "Log in, or send a token: Authorization: Bearer TOKEN.",
            {"www-authenticate": "Bearer"},
        )


def _add_headers(message: Message, path: str) -> None:
    headers = MutableHeaders(scope=message)
    for name, value in _HEADERS.items():
        headers[name] = value

    headers["cache-control"] = "no-store"
    if path.startswith("/static/"):
        headers["cache-control"] = "public, max-age=3600"


def _is_from_another_site(headers: Headers, host: str) -> bool:
    # Old browsers send only Origin, new ones also Sec-Fetch-Site; programs send neither.
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
        return True
    return headers.get("sec-fetch-site", "none") not in ("same-origin", "none")


def _refuse(code: int, text: str, headers: Mapping[str, str] | None = None) -> Response:
    # The connection is closed, since the rest of a refused body may still be on its way.
    return PlainTextResponse(text, code, headers={"connection": "close", **(headers or {})})


def _limit_body(receive: Receive, max_bytes: int) -> Receive:
    """Return a `receive` that raises an error if the body is too large or too slow."""
    total_bytes = 0
    is_complete = False
    deadline: float | None = None

    async def receive_limited() -> Message:
        nonlocal total_bytes, is_complete, deadline
        if is_complete:
            return await receive()  # waits until the client disconnects, which has no limit

        loop = asyncio.get_running_loop()
        if deadline is None:
            deadline = loop.time() + BODY_TIMEOUT_S
        try:
            message = await asyncio.wait_for(receive(), deadline - loop.time())
        except TimeoutError:
            raise _BodyError(408, f"The body took longer than {BODY_TIMEOUT_S:g} s.") from None

        total_bytes += len(message.get("body", b""))
        is_complete = message["type"] != "http.request" or not message.get("more_body", False)
        if total_bytes > max_bytes:
            raise _BodyError(413, f"The body is larger than {max_bytes} bytes.")
        return message

    return receive_limited
