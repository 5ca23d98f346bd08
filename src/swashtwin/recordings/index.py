"""The index file ``recordings.toml``: one entry per file, and what each file is."""

import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
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
    plain_text,
    read_text,
    sha256_of,
    write_text,
)
from swashtwin.pump import in_trade_units, is_same_class
from swashtwin.recordings.channel_checks import Finding
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.formats.raw import Text
from swashtwin.recordings.formats.registry import stem_of, suffix_of
from swashtwin.recordings.loading import PUMP_KEYS, recording_of
from swashtwin.recordings.recording import Recording, require_distinct
from swashtwin.recordings.stated_facts import is_quantity
from swashtwin.recordings.store import is_store

INDEX_NAME = "recordings.toml"
_NO_UNICODE = re.compile(r"[^\"\n]*[\ud800-\udfff][^\"\n]*")
_LOSSLESS = (".h5", ".hdf5")


def indexed_recordings(
    path: Path, unreadable: list[Finding] | None = None, *, label: str | None = None, specimen: str | None = None
) -> list[Recording]:
    """Every recording of an index, in its order.

    Parameters
    ----------
    unreadable : gets a finding for each entry that cannot be loaded, instead of an error for the first.
    label, specimen : only these; the files of entries that state others are not opened.

    Raises
    ------
    DataError
        The index or a file is missing or damaged, or one contradicts the other.
    """
    index = index_path(path)
    table = index_table(index)
    recordings = []
    files: dict[str, str] = {}
    classes = _classes(table)
    root = indexed_path(index.parent, str(table.get("root", "")))
    for entry in _entries(table, index):
        if _states_another(entry.label, label) or _states_another(entry.specimen, specimen):
            continue
        try:
            recording = recording_of(indexed_path(root, entry.file), entry)
            name, label_found = recording.recording_id, recording.label
            if classes is not None and label_found is not None and label_found not in classes:
                near = get_close_matches(label_found, classes, n=1, cutoff=0.4)
                hint = f"did you mean {near[0]!r}?" if near else f"classes = {list(classes)}."
                raise DataError(f"{index}: {entry.file} has the unknown class {label_found!r}; {hint}")
            if name in files:
                raise DataError(f'{index}: {files[name]} and {entry.file} share the id {name!r}; give one id = "...".')
        except SwashTwinError as cause:
            if unreadable is None:
                raise
            unreadable.append(Finding("unreadable", "error", None, str(cause)))
            continue
        files[name] = entry.file
        recordings.append(recording)
    return recordings


def _states_another(stated: str | None, wanted: str | None) -> bool:
    """Whether an entry states another class or specimen than is wanted."""
    return None not in (stated, wanted) and not is_same_class(plain_text(str(stated)), wanted)


def write_index(recordings: Sequence[Recording], files: Sequence[str | Path], path: str | Path) -> Path:
    """Path of the index that now says what each of `files` holds.

    Parameters
    ----------
    recordings : what was written.
    files : where each was written, absolute or relative to the index.
    path : index file, or the folder for ``recordings.toml``.
    """
    path = Path(path)
    path = path if path.suffix == ".toml" else path / INDEX_NAME
    if len(recordings) != len(files):
        raise InputError(f"{len(files)} files for {len(recordings)} recordings.")
    require_distinct((recording.recording_id for recording in recordings), "an index")
    index: dict[str, Any] = {"format": 1}
    classes = list(dict.fromkeys(recording.label for recording in recordings if recording.label is not None))
    if classes:
        index["classes"] = classes
    index["recording"] = [
        _described(recording, Path(file), path.parent) for recording, file in zip(recordings, files, strict=True)
    ]
    return save_index(index, path)


def save_index(index: Mapping[str, Any], path: str | Path) -> Path:
    """Path of the index file, which is replaced only when the new one is complete."""
    import tomli_w

    text = tomli_w.dumps(dict(index))
    if name := _NO_UNICODE.search(text):
        raise DataError(f"{path}: {name[0]!r} is no name in Unicode, which an index cannot hold; rename the file.")
    return write_text(Path(path), text)


def narrow_index(index: Path | str, recordings: Sequence[Recording], ids: Iterable[str], path: Path | str) -> Path:
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
    source, path = index_path(Path(index)), Path(path)
    table = index_table(source)
    if len(table["recording"]) != len(recordings):
        raise InputError(f"{source} has {len(table['recording'])} entries, for {len(recordings)} recordings.")
    ids = {str(name) for name in ids}
    missing = sorted(ids - {recording.recording_id for recording in recordings})
    if missing:
        raise InputError(f"{source} has no recording {missing[0]!r}.")
    pairs = zip(table["recording"], recordings, strict=True)
    table["recording"] = [entry for entry, recording in pairs if recording.recording_id in ids]
    root = (source.parent / table.get("root", "")).resolve()
    table.pop("root", None)
    if root != path.parent.resolve():
        table["root"] = path_from(path.parent.resolve(), root)
    last = ("fault_of", "defaults", "recording")  # tables stand after the plain keys
    return save_index({key: table[key] for key in sorted(table, key=lambda key: key in last)}, path)


