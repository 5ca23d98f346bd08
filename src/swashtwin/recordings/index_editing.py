"""Facts of an index that are edited while others may edit them too: checked, merged, and written whole."""

import copy
import os
import re
import threading
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, InputError, parse, read_text, write_text
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.index import index_table, save_index

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_LOCK = threading.Lock()
_HEADING = re.compile(r"^[ \t]*\[\[[ \t]*recording[ \t]*\]\][ \t]*(#.*)?$", re.MULTILINE)


@dataclass(frozen=True)
class FactChange:
    """One fact of one entry, as it was seen and as it shall be."""

    entry: str
    """Id of the entry, or its file where it states none."""
    fact: str
    """Key of an `Entry`, such as ``label``."""
    before: Any
    """What the entry, or the index's defaults, stated when it was looked at; None for nothing."""
    after: Any
    """What it shall state; None for nothing."""


def change_facts(
    path: Path, changes: Sequence[FactChange], *, proposed: Mapping[str, Any] | None = None, undo: bool = False
) -> None:
    """Write changed facts into an index; comments stay where only lines of facts change.

    Changes by others of other facts are merged. Where somebody changed one of these facts since it was looked at,
    nothing is written.

    Parameters
    ----------
    proposed : what the index holds where there is no file yet.
    undo : take a class that no recording has any more out of the index's classes.

    Raises
    ------
    InputError
        A fact is not any more what it was before, or an entry is there no more.
    DataError, UnitError
        A value cannot be.
    """
    with _alone(path.parent):
        text = read_text(path) if path.is_file() or proposed is None else None
        table = index_table(path) if text is not None else copy.deepcopy(dict(proposed or {}))
        edited = copy.deepcopy(table)
        for change in changes:
            _apply(edited, change, path, undo=undo)
        content = None if text is None else _edited_text(text, table, edited)
        if (read_text(path) if path.is_file() else None) != text:
            raise InputError(f"{path} is being changed by another program; look again, and repeat the change.")
        save_index(edited, path) if content is None else write_text(path, content)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Within it no other thread or process changes facts of an index in `folder`."""
    with _LOCK:
        handle = None if fcntl is None else os.open(folder, os.O_RDONLY)
        try:
            if handle is not None:
                with suppress(OSError):  # a file system without locks
                    fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            if handle is not None:
                os.close(handle)


def _apply(table: dict[str, Any], change: FactChange, path: Path, *, undo: bool) -> None:
    entries = [entry for entry in table["recording"] if change.entry in (entry.get("id"), entry.get("file"))]
    if len(entries) != 1:
        raise InputError(f"{path} has {len(entries)} entries {change.entry!r} now; load it again.")
    (entry,), defaults = entries, table.get("defaults", {})
    stated = {**defaults, **entry}.get(change.fact)
    if stated != change.before:
        raise InputError(
            f"{change.entry}: {change.fact} was {change.before!r} and is {stated!r} now, since another window or "
            "program changed it; nothing was written."
        )
    where = f"{path}: {change.entry}"
    if change.after is None:
        if change.fact in defaults:
            raise InputError(f"{where}: {change.fact} is stated for all, in [defaults]; state another value.")
        entry.pop(change.fact, None)
    else:
        entry[change.fact] = change.after
        Entry.from_mapping({**defaults, **entry}, where)
        if change.fact in QUANTITIES and parse(change.after, QUANTITIES[change.fact], name=change.fact) <= 0:
            raise DataError(f"{where}: {change.fact} = {change.after!r} must be above zero.")
    if change.fact == "label" and "classes" in table:
        labels = [item.get("label") for item in table["recording"]]
        classes = [name for name in table["classes"] if not (undo and name == change.before) or name in labels]
        table["classes"] = classes + [change.after] * (change.after is not None and change.after not in classes)


def _edited_text(text: str, table: Mapping[str, Any], edited: Mapping[str, Any]) -> str | None:
    """`text` with only the lines of changed facts replaced; None where that does not give the edited table."""
    starts = [match.start() for match in _HEADING.finditer(text)]
    if len(starts) != len(edited["recording"]):
        return None
    head, *parts = (text[start:end] for start, end in zip([0, *starts], [*starts, len(text)], strict=True))
    if table.get("classes") != edited.get("classes"):
        head = _with_line(head, "classes", edited["classes"])
    for number, (old, new) in enumerate(zip(table["recording"], edited["recording"], strict=True)):
        for fact in sorted(old.keys() | new.keys()):
            if old.get(fact) != new.get(fact):
                parts[number] = _with_line(parts[number], fact, new.get(fact))
    content = head + "".join(parts)
    with suppress(tomllib.TOMLDecodeError):
        return content if tomllib.loads(content) == edited else None
    return None


def _with_line(part: str, fact: str, value: Any) -> str:
    """`part` of an index with the line of a fact replaced, added below that of the file, or without it."""
    import tomli_w

    line = "" if value is None else tomli_w.dumps({fact: value})
    stated = re.compile(rf"^[ \t]*{re.escape(fact)}[ \t]*=[ \t]*(\[[^\]]*\]|.*)[^\n]*(\n|\Z)", re.MULTILINE)
    if stated.search(part):
        return stated.sub(lambda _: line, part, count=1)
    file = re.compile(r"^[ \t]*file[ \t]*=.*(\n|\Z)", re.MULTILINE)
    return file.sub(lambda match: f"{match[0].rstrip()}\n{line}", part, count=1)
