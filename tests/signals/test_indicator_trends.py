"""Trends of indicators: a recording against its own machine's healthy ones."""

from dataclasses import replace

import numpy as np
import pytest
from pump_signals import SHAFT, pump

from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.signals import indicators_of, stack_tables, trend_of

HEALTHY = [1.0, 1.01, 0.99, 1.02, 0.98, 1.005]


def fleet(levels: list[float], **facts: object) -> list[Recording]:
    return [
        pump(level, f"run{i}", seed=i, label="normal", **facts) for i, level in enumerate(levels)
    ]


def trend(recordings: list[Recording], **options: object):  # type: ignore[no-untyped-def]
    table = stack_tables(
        [indicators_of(recording, families=("statistics",)) for recording in recordings]
    )
    return trend_of(table, "rms", **options)  # type: ignore[arg-type]


def test_a_louder_machine_is_flagged_against_its_own_baseline() -> None:
    test_recordings = [
        pump(1.5, "worn", 7, label="piston"),
        pump(1.01, "fine", 8, label="piston"),
        pump(0.5, "quiet", 9),
    ]
    result = trend([*fleet(HEALTHY), *test_recordings])

    assert {
        point.row.recording_id: point.status for point in result.points if not point.healthy
    } == {
        "worn": "above",
        "fine": "within",
        "quiet": "below",
    }
    assert [point.count for point in result.points if point.healthy] == [5] * 6
    assert [point.row.recording_id for point in result.flagged] == ["quiet", "worn"]
    assert result.to_dict()["flagged"] == ["quiet", "worn"]


def test_a_healthy_recording_is_not_in_its_own_baseline() -> None:
    result = trend(fleet([*HEALTHY, 3.0]))
    assert result.points[-1].status == "above"
    assert result.points[-1].median < 1.05


def test_a_baseline_excludes_other_machines_and_operating_points() -> None:
    healthy = fleet(HEALTHY)
    different = [
        pump(1.0, "other machine", 5, specimen="P2"),
        pump(
            1.0,
            "other pressure",
            6,
            condition=OperatingCondition(2 * np.pi * SHAFT, MPa(10)),
        ),
        pump(1.0, "other speed", 7, condition=OperatingCondition(rpm(950), MPa(15))),
        pump(1.0, "almost that speed", 8, condition=OperatingCondition(rpm(905), MPa(15))),
    ]
    result = trend([*healthy, *different])

    assert {point.row.recording_id for point in result.points if point.status == "no baseline"} == {
        "other machine",
        "other pressure",
        "other speed",
    }


def test_a_trend_goes_by_date_or_by_name() -> None:
    dated = [
        replace(recording, attributes={"date": f"2024-01-0{9 - i}"})
        for i, recording in enumerate(fleet(HEALTHY))
    ]

    assert [point.row.recording_id for point in trend(dated, by="time").points] == [
        f"run{i}" for i in (5, 4, 3, 2, 1, 0)
    ]
    assert [point.row.recording_id for point in trend(dated).points] == [
        f"run{i}" for i in range(6)
    ]
    with pytest.raises(DataError, match="has no date"):
        trend(fleet(HEALTHY), by="time")


def test_a_trend_without_a_baseline_or_with_invalid_options_is_refused() -> None:
    with pytest.raises(DataError, match="No recording is healthy"):
        trend([pump(label="piston")])
    with pytest.raises(InputError, match="k "):
        trend(fleet([1.0]), k=0.0)
    with pytest.raises(InputError, match="no channel 'x'; there are cover, body"):
        trend(fleet([1.0]), channel="x")

    result = trend([pump(1.0, f"r{i}", i) for i in range(4)], healthy=["r*"])
    assert all(point.healthy for point in result.points)
