"""The server, and what is refused before any page is asked: foreign hosts and origins, strangers,
large and slow bodies, clients that send or take nothing. And the headers by which a browser refuses
the rest.
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
