"""Roles of recordings in a study are disjoint, and missing recordings are reported."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_case import TINY, tiny

from swashtwin.foundation import DataError
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin_bench import build_plan, run_plan
from swashtwin_bench.studies.cells import recordings_by_cell
from swashtwin_bench.studies.dataset import calibration_tasks, prepare_dataset
from swashtwin_bench.studies.scenario import split_scenario


@pytest.mark.parametrize("seed", range(5))
def test_no_recording_has_two_roles(recordings: list[Recording], seed: int) -> None:
    split = split_scenario(recordings, TINY, seed)
    lenders = frozenset(name for ids in split.scarce.values() for name in ids)
    roles = [split.train, lenders, split.references, *split.tests.values()]
    assert sum(map(len, roles)) == len(frozenset.union(*roles))
    by_id = {recording.recording_id: recording for recording in recordings}
    trained_on = {by_id[name].specimen for name in split.train}
    assert {by_id[name].specimen for name in split.tests["L2"]} <= trained_on
    assert not {by_id[name].specimen for name in split.tests["L4"] | split.references} & trained_on


@pytest.mark.parametrize("seed", range(5))
def test_one_recording_of_one_pump_fills_the_scarce_cell(
    recordings: list[Recording], seed: int
) -> None:
    dataset = prepare_dataset(recordings, TINY, seed, ())
    of_class = dataset.measured.label == "swash_plate"
    scarce = dataset.measured.subset(of_class & (dataset.measured.discharge_pressure > 12e6))
    assert len(scarce) == 3
    assert len(set(scarce.recording_id)) == 1


def test_references_are_healthy_of_the_pumps_held_out_and_never_tested(
    recordings: list[Recording],
) -> None:
    dataset = prepare_dataset(recordings, TINY, 0, ())
    references = [
        recording for recording in recordings if recording.recording_id in dataset.split.references
    ]
    assert references
    assert {recording.label for recording in references} == {"normal"}
    assert not {recording.specimen for recording in references} & set(dataset.measured.specimen)
    tested = {name for test in dataset.tests.values() for name in test.recording_id.tolist()}
    assert not tested & dataset.split.references
    assert set(dataset.roles()["reference"]) <= set(dataset.manifest)


def test_case_two_trains_on_no_measured_window_of_the_missing_cell(
    recordings: list[Recording],
) -> None:
    scenario = tiny("case2").scenario
    assert build_plan("case2", "paper").scenario.test_windows == 50
    assert build_plan("case2", "paper").scenario.synthetic == 200
    dataset = prepare_dataset(recordings, scenario, 0, ())
    assert dataset.measured.counts()["swash_plate", 15e6] == 0
    assert dataset.measured.counts()["swash_plate", 10e6] > 0
    used = {
        r.recording_id
        for task in calibration_tasks(recordings, scenario, 0)
        for r in task.recordings
    }
    assert used
    assert not any("swash_plate_15MPa" in name for name in used)


def test_the_law_starts_where_a_healthy_pump_was_recorded(recordings: list[Recording]) -> None:
    """A twin of an operating point of the recess alone would find no healthy recording to be
    calibrated on.
    """
    faster = [
        r.replace(condition=r.condition.replace(speed=1.3 * r.condition.speed))
        if r.label == "swash_plate"
        else r
        for r in recordings
        if r.condition is not None
    ]
    for task in calibration_tasks(faster, replace(TINY, calibrated_on="law"), 0):
        healthy = [
            r.condition for r in task.recordings if r.label == "normal" and r.condition is not None
        ]
        assert {r.label for r in task.recordings} == {"normal", "swash_plate"}
        assert all(
            any(twin.condition.matches(condition) for condition in healthy) for twin in task.twins
        )


def test_too_few_pumps_or_repeats_or_facts_are_named(recordings: list[Recording]) -> None:
    with pytest.raises(DataError, match="at least 2 specimens"):
        run_plan(tiny(), [r for r in recordings if r.specimen == "A"])
    once = [r for r in recordings if r.recording_id.endswith("_1")]
    with pytest.raises(DataError, match="two recordings of"):
        run_plan(tiny(), once)
    with pytest.raises(DataError, match="needs label, specimen"):
        run_plan(tiny(), [replace(recordings[0], specimen=None), *recordings[1:]])
    with pytest.raises(DataError, match="500 measured windows"):
        run_plan(tiny(scenario=replace(TINY, scarce_windows=500)), recordings)


def test_a_pressure_as_measured_is_counted_where_it_was_set() -> None:
    def at(pressure: float) -> Recording:
        condition = OperatingCondition(speed=90.0, discharge_pressure=pressure)
        return Recording(
            np.zeros((1, 10)), 1.0, f"{pressure}", label="normal", condition=condition, specimen="A"
        )

    cells = recordings_by_cell(
        [at(p) for p in (4.9e6, 5.1e6, 9.8e6, 10.2e6, 15.2e6, 14.7e6, 14.9e6)], "the study"
    )
    assert sorted(len(cell) for cell in cells) == [2, 2, 3]


def test_a_missing_test_pressure_is_refused_before_any_calibration(
    recordings: list[Recording],
) -> None:
    lower = [
        r for r in recordings if r.condition is not None and r.condition.discharge_pressure < 12e6
    ]
    with pytest.raises(DataError, match="tests at 15 MPa"):
        calibration_tasks(lower, tiny("case2").scenario, 0)
