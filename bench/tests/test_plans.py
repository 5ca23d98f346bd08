"""Studies of classifiers as plans: what they train and test, and the noise exactly as the protocol
defines it.
"""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_case import FOREST

from swashtwin.calibration import GaussNewton
from swashtwin.foundation import InputError
from swashtwin.learning import NETWORKS, cut_windows
from swashtwin.recordings import Recording, load_recording, write_recording
from swashtwin.signals import add_noise
from swashtwin_bench import FILLERS, Plan, build_plan, run_plan
from swashtwin_bench.rigs.version_two.fleet import draw_fault
from swashtwin_bench.studies import plans
from swashtwin_bench.studies.dataset import StudyDataset, calibration_tasks, prepare_dataset
from swashtwin_bench.studies.perturbations import Perturbation
from swashtwin_bench.studies.plan import PlanSettings
from swashtwin_bench.studies.plans import PLANS, SIZES
from swashtwin_bench.studies.training_sets import (
    TWIN_TRAINING_SETS,
    TrainingSet,
    fill_cells,
)

FEW = {"windows": 2, "scarce_windows": 3, "synthetic": 6, "test_windows": None, "held_out": 1}


def small(study: str, **changes: Any) -> Plan:
    plan = build_plan(study)
    scenario = replace(plan.scenario, method=GaussNewton(starts=1), **FEW)
    return replace(
        plan, **{"scenario": scenario, "training_sets": {"measured": TrainingSet()}, **changes}
    )


@pytest.fixture(scope="module")
def dataset(recordings: list[Recording]) -> StudyDataset:
    return prepare_dataset(recordings, small("noise").scenario, 0, (), noisy_tests=True)


def test_what_workers_get_needs_no_file_of_a_recording(
    recordings: list[Recording], dataset: StudyDataset, tmp_path: Path
) -> None:
    expected = dataset.test_recordings["L4"][:2]
    files = {
        each.recording_id: write_recording(each, tmp_path / f"{n}.h5")
        for n, each in enumerate(expected)
    }
    lazy = [
        load_recording(files[r.recording_id]) if r.recording_id in files else r for r in recordings
    ]
    prepared = prepare_dataset(lazy, small("noise").scenario, 0, (), noisy_tests=True)
    for file in files.values():
        file.unlink()
    received = pickle.loads(pickle.dumps(prepared.test_recordings["L4"][:2]))
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
    cut = cut_windows([expected], length=clean.length, classes=clean.classes, stride=1)
    for index in np.flatnonzero(clean.recording_id == name):
        np.testing.assert_array_equal(noisy.signal[index], cut.signal[clean.start[index]])
    power = recording.signal.var(axis=1) / (expected.signal - recording.signal).var(axis=1)
    assert 10 * np.log10(power) == pytest.approx([5.0] * len(power), abs=0.2)
    assert not np.array_equal(white.of_test(dataset, "L4", repeat=4).signal, noisy.signal)


def test_gains_and_speeds_change_each_recording_in_its_own_way(recordings: list[Recording]) -> None:
    for recording in recordings[:2]:
        changed = Perturbation("gain", 12.0).of_recording(recording, 0)
        decibels = 20 * np.log10(changed.signal.std(axis=1) / recording.signal.std(axis=1))
        assert len(set(decibels.round(3).tolist())) == len(decibels)
        assert np.abs(decibels).max() <= 12.0
    lines = np.sin(2 * np.pi * 200 / recording.sample_rate * np.arange(recording.n_samples))[None]
    line = recording.replace(signal=np.repeat(lines, len(recording.channels), axis=0))
    counts = [
        np.argmax(
            np.abs(
                np.fft.rfft(Perturbation("speed", 0.02).of_recording(line, repeat).signal[0], 2**18)
            )
        )
        * recording.sample_rate
        / 2**18
        for repeat in range(4)
    ]
    assert len(set(counts)) == 4
    assert all(195.9 < hertz < 204.2 for hertz in counts)


def test_longer_windows_leave_as_much_signal_in_the_scarce_cell() -> None:
    plan = build_plan("case2", "paper").of_window(8192)
    assert (plan.scenario.length, plan.scenario.scarce_windows, plan.scenario.test_windows) == (
        8192,
        0,
        12,
    )
    assert build_plan("case1", "paper").of_window(8192).scenario.scarce_windows == 12


def test_noisy_tests_have_a_row_for_each_ratio_with_the_mean_over_their_draws(
    recordings: list[Recording],
) -> None:
    study = run_plan(
        small(
            "noise",
            models={"extra_trees": FOREST},
            perturbations=(Perturbation("hum", 5.0),),
            draws=2,
        ),
        recordings,
    )
    assert [(row["split"], row["perturbation"]) for row in study.rows()] == [
        (split, test) for split in ("L2", "L4") for test in ("clean", "hum 5 dB")
    ]
    accuracies = [row["accuracy"] for _, row in study.tests(split="L2", perturbation="hum 5 dB")]
    assert len(accuracies) == 2
    assert study.rows()[1]["accuracy"]["values"] == pytest.approx([np.mean(accuracies)])


def test_every_network_stands_in_the_algorithms_table() -> None:
    names = build_plan("algorithms").models
    assert set(NETWORKS) <= set(names)


@pytest.mark.parametrize("study", PLANS)
def test_every_plan_has_tasks_whose_keys_differ(study: str) -> None:
    for size in SIZES["paper" if study.startswith("paper-") else "ours"]:
        tasks = PLANS[study](size).tasks(0, "data")
        assert tasks
        assert len({task.key for task in tasks}) == len(tasks)


