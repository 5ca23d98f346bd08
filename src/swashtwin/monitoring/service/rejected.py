"""Files of recordings that could not be judged, up to a bound; each can be looked at, repaired and delivered again."""

import os
import shutil
from contextlib import suppress
from pathlib import Path

from swashtwin.monitoring.sources import SpoolFile, safe_name

_MOST_FILES = 1000
_MOST_BYTES = 1 << 30


class RejectedFiles:
    """A folder of rejected files; the oldest go when it holds too many."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        files = sorted(path for path in folder.iterdir() if path.is_file())
        self._sizes = {path: path.stat().st_size for path in files}

    def keep(self, file: SpoolFile) -> str | None:
        """Name of a copy of a file in the spool; None where the disk has no space for it."""
        path = self._folder / f"{file.key}-{safe_name(file.delivery.file)}"
        try:
            if not path.exists():
                _link(file.path, path)
            self._sizes[path] = path.stat().st_size
        except OSError:
            return None
        while len(self._sizes) > _MOST_FILES or sum(self._sizes.values()) > _MOST_BYTES:
            oldest = next(iter(self._sizes))
            with suppress(OSError):
                oldest.unlink()
            del self._sizes[oldest]
        return path.name if path in self._sizes else None


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # a file system without links
        shutil.copyfile(source, target)
