"""Roles of recordings in a study are disjoint, and missing recordings are reported."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tiny_case import TINY, tiny

from swashtwin.foundation import DataError
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin_bench import build_plan, run_plan
from swashtwin_bench.studies.cells import recordings_by_cell
from swashtwin_bench.studies.dataset import calibration_tasks, prepare_dataset
from swashtwin_bench.studies.scenario import ScenarioSplit, split_scenario


def lenders_of(split: ScenarioSplit) -> frozenset[str]:
    """Return the recordings that may provide the windows of a scarce cell."""
    return frozenset().union(*split.scarce.values())


# ---- roles


@pytest.mark.parametrize("seed", range(5))
def test_no_recording_has_two_roles(recordings: list[Recording], seed: int) -> None:
    split = split_scenario(recordings, TINY, seed)
    roles = [split.train, lenders_of(split), split.references, *split.tests.values()]
    assert sum(map(len, roles)) == len(frozenset.union(*roles))


@pytest.mark.parametrize("seed", range(5))
def test_l2_tests_on_pumps_that_were_trained_on_and_l4_on_others(
    recordings: list[Recording], seed: int
) -> None:
    split = split_scenario(recordings, TINY, seed)
    specimen_of = {recording.recording_id: recording.specimen for recording in recordings}

    trained_on = {specimen_of[name] for name in split.train}
    assert {specimen_of[name] for name in split.tests["L2"]} <= trained_on
    held_out = split.tests["L4"] | split.references
    assert not {specimen_of[name] for name in held_out} & trained_on


@pytest.mark.parametrize("seed", range(5))
def test_one_recording_of_one_pump_fills_the_scarce_cell(
    recordings: list[Recording], seed: int
) -> None:
    measured = prepare_dataset(recordings, TINY, seed, ()).measured
    # pressures are 5, 10 and 15 MPa, and the scarce cell is at 15
    is_scarce = (measured.label == "swash_plate") & (measured.discharge_pressure > 12e6)
    scarce = measured.subset(is_scarce)
    assert len(scarce) == 3
    assert len(set(scarce.recording_id)) == 1


def test_references_are_healthy_recordings_of_the_held_out_pumps(
    recordings: list[Recording],
) -> None:
    dataset = prepare_dataset(recordings, TINY, 0, ())
    ids = dataset.split.references
    references = [recording for recording in recordings if recording.recording_id in ids]
    assert references
    assert {recording.label for recording in references} == {"normal"}
    assert not {recording.specimen for recording in references} & set(dataset.measured.specimen)
    assert set(dataset.roles()["reference"]) <= set(dataset.manifest)


def test_references_are_never_tested(recordings: list[Recording]) -> None:
    # a classifier that compares with them would otherwise be tested on other windows
    dataset = prepare_dataset(recordings, TINY, 0, ())
    for test in dataset.tests.values():
        assert not set(test.recording_id.tolist()) & dataset.split.references


# ---- calibrations


def test_case_two_has_the_counts_of_the_paper() -> None:
    scenario = build_plan("case2", "paper").scenario
    assert (scenario.test_windows, scenario.synthetic) == (50, 200)


def test_case_two_trains_on_no_measured_window_of_the_missing_cell(
    recordings: list[Recording],
) -> None:
    dataset = prepare_dataset(recordings, tiny("case2").scenario, 0, ())
    counts = dataset.measured.counts()
    assert counts["swash_plate", 15e6] == 0
    assert counts["swash_plate", 10e6] > 0


def test_case_two_calibrates_on_no_recording_of_the_missing_cell(
    recordings: list[Recording],
) -> None:
    calibrated_on: set[str] = set()
    for task in calibration_tasks(recordings, tiny("case2").scenario, 0):
        calibrated_on |= {recording.recording_id for recording in task.recordings}

    assert calibrated_on
    assert not any("swash_plate_15MPa" in name for name in calibrated_on)


def test_the_law_starts_at_an_operating_point_of_a_healthy_recording(
    recordings: list[Recording],
) -> None:
    """A twin has to find healthy recordings to calibrate on.

    Here the recess was recorded at a speed at which no healthy pump was.
    """
    faster = []
    for recording in recordings:
        assert recording.condition is not None
        if recording.label == "swash_plate":
            speed = 1.3 * recording.condition.speed
            recording = recording.replace(condition=recording.condition.replace(speed=speed))
        faster.append(recording)

    for task in calibration_tasks(faster, replace(TINY, calibrated_on="law"), 0):
        assert {recording.label for recording in task.recordings} == {"normal", "swash_plate"}
        healthy = [
            recording.condition
            for recording in task.recordings
            if recording.label == "normal" and recording.condition is not None
        ]
        for twin in task.twins:
            assert any(twin.condition.matches(condition) for condition in healthy)


# ---- missing recordings


def test_too_few_pumps_are_reported(recordings: list[Recording]) -> None:
    of_one_pump = [recording for recording in recordings if recording.specimen == "A"]
    with pytest.raises(DataError, match="at least 2 specimens"):
        run_plan(tiny(), of_one_pump)


def test_too_few_repeats_are_reported(recordings: list[Recording]) -> None:
    once = [recording for recording in recordings if recording.recording_id.endswith("_1")]
    with pytest.raises(DataError, match="two recordings of"):
        run_plan(tiny(), once)


def test_an_unknown_specimen_is_reported(recordings: list[Recording]) -> None:
    nameless = replace(recordings[0], specimen=None)
    with pytest.raises(DataError, match="needs label, specimen"):
        run_plan(tiny(), [nameless, *recordings[1:]])


def test_too_few_windows_are_reported(recordings: list[Recording]) -> None:
    changes: dict[str, Any] = {"scenario": replace(TINY, scarce_windows=500)}
    with pytest.raises(DataError, match="500 measured windows"):
        run_plan(tiny(**changes), recordings)


def test_a_missing_test_pressure_is_refused_before_any_calibration(
    recordings: list[Recording],
) -> None:
    lower_pressures = [
        recording
        for recording in recordings
        if recording.condition is not None and recording.condition.discharge_pressure < 12e6
    ]
    with pytest.raises(DataError, match="tests at 15 MPa"):
        calibration_tasks(lower_pressures, tiny("case2").scenario, 0)


def test_measured_pressures_are_counted_at_the_set_ones() -> None:
    def recording_at(pressure: float) -> Recording:
        return Recording(
            np.zeros((1, 10)),
            1.0,
            f"{pressure}",
            label="normal",
            condition=OperatingCondition(speed=90.0, discharge_pressure=pressure),
            specimen="A",
        )

    # two around 5 MPa, two around 10 and three around 15
    pressures = (4.9e6, 5.1e6, 9.8e6, 10.2e6, 15.2e6, 14.7e6, 14.9e6)
    cells = recordings_by_cell([recording_at(pressure) for pressure in pressures], "the study")
    assert sorted(len(cell) for cell in cells) == [2, 2, 3]
