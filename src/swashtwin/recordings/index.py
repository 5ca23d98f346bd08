"""The index file ``recordings.toml``: one entry per file, what each file is, and facts that are
edited.
"""

import copy
import os
import re
import threading
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import msgspec

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    SwashTwinError,
    from_table,
    parse_quantity,
    plain_text,
    read_text,
    sha256_of,
    write_text,
)
from swashtwin.pump import format_quantity, is_same_class
from swashtwin.recordings.channel_checks import Finding
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.fact_extraction import is_positive_quantity
from swashtwin.recordings.files import is_store, stem_of, suffix_of
from swashtwin.recordings.formats.raw_file import Text
from swashtwin.recordings.loading import PUMP_KEYS, load_entry
from swashtwin.recordings.recording import Recording, require_unique_ids

INDEX_NAME = "recordings.toml"
_NO_UNICODE = re.compile(r"[^\"\n]*[\ud800-\udfff][^\"\n]*")
_LOSSLESS = (".h5", ".hdf5")


def load_index(
    path: Path,
    unreadable: list[Finding] | None = None,
    *,
    label: str | None = None,
    specimen: str | None = None,
) -> list[Recording]:
    """Every recording of an index, in its order.

    Parameters
    ----------
    unreadable : gets a finding for each entry that cannot be loaded, instead of an error for the
        first.
    label, specimen : only these; the files of entries that state others are not opened.
    """
    index = find_index(path)
    table = read_index(index)
    recordings = []
    files: dict[str, str] = {}
    classes = _classes(table)
    root = resolve_index_path(index.parent, str(table.get("root", "")))
    for entry in _entries(table, index):
        pairs = ((entry.label, label), (entry.specimen, specimen))
        if any(
            None not in pair and not is_same_class(plain_text(str(pair[0])), pair[1])
            for pair in pairs
        ):
            continue
        try:
            recording = load_entry(resolve_index_path(root, entry.file), entry)
            name, label_found = recording.recording_id, recording.label
            if classes is not None and label_found is not None and label_found not in classes:
                near = get_close_matches(label_found, classes, n=1, cutoff=0.4)
                hint = f"did you mean {near[0]!r}?" if near else f"classes = {list(classes)}."
                raise DataError(
                    f"{index}: {entry.file} has the unknown class {label_found!r}; {hint}"
                )
            if name in files:
                raise DataError(
                    f'{index}: {files[name]} and {entry.file} share the id {name!r}; give one id = "...".'
                )
        except SwashTwinError as cause:
            if unreadable is None:
                raise
            unreadable.append(Finding("unreadable", "error", None, str(cause)))
            continue
        files[name] = entry.file
        recordings.append(recording)
    return recordings


def write_index(
    recordings: Sequence[Recording], files: Sequence[str | Path], path: str | Path
) -> Path:
    """Path of the index that now says what each of `files` holds, whose paths are absolute or
    relative to it.

    Parameters
    ----------
    path : index file, or the folder for ``recordings.toml``.
    """
    path = Path(path)
    path = path if path.suffix == ".toml" else path / INDEX_NAME
    if len(recordings) != len(files):
        raise InputError(f"{len(files)} files for {len(recordings)} recordings.")
    require_unique_ids((recording.recording_id for recording in recordings), "an index")
    index: dict[str, Any] = {"format": 1}
    classes = list(
        dict.fromkeys(recording.label for recording in recordings if recording.label is not None)
    )
    if classes:
        index["classes"] = classes
    index["recording"] = [
        _described(recording, Path(file), path.parent)
        for recording, file in zip(recordings, files, strict=True)
    ]
    return save_index(index, path)


def save_index(index: Mapping[str, Any], path: str | Path) -> Path:
    """Path of the index file, which is replaced only when the new one is complete."""
    import tomli_w

    text = tomli_w.dumps(dict(index))
    if name := _NO_UNICODE.search(text):
        raise DataError(
            f"{path}: {name[0]!r} is no name in Unicode, which an index cannot hold; rename the file."
        )
    return write_text(Path(path), text)


