"""The history in SQLite and in PostgreSQL: what is filed can be read."""

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from judgments import START, judgment, rejection, waveform

from swashtwin.foundation import InputError
from swashtwin.monitoring.config.settings import Retention
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Judgment


def test_a_recording_is_read_as_it_was_filed(history: History) -> None:
    written = judgment(
        1,
        speed=157.1,
        pressure=15e6,
        label="normal",
        probability=0.9,
        confidence=0.8,
        ood_p=0.5,
        model="abc",
        alarm_p=0.25,
        capital=1.5,
        reasons={"moved": [["x", 3.5]], "text": "größer"},
    )
    with history.machine("pump-1") as transaction:
        number = transaction.add_recording(written, {("x", "rms"): 0.1, ("y", "rms"): -3.0})
    stored = history.reader.recording(number)
    assert stored is not None
    assert stored == written
    assert (stored.id, stored.machine, stored.waveform) == (number, "pump-1", None)
    assert history.reader.indicator_names("pump-1") == (("x", "rms"), ("y", "rms"))
    assert history.reader.recordings("pump-1") == [stored]
    assert history.reader.recordings("pump-2") == []
    assert history.reader.recording(number + 1) is None


def test_numbers_that_are_not_finite_become_null_or_the_largest_and_times_are_read_in_utc(
    history: History,
) -> None:
    time = datetime(2026, 7, 1, 12, tzinfo=ZoneInfo("Europe/Berlin"))
    odd = judgment(
        1, time=time, ood_p=math.nan, capital=math.inf, reasons={"p": math.nan, "a": np.arange(2)}
    )
    with history.machine("pump-1") as transaction:
        number = transaction.add_recording(odd)
    stored = history.reader.recording(number)
    assert stored is not None
    assert stored.ood_p is None
    assert stored.capital == pytest.approx(1.797e308, rel=1e-3)
    assert stored.reasons == {"p": None, "a": [0, 1]}
    assert (stored.time, stored.time.utcoffset()) == (
        datetime(2026, 7, 1, 10, tzinfo=UTC),
        timedelta(0),
    )


def test_recordings_come_newest_first_in_pages_and_by_filter(history: History) -> None:
    states = ["normal", "alarm", "normal", "unusual", "normal"]
    with history.machine("pump-1") as transaction:
        for number in (3, 0, 4, 1, 2):
            transaction.add_recording(
                judgment(number, state=states[number], point="b" if number == 2 else "a")
            )
        assert transaction.newest() == START + timedelta(hours=4)
    reader = history.reader

    def numbers(**options: object) -> list[int]:
        results = reader.recordings("pump-1", **options)  # type: ignore[arg-type]
        return [int(stored.file.removesuffix(".wav")) for stored in results]

    assert numbers() == [4, 3, 2, 1, 0]
    assert numbers(limit=2) == [4, 3]
    assert numbers(before=reader.recordings("pump-1", limit=2)[-1].id) == [2, 1, 0]
    assert numbers(state="normal") == [4, 2, 0]
    assert numbers(point="b") == [2]
    assert numbers(since=START + timedelta(hours=1), until=START + timedelta(hours=3)) == [2, 1]


def test_a_trend_has_its_newest_values_oldest_first_and_bridges_other_layouts(
    history: History,
) -> None:
    with history.machine("pump-1") as transaction:
        for number in range(6):
            values = {("x", "rms"): float(number), ("y", "rms"): -1.0}
            if number >= 3:
                values = {("y", "kurtosis"): 3.0, **values}
            transaction.add_recording(judgment(number, alarm_p=0.5 if number else None), values)
    trend = history.reader.trend("pump-1", "x", "rms")
    np.testing.assert_array_equal(trend.values, np.arange(6.0))
    assert trend.times[0] == np.datetime64("2026-03-01T06:00")
    assert (np.diff(trend.times) == np.timedelta64(1, "h")).all()
    np.testing.assert_array_equal(
        history.reader.trend("pump-1", "x", "rms", limit=2).values, [4, 5]
    )
    np.testing.assert_array_equal(
        history.reader.trend("pump-1", "x", "rms", since=START + timedelta(hours=5)).values, [5]
    )
    np.testing.assert_array_equal(
        history.reader.trend("pump-1", "", "alarm_p").values, [np.nan] + [0.5] * 5
    )
    assert history.reader.trend("pump-1", "z", "rms").values.size == 0
    with pytest.raises(InputError, match="capital"):
        history.reader.trend("pump-1", "", "content")


