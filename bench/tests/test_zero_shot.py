"""The zero-shot study on a very small rig: no measured fault teaches, no reference is tested, the rows are there."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from swashtwin.calibration import GaussNewton, Nuisances
from swashtwin.cli import app
from swashtwin.foundation import DataError
from swashtwin.learning import TrainingSettings
from swashtwin.pump import CLASSES
from swashtwin.recordings import Recording
from swashtwin_bench import StudyTable, run_zero_shot, write_study_report
from swashtwin_bench.questions import zero_shot_prior
from swashtwin_bench.questions.zero_shot import ZERO_SHOT_SIZES
from swashtwin_bench.questions.zero_shot_data import (
    BOTH_NORMALS,
    MEASURED_NORMALS,
    ORACLE,
    POSTERIOR,
    SAME,
    UNSEEN,
    ZeroShotData,
    prepare_zero_shot,
    split_zero_shot,
)
from swashtwin_bench.questions.zero_shot_prior import (
    FOREST,
    OTHER_PRESSURES,
    PRIOR,
    at_unseen_pressure,
    prior_trials,
)
from swashtwin_bench.questions.zero_shot_table import choose_zero_shot
from swashtwin_bench.studies.priors import any_fault, rig_fault, wide_fault

TINY = replace(
    ZERO_SHOT_SIZES["quick"],
    length=6144,
    windows=2,
    held_out=1,
    draws=2,
    synthetic=1,
    method=GaussNewton(starts=1),
    nuisances=Nuisances(),
    trees=12,
    training=TrainingSettings(epochs=1, normalization="set"),
    network={"stride": 64, "channels": (8, 8)},
    order_network={"stride": 16, "channels": (8, 8)},
)


@pytest.fixture(scope="module")
def two_pressures(recordings: list[Recording]) -> list[Recording]:
    return [recording for recording in recordings if "_10MPa_" not in recording.recording_id]


@pytest.fixture(scope="module")
def data(two_pressures: list[Recording]) -> ZeroShotData:
    return prepare_zero_shot(two_pressures, TINY, 0)


@pytest.fixture(scope="module")
def study(two_pressures: list[Recording], data: ZeroShotData) -> StudyTable:
    """The study of `data`, which is not prepared again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.questions.zero_shot.prepare_zero_shot", lambda *_: data)
        return run_zero_shot(two_pressures, size=TINY, seeds=(0,), command="swashtwin bench zero-shot rig")


@pytest.mark.parametrize("seed", range(4))
def test_no_recording_has_two_roles(two_pressures: list[Recording], seed: int) -> None:
    split = split_zero_shot(two_pressures, 1, seed)
    roles = [split.healthy, split.faulty, split.tests[SAME], split.tests[UNSEEN]]
    assert sum(map(len, roles)) == len(frozenset().union(*roles)) == len(two_pressures)
    assert not any("normal" in name for name in split.faulty)
    assert all("normal" in name for name in split.healthy)
    assert {name[0] for name in split.tests[UNSEEN]}.isdisjoint(split.pumps)


def test_no_measured_fault_is_in_any_training_set_but_the_oracles(data) -> None:
    for name, windows in data.sets.items():
        measured = windows.subset(~windows.synthetic)
        faults = set(measured.label.tolist()) - {"normal"}
        assert bool(faults) == (name == ORACLE), name
    assert data.strangers.synthetic.all()
    assert not any(windows.synthetic.any() for windows in data.tests.values())


def test_twins_are_calibrated_on_healthy_recordings_of_their_own_pump(data) -> None:
    for pump, calibration in data.calibrations.items():
        assert set(calibration.recording_ids) <= data.split.healthy
        assert {name[0] for name in calibration.recording_ids} == {pump}
        assert calibration.twin.fault is None


def test_the_variants_differ_in_their_normal_windows_only(data) -> None:
    def normals(name: str) -> tuple[int, int]:
        windows = data.sets[name]
        of_class = windows.synthetic[windows.label == "normal"]
        return int(of_class.sum()), int((~of_class).sum())

    synthetic, none = normals(POSTERIOR)
    _, measured = normals(BOTH_NORMALS)
    assert synthetic > 0 == none < measured
    assert normals(BOTH_NORMALS) == (synthetic, measured)
    assert normals(MEASURED_NORMALS) == (0, measured)


def test_every_pump_has_other_posterior_draws(data) -> None:
    twins = data.sets[POSTERIOR]
    levels = {name: float(twins.signal[twins.specimen == name].std()) for name in set(twins.specimen.tolist())}
    assert len(set(levels.values())) == len(levels) == 2 * TINY.draws


@pytest.mark.parametrize("draw", [wide_fault, any_fault, rig_fault])
def test_a_drawn_fault_is_of_its_class(draw) -> None:
    rng = np.random.default_rng(0)
    for label in CLASSES:
        for number in range(4):
            fault = draw(label, number, rng)
            assert ("normal" if fault is None else fault.label) == label


