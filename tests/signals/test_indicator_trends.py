"""A trend compares each recording with the healthy ones of its own machine."""

from dataclasses import replace

import numpy as np
import pytest
from pump_signals import SHAFT, pump

from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.signals import Trend, indicators_of, stack_tables, trend_of

# Six healthy recordings of a machine, within 2 % of each other.
HEALTHY_LEVELS = [1.0, 1.01, 0.99, 1.02, 0.98, 1.005]


def healthy_recordings(levels: list[float]) -> list[Recording]:
    """Return recordings called run0, run1 and so on with these levels."""
    return [
        pump(level, f"run{number}", seed=number, label="normal")
        for number, level in enumerate(levels)
    ]


def rms_trend(recordings: list[Recording], **options: object) -> Trend:
    tables = [indicators_of(recording, families=("statistics",)) for recording in recordings]
    return trend_of(stack_tables(tables), "rms", **options)  # type: ignore[arg-type]


def recording_ids(trend: Trend) -> list[str]:
    return [point.row.recording_id for point in trend.points]


# ---- baselines


def trend_of_three_tests() -> Trend:
    """Return the trend of a louder, an unchanged and a quieter recording after healthy ones."""
    test_recordings = [
        pump(1.5, "worn", 7, label="piston"),
        pump(1.01, "fine", 8, label="piston"),
        pump(0.5, "quiet", 9),
    ]
    return rms_trend([*healthy_recordings(HEALTHY_LEVELS), *test_recordings])


def test_recordings_are_above_within_or_below_the_baseline_of_their_machine() -> None:
    trend = trend_of_three_tests()

    statuses = {point.row.recording_id: point.status for point in trend.points if not point.healthy}
    assert statuses == {"worn": "above", "fine": "within", "quiet": "below"}


def test_recordings_outside_their_baseline_are_flagged() -> None:
    trend = trend_of_three_tests()

    assert [point.row.recording_id for point in trend.flagged] == ["quiet", "worn"]
    assert trend.to_dict()["flagged"] == ["quiet", "worn"]


def test_a_healthy_recording_is_not_in_its_own_baseline() -> None:
    trend = rms_trend(healthy_recordings([*HEALTHY_LEVELS, 3.0]))

    loud = trend.points[-1]
    assert loud.status == "above"
    assert loud.median < 1.05


def test_the_baseline_of_a_healthy_recording_is_the_other_healthy_ones() -> None:
    trend = trend_of_three_tests()

    assert [point.count for point in trend.points if point.healthy] == [5] * 6


def test_a_baseline_excludes_other_machines_and_operating_points() -> None:
    shaft_speed = 2 * np.pi * SHAFT
    recordings = [
        pump(1.0, "other machine", 5, specimen="P2"),
        pump(1.0, "other pressure", 6, condition=OperatingCondition(shaft_speed, MPa(10))),
        pump(1.0, "other speed", 7, condition=OperatingCondition(rpm(950), MPa(15))),
        # within 1 % of the speed of the baseline
        pump(1.0, "almost that speed", 8, condition=OperatingCondition(rpm(905), MPa(15))),
    ]

    trend = rms_trend([*healthy_recordings(HEALTHY_LEVELS), *recordings])

    without_baseline = {
        point.row.recording_id for point in trend.points if point.status == "no baseline"
    }
    assert without_baseline == {"other machine", "other pressure", "other speed"}


def test_healthy_recordings_can_be_specified_by_a_pattern() -> None:
    recordings = [pump(1.0, f"r{number}", number) for number in range(4)]

    trend = rms_trend(recordings, healthy=["r*"])

    assert all(point.healthy for point in trend.points)


# ---- order


def test_a_trend_is_in_the_order_of_names_or_of_dates() -> None:
    recordings = [
        replace(recording, attributes={"date": f"2024-01-0{9 - number}"})
        for number, recording in enumerate(healthy_recordings(HEALTHY_LEVELS))
    ]
    names = [f"run{number}" for number in range(6)]

    assert recording_ids(rms_trend(recordings)) == names
    assert recording_ids(rms_trend(recordings, by="time")) == names[::-1]


def test_a_trend_by_time_requires_dates() -> None:
    with pytest.raises(DataError, match="has no date"):
        rms_trend(healthy_recordings(HEALTHY_LEVELS), by="time")


# ---- refusals


def test_a_trend_without_a_healthy_recording_is_refused() -> None:
    with pytest.raises(DataError, match="No recording is healthy"):
        rms_trend([pump(label="piston")])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param({"k": 0.0}, "k ", id="no tolerance"),
        pytest.param(
            {"channel": "x"}, "no channel 'x'; there are cover, body", id="unknown channel"
        ),
    ],
)
def test_an_invalid_option_of_a_trend_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        rms_trend(healthy_recordings([1.0]), **options)
