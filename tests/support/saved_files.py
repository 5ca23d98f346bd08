"""Stored keys and the version of saved files, and how either is changed.

The key of an entry is the path to it, such as ``card.history[].loss``; all entries of a list are one.
"""

import json
import re
import sqlite3
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomli_w
from safetensors import safe_open

from swashtwin.foundation import read_artifact, write_artifact


class SavedFile(ABC):
    """A kind of file: where its stored keys and its version are."""

    @abstractmethod
    def keys(self, path: Path) -> list[str]:
        """The stored keys of a file."""

    @abstractmethod
    def version(self, path: Path) -> str:
        """The version of a file as it stores it; empty if it stores none."""

    @abstractmethod
    def rename(self, path: Path, key: str, new_name: str | None) -> None:
        """Rename a key, which keeps its value, or remove it with the value."""

    @abstractmethod
    def set_version(self, path: Path, version: str) -> None:
        """Change the version that a file stores."""


class Tables(SavedFile):
    """A file of nested tables.

    Parameters
    ----------
    data : keys of tables whose own keys are data, such as names of recordings.
    version_key : key of the version at the top; empty if none is stored.
    """

    def __init__(self, *, version_key: str = "", data: tuple[str, ...] = ()) -> None:
        self.version_key = version_key
        self._data = data

    @abstractmethod
    def read(self, path: Path) -> Any:
        """The tables of a file."""

    @abstractmethod
    def write(self, path: Path, tables: Any) -> None:
        """Write the tables of a file."""

    def keys(self, path: Path) -> list[str]:
        return sorted(set(self._keys(self.read(path), "")))

    def _keys(self, tables: Any, key: str) -> Iterator[str]:
        if isinstance(tables, list):
            for entry in tables:
                yield from self._keys(entry, f"{key}[]")
        elif isinstance(tables, dict) and key not in self._data:
            for name, entry in tables.items():
                inner_key = f"{key}.{name}" if key else name
                yield inner_key
                yield from self._keys(entry, inner_key)

    def version(self, path: Path) -> str:
        return str(self.read(path)[self.version_key]) if self.version_key else ""

    def rename(self, path: Path, key: str, new_name: str | None) -> None:
        tables = self.read(path)
        parent_key, _, name = key.rpartition(".") if "." in key else ("", "", key)
        renamed = [_rename(table, name, new_name) for table in _tables_at(tables, parent_key)]
        assert any(renamed), key
        self.write(path, tables)

    def set_version(self, path: Path, version: str) -> None:
        tables = self.read(path)
        kind = type(tables[self.version_key])
        tables[self.version_key] = kind(version)
        self.write(path, tables)


def _rename(table: dict[str, Any], name: str, new_name: str | None) -> bool:
    if name not in table:
        return False
    value = table.pop(name)
    if new_name is not None:
        table[new_name] = value
    return True


def _tables_at(tables: Any, key: str) -> list[dict[str, Any]]:
    """All tables at a key, which lists have several of."""
    selected = [tables]
    # A list within a list gives one step each.
    for step in re.findall(r"\[\]|[^.\[\]]+", key):
        inner: list[Any] = []
        for table in selected:
            if step == "[]":
                inner += table if isinstance(table, list) else []
            elif isinstance(table, dict) and table.get(step) is not None:
                inner.append(table[step])
        selected = inner
    return [table for table in selected if isinstance(table, dict)]


class JsonFile(Tables):
    """A JSON file."""

    def read(self, path: Path) -> Any:
        return json.loads(path.read_text(encoding="utf-8"))

    def write(self, path: Path, tables: Any) -> None:
        path.write_text(json.dumps(tables), encoding="utf-8")


class ColumnsFile(JsonFile):
    """A JSON file of columns of a database, whose names are keys of the database."""

    def keys(self, path: Path) -> list[str]:
        return [key for key in super().keys(path) if "." in key]


