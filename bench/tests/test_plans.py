"""Studies of classifiers as plans: what they train and test, and the noise exactly as the protocol defines it."""

import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton
from swashtwin.foundation import InputError, holm_correction
from swashtwin.learning import BASELINES, CANDIDATES, NETWORKS, cut_windows, fit_baseline
from swashtwin.recordings import Recording, load_recording, write_recording
from swashtwin.signals import add_noise
from swashtwin.synthesis import DEFAULT_VARIATION, discriminative_score
from swashtwin_bench import FILLERS, Plan, models_of, plan_of, rig_recordings, run_plan
from swashtwin_bench.fillers.twin_filler import TwinFiller
from swashtwin_bench.results.contrasts import Contrast, paired_interval, signed_rank_p
from swashtwin_bench.results.result import contrasts_of
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.table import Trial
from swashtwin_bench.rigs.version_two.fleet import draw_fault
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.rivals import models
from swashtwin_bench.rivals.models import ABLATED, DEFAULT, MODELS, train_model
from swashtwin_bench.studies.dataset import StudyDataset, calibration_tasks, cut_again, prepare
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.registry import PLANS, sizes_of
from swashtwin_bench.studies.scenario import split_scenario
from swashtwin_bench.studies.training_sets import (
    RIG_VARIATION,
    TWIN_TRAINING_SETS,
    TrainingSet,
    _filler,
    fill_cells,
    noisy_training_windows,
)

FEW = {"windows": 2, "scarce_windows": 3, "synthetic": 6, "test_windows": None, "held_out": 1}


def small(study: str, **changes: Any) -> Plan:
    plan = plan_of(study, "quick")
    scenario = replace(plan.scenario, method=GaussNewton(starts=1), **FEW)
    return replace(plan, **{"scenario": scenario, "training_sets": {"measured": TrainingSet()}, **changes})


@pytest.fixture(scope="module")
def dataset(recordings: list[Recording]) -> StudyDataset:
    return prepare(recordings, small("noise").scenario, 0, (), noisy_tests=True, noisy_training=True)


def test_what_workers_get_needs_no_file_of_a_recording(
    recordings: list[Recording], dataset: StudyDataset, tmp_path: Path
) -> None:
    names = dataset.test_recordings["L4"][0].recording_id, dataset.train_recordings[0].recording_id
    files = {
        name: write_recording(r, tmp_path / f"{index}.h5")
        for index, r in enumerate(recordings)
        for name in names
        if r.recording_id == name
    }
    lazy = [load_recording(files[r.recording_id]) if r.recording_id in files else r for r in recordings]
    prepared = prepare(lazy, small("noise").scenario, 0, (), noisy_tests=True, noisy_training=True)
    for file in files.values():
        file.unlink()
    received = pickle.loads(pickle.dumps((prepared.test_recordings["L4"][0], prepared.train_recordings[0])))
    expected = dataset.test_recordings["L4"][0], dataset.train_recordings[0]
    for recording, original in zip(received, expected, strict=True):
        np.testing.assert_allclose(recording.signal, original.signal, rtol=1e-6, atol=1e-6)


def test_noise_is_added_to_the_whole_recording_before_windows_are_cut(
    recordings: list[Recording], dataset: StudyDataset
) -> None:
    white = Perturbation("white", 5.0)
    clean, noisy = dataset.tests["L4"], white.of_test(dataset, "L4", repeat=3)
    name = str(clean.recording_id[0])
    recording = next(recording for recording in recordings if recording.recording_id == name)
    expected = replace(recording, signal=add_noise(recording.signal, 5.0, 3, name))
    cut = cut_windows([expected], like=clean, stride=1)
    indices = np.flatnonzero(clean.recording_id == name)
    for index in indices:
        np.testing.assert_array_equal(noisy.signal[index], cut.signal[clean.start[index]])
    added = expected.signal - recording.signal
    power = recording.signal.var(axis=1) / added.var(axis=1)
    assert 10 * np.log10(power) == pytest.approx([5.0] * len(power), abs=0.2)
    again, other = white.of_test(dataset, "L4", repeat=3), white.of_test(dataset, "L4", repeat=4)
    np.testing.assert_array_equal(again.signal, noisy.signal)
    assert not np.array_equal(other.signal, noisy.signal)


