"""The files of a public set, and the checksums that came with them."""

import csv
from pathlib import Path

from swashtwin.foundation import DataError, MissingFileError
from swashtwin.recordings import suffix_of


def files_below(folder: Path, *suffixes: str) -> list[Path]:
    """Files with one of `suffixes` below `folder`, sorted by path.

    Raises
    ------
    MissingFileError
        There is no such folder.
    DataError
        It holds no such file.
    """
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder; name the one that holds the set.")
    paths = sorted(path for path in folder.rglob("*") if suffix_of(path) in suffixes and path.is_file())
    if not paths:
        raise DataError(f"{folder} holds no {' or '.join(suffixes)} file; name the folder that holds the set.")
    return paths


def table_of(folder: Path, name: str = "files.csv") -> dict[str, dict[str, str]]:
    """Rows of the set's table `name` by their column ``file``; empty where the set came without one."""
    path = folder / name
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8-sig") as file:
        return {row["file"]: row for row in csv.DictReader(file) if row.get("file")}


def facts_of(texts: dict[str, str | None]) -> dict[str, str]:
    """The texts that say something."""
    return {name: text for name, text in texts.items() if text}
