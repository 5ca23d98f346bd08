"""The paper's cases on a very small rig: roles are kept apart, tasks are resumed, and bad data is refused in words."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.augmentation import FILLERS, Jitter
from swashtwin.calibration import GaussNewton
from swashtwin.condition import OperatingCondition
from swashtwin.errors import ArtifactError, DataError, InputError
from swashtwin.faults import PistonWear
from swashtwin.recording import Recording
from swashtwin.report import write_report
from swashtwin.rig import RigSize, rig_recordings
from swashtwin.studies import Fleets, Model, Plan, StudyResult, Workers, plan_of, run_plan
from swashtwin.studies.cells import recordings_by_cell
from swashtwin.studies.fillings import Filling
from swashtwin.studies.gathering import gathered
from swashtwin.studies.material import calibration_tasks, prepare
from swashtwin.studies.models import DEFAULT
from swashtwin.studies.runs import Run, load_run, load_runs, save_run
from swashtwin.studies.scenario import MACHINED, Scenario, split_scenario
from swashtwin.training import TrainingSettings

SETS = ("measured", "nominal", "calibrated")
TINY = Scenario(windows=2, scarce_windows=3, synthetic=6, held_out=1, method=GaussNewton(starts=1))
NETWORK = Model("bitcn", {"stride": 32, "channels": (8, 8)}, TrainingSettings(epochs=1, normalization="set"))


MEASURED = {"measured": Filling()}


def tiny(study: str = "case1", **changes: Any) -> Plan:
    plan = plan_of(study, "quick")
    few = {"scarce_windows": plan.scenario.scarce_windows and 3, "synthetic": 6, "test_windows": None}
    scenario = replace(plan.scenario, windows=2, held_out=1, method=GaussNewton(starts=1), **few)
    models = {name: NETWORK if model.is_network else model for name, model in plan.models.items()}
    return replace(plan, **{"scenario": scenario, "models": models, **changes})


def confusions(study: StudyResult, seed: int) -> list[Any]:
    """Confusion matrices of the classifiers that learnt from measured windows alone."""
    own = [one for one in (*study.outcomes, *study.rivals) if (one.seed, one.training_set) == (seed, "measured")]
    return [(one.factors, one.scores.confusion.tolist()) for one in own]


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    return [recording for recording, _ in rig_recordings(0, RigSize(specimens=3, repeats=2, duration=1.2))]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def result(recordings: list[Recording], out: Path) -> StudyResult:
    return run_plan(tiny(), recordings, seeds=(0, 1), out=out, command="swashtwin study case1 rig")


@pytest.mark.parametrize("seed", range(5))
def test_no_recording_has_two_roles(recordings: list[Recording], seed: int) -> None:
    split = split_scenario(recordings, TINY, seed)
    lent = frozenset(name for ids in split.scarce.values() for name in ids)
    roles = [split.train, lent, split.references, *split.tests.values()]
    assert sum(map(len, roles)) == len(frozenset.union(*roles))
    by_id = {recording.recording_id: recording for recording in recordings}
    trained_on = {by_id[name].specimen for name in split.train}
    assert {by_id[name].specimen for name in split.tests["L2"]} <= trained_on
    assert not {by_id[name].specimen for name in split.tests["L4"] | split.references} & trained_on


@pytest.mark.parametrize("seed", range(5))
def test_one_recording_of_one_pump_fills_the_scarce_cell(recordings: list[Recording], seed: int) -> None:
    material = prepare(recordings, TINY, seed, ())
    own = material.measured.label == "swash_plate"
    scarce = material.measured.subset(own & (material.measured.discharge_pressure > 12e6))
    assert len(scarce) == 3
    assert len(set(scarce.recording_id)) == 1


def test_references_are_healthy_of_the_pumps_held_out_and_never_tested(recordings: list[Recording]) -> None:
    material = prepare(recordings, TINY, 0, ())
    references = [one for one in recordings if one.recording_id in material.split.references]
    assert references
    assert {one.label for one in references} == {"normal"}
    assert not {one.specimen for one in references} & set(material.measured.specimen)
    tested = {name for test in material.tests.values() for name in test.recording_id.tolist()}
    assert not tested & material.split.references
    assert set(material.roles()["reference"]) <= set(material.manifest)


def test_case_two_trains_on_no_measured_window_of_the_missing_cell(recordings: list[Recording]) -> None:
    scenario = tiny("case2").scenario
    assert plan_of("case2", "paper").scenario.test_windows == 50
    assert plan_of("case2", "paper").scenario.synthetic == 200
    material = prepare(recordings, scenario, 0, ())
    assert material.measured.counts()["swash_plate", 15e6] == 0
    assert material.measured.counts()["swash_plate", 10e6] > 0
    used = {r.recording_id for task in calibration_tasks(recordings, scenario, 0) for r in task.recordings}
    assert used
    assert not any("swash_plate_15MPa" in name for name in used)


def test_the_rows_are_those_of_the_schema(result: StudyResult) -> None:
    told = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    wanted = [(name, level) for name in SETS for level in ("L2", "L4")]
    assert [(row["training_set"], row["level"]) for row in told["rows"]] == wanted
    for row in [*told["rows"], *told["rivals"]]:
        for name in ("accuracy", "recall", "f1", "g_mean", "recording_accuracy", "scarce_recall"):
            assert len(row[name]["values"]) == 2
            assert row[name]["mean"] == pytest.approx(np.mean(row[name]["values"]))
    assert {row["classifier"] for row in told["rivals"]} == {"extra_trees"}
    assert (told["study"], told["seeds"]) == ("case1", [0, 1])
    assert "stand-in for a machine" in told["origin"]
    assert set(told["splits"]["0"]) == {"train", "calibration", "reference", "L2", "L4"}
    assert len(told["contrasts"]) == 8


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
    monkeypatch.setattr("swashtwin.studies.carrying.carry_out", lambda *_: pytest.fail("was done before"))
    said: list[str] = []
    again = run_plan(tiny(), recordings, seeds=(0, 1), out=out, progress=lambda what, *_: said.append(what))
    assert again.rows() == result.rows()
    assert said == ["6 of seed 0 done before", "6 of seed 1 done before"]
    assert len(again.calibrations) == 2
    for one, before in zip(again.embeddings, result.embeddings, strict=True):
        np.testing.assert_allclose(one.features, before.features, rtol=1e-6)


def test_another_setting_is_another_task(recordings: list[Recording]) -> None:
    plan, data = tiny(), "0" * 64
    keys = {task.key for task in plan.tasks(0, data)}
    assert len(keys) == 6
    for other in (
        tiny(scenario=replace(plan.scenario, synthetic=7)),
        tiny(models={name: model.with_training(epochs=2) for name, model in plan.models.items()}),
        tiny(snrs=(5.0,)),
    ):
        network = [task.key for task in other.tasks(0, data) if task.factors["classifier"] == DEFAULT]
        assert not keys & set(network)
    assert not keys & {task.key for task in plan.tasks(1, data)}
    assert not keys & {task.key for task in plan.tasks(0, "1" * 64)}


def test_two_processes_give_the_same_scores(recordings: list[Recording], result: StudyResult) -> None:
    again = run_plan(tiny(fillings=MEASURED), recordings, seeds=(0,), workers=Workers(jobs=2))
    assert confusions(again, 0) == confusions(result, 0)


def test_a_dask_cluster_gives_the_same_scores(recordings: list[Recording], result: StudyResult) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        workers = Workers(backend="dask", address=cluster.scheduler_address)
        again = run_plan(tiny(fillings=MEASURED), recordings, seeds=(0,), workers=workers)
    assert confusions(again, 0) == confusions(result, 0)


def test_an_interrupted_task_leaves_no_result_and_the_finished_ones_stay(
    recordings: list[Recording], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swashtwin.studies import carrying

    calls, real = [], carrying.carry_out

    def interrupted(*arguments: Any) -> Any:
        calls.append(arguments[0].key)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments)

    plan = tiny(fillings=MEASURED)
    monkeypatch.setattr(carrying, "carry_out", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_plan(plan, recordings, seeds=(0,), out=tmp_path)
    assert [run.task.key for run in load_runs(tmp_path)] == calls[:1]
    assert len(run_plan(plan, recordings, seeds=(0,), out=tmp_path).runs) == 2
    assert len(calls) == 3


def test_a_broken_run_is_refused_by_name(recordings: list[Recording], result: StudyResult, tmp_path: Path) -> None:
    run = result.runs[0]
    folder = tmp_path / "case1" / run.task.key
    folder.mkdir(parents=True)
    table = run.to_dict()
    for text, said in (
        ('{"half', "is damaged"),
        (json.dumps({**table, "format": "swashtwin run 0"}), "this version reads"),
        (json.dumps({**table, "task": {**table["task"], "seed": 5}}), "other settings"),
    ):
        (folder / "result.json").write_text(text)
        with pytest.raises(ArtifactError, match=said):
            load_run(folder)
    with pytest.raises(ArtifactError, match="other settings"):
        run_plan(tiny(), recordings, seeds=(0,), out=tmp_path)


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
    with pytest.raises(InputError, match="needs a seed"):
        run_plan(tiny(), recordings, seeds=())
    with pytest.raises(InputError, match="belongs to backend dask or ray"):
        Workers(address="tcp://nowhere:1")


def test_finished_runs_are_gathered_into_the_study_they_are_of(result: StudyResult, out: Path) -> None:
    (study,) = gathered(out)
    assert study.rows() == result.rows()
    assert study.seeds == (0, 1)
    assert len(study.calibrations) == len(result.calibrations) == 2
    assert study.command == "swashtwin study case1 rig"


def test_runs_of_older_settings_are_left_out_and_counted(result: StudyResult, tmp_path: Path) -> None:
    measured = [run for run in result.runs if run.task.factors["training_set"] == "measured"]
    for number, run in enumerate(measured):
        older = replace(run, task=replace(run.task, settings={**run.task.settings, "model": {"kind": "older"}}))
        for place, one in enumerate((older, run)):
            os.utime(save_run(one, tmp_path) / "result.json", (number, 10 * number + place))
    (study,) = gathered(tmp_path)
    assert {run.task.key for run in study.runs} == {run.task.key for run in measured}
    assert "4 runs of other settings" in study.notes[-1]


def test_runs_of_other_recordings_in_the_folder_do_not_mix(result: StudyResult, tmp_path: Path) -> None:
    others = [replace(run, origin="elsewhere", task=replace(run.task, data="other")) for run in result.runs]
    for number, run in enumerate((*others, *result.runs[:2])):
        os.utime(save_run(run, tmp_path) / "result.json", (number, number))
    (study,) = gathered(tmp_path)
    assert {run.task.data for run in study.runs} == {result.runs[0].task.data}
    assert len(study.runs) == 2
    assert f"{len(others)} runs of other settings or recordings" in study.notes[-1]


def test_each_variant_of_a_study_tells_its_own_split(result: StudyResult) -> None:
    def varied(run: Run, value: str) -> Run:
        factors = {**run.task.factors, "pumps": value}
        roles = {**run.roles, "train": [value]}
        cells = {**run.cells, "L2": {"normal @ 15 MPa": int(value)}}
        return replace(run, task=replace(run.task, factors=factors), roles=roles, cells=cells)

    runs = [varied(run, value) for run in result.runs for value in ("1", "2")]
    told = replace(result, runs=tuple(runs)).to_dict()
    assert set(told["splits"]) == set(told["fingerprints"]) == {"0, 1", "0, 2", "1, 1", "1, 2"}
    assert told["splits"]["0, 2"]["train"] == ["2"]
    assert told["cells"]["L2"] != told["cells"]["L2, 2"]
    assert [name for name in told["cells"] if name.startswith("L4")] == ["L4"]


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="holds no finished run"):
        gathered(tmp_path)


def test_several_studies_make_one_page(result: StudyResult, tmp_path: Path) -> None:
    noisy = []
    for run in result.runs:
        if run.task.factors["training_set"] == "calibrated":
            outcomes = [
                replace(one, factors={**one.factors, "snr": snr}) for one in run.outcomes for snr in ("clean", "5 dB")
            ]
            noisy.append(replace(run, task=replace(run.task, study="noise"), outcomes=tuple(outcomes), embedding=None))
    for run in (*noisy, *(replace(run, task=replace(run.task, study="algorithms")) for run in result.runs)):
        save_run(run, tmp_path)
    page = write_report(*gathered(tmp_path), folder=tmp_path / "page").read_text(encoding="utf-8")
    assert "Algorithms on Case I" in page
    assert "accuracy 0.910" in page
    assert "swashtwin study case1 rig; seeds 0, 1; cpu; virtual rig" in page
    for name in ("noise_snr", "noise_confusion", "algorithms_scores"):
        assert (tmp_path / "page" / "figures" / f"{name}.svg").is_file()
        assert (tmp_path / "page" / "figures" / f"{name}.csv").is_file()


def test_what_a_name_stands_for_is_part_of_a_tasks_key(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of("case1", "quick")
    keys = [task.key for task in plan.tasks(0, "data")]
    group = plan.scenario.pump.rotating_group
    worn = replace(plan.scenario.pump, rotating_group=replace(group, piston_clearance=2 * group.piston_clearance))
    other_pump = replace(plan, scenario=replace(plan.scenario, pump=worn))
    assert not set(keys) & {task.key for task in other_pump.tasks(0, "data")}
    on_a_gpu = [task.key for task in plan.tasks(0, "data", "cuda")]
    networks = [task.factors["classifier"] == DEFAULT for task in plan.tasks(0, "data")]
    assert [one != other for one, other in zip(keys, on_a_gpu, strict=True)] == networks
    filled = replace(plan, fillings={"jitter": Filling("jitter")})
    before = {task.key for task in filled.tasks(0, "data")}
    monkeypatch.setitem(FILLERS, "jitter", Jitter(gain=0.5))
    assert not before & {task.key for task in filled.tasks(0, "data")}


def test_a_fleet_whose_building_is_interrupted_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(folder: Path, **how: object) -> None:
        folder.mkdir()
        (folder / "half.h5").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("swashtwin.studies.sources.build_rig", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Fleets(tmp_path).taken(0)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "rig-small-0").mkdir()
    (tmp_path / "rig-small-0" / "half.h5").touch()
    with pytest.raises(DataError, match="delete it, and the same command"):
        Fleets(tmp_path).taken(0)


def test_of_ones_own_recordings_only_the_latest_are_told(result: StudyResult, tmp_path: Path) -> None:
    other = next(iter(result.runs))
    other = replace(other, task=replace(other.task, data="other"))
    for number, run in enumerate((*result.runs, other)):
        os.utime(save_run(run, tmp_path) / "result.json", (number, number))
    (study,) = gathered(tmp_path)
    assert [run.task.data for run in study.runs] == ["other"]


def test_runs_of_another_version_are_left_out_and_counted(result: StudyResult, tmp_path: Path) -> None:
    for run in result.runs:
        save_run(run, tmp_path)
    old = tmp_path / "case1" / "old" / "result.json"
    old.parent.mkdir()
    old.write_text('{"format": "swashtwin run 1"}')
    (study,) = gathered(tmp_path)
    assert len(study.runs) == len(result.runs)
    assert "1 runs of another version" in study.notes[-1]


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
    monkeypatch.setattr("swashtwin.studies.fillings.TRAINING_SNRS", (5.0, 25.0))
    assert {name for name, key in keys("noise").items() if before["noise"][name] != key} == {
        name for name in before["noise"] if "calibrated_noise" in name
    }


def test_a_calibration_is_not_taken_for_one_of_recordings_that_say_something_else(recordings: list[Recording]) -> None:
    def named(own: list[Recording]) -> list[str]:
        return [task.key for task in calibration_tasks(own, TINY, 0)]

    faster = [replace(r, condition=r.condition and r.condition.replaced(speed=92.0)) for r in recordings]
    assert not set(named(recordings)) & set(named(faster))


def test_a_pressure_as_measured_is_counted_where_it_was_set() -> None:
    def at(pressure: float) -> Recording:
        condition = OperatingCondition(speed=90.0, discharge_pressure=pressure)
        return Recording(np.zeros((1, 10)), 1.0, f"{pressure}", label="normal", condition=condition, specimen="A")

    cells = recordings_by_cell([at(p) for p in (4.9e6, 5.1e6, 9.8e6, 10.2e6, 15.2e6, 14.7e6, 14.9e6)], "the study")
    assert sorted(len(cell) for cell in cells) == [2, 2, 3]


def test_no_recording_at_the_tested_pressure_is_told_before_anything_is_calibrated(recordings: list[Recording]) -> None:
    kept = [r for r in recordings if r.condition is not None and r.condition.discharge_pressure < 12e6]
    with pytest.raises(DataError, match="tests at 15 MPa"):
        calibration_tasks(kept, tiny("case2").scenario, 0)


def test_four_of_five_classes_are_a_study_too(recordings: list[Recording]) -> None:
    kept = [r for r in recordings if r.label != "valve_plate"]
    material = prepare(kept, TINY, 0, ())
    assert material.measured.classes == ("normal", "swash_plate", "cylinder_block", "piston")