class TomlFile(Tables):
    """A TOML file."""

    def read(self, path: Path) -> Any:
        return tomllib.loads(path.read_text(encoding="utf-8"))

    def write(self, path: Path, tables: Any) -> None:
        path.write_text(tomli_w.dumps(tables), encoding="utf-8")


class Artifact(Tables):
    """A safetensors file of a card and arrays; arrays that the card does not name are keys too."""

    def __init__(self, kind: str, *, data: tuple[str, ...] = ()) -> None:
        super().__init__(version_key="version", data=(*data, "arrays"))
        self._kind = kind

    def read(self, path: Path) -> Any:
        with safe_open(path, framework="np") as file:
            header = json.loads(file.metadata()["swashtwin"])
        version = header["version"]
        card, arrays = read_artifact(path, self._kind, version, advice="", may_be_nan=None)
        return {"version": version, "card": card, "arrays": arrays}

    def write(self, path: Path, tables: Any) -> None:
        write_artifact(
            path,
            self._kind,
            tables["version"],
            tables["card"],
            tables["arrays"],
            may_be_nan=None,
        )

    def _keys(self, tables: Any, key: str) -> Iterator[str]:
        if isinstance(tables, dict) and [*tables] == ["array"]:
            return
        if not key:
            yield from super()._keys(tables["card"], "card")
            named = json.dumps(tables["card"])
            for name in tables["arrays"]:
                if json.dumps({"array": name}) not in named:
                    yield f"arrays.{name}"
            return
        yield from super()._keys(tables, key)


class HistoryFile(SavedFile):
    """A watch history in SQLite: its keys are the columns of its tables."""

    def keys(self, path: Path) -> list[str]:
        with closing(sqlite3.connect(path)) as connection:
            rows = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            tables = [name for (name,) in rows if not name.startswith("sqlite_")]
            columns = {
                table: [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
                for table in tables
            }
        return sorted(f"{table}.{name}" for table in tables for name in columns[table])

    def version(self, path: Path) -> str:
        with closing(sqlite3.connect(path)) as connection:
            row = connection.execute("SELECT version FROM swashtwin_history").fetchone()
        return str(row[0])

    def rename(self, path: Path, key: str, new_name: str | None) -> None:
        # SQLite drops no column of an index or a key, so that a removed one is renamed as well.
        table, name = key.split(".")
        change = f'RENAME COLUMN "{name}" TO "{new_name or "removed"}"'
        self._execute(path, f"ALTER TABLE {table} {change}")

    def set_version(self, path: Path, version: str) -> None:
        self._execute(path, f"UPDATE swashtwin_history SET version = {version}")

    def _execute(self, path: Path, statement: str) -> None:
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute(statement)


class RecordingFile(SavedFile):
    """An HDF5 file of one recording, or a store: its keys are the data sets and attributes."""

    def __init__(self, *, is_store: bool) -> None:
        self._is_store = is_store

    def _group(self, file: h5py.File) -> h5py.Group:
        return file["000000"] if self._is_store else file

    def keys(self, path: Path) -> list[str]:
        with h5py.File(path) as file:
            group = self._group(file)
            return sorted([*group, *group.attrs])

    def version(self, path: Path) -> str:
        with h5py.File(path) as file:
            return bytes(file.attrs["format"]).decode()

    def rename(self, path: Path, key: str, new_name: str | None) -> None:
        with h5py.File(path, "r+") as file:
            group = self._group(file)
            owner = group if key in group else group.attrs
            if new_name is not None:
                owner[new_name] = owner[key]
            del owner[key]

    def set_version(self, path: Path, version: str) -> None:
        # Written anew, since a longer attribute would not stay at the start of the file.
        original = path.rename(path.with_suffix(".original"))
        with h5py.File(original) as source, h5py.File(path, "w") as file:
            file.attrs["format"] = np.bytes_(version.encode())
            for name, value in source.attrs.items():
                if name != "format":
                    file.attrs[name] = value
            for name in source:
                source.copy(name, file)
        original.unlink()
