"""People and programs that may use the page, in one JSON file that only its owner can read: where root writes it, the
owner of the file before or of its folder.

A password is kept as an argon2id hash, a token as its SHA-256: a token has 256 random bits, so that no slow hash is
needed and each request can be checked at once.
"""

import hashlib
import json
import os
import re
import secrets
import threading
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from swashtwin.foundation import DataError, InputError, MissingFileError

LEAST_PASSWORD = 10
"""Characters that a password needs."""

_NAME = re.compile(r"[\w.@ -]{1,64}")
_FORM = "swashtwin-page-users-1"
_HASHER = PasswordHasher()
_KINDS = ("users", "tokens", "control")
"""People; programs that read and upload; programs that also acknowledge, silence and note events."""
_CHECKING = threading.Lock()
"""One password at a time: a check takes 64 MiB."""


def add_user(path: Path, name: str, password: str) -> None:
    """Write a person into the file at `path`, which is created where absent; one of the same name is replaced.

    Raises
    ------
    InputError
        A name with signs beyond letters, digits, ``.``, ``@``, ``-`` and space, or a short password.
    """
    if not LEAST_PASSWORD <= len(password) <= 1000:
        raise InputError(f"The password needs {LEAST_PASSWORD} to 1000 characters; this one has {len(password)}.")
    _change(path, "users", name, _HASHER.hash(password))


def add_token(path: Path, name: str, *, control: bool = False) -> str:
    """A fresh token for the program `name`; the file at `path` keeps its hash only, so it can not be shown again.

    Parameters
    ----------
    control : whether the program may acknowledge, silence and note events too, and not only read and upload.

    Raises
    ------
    InputError
        A name with signs beyond letters, digits, ``.``, ``@``, ``-`` and space.
    """
    token = f"st_{secrets.token_urlsafe(32)}"
    _change(path, "control" if control else "tokens", name, _digest(token))
    return token


def remove_entry(path: Path, name: str) -> None:
    """Take the person and the token called `name` out of the file at `path`.

    Raises
    ------
    InputError
        Nobody there has that name.
    """
    entries = _read(path)
    if not any(name in entries[kind] for kind in _KINDS):
        raise InputError(f"{path} has no user and no token called {name!r}.")
    for kind in _KINDS:
        entries[kind].pop(name, None)
    _write(path, entries)


@dataclass
class UserFile:
    """The file as the page asks it; read again whenever it changed."""

    path: Path
    """Where it is."""
    _stamp: tuple[int, int, int] | None = field(default=None, init=False)
    _entries: dict[str, dict[str, str]] = field(default_factory=dict, init=False)

    def count(self) -> int:
        """Number of people and tokens.

        Raises
        ------
        DataError
            The file is damaged or absent.
        """
        return sum(map(len, self._current().values()))

    def mark(self, name: str) -> str | None:
        """Text that changes with the password of the person `name` and does not tell it; None where nobody's name."""
        stored = self._current()["users"].get(name)
        return None if stored is None else _digest(stored)

    def checked_mark(self, name: str, password: str) -> str | None:
        """Mark of the person `name` where the password is right; takes as long for a name that nobody has."""
        stored = self._current()["users"].get(name)
        with _CHECKING:
            try:
                _HASHER.verify(stored or _nobody(), password[:1000])
            except (VerificationError, InvalidHashError):
                return None
        return None if stored is None else _digest(stored)

    def token_name(self, token: str, *, control: bool) -> str | None:
        """Name of the program whose token this is, among those with `control` or the others; None where nobody's."""
        digest, entries = _digest(token), self._current()["control" if control else "tokens"]
        names = [name for name, stored in entries.items() if secrets.compare_digest(stored, digest)]
        return names[0] if names else None

    def _current(self) -> dict[str, dict[str, str]]:
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
    """Hash that is checked for a name that nobody has, so that the answer takes as long; made when first needed."""
    return _HASHER.hash(secrets.token_hex(16))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _change(path: Path, kind: str, name: str, value: str) -> None:
    if not _NAME.fullmatch(name) or name != name.strip():
        raise InputError(
            f"The name {name!r} is none: use up to 64 letters, digits, '.', '@', '-', '_' or spaces, none at the ends."
        )
    entries = _read(path) if Path(path).exists() else {kind: {} for kind in _KINDS}
    if kind != "users":  # a program has one token
        for others in _KINDS[1:]:
            entries[others].pop(name, None)
    entries[kind][name] = value
    _write(path, entries)


def _read(path: Path) -> dict[str, dict[str, str]]:
    try:
        content: Any = json.loads(Path(path).read_text(encoding="utf-8"))
        entries = {kind: content[kind] for kind in _KINDS[:2]} | {"control": content.get("control", {})}
        is_ours = content["form"] == _FORM and all(
            isinstance(named, dict) and all(isinstance(value, str) for value in named.values())
            for named in entries.values()
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        is_ours = False
    if not is_ours:
        raise DataError(f"{path} is no file of users; write one with swashtwin watch user.")
    return entries


def _write(path: Path, entries: dict[str, dict[str, str]]) -> None:
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    owner = (path if path.exists() else path.parent).stat()
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(6)}")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)  # never readable by others
        with open(descriptor, "w", encoding="utf-8", newline="\n") as file:
            json.dump({"form": _FORM, **entries}, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        if hasattr(os, "geteuid") and os.geteuid() == 0:  # else the user of a service could not read what root wrote
            os.chown(temporary, owner.st_uid, owner.st_gid)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
