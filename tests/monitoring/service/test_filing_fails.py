"""Filing whose n-th statement, write, fsync or rename fails, for every n.

The recording is filed once in each case: it is neither lost nor stored twice.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event
from sqlalchemy.exc import OperationalError
from watched_pumps import hum, watch_config

from swashtwin.monitoring import History
from swashtwin.monitoring.history import waveforms
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.service import judging
from swashtwin.monitoring.sources import spool as spool_module
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.recordings import write_recording

# The source and the watch repeat an action; only its first attempt meets the one failure.
MAX_ATTEMPTS = 3


class Failure:
    """Let the n-th call of a kind fail, once."""

    def __init__(self, number: int, make_error: Callable[[], Exception]) -> None:
        self._n_left = number
        self._make_error = make_error
        self.has_failed = False

    def count(self, *_: Any) -> None:
        """Count a call, and raise the error if it is the n-th."""
        self._n_left -= 1
        if self._n_left == 0:
            self.has_failed = True
            raise self._make_error()

    def before(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return `function` with its calls counted."""

        def counted(*arguments: Any, **options: Any) -> Any:
            self.count()
            return function(*arguments, **options)

        return counted


def disk_full() -> OSError:
    return OSError(28, "No space left on device")


def database_busy() -> OperationalError:
    return OperationalError("statement", {}, Exception("database is locked"))


@contextmanager
def failing(
    kind: str, number: int, history: History, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Failure]:
    """Let the `number`-th call of a kind fail inside of the block."""
    if kind == "statement":
        failure = Failure(number, database_busy)
        engine = history._database._engine
        counter = failure.count  # one object, since a listener is removed by its identity
        event.listen(engine, "before_cursor_execute", counter)
        try:
            yield failure
        finally:
            event.remove(engine, "before_cursor_execute", counter)
        return

    failure = Failure(number, disk_full)
    with monkeypatch.context() as patch:
        if kind == "rename":
            patch.setattr(Path, "replace", failure.before(Path.replace))
            patch.setattr(os, "replace", failure.before(os.replace))
        elif kind == "fsync":
            patch.setattr(os, "fsync", failure.before(os.fsync))
        else:
            patch.setattr(waveforms, "write_store", failure.before(waveforms.write_store))
            patch.setattr(spool_module, "_write", failure.before(spool_module._write))
        yield failure


def repeat(action: Callable[[], Any]) -> Any:
    """Return the result of the first attempt that does not fail."""
    for _ in range(MAX_ATTEMPTS):
        try:
            return action()
        except (OSError, HistoryError):
            continue
    raise AssertionError("each attempt failed, though only one call fails")


def file_one_recording(
    folder: Path, content: bytes, kind: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> bool:
    """File a recording while the `number`-th call of a kind fails.

    Return whether a call failed; otherwise there were fewer than `number`.
    """
    config = watch_config(folder, '[[channel]]\nkind = "log"')
    history = History.open("", config.folder)
    spool = Spool(config.folder / "spool")
    pipeline = judging.Pipeline(config, history)
    delivery = Delivery("inbox", "a.h5", datetime.now(UTC), "pump-1")

    with failing(kind, number, history, monkeypatch) as failure:
        repeat(lambda: spool.add(delivery, content))
        while (file := spool.next(0)) is not None:
            outcome = repeat(lambda file=file: pipeline.judge(file))
            # A second copy may be rejected as a duplicate: nothing is lost by that.
            assert outcome.state in ("learning", "rejected")
            repeat(lambda file=file: spool.remove(file))

    assert_filed_once(history)
    assert not list((config.folder / "spool").iterdir())
    history.close()
    return failure.has_failed


def assert_filed_once(history: History) -> None:
    reader = history.reader
    (stored,) = reader.recordings()
    assert (history.waveforms.folder / str(stored.waveform)).is_file()

    # The overview counts in columns of its own, which must agree with the rows.
    assert reader.machines()[0].recordings == 1
    assert reader.recordings_by_state() == {("pump-1", "learning"): 1}
    assert {row.reason for row in reader.rejections()} <= {"double"}


# The minimum keeps the patches honest: a call by another name would never fail.
@pytest.mark.parametrize(
    ("kind", "min_calls"),
    [
        pytest.param("statement", 8, marks=pytest.mark.nightly),
        ("write", 3),
        ("fsync", 3),
        ("rename", 1),
    ],
)
def test_whichever_call_fails_once_the_recording_is_filed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, min_calls: int
) -> None:
    content = write_recording(hum(1), tmp_path / "a.h5").read_bytes()

    number = 1
    while file_one_recording(tmp_path / str(number), content, kind, number, monkeypatch):
        number += 1

    assert number > min_calls, "there must be calls that fail"