def write_subset_index(
    index: Path | str, recordings: Sequence[Recording], ids: Iterable[str], path: Path | str
) -> Path:
    """Path of a new index that holds only the entries of some recordings of `index`.

    A split that is written down so serves calibration, synthesis, training and evaluation alike.

    Parameters
    ----------
    index : folder that holds ``recordings.toml``, or the index file itself.
    recordings : those that `load_recordings` gives for it.
    ids : recordings to keep.
    path : new index file.

    Raises
    ------
    InputError
        `recordings` are not those of `index`, or one of `ids` is not among them.
    """
    source, path = find_index(Path(index)), Path(path)
    table = read_index(source)
    if len(table["recording"]) != len(recordings):
        raise InputError(
            f"{source} has {len(table['recording'])} entries, for {len(recordings)} recordings."
        )
    ids = {str(name) for name in ids}
    missing = sorted(ids - {recording.recording_id for recording in recordings})
    if missing:
        raise InputError(f"{source} has no recording {missing[0]!r}.")
    pairs = zip(table["recording"], recordings, strict=True)
    table["recording"] = [entry for entry, recording in pairs if recording.recording_id in ids]
    root = (source.parent / table.get("root", "")).resolve()
    table.pop("root", None)
    if root != path.parent.resolve():
        table["root"] = relative_path(path.parent.resolve(), root)
    last = ("fault_of", "defaults", "recording")  # tables stand after the plain keys
    return save_index({key: table[key] for key in sorted(table, key=lambda key: key in last)}, path)


def source_files(path: str | Path) -> list[Path]:
    """Files that a source is read from: an index and all that it names, or one file or store, which
    is itself.
    """
    path = Path(path)
    if not (path.is_dir() or path.suffix == ".toml"):
        return [path]
    index = find_index(path)
    table = read_index(index)
    root = resolve_index_path(index.parent, str(table.get("root", "")))
    return [index, *(resolve_index_path(root, entry.file) for entry in _entries(table, index))]


def resolve_index_path(folder: Path, name: str) -> Path:
    """File or folder that an index names below `folder`; on every system it may be written as
    Windows does it.
    """
    path = folder / name
    return path if "\\" not in name or path.exists() else folder / name.replace("\\", "/")


def declared_classes(path: str | Path) -> tuple[str, ...] | None:
    """Classes that an index declares, whether it has recordings of each or not; None where it
    declares none.
    """
    if is_store(Path(path)):
        return None
    return _classes(read_index(find_index(Path(path))))


def declared_faults(path: str | Path) -> dict[str, str]:
    """Fault that each class of an index stands for, as its table ``[fault_of]`` says."""
    return (
        {} if is_store(Path(path)) else dict(read_index(find_index(Path(path))).get("fault_of", {}))
    )


def _classes(table: dict[str, Any]) -> tuple[str, ...] | None:
    return None if "classes" not in table else tuple(plain_text(name) for name in table["classes"])


def find_index(path: Path) -> Path:
    """The index file: `path` itself, or ``recordings.toml`` in the folder `path`."""
    if path.is_dir():
        path = path / INDEX_NAME
    if not path.is_file():
        raise MissingFileError(
            f"{path} does not exist; propose one with: swashtwin index {path.parent}"
        )
    if path.suffix != ".toml":
        raise DataError(
            f"{path} is not an index (recordings.toml); swashtwin index FOLDER writes one."
        )
    return path


def read_index(index: Path) -> dict[str, Any]:
    """What an index file states, as TOML has it.

    Raises
    ------
    DataError
        It is damaged, or no index of this version.
    """
    text = read_text(index)
    try:
        table = tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as cause:  # numbers of thousands of digits, and lists in lists, too
        hint = (
            "; write / between folders, or put a text with \\ into single quotes"
            if "\\" in str(cause)
            else ""
        )
        raise DataError(
            f"{index} is not valid TOML: {(str(cause).splitlines() or [''])[0][:160]}{hint}"
        ) from cause
    if table.get("format") != 1 or isinstance(table["format"], bool):
        raise DataError(
            f"{index}: format = {table.get('format')!r} cannot be read; this version reads format = 1."
        )
    if not table.get("recording"):
        raise DataError(f"{index} has no [[recording]] entry.")
    try:
        from_table(table, _Index, str(index))
    except InputError as cause:
        raise DataError(str(cause)) from cause
    return table


class _Index(msgspec.Struct, forbid_unknown_fields=True):
    format: int
    recording: list[dict[str, Any]]
    classes: list[Text] = []
    root: str = ""
    fault_of: dict[str, str] = {}
    defaults: dict[str, Any] = {}


def _entries(table: dict[str, Any], index: Path) -> list[Entry]:
    defaults = table.get("defaults", {})
    return [
        Entry.from_mapping({**defaults, **values}, where=f"{index}: entry {number}")
        for number, values in enumerate(table["recording"], 1)
    ]