def test_wide_severities_span_most_of_a_decade() -> None:
    rng = np.random.default_rng(0)
    severities = [wide_fault("piston", 0, rng).severity for _ in range(200)]
    assert 7 < max(severities) / min(severities) < 10
    narrow = [rig_fault("piston", 0, rng).severity for _ in range(200)]
    assert max(narrow) / min(narrow) < 4


def test_the_rows_are_those_of_the_schema(study: StudyTable) -> None:
    table = json.loads(json.dumps(study.to_dict(), allow_nan=False))
    assert table["study"] == "zero-shot"
    for name in ("training_set", "classifier", "test", "balanced_accuracy", "g_mean", "recall_piston", "discriminator"):
        assert all(name in row for row in table["rows"])
    highest = {at_unseen_pressure(test) for test in (SAME, UNSEEN)}
    assert {row["test"] for row in table["rows"]} == {SAME, UNSEEN} | highest
    assert {"BiTCN", "extra trees", "order threshold"} <= {row["classifier"] for row in table["rows"]}
    assert "stand-in for a machine" in table["origin"]
    by_window = [row for row in table["rows"] if row["classifier"] != FOREST]
    assert len(table["details"]["confusion"]) == len(by_window)


def test_no_fault_at_the_highest_pressure_teaches_what_is_tested_there(
    two_pressures: list[Recording], data: ZeroShotData, monkeypatch: pytest.MonkeyPatch
) -> None:
    normal = {recording.recording_id for recording in two_pressures if recording.label == "normal"}
    faulty = {recording.recording_id for recording in two_pressures} - normal
    taught: list[set[str]] = []
    for method in ("teach", "learn_measured"):
        plain = getattr(zero_shot_prior._Rows, method)

        def note(*words: Any, plain: Any = plain) -> Any:
            taught.append(set(words[-1]))
            return plain(*words)

        monkeypatch.setattr(zero_shot_prior._Rows, method, note)
    split = replace(data.split, healthy=frozenset(normal), faulty=frozenset(faulty))
    trials = [trial.factors for trial in prior_trials(two_pressures, split, 0)]
    lower = {name for name in faulty if "_15MPa_" not in name}
    assert 0 < len(lower) < len(faulty)
    assert taught[-2:] == [lower, lower]
    at_highest = {trial["training_set"] for trial in trials if trial["test"].endswith("unseen pressure")}
    assert at_highest == {PRIOR, f"{PRIOR} and {OTHER_PRESSURES}", OTHER_PRESSURES}


def test_measured_faults_that_lack_a_class_leave_it_without_probability(
    two_pressures: list[Recording], data: ZeroShotData
) -> None:
    normal = {recording.recording_id for recording in two_pressures if recording.label == "normal"}
    pistons = {recording.recording_id for recording in two_pressures if recording.label == "piston"}
    split = replace(data.split, healthy=frozenset(normal), faulty=frozenset(pistons), tests={SAME: frozenset(pistons)})
    scores = {trial.factors["training_set"]: trial.values for trial in prior_trials(two_pressures, split, 0)}
    assert scores[ORACLE]["recall_piston"] == 1.0


def test_recordings_of_one_pressure_have_no_unseen_pressure(two_pressures: list[Recording], data: ZeroShotData) -> None:
    alone = [recording for recording in two_pressures if "_15MPa_" in recording.recording_id]
    names = {recording.recording_id for recording in alone}
    split = replace(
        data.split,
        healthy=data.split.healthy & names,
        faulty=data.split.faulty & names,
        tests={test: ids & names for test, ids in data.split.tests.items()},
    )
    assert {trial.factors["test"] for trial in prior_trials(alone, split, 0)} == {SAME, UNSEEN}


def test_a_stranger_recall_is_of_what_learned_and_a_choice_needs_no_measured_fault(study: StudyTable) -> None:
    training_set, classifier = choose_zero_shot(study)
    assert training_set not in (ORACLE, "prior draws")
    ruled = study.values("strangers", classifier="order threshold")
    assert np.isnan(ruled).all()
    assert not np.isnan(study.values("strangers", classifier=classifier)).any()


def test_the_page_shows_the_confusion_matrices(study: StudyTable, tmp_path) -> None:
    page = write_study_report(study, folder=tmp_path).read_text(encoding="utf-8")
    assert "Confusion matrices" in page
    assert (tmp_path / "figures" / "study_confusion_2.svg").is_file()


def test_a_single_healthy_recording_is_refused_by_name(two_pressures: list[Recording]) -> None:
    few = [recording for recording in two_pressures if recording.recording_id != "A_normal_5MPa_1"]
    with pytest.raises(DataError, match="A_normal_5MPa_2 is the only healthy recording"):
        split_zero_shot(few, 1, 0)


def test_two_pumps_without_a_twin_need_three_pumps(two_pressures: list[Recording]) -> None:
    with pytest.raises(DataError, match="at least 4 specimens"):
        split_zero_shot(two_pressures, 3, 0)


def test_the_command_takes_recordings_or_fleets_and_not_neither() -> None:
    result = CliRunner().invoke(app, ["bench", "zero-shot"])
    assert result.exit_code == 2
