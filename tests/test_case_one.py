"""Case I on a very small rig: the roles are kept apart, the rows are there, and bad data is refused in words."""

import json
from dataclasses import replace

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton
from swashtwin.errors import DataError
from swashtwin.recording import Recording
from swashtwin.rig import RigSize, rig_recordings
from swashtwin.studies import CASE_ONE_SIZES, StudyResult, run_case_one
from swashtwin.studies.case_one import TRAINING_SETS, split_case_one
from swashtwin.studies.result import spread
from swashtwin.training import TrainingSettings

TINY = replace(
    CASE_ONE_SIZES["quick"],
    windows=2,
    scarce_windows=3,
    synthetic=6,
    held_out=1,
    training=TrainingSettings(epochs=1, normalization="set"),
    network={"stride": 32, "channels": (8, 8)},
    method=GaussNewton(starts=1),
)


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    return [recording for recording, _ in rig_recordings(0, RigSize(specimens=3, repeats=2, duration=1.2))]


@pytest.fixture(scope="module")
def result(recordings: list[Recording]) -> StudyResult:
    return run_case_one(recordings, size=TINY, seeds=(0, 1), command="swashtwin study case1 rig")


@pytest.mark.parametrize("seed", range(5))
def test_no_recording_has_two_roles(recordings: list[Recording], seed: int) -> None:
    split = split_case_one(recordings, TINY, seed)
    assert not split.train & split.tests["L2"]
    assert not split.train & split.tests["L4"]
    by_id = {recording.recording_id: recording for recording in recordings}
    trained_on = {by_id[name].specimen for name in split.train}
    assert {by_id[name].specimen for name in split.tests["L2"]} <= trained_on
    assert not {by_id[name].specimen for name in split.tests["L4"]} & trained_on


@pytest.mark.parametrize("seed", range(5))
def test_one_recording_of_one_pump_fills_the_scarce_cell(recordings: list[Recording], seed: int) -> None:
    split = split_case_one(recordings, TINY, seed)
    scarce = [name for name in split.train if "swash_plate_15MPa" in name]
    assert len(scarce) == 1
    assert len([name for name in split.train if "piston_15MPa" in name]) == 2


def test_the_rows_are_those_of_the_schema(result: StudyResult) -> None:
    told = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert [(row["training_set"], row["level"]) for row in told["rows"]] == [
        (name, level) for name in TRAINING_SETS for level in ("L2", "L4")
    ]
    for row in [*told["rows"], *told["rivals"]]:
        for name in ("accuracy", "recall", "f1", "g_mean", "recording_accuracy", "scarce_recall"):
            assert len(row[name]["values"]) == 2
            assert row[name]["mean"] == pytest.approx(np.mean(row[name]["values"]))
    assert {row["classifier"] for row in told["rivals"]} == {"extra_trees"}
    assert told["study"] == "case1"
    assert told["seeds"] == [0, 1]
    assert "stand-in for a machine" in told["origin"]


def test_synthetic_windows_are_in_the_filled_training_sets_only(result: StudyResult) -> None:
    assert "of them synthetic" not in result.cells["measured"]
    assert "of them synthetic" not in result.cells["L2"]
    for name in ("nominal", "calibrated"):
        assert result.cells[name]["of them synthetic"] == 6
        filled, bare = (result.cells[key]["swash_plate @ 15 MPa"] for key in (name, "measured"))
        assert (filled, bare) == (9, 3)


def test_a_test_set_holds_every_class_alike(result: StudyResult) -> None:
    for level in ("L2", "L4"):
        assert len({count for name, count in result.cells[level].items() if "15 MPa" in name}) == 1
        assert len(result.cells[level]) == 5


def test_every_training_pump_is_calibrated_away_from_the_tests(
    result: StudyResult, recordings: list[Recording]
) -> None:
    split = split_case_one(recordings, TINY, 0)
    assert len(result.calibrations) == 2
    for calibration in result.calibrations:
        assert set(calibration.recording_ids) <= split.train


def test_the_same_seed_gives_the_same_scores(recordings: list[Recording], result: StudyResult) -> None:
    again = run_case_one(recordings, size=TINY, seeds=(0,), jobs=2)
    first = [one.scores.accuracy for one in result.outcomes if one.seed == 0]
    assert [one.scores.accuracy for one in again.outcomes] == first


def test_the_figures_of_the_report_are_there(result: StudyResult) -> None:
    assert {curve.training_set for curve in result.curves} == set(TRAINING_SETS)
    assert [embedding.training_set for embedding in result.embeddings] == list(TRAINING_SETS)
    windows = sum(result.cells[level][name] for level in ("L2", "L4") for name in result.cells[level])
    for embedding in result.embeddings:
        assert len(embedding.label) == len(embedding.level) == len(embedding.features) == windows


def test_too_few_pumps_or_repeats_or_facts_are_named(recordings: list[Recording]) -> None:
    with pytest.raises(DataError, match="at least 2 specimens"):
        run_case_one([r for r in recordings if r.specimen == "A"], size=TINY)
    once = [r for r in recordings if r.recording_id.endswith("_1")]
    with pytest.raises(DataError, match="two recordings of"):
        run_case_one(once, size=TINY)
    with pytest.raises(DataError, match="needs label, specimen"):
        run_case_one([replace(recordings[0], specimen=None), *recordings[1:]], size=TINY)


def test_a_spread_of_one_value_has_no_deviation() -> None:
    assert spread([0.5]) == {"mean": 0.5, "std": None, "values": [0.5]}
    assert spread([float("nan")]) == {"mean": None, "std": None, "values": [None]}
    assert spread([0.25, 0.75])["std"] == pytest.approx(np.std([0.25, 0.75], ddof=1))
