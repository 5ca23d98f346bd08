"""The index file ``recordings.toml``, which states what each file is: reading it."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    SwashTwinError,
    closest_name,
    describe_toml_error,
    from_table,
    plain_text,
    read_text,
    shell_command,
    spell_for_index,
)
from swashtwin.pump import is_same_class
from swashtwin.recordings.entry import Entry
from swashtwin.recordings.file_loading import load_entry
from swashtwin.recordings.findings import Finding
from swashtwin.recordings.formats.raw_file import Text
from swashtwin.recordings.hdf5_store import is_store
from swashtwin.recordings.recording import Recording

INDEX_NAME = "recordings.toml"


class _Index(msgspec.Struct, forbid_unknown_fields=True):
    format: int
    recording: list[dict[str, Any]]
    classes: list[Text] = []
    root: str = ""
    fault_of: dict[str, str] = {}
    defaults: dict[str, Any] = {}


def find_index(path: Path) -> Path:
    """Return the index file: `path` itself, or ``recordings.toml`` in the folder `path`."""
    if path.is_dir():
        path = path / INDEX_NAME
    if not path.is_file():
        raise MissingFileError(
            f"{path} does not exist; propose one with: {shell_command('index', path.parent)}"
        )
    if path.suffix != ".toml":
        raise DataError(
            f"{path} is not an index (recordings.toml); swashtwin index FOLDER writes one."
        )
    return path


def read_index(index: Path) -> dict[str, Any]:
    """Return the content of an index file as TOML has it.

    Raises
    ------
    DataError
        It is damaged, or not an index of this version.
    """
    text = read_text(index)
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as cause:  # also numbers of thousands of digits
        raise DataError(f"{index} is not valid TOML: {describe_toml_error(cause)}") from cause

    if table.get("format") != 1 or isinstance(table["format"], bool):  # True equals 1
        raise DataError(
            f"{index}: format = {table.get('format')!r} cannot be read; this version reads "
            "format = 1. Read it with the swashtwin that wrote it, or write it again with: "
            f"{shell_command('index', index.parent)}"
        )
    if not table.get("recording"):
        raise DataError(f"{index} has no [[recording]] entry.")
    try:
        from_table(table, _Index, str(index))
    except InputError as cause:
        raise DataError(str(cause)) from cause
    return table


def read_entries(table: dict[str, Any], index: Path) -> list[Entry]:
    """Return the entries of an index, with its defaults."""
    defaults = table.get("defaults", {})
    entries = []
    for number, values in enumerate(table["recording"], 1):
        entries.append(Entry.from_mapping({**defaults, **values}, f"{index}: entry {number}"))
    return entries


def load_index(
    path: Path,
    unreadable: list[Finding] | None = None,
    *,
    label: str | None = None,
    specimen: str | None = None,
) -> list[Recording]:
    """Return every recording of an index, in its order.

    Parameters
    ----------
    unreadable : receives a finding for each entry that cannot be loaded; by default the first one
        is an error.
    label, specimen : only these; the files of entries that specify others are not opened.
    """
    index = find_index(path)
    table = read_index(index)
    classes = _declared_classes(table)
    root = _index_root(index, table)

    recordings: list[Recording] = []
    files: dict[str, str] = {}
    for entry in read_entries(table, index):
        if not (_may_match(entry.label, label) and _may_match(entry.specimen, specimen)):
            continue
        try:
            recording = load_entry(resolve_index_path(root, entry.file), entry)
            _require_declared_class(recording.label, classes, f"{index}: {entry.file}")
            name = recording.recording_id
            if name in files:
                raise DataError(
                    f"{index}: {files[name]} and {entry.file} have the same id {name!r}; "
                    'give one of them id = "...".'
                )
        except SwashTwinError as cause:
            message = cause.describe(spell_for_index)
            if unreadable is None:
                raise type(cause)(message, field=cause.field) from cause
            unreadable.append(Finding("unreadable", "error", None, message))
            continue
        files[name] = entry.file
        recordings.append(recording)
    return recordings


def _may_match(specified: str | None, selected_label: str | None) -> bool:
    """Return whether an entry may be selected: a file may state what its entry does not."""
    if specified is None or selected_label is None:
        return True
    return is_same_class(plain_text(str(specified)), selected_label)


def _require_declared_class(
    label: str | None, classes: Sequence[str] | None, source_name: str
) -> None:
    if classes is None or label is None or label in classes:
        return

    suggestion = closest_name(label, classes)
    hint = f"did you mean {suggestion!r}?" if suggestion else f"classes = {list(classes)}."
    raise DataError(f"{source_name} has the unknown class {label!r}; {hint}")


def source_files(path: str | Path) -> list[Path]:
    """Return the files that a source is read from.

    They are an index and all files that it names, or one file or store, which is itself.
    """
    path = Path(path)
    if not (path.is_dir() or path.suffix == ".toml"):
        return [path]

    index = find_index(path)
    table = read_index(index)
    root = _index_root(index, table)
    return [index, *(resolve_index_path(root, entry.file) for entry in read_entries(table, index))]


def _index_root(index: Path, table: dict[str, Any]) -> Path:
    return resolve_index_path(index.parent, str(table.get("root", "")))


def resolve_index_path(folder: Path, name: str) -> Path:
    """Return the file or folder that an index names below `folder`.

    The name may be written with backslashes, as Windows does it, on every system.
    """
    path = folder / name
    if "\\" not in name or path.exists():
        return path
    return folder / name.replace("\\", "/")


def declared_classes(path: str | Path) -> tuple[str, ...] | None:
    """Return the classes that an index declares, also those without recordings.

    None if it declares none.
    """
    path = Path(path)
    return None if is_store(path) else _declared_classes(read_index(find_index(path)))


def declared_faults(path: str | Path) -> dict[str, str]:
    """Return the fault of each class of an index, from its table ``[fault_of]``."""
    path = Path(path)
    return {} if is_store(path) else dict(read_index(find_index(path)).get("fault_of", {}))


def _declared_classes(table: dict[str, Any]) -> tuple[str, ...] | None:
    if "classes" not in table:
        return None
    return tuple(plain_text(name) for name in table["classes"])
