"""The history under kills, a full disk, a stopped database, a clock set back and other
processes.
"""

import errno
import multiprocessing
import random
import shutil
import sqlite3
import threading
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from history_writers import RETENTION, file_in_turns, file_recordings, send_messages
from judgments import START, judgment, waveform
from sqlalchemy import event, text

from swashtwin.foundation import DataError, InputError
from swashtwin.monitoring.history import waveforms
from swashtwin.monitoring.history.database import SQLITE_FILE, HistoryError, _open_engine
from swashtwin.monitoring.history.history import History

# the writers are forked before they start threads
pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")

KILLS = 25


@pytest.fixture
def start() -> Any:
    """Return a function that starts a process.

    The process runs a function of `history_writers`. It is forked, so that all imports are done.
    """
    context = multiprocessing.get_context("fork")
    processes = []

    def start_process(function: Callable[..., None], *arguments: object) -> Any:
        process = context.Process(target=function, args=arguments)
        process.start()
        processes.append(process)
        return process

    yield start_process

    for process in processes:
        process.kill()
        process.join()
        process.close()


def _is_consistent(history: History, machine: str, count: int) -> None:
    stored = history.reader.recordings(machine, limit=10_000)
    assert sorted(row.content for row in stored) == sorted(
        judgment(n).content for n in range(count)
    )

    (point,) = history.reader.operating_points(machine)
    assert point.test == {"filed": count}

    overview = next(overview for overview in history.reader.machines() if overview.name == machine)
    assert overview.recordings == count
    assert overview.last == stored[0]

    assert history.reader.trend(machine, "x", "rms", limit=10_000).values.tolist() == list(
        range(count)
    )

    assert all(
        (history.waveforms.folder / row.waveform).is_file()
        for row in stored
        if row.waveform is not None
    )


@pytest.mark.nightly
def test_a_writer_killed_at_random_moments_loses_nothing_and_files_nothing_twice(
    start: Any, history_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    delays = random.Random(0)
    file_recordings(history_url, tmp_path, "pump-1", 1)  # imports what it needs
    history = History.open(history_url, tmp_path, RETENTION)
    counts = []

    for _ in range(KILLS):
        history.close()  # no connection is shared
        process = start(file_recordings, history_url, tmp_path, "pump-1", 100_000)
        while process.is_alive() and len(history.reader.recordings(limit=10_000)) <= sum(
            counts[-1:], 1
        ):
            process.join(0.01)  # until it writes, however busy the machine is

        process.join(delays.uniform(0.0, 0.5))
        process.kill()
        process.join()
        counts.append(len(history.reader.recordings(limit=10_000)))
    assert len(set(counts)) > 5, "kills must hit a process that writes"

    count = counts[-1] + 5
    start(file_recordings, history_url, tmp_path, "pump-1", count).join(120)

    _is_consistent(history, "pump-1", count)
    assert history.outbox.waiting(["log"]) == count

    monkeypatch.setattr("swashtwin.monitoring.history.waveforms.MIN_ORPHAN_AGE_S", -1)
    history.waveforms.sweep()

    stored_files = [
        history.waveforms.folder / row.waveform
        for row in history.reader.recordings("pump-1", limit=10_000)
        if row.waveform
    ]
    assert sorted(history.waveforms.folder.rglob("*.h5")) == sorted(stored_files)
    history.close()


@pytest.mark.nightly
def test_processes_that_get_the_same_deliveries_file_each_once_and_send_each_message_once(
    start: Any, history_url: str, tmp_path: Path
) -> None:
    writers = [start(file_in_turns, history_url, tmp_path, 2, 15) for _ in range(3)]
    for writer in writers:
        writer.join(120)
        assert writer.exitcode == 0

    history = History.open(history_url, tmp_path, RETENTION)
    for machine in ("pump-0", "pump-1"):
        _is_consistent(history, machine, 15)

    sent = tmp_path / "sent.txt"
    senders = [start(send_messages, history_url, tmp_path, sent) for _ in range(3)]
    for sender in senders:
        sender.join(120)
        assert sender.exitcode == 0

    numbers = sent.read_text(encoding="utf-8").split()
    assert len(numbers) == len(set(numbers)) == 30
    history.close()


def test_a_claimed_message_is_due_again_after_its_lease(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:

    with history.machine("pump-1") as transaction:
        transaction.post("log", {"text": "grün"}, alarm=7)

    # a clock that is set back later must not keep a message waiting
    fast_clock = type(
        "Clock",
        (datetime,),
        {"now": classmethod(lambda _, zone: datetime.now(zone) + timedelta(days=400))},
    )
    with monkeypatch.context() as patch:
        patch.setattr("swashtwin.monitoring.history.outbox.datetime", fast_clock)
        (message,) = history.outbox.claim(["log"])

    (message,) = history.outbox.claim(["log"])
    assert message.channel == "log"
    assert message.body == {"text": "grün"}
    assert message.alarm == 7
    assert message.attempts == 2

    assert history.outbox.claim(["log"]) == []
    assert history.outbox.waiting(["mail"]) == 0
    history.outbox.mark_failed(message.id, "no route", delay=0)
    assert history.outbox.claim(["mail"]) == ()

    monkeypatch.setattr("swashtwin.monitoring.history.outbox.LEASE", timedelta(0))
    (repeated,) = history.outbox.claim(["log"])
    assert (repeated.id, repeated.attempts, repeated.error) == (message.id, 3, "no route")

    (last_claim,) = history.outbox.claim(["log"])
    assert last_claim.attempts == 4

    history.outbox.mark_sent(last_claim.id)
    assert history.outbox.waiting(["log"]) == 0


def test_a_new_history_waits_for_a_process_that_has_begun_to_write_to_it(tmp_path: Path) -> None:
    writer = sqlite3.connect(tmp_path / SQLITE_FILE, check_same_thread=False)
    writer.isolation_level = None
    writer.execute("BEGIN IMMEDIATE")

    release = threading.Timer(0.3, writer.rollback)
    release.start()
    history = History.open("", tmp_path)
    release.join()

    assert list(history.reader.machines()) == []
    history.close()
    writer.close()


def test_a_full_sqlite_disk_is_one_error_after_which_the_history_goes_on(tmp_path: Path) -> None:
    history = History.open("", tmp_path)
    maximum_pages = [60]

    @event.listens_for(history._database._engine, "checkout")
    def limit(connection: Any, *_: object) -> None:
        connection.execute(f"PRAGMA max_page_count = {maximum_pages[0]}")

    def fill() -> None:
        for number in range(10_000):
            with history.machine("pump-1") as transaction:
                transaction.add_recording(
                    judgment(number), {("x", str(n)): 1.0 for n in range(300)}
                )

    with pytest.raises(HistoryError, match="full"):
        fill()
    filed = len(history.reader.recordings(limit=10_000))
    assert filed > 0

    maximum_pages[0] = 100_000
    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(filed))
    assert history.reader.machines()[0].recordings == filed + 1
    history.close()


def test_a_disk_without_space_for_a_waveform_raises_an_operating_system_error(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(".")._replace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)

    with pytest.raises(OSError, match="GB free") as caught:
        history.waveforms.write("pump-1", START, "a" * 64, waveform(1))

    assert caught.value.errno == errno.ENOSPC
    assert list(history.waveforms.folder.rglob("*.h5")) == []


@pytest.mark.parametrize("code", ["53100", "53300", "57P01", "40P01"])
def test_a_full_or_busy_postgresql_is_one_error_after_which_the_history_goes_on(
    postgresql_url: str, tmp_path: Path, code: str
) -> None:
    history = History.open(postgresql_url, tmp_path)
    with history._database._engine.begin() as connection:
        connection.exec_driver_sql(
            "CREATE FUNCTION fail() RETURNS trigger LANGUAGE plpgsql AS "
            f"$$ BEGIN RAISE EXCEPTION 'no room' USING ERRCODE = '{code}'; END $$"
        )
        connection.exec_driver_sql(
            "CREATE TRIGGER fail BEFORE INSERT ON outbox FOR EACH ROW EXECUTE FUNCTION fail()"
        )

    with pytest.raises(HistoryError, match="no room"), history.machine("pump-1") as transaction:
        transaction.post(str(transaction.add_recording(judgment(1))), {})
    assert history.reader.recordings() == []

    with history._database._engine.begin() as connection:
        connection.exec_driver_sql("DROP TRIGGER fail ON outbox")

    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(1))
    assert len(history.reader.recordings()) == 1
    history.close()


