"""The index file ``recordings.toml``: writing it."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, InputError, sha256_of, write_text
from swashtwin.pump import format_quantity
from swashtwin.recordings.entry import CONDITION_FIELDS, QUANTITIES
from swashtwin.recordings.fact_extraction import is_positive_quantity
from swashtwin.recordings.file_formats import stem_of, suffix_of
from swashtwin.recordings.hdf5_store import HDF5_SUFFIXES
from swashtwin.recordings.index_reading import INDEX_NAME, find_index, read_index
from swashtwin.recordings.recording import Recording, require_unique_ids

# Text around a surrogate, which stands for a byte of a file name that is not UTF-8.
_INVALID_UNICODE = re.compile(r"[^\"\n]*[\ud800-\udfff][^\"\n]*")

# Keys that are tables: TOML has them after the plain keys.
_TABLES = ("fault_of", "defaults", "recording")

# Digits of a quantity that give the same double when read.
_EXACT_DIGITS = 15


def write_index(
    recordings: Sequence[Recording], files: Sequence[str | Path], path: str | Path
) -> Path:
    """Write an index that states what each of `files` holds, and return its path.

    Parameters
    ----------
    files : file of each recording, absolute or relative to the index.
    path : index file, or the folder for ``recordings.toml``.
    """
    path = Path(path)
    if path.suffix != ".toml":
        path = path / INDEX_NAME
    if len(recordings) != len(files):
        raise InputError(f"{len(files)} files for {len(recordings)} recordings.")
    require_unique_ids((recording.recording_id for recording in recordings), "an index")

    index: dict[str, Any] = {"format": 1}
    labels = dict.fromkeys(recording.label for recording in recordings)
    classes = [label for label in labels if label is not None]
    if classes:
        index["classes"] = classes
    index["recording"] = [
        _describe_entry(recording, Path(file), path.parent)
        for recording, file in zip(recordings, files, strict=True)
    ]
    return save_index(index, path)


def save_index(index: Mapping[str, Any], path: str | Path) -> Path:
    """Write an index as TOML and return its path; the previous file stays until it is complete."""
    import tomli_w

    text = tomli_w.dumps(dict(index))
    if match := _INVALID_UNICODE.search(text):
        raise DataError(
            f"{path}: {match[0]!r} is not valid Unicode, which an index needs; rename the file."
        )
    return write_text(Path(path), text)


def write_subset_index(
    index: Path | str, recordings: Sequence[Recording], ids: Iterable[str], path: Path | str
) -> Path:
    """Write an index that holds only the entries of some recordings, and return its path.

    Calibration, synthesis, training and evaluation can then use the same split.

    Parameters
    ----------
    index : folder that holds ``recordings.toml``, or the index file itself.
    recordings : result of `load_recordings` for it.
    ids : recordings to keep.
    path : new index file.

    Raises
    ------
    InputError
        `recordings` are not those of `index`, or one of `ids` is not among them.
    """
    source = find_index(Path(index))
    path = Path(path)
    table = read_index(source)
    entries = table["recording"]
    if len(entries) != len(recordings):
        raise InputError(f"{source} has {len(entries)} entries, for {len(recordings)} recordings.")

    selected_ids = {str(name) for name in ids}
    unknown_ids = selected_ids - {recording.recording_id for recording in recordings}
    if unknown_ids:
        raise InputError(f"{source} has no recording {min(unknown_ids)!r}.")
    table["recording"] = [
        entry
        for entry, recording in zip(entries, recordings, strict=True)
        if recording.recording_id in selected_ids
    ]

    root = (source.parent / table.pop("root", "")).resolve()
    folder = path.parent.resolve()
    if root != folder:
        table["root"] = relative_path(folder, root)
    ordered_keys = sorted(table, key=lambda key: key in _TABLES)
    return save_index({key: table[key] for key in ordered_keys}, path)


def relative_path(folder: Path, path: Path) -> str:
    """Return `path` as an index in `folder` states it: relative, or absolute on another drive."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive of Windows
        return path.absolute().as_posix()


def _describe_entry(recording: Recording, file: Path, folder: Path) -> dict[str, Any]:
    """Return the entry that restores what the file's format does not hold."""
    absolute = file if file.is_absolute() else folder / file
    entry: dict[str, Any] = {"file": relative_path(folder, absolute)}
    if recording.recording_id != stem_of(file):
        entry["id"] = recording.recording_id
    if recording.label:
        entry["label"] = recording.label
    if recording.specimen:
        entry["specimen"] = recording.specimen
    if recording.condition is not None:
        for key, name in CONDITION_FIELDS.items():
            value = getattr(recording.condition, name)
            entry[key] = format_quantity(value, QUANTITIES[key], _EXACT_DIGITS)
    if recording.synthetic:
        entry["synthetic"] = True

    if suffix_of(file) not in HDF5_SUFFIXES:
        entry.update(_describe_layout(recording))
    if absolute.is_file():
        entry["sha256"] = sha256_of(absolute)
    return entry


def _describe_layout(recording: Recording) -> dict[str, Any]:
    """Return channels, rate, unit and attributes, which only HDF5 files hold."""
    facts: dict[str, Any] = {
        "names": list(recording.channels),
        "sample_rate": f"{recording.sample_rate:.{_EXACT_DIGITS}g} Hz",
        "unit": recording.unit,
    }
    attributes = dict(recording.attributes)
    for key in ("file", "sha256"):  # the entry states them
        attributes.pop(key, None)
    if "discharge_pressure" in attributes:
        attributes["pressure"] = attributes.pop("discharge_pressure")

    for key in QUANTITIES:
        if is_positive_quantity(attributes.get(key), key):
            facts[key] = attributes.pop(key)
    if attributes:
        facts["attributes"] = attributes
    return facts
