"""Progress of trainings that take hours: how many epochs their checkpoints hold."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from swashtwin.foundation import ArtifactError, MissingFileError
from swashtwin.learning import checkpoint_epochs

PAUSE = 20.0
"""Seconds between two looks at the checkpoints."""


@contextmanager
def epochs_shown(
    epochs: Mapping[Path, int], is_finished: Callable[[Path], bool], report: Callable[[str, int, int], None]
) -> Iterator[None]:
    """Within it, epochs done and in all are reported every `PAUSE` seconds, from a thread of its own.

    Parameters
    ----------
    epochs : epochs of each training, by its checkpoint.
    is_finished : whether a training ended, which deletes its checkpoint.
    report : called with (activity, epochs done, in all).
    """
    ended, seen = threading.Event(), dict.fromkeys(epochs, 0)

    def watch() -> None:
        while not ended.wait(PAUSE):
            for file, count in epochs.items():
                seen[file] = count if is_finished(file) else max(seen[file], _epochs_in(file))
            if not ended.is_set():
                report("epochs", sum(seen.values()), sum(epochs.values()))

    thread = threading.Thread(target=watch, name="epochs", daemon=True)
    if epochs:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if epochs:
            thread.join()


def _epochs_in(file: Path) -> int:
    try:
        return checkpoint_epochs(file)
    except (ArtifactError, MissingFileError):  # not there yet or any more; a damaged one is the training's to tell
        return 0
