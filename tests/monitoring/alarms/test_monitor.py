"""The monitor of one operating point, from its first recording to an alarm that is cleared."""

import json
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from small_machine import Machine

from swashtwin.foundation import DataError, MPa, rpm, to_table
from swashtwin.monitoring.alarms.baseline import baseline_band_powers
from swashtwin.monitoring.alarms.monitor import (
    OperatingPointJudgment,
    OperatingPointMonitor,
    OperatingPointState,
)
from swashtwin.monitoring.alarms.operating_point import OperatingPoint, match_operating_point
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

MONITOR = OperatingPointMonitor("pump-1")
HEALTHY = 0.0
N_WATCHED = 40


def judge_all(
    machine: Machine,
    rises: Sequence[float],
    state: OperatingPointState | None = None,
    start: int = 0,
) -> list[OperatingPointJudgment]:
    """Return the judgments of recordings with these rises [dB], the first with number `start`."""
    judgments = []
    for number, rise in enumerate(rises, start):
        judgment = MONITOR.judge(machine.recording(number, rise=rise), state)
        judgments.append(judgment)
        state = through_json(judgment.state)
    return judgments


def through_json(state: OperatingPointState) -> OperatingPointState:
    """Return a state as the history returns it: each recording may follow a restart."""
    baseline = json.loads(json.dumps(to_table(state.baseline)))
    test = json.loads(json.dumps(state.test_table()))
    return OperatingPointState.from_tables(baseline, test)


@pytest.fixture(scope="module")
def watched(machine: Machine) -> OperatingPointState:
    """State after 20 healthy recordings were learned from and 20 watched."""
    return judge_all(machine, [HEALTHY] * N_WATCHED)[-1].state


Follow = Callable[[Sequence[float]], list[OperatingPointJudgment]]


@pytest.fixture
def follow(machine: Machine, watched: OperatingPointState) -> Follow:
    """Return a function that judges recordings with these rises [dB] after the watched ones."""
    return lambda rises: judge_all(machine, rises, watched, N_WATCHED)


def test_the_first_twenty_recordings_are_learned_from_and_raise_no_alarm(machine: Machine) -> None:
    *learning, watching = judge_all(machine, [HEALTHY] * 21)

    assert [judgment.learned for judgment in learning] == list(range(1, 21))
    assert {judgment.stage for judgment in learning} == {"learning"}
    assert all(judgment.capital is None for judgment in learning)
    assert not any(judgment.is_alarm for judgment in learning)

    assert watching.stage == "watching"
    assert watching.p_value is not None


def test_recordings_that_the_baseline_dropped_count_as_large_ones_of_the_machine(
    machine: Machine,
) -> None:
    # Otherwise a machine that is loud now and then raises false alarms, however alike its
    # recordings are.
    loud_numbers = (6, 9, 14)
    rises = [20.0 if number in loud_numbers else HEALTHY for number in range(23)]

    judgments = judge_all(machine, rises)

    assert judgments[6].learned == 6
    assert "not learned from this recording" in judgments[6].notes[0]
    assert judgments[-1].learned == 20
    # Three of 23, and the next one, which the share supposes to be large.
    assert judgments[-1].state.test.large_share == 4 / 24


def test_a_rise_of_five_orders_raises_an_alarm_that_names_them(follow: Follow) -> None:
    judgments = follow([12.0] * 8)

    raised = [judgment.pump for judgment in judgments].index("raised")
    assert raised <= 5

    alarm = judgments[raised]
    assert alarm.is_alarm
    assert alarm.capital is not None
    # The reciprocal of the false alarm rate.
    assert alarm.capital >= 100

    assert {change.channel for change in alarm.moved[:3]} == {"x"}
    assert any("shaft order" in reason for reason in alarm.reasons)
    table = json.loads(json.dumps(alarm.to_dict()))
    assert table["moved"][0]["change"] == pytest.approx(12, abs=4)


def test_one_large_recording_raises_no_alarm(follow: Follow) -> None:
    judgments = follow([20.0, *[HEALTHY] * 10])

    assert judgments[0].is_large
    assert not any(judgment.pump for judgment in judgments)


def test_no_evidence_is_collected_during_an_alarm_and_five_quiet_recordings_clear_it(
    follow: Follow,
) -> None:
    judgments = follow([*[12.0] * 8, *[HEALTHY] * 6])

    capitals = {judgment.capital for judgment in judgments if judgment.is_alarm}
    assert len(capitals) == 1

    quiet = judgments[8:]
    assert [judgment.pump for judgment in quiet] == [None] * 4 + ["cleared", None]

    # The test starts anew: evidence of the alarm that is over must not raise the next one.
    assert judgments[-1].capital is not None
    assert judgments[-1].capital <= 1


