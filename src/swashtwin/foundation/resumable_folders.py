"""Folders that are filled file by file, and can be continued after an interruption."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swashtwin.foundation.atomic_files import HIDDEN_NAME, write_text
from swashtwin.foundation.errors import ArtifactError, InputError
from swashtwin.foundation.file_access import read_text
from swashtwin.foundation.packages import VERSION

# Free space that stays on the disk, so that logs and databases can still be written.
_DISK_RESERVE_BYTES = 1 << 24

# Length of a differing value in a message.
_MAX_VALUE_CHARACTERS = 60


def resume_folder(folder: Path, manifest: str, settings: Mapping[str, Any]) -> None:
    """Continue a folder that was filled with equal settings, or start a new one.

    Parameters
    ----------
    folder : new or empty folder, or one with such a manifest.
    manifest : name of the file in it that holds `settings` and the version of swashtwin.
    settings : everything that the files of the folder depend on, as JSON can hold it.

    Raises
    ------
    InputError
        The folder holds something else, or files of other settings or of another version.
    ArtifactError
        The manifest is damaged.
    """
    settings = json.loads(json.dumps({"version": VERSION, **settings}))
    path = folder / manifest

    if not path.is_file():
        if folder.exists() and not _is_empty(folder):
            raise InputError(
                f"{folder} is not a folder of such recordings and is not empty; choose a new "
                "folder."
            )
        write_text(path, json.dumps(settings, indent=1))
        return

    try:
        saved_settings = json.loads(read_text(path))
    except ValueError as cause:
        raise ArtifactError(f"{path} is damaged ({cause}); choose a new folder.") from cause

    difference = first_difference(saved_settings, settings)
    if difference:
        raise InputError(
            f"{folder} was made with other settings: {difference} ({manifest}). Choose a new "
            "folder, or remove this one."
        )


def _is_empty(folder: Path) -> bool:
    """Whether the folder holds nothing but files that a killed process was writing."""
    return folder.is_dir() and all(HIDDEN_NAME.match(file.name) for file in folder.iterdir())


def first_difference(previous: Any, current: Any, name: str = "") -> str:
    """Describe the first entry in which two tables differ; empty if they are equal.

    Examples
    --------
    >>> first_difference({"rig": {"seed": 1}}, {"rig": {"seed": 2}})
    'rig.seed was 1, now 2'
    """
    if isinstance(previous, Mapping) and isinstance(current, Mapping):
        for key in sorted({*previous, *current}):
            entry_name = f"{name}.{key}" if name else key
            difference = first_difference(previous.get(key), current.get(key), entry_name)
            if difference:
                return difference
        return ""

    if previous == current:
        return ""
    previous_text = json.dumps(previous)[:_MAX_VALUE_CHARACTERS]
    current_text = json.dumps(current)[:_MAX_VALUE_CHARACTERS]
    return f"{name} was {previous_text}, now {current_text}"


def require_disk_space(folder: Path, count: int, bytes_each: int) -> None:
    """Raise an `InputError` if `count` files of `bytes_each` do not fit on the disk of `folder`."""
    needed = count * bytes_each
    free = shutil.disk_usage(folder).free - _DISK_RESERVE_BYTES
    if needed > free:
        raise InputError(
            f"{folder} has {max(free, 0) / 1e9:.4g} GB free, and {count} such recordings take "
            f"{needed / 1e9:.4g} GB; request fewer or shorter ones, or use another disk."
        )
