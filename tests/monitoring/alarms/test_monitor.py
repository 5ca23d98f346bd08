"""One machine's monitor: it learns, stays quiet, raises an alarm that names the levels, clears it,
and says why not.
"""

import json

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


def course(
    machine: Machine, rises: list[float], state: OperatingPointState | None = None, first: int = 0
) -> list[OperatingPointJudgment]:
    """Judgments on recordings with these rises [dB]; the state goes through JSON after each."""
    point_judgments = []
    for number, rise in enumerate(rises, first):
        point_judgment = MONITOR.judge(machine.recording(number, rise=rise), state)
        tables = (to_table(point_judgment.state.baseline), point_judgment.state.test_table())
        state = OperatingPointState.from_tables(
            *(json.loads(json.dumps(table)) for table in tables)
        )
        point_judgments.append(point_judgment)
    return point_judgments


@pytest.fixture(scope="module")
def watched(machine: Machine) -> OperatingPointState:
    """State after 20 healthy recordings were learned from and 20 watched."""
    return course(machine, [0.0] * 40)[-1].state


def test_the_first_twenty_recordings_are_learned_from_and_judged_by_nothing(
    machine: Machine,
) -> None:
    point_judgments = course(machine, [0.0] * 21)
    assert [result.learned for result in point_judgments[:20]] == list(range(1, 21))
    assert {result.stage for result in point_judgments[:20]} == {"learning"}
    assert all(result.capital is None and not result.is_alarm for result in point_judgments[:20])
    assert point_judgments[20].stage == "watching"
    assert point_judgments[20].p_value is not None


def test_recordings_that_the_baseline_dropped_count_as_large_ones_of_the_machine(
    machine: Machine,
) -> None:
    """Else a machine that is loud now and then raises false alarms, however alike its recordings
    are.
    """
    rises = [20.0 if number in (6, 9, 14) else 0.0 for number in range(23)]
    point_judgments = course(machine, rises)
    assert point_judgments[6].learned == 6
    assert "not learned from this recording" in point_judgments[6].notes[0]
    assert point_judgments[-1].learned == 20
    assert point_judgments[-1].state.test.large_share == 4 / 24


def test_a_rise_of_five_orders_raises_an_alarm_that_names_them(
    machine: Machine, watched: OperatingPointState
) -> None:
    point_judgments = course(machine, [12.0] * 8, watched, 40)
    raised = [result.pump for result in point_judgments].index("raised")
    assert raised <= 5
    evidence = point_judgments[raised]
    assert evidence.is_alarm
    assert evidence.capital is not None
    assert evidence.capital >= 100
    assert {change.channel for change in evidence.moved[:3]} == {"x"}
    assert any("shaft order" in reason for reason in evidence.reasons)
    assert json.loads(json.dumps(evidence.to_dict()))["moved"][0]["change"] == pytest.approx(
        12, abs=4
    )


def test_one_large_recording_raises_no_alarm(
    machine: Machine, watched: OperatingPointState
) -> None:
    point_judgments = course(machine, [20.0, *[0.0] * 10], watched, 40)
    assert point_judgments[0].is_large
    assert not any(result.pump for result in point_judgments)


def test_while_an_alarm_stands_nothing_is_bet_and_five_quiet_recordings_clear_it(
    machine: Machine, watched: OperatingPointState
) -> None:
    point_judgments = course(machine, [*[12.0] * 8, *[0.0] * 6], watched, 40)
    assert len({result.capital for result in point_judgments if result.is_alarm}) == 1
    assert [result.pump for result in point_judgments[8:]] == [None] * 4 + ["cleared", None]
    assert point_judgments[-1].capital is not None
    assert point_judgments[-1].capital <= 1


def test_the_baseline_has_median_and_scatter_of_each_level_that_a_judgment_has(
    machine: Machine, watched: OperatingPointState
) -> None:
    band_powers = baseline_band_powers(to_table(watched.baseline))
    point_judgment = course(machine, [0.0], watched, 40)[0]
    assert band_powers.keys() == point_judgment.band_powers.keys()
    spreads = [
        abs(point_judgment.band_powers[key] - median) / spread
        for key, (median, spread) in band_powers.items()
    ]
    assert np.mean(spreads) < 2


def test_the_same_recordings_give_the_same_judgments(
    machine: Machine, watched: OperatingPointState
) -> None:
    first, second = (course(machine, [0.0, 9.0, 12.0], watched, 40) for _ in range(2))
    assert [result.to_dict() for result in first] == [result.to_dict() for result in second]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda machine: machine.recording(40).replace(sample_rate=8000.0),
            "sample rate 4000 Hz against 8000 Hz",
        ),
        (lambda machine: machine.recording(40, seconds=0.45), "record longer"),
        (lambda machine: broken(machine.recording(40)), "missing or infinite"),
    ],
)
def test_a_recording_that_does_not_fit_the_baseline_is_refused(
    machine: Machine, watched: OperatingPointState, change, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        MONITOR.judge(change(machine), watched)


def broken(recording: Recording) -> Recording:
    """The recording without one of its samples."""
    signal = recording.signal.copy()
    signal[1, 7] = np.nan
    return recording.replace(signal=signal)


def recording(speed: float, pressure: float) -> Recording:
    """A recording at a speed [rev/min] and a pressure [MPa]."""
    return Recording(
        np.ones((1, 9)), 100.0, "r", condition=OperatingCondition(rpm(speed), MPa(pressure))
    )


POINTS = [
    OperatingPoint(rpm(860), MPa(10)),
    OperatingPoint(rpm(860), MPa(11)),
    OperatingPoint(rpm(1500), MPa(10)),
]


@pytest.mark.parametrize(
    ("speed", "pressure", "name"),
    [
        (862, 10.2, "860 rpm, 10 MPa"),
        (850, 10.8, "860 rpm, 11 MPa"),
        (1490, 10, "1500 rpm, 10 MPa"),
        (1200, 10, "1200 rpm, 10 MPa"),
    ],
)
def test_a_recording_belongs_to_the_nearest_point_or_makes_one(
    speed: float, pressure: float, name: str
) -> None:
    assert match_operating_point(recording(speed, pressure), POINTS).name == name
    assert (
        match_operating_point(Recording(np.ones((1, 9)), 100.0, "states nothing"), POINTS).name
        == "any"
    )


@given(some.floats(100, 3000), some.floats(1, 30))
def test_a_recording_belongs_to_the_point_that_it_made(speed: float, pressure: float) -> None:
    point = match_operating_point(recording(speed, pressure), POINTS)
    assert match_operating_point(recording(speed, pressure), [*POINTS, point]) == point
