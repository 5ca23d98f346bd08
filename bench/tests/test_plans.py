"""Studies of classifiers as plans: what they train and test, and noise as the protocol defines it."""

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
from swashtwin_bench import FILLERS, Plan, StudyResult, build_plan, run_plan
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

FEW_WINDOWS: dict[str, Any] = {
    "windows": 2,
    "scarce_windows": 3,
    "synthetic": 6,
    "test_windows": None,
    "held_out": 1,
}


def small(study: str, **changes: Any) -> Plan:
    """Return a study with few measured windows as its only training set."""
    plan = build_plan(study)
    scenario = replace(plan.scenario, method=GaussNewton(starts=1), **FEW_WINDOWS)
    defaults = {"scenario": scenario, "training_sets": {"measured": TrainingSet()}}
    return replace(plan, **{**defaults, **changes})


@pytest.fixture(scope="module")
def dataset(recordings: list[Recording]) -> StudyDataset:
    return prepare_dataset(recordings, small("noise").scenario, 0, (), noisy_tests=True)


def test_a_worker_needs_no_file_of_the_recordings_that_it_gets(
    recordings: list[Recording], dataset: StudyDataset, tmp_path: Path
) -> None:
    expected = dataset.test_recordings["L4"][:2]
    files = {}
    for recording in expected:
        path = tmp_path / f"{len(files)}.h5"
        files[recording.recording_id] = write_recording(recording, path)

    in_files = []
    for recording in recordings:
        name = recording.recording_id
        in_files.append(load_recording(files[name]) if name in files else recording)
    prepared = prepare_dataset(in_files, small("noise").scenario, 0, (), noisy_tests=True)

    # what a worker receives must hold the samples and not read them later
    for file in files.values():
        file.unlink()
    received = pickle.loads(pickle.dumps(prepared.test_recordings["L4"][:2]))
    for recording, original in zip(received, expected, strict=True):
        np.testing.assert_allclose(recording.signal, original.signal, rtol=1e-6, atol=1e-6)


# ---- perturbations of the tests


@pytest.fixture(scope="module")
def l4_recording(recordings: list[Recording], dataset: StudyDataset) -> Recording:
    """The recording of the first window of L4."""
    name = str(dataset.tests["L4"].recording_id[0])
    return next(recording for recording in recordings if recording.recording_id == name)


def test_noise_is_added_to_the_whole_recording_before_windows_are_cut(
    dataset: StudyDataset, l4_recording: Recording
) -> None:
    clean = dataset.tests["L4"]
    noisy = Perturbation("white", 5.0).of_test(dataset, "L4", repeat=3)

    # a stride of 1 puts the window that starts at a sample at the same index
    name = l4_recording.recording_id
    expected = replace(l4_recording, signal=add_noise(l4_recording.signal, 5.0, 3, name))
    cut = cut_windows([expected], length=clean.length, classes=clean.classes, stride=1)
    for index in np.flatnonzero(clean.recording_id == name):
        np.testing.assert_array_equal(noisy.signal[index], cut.signal[clean.start[index]])


def test_noise_has_its_ratio_in_each_channel(l4_recording: Recording) -> None:
    signal = l4_recording.signal
    noise = add_noise(signal, 5.0, 3, l4_recording.recording_id) - signal
    decibels = 10 * np.log10(signal.var(axis=1) / noise.var(axis=1))
    assert decibels == pytest.approx([5.0] * len(decibels), abs=0.2)


def test_each_repeat_draws_other_noise(dataset: StudyDataset) -> None:
    white = Perturbation("white", 5.0)
    third = white.of_test(dataset, "L4", repeat=3)
    fourth = white.of_test(dataset, "L4", repeat=4)
    assert not np.array_equal(fourth.signal, third.signal)


def test_gains_change_each_channel_of_a_recording_in_its_own_way(
    recordings: list[Recording],
) -> None:
    for recording in recordings[:2]:
        changed = Perturbation("gain", 12.0).of_recording(recording, 0)
        ratio = changed.signal.std(axis=1) / recording.signal.std(axis=1)
        decibels = 20 * np.log10(ratio)
        assert len(set(decibels.round(3).tolist())) == len(decibels)
        assert np.abs(decibels).max() <= 12.0


def test_speeds_move_the_lines_of_a_recording_by_up_to_two_percent(
    recordings: list[Recording],
) -> None:
    recording = recordings[0]
    rate = recording.sample_rate
    line = np.sin(2 * np.pi * 200 / rate * np.arange(recording.n_samples))
    tone = recording.replace(signal=np.tile(line, (len(recording.channels), 1)))

    n_fft = 2**18
    frequencies = []
    for repeat in range(4):
        changed = Perturbation("speed", 0.02).of_recording(tone, repeat)
        spectrum = np.abs(np.fft.rfft(changed.signal[0], n_fft))
        frequencies.append(spectrum.argmax() * rate / n_fft)

    assert len(set(frequencies)) == 4
    # 200 Hz times 0.98 to 1.02, and a line of the spectrum more on each side
    assert all(195.9 < frequency < 204.2 for frequency in frequencies)


