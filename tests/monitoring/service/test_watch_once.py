"""What a watch makes of the files in a folder."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from watched_pumps import LEARNING, hum, watch_config, write_hum

from swashtwin.monitoring import History, Outcome, run_watch
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.service import filing, running
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.recordings import write_recording


def judge(config: WatchConfig) -> list[Outcome]:
    outcomes: list[Outcome] = []
    run_watch(config, once=True, progress=outcomes.append)
    return outcomes


def opened(config: WatchConfig) -> History:
    return History.open(config.history_url, config.folder)


def reasons(config: WatchConfig) -> dict[str, str]:
    with_reasons = opened(config)
    try:
        return {rejection.file: rejection.reason for rejection in with_reasons.reader.rejections()}
    finally:
        with_reasons.close()


def test_a_pump_is_learned_then_watched_and_a_louder_one_raises_an_alarm(
    tmp_path: Path, history_url: str
) -> None:
    config = watch_config(tmp_path, '[[channel]]\nkind = "log"', history=history_url)
    for number in range(LEARNING + 5):
        write_hum(tmp_path / "incoming" / f"{number:03}.h5", number, number)
    states = [outcome.state for outcome in judge(config)]
    assert states == ["learning"] * LEARNING + ["normal"] * 5
    for number in range(LEARNING + 5, LEARNING + 15):
        write_hum(tmp_path / "incoming" / f"{number:03}.h5", number, number, gain=6.0)
    assert judge(config)[-1].state == "alarm"
    history = opened(config)
    (alarm,) = history.reader.alarms("pump-1")
    assert (alarm.kind, alarm.state, alarm.point) == ("pump", "open", "1500 rpm, 15 MPa")
    assert history.outbox.waiting(["log"]) == 0
    history.close()
    assert "pump-1" in (config.folder / "alarms.log").read_text(encoding="utf-8")


def test_what_cannot_be_judged_is_filed_with_its_reason_and_stops_nothing(tmp_path: Path) -> None:
    config = watch_config(tmp_path, machines=("pump-1", "pump-2"))
    inbox = tmp_path / "incoming"
    write_hum(inbox / "pump-1" / "a.h5", 1, 100)
    write_hum(inbox / "pump-1" / "copy.h5", 1, 101)
    write_hum(inbox / "pump-1" / "early.h5", 2, 50)
    write_hum(inbox / "pump-1" / "slow.h5", 3, 102, rate=2560.0)
    write_hum(inbox / "pump-1" / "other.h5", 4, 103, channels=("x", "w"))
    write_hum(inbox / "pump-9" / "stranger.h5", 5, 104)
    write_hum(inbox / "nobody.h5", 6, 105)
    (inbox / "pump-1" / "cut.h5").write_bytes((inbox / "pump-1" / "a.h5").read_bytes()[:5000])
    (inbox / "pump-1" / "empty.wav").write_bytes(b"")
    (inbox / "pump-1" / "notes.xyz").write_text("no recording")
    outcomes = judge(config)
    write_hum(inbox / "pump-1" / "last.h5", 7, 2e6)
    assert [outcome.state for outcome in judge(config)] == ["learning"]
    rejected = {
        outcome.file: outcome.sentence for outcome in outcomes if outcome.state == "rejected"
    }
    filed = reasons(config)
    assert filed["copy.h5"] == "double"
    assert filed["stranger.h5"] == filed["nobody.h5"] == "machine"
    assert filed["cut.h5"] == filed["empty.wav"] == filed["notes.xyz"] == "broken"
    assert filed["slow.h5"] == filed["other.h5"] == "unfit"
    assert filed.keys() == rejected.keys()
    assert "the configuration has pump-1, pump-2" in rejected["stranger.h5"]
    copies = [path.name.split("-", 2)[2] for path in (config.folder / "rejected").iterdir()]
    assert sorted(copies) == sorted(name for name in rejected if name != "copy.h5")


def test_what_comes_late_is_filed_as_late_and_a_clock_that_was_set_back_makes_nothing_late(
    tmp_path: Path,
) -> None:
    config = watch_config(tmp_path / "late")
    write_hum(tmp_path / "late" / "incoming" / "a.h5", 1, 100)
    judge(config)
    write_hum(tmp_path / "late" / "incoming" / "b.h5", 2, 98)
    write_hum(tmp_path / "late" / "incoming" / "c.h5", 3, 90)
    assert [outcome.state for outcome in judge(config)] == ["rejected", "learning"]
    assert reasons(config) == {"c.h5": "late"}
    config = watch_config(tmp_path / "back")
    ahead = datetime.now(UTC) + timedelta(days=400)
    content = write_recording(hum(1), tmp_path / "a.h5").read_bytes()
    Spool(config.folder / "spool").add(Delivery("inbox", "a.h5", ahead, "pump-1"), content)
    judge(config)
    write_hum(tmp_path / "back" / "incoming" / "b.h5", 2)
    assert [outcome.state for outcome in judge(config)] == ["learning"]


def test_a_history_that_is_away_for_a_while_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = watch_config(tmp_path)
    monkeypatch.setattr(running, "FIRST_PAUSE_S", 0.01)
    machine = History.machine
    failures = [HistoryError("away"), OSError(28, "No space left on device")]

    def unsteady(history: History, name: str):
        if failures:
            raise failures.pop()
        return machine(history, name)

    monkeypatch.setattr(History, "machine", unsteady)
    write_hum(tmp_path / "incoming" / "a.h5", 1, 0)
    assert [outcome.state for outcome in judge(config)] == ["learning"]
    assert failures == []


def test_an_error_of_ours_is_filed_and_the_next_recording_is_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from swashtwin.monitoring.alarms.monitor import OperatingPointMonitor

    config = watch_config(tmp_path)
    original = OperatingPointMonitor.judge
    failures = [ZeroDivisionError("division by zero")]

    def unsteady(*arguments: object, **options: object):
        if failures:
            raise failures.pop()
        return original(*arguments, **options)

    monkeypatch.setattr(OperatingPointMonitor, "judge", unsteady)
    for number in range(2):
        write_hum(tmp_path / "incoming" / f"{number}.h5", number, number)
    assert [outcome.state for outcome in judge(config)] == ["rejected", "learning"]
    assert reasons(config) == {"0.h5": "error"}
    assert "division by zero" in caplog.text


def test_an_alarm_that_was_raised_in_a_silence_is_told_when_the_silence_is_over(
    tmp_path: Path,
) -> None:
    config = watch_config(tmp_path, '[[channel]]\nkind = "log"')
    history = opened(config)
    with history.machine("pump-1") as transaction:
        transaction.silence(datetime.now(UTC) + timedelta(hours=1), "Kim")
    for first, end in ((0, LEARNING + 10), (LEARNING + 10, LEARNING + 11)):
        for number in range(first, end):
            write_hum(
                tmp_path / "incoming" / f"{number:03}.h5",
                number,
                number,
                gain=1.0 if number < LEARNING else 6.0,
            )
        assert judge(config)[-1].state == "alarm"
        assert (config.folder / "alarms.log").exists() == (first > 0)
        with history.machine("pump-1") as transaction:
            transaction.end_silence()
    history.close()
    assert (config.folder / "alarms.log").read_text(encoding="utf-8").count("pump-1") == 1


def test_a_model_that_cannot_be_read_is_a_problem_and_the_watch_goes_on(tmp_path: Path) -> None:
    (tmp_path / "model.safetensors").write_bytes(b"no model")
    config = watch_config(tmp_path, machine='model = "model.safetensors"')
    write_hum(tmp_path / "incoming" / "a.h5", 1, 0)
    outcomes: list[Outcome] = []
    status = run_watch(config, once=True, progress=outcomes.append)
    assert [outcome.state for outcome in outcomes] == ["learning"]
    assert "model of pump-1" in status.problems[0]


def test_a_file_that_vanished_from_the_spool_is_forgotten(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    write_hum(tmp_path / "incoming" / "a.h5", 1)
    spool = Spool(config.folder / "spool")
    spool.add(Delivery("inbox", "gone.h5", datetime.now(UTC), "pump-1"), b"content")
    next((config.folder / "spool").glob("*.h5")).unlink()
    assert [outcome.file for outcome in judge(config)] == ["a.h5"]


def test_a_machine_has_a_bounded_number_of_operating_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(filing, "MAX_OPERATING_POINTS", 1)
    config = watch_config(tmp_path)
    spool = Spool(config.folder / "spool")
    for number, speed in enumerate(("1500 rpm", "1000 rpm", "1510 rpm")):
        content = write_recording(hum(number), tmp_path / f"{number}.h5").read_bytes()
        spool.add(
            Delivery("inbox", f"{number}.h5", datetime.now(UTC), "pump-1", {"speed": speed}),
            content,
        )
    assert [outcome.state for outcome in judge(config)] == ["learning", "rejected", "learning"]
    assert reasons(config) == {"1.h5": "points"}
