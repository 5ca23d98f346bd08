"""A watch that judges the files in a folder and ends."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from watched_pumps import LEARNING, hum, watch_config, write_hum

from swashtwin.monitoring import History, Outcome, run_watch
from swashtwin.monitoring.alarms.monitor import OperatingPointMonitor
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.service import filing, running
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.recordings import write_recording

WORN_GAIN = 6.0
LOG_CHANNEL = '[[channel]]\nkind = "log"'


def judge(config: WatchConfig) -> list[Outcome]:
    """Return the outcomes of all files that are there."""
    outcomes: list[Outcome] = []
    run_watch(config, once=True, progress=outcomes.append)
    return outcomes


def judge_states(config: WatchConfig) -> list[str]:
    return [outcome.state for outcome in judge(config)]


@contextmanager
def opened_history(config: WatchConfig) -> Iterator[History]:
    history = History.open(config.history_url, config.folder)
    try:
        yield history
    finally:
        history.close()


def rejection_reasons(config: WatchConfig) -> dict[str, str]:
    """Return the code of the reason of each rejected file."""
    with opened_history(config) as history:
        return {rejection.file: rejection.reason for rejection in history.reader.rejections()}


def spool_of(config: WatchConfig) -> Spool:
    return Spool(config.folder / "spool")


def fail_first(function: Callable[..., Any], failures: list[Exception]) -> Callable[..., Any]:
    """Return `function`, whose calls fail until `failures` is empty; its last one comes first."""

    def unsteady(*arguments: Any, **options: Any) -> Any:
        if failures:
            raise failures.pop()
        return function(*arguments, **options)

    return unsteady


def test_a_pump_is_learned_then_watched_and_a_louder_one_raises_an_alarm(
    tmp_path: Path, history_url: str
) -> None:
    config = watch_config(tmp_path, LOG_CHANNEL, history=history_url)
    inbox = tmp_path / "incoming"

    for number in range(LEARNING + 5):
        write_hum(inbox / f"{number:03}.h5", number, number)
    assert judge_states(config) == ["learning"] * LEARNING + ["normal"] * 5

    for number in range(LEARNING + 5, LEARNING + 15):
        write_hum(inbox / f"{number:03}.h5", number, number, gain=WORN_GAIN)
    assert judge_states(config)[-1] == "alarm"

    with opened_history(config) as history:
        (alarm,) = history.reader.alarms("pump-1")
        assert (alarm.kind, alarm.state) == ("pump", "open")
        assert alarm.point == "1500 rpm, 15 MPa"
        # A watch that ends sends its messages before.
        assert history.outbox.waiting(["log"]) == 0
    assert "pump-1" in (config.folder / "alarms.log").read_text(encoding="utf-8")


def test_a_recording_that_a_baseline_leaves_out_is_named_with_the_reason(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    for number in range(5):
        write_hum(tmp_path / "incoming" / f"{number}.h5", number, number)
    write_hum(tmp_path / "incoming" / "5.h5", 5, 5, gain=WORN_GAIN)

    outcome = judge(config)[-1]
    assert outcome.sentence.startswith("learning 5/20; not learned from this recording: +")


def test_what_cannot_be_judged_is_filed_with_its_reason_and_stops_nothing(tmp_path: Path) -> None:
    # With two machines, only a sub-folder tells which of them a file is of.
    config = watch_config(tmp_path, machines=("pump-1", "pump-2"))
    inbox = tmp_path / "incoming"
    pump_1 = inbox / "pump-1"

    write_hum(pump_1 / "a.h5", 1, 100)
    # Files are taken oldest first, so this one is not late.
    write_hum(pump_1 / "early.h5", 2, 50)
    write_hum(pump_1 / "copy.h5", 1, 101)
    write_hum(pump_1 / "slow.h5", 3, 102, rate=2560.0)
    write_hum(pump_1 / "other.h5", 4, 103, channels=("x", "w"))
    write_hum(inbox / "pump-9" / "stranger.h5", 5, 104)
    write_hum(inbox / "nobody.h5", 6, 105)
    (pump_1 / "cut.h5").write_bytes((pump_1 / "a.h5").read_bytes()[:5000])
    (pump_1 / "empty.wav").write_bytes(b"")
    (pump_1 / "notes.xyz").write_text("no recording")
    outcomes = judge(config)

    # A later watch goes on. The time is four years ahead, so that of arrival is used.
    write_hum(pump_1 / "last.h5", 7, 2e6)
    assert judge_states(config) == ["learning"]

    reasons = rejection_reasons(config)
    assert reasons == {
        "copy.h5": "double",
        "stranger.h5": "machine",
        "nobody.h5": "machine",
        "cut.h5": "broken",
        "empty.wav": "broken",
        "notes.xyz": "broken",
        "slow.h5": "unfit",
        "other.h5": "unfit",
    }

    sentences = {
        outcome.file: outcome.sentence for outcome in outcomes if outcome.state == "rejected"
    }
    assert sentences.keys() == reasons.keys()
    assert "the configuration has pump-1, pump-2" in sentences["stranger.h5"]

    # Rejected files are kept to be repaired; the history has the samples of a duplicate.
    kept_files = [path.name.split("-", 2)[2] for path in (config.folder / "rejected").iterdir()]
    assert sorted(kept_files) == sorted(reasons.keys() - {"copy.h5"})


def test_a_recording_that_comes_late_is_rejected(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    inbox = tmp_path / "incoming"
    write_hum(inbox / "a.h5", 1, 100)
    judge(config)

    # Five minutes of disorder are allowed, since sources deliver in parallel.
    write_hum(inbox / "b.h5", 2, 98)
    write_hum(inbox / "c.h5", 3, 90)

    # Oldest first: c, then b.
    assert judge_states(config) == ["rejected", "learning"]
    assert rejection_reasons(config) == {"c.h5": "late"}


def test_a_clock_that_was_set_back_makes_no_recording_late(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    # Otherwise a clock that was wrong once would end the watch of the machine for a year.
    ahead = datetime.now(UTC) + timedelta(days=400)
    content = write_recording(hum(1), tmp_path / "a.h5").read_bytes()
    spool_of(config).add(Delivery("inbox", "a.h5", ahead, "pump-1"), content)
    judge(config)

    write_hum(tmp_path / "incoming" / "b.h5", 2)

    assert judge_states(config) == ["learning"]


def test_a_history_that_is_unavailable_for_a_while_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = watch_config(tmp_path)
    monkeypatch.setattr(running, "FIRST_PAUSE_S", 0.01)
    # A full disk, then a server that does not answer.
    failures = [HistoryError("away"), OSError(28, "No space left on device")]
    monkeypatch.setattr(History, "machine", fail_first(History.machine, failures))

    write_hum(tmp_path / "incoming" / "a.h5", 1, 0)

    assert judge_states(config) == ["learning"]
    assert failures == []


def test_an_error_of_the_watch_is_filed_and_the_next_recording_is_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    config = watch_config(tmp_path)
    failures = [ZeroDivisionError("division by zero")]
    unsteady_judge = fail_first(OperatingPointMonitor.judge, failures)
    monkeypatch.setattr(OperatingPointMonitor, "judge", unsteady_judge)

    for number in range(2):
        write_hum(tmp_path / "incoming" / f"{number}.h5", number, number)

    assert judge_states(config) == ["rejected", "learning"]
    assert rejection_reasons(config) == {"0.h5": "error"}
    assert "division by zero" in caplog.text


def test_an_alarm_raised_during_a_silence_is_reported_after_it(tmp_path: Path) -> None:
    config = watch_config(tmp_path, LOG_CHANNEL)
    inbox = tmp_path / "incoming"
    log = config.folder / "alarms.log"

    with opened_history(config) as history:
        with history.machine("pump-1") as transaction:
            transaction.silence(datetime.now(UTC) + timedelta(hours=1), "Kim")
        for number in range(LEARNING + 10):
            gain = 1.0 if number < LEARNING else WORN_GAIN
            write_hum(inbox / f"{number:03}.h5", number, number, gain=gain)
        assert judge_states(config)[-1] == "alarm"
        assert not log.exists()

        with history.machine("pump-1") as transaction:
            transaction.end_silence()
        # The next judgment posts what the silence held back.
        number = LEARNING + 10
        write_hum(inbox / f"{number:03}.h5", number, number, gain=WORN_GAIN)
        assert judge_states(config)[-1] == "alarm"

    assert log.read_text(encoding="utf-8").count("pump-1") == 1


def test_a_model_that_cannot_be_read_is_a_problem_and_the_watch_goes_on(tmp_path: Path) -> None:
    (tmp_path / "model.safetensors").write_bytes(b"no model")
    config = watch_config(tmp_path, machine='model = "model.safetensors"')
    write_hum(tmp_path / "incoming" / "a.h5", 1, 0)

    outcomes: list[Outcome] = []
    status = run_watch(config, once=True, progress=outcomes.append)

    # Alarms need no model.
    assert [outcome.state for outcome in outcomes] == ["learning"]
    assert "model of pump-1" in status.problems[0]


def test_a_file_that_vanished_from_the_spool_is_forgotten(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    write_hum(tmp_path / "incoming" / "a.h5", 1)
    # The spool still has the card of the file, and would try it for ever.
    spool_of(config).add(Delivery("inbox", "gone.h5", datetime.now(UTC), "pump-1"), b"content")
    next((config.folder / "spool").glob("*.h5")).unlink()

    assert [outcome.file for outcome in judge(config)] == ["a.h5"]


def test_a_machine_has_a_bounded_number_of_operating_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(filing, "MAX_OPERATING_POINTS", 1)
    config = watch_config(tmp_path)
    spool = spool_of(config)

    # The last speed is within the tolerance of the first, so it needs no point of its own.
    for number, speed in enumerate(("1500 rpm", "1000 rpm", "1510 rpm")):
        content = write_recording(hum(number), tmp_path / f"{number}.h5").read_bytes()
        delivery = Delivery(
            "inbox",
            f"{number}.h5",
            datetime.now(UTC),
            "pump-1",
            {"speed": speed},
        )
        spool.add(delivery, content)

    assert judge_states(config) == ["learning", "rejected", "learning"]
    assert rejection_reasons(config) == {"1.h5": "points"}