def test_the_papers_recipe_has_the_papers_counts_and_both_ways_to_split() -> None:
    for study, in_cell in (("case1", 50), ("case2", 0)):
        plan = build_plan(f"paper-{study}", "paper")
        assert plan.scenario.class_windows == 650
        assert (
            plan.scenario.scarce_windows,
            plan.scenario.scarce_windows + plan.scenario.synthetic,
        ) == (in_cell, 200)
        assert {name: plan.scenario_of(name).splits[0] for name in plan.variants} == {
            "by recording": "L2",
            "at random": "L0",
        }
    for study in (name for name in PLANS if name.startswith("paper-")):
        medium, whole = (build_plan(study, size) for size in ("medium", "paper"))
        assert (medium.scenario, medium.draws) == (whole.scenario, whole.draws)
        for name, model in whole.models.items():
            if model.is_network:
                assert medium.models[name].training == replace(model.training, epochs=30)
                patched = plans.NETWORKS[name][0].startswith("bitcn")
                assert medium.models[name].network.get("stride") == (
                    plans.PATCH if patched else None
                )


def test_the_fair_test_calibrates_each_pump_on_healthy_recordings_and_its_recess(
    recordings: list[Recording],
) -> None:
    plan = small("fair-test")
    scenario = replace(plan.scenario, scarce_windows=0, **plan.variants["never measured"])
    counts = prepare_dataset(recordings, scenario, 0, ()).measured.counts()
    assert counts["normal", 15e6] > 0
    assert [counts[label, 15e6] for label in scenario.scarce] == [0, 0, 0, 0]
    assert all(counts[label, 10e6] > 0 for label in scenario.scarce)
    tasks = calibration_tasks(recordings, scenario, 0)
    assert [(task.label, task.law is None) for task in tasks] == [("normal", False)] * 2


def test_every_filler_has_the_same_budget_and_none_fills_at_zero() -> None:
    tasks = build_plan("augmentation").tasks(0, "data")
    at_none = {task.factors["training_set"] for task in tasks if task.factors["synthetic"] == "0"}
    filled = {task.factors["training_set"] for task in tasks if task.factors["synthetic"] == "200"}
    assert at_none == {"measured", "class_weights"}
    assert {*FILLERS, *TWIN_TRAINING_SETS} == filled


def test_a_training_set_that_nothing_fills_is_refused_by_name() -> None:
    with pytest.raises(
        InputError, match=r"Unknown source 'smoote' of synthetic windows: must be one of nominal, "
    ):
        TrainingSet("smoote")


@pytest.mark.parametrize("by", ["duplicate", "nominal"])
def test_a_filler_fills_the_scarce_cell_or_every_class(dataset: StudyDataset, by: str) -> None:
    synthetic, values = fill_cells(dataset, TrainingSet(by))
    assert synthetic.synthetic.all()
    assert synthetic.counts()["swash_plate", 15e6] == len(synthetic) == dataset.scenario.synthetic
    assert 0 <= values["discriminator"] <= 1
    every, _ = fill_cells(dataset, TrainingSet(by, every_class=True))
    assert [every.counts()[label, 15e6] for label in every.classes] == [
        dataset.scenario.synthetic
    ] * 5


def test_a_study_can_be_run_in_part_and_by_other_classifiers() -> None:
    augmentation = build_plan("augmentation")
    plan = augmentation.with_settings(
        PlanSettings(values=("72", "0"), training_sets=("calibrated", "measured"))
    )
    whole = {task.key for task in augmentation.tasks(0, "data")}
    assert {task.factors["synthetic"] for task in plan.tasks(0, "data")} == {"0", "72"}
    assert {task.key for task in plan.tasks(0, "data")} < whole
    chosen = build_plan("noise").with_settings(PlanSettings(classifiers=("chosen", "extra_trees")))
    assert chosen.reference_values["classifier"] == "chosen"
    for settings, message in (
        (PlanSettings(training_sets=("twin",)), "no training set 'twin'"),
        (PlanSettings(values=("73",)), "no value of synthetic '73'; there are 0, 72, 200"),
        (
            PlanSettings(classifiers=("extra_tres",)),
            "Unknown classifier 'extra_tres'. Did you mean 'extra_trees'",
        ),
    ):
        with pytest.raises(InputError, match=message):
            augmentation.with_settings(settings)
    with pytest.raises(InputError, match="has no task: calibrated is not trained at synthetic 0"):
        run_plan(
            augmentation.with_settings(PlanSettings(training_sets=("calibrated",), values=("0",))),
            [],
        )


def test_a_study_takes_thirteen_sensors() -> None:
    thirteen = build_plan("case1").with_settings(PlanSettings(sensors=13))
    assert (thirteen.sensors, len(thirteen.scenario.pump.sensors)) == (13, 13)
    with pytest.raises(InputError, match="no number of sensors '5'"):
        build_plan("case1").with_settings(PlanSettings(sensors=5))


def test_twins_of_a_study_on_the_rig_with_a_deep_recess_simulate_that_recess() -> None:
    case1 = build_plan("case1")
    one, two, deep = (
        case1.with_settings(PlanSettings(rig=version)) for version in ("1", "2", "2-deep")
    )
    assert one.scenario == two.scenario == case1.scenario
    (recess,) = deep.scenario.faults["swash_plate"]
    assert recess == replace(
        draw_fault("swash_plate", "A", 0, "any", is_deep=True), angle=recess.angle
    )
    assert one.tasks(0, "data")[0].key != deep.tasks(0, "data")[0].key
    (paper,) = build_plan("paper-recess").scenario.faults["swash_plate"]
    assert (paper.depth, paper.length, paper.width, paper.contact) == pytest.approx(
        (0.6e-3, 30e-3, 24e-3, "shared")
    )
