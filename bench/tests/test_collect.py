"""Finished runs of a folder become the studies that they are of."""

import os
import re
from dataclasses import replace
from pathlib import Path

import pytest

from swashtwin.foundation import DataError
from swashtwin_bench import StudyResult, collect_studies, plan_of, write_study_report
from swashtwin_bench.results.comparison_figures import time_drawing
from swashtwin_bench.results.runs import Run, save_run
from swashtwin_bench.results.study_part import contrast_table, metrics_table
from swashtwin_bench.studies.runner import assemble_result


def test_finished_runs_are_collected_into_their_study(result: StudyResult, out: Path) -> None:
    (study,) = collect_studies(out)
    assert study.rows() == result.rows()
    assert study.seeds == (0, 1)
    assert len(study.calibrations) == len(result.calibrations) == 2
    assert study.commands == ("swashtwin bench case1 rig",)


def test_a_study_collected_from_several_commands_names_each(result: StudyResult, tmp_path: Path) -> None:
    for run in result.runs:
        save_run(replace(run, command=f"swashtwin bench case1 rig --seeds {run.task.seed}"), tmp_path)
    (study,) = collect_studies(tmp_path)
    assert study.commands == ("swashtwin bench case1 rig --seeds 0", "swashtwin bench case1 rig --seeds 1")
    assert study.to_dict()["command"] == " && ".join(study.commands)
    page = Path(write_study_report(study, folder=tmp_path / "page")).read_text()
    text = re.sub(r"<[^>]+>", "", page)
    assert all(command in text for command in study.commands)
    assert "2 commands, at the end of the study" in page


def test_a_row_of_fewer_seeds_than_the_study_says_so(result: StudyResult, tmp_path: Path) -> None:
    for run in result.runs:
        if (run.task.seed, run.task.factors["training_set"]) != (1, "measured"):
            save_run(run, tmp_path)
    (study,) = collect_studies(tmp_path)
    counted = {row[0].text.split(", ")[-1]: row[1].text for row in metrics_table(study).rows}
    assert counted["measured only"] == "1"
    assert counted["with calibrated twin"] == "2"
    assert {row[4].text for row in contrast_table(study).rows} == {"1", "2"}


def test_runs_of_older_settings_are_left_out_and_counted(result: StudyResult, tmp_path: Path) -> None:
    measured = [run for run in result.runs if run.task.factors["training_set"] == "measured"]
    for number, run in enumerate(measured):
        older = replace(run, task=replace(run.task, settings={**run.task.settings, "model": {"kind": "older"}}))
        for index, version in enumerate((older, run)):
            os.utime(save_run(version, tmp_path) / "result.json", (number, 10 * number + index))
    (study,) = collect_studies(tmp_path)
    assert {run.task.key for run in study.runs} == {run.task.key for run in measured}
    assert "4 runs of other settings" in study.notes[-1]


def test_runs_of_other_recordings_in_the_folder_do_not_mix(result: StudyResult, tmp_path: Path) -> None:
    others = [replace(run, origin="elsewhere", task=replace(run.task, data="other")) for run in result.runs]
    for number, run in enumerate((*others, *result.runs[:2])):
        os.utime(save_run(run, tmp_path) / "result.json", (number, number))
    (study,) = collect_studies(tmp_path)
    assert {run.task.data for run in study.runs} == {result.runs[0].task.data}
    assert len(study.runs) == 2
    assert f"{len(others)} runs of other settings or recordings" in study.notes[-1]


def test_each_variant_of_a_study_has_a_split(result: StudyResult) -> None:
    def varied(run: Run, value: str) -> Run:
        factors = {**run.task.factors, "pumps": value}
        roles = {**run.roles, "train": [value]}
        cells = {**run.cells, "L2": {"normal @ 15 MPa": int(value)}}
        return replace(run, task=replace(run.task, factors=factors), roles=roles, cells=cells)

    runs = [varied(run, value) for run in result.runs for value in ("1", "2")]
    table = replace(result, runs=tuple(runs)).to_dict()
    assert set(table["splits"]) == set(table["fingerprints"]) == {"0, 1", "0, 2", "1, 1", "1, 2"}
    assert table["splits"]["0, 2"]["train"] == ["2"]
    assert table["cells"]["L2"] != table["cells"]["L2, 2"]
    assert [name for name in table["cells"] if name.startswith("L4")] == ["L4"]