def test_an_alarm_is_closed_when_it_is_both_cleared_and_acknowledged(history: History) -> None:
    with history.machine("pump-1") as transaction:
        first = transaction.open_alarm("pump", "a", START, {"rise": 9.0}, None).id
        second = transaction.open_alarm("sensor", None, START, {}, None).id
        transaction.clear_alarm(first, START + timedelta(hours=1))
        assert [alarm.state for alarm in transaction.alarms()] == ["open", "open"]
    with history.machine("pump-1") as transaction:
        transaction.acknowledge(first, "operator", "seen")
        transaction.acknowledge(second, "operator")
        with pytest.raises(InputError, match="acknowledged already"):
            transaction.acknowledge(second, "other")
        with pytest.raises(InputError, match="no alarm 999"):
            transaction.acknowledge(999, "operator")
        assert [alarm.id for alarm in transaction.alarms()] == [second]
        transaction.clear_alarm(second, START + timedelta(hours=2))
    with pytest.raises(InputError, match="no alarm"), history.machine("pump-2") as transaction:
        transaction.acknowledge(first, "operator")
    alarm = history.reader.alarm(first)
    assert alarm is not None
    assert (alarm.state, alarm.who, alarm.note, alarm.evidence) == (
        "closed",
        "operator",
        "seen",
        {"rise": 9.0},
    )
    assert [alarm.id for alarm in history.reader.alarms("pump-1")] == [second, first]
    assert history.reader.alarms(state="open") == []
    assert history.reader.alarm(999) is None


def test_a_rejection_of_the_same_content_is_counted_and_all_are_bounded(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    for hour in range(3):
        time = START + timedelta(hours=hour)
        history.reject(rejection("a.wav", "c", received=time, machine="pump-1", reason="double"))
    history.reject(rejection("b.wav", "", source="http", copy="b.wav"))
    newest, first = history.reader.rejections()
    assert (newest.times, newest.received, newest.machine) == (
        3,
        START + timedelta(hours=2),
        "pump-1",
    )
    assert (first.times, first.machine, first.copy) == (1, "", "b.wav")
    assert history.reader.rejections_by_reason() == {"double": 3, "broken": 1}
    monkeypatch.setattr("swashtwin.monitoring.history.history.MAX_REJECTIONS", 5)
    for number in range(9):
        history.reject(rejection(f"{number}.wav", str(number)))
        history.reject(rejection("again.wav", "again"))
    assert len(history.reader.rejections()) == 5


def add(history: History, facts: Judgment, number: int) -> int:
    """Number of a recording that was filed with its waveform."""
    path = history.waveforms.write("pump-1", facts.time, facts.content, waveform(number))
    with history.machine("pump-1") as transaction:
        return transaction.add_recording(facts, waveform=path)


def test_retention_keeps_alarms_one_a_day_and_the_last(history_url: str, tmp_path: Path) -> None:
    history = History.open(history_url, tmp_path, Retention(per_day=1, latest=3))
    states = {30: "alarm", 31: "alarm"}
    for number in range(60):
        add(history, judgment(number, state=states.get(number, "normal")), number)
    stored = history.reader.recordings("pump-1", limit=100)
    numbers = [int(row.file[:-4]) for row in reversed(stored) if row.waveform is not None]
    # Recordings begin at six o'clock, so days begin with numbers 0, 18 and 42.
    assert numbers == [0, 18, 30, 31, 42, 57, 58, 59]
    assert len(list(history.waveforms.folder.rglob("*.h5"))) == len(numbers)
    alarm = next(row for row in stored if row.file == "30.wav")
    samples = history.reader.waveform(alarm.id)
    assert samples is not None
    np.testing.assert_array_equal(samples.signal, waveform(30).signal)
    assert history.reader.waveform(stored[10].id) is None
    history.close()
    history = History.open(history_url, tmp_path, Retention(per_day=0, latest=3))
    for number in range(60, 70):
        added = add(history, judgment(number), number)
        if number == 64:  # its alarm keeps the recordings before it too
            with history.machine("pump-1") as transaction:
                transaction.open_alarm("pump", "a", START, {}, added)
    stored = history.reader.recordings("pump-1", limit=10)
    assert [int(row.file[:-4]) for row in stored if row.waveform] == [69, 68, 67, 64, 63, 62]
    history.close()


def test_sweeping_removes_old_files_that_no_recording_has(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = []
    for number in (1, 2):
        facts = judgment(number)
        paths.append(history.waveforms.write("pump-1", facts.time, facts.content, waveform(number)))
    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(1), waveform=paths[0])
    assert history.waveforms.sweep() == 0
    monkeypatch.setattr("swashtwin.monitoring.history.waveforms.MIN_ORPHAN_AGE_S", -1)
    assert history.waveforms.sweep() == 1
    assert [(history.waveforms.folder / path).is_file() for path in paths] == [True, False]