def _described(recording: Recording, file: Path, folder: Path) -> dict[str, Any]:
    """Entry that gives back what the file's format loses."""
    absolute = file if file.is_absolute() else folder / file
    entry: dict[str, Any] = {"file": relative_path(folder, absolute)}
    if recording.recording_id != stem_of(file):
        entry["id"] = recording.recording_id
    entry |= {
        name: getattr(recording, name) for name in ("label", "specimen") if getattr(recording, name)
    }
    if recording.condition is not None:
        values = {key: getattr(recording.condition, field) for key, field in PUMP_KEYS.items()}
        entry |= {key: format_quantity(value, QUANTITIES[key], 15) for key, value in values.items()}
    if recording.synthetic:
        entry["synthetic"] = True
    attributes = {
        key: value for key, value in recording.attributes.items() if key not in ("file", "sha256")
    }
    if suffix_of(file) not in _LOSSLESS:
        entry |= {
            "names": list(recording.channels),
            "sample_rate": f"{recording.sample_rate:.15g} Hz",
        }
        entry["unit"] = recording.unit
        if "discharge_pressure" in attributes:
            attributes["pressure"] = attributes.pop("discharge_pressure")
        stated = [key for key in QUANTITIES if is_positive_quantity(attributes.get(key), key)]
        entry |= {key: attributes.pop(key) for key in stated}
        if attributes:
            entry["attributes"] = attributes
    if absolute.is_file():
        entry["sha256"] = sha256_of(absolute)
    return entry


def relative_path(folder: Path, path: Path) -> str:
    """`path` as an index in `folder` states it: relative, but for another drive of Windows."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.absolute().as_posix()


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
    previous: Any
    """What the entry, or the index's defaults, stated when it was looked at; None for nothing."""
    value: Any
    """What it shall state; None for nothing."""


def change_facts(
    path: Path,
    changes: Sequence[FactChange],
    *,
    proposed: Mapping[str, Any] | None = None,
    undo: bool = False,
) -> None:
    """Write changed facts into an index; comments stay where only lines of facts change.

    Changes by others of other facts are merged. Where somebody changed one of these facts since it
    was looked at, nothing is written.

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
        table = read_index(path) if text is not None else copy.deepcopy(dict(proposed or {}))
        edited = copy.deepcopy(table)
        for change in changes:
            _apply(edited, change, path, undo=undo)
        content = None if text is None else _edited_text(text, table, edited)
        if (read_text(path) if path.is_file() else None) != text:
            raise InputError(
                f"{path} is being changed by another program; look again, and repeat the change."
            )
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
    entries = [
        entry
        for entry in table["recording"]
        if change.entry in (entry.get("id"), entry.get("file"))
    ]
    if len(entries) != 1:
        raise InputError(f"{path} has {len(entries)} entries {change.entry!r} now; load it again.")
    (entry,), defaults = entries, table.get("defaults", {})
    stated = {**defaults, **entry}.get(change.fact)
    if stated != change.previous:
        raise InputError(
            f"{change.entry}: {change.fact} was {change.previous!r} and is {stated!r} now, since another window or "
            "program changed it; nothing was written."
        )
    where = f"{path}: {change.entry}"
    if change.value is None:
        if change.fact in defaults:
            raise InputError(
                f"{where}: {change.fact} is stated for all, in [defaults]; state another value."
            )
        entry.pop(change.fact, None)
    else:
        entry[change.fact] = change.value
        Entry.from_mapping({**defaults, **entry}, where)
        if (
            change.fact in QUANTITIES
            and parse_quantity(change.value, QUANTITIES[change.fact], name=change.fact) <= 0
        ):
            raise DataError(f"{where}: {change.fact} = {change.value!r} must be above zero.")
    if change.fact == "label" and "classes" in table:
        labels = [item.get("label") for item in table["recording"]]
        classes = [
            name
            for name in table["classes"]
            if not (undo and name == change.previous) or name in labels
        ]
        table["classes"] = classes + [change.value] * (
            change.value is not None and change.value not in classes
        )


def _edited_text(text: str, table: Mapping[str, Any], edited: Mapping[str, Any]) -> str | None:
    """`text` with only the lines of changed facts replaced; None where that does not give the
    edited table.
    """
    starts = [match.start() for match in _HEADING.finditer(text)]
    if len(starts) != len(edited["recording"]):
        return None
    head, *parts = (
        text[start:end] for start, end in zip([0, *starts], [*starts, len(text)], strict=True)
    )
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
    """`part` of an index with the line of a fact replaced, added below that of the file, or without
    it.
    """
    import tomli_w

    line = "" if value is None else tomli_w.dumps({fact: value})
    stated = re.compile(
        rf"^[ \t]*{re.escape(fact)}[ \t]*=[ \t]*(\[[^\]]*\]|.*)[^\n]*(\n|\Z)", re.MULTILINE
    )
    if stated.search(part):
        return stated.sub(lambda _: line, part, count=1)
    file = re.compile(r"^[ \t]*file[ \t]*=.*(\n|\Z)", re.MULTILINE)
    return file.sub(lambda match: f"{match[0].rstrip()}\n{line}", part, count=1)