def test_rows_stand_in_the_order_of_the_study_whatever_was_run_first(result: StudyResult) -> None:
    plan = plan_of("case1", "quick")
    last_first = result.runs[::-1]
    rows = [(row["classifier"], row["training_set"], row["level"]) for row in assemble_result(plan, last_first).rows()]
    assert rows == [(row["classifier"], row["training_set"], row["level"]) for row in result.rows()]


def test_a_classifier_of_fewer_seeds_says_so_beside_its_point(result: StudyResult) -> None:
    runs = [run for run in result.runs if (run.task.factors["classifier"], run.task.seed) != ("extra_trees", 1)]
    study = assemble_result(plan_of("case1", "quick"), runs)
    drawing = time_drawing(replace(study, trials=study.trials, rival_names=()), "case1")
    assert "extra trees (n = 1)" in drawing.svg
    assert "ours) (n" not in drawing.svg


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="holds no finished run"):
        collect_studies(tmp_path)


def test_several_studies_make_one_page(result: StudyResult, tmp_path: Path) -> None:
    noisy = []
    for run in result.runs:
        if run.task.factors["training_set"] == "calibrated":
            outcomes = [
                replace(outcome, factors={**outcome.factors, "perturbation": test})
                for outcome in run.outcomes
                for test in ("clean", "5 dB")
            ]
            noisy.append(replace(run, task=replace(run.task, study="noise"), outcomes=tuple(outcomes), embedding=None))
    for run in (*noisy, *(replace(run, task=replace(run.task, study="algorithms")) for run in result.runs)):
        save_run(run, tmp_path)
    page = write_study_report(*collect_studies(tmp_path), folder=tmp_path / "page").read_text(encoding="utf-8")
    assert "Algorithms on Case I" in page
    assert "accuracy 0.910" in page
    assert "swashtwin bench case1 rig; seeds 0, 1; cpu; virtual rig" in page
    for name in ("noise_perturbation", "noise_confusion", "algorithms_scores"):
        assert (tmp_path / "page" / "figures" / f"{name}.svg").is_file()
        assert (tmp_path / "page" / "figures" / f"{name}.csv").is_file()


def test_only_the_latest_recordings_of_a_user_are_collected(result: StudyResult, tmp_path: Path) -> None:
    other = next(iter(result.runs))
    other = replace(other, task=replace(other.task, data="other"))
    for number, run in enumerate((*result.runs, other)):
        os.utime(save_run(run, tmp_path) / "result.json", (number, number))
    (study,) = collect_studies(tmp_path)
    assert [run.task.data for run in study.runs] == ["other"]


def test_runs_of_another_version_are_left_out_and_counted(result: StudyResult, tmp_path: Path) -> None:
    for run in result.runs:
        save_run(run, tmp_path)
    old = tmp_path / "case1" / "old" / "result.json"
    old.parent.mkdir()
    old.write_text('{"format": "swashtwin run 1"}')
    (study,) = collect_studies(tmp_path)
    assert len(study.runs) == len(result.runs)
    assert "1 runs of another version" in study.notes[-1]


def test_the_note_on_a_classifier_appears_where_it_was_trained(result: StudyResult) -> None:
    plan = plan_of("noise", "quick")
    runs = [run for run in result.runs if run.task.factors["training_set"] == "calibrated"]
    noisy = [
        replace(run, task=replace(run.task, factors={**run.task.factors, "classifier": "spectral_noise"}))
        for run in runs
    ]
    note_start = "New noise in every epoch"
    assert not any(note_start in note for note in assemble_result(plan, runs).notes)
    assert any(note_start in note for note in assemble_result(plan, [*runs, *noisy]).notes)
