"""Decide who sent a request.

A visitor is a person with a session, a program with a token, or, if there is no file of users,
anyone on this computer.
"""

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
from swashtwin.monitoring.page.throttle import Origin, Throttle, drop_oldest
from swashtwin.monitoring.page.users import UserFile, digest

COOKIE = "swashtwin_visit"
"""Name of the cookie; it holds the id of a visit, and after a login that of the session."""
SESSION_SECONDS = 12 * 3600.0
"""How long a login lasts without a request [s]; our choice."""
MAX_SESSION_SECONDS = 7 * 24 * 3600.0
"""How long a login lasts in total [s]; our choice."""
_MAX_SESSIONS = 1000


@dataclass(frozen=True)
class Visitor:
    """Who sent a request."""

    name: str
    """Name of the person or of the program's token; empty if the page has no logins."""
    kind: Literal["person", "token", "control", "local"]
    """How the visitor is known; ``control`` is a token that may also change things."""


class _Session(NamedTuple):
    name: str
    """Name of the person."""
    mark: str
    """Mark of the password with which the person logged in (`UserFile.mark`)."""
    final_end: float
    """When it ends even if it is used [s]."""
    idle_end: float
    """When it ends without a request [s]."""


class Access:
    """Logins, sessions and form tokens of one page.

    Raises
    ------
    InputError
        The file of users has no entry, so nobody could use the page.
    DataError
        The file of users is absent or damaged.
    """

    def __init__(self, settings: PageSettings) -> None:
        self.settings = settings
        self.users: UserFile | None = None
        """People and programs; `None` if the page is open to this computer only."""
        self._throttle = Throttle()
        self._form_key = secrets.token_bytes(32)
        self._sessions: OrderedDict[str, _Session] = OrderedDict()
        self._familiar: OrderedDict[Origin, None] = OrderedDict()
        """Addresses from which a person has logged in. Only the address is slowed down there, so
        that strangers who guess passwords cannot lock that person out.
        """
        self._lock = threading.Lock()
        if settings.users is not None:
            self.users = UserFile(settings.users)
            if not self.users.entries():
                raise InputError(
                    f"{settings.users} has no user and no token; add one with swashtwin watch user."
                )

    def visitor(self, request: HTTPConnection) -> Visitor | None:
        """Return who sent a request; `None` if the sender may not use the page."""
        if self.users is None:
            return Visitor("", "local")

        # A token comes first: a program that sends one is not the person whose cookie it may hold.
        scheme, _, token = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            program = self.users.program(token.strip())
            if program is None:
                return None
            return Visitor(program.name, program.kind)

        person = self._session_name(self.users, request.cookies.get(COOKIE, ""))
        if person is None:
            return None
        return Visitor(person, "person")

    def login(self, request: HTTPConnection, name: str, password: str) -> str | int:
        """Return a new session's id, or the seconds to wait before the next attempt.

        The result is 0 if the login failed and another attempt may follow at once.
        """
        if self.users is None:
            return 0

        origin = Origin(self._address(request), digest(name))
        by_address, by_name = origin.keys
        keys = [by_address]
        if origin not in self._familiar:
            keys.append(by_name)

        # The attempt is counted before the slow check, so that parallel guesses are counted too.
        wait = self._throttle.attempt(origin, *keys)
        if wait:
            return wait
        mark = self.users.checked_mark(name, password)
        if mark is None:
            return self._throttle.wait(*keys)

        self._throttle.succeed(origin)
        return self._start_session(name, mark, origin)

    def logout(self, request: HTTPConnection) -> None:
        """End the session of a request."""
        with self._lock:
            self._sessions.pop(digest(request.cookies.get(COOKIE, "")), None)

    def form_token(self, visit: str) -> str:
        """Return the token that the forms of a visit carry."""
        return hmac.new(self._form_key, visit.encode(), hashlib.sha256).hexdigest()

    def is_form_token(self, request: HTTPConnection, token: str) -> bool:
        """Return whether a form comes from a page that was sent to the same visit."""
        visit = request.cookies.get(COOKIE, "")
        expected_token = self.form_token(visit).encode()
        return bool(visit) and hmac.compare_digest(expected_token, token.encode("utf-8", "replace"))

    def set_cookie(self, response: Response, visit: str) -> None:
        """Set the visit's cookie in the browser.

        Scripts cannot read it, and forms of another site do not send it. A link does send it
        (``Lax``), so that a link in an alarm's mail leads to the alarm and not to the login.
        """
        response.set_cookie(
            COOKIE, visit, httponly=True, samesite="lax", secure=self.settings.https, path="/"
        )

    def _address(self, request: HTTPConnection) -> str:
        """Return the address that an attempt to log in comes from."""
        address = "unknown"
        if request.client is not None:
            address = request.client.host
        if address != self.settings.proxy:
            return address

        # The proxy appends the client's address; what precedes it is the client's own claim.
        forwarded = ",".join(request.headers.getlist("x-forwarded-for"))
        return forwarded.rpartition(",")[2].strip() or address

    def _start_session(self, name: str, mark: str, origin: Origin) -> str:
        session_id = secrets.token_urlsafe(32)
        now = time.monotonic()
        session = _Session(name, mark, now + MAX_SESSION_SECONDS, now + SESSION_SECONDS)

        # Only digests are kept: a copy of the memory gives nobody a session.
        with self._lock:
            self._familiar[origin] = None
            drop_oldest(self._familiar, _MAX_SESSIONS)
            self._sessions[digest(session_id)] = session
            drop_oldest(self._sessions, _MAX_SESSIONS)
        return session_id

    def _session_name(self, users: UserFile, session_id: str) -> str | None:
        """Return the person of a session; `None` if it ended or the password changed since."""
        now = time.monotonic()
        key = digest(session_id)
        with self._lock:
            session = self._sessions.pop(key, None)
            if session is None or min(session.idle_end, session.final_end) < now:
                return None
            if users.mark(session.name) != session.mark:
                return None

            # Inserted again at the end, since the first entries are dropped when space is short.
            self._sessions[key] = session._replace(idle_end=now + SESSION_SECONDS)
            return session.name
