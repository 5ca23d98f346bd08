"""Refuse whoever does not know the token of the explorer's address.

Every user of a computer can open its ports. The token, which is printed to the one who started the
explorer, keeps the others out. The browser sends it once, in the address, and then as a cookie.
"""

import re
import secrets

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_PARAMETER = "token"
"""Parameter of the address that holds the token."""

_PORT = re.compile(r":(\d{1,5})$")
_REFUSAL = (
    "This explorer requires the token of its address. Open the whole address that"
    " `swashtwin explore` printed when it started; it ends with ?token= and the token."
)


class AddressToken:
    """Middleware that answers 403 to a request without the token.

    Parameters
    ----------
    token : the secret, expected as the parameter `TOKEN_PARAMETER` or as the cookie that the first
        such request sets.
    """

    def __init__(self, app: ASGIApp, token: str) -> None:
        self.app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return

        connection = HTTPConnection(scope)
        cookie = _cookie_name(connection)
        has_address_token = self._is_token(connection.query_params.get(TOKEN_PARAMETER, ""))
        if not has_address_token and not self._is_token(connection.cookies.get(cookie, "")):
            await _refuse(connection)(scope, receive, send)
            return

        async def send_with_cookie(message: Message) -> None:
            if has_address_token and message["type"] == "http.response.start":
                # Neither scripts read the cookie, nor does another site's page send it.
                carrier = Response()
                carrier.set_cookie(cookie, self._token, httponly=True, samesite="strict", path="/")
                headers = MutableHeaders(scope=message)
                headers.append("set-cookie", carrier.headers["set-cookie"])
            await send(message)

        await self.app(scope, receive, send_with_cookie)

    def _is_token(self, text: str) -> bool:
        # In constant time: a comparison that ends at the first difference tells the token.
        return secrets.compare_digest(text.encode("utf-8", "replace"), self._token.encode())


def _cookie_name(connection: HTTPConnection) -> str:
    # Browsers share cookies between the ports of a host; two explorers must not exchange theirs.
    port = _PORT.search(connection.headers.get("host", ""))
    return f"swashtwin_explorer_{'80' if port is None else port[1]}"


def _refuse(connection: HTTPConnection) -> Response:
    if connection.url.path.startswith("/api/"):
        return JSONResponse({"detail": _REFUSAL}, 403)
    return PlainTextResponse(_REFUSAL, 403)
