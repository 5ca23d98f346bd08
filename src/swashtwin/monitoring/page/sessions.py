"""Decide who sent a request: a person with a session, a program with a token, or a local visitor."""

import hashlib
import hmac
import secrets
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import Literal, NamedTuple

from starlette.requests import HTTPConnection
from starlette.responses import Response

from swashtwin.foundation import InputError
from swashtwin.monitoring.config.settings import PageSettings
from swashtwin.monitoring.page.throttle import Throttle, drop_oldest
from swashtwin.monitoring.page.users import UserFile, digest

COOKIE = "swashtwin_visit"
SESSION_SECONDS = 12 * 3600.0
"""How long a login lasts without a request [s]."""
LONGEST_SESSION_SECONDS = 7 * 24 * 3600.0
"""How long a login lasts at most [s]."""
_MOST_SESSIONS = 1000


@dataclass(frozen=True)
class Visitor:
    """Who sent a request."""

    name: str
    """Name of the person or of the program's token; empty where the page asks for none."""
    kind: Literal["person", "token", "control", "local"]
    """How we know; ``control``: by a token that may acknowledge, silence and note events."""


class _Session(NamedTuple):
    name: str
    """Name of the person."""
    mark: str
    """Mark of the password with which the person logged in."""
    last_end: float
    """When it ends at the latest [s]."""
    end: float
    """When it ends without a request [s]."""


class Access:
    """Logins, sessions and form tokens of one page."""

    def __init__(self, settings: PageSettings) -> None:
        self.settings = settings
        self.users = None if settings.users is None else UserFile(settings.users)
        """People and programs; None where the page is open to this computer only."""
        self._throttle = Throttle()
        self._key = secrets.token_bytes(32)
        self._sessions: OrderedDict[str, _Session] = OrderedDict()
        self._familiar: OrderedDict[tuple[str, str], None] = OrderedDict()
        """Addresses from which a person logged in; there only the address is slowed down after
        wrong passwords.
        """
        self._lock = threading.Lock()
        if self.users is not None and not self.users.entries():
            raise InputError(
                f"{settings.users} names no user and no token; add one with swashtwin watch user."
            )

    def visitor(self, request: HTTPConnection) -> Visitor | None:
        """Who sent this request; None where nobody who may use the page."""
        if self.users is None:
            return Visitor("", "local")
        scheme, _, token = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            program = self.users.program(token.strip())
            return None if program is None else Visitor(program.name, program.kind)
        person = self._session(self.users, request.cookies.get(COOKIE, ""))
        return None if person is None else Visitor(person, "person")

    def login(self, request: HTTPConnection, name: str, password: str) -> str | int:
        """A session's id for the cookie; or, where the login failed, the seconds to wait before the
        next attempt.
        """
        address, person = request.client.host if request.client else "unknown", digest(name)
        if address == self.settings.proxy and (
            stated := ",".join(request.headers.getlist("x-forwarded-for"))
        ):
            address = stated.rpartition(",")[
                2
            ].strip()  # the proxy states last where a request came from
        keys = [f"address {address}"]
        if (
            address,
            person,
        ) not in self._familiar:  # else strangers who guess could lock a person out
            keys.append(f"name {person}")
        if self.users is None:
            return 0
        if wait := self._throttle.attempt(*keys):
            return wait
        mark = self.users.checked_mark(name, password)
        if mark is None:
            return self._throttle.wait(*keys)
        self._throttle.succeed(*keys)
        session = secrets.token_urlsafe(32)
        now = time.monotonic()
        with self._lock:
            self._familiar[address, person] = None
            drop_oldest(self._familiar, _MOST_SESSIONS)
            entry = _Session(name, mark, now + LONGEST_SESSION_SECONDS, now + SESSION_SECONDS)
            self._sessions[digest(session)] = entry
            drop_oldest(self._sessions, _MOST_SESSIONS)
        return session

    def logout(self, request: HTTPConnection) -> None:
        """End the session of this request."""
        with self._lock:
            self._sessions.pop(digest(request.cookies.get(COOKIE, "")), None)

    def form_token(self, visit: str) -> str:
        """Token that forms of the visit with this cookie carry."""
        return hmac.new(self._key, visit.encode(), hashlib.sha256).hexdigest()

    def is_form_token(self, request: HTTPConnection, token: str) -> bool:
        """Whether a form came from a page that we gave to the same visit."""
        visit = request.cookies.get(COOKIE, "")
        return bool(visit) and hmac.compare_digest(
            self.form_token(visit).encode(), token.encode("utf-8", "replace")
        )

    def set_cookie(self, response: Response, visit: str) -> None:
        """Give the visit's cookie to the browser.

        Scripts can not read it, and no form of another site sends it. A link in a message does
        (``Lax``), so that an alarm's mail leads to the alarm and not to the login.
        """
        response.set_cookie(
            COOKIE, visit, httponly=True, samesite="lax", secure=self.settings.https, path="/"
        )

    def _session(self, users: UserFile, visit: str) -> str | None:
        """Name of the person whose session has that id; None where it ended or the password is
        another one now.
        """
        now = time.monotonic()
        with self._lock:
            key = digest(visit)
            session = self._sessions.pop(key, None)
            if (
                session is None
                or min(session.end, session.last_end) < now
                or users.mark(session.name) != session.mark
            ):
                return None
            self._sessions[key] = session._replace(
                end=now + SESSION_SECONDS
            )  # at the end: the oldest goes first
            return session.name
