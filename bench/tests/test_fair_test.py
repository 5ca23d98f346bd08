"""The second fair test: its roles, windows with a healthy reference, and the page of its results."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, MPa, random_stream, rpm
from swashtwin.learning import cut_windows
from swashtwin.pump import CLASSES, OperatingCondition, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench import StudyResult, build_plan, fair_test
from swashtwin_bench.fair_test import PRIMARY, Contrast, Score
from swashtwin_bench.rigs.fleet import (
    FLEET_FACTORS,
    WIDE_SUPPORT_SPREAD,
    WIDE_VALUE_SPREAD,
    draw_specimen,
    draw_wide_specimen,
)
from swashtwin_bench.rigs.writing import wide_version
from swashtwin_bench.studies.dataset import StudyDataset, prepare_dataset
from swashtwin_bench.studies.healthy_reference import relative_to_healthy
from swashtwin_bench.studies.scenario import split_scenario

PRESSURES = (MPa(5), MPa(10), MPa(15))
SCENARIO = replace(build_plan("fair-test-2").scenario, held_out=1, windows=2, test_windows=None)


def noise_recording(specimen: str, label: str, pressure: float, repeat: int) -> Recording:
    """Return noise whose loudness is that of the pump, doubled by a fault."""
    name = f"{specimen}_{label}_{pressure / 1e6:g}_{repeat}"
    loudness = {"A": 1.0, "B": 3.0, "C": 0.2}[specimen] * (1 if label == "normal" else 2)
    return Recording(
        signal=loudness * random_stream(0, name).normal(size=(2, 4096)),
        sample_rate=25600.0,
        channels=("cover_z", "body_y"),
        recording_id=name,
        label=label,
        specimen=specimen,
        condition=OperatingCondition(speed=rpm(860), discharge_pressure=pressure),
    )


@pytest.fixture(scope="module")
def noises() -> list[Recording]:
    """Three recordings of each class, pressure and pump."""
    return [
        noise_recording(specimen, label, pressure, repeat)
        for specimen in "ABC"
        for label in CLASSES
        for pressure in PRESSURES
        for repeat in range(3)
    ]


@pytest.fixture(scope="module")
def dataset(noises: list[Recording]) -> StudyDataset:
    return prepare_dataset(noises, replace(SCENARIO, with_reference=True), 0, ())


# ---- the wide spread


def test_a_pump_of_the_wide_spread_differs_in_values_mounting_and_bearings_alone() -> None:
    nominal = load_pump("25scy14-1b")
    usual = draw_specimen(nominal, "B", 7)
    wide = draw_wide_specimen(nominal, "B", 7)
    changed = replace(wide, values=usual.values, mount=usual.mount, bearing=usual.bearing)
    assert repr(changed) == repr(usual)

    for name in "ABCDEF":
        pump = draw_wide_specimen(nominal, name, 7)
        ratio = pump.values / (np.array(nominal.interfaces.values()) * np.array(FLEET_FACTORS))
        assert np.abs(np.log(ratio)).max() <= WIDE_VALUE_SPREAD
        assert np.abs(np.log([pump.mount, pump.bearing])).max() <= WIDE_SUPPORT_SPREAD
    assert abs(np.log(wide.mount / usual.mount)) > 0.01


def test_only_version_one_has_a_wide_spread() -> None:
    assert wide_version("1") == "1-wide"
    with pytest.raises(InputError, match="Version 2 of the rig has no wide spread"):
        wide_version("2")


# ---- roles


@pytest.mark.parametrize("seed", range(3))
def test_every_pump_has_a_healthy_reference_that_neither_trains_nor_tests(
    noises: list[Recording], seed: int
) -> None:
    split = split_scenario(noises, SCENARIO, seed)
    roles = [split.train, *map(frozenset, split.scarce.values()), *split.tests.values()]
    assert not split.references & frozenset.union(*roles)
    assert sum(map(len, roles)) == len(frozenset.union(*roles))

    by_id = {recording.recording_id: recording for recording in noises}
    references = [by_id[name] for name in split.references]
    assert {recording.label for recording in references} == {"normal"}
    cells = {(r.specimen, r.condition.discharge_pressure) for r in references if r.condition}
    assert len(cells) == len(references) == 9


def test_too_few_recordings_for_a_reference_are_reported(noises: list[Recording]) -> None:
    few = [recording for recording in noises if not recording.recording_id.endswith("_2")]
    with pytest.raises(DataError, match=r"needs 3 recordings of .* of specimen"):
        split_scenario(few, SCENARIO, 0)


def test_settings_that_came_later_leave_the_keys_of_earlier_studies_alone() -> None:
    # a finished run is found by a key that holds this description
    later = {"training_recordings", "with_reference"}
    assert not later & set(build_plan("filling").scenario.describe())
    assert later <= set(replace(SCENARIO, with_reference=True).describe())


# ---- windows with a reference


def test_windows_with_a_reference_show_the_fault_and_not_the_pump(dataset: StudyDataset) -> None:
    relative = dataset.for_training()
    for windows in (relative.measured, *relative.tests.values()):
        power = windows.signal.var(axis=(1, 2))
        assert power[windows.label == "normal"].mean() == pytest.approx(1, rel=0.3)
        assert power[windows.label == "piston"].mean() == pytest.approx(4, rel=0.3)

        for name in set(windows.specimen.tolist()):
            of_pump = power[(windows.specimen == name) & (windows.label == "piston")]
            assert of_pump.mean() == pytest.approx(4, rel=0.5)


def test_without_a_reference_windows_are_as_measured(noises: list[Recording]) -> None:
    dataset = prepare_dataset(noises, SCENARIO, 0, ())
    np.testing.assert_array_equal(dataset.for_training().measured.signal, dataset.measured.signal)


def test_a_gain_does_not_change_windows_with_a_reference(noises: list[Recording]) -> None:
    healthy, faulty = (
        cut_windows([recording], length=2048, classes=CLASSES)
        for recording in (noises[0], noises[3 * len(PRESSURES)])
    )
    expected = relative_to_healthy(faulty, healthy)
    louder = [replace(windows, signal=5 * windows.signal) for windows in (faulty, healthy)]
    np.testing.assert_allclose(relative_to_healthy(*louder).signal, expected.signal, atol=1e-4)


def test_a_machine_without_healthy_windows_is_reported(dataset: StudyDataset) -> None:
    references = dataset.references.subset(dataset.references.specimen != "A")
    with pytest.raises(DataError, match="A has no healthy recording at 5 MPa to compare with"):
        relative_to_healthy(dataset.measured, references)


def test_a_run_counts_the_recordings_that_were_named_right_by_pump(result: StudyResult) -> None:
    for run in result.runs:
        for row in run["rows"]:
            correct, total = np.sum(list(row["correct_recordings"].values()), axis=0)
            assert correct / total == pytest.approx(row["recording_accuracy"])


# ---- the page


def test_the_page_of_the_second_fair_test_is_up_to_date() -> None:
    page = fair_test.TEST_PAGE.read_text(encoding="utf-8")
    expected = fair_test.build_page(page, fair_test.load_scores())
    assert page == expected, "run python -m swashtwin_bench.fair_test page"


def test_the_primary_contrasts_are_trainings_of_the_study() -> None:
    plan = build_plan("fair-test-2")
    for contrast in PRIMARY:
        assert contrast.reference in plan.variants
        assert contrast.classifier in plan.models
        assert {contrast.first, contrast.second} <= set(plan.training_sets)


def test_the_page_states_the_primary_contrasts() -> None:
    page = fair_test.TEST_PAGE.read_text(encoding="utf-8")
    classifiers = {"extra_trees": "extra trees", "chosen": "default training"}
    pumps = {"L2": "trained pumps (L2)", "L4": "new pumps (L4)"}
    for number, contrast in enumerate(PRIMARY, 1):
        assert (
            f"{number}. `{contrast.first}` minus `{contrast.second}`: {contrast.spread} spread, "
            f"{contrast.reference} reference, {classifiers[contrast.classifier]}, "
            f"{pumps[contrast.split]}."
        ) in page


def test_the_second_primary_contrast_is_what_the_default_training_sees() -> None:
    # it compares whole recordings with healthy ones, and windows of twins are none
    assert (PRIMARY[1].classifier, PRIMARY[1].reference) == ("chosen", "without")


def scores_of(contrast: Contrast, gains: list[int]) -> list[Score]:
    """Return scores of two pumps in which the first training set names more recordings right."""
    scores = []
    for fleet, gain in enumerate(gains):
        for name, correct in ((contrast.first, 10 + gain), (contrast.second, 10)):
            score = Score(
                contrast.spread,
                fleet,
                contrast.reference,
                contrast.classifier,
                name,
                contrast.split,
                (correct, correct),
                (20, 20),
                0.5,
                f"seed{fleet}-{name}",
            )
            scores.append(score)
    return scores


@pytest.mark.parametrize(
    ("gains", "verdict"),
    [
        ([2, 3, 2, 3], "+12.5 (+7.9…+17.1), shown"),
        ([-1, 0, -1, 0], "-2.5 (-7.1…+2.1), refuted for practical purposes"),
        ([-4, 4, 5, -3], "neither shown nor refuted"),
    ],
)
def test_the_verdict_follows_the_interval(gains: list[int], verdict: str) -> None:
    assert verdict in fair_test.describe_primary(PRIMARY[0], scores_of(PRIMARY[0], gains))


def test_only_fleets_with_both_training_sets_are_paired() -> None:
    scores = scores_of(PRIMARY[0], [1, 2])
    assert PRIMARY[0].differences(scores) == pytest.approx([0.05, 0.1])
    assert PRIMARY[0].differences(scores[:-1]) == pytest.approx([0.05])


def test_scores_survive_their_file_and_fill_the_page(tmp_path: Path) -> None:
    scores = scores_of(PRIMARY[0], [2, 3, 2]) + scores_of(PRIMARY[1], [1, 1, 0])
    fair_test.write_scores(scores, tmp_path / "runs.csv")
    assert fair_test.load_scores(tmp_path / "runs.csv") == scores

    page = fair_test.build_page(f"# Test\n{fair_test.MARKER}old", scores)
    assert page.startswith("# Test\n")
    assert not page.endswith("old")
    assert "|wide, without, extra trees|" in page
    with pytest.raises(InputError, match="The page has no line"):
        fair_test.build_page("# Test\n", scores)


def test_the_interval_of_an_accuracy_is_wider_than_that_of_independent_recordings() -> None:
    scores = scores_of(PRIMARY[0], [0] * 4)
    unlike_pumps = [replace(score, correct=(1, 19)) for score in scores]
    low, high = fair_test.pump_interval(unlike_pumps)
    # eight pumps of 0.05 or 0.95, not 160 recordings of 0.5
    assert high - low > 0.4


def write_run(folder: Path, key: str, version: str = "1-wide") -> Path:
    """Write the run of one training, and return its folder."""
    run = {
        "key": key,
        "seed": 40,
        "origin": f"Recordings of the swashtwin virtual rig, version {version}: a stand-in.",
        "factors": {"classifier": "extra_trees", "training_set": "nominal", "reference": "with"},
        "rows": [
            {"split": "L4", "correct_recordings": {"A": [3, 4]}, "scarce_recall": 0.25},
            {"split": "L2", "correct_recordings": {"B": [4, 4]}, "scarce_recall": 0.5},
        ],
    }
    file = folder / "fair-test-2" / key / "result.json"
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps(run))
    return file.parent


def test_runs_are_collected_from_the_folders_of_the_study(tmp_path: Path) -> None:
    write_run(tmp_path, "seed40-x")

    trained, new = fair_test.collect_runs([tmp_path, tmp_path])
    assert (new.spread, new.fleet, new.split, new.accuracy) == ("wide", 40, "L4", 0.75)
    assert (trained.split, trained.accuracy) == ("L2", 1.0)
    with pytest.raises(InputError, match="has no run of fair-test-2"):
        fair_test.collect_runs([tmp_path / "fair-test-2"])


def test_collected_runs_are_added_to_the_table(tmp_path: Path) -> None:
    table = scores_of(PRIMARY[0], [2, 3])
    write_run(tmp_path, "seed40-x")
    collected = fair_test.collect_runs([tmp_path])

    both = fair_test.add_scores(table, collected)
    assert len(both) == len(table) + 2
    assert fair_test.add_scores(both, collected) == both

    repeated = [replace(score, run="seed40-y") for score in collected]
    with pytest.raises(InputError, match="has run seed40-x, and the folders have seed40-y"):
        fair_test.add_scores(both, repeated)


def test_two_runs_of_one_training_are_reported_with_the_one_to_delete(tmp_path: Path) -> None:
    # a run that is repeated after a fix has another key
    second = write_run(tmp_path, "seed40-a")
    first = write_run(tmp_path, "seed40-b")
    os.utime(first / "result.json", (0, 0))

    with pytest.raises(InputError) as error:
        fair_test.collect_runs([tmp_path])
    assert str(second) in str(error.value)
    assert str(error.value).endswith(f"Delete the earlier one: {first}.")


def test_a_run_on_another_rig_is_reported(tmp_path: Path) -> None:
    folder = write_run(tmp_path, "seed40-x", version="2")
    with pytest.raises(InputError, match="is a run on version 2 of the rig") as error:
        fair_test.collect_runs([tmp_path])
    assert str(folder) in str(error.value)