@pytest.fixture(scope="module")
def noise_study(recordings: list[Recording]) -> StudyResult:
    """The study of noise with two draws of mains hum."""
    plan = small(
        "noise",
        models={"extra_trees": FOREST},
        perturbations=(Perturbation("hum", 5.0),),
        draws=2,
    )
    return run_plan(plan, recordings)


def test_noisy_tests_have_a_row_for_each_split_and_ratio(noise_study: StudyResult) -> None:
    names = [(row["split"], row["perturbation"]) for row in noise_study.rows()]
    assert names == [
        ("L2", "clean"),
        ("L2", "hum 5 dB"),
        ("L4", "clean"),
        ("L4", "hum 5 dB"),
    ]


def test_a_row_of_a_noisy_test_is_the_mean_over_its_draws(noise_study: StudyResult) -> None:
    draws = noise_study.tests(split="L2", perturbation="hum 5 dB")
    accuracies = [row["accuracy"] for _, row in draws]
    assert len(accuracies) == 2
    noisy_row = noise_study.rows()[1]
    assert noisy_row["accuracy"]["values"] == pytest.approx([np.mean(accuracies)])


# ---- plans of the studies


def test_longer_windows_leave_as_much_signal_in_the_scarce_cell() -> None:
    # 8192 samples are four times the usual 2048
    scenario = build_plan("case1", "paper").of_window(8192).scenario
    assert scenario.scarce_windows == 12

    scenario = build_plan("case2", "paper").of_window(8192).scenario
    assert scenario.length == 8192
    assert scenario.scarce_windows == 0
    assert scenario.test_windows == 12


def test_every_network_stands_in_the_algorithms_table() -> None:
    names = build_plan("algorithms").models
    assert set(NETWORKS) <= set(names)


@pytest.mark.parametrize("study", PLANS)
def test_every_plan_has_tasks_whose_keys_differ(study: str) -> None:
    recipe = "paper" if study.startswith("paper-") else "ours"
    for size in SIZES[recipe]:
        # a key is the folder of a task's run
        tasks = PLANS[study](size).tasks(0, "data")
        assert tasks
        assert len({task.key for task in tasks}) == len(tasks)


@pytest.mark.parametrize(("study", "n_scarce"), [("case1", 50), ("case2", 0)])
def test_the_papers_recipe_has_the_papers_counts(study: str, n_scarce: int) -> None:
    scenario = build_plan(f"paper-{study}", "paper").scenario
    assert scenario.class_windows == 650
    assert scenario.scarce_windows == n_scarce
    assert scenario.scarce_windows + scenario.synthetic == 200


@pytest.mark.parametrize("study", ["case1", "case2"])
def test_the_papers_recipe_splits_in_both_ways(study: str) -> None:
    # the paper does not specify how it split
    plan = build_plan(f"paper-{study}", "paper")
    first_splits = {name: plan.scenario_of(name).splits[0] for name in plan.variants}
    assert first_splits == {"by recording": "L2", "at random": "L0"}


@pytest.mark.parametrize("study", [name for name in PLANS if name.startswith("paper-")])
def test_size_medium_differs_from_the_paper_in_epochs_and_patches_alone(study: str) -> None:
    medium = build_plan(study, "medium")
    paper = build_plan(study, "paper")
    assert (medium.scenario, medium.draws) == (paper.scenario, paper.draws)

    for name, model in paper.models.items():
        if not model.is_network:
            continue
        assert medium.models[name].training == replace(model.training, epochs=30)
        kind = plans.NETWORKS[name][0]
        stride = plans.PATCH if kind.startswith("bitcn") else None
        assert medium.models[name].network.get("stride") == stride


def test_the_fair_test_lacks_every_fault_at_the_tested_pressure(
    recordings: list[Recording],
) -> None:
    plan = small("fair-test")
    scenario = replace(plan.scenario, scarce_windows=0, **plan.variants["never measured"])
    counts = prepare_dataset(recordings, scenario, 0, ()).measured.counts()
    assert counts["normal", 15e6] > 0
    assert [counts[label, 15e6] for label in scenario.scarce] == [0, 0, 0, 0]
    assert all(counts[label, 10e6] > 0 for label in scenario.scarce)


def test_the_fair_test_calibrates_each_pump_on_healthy_recordings_and_its_recess(
    recordings: list[Recording],
) -> None:
    plan = small("fair-test")
    scenario = replace(plan.scenario, scarce_windows=0, **plan.variants["never measured"])
    # two of the three pumps are trained on
    tasks = calibration_tasks(recordings, scenario, 0)
    assert [(task.label, task.law is None) for task in tasks] == [("normal", False)] * 2


