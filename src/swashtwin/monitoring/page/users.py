"""Keep the file of users and tokens.

The file is JSON that only its owner can read. If root writes it, it is given to the owner of the
previous file, or else of its folder. A password is kept as an argon2id hash, a token as its
SHA-256: a token has 256 random bits, so a slow hash would add nothing, and each request can be
checked at once.
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

from swashtwin.foundation import (
    DataError,
    FileStamp,
    InputError,
    MissingFileError,
    file_stamp,
    from_table,
    hold_lock,
    to_table,
)

MIN_PASSWORD_LENGTH = 10
"""Minimum length of a password, in characters."""
MAX_PASSWORD_LENGTH = 1000
"""Maximum length of a password, in characters; it bounds the time of one hash."""

_NAME = re.compile(r"[\w.@ -]{1,64}")
_HASHER = PasswordHasher()

# Held while a password is checked: a check takes 64 MiB, so they run one after the other.
_CHECK_LOCK = threading.Lock()

Kind = Literal["person", "token", "control"]
"""A person sees and acknowledges. A token reads and uploads; a token for control may also
acknowledge, silence and add events.
"""


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One person or program."""

    name: str
    """Name."""
    kind: Kind
    """What the entry may do."""
    hash: str
    """Hash of the password or of the token."""


def add_user(path: Path, name: str, password: str) -> None:
    """Add a person to a file of users, or replace the person's password.

    Parameters
    ----------
    path : file of users; it is created if absent.

    Raises
    ------
    InputError
        The name is invalid, or the password is too short or too long.
    """
    if not MIN_PASSWORD_LENGTH <= len(password) <= MAX_PASSWORD_LENGTH:
        raise InputError(
            f"The password has {len(password)} characters; use {MIN_PASSWORD_LENGTH} to"
            f" {MAX_PASSWORD_LENGTH}."
        )
    _replace_entry(path, Entry(name, "person", _HASHER.hash(password)))


def add_token(path: Path, name: str, *, control: bool = False) -> str:
    """Add a program to a file of users and return its new token.

    The file keeps only the token's hash, so the token cannot be shown again.

    Parameters
    ----------
    path : file of users; it is created if absent.
    control : whether the program may also acknowledge, silence and add events.

    Raises
    ------
    InputError
        The name is invalid.
    """
    token = f"st_{secrets.token_urlsafe(32)}"
    kind: Kind = "token"
    if control:
        kind = "control"
    _replace_entry(path, Entry(name, kind, digest(token)))
    return token


def remove_entry(path: Path, name: str) -> None:
    """Remove the person and the token of a name from a file of users.

    Raises
    ------
    InputError
        No entry has that name.
    """
    with _editing(path) as entries:
        remaining_entries = [entry for entry in entries if entry.name != name]
        if len(remaining_entries) == len(entries):
            raise InputError(f"{path} has no user and no token called {name!r}.")

        entries[:] = remaining_entries


@dataclass
class UserFile:
    """A file of users; it is read again whenever it changed."""

    path: Path
    """Path of the file."""
    _stamp: FileStamp | None = field(default=None, init=False)
    _entries: list[Entry] = field(default_factory=list, init=False)

    def mark(self, name: str) -> str | None:
        """Return a text that changes with a person's password; `None` if nobody has the name."""
        password_hash = self._password_hash(name)
        if password_hash is None:
            return None
        return digest(password_hash)

    def checked_mark(self, name: str, password: str) -> str | None:
        """Return a person's mark if the password is right, else `None`.

        The check takes as long for a name that nobody has, so its time does not reveal names.
        """
        password_hash = self._password_hash(name)
        with _CHECK_LOCK:
            try:
                _HASHER.verify(password_hash or _decoy_hash(), password[:MAX_PASSWORD_LENGTH])
            except (VerificationError, InvalidHashError):
                return None

        if password_hash is None:
            return None
        return digest(password_hash)

    def program(self, token: str) -> Entry | None:
        """Return the program that has this token; `None` if no program has it."""
        token_hash = digest(token)
        for entry in self.entries():
            if entry.kind != "person" and secrets.compare_digest(entry.hash, token_hash):
                return entry
        return None

    def _password_hash(self, name: str) -> str | None:
        for entry in self.entries():
            if entry.kind == "person" and entry.name == name:
                return entry.hash
        return None

    def entries(self) -> list[Entry]:
        """Return people and programs.

        Raises
        ------
        DataError
            The file is damaged or absent.
        """
        try:
            stamp = file_stamp(self.path)
        except MissingFileError:
            raise MissingFileError(
                f"{self.path}: no such file of users; create it with swashtwin watch user."
            ) from None

        if stamp != self._stamp:
            self._entries = _read_entries(self.path)
            self._stamp = stamp
        return self._entries


def digest(text: str) -> str:
    """Return the SHA-256 of a text as hexadecimal digits."""
    # A header may hold lone surrogates, which the strict encoder refuses.
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


@cache
def _decoy_hash() -> str:
    """Return the hash that is checked for a name that nobody has."""
    return _HASHER.hash(secrets.token_hex(16))


def _replace_entry(path: Path, entry: Entry) -> None:
    if not _NAME.fullmatch(entry.name) or entry.name != entry.name.strip():
        raise InputError(
            f"Invalid name {entry.name!r}: use up to 64 letters, digits, '.', '@', '-', '_' or"
            " spaces, with no space at the ends."
        )

    is_person = entry.kind == "person"
    with _editing(path) as entries:
        # A person and a program may share a name; two programs may not.
        entries[:] = [
            present
            for present in entries
            if present.name != entry.name or (present.kind == "person") is not is_person
        ]
        entries.append(entry)


@contextmanager
def _editing(path: Path) -> Iterator[list[Entry]]:
    """Yield the entries of a file, and write what the block makes of them.

    A lock lets two commands edit the file one after the other.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lock_path = path.with_name(f".{path.name}.lock")
    with hold_lock(lock_path):
        _give_to_owner(lock_path, path)
        entries: list[Entry] = []
        if path.exists():
            entries = _read_entries(path)
        yield entries
        _write_entries(path, entries)


def _read_entries(path: Path) -> list[Entry]:
    try:
        return from_table(json.loads(path.read_text(encoding="utf-8")), list[Entry])
    except ValueError as cause:
        raise DataError(
            f"{path} is not a file of users of this swashtwin ({str(cause)[:200].rstrip('.')}); "
            "create one with swashtwin watch user."
        ) from cause


def _write_entries(path: Path, entries: list[Entry]) -> None:
    temporary_path = path.with_name(f".{path.name}-{secrets.token_hex(6)}")
    try:
        # The mode is set when the file is created, so nobody else can read it at any time.
        descriptor = os.open(temporary_path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "w", encoding="utf-8", newline="\n") as file:
            # On the disk before it replaces the file: after a power failure there is one of both.
            json.dump(to_table(entries), file, indent=1)
            file.flush()
            os.fsync(file.fileno())

        _give_to_owner(temporary_path, path)
        temporary_path.replace(path)
    finally:
        temporary_path.unlink(missing_ok=True)


def _give_to_owner(new_path: Path, path: Path) -> None:
    """Give a file that root made to the owner of `path`, or else of its folder.

    Without this, a service that runs as its own user could not read what root wrote for it.
    """
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        owner = (path if path.exists() else path.parent).stat()
        os.chown(new_path, owner.st_uid, owner.st_gid, follow_symlinks=False)
