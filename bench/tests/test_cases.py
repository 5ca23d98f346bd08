"""The paper's cases on a very small rig: roles are kept apart, tasks are resumed, and bad data is refused in words."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_case import TINY, tiny

from swashtwin.foundation import ArtifactError, InputError
from swashtwin.pump import PistonWear
from swashtwin.recordings import Recording
from swashtwin_bench import FILLERS, Fleets, StudyResult, Workers, plan_of, run_plan
from swashtwin_bench.fillers.distortion import Jitter
from swashtwin_bench.results.runs import Embedding, load_run
from swashtwin_bench.rivals.models import DEFAULT
from swashtwin_bench.studies.dataset import calibration_tasks
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.scenario import MACHINED, split_scenario
from swashtwin_bench.studies.training_sets import TrainingSet

SETS = ("measured", "nominal", "calibrated")
MEASURED = {"measured": TrainingSet()}


def embeddings(study: StudyResult) -> list[Embedding]:
    return [run.embedding for run in study.embedded_runs if run.embedding is not None]


def confusions(study: StudyResult, seed: int) -> list[Any]:
    """Confusion matrices of the classifiers that learnt from measured windows alone."""
    outcomes = [
        outcome
        for outcome in (*study.outcomes, *study.rivals)
        if (outcome.seed, outcome.training_set) == (seed, "measured")
    ]
    return [(outcome.factors, outcome.scores.confusion.tolist()) for outcome in outcomes]


def test_the_rows_are_those_of_the_schema(result: StudyResult) -> None:
    table = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    expected = [(name, level) for name in SETS for level in ("L2", "L4")]
    assert [(row["training_set"], row["level"]) for row in table["rows"]] == expected
    for row in [*table["rows"], *table["rivals"]]:
        for name in ("accuracy", "recall", "f1", "g_mean", "recording_accuracy", "scarce_recall"):
            assert len(row[name]["values"]) == 2
            assert row[name]["mean"] == pytest.approx(np.mean(row[name]["values"]))
    assert {row["classifier"] for row in table["rivals"]} == {"extra_trees"}
    assert (table["study"], table["seeds"]) == ("case1", [0, 1])
    assert "stand-in for a machine" in table["origin"]
    assert set(table["splits"]["0"]) == {"train", "calibration", "reference", "L2", "L4"}
    assert len(table["contrasts"]) == 8


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
    split = split_scenario(recordings, TINY, 0)
    assert len(result.calibrations) == 2
    for calibration in result.calibrations:
        assert set(calibration.recording_ids) <= split.train | set(split.scarce["swash_plate"])


def test_a_rerun_does_nothing_again(
    recordings: list[Recording], result: StudyResult, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin_bench.studies.runner.run_task", lambda *_: pytest.fail("was done before"))
    messages: list[str] = []
    again = run_plan(tiny(), recordings, seeds=(0, 1), out=out, progress=lambda what, *_: messages.append(what))
    assert again.rows() == result.rows()
    assert messages == ["6 of seed 0 done before", "6 of seed 1 done before"]
    assert len(again.calibrations) == 2
    for embedding, before in zip(embeddings(again), embeddings(result), strict=True):
        np.testing.assert_allclose(embedding.features, before.features, rtol=1e-6)


def test_another_setting_is_another_task(recordings: list[Recording]) -> None:
    plan, data = tiny(), "0" * 64
    keys = {task.key for task in plan.tasks(0, data)}
    assert len(keys) == 6
    for other in (
        tiny(scenario=replace(plan.scenario, synthetic=7)),
        tiny(models={name: model.with_training(epochs=2) for name, model in plan.models.items()}),
        tiny(perturbations=(Perturbation("white", 5.0),)),
    ):
        network = [task.key for task in other.tasks(0, data) if task.factors["classifier"] == DEFAULT]
        assert not keys & set(network)
    assert not keys & {task.key for task in plan.tasks(1, data)}
    assert not keys & {task.key for task in plan.tasks(0, "1" * 64)}


def test_two_processes_give_the_same_scores(recordings: list[Recording], result: StudyResult) -> None:
    again = run_plan(tiny(training_sets=MEASURED), recordings, seeds=(0,), workers=Workers(jobs=2))
    assert confusions(again, 0) == confusions(result, 0)


def test_a_dask_cluster_gives_the_same_scores(recordings: list[Recording], result: StudyResult) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        workers = Workers(backend="dask", address=cluster.scheduler_address)
        again = run_plan(tiny(training_sets=MEASURED), recordings, seeds=(0,), workers=workers)
    assert confusions(again, 0) == confusions(result, 0)


def test_an_interrupted_task_leaves_no_result_and_finished_results_stay(
    recordings: list[Recording], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swashtwin_bench.studies import runner

    calls, real = [], runner.run_task

    def interrupted(*arguments: Any) -> Any:
        calls.append(arguments[0].key)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments)

    plan = tiny(training_sets=MEASURED)
    monkeypatch.setattr(runner, "run_task", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_plan(plan, recordings, seeds=(0,), out=tmp_path)
    assert [path.parent.name for path in tmp_path.rglob("result.json")] == calls[:1]
    assert len(run_plan(plan, recordings, seeds=(0,), out=tmp_path).runs) == 2
    assert len(calls) == 3


def test_a_broken_run_is_refused_by_name(recordings: list[Recording], result: StudyResult, tmp_path: Path) -> None:
    run = result.runs[0]
    folder = tmp_path / "case1" / run.task.key
    folder.mkdir(parents=True)
    table = run.to_dict()
    for text, message in (
        ('{"half', "is damaged"),
        (json.dumps({**table, "format": "swashtwin run 0"}), "this version reads"),
        (json.dumps({**table, "task": {**table["task"], "seed": 5}}), "other settings"),
    ):
        (folder / "result.json").write_text(text)
        with pytest.raises(ArtifactError, match=message):
            load_run(folder)
    with pytest.raises(ArtifactError, match="other settings"):
        run_plan(tiny(), recordings, seeds=(0,), out=tmp_path)


def test_the_settings_behind_a_name_are_part_of_a_tasks_key(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of("case1", "quick")
    keys = [task.key for task in plan.tasks(0, "data")]
    group = plan.scenario.pump.rotating_group
    worn = replace(plan.scenario.pump, rotating_group=replace(group, piston_clearance=2 * group.piston_clearance))
    other_pump = replace(plan, scenario=replace(plan.scenario, pump=worn))
    assert not set(keys) & {task.key for task in other_pump.tasks(0, "data")}
    on_a_gpu = [task.key for task in plan.tasks(0, "data", "cuda")]
    networks = [task.factors["classifier"] == DEFAULT for task in plan.tasks(0, "data")]
    assert [key != other for key, other in zip(keys, on_a_gpu, strict=True)] == networks
    filled = replace(plan, training_sets={"jitter": TrainingSet("jitter")})
    before = {task.key for task in filled.tasks(0, "data")}
    monkeypatch.setitem(FILLERS, "jitter", Jitter(gain=0.5))
    assert not before & {task.key for task in filled.tasks(0, "data")}


def test_a_folder_of_other_files_is_no_fleet(tmp_path: Path) -> None:
    (tmp_path / "rig-small-0").mkdir()
    (tmp_path / "rig-small-0" / "half.h5").touch()
    with pytest.raises(InputError, match="choose a new folder"):
        Fleets(tmp_path).recordings_for(0)


def test_a_key_holds_everything_that_twins_and_noise_are_made_of(monkeypatch: pytest.MonkeyPatch) -> None:
    def keys(study: str) -> dict[str, str]:
        return {"-".join(task.factors.values()): task.key for task in plan_of(study, "paper").tasks(0, "data")}

    before = {study: keys(study) for study in ("augmentation", "noise")}
    other = {**MACHINED, "piston": (PistonWear(clearance=1e-4),)}
    plan = plan_of("augmentation", "paper")
    plan = replace(plan, scenario=replace(plan.scenario, faults=other))
    changed = {"-".join(task.factors.values()): task.key for task in plan.tasks(0, "data")}
    differing = {name for name, key in before["augmentation"].items() if changed[name] != key}
    assert differing == {name for name in changed if "every_class" in name}
    monkeypatch.setattr("swashtwin_bench.studies.training_sets.TRAINING_SNRS", (5.0, 25.0))
    assert {name for name, key in keys("noise").items() if before["noise"][name] != key} == {
        name for name in before["noise"] if "calibrated_noise" in name
    }


def test_a_calibration_is_not_reused_for_recordings_with_other_facts(recordings: list[Recording]) -> None:
    def named(recordings: list[Recording]) -> list[str]:
        return [task.key for task in calibration_tasks(recordings, TINY, 0)]

    faster = [replace(r, condition=r.condition and r.condition.replaced(speed=92.0)) for r in recordings]
    assert not set(named(recordings)) & set(named(faster))