def test_a_study_on_the_rig_with_a_deep_recess_simulates_that_recess() -> None:
    case1 = build_plan("case1")
    one = case1.with_settings(PlanSettings(rig="1"))
    two = case1.with_settings(PlanSettings(rig="2"))
    deep = case1.with_settings(PlanSettings(rig="2-deep"))
    assert one.scenario == two.scenario == case1.scenario

    (recess,) = deep.scenario.faults["swash_plate"]
    drawn = draw_fault("swash_plate", "A", 0, "any", is_deep=True)
    # the rig draws the angle for each pump, which a twin cannot know
    assert recess == replace(drawn, angle=recess.angle)
    assert one.tasks(0, "data")[0].key != deep.tasks(0, "data")[0].key


def test_the_papers_study_of_the_recess_has_its_dimensions() -> None:
    (recess,) = build_plan("paper-recess").scenario.faults["swash_plate"]
    assert (recess.depth, recess.length, recess.width, recess.contact) == pytest.approx(
        (0.6e-3, 30e-3, 24e-3, "shared")
    )


# ---- fillers of the scarce cell


def test_every_filler_has_the_same_budget_and_none_fills_at_zero() -> None:
    tasks = build_plan("augmentation").tasks(0, "data")
    sets_by_budget: dict[str, set[str]] = {}
    for task in tasks:
        budget = task.factors["synthetic"]
        sets_by_budget.setdefault(budget, set()).add(task.factors["training_set"])

    assert sets_by_budget["0"] == {"measured", "class_weights"}
    assert sets_by_budget["200"] == {*FILLERS, *TWIN_TRAINING_SETS}


def test_an_unknown_source_of_synthetic_windows_is_refused_with_the_known_ones() -> None:
    message = "Unknown source 'smoote' of synthetic windows: must be one of nominal, "
    with pytest.raises(InputError, match=message):
        TrainingSet("smoote")


@pytest.mark.parametrize("source", ["duplicate", "nominal"])
def test_a_filler_fills_the_scarce_cell(dataset: StudyDataset, source: str) -> None:
    synthetic, values = fill_cells(dataset, TrainingSet(source))
    n_synthetic = dataset.scenario.synthetic
    assert synthetic.synthetic.all()
    assert synthetic.counts()["swash_plate", 15e6] == len(synthetic) == n_synthetic
    assert 0 <= values["discriminator"] <= 1


@pytest.mark.parametrize("source", ["duplicate", "nominal"])
def test_a_filler_can_fill_every_class_alike(dataset: StudyDataset, source: str) -> None:
    synthetic, _ = fill_cells(dataset, TrainingSet(source, every_class=True))
    counts = [synthetic.counts()[label, 15e6] for label in synthetic.classes]
    assert counts == [dataset.scenario.synthetic] * 5


# ---- settings


def test_a_study_can_be_run_in_part() -> None:
    augmentation = build_plan("augmentation")
    settings = PlanSettings(values=("72", "0"), training_sets=("calibrated", "measured"))
    tasks = augmentation.with_settings(settings).tasks(0, "data")
    assert {task.factors["synthetic"] for task in tasks} == {"0", "72"}

    # the keys are those of the whole study, so that its finished runs are read
    all_keys = {task.key for task in augmentation.tasks(0, "data")}
    assert {task.key for task in tasks} < all_keys


def test_the_first_selected_classifier_is_the_one_to_compare_with() -> None:
    settings = PlanSettings(classifiers=("chosen", "extra_trees"))
    plan = build_plan("noise").with_settings(settings)
    assert plan.reference_values["classifier"] == "chosen"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (PlanSettings(training_sets=("twin",)), "no training set 'twin'"),
        (PlanSettings(values=("73",)), "no value of synthetic '73'; there are 0, 72, 200"),
        (
            PlanSettings(classifiers=("extra_tres",)),
            "Unknown classifier 'extra_tres'. Did you mean 'extra_trees'",
        ),
    ],
)
def test_an_unknown_part_of_a_study_is_refused_by_name(
    settings: PlanSettings, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        build_plan("augmentation").with_settings(settings)


def test_a_study_without_any_task_is_refused_with_the_reason() -> None:
    settings = PlanSettings(training_sets=("calibrated",), values=("0",))
    plan = build_plan("augmentation").with_settings(settings)
    with pytest.raises(InputError, match="has no task: calibrated is not trained at synthetic 0"):
        run_plan(plan, [])


def test_a_study_takes_three_or_thirteen_sensors() -> None:
    case1 = build_plan("case1")
    thirteen = case1.with_settings(PlanSettings(sensors=13))
    assert thirteen.sensors == len(thirteen.scenario.pump.sensors) == 13

    with pytest.raises(InputError, match="no number of sensors '5'"):
        case1.with_settings(PlanSettings(sensors=5))
