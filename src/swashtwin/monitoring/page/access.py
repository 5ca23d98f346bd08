"""Who is asking: a person with a session, a program with a token, or anyone on this computer where
nobody is named.

People and programs are in one JSON file that only its owner can read: where root writes it, the
owner of the file before or of its folder. A password is kept as an argon2id hash, a token as its
SHA-256: a token has 256 random bits, so that no slow hash is needed and each request can be checked
at once.
"""

import hashlib
import hmac
import json
import math
import os
import re
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from starlette.requests import HTTPConnection
from starlette.responses import Response

from swashtwin.foundation import DataError, InputError, MissingFileError, from_table, to_table
from swashtwin.monitoring.config.settings import PageSettings
from swashtwin.monitoring.sources.spool import lock_file

LEAST_PASSWORD = 10
"""Characters that a password needs."""

_NAME = re.compile(r"[\w.@ -]{1,64}")
_HASHER = PasswordHasher()
_CHECKING = threading.Lock()
"""One password at a time: a check takes 64 MiB."""

Kind = Literal["person", "token", "control"]
"""People see and acknowledge; tokens read and upload; tokens for control acknowledge, silence and
note events too.
"""


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One person or program."""

    name: str
    kind: Kind
    hash: str
    """Of the password or the token."""


def add_user(path: Path, name: str, password: str) -> None:
    """Write a person into the file at `path`, which is created where absent; one of the same name
    is replaced.

    Raises
    ------
    InputError
        A name with signs beyond letters, digits, ``.``, ``@``, ``-`` and space, or a short
        password.
    """
    if not LEAST_PASSWORD <= len(password) <= 1000:
        raise InputError(
            f"The password needs {LEAST_PASSWORD} to 1000 characters; this one has {len(password)}."
        )
    _replace(path, Entry(name, "person", _HASHER.hash(password)))


def add_token(path: Path, name: str, *, control: bool = False) -> str:
    """A fresh token for the program `name`; the file at `path` keeps its hash only, so it can not
    be shown again.

    Parameters
    ----------
    control : whether the program may acknowledge, silence and note events too, and not only read
        and upload.

    Raises
    ------
    InputError
        A name with signs beyond letters, digits, ``.``, ``@``, ``-`` and space.
    """
    token = f"st_{secrets.token_urlsafe(32)}"
    _replace(path, Entry(name, "control" if control else "token", _digest(token)))
    return token


def remove_entry(path: Path, name: str) -> None:
    """Take the person and the token called `name` out of the file at `path`.

    Raises
    ------
    InputError
        Nobody there has that name.
    """
    with _changing(path) as entries:
        kept = [entry for entry in entries if entry.name != name]
        if len(kept) == len(entries):
            raise InputError(f"{path} has no user and no token called {name!r}.")
        entries[:] = kept


@dataclass
class UserFile:
    """The file as the page asks it; read again whenever it changed."""

    path: Path
    """Where it is."""
    _stamp: tuple[int, int, int] | None = field(default=None, init=False)
    _entries: list[Entry] = field(default_factory=list, init=False)

    def mark(self, name: str) -> str | None:
        """Text that changes with the password of the person `name` and does not tell it; None where
        nobody's name.
        """
        return None if (known := self._hash(name)) is None else _digest(known)

    def checked_mark(self, name: str, password: str) -> str | None:
        """Mark of the person `name` where the password is right; takes as long for a name that
        nobody has.
        """
        known = self._hash(name)
        with _CHECKING:
            try:
                _HASHER.verify(known or _nobody(), password[:1000])
            except (VerificationError, InvalidHashError):
                return None
        return None if known is None else _digest(known)

    def program(self, token: str) -> Entry | None:
        """The program whose token this is; None where nobody's."""
        digest = _digest(token)
        programs = [item for item in self.entries() if item.kind != "person"]
        return next((item for item in programs if secrets.compare_digest(item.hash, digest)), None)

    def _hash(self, name: str) -> str | None:
        return next(
            (item.hash for item in self.entries() if (item.kind, item.name) == ("person", name)),
            None,
        )

    def entries(self) -> list[Entry]:
        """People and programs.

        Raises
        ------
        DataError
            The file is damaged or absent.
        """
        try:
            status = self.path.stat()
        except FileNotFoundError:
            raise MissingFileError(
                f"{self.path}: there is no such file of users; write one with swashtwin watch user."
            ) from None
        stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
        if stamp != self._stamp:
            self._entries, self._stamp = _read(self.path), stamp
        return self._entries


