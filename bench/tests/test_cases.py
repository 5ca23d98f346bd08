"""The paper's cases on a very small rig: roles are kept apart, tasks are resumed, and bad data is
refused in words.
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
from swashtwin_bench import StudyResult, Work, build_plan, run_plan, write_study_report
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


def confusions(study: StudyResult) -> list[Any]:
    """Confusion matrices under seed 0 of the classifiers that learned from measured windows
    alone.
    """
    tests = study.tests(training_set="measured")
    return [
        (each["factors"], row["split"], row["confusion"])
        for each, row in tests
        if each["seed"] == 0
    ]


def test_the_rows_are_those_of_the_schema(result: StudyResult) -> None:
    table = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    expected = [
        (c, name, at) for c in (OWN_NETWORK, "extra_trees") for name in SETS for at in ("L2", "L4")
    ]
    assert [
        (row["classifier"], row["training_set"], row["split"]) for row in table["rows"]
    ] == expected
    for row in table["rows"]:
        for name in ("accuracy", "recall", "f1", "g_mean", "recording_accuracy", "scarce_recall"):
            assert len(row[name]["values"]) == 2
            assert row[name]["mean"] == pytest.approx(np.mean(row[name]["values"]))
    assert (table["study"], table["seeds"]) == ("case1", [0, 1])
    assert "stand-in for a machine" in table["origin"]
    assert set(table["splits"]["0"]) == {"train", "calibration", "reference", "L2", "L4"}
    assert len(table["differences"]) == 8


def test_sets_hold_what_they_say(result: StudyResult) -> None:
    for name in ("nominal", "calibrated"):
        assert result.cells[name]["of them synthetic"] == 6
        assert (
            result.cells[name]["swash_plate @ 15 MPa"],
            result.cells["measured"]["swash_plate @ 15 MPa"],
        ) == (9, 3)
    for name in ("measured", "L2", "L4"):
        assert "of them synthetic" not in result.cells[name]
    for split in ("L2", "L4"):
        assert len({count for name, count in result.cells[split].items() if "15 MPa" in name}) == 1
        assert len(result.cells[split]) == 5


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
    monkeypatch.setattr(runner, "train_and_test", lambda *_, **__: pytest.fail("was finished"))
    messages: list[str] = []
    work = Work((0, 1), out=out, progress=lambda what, *_: messages.append(what))
    again = run_plan(tiny(), recordings, work)
    assert again.rows() == result.rows()
    assert messages == ["6 of seed 0 already finished", "6 of seed 1 already finished"]
    assert len(again.calibrations) == 2
    assert again.command == "swashtwin bench study case1 rig"


def test_another_setting_is_another_task(
    recordings: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, data = tiny(), "0" * 64
    keys = {task.key for task in plan.tasks(0, data)}
    assert len(keys) == 6
    group = plan.scenario.pump.rotating_group
    worn = replace(
        plan.scenario.pump,
        rotating_group=replace(group, piston_clearance=2 * group.piston_clearance),
    )
    for other in (
        tiny(scenario=replace(plan.scenario, synthetic=7)),
        tiny(scenario=replace(plan.scenario, pump=worn)),
        tiny(models={name: model.with_training(epochs=2) for name, model in plan.models.items()}),
        tiny(perturbations=(Perturbation("white", 5.0),)),
    ):
        network = [
            task.key for task in other.tasks(0, data) if task.factors["classifier"] == OWN_NETWORK
        ]
        assert not keys & set(network)
    assert not keys & {task.key for task in plan.tasks(1, data)}
    assert not keys & {task.key for task in plan.tasks(0, "1" * 64)}
    filled = replace(plan, training_sets={"smote": TrainingSet("smote")})
    before = {task.key for task in filled.tasks(0, "data")}
    monkeypatch.setattr(
        "swashtwin_bench.studies.training_sets.FILLERS", {"smote": SMOTE(neighbors=2)}
    )
    assert not before & {task.key for task in filled.tasks(0, "data")}


def test_a_key_holds_everything_that_twins_are_made_of() -> None:
    def keys(study: str, **changes: Any) -> dict[str, str]:
        plan = build_plan(study, "paper")
        plan = replace(plan, scenario=replace(plan.scenario, **changes))
        return {"-".join(task.factors.values()): task.key for task in plan.tasks(0, "data")}

    before = keys("augmentation")
    changed = keys("augmentation", faults={**MACHINED, "piston": (PistonWear(clearance=1e-4),)})
    differing = {name for name, key in before.items() if changed[name] != key}
    assert differing == {name for name in changed if "every_class" in name}


@pytest.mark.nightly
def test_two_processes_give_the_same_scores(
    recordings: list[Recording], result: StudyResult
) -> None:
    again = run_plan(tiny(training_sets=MEASURED), recordings, Work(jobs=2))
    assert confusions(again) == confusions(result)


def test_a_broken_run_is_refused_by_name(
    recordings: list[Recording], result: StudyResult, tmp_path: Path
) -> None:
    done = result.runs[0]
    folder = tmp_path / "case1" / done["key"]
    folder.mkdir(parents=True)
    for text, message in (
        ('{"half', "is damaged"),
        (json.dumps({**done, "format": "swashtwin run 0"}), "this version reads"),
        (json.dumps({**done, "key": "other"}), "belongs to another task"),
    ):
        (folder / "result.json").write_text(text)
        with pytest.raises(ArtifactError, match=message):
            load_run(folder)
    with pytest.raises(ArtifactError, match="belongs to another task"):
        run_plan(tiny(), recordings, Work(out=tmp_path))


def test_a_folder_of_other_files_is_no_fleet(tmp_path: Path) -> None:
    (tmp_path / "rig-small-0").mkdir()
    (tmp_path / "rig-small-0" / "half.h5").touch()
    with pytest.raises(InputError, match="choose a new folder"):
        find_fleets(tmp_path, "small", "1", Work())(0)


def test_a_calibration_is_not_reused_for_recordings_with_other_facts(
    recordings: list[Recording],
) -> None:
    def named(recordings: list[Recording]) -> list[str]:
        return [task.key for task in calibration_tasks(recordings, TINY, 0)]

    faster = [
        replace(r, condition=r.condition and r.condition.replace(speed=92.0)) for r in recordings
    ]
    assert not set(named(recordings)) & set(named(faster))


# ---- tables and pages of finished runs


STUBS = [
    run(name, seed, 0.8, classifier)
    for name in SETS
    for seed in (0, 1)
    for classifier in (OWN_NETWORK, "extra_trees")
]


def test_a_row_of_fewer_seeds_than_the_study_says_so_and_each_command_is_named(
    tmp_path: Path,
) -> None:
    few = [
        each for each in STUBS if (each["seed"], each["factors"]["training_set"]) != (1, "measured")
    ]
    runs = [
        {**each, "command": f"swashtwin bench study case1 --seeds {each['seed']}"} for each in few
    ]
    study = build_study(build_plan("case1"), runs)
    counted = {row[0].text.split(", ")[-1]: row[1].text for row in build_scores_table(study).rows}
    assert (counted["measured windows only"], counted["with calibrated twin"]) == ("1", "2")
    assert {row[4].text for row in build_differences_table(study).rows} == {"1", "2"}
    assert (
        study.command
        == "swashtwin bench study case1 --seeds 0 && swashtwin bench study case1 --seeds 1"
    )
    page = write_study_report(study, folder=tmp_path / "page").read_text(encoding="utf-8")
    assert study.command in re.sub(r"<[^>]+>", "", page).replace("&amp;", "&")


def test_each_variant_of_a_study_has_a_split_and_rows_stand_in_the_order_of_the_study() -> None:
    runs = [
        {
            **each,
            "factors": {**each["factors"], "pumps": value},
            "roles": {**each["roles"], "train": [value]},
            "cells": {**each["cells"], "L2": {"normal @ 15 MPa": int(value)}},
        }
        for each in STUBS
        for value in ("2", "1")
    ]
    study = build_study(
        replace(build_plan("case1"), varied="pumps", variants={"1": {}, "2": {}}), runs
    )
    table = study.to_dict()
    assert set(table["splits"]) == set(table["fingerprints"]) == {"0, 1", "0, 2", "1, 1", "1, 2"}
    assert table["splits"]["0, 2"]["train"] == ["2"]
    assert table["cells"]["L2"] != table["cells"]["L2, 2"]
    assert [row["pumps"] for row in study.rows()][:8] == ["1"] * 6 + ["2"] * 2


def test_a_page_has_a_figure_for_what_its_study_varies(tmp_path: Path) -> None:
    plain = [each for each in STUBS if each["factors"]["training_set"] == "calibrated"]
    noisy = [
        {
            **each,
            "rows": [
                {**row, "perturbation": at} for row in each["rows"] for at in ("clean", "5 dB")
            ],
        }
        for each in plain
    ]
    for name, runs, figure in (("noise", noisy, "perturbation"), ("algorithms", plain, "tsne")):
        study = build_study(build_plan(name), [{**each, "study": name} for each in runs])
        page = write_study_report(study, folder=tmp_path / name).read_text(encoding="utf-8")
        assert "accuracy 0.910" in page or name != "noise"
        assert "--seeds 0,1; seeds 0, 1; cpu; virtual rig" in re.sub(r"<[^>]+>", "", page)
        for kind in (figure, "confusion", "rows"):
            assert {
                path.suffix for path in (tmp_path / name / "figures").glob(f"study_{kind}.*")
            } == {".svg", ".csv"}


# ---- what the answer says


def answer(accuracies: Mapping[str, Mapping[str, tuple[float, ...]]], **changes: Any) -> str:
    """Answer at L2 of a study with accuracies by classifier and training set, one for each seed."""
    runs = []
    for classifier, sets in accuracies.items():
        for name, values in sets.items():
            for seed, value in enumerate(values):
                one = run(name, seed, 0.5, classifier, ("L2",), **changes)
                runs.append({**one, "rows": [{**one["rows"][0], "accuracy": value}]})
    (sentence,) = build_study(build_plan("case1"), runs).answer
    return sentence


def test_the_answer_gives_the_difference_paired_by_seed_and_whether_it_is_chance() -> None:
    sets = {
        "measured": (0.5, 0.6, 0.55),
        "nominal": (0.6, 0.71, 0.64),
        "calibrated": (0.71, 0.82, 0.78),
    }
    text = answer({OWN_NETWORK: sets}, data="")
    assert "L2: highest accuracy 0.770, BiTCN on spectra (ours), with calibrated twin." in text
    assert (
        "Accuracy of BiTCN on spectra (ours) with calibrated twin minus accuracy with measured "
        "windows only: +22.0 points (95 % interval "
    ) in text
    assert "not significant" in answer(
        {OWN_NETWORK: {"measured": (0.5, 0.6), "calibrated": (0.7, 0.5)}}
    )
    assert "+10.0 points (95 % interval +10.0 to +10.0; not significant)." in answer(
        {OWN_NETWORK: {"measured": (0.5, 0.5), "calibrated": (0.6, 0.6)}}
    )
    assert "+20.0 points (one seed)." in answer(
        {OWN_NETWORK: {"measured": (0.5,), "calibrated": (0.7,)}}
    )


def test_the_best_row_has_all_seeds() -> None:
    text = answer({OWN_NETWORK: {"calibrated": (0.9, 0.6)}, "extra_trees": {"calibrated": (0.95,)}})
    assert "highest accuracy (rows of 2 seeds) 0.750" in text


def test_rows_of_no_synthetic_window_are_compared_with_those_of_every_number() -> None:
    runs = [
        run(
            name,
            0,
            0.5,
            splits=("L2",),
            factors={"classifier": OWN_NETWORK, "training_set": name, "synthetic": budget},
        )
        for name, budget in (
            ("measured", "0"),
            ("calibrated", "72"),
            ("calibrated", "200"),
            ("nominal", "72"),
        )
    ]
    pairs = build_study(build_plan("augmentation"), runs).differences()
    assert {
        (p.first["synthetic"], p.second["training_set"], p.second["synthetic"]) for p in pairs
    } == {
        ("72", "measured", "0"),
        ("200", "measured", "0"),
        ("72", "nominal", "72"),
    }
