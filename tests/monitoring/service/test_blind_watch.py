"""A watch that gets nothing usable says so: refused deliveries, wrong clocks, unreadable tags."""

import os
import re
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from watched_pumps import LEARNING, RATE, START, hum, watch_config, write_hum

from swashtwin.foundation import InputError
from swashtwin.monitoring import History, Outcome, run_watch
from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.page.states import state_of
from swashtwin.monitoring.service import judging
from swashtwin.monitoring.service.deliveries import N_IN_A_ROW, DeliveryState, place
from swashtwin.monitoring.service.judging import Pipeline
from swashtwin.monitoring.service.running import Watch
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.message_format import read_message
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.monitoring.status import WatchStatus
from swashtwin.recordings import write_recording

LOG_CHANNEL = '[[channel]]\nkind = "log"'
WORN_GAIN = 6.0
AN_HOUR_BACK = 10 * LEARNING - 60
"""Minutes from `START` to the date of the recording after the baseline, an hour behind."""
LOGGER_RESET = (datetime(2000, 1, 1, 0, 5, tzinfo=UTC) - START).total_seconds() / 60
"""Minutes from `START` to the date of a logger that lost its battery."""


def judge(config: WatchConfig) -> tuple[list[Outcome], WatchStatus]:
    outcomes: list[Outcome] = []
    status = run_watch(config, once=True, progress=outcomes.append)
    return outcomes, status


def states(outcomes: Sequence[Outcome]) -> list[str]:
    return [outcome.state for outcome in outcomes]


@contextmanager
def opened_history(config: WatchConfig):
    history = History.open(config.history_url, config.folder)
    try:
        yield history
    finally:
        history.close()


def overview(config: WatchConfig, name: str = "pump-1") -> MachineOverview:
    with opened_history(config) as history:
        return next(machine for machine in history.reader.machines() if machine.name == name)


def events(config: WatchConfig) -> list[str]:
    """Return kind and event of each message that was sent."""
    path = config.folder / "alarms.log"
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [" ".join(re.findall(r"(\w+) alarm (\w+)", line)[0]) for line in lines]


def learn(config: WatchConfig, count: int) -> None:
    inbox = config.path.parent / "incoming"
    for number in range(count):
        write_hum(inbox / f"{number:03}.h5", number, 10 * number)
    assert states(judge(config)[0]) == ["learning"] * count


