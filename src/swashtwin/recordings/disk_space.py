"""Room on the disk, asked for before the work."""

import shutil
from pathlib import Path

from swashtwin.foundation import InputError

_SPARE = 1 << 24
"""Bytes that are left free on the disk: for the index, and for whoever else writes there."""


def require_room(folder: Path, count: int, bytes_each: int) -> None:
    """Refuse recordings for which the disk of an existing `folder` has no room."""
    needed, free = count * bytes_each, shutil.disk_usage(folder).free - _SPARE
    if needed > free:
        raise InputError(
            f"{folder} has {max(free, 0) / 1e9:.4g} GB free, and {count} such recordings take {needed / 1e9:.4g} GB; "
            "ask for fewer or shorter ones, or name a folder on another disk."
        )
