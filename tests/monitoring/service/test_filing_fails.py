"""A filing whose n-th statement, write, fsync or rename fails, for every n: nothing is lost or
there twice.
"""

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event
from sqlalchemy.exc import OperationalError
from watched_pumps import hum, watch_config

from swashtwin.monitoring import History
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.service import judging
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.recordings import write_recording


class Failure:
    """Lets the n-th call of a kind fail, once."""

    def __init__(self, number: int, error: Callable[[], Exception]) -> None:
        self.left = number
        self._error = error
        self.has_failed = False

    def count(self, *_: Any) -> None:
        """Count a call."""
        self.left -= 1
        if self.left == 0:
            self.has_failed = True
            raise self._error()

    def before(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, which is counted first."""

        def counted(*arguments: Any, **options: Any) -> Any:
            self.count()
            return function(*arguments, **options)

        return counted


def full() -> OSError:
    return OSError(28, "No space left on device")


def busy() -> OperationalError:
    return OperationalError("statement", {}, Exception("database is locked"))


def file_all(
    folder: Path, content: bytes, number: int, kind: str, monkeypatch: pytest.MonkeyPatch
) -> bool:
    """Whether the n-th call failed while a recording arrived and was filed, repeated as its source
    and the watch do.
    """
    config = watch_config(folder, '[[channel]]\nkind = "log"')
    history = History.open("", config.folder)
    spool = Spool(config.folder / "spool")
    pipeline = judging.Pipeline(config, history)
    failure = Failure(number, busy if kind == "statement" else full)
    counter = failure.count
    with monkeypatch.context() as patch:
        if kind == "statement":
            event.listen(history._database._engine, "before_cursor_execute", counter)
        elif kind == "rename":
            patch.setattr(Path, "replace", failure.before(Path.replace))
            patch.setattr(os, "replace", failure.before(os.replace))
        elif kind == "fsync":
            patch.setattr(os, "fsync", failure.before(os.fsync))
        else:
            patch.setattr(
                "swashtwin.monitoring.history.waveforms.write_store", failure.before(_write_store())
            )
            patch.setattr(
                "swashtwin.monitoring.sources.spool._write", failure.before(_spool_write())
            )
        received = datetime.now(UTC)
        repeat(lambda: spool.add(Delivery("inbox", "a.h5", received, "pump-1"), content))
        while (file := spool.next(0)) is not None:
            outcome = repeat(lambda file=file: pipeline.judge(file))
            assert outcome.state in ("learning", "rejected")
            repeat(lambda file=file: spool.remove(file))
    if kind == "statement":
        event.remove(history._database._engine, "before_cursor_execute", counter)
    contents = [row.content for row in history.reader.recordings()]
    names = {row.waveform for row in history.reader.recordings()}
    assert len(contents) == 1
    assert all((history.waveforms.folder / str(name)).is_file() for name in names)
    assert history.reader.machines()[0].recordings == 1
    assert history.reader.recordings_by_state() == {("pump-1", "learning"): 1}
    assert {row.reason for row in history.reader.rejections()} <= {"double"}
    assert not list((config.folder / "spool").iterdir())
    history.close()
    return failure.has_failed


def repeat(action: Callable[[], Any]) -> Any:
    """What an action gives at its first attempt without a failure."""
    for _ in range(3):
        try:
            return action()
        except (OSError, HistoryError):
            continue
    raise AssertionError("it fails for ever")


def _write_store() -> Callable[..., Any]:
    from swashtwin.monitoring.history import waveforms

    return waveforms.write_store


def _spool_write() -> Callable[..., Any]:
    from swashtwin.monitoring.sources import spool

    return spool._write


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
    while file_all(tmp_path / str(number), content, number, kind, monkeypatch):
        number += 1
    assert number > min_calls, "there must be calls that fail"
