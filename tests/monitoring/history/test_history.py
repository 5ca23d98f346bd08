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


def hour(number: int) -> datetime:
    """Return the time of recording `number`."""
    return START + timedelta(hours=number)


def file_number(row: Judgment) -> int:
    """Return the number of a recording that `judgment` made."""
    return int(row.file.removesuffix(".wav"))


def write_waveform(history: History, facts: Judgment) -> str:
    """Write the samples of a recording that is not filed yet, and return their path."""
    samples = waveform(file_number(facts))
    return history.waveforms.write("pump-1", facts.time, facts.content, samples)


def add_with_waveform(history: History, facts: Judgment) -> int:
    """File a recording with its samples, and return its id."""
    path = write_waveform(history, facts)
    with history.machine("pump-1") as transaction:
        return transaction.add_recording(facts, waveform=path)


def numbers_with_waveform(history: History, limit: int) -> list[int]:
    """Return the newest recordings whose samples are kept, newest first."""
    rows = history.reader.recordings("pump-1", limit=limit)
    return [file_number(row) for row in rows if row.waveform is not None]


def test_the_newest_scores_of_machines_come_oldest_first(history: History) -> None:
    for name, scores in (("pump-1", [None, 0.5, 1.5, 2.5]), ("pump-2", [3.5])):
        with history.machine(name) as transaction:
            for number, score in enumerate(scores):
                transaction.add_recording(judgment(number, reasons={"score": score}))

    newest = history.reader.newest_scores(["pump-1", "pump-2", "pump-3"], 3)

    assert {name: [row.score for row in rows] for name, rows in newest.items()} == {
        "pump-1": [0.5, 1.5, 2.5],
        "pump-2": [3.5],
        "pump-3": [],
    }
    assert [row.time for row in newest["pump-1"]] == [hour(1), hour(2), hour(3)]
    assert history.reader.newest_scores(["pump-1"], 9)["pump-1"][0].score is None


def test_indicators_of_a_channel_are_read_as_a_table_across_layouts(history: History) -> None:
    layouts = [
        {("x", "a"): 1.0, ("x", "b"): 2.0, ("y", "a"): 9.0},
        {("y", "a"): 9.0, ("x", "b"): 4.0},
    ]
    with history.machine("pump-1") as transaction:
        for number, values in enumerate(layouts):
            transaction.add_recording(judgment(number), values)
        transaction.add_recording(judgment(2))  # a flat channel has no indicators

    table = history.reader.indicator_table("pump-1", "x", ["b", "a"], point="1500 rpm, 15 MPa")

    np.testing.assert_array_equal(table.values, [[2.0, 1.0], [4.0, np.nan]])
    assert table.times.tolist() == [hour(0).replace(tzinfo=None), hour(1).replace(tzinfo=None)]
    newest = history.reader.indicator_table("pump-1", "x", ["b"], limit=1)
    assert newest.values.tolist() == [[4.0]]


def test_the_score_of_recordings_has_a_trend(history: History) -> None:
    with history.machine("pump-1") as transaction:
        for number, score in enumerate((None, 1.5, 2.5)):
            transaction.add_recording(judgment(number, reasons={"score": score}))

    trend = history.reader.trend("pump-1", "", "score")

    np.testing.assert_array_equal(trend.values, [np.nan, 1.5, 2.5])