@pytest.fixture(scope="module")
def learned_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a watch that has learned its baseline."""
    folder = tmp_path_factory.mktemp("learned")
    learn(watch_config(folder, LOG_CHANNEL), LEARNING)
    # The copy of a file would be a delivery of its own.
    for path in (folder / "incoming").iterdir():
        path.unlink()
    return folder


@pytest.fixture
def learned(learned_folder: Path, tmp_path: Path) -> WatchConfig:
    """A copy of such a watch in the folder of the test, which may change it."""
    shutil.copytree(learned_folder, tmp_path, dirs_exist_ok=True)
    return load_watch_config(tmp_path / "watch.toml")


def add_broken(config: WatchConfig, names: str) -> None:
    for name in names:
        (config.path.parent / "incoming" / f"{name}.h5").write_bytes(f"no HDF5 {name}".encode())


def test_refused_deliveries_in_a_row_are_a_finding_until_one_can_be_used(
    tmp_path: Path, history_url: str
) -> None:
    config = watch_config(tmp_path, LOG_CHANNEL, history=history_url)
    learn(config, 3)

    add_broken(config, "ab")
    _, status = judge(config)
    assert not status.problems
    assert events(config) == []

    # The count continues after a restart.
    add_broken(config, "c")
    outcomes, status = judge(config)
    assert outcomes[0].sentence.endswith("delivery alarm raised")
    (problem,) = status.problems
    assert "pump-1: 3 deliveries in a row" in problem
    assert "c.h5 (not readable as configured)" in problem
    assert state_of(overview(config)).code == "delivery"
    assert events(config) == ["delivery opened"]

    add_broken(config, "d")
    _, status = judge(config)
    assert "4 deliveries" in status.problems[0]
    assert events(config) == ["delivery opened"]

    write_hum(tmp_path / "incoming" / "good.h5", 50, 31)
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"]
    assert "delivery alarm cleared" in outcomes[0].sentence
    assert not status.problems
    assert events(config) == ["delivery opened", "delivery cleared"]
    (alarm,) = overview(config).alarms
    assert alarm.cleared is not None


def test_a_finding_outlives_a_restart_and_a_silence(tmp_path: Path) -> None:
    config = watch_config(tmp_path, LOG_CHANNEL)
    learn(config, 1)
    with opened_history(config) as history, history.machine("pump-1") as transaction:
        transaction.silence(datetime.now(UTC) + timedelta(hours=1), "Kim")
    add_broken(config, "abc")
    judge(config)
    assert events(config) == []

    # Nothing new came, and the watch still knows.
    _, status = judge(config)
    assert "pump-1" in status.problems[0]

    with opened_history(config) as history, history.machine("pump-1") as transaction:
        transaction.end_silence()
    add_broken(config, "d")
    judge(config)
    assert events(config) == ["delivery opened"]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"channels": ("x",)}, "unfit"),
        ({"rate": RATE / 2}, "unfit"),
        ({"channels": ("x", "y", "w")}, "unfit"),
    ],
)
def test_a_lost_channel_or_a_changed_rate_is_a_finding_within_three_deliveries(
    learned: WatchConfig, tmp_path: Path, change: dict[str, object], reason: str
) -> None:
    for number in range(N_IN_A_ROW):
        write_hum(tmp_path / "incoming" / f"n{number}.h5", 90 + number, 300 + number, **change)
    outcomes, status = judge(learned)
    assert states(outcomes) == ["rejected"] * N_IN_A_ROW
    assert "not fit for a verdict" in status.problems[0]
    with opened_history(learned) as history:
        assert {rejection.reason for rejection in history.reader.rejections()} == {reason}
    assert events(learned) == ["delivery opened"]


def write_csv(path: Path, seed: int, minute: float, unit: str = " [m/s^2]") -> None:
    """Write a recording whose headings have a unit, or lost it."""
    recording = hum(seed)
    time = np.arange(recording.n_samples) / RATE
    rows = np.column_stack([time, recording.signal.T])
    path.parent.mkdir(exist_ok=True)
    heading = f"time [s],x{unit},y{unit}"
    np.savetxt(path, rows, delimiter=",", header=heading, comments="", fmt="%.6f")
    moment = START.timestamp() + 60 * minute
    os.utime(path, (moment, moment))


def test_a_lost_unit_is_a_finding(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    write_csv(tmp_path / "incoming" / "a.csv", 1, 0)
    for number in range(N_IN_A_ROW):
        write_csv(tmp_path / "incoming" / f"n{number}.csv", 2 + number, 10 + number, unit="")
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"] + ["rejected"] * N_IN_A_ROW
    assert "pump-1" in status.problems[0]


def test_the_same_file_again_and_again_is_a_finding_and_a_repeated_delivery_is_none(
    tmp_path: Path,
) -> None:
    config = watch_config(tmp_path)
    inbox = tmp_path / "incoming"
    learn(config, 3)
    # A share that is delivered again as a whole.
    for number in range(3):
        write_hum(inbox / f"again-{number}.h5", number, 10 * number)
    _, status = judge(config)
    assert not status.problems

    # A logger that hangs.
    for number in range(N_IN_A_ROW):
        write_hum(inbox / f"stuck-{number}.h5", 2, 100 + number)
    _, status = judge(config)
    assert "the same samples again" in status.problems[0]


def test_a_machine_that_the_configuration_lacks_is_a_problem_of_its_source(tmp_path: Path) -> None:
    config = watch_config(tmp_path, machines=("pump-1", "pump-2"))
    for number in range(N_IN_A_ROW):
        write_hum(tmp_path / "incoming" / "Pump_1" / f"{number}.h5", number, number)
        write_hum(tmp_path / "incoming" / "pump-2" / f"{number}.h5", number, number)
    _, status = judge(config)
    assert status.problems == (
        "source folder: 3 recordings are of Pump_1, which the configuration does not have.",
    )


# Clocks


@pytest.mark.parametrize(
    "first",
    [LOGGER_RESET, AN_HOUR_BACK, -5e5],
    ids=["2000", "an hour", "a year"],
)
def test_a_clock_that_falls_back_hides_no_fault(
    learned: WatchConfig, tmp_path: Path, first: float
) -> None:
    inbox = tmp_path / "incoming"
    for number in range(10):
        write_hum(inbox / f"s{number}.h5", 600 + number, first + 10 * number, gain=WORN_GAIN)
    outcomes, status = judge(learned)
    assert states(outcomes)[-1] == "alarm"
    assert "rejected" not in states(outcomes)
    assert "clock" in outcomes[0].sentence
    assert "pump opened" in events(learned)
    assert "delivery opened" in events(learned)
    if first != AN_HOUR_BACK:
        assert "wrong clock" in status.problems[0]
        assert "Check the clock of the logger" in status.problems[0]


def test_one_file_of_1980_shuts_nothing_out(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    inbox = tmp_path / "incoming"
    minute_of_1980 = (datetime(1980, 1, 1, tzinfo=UTC) - START).total_seconds() / 60
    write_hum(inbox / "a_bad.h5", 500, minute_of_1980)
    for number in range(30):
        write_hum(inbox / f"r{number:03}.h5", number, 10 * number)
    outcomes, status = judge(config)
    assert Counter(states(outcomes)) == {"learning": LEARNING, "normal": 31 - LEARNING}
    assert "clock" in outcomes[0].sentence
    assert not status.problems
    # The page shows the newest recording, and not the one with the wrong date.
    assert overview(config).last.file == "r029.h5"


def test_an_archive_keeps_its_dates(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    inbox = tmp_path / "incoming"
    for number in range(24):
        # A recording a day, months ago, with a gap of weeks.
        write_hum(inbox / f"r{number:03}.h5", number, 1440 * (number - 300 + 40 * (number > 9)))
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"] * LEARNING + ["normal"] * 4
    assert not any("clock" in outcome.sentence for outcome in outcomes)
    assert not status.problems
    with opened_history(config) as history:
        newest = history.reader.recordings(limit=1)[0]
    assert newest.time == START + timedelta(days=23 - 300 + 40)


def test_live_dates_an_hour_behind_stay_with_the_arrival_until_the_clock_is_right() -> None:
    noon = datetime(2026, 11, 23, 12, tzinfo=UTC)
    hour = timedelta(hours=1)
    state = DeliveryState(newest=noon)
    for minutes in range(10, 200, 10):
        received = noon + timedelta(minutes=minutes)
        assert place(state, received - hour, received) == "clock"
        state = DeliveryState(noon, wrong_date=received - hour, wrong_received=received)
    assert place(state, received, received + timedelta(minutes=1)) == "date"


def test_recordings_that_were_kept_during_an_outage_keep_their_dates() -> None:
    noon = datetime(2026, 11, 23, 12, tzinfo=UTC)
    state = DeliveryState(newest=noon)
    received = noon + timedelta(hours=5)
    for minutes in range(10, 300, 10):
        date = noon + timedelta(minutes=minutes)
        assert place(state, date, received) == "date"
        state = DeliveryState(newest=date)


def test_late_recordings_in_a_row_are_those_of_a_clock() -> None:
    noon = datetime(2026, 11, 23, 12, tzinfo=UTC)
    date = noon - timedelta(minutes=12)
    placements = [place(DeliveryState(newest=noon, n_late=n), date, noon) for n in range(4)]
    assert placements == ["late", "late", "clock", "clock"]


# Tags


def tagged_config(folder: Path, text: str = LOG_CHANNEL, machine: str = "") -> WatchConfig:
    """Return a watch whose operating points come from tags alone."""
    path = watch_config(folder, text, machine=f'tags = "tags.csv"\n{machine}').path
    lines = path.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if not line.startswith(("speed", "discharge_pressure"))]
    path.write_text("\n".join(kept), encoding="utf-8")
    return load_watch_config(path)


def write_tags(folder: Path, cells: Sequence[str], separator: str = ",") -> None:
    head = separator.join(("time", "speed", "pressure"))
    lines = []
    for number, cell in enumerate(cells):
        time = START + timedelta(minutes=10 * number - 1)
        lines.append(f"{time:%Y-%m-%dT%H:%M:%SZ}{separator}{cell}\n")
    (folder / "tags.csv").write_text(f"{head}\n{''.join(lines)}")


def write_hums(folder: Path, count: int, start: int = 0) -> None:
    for number in range(start, start + count):
        write_hum(folder / "incoming" / f"r{number:03}.h5", number, 10 * number)


def points(config: WatchConfig) -> set[str | None]:
    with opened_history(config) as history:
        return {judgment.point for judgment in history.reader.recordings()}


def test_tags_with_semicolons_give_the_operating_point(tmp_path: Path) -> None:
    config = tagged_config(tmp_path)
    write_tags(tmp_path, ["1498;15,1"] * 4, ";")
    write_hums(tmp_path, 4)
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"] * 4
    assert points(config) == {"1498 rpm, 15.1 MPa"}
    assert not status.problems


def test_recordings_wait_for_tags_that_cannot_be_read_and_are_judged_in_order_once_they_can(
    tmp_path: Path,
) -> None:
    config = tagged_config(tmp_path)
    write_tags(tmp_path, ["1,498;15,100"] * 5, ";")
    write_hums(tmp_path, 4)
    outcomes, status = judge(config)
    assert states(outcomes) == ["waiting"] * 4
    assert status.waiting == 4
    (problem,) = status.problems
    assert "tags.csv" in problem
    assert "two readings" in problem
    assert points(config) == set()
    assert events(config) == ["delivery opened"]
    assert state_of(overview(config)).code == "delivery"

    write_tags(tmp_path, ["1498.0;15.1"] * 6, ";")
    write_hums(tmp_path, 2, start=4)
    outcomes, status = judge(config)
    assert [outcome.file for outcome in outcomes] == [f"r{number:03}.h5" for number in range(6)]
    assert states(outcomes) == ["learning"] * 6
    assert not status.problems
    assert status.waiting == 0
    assert events(config) == ["delivery opened", "delivery cleared"]


def test_a_machine_that_waits_for_its_tags_keeps_no_other_waiting(tmp_path: Path) -> None:
    config = watch_config(tmp_path, machines=("pump-1",))
    text = config.path.read_text(encoding="utf-8")
    config.path.write_text(f'{text}\n[[machine]]\nname = "pump-2"\ntags = "tags.csv"\n')
    config = load_watch_config(config.path)
    for number in range(3):
        for machine in ("pump-1", "pump-2"):
            name = f"{machine}-{number}.h5"
            write_hum(tmp_path / "incoming" / machine / name, number, number)
    outcomes, _ = judge(config)
    assert sorted((outcome.machine, outcome.state) for outcome in outcomes) == [
        *[("pump-1", "learning")] * 3,
        *[("pump-2", "waiting")] * 3,
    ]


def test_a_bad_line_refuses_its_recordings_and_no_others(tmp_path: Path) -> None:
    config = tagged_config(tmp_path)
    write_tags(tmp_path, ["1498,15.1", "Bad Input,15.1", "1498,2190", "0,0", "1498,15.1"])
    write_hums(tmp_path, 5)
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning", "rejected", "rejected", "rejected", "learning"]
    assert "line 3" in outcomes[1].sentence
    assert "line 4" in outcomes[2].sentence
    assert "pump at rest" in outcomes[3].sentence
    assert points(config) == {"1498 rpm, 15.1 MPa"}
    assert not status.problems


def test_a_pump_that_stands_still_is_no_finding(tmp_path: Path) -> None:
    config = tagged_config(tmp_path)
    write_tags(tmp_path, ["1498,15.1", *["0.2,0.02"] * 5])
    write_hums(tmp_path, 6)
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"] + ["rejected"] * 5
    assert not status.problems


def test_local_times_are_asked_for_and_the_answer_works(tmp_path: Path) -> None:
    config = tagged_config(tmp_path)
    write_tags(tmp_path, ["1498,15.1"] * 4)
    path = tmp_path / "tags.csv"
    path.write_text(path.read_text().replace("Z,", ","))
    write_hums(tmp_path, 3)
    _, status = judge(config)
    assert "tags_zone" in status.problems[0]

    config = tagged_config(tmp_path, machine='tags_zone = "UTC"')
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"] * 3
    assert not status.problems


def test_the_values_of_the_configuration_replace_tags_and_that_is_a_finding(tmp_path: Path) -> None:
    config = watch_config(tmp_path, machine='tags = "missing.csv"')
    write_hums(tmp_path, 3)
    outcomes, status = judge(config)
    assert states(outcomes) == ["learning"] * 3
    assert "missing.csv" in status.problems[0]
    assert points(config) == {"1500 rpm, 15 MPa"}


def test_a_kill_counts_no_refused_delivery_twice(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    learn(config, 1)
    content = write_recording(hum(9, rate=RATE / 2), tmp_path / "a.h5").read_bytes()
    received = datetime.now(UTC)
    for _ in range(N_IN_A_ROW):
        Spool(config.folder / "spool").add(Delivery("inbox", "a.h5", received, "pump-1"), content)
    _, status = judge(config)
    assert not status.problems


def test_recordings_are_judged_while_the_watch_runs_once_their_tags_are_repaired(
    tmp_path: Path,
) -> None:
    config = tagged_config(tmp_path)
    (tmp_path / "tags.csv").write_text("no tags\n")
    spool = Spool(config.folder / "spool")
    content = [write_recording(hum(n), tmp_path / f"{n}.h5").read_bytes() for n in range(2)]
    for number in range(2):
        facts = {"time": (START + timedelta(minutes=10 * number)).isoformat()}
        delivery = Delivery("inbox", f"{number}.h5", datetime.now(UTC), "pump-1", facts)
        spool.add(delivery, content[number])

    with opened_history(config) as history:
        pipeline = Pipeline(config, history)
        for _ in range(2):
            file = spool.next(0.0)
            assert file is not None
            assert pipeline.judge(file).is_waiting
            spool.hold(file)
        assert spool.next(0.0) is None
        assert len(spool) == spool.n_held == 2
        assert not pipeline.may_resume()

        write_tags(tmp_path, ["1498,15.1"] * 3)
        assert pipeline.may_resume()
        pipeline.resume()
        spool.release()
        for number in range(2):
            file = spool.next(0.0)
            assert file is not None
            assert file.delivery.file == f"{number}.h5"
            assert pipeline.judge(file).state == "learning"
            spool.remove(file)


def test_a_machine_keeps_a_bounded_number_of_recordings_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judging, "MAX_HELD", 2)
    config = tagged_config(tmp_path)
    write_hums(tmp_path, 4)
    outcomes, _ = judge(config)
    assert states(outcomes) == ["waiting", "waiting", "rejected", "rejected"]
    with opened_history(config) as history:
        assert {rejection.reason for rejection in history.reader.rejections()} == {"tags"}


# Messages and uploads


def test_a_message_of_1970_counts_by_its_arrival() -> None:
    header = b'{"file": "a.wav", "time": "1970-01-01T00:02:00Z", "speed": "1500 rpm"}\n'
    delivery, _ = read_message(header + b"content", "mqtt", datetime.now(UTC), "pump-1")
    assert delivery.problem is None
    assert delivery.facts["time"].startswith("1970")


def test_uploads_that_are_refused_in_a_row_are_a_problem_of_their_source(tmp_path: Path) -> None:
    config = watch_config(tmp_path, '[[source]]\nkind = "http"')
    with opened_history(config) as history:
        watch = Watch(config, history, lambda _: None)
        for number in range(N_IN_A_ROW):
            assert not watch.status().problems
            path = tmp_path / f"{number}.bin"
            path.write_bytes(b"content")
            with pytest.raises(InputError):
                watch.upload(path, "a.wav", "pump-1", {"speed": "-5 rpm"})
        (problem,) = watch.status().problems
        assert "3 uploads in a row were refused" in problem

        watch.upload(path, "a.wav", "pump-1", {"speed": "5 rpm"})
        assert not watch.status().problems