def test_the_baseline_has_median_and_spread_of_each_band_power_of_a_judgment(
    watched: OperatingPointState, follow: Follow
) -> None:
    baseline = baseline_band_powers(to_table(watched.baseline))
    (judgment,) = follow([HEALTHY])

    assert baseline.keys() == judgment.band_powers.keys()
    deviations = []
    for key, (median, spread) in baseline.items():
        deviations.append(abs(judgment.band_powers[key] - median) / spread)
    # A healthy recording lies within its spread on average; wrong keys or units would not.
    assert np.mean(deviations) < 2


def test_the_same_recordings_give_the_same_judgments(follow: Follow) -> None:
    rises = [HEALTHY, 9.0, 12.0]
    first = [judgment.to_dict() for judgment in follow(rises)]
    second = [judgment.to_dict() for judgment in follow(rises)]

    # Ties of p-values are broken by numbers drawn for the recording, not for the process.
    assert first == second


def test_an_alarm_goes_on_while_a_sensor_is_faulty(follow: Follow, machine: Machine) -> None:
    alarm = follow([12.0] * 8)[-1]
    assert alarm.is_alarm

    recording = machine.recording(N_WATCHED + 8)
    flat = recording.signal.copy()
    flat[0] = 0.0
    judgment = MONITOR.judge(recording.replace(signal=flat), alarm.state)

    assert judgment.stage == "sensor"
    assert judgment.is_alarm
    assert judgment.learned == alarm.learned
    assert judgment.state.pump == alarm.state.pump


def test_each_recording_draws_its_own_rank_among_equal_scores(machine: Machine) -> None:
    recording = machine.recording(0)
    state = None
    p_values = []
    for _ in range(60):
        judgment = MONITOR.judge(recording, state)
        state = judgment.state
        if judgment.p_value is not None:
            p_values.append(judgment.p_value)

    # All scores are equal, so the draws alone decide. One draw for all would give equal p-values,
    # which are not uniform, and the limit of the false alarms rests on that they are.
    counts, _ = np.histogram(p_values, bins=4, range=(0, 1))
    assert len(p_values) == 40
    assert counts.min() >= 4


def with_missing_sample(recording: Recording) -> Recording:
    signal = recording.signal.copy()
    signal[1, 7] = np.nan
    return recording.replace(signal=signal)


@pytest.mark.parametrize(
    ("make_recording", "message"),
    [
        pytest.param(
            lambda machine: machine.recording(40).replace(sample_rate=8000.0),
            "sample rate 4000 Hz against 8000 Hz",
            id="other sample rate",
        ),
        # Nine turns of the shaft; recordings of the baseline have twenty.
        pytest.param(
            lambda machine: machine.recording(40, seconds=0.45), "record longer", id="too short"
        ),
        pytest.param(
            lambda machine: with_missing_sample(machine.recording(40)),
            "missing or infinite",
            id="missing sample",
        ),
    ],
)
def test_a_recording_that_does_not_fit_the_baseline_is_refused(
    machine: Machine,
    watched: OperatingPointState,
    make_recording: Callable[[Machine], Recording],
    message: str,
) -> None:
    with pytest.raises(DataError, match=message):
        MONITOR.judge(make_recording(machine), watched)


def recording_at(speed_rpm: float, pressure_mpa: float) -> Recording:
    condition = OperatingCondition(rpm(speed_rpm), MPa(pressure_mpa))
    return Recording(np.ones((1, 9)), 100.0, "r", condition=condition)


POINTS = [
    OperatingPoint(rpm(860), MPa(10)),
    OperatingPoint(rpm(860), MPa(11)),
    OperatingPoint(rpm(1500), MPa(10)),
]


@pytest.mark.parametrize(
    ("speed", "pressure", "name"),
    [
        # between two points, nearer to the first, then nearer to the second
        (862, 10.2, "860 rpm, 10 MPa"),
        (850, 10.8, "860 rpm, 11 MPa"),
        (1490, 10, "1500 rpm, 10 MPa"),
        # far from all: a point of its own
        (1200, 10, "1200 rpm, 10 MPa"),
    ],
)
def test_a_recording_belongs_to_the_nearest_point_or_makes_one(
    speed: float, pressure: float, name: str
) -> None:
    assert match_operating_point(recording_at(speed, pressure), POINTS).name == name


def test_a_recording_without_speed_and_pressure_belongs_to_any_point() -> None:
    recording = Recording(np.ones((1, 9)), 100.0, "specifies nothing")
    assert match_operating_point(recording, POINTS).name == "any"


@given(some.floats(100, 3000), some.floats(1, 30))
def test_a_recording_belongs_to_the_point_that_it_made(speed: float, pressure: float) -> None:
    recording = recording_at(speed, pressure)
    point = match_operating_point(recording, POINTS)
    assert match_operating_point(recording, [*POINTS, point]) == point
