"""The paper's cases on a very small rig: roles are kept apart, tasks are resumed, and bad data is
refused with its reason.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stub_runs import run
from tiny_case import TINY, tiny

from swashtwin.foundation import ArtifactError, InputError
from swashtwin.pump import PistonWear
from swashtwin.recordings import Recording
from swashtwin_bench import Plan, StudyResult, Work, build_plan, run_plan, write_study_report
from swashtwin_bench.fillers.interpolation import SMOTE
from swashtwin_bench.results.page import build_differences_table, build_scores_table
from swashtwin_bench.results.runs import load_run
from swashtwin_bench.rivals.models import OWN_NETWORK
from swashtwin_bench.studies import runner
from swashtwin_bench.studies.dataset import calibration_tasks
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.runner import build_study, find_fleets
from swashtwin_bench.studies.scenario import MACHINED, split_scenario
from swashtwin_bench.studies.training_sets import TrainingSet

SETS = ("measured", "nominal", "calibrated")
MEASURED = {"measured": TrainingSet()}


# ---- Case I on the tiny rig


@pytest.fixture(scope="module")
def table(result: StudyResult) -> dict[str, Any]:
    """JSON of Case I."""
    return json.loads(json.dumps(result.to_dict(), allow_nan=False))  # type: ignore[no-any-return]


def test_a_study_has_a_row_for_each_classifier_training_set_and_split(
    table: dict[str, Any],
) -> None:
    expected = []
    for classifier in (OWN_NETWORK, "extra_trees"):
        for training_set in SETS:
            expected += [(classifier, training_set, split) for split in ("L2", "L4")]

    names = [(row["classifier"], row["training_set"], row["split"]) for row in table["rows"]]
    assert names == expected


def test_a_row_has_the_mean_of_each_metric_over_the_seeds(table: dict[str, Any]) -> None:
    assert table["seeds"] == [0, 1]
    metrics = ("accuracy", "recall", "f1", "g_mean", "recording_accuracy", "scarce_recall")
    for row in table["rows"]:
        for name in metrics:
            values = row[name]["values"]
            assert len(values) == 2
            assert row[name]["mean"] == pytest.approx(np.mean(values))


def test_the_json_of_a_study_has_its_name_origin_roles_and_differences(
    table: dict[str, Any],
) -> None:
    assert table["study"] == "case1"
    assert "stand-in for a machine" in table["origin"]
    assert set(table["splits"]["0"]) == {"train", "calibration", "reference", "L2", "L4"}
    # the calibrated set minus two others, for two classifiers on two splits
    assert len(table["differences"]) == 8


@pytest.mark.parametrize("name", ["nominal", "calibrated"])
def test_a_filled_training_set_has_synthetic_windows_in_the_scarce_cell(
    result: StudyResult, name: str
) -> None:
    assert result.cells[name]["of them synthetic"] == 6
    # three measured windows and the six synthetic ones
    assert result.cells["measured"]["swash_plate @ 15 MPa"] == 3
    assert result.cells[name]["swash_plate @ 15 MPa"] == 9


@pytest.mark.parametrize("name", ["measured", "L2", "L4"])
def test_measured_sets_and_tests_have_no_synthetic_window(result: StudyResult, name: str) -> None:
    assert "of them synthetic" not in result.cells[name]


@pytest.mark.parametrize("split", ["L2", "L4"])
def test_a_test_has_equally_many_windows_of_each_class(result: StudyResult, split: str) -> None:
    cells = result.cells[split]
    assert len(cells) == 5
    assert len({count for name, count in cells.items() if "15 MPa" in name}) == 1


def test_every_training_pump_is_calibrated_away_from_the_tests(
    result: StudyResult, recordings: list[Recording]
) -> None:
    split = split_scenario(recordings, TINY, 0)
    assert len(result.calibrations) == 2
    for calibration in result.calibrations:
        assert set(calibration.recording_ids) <= split.train | set(split.scarce["swash_plate"])


def test_a_rerun_reads_the_finished_runs(
    recordings: list[Recording], result: StudyResult, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "train_and_test", lambda *_, **__: pytest.fail("was finished"))
    messages: list[str] = []
    work = Work((0, 1), out=out, progress=lambda what, *_: messages.append(what))
    again = run_plan(tiny(), recordings, work)

    assert again.rows() == result.rows()
    assert messages == ["6 of seed 0 already finished", "6 of seed 1 already finished"]
    assert len(again.calibrations) == 2
    # the command that made the runs, not that of the rerun
    assert again.command == "swashtwin bench study case1 rig"


def confusions(study: StudyResult) -> list[Any]:
    """Return the confusion matrices under seed 0 of the measured training set."""
    matrices = []
    for run_, row in study.tests(training_set="measured"):
        if run_["seed"] == 0:
            matrices.append((run_["factors"], row["split"], row["confusion"]))
    return matrices


@pytest.mark.nightly
def test_two_processes_give_the_same_scores(
    recordings: list[Recording], result: StudyResult
) -> None:
    in_parallel = run_plan(tiny(training_sets=MEASURED), recordings, Work(jobs=2))
    assert confusions(in_parallel) == confusions(result)


# ---- keys of tasks: a run is only read for the same settings and data


DATA = "0" * 64
"""Fingerprint of some recordings."""


def keys_of(plan: Plan, seed: int = 0, data: str = DATA) -> set[str]:
    return {task.key for task in plan.tasks(seed, data)}


def with_worn_twin(plan: Plan) -> Plan:
    """Return a plan whose twin has twice the piston clearance."""
    pump = plan.scenario.pump
    group = pump.rotating_group
    worn_group = replace(group, piston_clearance=2 * group.piston_clearance)
    return tiny(scenario=replace(plan.scenario, pump=replace(pump, rotating_group=worn_group)))


def with_two_epochs(plan: Plan) -> Plan:
    models = {name: model.with_training(epochs=2) for name, model in plan.models.items()}
    return tiny(models=models)


@pytest.mark.parametrize(
    "change",
    [
        lambda plan: tiny(scenario=replace(plan.scenario, synthetic=7)),
        with_worn_twin,
        with_two_epochs,
        lambda plan: tiny(perturbations=(Perturbation("white", 5.0),)),
    ],
    ids=["synthetic", "pump", "epochs", "perturbation"],
)
def test_another_setting_is_another_task(change: Any) -> None:
    plan = tiny()
    keys = keys_of(plan)
    assert len(keys) == 6

    # trees have no epochs, so only the tasks of the network must differ in each case
    tasks = change(plan).tasks(0, DATA)
    of_network = {task.key for task in tasks if task.factors["classifier"] == OWN_NETWORK}
    assert not keys & of_network


def test_another_seed_and_other_recordings_are_other_tasks() -> None:
    plan = tiny()
    assert not keys_of(plan) & keys_of(plan, seed=1)
    assert not keys_of(plan) & keys_of(plan, data="1" * 64)


def test_another_setting_of_a_filler_is_another_task(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = tiny(training_sets={"smote": TrainingSet("smote")})
    keys = keys_of(plan)
    monkeypatch.setattr(
        "swashtwin_bench.studies.training_sets.FILLERS", {"smote": SMOTE(neighbors=2)}
    )
    assert not keys & keys_of(plan)


def test_a_key_holds_everything_that_twins_are_made_of() -> None:
    def keys_by_factors(**changes: Any) -> dict[str, str]:
        plan = build_plan("augmentation", "paper")
        plan = replace(plan, scenario=replace(plan.scenario, **changes))
        return {"-".join(task.factors.values()): task.key for task in plan.tasks(0, "data")}

    original = keys_by_factors()
    worn = (PistonWear(clearance=1e-4),)
    changed = keys_by_factors(faults={**MACHINED, "piston": worn})

    # the scarce class is the swash plate; only sets that fill every class simulate the piston
    differing = {name for name, key in original.items() if changed[name] != key}
    assert differing == {name for name in changed if "every_class" in name}


def test_a_calibration_is_not_reused_for_recordings_with_other_facts(
    recordings: list[Recording],
) -> None:
    faster = []
    for recording in recordings:
        assert recording.condition is not None
        faster.append(replace(recording, condition=recording.condition.replace(speed=92.0)))

    keys = {task.key for task in calibration_tasks(recordings, TINY, 0)}
    assert not keys & {task.key for task in calibration_tasks(faster, TINY, 0)}


# ---- runs and folders that are refused


@pytest.fixture
def finished_run(result: StudyResult) -> dict[str, Any]:
    return dict(result.runs[0])


@pytest.fixture
def run_folder(finished_run: dict[str, Any], tmp_path: Path) -> Path:
    """Empty folder of `finished_run` within the folder of the test."""
    folder = tmp_path / "case1" / finished_run["key"]
    folder.mkdir(parents=True)
    return folder


def test_a_half_written_run_is_refused(run_folder: Path) -> None:
    (run_folder / "result.json").write_text('{"half')
    with pytest.raises(ArtifactError, match="is damaged"):
        load_run(run_folder)


def test_a_run_of_another_format_is_refused(finished_run: dict[str, Any], run_folder: Path) -> None:
    text = json.dumps({**finished_run, "format": "swashtwin run 0"})
    (run_folder / "result.json").write_text(text)
    with pytest.raises(ArtifactError, match="this version reads"):
        load_run(run_folder)


def test_a_run_of_another_task_is_refused_alone_and_in_its_study(
    finished_run: dict[str, Any],
    run_folder: Path,
    recordings: list[Recording],
    tmp_path: Path,
) -> None:
    text = json.dumps({**finished_run, "key": "other"})
    (run_folder / "result.json").write_text(text)
    with pytest.raises(ArtifactError, match="belongs to another task"):
        load_run(run_folder)
    with pytest.raises(ArtifactError, match="belongs to another task"):
        run_plan(tiny(), recordings, Work(out=tmp_path))


def test_a_folder_of_other_files_is_not_taken_for_a_fleet(tmp_path: Path) -> None:
    (tmp_path / "rig-small-0").mkdir()
    (tmp_path / "rig-small-0" / "half.h5").touch()
    with pytest.raises(InputError, match="choose a new folder"):
        find_fleets(tmp_path, "small", "1", Work())(0)


# ---- tables and pages of finished runs


def stub_runs() -> list[dict[str, Any]]:
    """Return runs of Case I under two seeds, made without training anything."""
    runs = []
    for name in SETS:
        for seed in (0, 1):
            runs += [
                run(name, seed, 0.8, classifier) for classifier in (OWN_NETWORK, "extra_trees")
            ]
    return runs


STUBS = stub_runs()


@pytest.fixture(scope="module")
def incomplete() -> StudyResult:
    """Case I of two commands, of which the second did not train the measured set."""
    runs = []
    for stub in STUBS:
        if stub["seed"] == 1 and stub["factors"]["training_set"] == "measured":
            continue
        runs.append({**stub, "command": f"swashtwin bench study case1 --seeds {stub['seed']}"})
    return build_study(build_plan("case1"), runs)


def test_a_row_of_fewer_seeds_than_the_study_says_so(incomplete: StudyResult) -> None:
    seeds_by_set = {}
    for row in build_scores_table(incomplete).rows:
        training_set = row[0].text.split(", ")[-1]
        seeds_by_set[training_set] = row[1].text
    assert seeds_by_set["measured windows only"] == "1"
    assert seeds_by_set["with calibrated twin"] == "2"

    differences = build_differences_table(incomplete)
    assert {row[4].text for row in differences.rows} == {"1", "2"}


def test_a_study_of_several_commands_names_each(incomplete: StudyResult, tmp_path: Path) -> None:
    command = "swashtwin bench study case1 --seeds 0 && swashtwin bench study case1 --seeds 1"
    assert incomplete.command == command

    page = write_study_report(incomplete, folder=tmp_path / "page").read_text(encoding="utf-8")
    assert command in re.sub(r"<[^>]+>", "", page).replace("&amp;", "&")


@pytest.fixture(scope="module")
def varied() -> StudyResult:
    """A study of one and of two pumps, whose runs come in the other order."""
    runs = []
    for stub in STUBS:
        for pumps in ("2", "1"):
            varied_run = {
                **stub,
                "factors": {**stub["factors"], "pumps": pumps},
                "roles": {**stub["roles"], "train": [pumps]},
                "cells": {**stub["cells"], "L2": {"normal @ 15 MPa": int(pumps)}},
            }
            runs.append(varied_run)

    plan = replace(build_plan("case1"), varied="pumps", variants={"1": {}, "2": {}})
    return build_study(plan, runs)


def test_each_variant_of_a_study_has_its_split(varied: StudyResult) -> None:
    table = varied.to_dict()
    # seed and variant
    assert set(table["splits"]) == set(table["fingerprints"]) == {"0, 1", "0, 2", "1, 1", "1, 2"}
    assert table["splits"]["0, 2"]["train"] == ["2"]
    assert table["cells"]["L2"] != table["cells"]["L2, 2"]


def test_rows_stand_in_the_order_of_the_study(varied: StudyResult) -> None:
    first_rows = varied.rows()[:8]
    assert [row["pumps"] for row in first_rows] == ["1"] * 6 + ["2"] * 2


def with_noisy_tests(stub: dict[str, Any]) -> dict[str, Any]:
    """Return a run whose tests are repeated with noise."""
    rows = []
    for row in stub["rows"]:
        rows += [{**row, "perturbation": perturbation} for perturbation in ("clean", "5 dB")]
    return {**stub, "rows": rows}


@pytest.mark.parametrize(("study", "figure"), [("noise", "perturbation"), ("algorithms", "tsne")])
def test_a_page_has_a_figure_for_what_its_study_varies(
    study: str, figure: str, tmp_path: Path
) -> None:
    runs = [
        {**stub, "study": study}
        for stub in STUBS
        if stub["factors"]["training_set"] == "calibrated"
    ]
    if study == "noise":
        runs = [with_noisy_tests(stub) for stub in runs]
    result = build_study(build_plan(study), runs)
    page = write_study_report(result, folder=tmp_path).read_text(encoding="utf-8")

    # the paper's figure for its network stands next to ours
    assert "accuracy 0.910" in page or study != "noise"
    assert "--seeds 0,1; seeds 0, 1; cpu; virtual rig" in re.sub(r"<[^>]+>", "", page)
    for kind in (figure, "confusion", "rows"):
        files = (tmp_path / "figures").glob(f"study_{kind}.*")
        assert {path.suffix for path in files} == {".svg", ".csv"}


# ---- what the answer says


def study_of(
    accuracies: Mapping[str, Mapping[str, tuple[float, ...]]], **changes: Any
) -> StudyResult:
    """Return a study at L2 with these accuracies.

    They are given by classifier and training set, one for each seed.
    """
    runs = []
    for classifier, sets in accuracies.items():
        for name, values in sets.items():
            for seed, value in enumerate(values):
                stub = run(name, seed, 0.5, classifier, ("L2",), **changes)
                (row,) = stub["rows"]
                runs.append({**stub, "rows": [{**row, "accuracy": value}]})

    return build_study(build_plan("case1"), runs)


def answer(accuracies: Mapping[str, Mapping[str, tuple[float, ...]]], **changes: Any) -> str:
    """Return the answer at L2 of a study with these accuracies."""
    (sentence,) = study_of(accuracies, **changes).answer
    return sentence


def answer_of_own_network(**accuracies: tuple[float, ...]) -> str:
    return answer({OWN_NETWORK: accuracies})


def test_the_answer_gives_the_highest_accuracy_and_the_difference_paired_by_seed() -> None:
    accuracies = {
        "measured": (0.5, 0.6, 0.55),
        "nominal": (0.6, 0.71, 0.64),
        "calibrated": (0.71, 0.82, 0.78),
    }
    text = answer({OWN_NETWORK: accuracies}, data="")
    assert "L2: highest accuracy 0.770, BiTCN on spectra (ours), with calibrated twin." in text
    assert (
        "Accuracy of BiTCN on spectra (ours) with calibrated twin minus accuracy with measured "
        "windows only: +22.0 points (95 % interval "
    ) in text


def test_a_difference_that_changes_its_sign_between_seeds_is_not_significant() -> None:
    text = answer_of_own_network(measured=(0.5, 0.6), calibrated=(0.7, 0.5))
    assert "not significant" in text


def test_two_equal_differences_are_not_significant() -> None:
    # their interval has no width, which two seeds cannot prove
    text = answer_of_own_network(measured=(0.5, 0.5), calibrated=(0.6, 0.6))
    assert "+10.0 points (95 % interval +10.0 to +10.0; not significant)." in text


def test_the_difference_of_one_seed_has_no_interval() -> None:
    text = answer_of_own_network(measured=(0.5,), calibrated=(0.7,))
    assert "+20.0 points (one seed)." in text


def test_the_best_row_has_all_seeds() -> None:
    # the trees are better, under their only seed
    accuracies = {
        OWN_NETWORK: {"calibrated": (0.9, 0.6)},
        "extra_trees": {"calibrated": (0.95,)},
    }
    assert "highest accuracy (rows of 2 seeds) 0.750" in answer(accuracies)
    assert study_of(accuracies).headline == (
        "Highest accuracy at L2: 0.750, BiTCN on spectra (ours)"
    )


def test_rows_without_synthetic_windows_are_compared_with_those_of_every_number() -> None:
    runs = []
    for name, budget in (
        ("measured", "0"),
        ("calibrated", "72"),
        ("calibrated", "200"),
        ("nominal", "72"),
    ):
        factors = {"classifier": OWN_NETWORK, "training_set": name, "synthetic": budget}
        runs.append(run(name, 0, 0.5, splits=("L2",), factors=factors))

    pairs = set()
    for difference in build_study(build_plan("augmentation"), runs).differences():
        first = difference.first
        second = difference.second
        pairs.add((first["synthetic"], second["training_set"], second["synthetic"]))
    assert pairs == {
        ("72", "measured", "0"),
        ("200", "measured", "0"),
        ("72", "nominal", "72"),
    }


def test_the_folder_of_a_study_does_not_depend_on_the_folder_of_a_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    assert Work(out=Path("studies")).out == tmp_path / "studies"