@pytest.mark.nightly
def test_a_stopped_postgresql_is_one_error_and_is_used_again_after_its_restart(
    postgres_server: Any, postgresql_url: str, tmp_path: Path
) -> None:
    history = History.open(postgresql_url, tmp_path)
    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(1))

    postgres_server.stop()
    try:
        with pytest.raises(HistoryError):
            history.reader.sequence()
        with pytest.raises(HistoryError), history.machine("pump-1") as transaction:
            transaction.add_recording(judgment(2))
        with pytest.raises(HistoryError):
            History.open(postgresql_url, tmp_path)
    finally:
        postgres_server.start()

    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(2))
    assert len(history.reader.recordings()) == 2
    history.close()


def test_a_damaged_database_or_one_of_another_version_or_program_is_refused(
    tmp_path: Path, postgresql_url
) -> None:
    (tmp_path / "history.sqlite").write_bytes(b"no database" * 1000)
    with pytest.raises(HistoryError, match="not a database"):
        History.open("", tmp_path)

    for url in (f"sqlite:///{tmp_path}/other.sqlite", postgresql_url):
        engine = _open_engine(url, tmp_path, is_new=True)
        with engine.begin() as connection:
            connection.execute(text("CREATE TABLE events (id INTEGER)"))

        with pytest.raises(DataError, match=r"another program \(events\)"):
            History.open(url, tmp_path)

        with engine.begin() as connection:
            connection.execute(text("DROP TABLE events"))
        History.open(url, tmp_path).close()

        with engine.begin() as connection:
            connection.execute(text("UPDATE swashtwin_history SET version = 99"))
        engine.dispose()

        with pytest.raises(DataError, match="version 99"):
            History.open(url, tmp_path)


@pytest.mark.parametrize("url", ["mysql://host/name", "nonsense", "postgresql:/x:hunter2"])
def test_a_url_of_another_database_is_refused_without_showing_it(url: str, tmp_path: Path) -> None:
    with pytest.raises((InputError, HistoryError)) as caught:
        History.open(url, tmp_path)
    assert "hunter2" not in str(caught.value)


def test_a_waveform_that_another_watch_removes_while_it_is_written_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = History.open("", tmp_path)
    flush = waveforms._flush
    removed: list[Path] = []

    def flush_late(path: Path) -> None:
        if not removed:
            removed.append(path)
            path.unlink()
        flush(path)

    monkeypatch.setattr(waveforms, "_flush", flush_late)

    facts = judgment(0)
    path = history.waveforms.write("pump-1", facts.time, facts.content, waveform(0))
    assert removed == [tmp_path / "waveforms" / path]
    assert history.waveforms.read(path) is not None
    history.close()
