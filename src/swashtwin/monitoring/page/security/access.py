"""Who is asking: a person with a session, a program with a token, or anyone on this computer where nobody is named."""

import hashlib
import hmac
import ipaddress
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Literal

from starlette.requests import HTTPConnection
from starlette.responses import Response

from swashtwin.foundation import InputError
from swashtwin.monitoring.page.security.throttle import Throttle
from swashtwin.monitoring.page.security.users import UserFile

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


@dataclass(frozen=True)
class _Session:
    name: str
    """Name of the person."""
    mark: str
    """Mark of the password with which the person logged in."""
    end: float
    """When it ends without a request [s]."""
    last_end: float
    """When it ends at the latest [s]."""


@dataclass
class Access:
    """Logins, sessions and form tokens of one page."""

    users: tuple[UserFile, ...]
    """Files of people and tokens; none where the page is open to this computer only."""
    is_secure: bool = False
    """Whether cookies are sent over TLS only."""
    proxy: str | None = None
    """Address of the proxy before the page, whose word on the address of a client is taken."""
    throttle: Throttle = field(default_factory=Throttle)
    """Failed logins."""
    _key: bytes = field(default_factory=lambda: secrets.token_bytes(32), init=False)
    _sessions: OrderedDict[str, _Session] = field(default_factory=OrderedDict, init=False)
    _familiar: OrderedDict[tuple[str, str], None] = field(default_factory=OrderedDict, init=False)
    """Addresses from which a person logged in; there only the address is slowed down after wrong passwords."""
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def visitor(self, request: HTTPConnection) -> Visitor | None:
        """Who sent this request; None where nobody who may use the page."""
        if not self.users:
            return Visitor("", "local")
        scheme, _, token = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            kinds: tuple[Literal["control", "token"], ...] = ("control", "token")
            for file, kind in product(self.users, kinds):
                if program := file.token_name(token.strip(), control=kind == "control"):
                    return Visitor(program, kind)
            return None
        person = self._session(request.cookies.get(COOKIE, ""))
        return None if person is None else Visitor(person, "person")

    def login(self, request: HTTPConnection, name: str, password: str) -> str | int:
        """A session's id for the cookie; or, where the login failed, the seconds to wait before the next attempt."""
        address, person = self._address(request), hashlib.sha256(name.encode()).hexdigest()
        keys = [f"address {address}"]
        if (address, person) not in self._familiar:  # else strangers who guess could lock a person out
            keys.append(f"name {person}")
        wait = self.throttle.wait(*keys)
        if wait or not self.users:
            return wait
        marks = (file.checked_mark(name, password) for file in self.users)
        mark = next(filter(None, marks), None)
        if mark is None:
            self.throttle.fail(*keys)
            return self.throttle.wait(*keys)
        self.throttle.succeed(*keys)
        session = secrets.token_urlsafe(32)
        now = time.monotonic()
        with self._lock:
            self._familiar[address, person] = None
            while len(self._familiar) > _MOST_SESSIONS:
                self._familiar.popitem(last=False)
            self._sessions[_fingerprint(session)] = _Session(
                name, mark, now + SESSION_SECONDS, now + LONGEST_SESSION_SECONDS
            )
            while len(self._sessions) > _MOST_SESSIONS:
                self._sessions.popitem(last=False)
        return session

    def logout(self, request: HTTPConnection) -> None:
        """End the session of this request."""
        with self._lock:
            self._sessions.pop(_fingerprint(request.cookies.get(COOKIE, "")), None)

    def form_token(self, visit: str) -> str:
        """Token that forms of the visit with this cookie carry."""
        return hmac.new(self._key, visit.encode(), hashlib.sha256).hexdigest()

    def is_form_token(self, request: HTTPConnection, token: str) -> bool:
        """Whether a form came from a page that we gave to the same visit."""
        visit = request.cookies.get(COOKIE, "")
        return bool(visit) and hmac.compare_digest(self.form_token(visit).encode(), token.encode("utf-8", "replace"))

    def set_cookie(self, response: Response, visit: str) -> None:
        """Give the visit's cookie to the browser.

        Scripts can not read it, and no form of another site sends it. A link in a message does (``Lax``), so that an
        alarm's mail leads to the alarm and not to the login.
        """
        response.set_cookie(COOKIE, visit, httponly=True, samesite="lax", secure=self.is_secure, path="/")

    def _session(self, visit: str) -> str | None:
        """Name of the person whose session has that id; None where it ended or the password is another one now."""
        now = time.monotonic()
        with self._lock:
            key = _fingerprint(visit)
            session = self._sessions.get(key)
            if session is None:
                return None
            is_current = any(file.mark(session.name) == session.mark for file in self.users)
            del self._sessions[key]
            if min(session.end, session.last_end) < now or not is_current:
                return None
            self._sessions[key] = replace(session, end=now + SESSION_SECONDS)  # at the end: the oldest goes first
            return session.name

    def _address(self, request: HTTPConnection) -> str:
        """Address that a request came from; the proxy states it last in ``X-Forwarded-For``."""
        address = request.client.host if request.client else "unknown"
        stated = ",".join(request.headers.getlist("x-forwarded-for"))
        return stated.rpartition(",")[2].strip() if stated and address == self.proxy else address


def is_loopback(host: str) -> bool:
    """Whether only this computer can reach an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def required_users(host: str, paths: Iterable[Path | None]) -> tuple[UserFile, ...]:
    """The files of users and tokens that a page at `host` asks; none where it is open to this computer only.

    Raises
    ------
    InputError
        The page can be reached by other computers and no file is stated, or the files name nobody.
    DataError
        A file is absent or damaged.
    """
    users = tuple(UserFile(path) for path in dict.fromkeys(paths) if path is not None)
    if users and sum(map(UserFile.count, users)) == 0:
        raise InputError(f"{users[0].path} names no user and no token; add one with swashtwin watch user.")
    if not users and not is_loopback(host):
        raise InputError(
            f"[page] host = {host!r} can be reached by other computers, so the page needs users: add one with "
            'swashtwin watch user and state users = "users.json" under [page]; or use host = "127.0.0.1".'
        )
    return users


def _fingerprint(session: str) -> str:
    return hashlib.sha256(session.encode("utf-8", "replace")).hexdigest()
