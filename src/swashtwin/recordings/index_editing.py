"""The index file ``recordings.toml``: changing facts of entries, several programs at once."""

import copy
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swashtwin.foundation import (
    DataError,
    InputError,
    hold_lock,
    parse_quantity,
    read_text,
    write_text,
)
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.index_reading import read_index
from swashtwin.recordings.index_writing import save_index

# Time between attempts to take the lock: an edit takes about as long.
_LOCK_POLL_INTERVAL_S = 0.01


@dataclass(frozen=True)
class FactChange:
    """One fact of one entry: its previous and its new value."""

    entry: str
    """Id of the entry, or its file if it has no id."""
    fact: str
    """Key of an `Entry`, such as ``label``."""
    previous: Any
    """Value of the entry, or of the index's defaults, when it was shown; None for no value."""
    value: Any
    """New value; None to remove the fact."""


def change_facts(
    path: Path,
    changes: Sequence[FactChange],
    *,
    proposed: Mapping[str, Any] | None = None,
    undo: bool = False,
) -> None:
    """Write changed facts into an index; its comments and layout stay.

    Changes of other facts by other programs are merged. If one of these facts was changed since it
    was shown, nothing is written.

    Parameters
    ----------
    proposed : content of the index if there is no file yet.
    undo : remove a class that no recording has any more from the index's classes.

    Raises
    ------
    InputError
        A fact is not its previous value any more, or an entry does not exist any more.
    DataError, UnitError
        A value is invalid.
    """
    # The index itself is replaced when it is written, so it cannot be what is locked.
    lock_path = path.with_name(f".{path.name}.lock")
    with hold_lock(lock_path, poll_interval_s=_LOCK_POLL_INTERVAL_S):
        text = _read_if_exists(path)
        is_new = text is None and proposed is not None
        table = dict(proposed or {}) if is_new else read_index(path)

        edited = copy.deepcopy(table)
        for change in changes:
            _apply_change(edited, change, path, undo=undo)
        edited_text = None if text is None else _edit_text(text, table, edited)

        # The lock holds off our own programs only, not a text editor.
        if _read_if_exists(path) != text:
            raise InputError(
                f"{path} was changed by another program; load it again, and repeat the change."
            )
        if edited_text is None:
            save_index(edited, path)
        else:
            write_text(path, edited_text)


def _read_if_exists(path: Path) -> str | None:
    return read_text(path) if path.is_file() else None


def _apply_change(table: dict[str, Any], change: FactChange, path: Path, *, undo: bool) -> None:
    entry = _find_entry(table, change, path)
    defaults = table.get("defaults", {})
    current = {**defaults, **entry}.get(change.fact)
    if current != change.previous:
        raise InputError(
            f"{change.entry}: {change.fact} was {change.previous!r} and is {current!r} now, since "
            "another window or program changed it; nothing was written."
        )

    source_name = f"{path}: {change.entry}"
    if change.value is None:
        if change.fact in defaults:
            raise InputError(
                f"{source_name}: {change.fact} is specified for all recordings, in [defaults]; "
                "specify another value instead of none."
            )
        entry.pop(change.fact, None)
    else:
        entry[change.fact] = change.value
        Entry.from_mapping({**defaults, **entry}, source_name)
        _require_positive(change, source_name)

    if change.fact == "label" and "classes" in table:
        table["classes"] = _updated_classes(table, change, undo=undo)


def _find_entry(table: dict[str, Any], change: FactChange, path: Path) -> dict[str, Any]:
    entries: list[dict[str, Any]] = []
    for entry in table["recording"]:
        if change.entry in (entry.get("id"), entry.get("file")):
            entries.append(entry)
    if len(entries) != 1:
        raise InputError(f"{path} has {len(entries)} entries {change.entry!r} now; load it again.")
    return entries[0]


def _require_positive(change: FactChange, source_name: str) -> None:
    if change.fact not in QUANTITIES:
        return
    if parse_quantity(change.value, QUANTITIES[change.fact], name=change.fact) <= 0:
        raise DataError(f"{source_name}: {change.fact} ({change.value}) must be above zero.")


def _updated_classes(table: Mapping[str, Any], change: FactChange, *, undo: bool) -> list[str]:
    """Return the classes with the new label, and without one that an undone change added."""
    labels = [entry.get("label") for entry in table["recording"]]
    classes = list(table["classes"])
    if undo and change.previous in classes and change.previous not in labels:
        classes.remove(change.previous)
    if change.value is not None and change.value not in classes:
        classes.append(change.value)
    return classes


def _edit_text(text: str, table: Mapping[str, Any], edited: Mapping[str, Any]) -> str | None:
    """Return the text of an index with the differences of two tables applied.

    None if the text cannot be edited, so that it has to be written anew.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        document = tomlkit.parse(text)
        _edit_document(document, table, edited)
    except TOMLKitError:  # it is stricter than tomllib about rare forms
        return None

    edited_text = document.as_string()
    return edited_text if tomllib.loads(edited_text) == edited else None


def _edit_document(document: Any, table: Mapping[str, Any], edited: Mapping[str, Any]) -> None:
    """Apply the differences of two tables to a tomlkit document."""
    previous_classes = table.get("classes", [])
    classes = edited.get("classes", [])
    for name in previous_classes:
        if name not in classes:
            document["classes"].remove(name)
    for name in classes:
        if name not in previous_classes:
            document["classes"].append(name)

    entries = zip(document["recording"], table["recording"], edited["recording"], strict=True)
    for entry, previous_facts, facts in entries:
        for fact in sorted(previous_facts.keys() | facts.keys()):
            if previous_facts.get(fact) != facts.get(fact):
                _edit_fact(entry, fact, facts.get(fact))


def _edit_fact(entry: Any, fact: str, value: Any) -> None:
    """Set or remove one fact of an entry of a tomlkit document."""
    import tomlkit
    from tomlkit.items import Table

    if value is None:
        entry.remove(fact)
    elif fact in entry or not isinstance(entry, Table):
        entry[fact] = value
    else:
        # tomlkit has no public way to insert. Appending would put the fact behind comments at the
        # end of the entry, which often belong to the next one.
        entry.value._insert_after("file", fact, tomlkit.item(value))