def test_gains_and_speeds_change_each_recording_in_its_own_way(recordings: list[Recording]) -> None:
    for recording in recordings[:2]:
        changed = Perturbation("gain", 12.0).of_recording(recording, 0)
        decibels = 20 * np.log10(changed.signal.std(axis=1) / recording.signal.std(axis=1))
        assert len(set(decibels.round(3).tolist())) == len(decibels)
        assert np.abs(decibels).max() <= 12.0
    lines = np.sin(2 * np.pi * 200 / recording.sample_rate * np.arange(recording.n_samples))[None]
    line = recording.replace(signal=np.repeat(lines, len(recording.channels), axis=0))
    counts = [
        np.argmax(np.abs(np.fft.rfft(Perturbation("speed", 0.02).of_recording(line, repeat).signal[0], 2**18)))
        * recording.sample_rate
        / 2**18
        for repeat in range(4)
    ]
    assert len(set(counts)) == 4
    assert all(195.9 < hertz < 204.2 for hertz in counts)


def test_longer_windows_leave_as_much_signal_in_the_scarce_cell() -> None:
    plan = plan_of("case2", "paper").of_window(8192)
    assert (plan.scenario.length, plan.scenario.scarce_windows, plan.scenario.test_windows) == (8192, 0, 12)
    assert plan_of("case1", "paper").of_window(8192).scenario.scarce_windows == 12


def test_twins_of_other_studies_can_fill_too_and_the_first_classifier_is_compared_with_all() -> None:
    plan = plan_of("noise", "quick").of_training_sets(["calibrated", "posterior"])
    assert [training_set.by for training_set in plan.training_sets.values()] == ["calibrated", "posterior"]
    plan = plan.of_classifiers(models_of("quick", ["chosen", "extra_trees"]))
    assert contrasted(plan, "classifier") == {("chosen", "extra_trees")}
    with pytest.raises(InputError, match="no training set 'twin'"):
        plan.of_training_sets(["twin"])


