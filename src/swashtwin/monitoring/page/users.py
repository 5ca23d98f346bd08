"""Keep the file of users and tokens.

People and programs are in one JSON file that only its owner can read: where root writes it, the
owner of the file before or of its folder. A password is kept as an argon2id hash, a token as its
SHA-256: a token has 256 random bits, so that no slow hash is needed and each request can be checked
at once.
"""

import hashlib
import json
import os
import re
import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec
from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from swashtwin.foundation import DataError, InputError, MissingFileError, from_table, to_table
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
    _replace(path, Entry(name, "control" if control else "token", digest(token)))
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
        return None if (known := self._hash(name)) is None else digest(known)

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
        return None if known is None else digest(known)

    def program(self, token: str) -> Entry | None:
        """The program whose token this is; None where nobody's."""
        token_hash = digest(token)
        programs = [item for item in self.entries() if item.kind != "person"]
        return next(
            (item for item in programs if secrets.compare_digest(item.hash, token_hash)), None
        )

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


def digest(text: str) -> str:
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