def test_a_recording_is_read_as_it_was_filed(history: History) -> None:
    # Every optional column has a value, and the text one outside of ASCII.
    filed = judgment(
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
    indicators = {("x", "rms"): 0.1, ("y", "rms"): -3.0}
    with history.machine("pump-1") as transaction:
        number = transaction.add_recording(filed, indicators)

    stored = history.reader.recording(number)
    assert stored is not None
    assert stored == filed
    assert stored.id == number
    assert stored.machine == "pump-1"
    assert stored.waveform is None
    assert history.reader.recording(number + 1) is None

    assert history.reader.recordings("pump-1") == [stored]
    assert history.reader.recordings("pump-2") == []
    assert history.reader.indicator_names("pump-1") == (("x", "rms"), ("y", "rms"))


def test_numbers_that_are_not_finite_become_null_or_the_largest_number(history: History) -> None:
    # JSON has no NaN, and SQLite takes NaN for NULL; both databases shall return the same.
    filed = judgment(
        1,
        ood_p=math.nan,
        capital=math.inf,
        reasons={"p": math.nan, "a": np.arange(2)},
    )
    with history.machine("pump-1") as transaction:
        number = transaction.add_recording(filed)

    stored = history.reader.recording(number)
    assert stored is not None
    assert stored.ood_p is None
    assert stored.capital == pytest.approx(1.797e308, rel=1e-3)
    assert stored.reasons == {"p": None, "a": [0, 1]}


def test_times_of_any_zone_are_read_in_utc(history: History) -> None:
    noon_in_berlin = datetime(2026, 7, 1, 12, tzinfo=ZoneInfo("Europe/Berlin"))
    with history.machine("pump-1") as transaction:
        number = transaction.add_recording(judgment(1, time=noon_in_berlin))

    stored = history.reader.recording(number)
    assert stored is not None
    assert stored.time == datetime(2026, 7, 1, 10, tzinfo=UTC)
    # Equal times may have different offsets.
    assert stored.time.utcoffset() == timedelta(0)


def test_recordings_come_newest_first_in_pages_and_by_filter(history: History) -> None:
    states = ["normal", "alarm", "normal", "unusual", "normal"]
    with history.machine("pump-1") as transaction:
        # Sources deliver in parallel, so recordings are not filed in the order of their times.
        for number in (3, 0, 4, 1, 2):
            point = "b" if number == 2 else "a"
            transaction.add_recording(judgment(number, state=states[number], point=point))
        assert transaction.newest() == hour(4)
    reader = history.reader

    def numbers(**filters: object) -> list[int]:
        rows = reader.recordings("pump-1", **filters)  # type: ignore[arg-type]
        return [file_number(row) for row in rows]

    assert numbers() == [4, 3, 2, 1, 0]

    last_of_first_page = reader.recordings("pump-1", limit=2)[-1]
    assert numbers(limit=2) == [4, 3]
    assert numbers(before=last_of_first_page.id) == [2, 1, 0]

    assert numbers(state="normal") == [4, 2, 0]
    assert numbers(point="b") == [2]
    # The interval is half open: adjoining periods share no recording.
    assert numbers(since=hour(1), until=hour(3)) == [2, 1]


def test_a_trend_has_its_newest_values_oldest_first_and_bridges_other_layouts(
    history: History,
) -> None:
    with history.machine("pump-1") as transaction:
        for number in range(6):
            indicators = {("x", "rms"): float(number), ("y", "rms"): -1.0}
            # From the fourth on the packed values have another order: a sensor was added.
            if number >= 3:
                indicators = {("y", "kurtosis"): 3.0, **indicators}
            alarm_p = 0.5 if number else None
            transaction.add_recording(judgment(number, alarm_p=alarm_p), indicators)
    reader = history.reader

    trend = reader.trend("pump-1", "x", "rms")
    assert trend.values.tolist() == [0, 1, 2, 3, 4, 5]
    assert trend.times[0] == np.datetime64("2026-03-01T06:00")
    assert (np.diff(trend.times) == np.timedelta64(1, "h")).all()

    newest = reader.trend("pump-1", "x", "rms", limit=2)
    assert newest.values.tolist() == [4, 5]

    recent = reader.trend("pump-1", "x", "rms", since=hour(5))
    assert recent.values.tolist() == [5]

    # Without a channel the name is a column of the recordings.
    column = reader.trend("pump-1", "", "alarm_p")
    np.testing.assert_array_equal(column.values, [np.nan] + [0.5] * 5)

    assert reader.trend("pump-1", "z", "rms").values.size == 0
    # A column that is no number is refused with those that are.
    with pytest.raises(InputError, match="capital"):
        reader.trend("pump-1", "", "content")


def test_an_alarm_is_closed_once_it_is_both_cleared_and_acknowledged(history: History) -> None:
    with history.machine("pump-1") as transaction:
        pump_alarm = transaction.open_alarm("pump", "a", START, {"rise": 9.0}, None).id
        sensor_alarm = transaction.open_alarm("sensor", None, START, {}, None).id

    # One alarm is cleared first, the other acknowledged first: neither alone closes it.
    with history.machine("pump-1") as transaction:
        transaction.clear_alarm(pump_alarm, hour(1))
        assert [alarm.state for alarm in transaction.alarms()] == ["open", "open"]

    with history.machine("pump-1") as transaction:
        transaction.acknowledge(pump_alarm, "operator", "seen")
        transaction.acknowledge(sensor_alarm, "operator")
        assert [alarm.id for alarm in transaction.alarms()] == [sensor_alarm]
        transaction.clear_alarm(sensor_alarm, hour(2))

    closed = history.reader.alarm(pump_alarm)
    assert closed is not None
    assert closed.state == "closed"
    assert (closed.who, closed.note) == ("operator", "seen")
    assert closed.evidence == {"rise": 9.0}

    assert [alarm.id for alarm in history.reader.alarms("pump-1")] == [sensor_alarm, pump_alarm]
    assert history.reader.alarms(state="open") == []
    assert history.reader.alarm(999) is None


def test_an_alarm_is_acknowledged_once_and_only_through_its_own_machine(history: History) -> None:
    with history.machine("pump-1") as transaction:
        closed = transaction.open_alarm("pump", "a", START, {}, None).id
        standing = transaction.open_alarm("sensor", None, START, {}, None).id
        transaction.clear_alarm(closed, hour(1))
        transaction.acknowledge(closed, "operator")

    with history.machine("pump-1") as transaction:
        transaction.acknowledge(standing, "operator")
        with pytest.raises(InputError, match="acknowledged already"):
            transaction.acknowledge(standing, "other")
        with pytest.raises(InputError, match="no alarm 999"):
            transaction.acknowledge(999, "operator")
        # A refusal does not undo what else the transaction does.
        transaction.clear_alarm(standing, hour(2))

    # A form that is sent for another machine must not reach the alarms of this one.
    with pytest.raises(InputError, match="no alarm"), history.machine("pump-2") as transaction:
        transaction.acknowledge(closed, "operator")

    alarms = history.reader.alarms("pump-1")
    assert [alarm.state for alarm in alarms] == ["closed", "closed"]
    assert [alarm.who for alarm in alarms] == ["operator", "operator"]


def test_a_rejection_of_the_same_content_is_counted(history: History) -> None:
    for number in range(3):
        duplicate = rejection(
            "a.wav",
            "c",
            received=hour(number),
            machine="pump-1",
            reason="double",
        )
        history.reject(duplicate)
    history.reject(rejection("b.wav", "", source="http", copy="b.wav"))

    repeated, single = history.reader.rejections()
    assert repeated.times == 3
    assert repeated.received == hour(2)
    assert repeated.machine == "pump-1"

    assert single.times == 1
    assert single.machine == ""
    assert single.copy == "b.wav"

    assert history.reader.rejections_by_reason() == {"double": 3, "broken": 1}


def test_the_number_of_rejections_is_bounded(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin.monitoring.history.history.MAX_REJECTIONS", 5)

    for number in range(9):
        history.reject(rejection(f"{number}.wav", str(number)))
        # One that is repeated takes a row only once, and must not shift the limit.
        history.reject(rejection("again.wav", "again"))

    assert len(history.reader.rejections()) == 5


def test_retention_keeps_alarms_one_recording_a_day_and_the_latest(
    history_url: str, tmp_path: Path
) -> None:
    history = History.open(history_url, tmp_path, Retention(per_day=1, latest=3))
    for number in range(60):
        state = "alarm" if number in (30, 31) else "normal"
        add_with_waveform(history, judgment(number, state=state))

    # Recordings begin at six o'clock, so days begin with numbers 0, 18 and 42.
    kept_numbers = numbers_with_waveform(history, limit=100)
    assert kept_numbers == [59, 58, 57, 42, 31, 30, 18, 0]
    files = list(history.waveforms.folder.rglob("*.h5"))
    assert len(files) == len(kept_numbers)

    stored = history.reader.recordings("pump-1", limit=100)
    alarm = next(row for row in stored if row.file == "30.wav")
    samples = history.reader.waveform(alarm.id)
    assert samples is not None
    np.testing.assert_array_equal(samples.signal, waveform(30).signal)

    # Number 49 is neither an alarm, nor the first of its day, nor among the latest.
    assert history.reader.waveform(stored[10].id) is None
    history.close()


def test_an_alarm_keeps_the_recordings_before_it_also_under_another_retention(
    history_url: str, tmp_path: Path
) -> None:
    history = History.open(history_url, tmp_path, Retention(per_day=1, latest=3))
    for number in range(57, 60):
        add_with_waveform(history, judgment(number))
    history.close()

    # Limits may change between two runs of a watch; they hold for what is filed from then on.
    history = History.open(history_url, tmp_path, Retention(per_day=0, latest=3))
    for number in range(60, 70):
        row_id = add_with_waveform(history, judgment(number))
        if number == 64:
            with history.machine("pump-1") as transaction:
                transaction.open_alarm("pump", "a", START, {}, row_id)

    # The latest three, and the three that were the latest when the alarm was raised.
    assert numbers_with_waveform(history, limit=10) == [69, 68, 67, 64, 63, 62]
    history.close()


def test_sweeping_removes_old_files_that_no_recording_has(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    filed_path = write_waveform(history, judgment(1))
    orphaned_path = write_waveform(history, judgment(2))
    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(1), waveform=filed_path)

    # A young file may belong to a transaction that is not committed yet.
    assert history.waveforms.sweep() == 0

    monkeypatch.setattr("swashtwin.monitoring.history.waveforms.MIN_ORPHAN_AGE_S", -1)
    assert history.waveforms.sweep() == 1
    assert (history.waveforms.folder / filed_path).is_file()
    assert not (history.waveforms.folder / orphaned_path).exists()
