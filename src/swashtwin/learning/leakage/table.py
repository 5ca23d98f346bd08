"""Tables of windows that say which role each plays: anyone's CSV file, or the indexes that a split wrote."""

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

from swashtwin.foundation import DataError, InputError, MissingFileError, read_text
from swashtwin.recordings import load_recordings

ALIASES = {
    "recording": ("recording_id", "file_id", "file", "filename", "record", "measurement", "session"),
    "role": ("split", "set", "subset", "fold", "partition"),
    "window": ("window_id", "sample", "sample_id", "segment"),
    "specimen": ("specimen_id", "machine", "machine_id", "bearing", "bearing_id", "unit", "asset", "pump"),
    "channel": ("sensor",),
    "start": ("start_index", "begin", "offset", "start_sample"),
    "stop": ("stop_index", "end", "stop_sample", "end_sample"),
    "class": ("label", "target", "y", "fault"),
    "sha256": ("hash", "checksum", "digest"),
    "synthetic": ("is_synthetic", "generated", "augmented"),
}
"""Names of columns that are understood, beside the first, each by what it holds."""
_TRUE, _FALSE = ("1", "true", "yes", "y", "t"), ("", "0", "false", "no", "n", "f")
_SAME_ROLE = {"training": "train", "tr": "train", "val": "validation", "valid": "validation", "dev": "validation"}
_SAME_ROLE |= {"testing": "test", "eval": "test", "evaluation": "test"}


@dataclass(frozen=True)
class AuditRow:
    """One window, or one whole recording, and the role it plays."""

    recording: str
    """Uninterrupted measurement that it was cut from."""
    role: str
    """``train``, ``validation``, ``test``, or any other name, such as the number of a fold."""
    window: str = ""
    """Its own name, where it has one."""
    specimen: str = ""
    """Machine that was measured."""
    channel: str = ""
    """Sensor."""
    start: float | None = None
    """Where it begins in the recording, in samples or seconds."""
    stop: float | None = None
    """Where it ends, itself not included."""
    label: str = ""
    """Class."""
    sha256: str = ""
    """Hash of its samples."""
    synthetic: bool = False
    """Whether a model made it."""
    groups: Mapping[str, str] = field(default_factory=dict)
    """Whatever else must not be on two sides, by name, such as ``{"day": "Monday"}``."""


def read_audit_rows(
    path: Path | str, *, columns: Mapping[str, str] | None = None, groups: tuple[str, ...] = ()
) -> list[AuditRow]:
    """Rows of a CSV table with one row per window; comma, semicolon or tab between the columns.

    Parameters
    ----------
    columns : column of each fact where it has another name than `ALIASES` know: ``{"recording": "file_no"}``.
    groups : further columns to look for overlaps in.

    Raises
    ------
    MissingFileError
        No such file.
    DataError
        No such column, no row, or a value that cannot be.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist; name a CSV table with one row per window.")
    for fact in columns or {}:
        if fact not in ALIASES:
            near = get_close_matches(fact, ALIASES, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(ALIASES)}."
            raise InputError(f"{fact!r} is no fact of a window; {hint}")
    text = read_text(path)
    head = text.splitlines()[0] if text.strip() else ""
    reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=max(",;\t", key=head.count), restval="")
    names = [name.strip() for name in reader.fieldnames or ()]
    reader.fieldnames = names
    column_of = _columns(path, names, columns or {}, groups)
    try:
        rows = list(_rows(path, reader, column_of, groups))
    except csv.Error as cause:
        raise DataError(f"{path}, line {reader.line_num}: {cause}.") from cause
    if not rows:
        raise DataError(f"{path} has no row below its heading.")
    return rows


def rows_of(folder: Path | str) -> list[AuditRow]:
    """Rows of the indexes in `folder`, one per recording, each by the name of its file (``train.toml``, ``test.toml``).

    Raises
    ------
    DataError
        Fewer than two indexes.
    """
    folder = Path(folder)
    paths = [path for path in sorted(folder.glob("*.toml")) if path.stem != "recordings"]
    if len(paths) < 2:
        raise DataError(
            f"{folder} holds {len(paths)} role(s) (train.toml, test.toml); write them with swashtwin data split."
        )
    return [
        AuditRow(
            recording=recording.recording_id,
            role=_role(path.stem),
            specimen=recording.specimen or "",
            label=recording.label or "",
            sha256=recording.fingerprint(),
            synthetic=recording.synthetic,
        )
        for path in paths
        for recording in load_recordings(path)
    ]


def _columns(path: Path, names: list[str], named: Mapping[str, str], groups: tuple[str, ...]) -> dict[str, str]:
    """Column of each fact that the table has."""
    lowered = {name.lower(): name for name in names}
    column_of = {}
    for fact, aliases in ALIASES.items():
        if fact in named:
            column_of[fact] = named[fact]
        else:
            reserved = {*named.values(), *groups}
            matches = [lowered[name] for name in (fact, *aliases) if lowered.get(name, "") not in {"", *reserved}]
            column_of |= {fact: matches[0]} if matches else {}
    for column in [*column_of.values(), *groups]:
        if column not in names:
            near = get_close_matches(column, names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(names)}."
            raise DataError(f"{path} has no column {column!r}; {hint}")
    for fact in ("recording", "role"):
        if fact not in column_of:
            raise DataError(
                f"{path} has no column {fact!r}; it has {', '.join(names) or 'none'}. Name its column with --column."
            )
    return column_of


def _rows(
    path: Path, reader: "csv.DictReader[str]", column_of: Mapping[str, str], groups: tuple[str, ...]
) -> Iterator[AuditRow]:
    for row in reader:
        where = f"{path}, line {reader.line_num}"
        value = {fact: (row[column] or "").strip() for fact, column in column_of.items()}
        for fact in ("recording", "role"):
            if not value[fact]:
                raise DataError(f"{where}: {column_of[fact]} is empty; every window needs one.")
        start, stop = (_number(value.get(fact, ""), f"{where}: {column_of.get(fact)}") for fact in ("start", "stop"))
        if start is not None and stop is not None and stop <= start:
            raise DataError(
                f"{where}: stop ({stop:g}) must exceed start ({start:g}); stop is not itself in the window."
            )
        yield AuditRow(
            recording=value["recording"],
            role=_role(value["role"]),
            window=value.get("window", ""),
            specimen=value.get("specimen", ""),
            channel=value.get("channel", ""),
            start=start,
            stop=stop,
            label=value.get("class", ""),
            sha256=value.get("sha256", "").lower(),
            synthetic=_truth(value.get("synthetic", ""), f"{where}: {column_of.get('synthetic')}"),
            groups={name: (row[name] or "").strip() for name in groups},
        )


def _role(text: str) -> str:
    return _SAME_ROLE.get(text.lower(), text.lower())


def _number(text: str, where: str) -> float | None:
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise DataError(f"{where} = {text!r} is no number; give samples or seconds with a decimal point.") from None


def _truth(text: str, where: str) -> bool:
    if text.lower() in _TRUE:
        return True
    if text.lower() in _FALSE:
        return False
    raise DataError(f"{where} = {text!r} is neither true nor false.")
