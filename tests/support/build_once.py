"""Files that the tests of several processes share: the first process that needs one builds it."""

import fcntl
from collections.abc import Callable
from pathlib import Path


def built_once(path: Path, build: Callable[[Path], object]) -> Path:
    """Return a file or folder, which `build` writes if no process has built it.

    Other processes wait until it is complete.
    """
    mark = path.with_name(f".{path.name}.done")
    with path.with_name(f".{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not mark.exists():
            build(path)
            mark.touch()

    return path