def test_the_chosen_model_holds_its_candidates_in_its_key_and_trains_as_the_default_does(
    dataset: StudyDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = MODELS["quick"]["chosen"]
    assert len(model.describe()["candidates"]) == len(CANDIDATES)
    calls: list[dict[str, Any]] = []
    trained = fit_baseline("ridge", dataset.measured)
    fitting = lambda windows, **how: calls.append({"windows": windows, **how}) or trained  # noqa: E731
    monkeypatch.setattr(models, "fit_chosen", fitting)
    assert train_model(model, dataset.measured, seed=5, manifest=["lent"]) is trained
    assert calls == [{"windows": dataset.measured, "seed": 5, "manifest": ["lent"]}]


def test_windows_cut_again_from_the_same_recordings_are_the_same(
    recordings: list[Recording], dataset: StudyDataset
) -> None:
    np.testing.assert_array_equal(cut_again(recordings, dataset.measured).signal, dataset.measured.signal)


def test_training_with_noise_adds_a_noisy_copy_of_every_training_window(dataset: StudyDataset) -> None:
    noisy, values = fill_cells(dataset, TrainingSet(noise=True))
    assert values == {}
    assert noisy.recording_id.tolist() == dataset.measured.recording_id.tolist()
    assert not noisy.synthetic.any()
    assert (noisy.signal != dataset.measured.signal).any(axis=(1, 2)).all()
    np.testing.assert_array_equal(noisy.signal, noisy_training_windows(dataset).signal)


def test_noisy_tests_have_a_row_for_each_ratio_with_the_mean_over_their_draws(recordings: list[Recording]) -> None:
    plan = small(
        "noise",
        models={"extra_trees": MODELS["quick"]["extra_trees"]},
        perturbations=(Perturbation("hum", 5.0),),
        draws=2,
    )
    study = run_plan(plan, recordings)
    assert [(row["level"], row["perturbation"]) for row in study.rows()] == [
        (level, test) for level in ("L2", "L4") for test in ("clean", "hum 5 dB")
    ]
    accuracies = [
        outcome.scores.accuracy
        for outcome in study.outcomes
        if (outcome.level, outcome.factors["perturbation"]) == ("L2", "hum 5 dB")
    ]
    assert len(accuracies) == 2
    assert study.rows()[1]["accuracy"]["values"] == pytest.approx([np.mean(accuracies)])


def test_every_network_and_baseline_stands_in_the_algorithms_table() -> None:
    for size in ("quick", "paper"):
        plan = plan_of("algorithms", size)
        ablations = {name for name in NETWORKS if name.startswith("bitcn_")}
        assert set(NETWORKS) - ablations <= set(plan.models)
        assert set(BASELINES) <= set(plan.models)
    assert {"bitcn", *ablations} <= set(plan_of("ablation", "paper").models)


@pytest.mark.parametrize("study", PLANS)
def test_every_plan_has_tasks_whose_keys_differ(study: str) -> None:
    for size in sizes_of(study):
        tasks = plan_of(study, size).tasks(0, "data")
        assert tasks
        assert len({task.key for task in tasks}) == len(tasks)


def test_the_corrected_interval_is_wider_than_students() -> None:
    points = [0.02, 0.03, 0.01, 0.04]
    plain, corrected = paired_interval(points), paired_interval(points, test_share=0.5)
    assert corrected[0] < plain[0] < 0.025 < plain[1] < corrected[1]
    assert (corrected[1] - corrected[0]) / (plain[1] - plain[0]) == pytest.approx(math.sqrt(0.75 / 0.25))
    assert math.isnan(paired_interval([0.1])[0])


def test_signed_ranks_need_six_pairs_and_holm_never_lowers_a_p_value() -> None:
    assert math.isnan(signed_rank_p([0.1] * 5))
    assert signed_rank_p([0.0] * 6) == 1.0
    assert signed_rank_p([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]) < 0.05
    raw = np.array([0.2, 0.01, np.nan, 0.04])
    np.testing.assert_allclose(holm_correction(raw), [0.2, 0.03, np.nan, 0.08])


def contrasted(plan: Plan, factor: str) -> set[tuple[str, str]]:
    """Pairs of a factor's values that a plan contrasts, at one level, were all its rows there."""
    tasks = plan.tasks(0, "data")
    trials = [Trial({**task.factors, "level": "L2"}, 0, {"accuracy": 0.5}) for task in tasks]
    none: dict[str, Any] = {"roles": {"train": ["a"], "L2": ["b"]}, "fingerprints": {}, "cells": {}, "values": {}}
    none |= {"outcomes": (), "history": (), "calibrations": (), "origin": "", "wall_s": 0.0, "cpu_s": 0.0}
    runs = [Run(task=task, **none, device="cpu", version="", command="") for task in tasks]
    return {
        (contrast.first[factor], contrast.second[factor])
        for contrast in contrasts_of(trials, runs, plan.compared, plan.bare)
    }


@pytest.mark.parametrize("splits_of_one_set", [True, False])
def test_signed_ranks_are_left_out_where_pairs_are_splits_of_the_same_recordings(splits_of_one_set: bool) -> None:
    plan = plan_of("case1", "quick")
    none: dict[str, Any] = {"roles": {"train": ["a"], "L2": ["b"]}, "fingerprints": {}, "cells": {}, "values": {}}
    none |= {"outcomes": (), "history": (), "calibrations": (), "origin": "", "wall_s": 0.0, "cpu_s": 0.0}
    tasks = [task for seed in range(8) for task in plan.tasks(seed, "one" if splits_of_one_set else f"fleet {seed}")]
    better = {"calibrated": 0.9, "nominal": 0.8, "measured": 0.7}
    trials = [
        Trial({**task.factors, "level": "L2"}, task.seed, {"accuracy": better[task.factors["training_set"]]})
        for task in tasks
    ]
    runs = [Run(task=task, **none, device="cpu", version="", command="") for task in tasks]
    contrasts = contrasts_of(trials, runs, plan.compared)
    assert contrasts
    assert {contrast.is_corrected for contrast in contrasts} == {splits_of_one_set}
    assert all(math.isnan(contrast.p_value) is splits_of_one_set for contrast in contrasts)


def test_the_papers_network_without_a_part_is_contrasted_with_the_papers_and_ours_with_ours() -> None:
    pairs = contrasted(plan_of("ablation", "paper"), "classifier")
    papers = {("bitcn", name) for name in ("bitcn_ordinary", "bitcn_no_attention", "bitcn_forward")}
    assert pairs == papers | {(DEFAULT, name) for name in (*ABLATED, "bitcn")}
    assert contrasted(plan_of("ablation", "quick"), "classifier") == {(DEFAULT, name) for name in ABLATED}


def test_any_number_of_synthetic_windows_is_contrasted_with_none() -> None:
    plan = plan_of("augmentation", "quick")
    budgets = {name for name in plan.variants if name != "0"}
    of_measured = {pair for pair in contrasted(plan, "synthetic") if pair[1] == "0"}
    assert of_measured == {(budget, "0") for budget in budgets}
    assert {("calibrated", "measured"), ("calibrated", "nominal")} <= contrasted(plan, "training_set")
    assert {first == second for first, second in contrasted(plan, "synthetic") - of_measured} == {True}


def test_each_way_to_calibrate_is_contrasted_with_the_other_and_with_none() -> None:
    plan = plan_of("calibrators", "quick")
    rows = {(task.factors["training_set"], task.factors["calibrator"]) for task in plan.tasks(0, "data")}
    ways = ("ipinn", "gauss_newton", "healthy")
    assert rows == {("measured", "none"), *((name, way) for name in ("calibrated", "every_class") for way in ways)}
    pairs = contrasted(plan, "calibrator")
    assert {("gauss_newton", "ipinn"), ("healthy", "ipinn"), ("healthy", "gauss_newton")} <= pairs
    assert all(pair[0] != pair[1] for pair in pairs)
    assert {("calibrated", "measured"), ("every_class", "measured")} <= contrasted(plan, "training_set")
    assert plan.scenario_of("ipinn") == plan_of("case1", "quick").scenario
    assert plan.scenario_of("gauss_newton").describe() != plan.scenario_of("ipinn").describe()


def test_fewer_pumps_train_and_the_same_are_held_out() -> None:
    recordings = [recording for recording, _ in rig_recordings(2, RigSize(4, 2, 0.3), labels=("normal", "swash_plate"))]
    scenario = replace(plan_of("unseen-specimen", "quick").scenario, held_out=1)
    smaller, two = (split_scenario(recordings, replace(scenario, specimens=count), 0) for count in (1, 2))
    assert smaller.tests["L4"] == two.tests["L4"]
    assert smaller.train < two.train
    assert {name[0] for name in smaller.train | smaller.tests["L2"]} < {name[0] for name in two.train}


def test_every_fault_is_unknown_at_the_unseen_pressure_and_normals_are_not(recordings: list[Recording]) -> None:
    scenario = small("unseen-pressure").scenario
    scenario = replace(scenario, scarce_windows=0)
    counts = prepare(recordings, scenario, 0, ()).measured.counts()
    assert counts["normal", 15e6] > 0
    assert [counts[label, 15e6] for label in scenario.scarce] == [0, 0, 0, 0]
    assert all(counts[label, 10e6] > 0 for label in scenario.scarce)
    tasks = calibration_tasks(recordings, scenario, 0)
    assert [task.label for task in tasks] == ["normal"] * 2


def test_few_shots_keep_as_many_measured_windows_as_they_say(recordings: list[Recording]) -> None:
    plan = plan_of("few-shot", "quick")
    for count in ("0", "5", "10"):
        scenario = replace(plan.scenario_of(count), windows=2, held_out=1)
        assert prepare(recordings, scenario, 0, ()).measured.counts()["swash_plate", 15e6] == int(count)


def test_every_filler_has_the_same_budget_and_none_fills_at_zero() -> None:
    for size in ("quick", "paper"):
        tasks = plan_of("augmentation", size).tasks(0, "data")
        at_none = {task.factors["training_set"] for task in tasks if task.factors["synthetic"] == "0"}
        filled = {task.factors["training_set"] for task in tasks if task.factors["synthetic"] == "200"}
        assert at_none == {"measured", "class_weights"}
        assert {*FILLERS, *TWIN_TRAINING_SETS} == filled


def test_severities_spread_as_on_the_rig_unless_a_training_set_has_the_stated_prior(dataset: StudyDataset) -> None:
    described = {name: TWIN_TRAINING_SETS[name].describe({}) for name in ("posterior", "stated_prior")}
    of_rig = "severity=0.2, angle=0.008726646259971648,"
    stated = "severity=0.35, angle=0.08726646259971647,"
    assert of_rig in described["posterior"]["filler"]
    assert stated in described["stated_prior"]["filler"]
    keys = {"by", "count", "every_class", "noise", "background", "class_weights", "filler"}
    assert set(described["posterior"]) == set(described["stated_prior"]) == keys
    narrow, wide = (
        _filler(dataset, replace(TrainingSet("nominal"), stated_prior=it), "piston") for it in (False, True)
    )
    assert isinstance(narrow, TwinFiller)
    assert isinstance(wide, TwinFiller)
    assert (narrow.variation, wide.variation) == (RIG_VARIATION, DEFAULT_VARIATION)


def test_the_discriminator_of_a_study_is_that_of_synthesis(dataset: StudyDataset) -> None:
    filling = TrainingSet("jitter", count=4)
    synthetic, values = fill_cells(dataset, filling)
    test = dataset.tests[dataset.scenario.levels[0]]
    held_out = test.subset(np.isin(test.label, dataset.scenario.scarce))
    assert values["discriminator"] == discriminative_score(held_out, synthetic, seed=dataset.seed)


@pytest.mark.parametrize("by", ["duplicate", "nominal"])
def test_a_filler_fills_the_scarce_cell_or_every_class(dataset: StudyDataset, by: str) -> None:
    synthetic, values = fill_cells(dataset, TrainingSet(by, count=4))
    assert synthetic.synthetic.all()
    assert synthetic.counts()["swash_plate", 15e6] == len(synthetic) == 4
    assert 0 <= values["discriminator"] <= 1
    every, _ = fill_cells(dataset, TrainingSet(by, count=2, every_class=True))
    assert [every.counts()[label, 15e6] for label in every.classes] == [2] * 5


def test_a_study_can_be_run_for_some_of_its_training_sets_and_models() -> None:
    plan = plan_of("augmentation", "quick").of_training_sets(["measured"])
    assert len(plan.tasks(0, "data")) == len(plan.models)
    with pytest.raises(InputError, match="no training set 'guess'"):
        plan.of_training_sets(["guess"])
    with pytest.raises(InputError, match="no model is called 'extra_tres'; did you mean 'extra_trees'"):
        models_of("quick", ["extra_tres"])


def test_twins_of_a_study_on_the_rig_with_a_deep_recess_simulate_that_recess() -> None:
    case1 = plan_of("case1", "quick")
    assert case1.of_rig("1").scenario == case1.of_rig("2").scenario == case1.scenario
    (recess,) = case1.of_rig("2-deep").scenario.faults["swash_plate"]
    assert recess == replace(draw_fault("swash_plate", "A", 0, "any", is_deep=True), angle=recess.angle)
    keys = {case1.of_rig(version).tasks(0, "data")[0].key for version in ("1", "2-deep")}
    assert len(keys) == 2


def test_a_study_can_be_run_at_some_of_its_values() -> None:
    plan = plan_of("augmentation", "quick").of_values(["72", "0"])
    assert list(plan.variants) == ["0", "72"]  # in the order of the study's own curve
    whole = {task.key for task in plan_of("augmentation", "quick").tasks(0, "data")}
    keys = {task.key for task in plan.tasks(0, "data")}
    assert keys < whole
    assert {task.factors["synthetic"] for task in plan.tasks(0, "data")} == {"0", "72"}
    with pytest.raises(InputError, match="no value '73' to choose; the values of synthetic are 0, 72, 200"):
        plan_of("augmentation", "quick").of_values(["73"])
    with pytest.raises(InputError, match="case1 has no value '1' to choose; it has none"):
        plan_of("case1", "quick").of_values(["1"])


@pytest.mark.parametrize(
    ("interval", "clear"), [((0.01, 0.02), True), ((-0.01, 0.02), False), ((0.01, 0.01 + 1e-16), False)]
)
def test_an_interval_between_equal_differences_is_not_clear_for_rounding(
    interval: tuple[float, float], clear: bool
) -> None:
    assert Contrast({}, {}, "accuracy", 0.01, interval, 2, 1.0, False).is_clear is clear


def test_the_papers_size_has_the_papers_counts() -> None:
    for study, in_cell in (("paper-case1", 50), ("paper-case2", 0)):
        scenario = plan_of(study, "paper").scenario
        assert scenario.class_windows == 650
        assert (scenario.scarce_windows, scenario.scarce_windows + scenario.synthetic) == (in_cell, 200)