def source_files(path: str | Path) -> list[Path]:
    """Files that a source is read from: an index and all that it names, or one file or store, which is itself."""
    path = Path(path)
    if not (path.is_dir() or path.suffix == ".toml"):
        return [path]
    index = index_path(path)
    table = index_table(index)
    root = indexed_path(index.parent, str(table.get("root", "")))
    return [index, *(indexed_path(root, entry.file) for entry in _entries(table, index))]


def indexed_path(folder: Path, name: str) -> Path:
    """File or folder that an index names below `folder`; on every system it may be written as Windows does it."""
    path = folder / name
    return path if "\\" not in name or path.exists() else folder / name.replace("\\", "/")


def declared_classes(path: str | Path) -> tuple[str, ...] | None:
    """Classes that an index declares, whether it has recordings of each or not; None where it declares none."""
    if is_store(Path(path)):
        return None
    return _classes(index_table(index_path(Path(path))))


def declared_faults(path: str | Path) -> dict[str, str]:
    """Fault that each class of an index stands for, as its table ``[fault_of]`` says."""
    return {} if is_store(Path(path)) else dict(index_table(index_path(Path(path))).get("fault_of", {}))


def _classes(table: dict[str, Any]) -> tuple[str, ...] | None:
    return None if "classes" not in table else tuple(plain_text(name) for name in table["classes"])


def index_path(path: Path) -> Path:
    """The index file: `path` itself, or ``recordings.toml`` in the folder `path`."""
    if path.is_dir():
        path = path / INDEX_NAME
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist; propose one with: swashtwin index {path.parent}")
    if path.suffix != ".toml":
        raise DataError(f"{path} is not an index (recordings.toml); swashtwin index FOLDER writes one.")
    return path


def index_table(index: Path) -> dict[str, Any]:
    """What an index file states, as TOML has it.

    Raises
    ------
    DataError
        It is damaged, or no index of this version.
    """
    text = read_text(index)
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as cause:  # numbers of thousands of digits, and lists in lists, too
        hint = "; write / between folders, or put a text with \\ into single quotes" if "\\" in str(cause) else ""
        raise DataError(f"{index} is not valid TOML: {(str(cause).splitlines() or [''])[0][:160]}{hint}") from cause
    if table.get("format") != 1 or isinstance(table["format"], bool):
        raise DataError(f"{index}: format = {table.get('format')!r} cannot be read; this version reads format = 1.")
    if not table.get("recording"):
        raise DataError(f"{index} has no [[recording]] entry.")
    try:
        from_table(table, _Index, str(index))
    except InputError as cause:
        raise DataError(str(cause)) from cause
    return table


class _Index(msgspec.Struct, forbid_unknown_fields=True):
    """Form of an index."""

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
    entry: dict[str, Any] = {"file": path_from(folder, absolute)}
    if recording.recording_id != stem_of(file):
        entry["id"] = recording.recording_id
    entry |= {name: getattr(recording, name) for name in ("label", "specimen") if getattr(recording, name)}
    if recording.condition is not None:
        values = {key: getattr(recording.condition, field) for key, field in PUMP_KEYS.items()}
        entry |= {key: in_trade_units(value, QUANTITIES[key], 15) for key, value in values.items()}
    if recording.synthetic:
        entry["synthetic"] = True
    attributes = {key: value for key, value in recording.attributes.items() if key not in ("file", "sha256")}
    if suffix_of(file) not in _LOSSLESS:
        entry |= {"names": list(recording.channels), "sample_rate": rate_text(recording.sample_rate)}
        entry["unit"] = recording.unit
        if "discharge_pressure" in attributes:
            attributes["pressure"] = attributes.pop("discharge_pressure")
        stated = [key for key in QUANTITIES if is_quantity(attributes.get(key), key)]
        entry |= {key: attributes.pop(key) for key in stated}
        if attributes:
            entry["attributes"] = attributes
    if absolute.is_file():
        entry["sha256"] = sha256_of(absolute)
    return entry


def path_from(folder: Path, path: Path) -> str:
    """`path` as an index in `folder` states it: relative, but for another drive of Windows."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.absolute().as_posix()


def rate_text(rate: float) -> str:
    """Rate with its unit, such as ``25.6 kHz``."""
    return f"{rate / 1e3:.15g} kHz" if rate >= 1e3 else f"{rate:.15g} Hz"