@cache
def _nobody() -> str:
    """Hash that is checked for a name that nobody has, so that the answer takes as long; made when
    first needed.
    """
    return _HASHER.hash(secrets.token_hex(16))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _replace(path: Path, new: Entry) -> None:
    if not _NAME.fullmatch(new.name) or new.name != new.name.strip():
        raise InputError(
            f"The name {new.name!r} is none: use up to 64 letters, digits, '.', '@', '-', '_' or spaces, none at the "
            "ends."
        )
    with _changing(path) as entries:
        same = ("person",) if new.kind == "person" else ("token", "control")
        entries[:] = [
            entry for entry in entries if entry.name != new.name or entry.kind not in same
        ] + [new]


@contextmanager
def _changing(path: Path) -> Iterator[list[Entry]]:
    """Entries of the file, to be changed in the block; two commands at once change it one after the
    other.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = path.with_name(f".{path.name}.lock")
    with lock_file(lock):
        _give(lock, path)
        entries = _read(path) if path.exists() else []
        yield entries
        _write(path, entries)


def _read(path: Path) -> list[Entry]:
    try:
        return from_table(json.loads(path.read_text(encoding="utf-8")), list[Entry])
    except ValueError as cause:
        raise DataError(
            f"{path} is no file of users; write one with swashtwin watch user."
        ) from cause


def _give(made: Path, path: Path) -> None:
    """Let what root made belong to the owner of the file at `path`, or of its folder: a service's
    user needs it.
    """
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        owner = (path if path.exists() else path.parent).stat()
        os.chown(made, owner.st_uid, owner.st_gid, follow_symlinks=False)


def _write(path: Path, entries: list[Entry]) -> None:
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(6)}")
    try:
        descriptor = os.open(
            temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600
        )  # never readable by others
        with open(descriptor, "w", encoding="utf-8", newline="\n") as file:
            json.dump(to_table(entries), file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        _give(temporary, path)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


COOKIE = "swashtwin_visit"
SESSION_SECONDS = 12 * 3600.0
"""How long a login lasts without a request [s]."""
LONGEST_SESSION_SECONDS = 7 * 24 * 3600.0
"""How long a login lasts at most [s]."""
FREE_ATTEMPTS = 5
"""Wrong passwords in a row before the first wait."""
FIRST_WAIT = 2.0
"""Length of the first wait [s]; each further wrong password doubles it."""
LONGEST_WAIT = 900.0
"""Longest wait [s], and how long a quiet key is remembered."""
_MOST_KEYS = 10_000
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


class Throttle:
    """Fewer and fewer attempts to log in after wrong passwords, by key, such as an address or a
    user's name.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: OrderedDict[str, tuple[int, float]] = OrderedDict()
        self._lock = threading.Lock()

    def attempt(self, *keys: str) -> int:
        """Whole seconds until the next attempt; 0 where one is made now, which counts as wrong
        until `succeed`.

        So guesses that come at the same time do not all pass before the first is counted.
        """
        now = self._clock()
        with self._lock:
            wait = max(0, *(math.ceil(self._until(key, now) - now) for key in keys))
            if not wait:
                for key in keys:
                    count, last = self._failures.pop(key, (0, now))
                    self._failures[key] = (count + 1 if now - last < LONGEST_WAIT else 1, now)
                _shorten(self._failures, _MOST_KEYS)
            return wait

    def wait(self, *keys: str) -> int:
        """Whole seconds until the next attempt under all of these keys; 0 where it may be made
        now.
        """
        now = self._clock()
        with self._lock:
            return max(0, *(math.ceil(self._until(key, now) - now) for key in keys))

    def succeed(self, *keys: str) -> None:
        """Forget the failures under each key."""
        with self._lock:
            for key in keys:
                self._failures.pop(key, None)

    def _until(self, key: str, now: float) -> float:
        count, last = self._failures.get(key, (0, -math.inf))
        if count < FREE_ATTEMPTS:
            return now
        return last + min(FIRST_WAIT * 2.0 ** min(count - FREE_ATTEMPTS, 20), LONGEST_WAIT)


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
        address, person = request.client.host if request.client else "unknown", _digest(name)
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
            _shorten(self._familiar, _MOST_SESSIONS)
            entry = _Session(name, mark, now + LONGEST_SESSION_SECONDS, now + SESSION_SECONDS)
            self._sessions[_digest(session)] = entry
            _shorten(self._sessions, _MOST_SESSIONS)
        return session

    def logout(self, request: HTTPConnection) -> None:
        """End the session of this request."""
        with self._lock:
            self._sessions.pop(_digest(request.cookies.get(COOKIE, "")), None)

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
            COOKIE, visit, httponly=True, samesite="lax", secure=self.settings.secure, path="/"
        )

    def _session(self, users: UserFile, visit: str) -> str | None:
        """Name of the person whose session has that id; None where it ended or the password is
        another one now.
        """
        now = time.monotonic()
        with self._lock:
            key = _digest(visit)
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


def _shorten(items: OrderedDict[Any, Any], most: int) -> None:
    while len(items) > most:
        items.popitem(last=False)
